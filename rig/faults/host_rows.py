"""The host: signals, processes, clocks, disks, files; and the specimen: rows of the fault matrix, in its order."""

from __future__ import annotations

from rig.faults.row import Ending, FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="sigint", fault="SIGINT",
        where="process", place="signal", detected_by="handler posts event",
        limit_s=0.05, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
    ),
    FaultRow(
        slug="sigint-storm", fault="Repeated SIGINT",
        where="process", place="signal", detected_by="must not interrupt the stop",
        limit_s=0.05, reaction="continue S2", end=StopKind.FADE_OUT, disk="J", resume="c",
    ),
    FaultRow(
        slug="sigterm", fault="SIGTERM/SIGHUP",
        where="process", place="signal", detected_by="explicit handlers",
        limit_s=0.05, reaction="S1", end=StopKind.PRESSURE_OFF, disk="J", resume="c",
    ),
    FaultRow(
        slug="sigkill", fault="SIGKILL, OOM, segfault",
        where="process", place="signal", detected_by="both devices time out",
        limit_s=0.5, reaction="controller S2, ECU 0 A", end=StopKind.FADE_OUT, disk="K", resume="c",
        code=50, detector="application's link ended",
    ),
    FaultRow(
        slug="host-stalled", fault="GC/CPU starvation (SIGSTOP)",
        where="process", place="signal", detected_by="no kick; loop lag",
        limit_s=0.5, reaction="as 46", end=StopKind.FADE_OUT, disk="K", resume="c",
        code=51, detector="no heartbeat from the application within the heartbeat time-out",
    ),
    FaultRow(
        slug="host-late", fault="Computer too busy: monitoring paused",
        where="process", place="starvation", detected_by="excess waiting time of its threads, silence of all devices",
        limit_s=0.05, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=54, detector="the station did not run, or heard no device at all, for longer than allowed",
    ),
    FaultRow(
        slug="host-suspend", fault="Laptop suspend",
        where="process", place="clock", detected_by="BOOTTIME–MONOTONIC jump",
        limit_s=0.5, reaction="as 46; never continue", end=StopKind.FADE_OUT, disk="K", resume="c",
        code=58, detector="BOOTTIME advanced while MONOTONIC stopped: the computer was suspended",
    ),
    FaultRow(
        slug="clock-step", fault="NTP step",
        where="process", place="clock", detected_by="monotonic control; log offset",
        limit_s=1.0, reaction="W", end=Ending.WARN, disk="J", resume="a",
    ),
    FaultRow(
        slug="disk-full", fault="Disk full",
        where="process", place="disk", detected_by="forecast; write error; journal preallocated",
        limit_s=1.0, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
    ),
    FaultRow(
        slug="dir-readonly", fault="Read-only dir, existing file",
        where="process", place="disk", detected_by="preflight",
        occasion="start", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="fsync-error", fault="fsync error",
        where="process", place="disk", detected_by="abandon the file; no retry",
        occasion="1 flush", reaction="S2", end=StopKind.FADE_OUT, disk="K", resume="c",
    ),
    FaultRow(
        slug="two-instances", fault="Two instances",
        where="process", place="process", detected_by="flock per rig, controller lease",
        occasion="start", reaction="R second", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="task-dies", fault="A task ends unexpectedly",
        where="process", place="process", detected_by="supervisor",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=53, detector="a thread of the station ended",
    ),
    FaultRow(
        slug="config-absurd", fault="Implausible limits, wrong units",
        where="process", place="file", detected_by="typed units, rig envelope",
        occasion="load", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="matrix-infeasible", fault="Matrix exceeds stroke/velocity/force",
        where="process", place="file", detected_by="A, 2πfA, (2πf)²A, F(I,v), flow, heat",
        occasion="before first move", reaction="R all", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="matrix-changed", fault="Duplicate ids, matrix changed",
        where="process", place="file", detected_by="hash",
        occasion="load", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="wrong-damper", fault="Wrong damper",
        where="wire", place="specimen", detected_by="serial plus 0 A signature",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="estop", fault="E-stop mid-test",
        where="wire", place="controller", detected_by="read-only input",
        limit_s=0.1, occasion="HW; host ", reaction="HW; current→0, latch", end=StopKind.PRESSURE_OFF, disk="J",
        resume="n",
        code=40, detector="e-stop chain open",
    ),
    FaultRow(
        slug="load-train", fault="Load-train crack/looseness",
        where="wire", place="specimen", detected_by="peak, work, servo error per cycle",
        occasion="1 cycle", reaction="S1", end=StopKind.PRESSURE_OFF, disk="J", resume="n",
    ),
)

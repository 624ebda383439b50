"""The host: signals, processes, clocks, disks, files; and the specimen: rows of the fault matrix, in its order."""

from __future__ import annotations

from rig.faults.row import Ending, FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="sigint", fault="SIGINT",
        where="process", place="signal", detected_by="the signal handler sends an event",
        limit_s=0.05, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
    ),
    FaultRow(
        slug="sigint-storm", fault="Repeated SIGINT",
        where="process", place="signal", detected_by="the stop in progress must not be interrupted",
        limit_s=0.05, reaction="continue S2", end=StopKind.FADE_OUT, disk="J", resume="c",
    ),
    FaultRow(
        slug="sigterm", fault="SIGTERM or SIGHUP",
        where="process", place="signal", detected_by="explicit handlers",
        limit_s=0.05, reaction="S1", end=StopKind.PRESSURE_OFF, disk="J", resume="c",
    ),
    FaultRow(
        slug="sigkill", fault="SIGKILL, out of memory or crash",
        where="process", place="signal", detected_by="time-out of both devices",
        limit_s=0.5, reaction="controller S2, ECU 0 A", end=StopKind.FADE_OUT, disk="K", resume="c",
        code=50, detector="the application's link was closed",
    ),
    FaultRow(
        slug="host-stalled", fault="Application not running (SIGSTOP, busy CPU)",
        where="process", place="signal", detected_by="missing heartbeat, delay of the loop",
        limit_s=0.5, reaction="as 46", end=StopKind.FADE_OUT, disk="K", resume="c",
        code=51, detector="no heartbeat from the application within the heartbeat time-out",
    ),
    FaultRow(
        slug="host-late", fault="Computer too busy: monitoring paused",
        where="process", place="starvation", detected_by="threads waiting too long, or no data from any device",
        limit_s=0.05, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=54, detector="the station was paused, or received no data from any device, for longer than allowed",
    ),
    FaultRow(
        slug="host-suspend", fault="Computer suspended",
        where="process", place="clock", detected_by="jump of BOOTTIME relative to MONOTONIC",
        limit_s=0.5, reaction="as 46; never continue", end=StopKind.FADE_OUT, disk="K", resume="c",
        code=58, detector="BOOTTIME advanced while MONOTONIC did not: the computer was suspended",
    ),
    FaultRow(
        slug="clock-step", fault="NTP step",
        where="process", place="clock", detected_by="control uses the monotonic clock; the offset is logged",
        limit_s=1.0, reaction="W", end=Ending.WARN, disk="J", resume="a",
    ),
    FaultRow(
        slug="disk-full", fault="Disk full",
        where="process", place="disk",
        detected_by="estimate before the start, write error; the journal is preallocated",
        limit_s=1.0, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
    ),
    FaultRow(
        slug="dir-readonly", fault="Read-only folder or existing file",
        where="process", place="disk", detected_by="preflight",
        occasion="start", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="fsync-error", fault="fsync error",
        where="process", place="disk", detected_by="the file is abandoned, without a retry",
        occasion="1 flush", reaction="S2", end=StopKind.FADE_OUT, disk="K", resume="c",
    ),
    FaultRow(
        slug="two-instances", fault="Two instances",
        where="process", place="process", detected_by="file lock for each rig, controller lease",
        occasion="start", reaction="R second", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="task-dies", fault="A thread ended unexpectedly",
        where="process", place="process", detected_by="supervisor",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=53, detector="a thread of the station ended",
    ),
    FaultRow(
        slug="config-absurd", fault="Implausible limits, wrong units",
        where="process", place="file", detected_by="check of units, envelope of the rig",
        occasion="load", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="matrix-infeasible", fault="Matrix exceeds stroke, velocity or force",
        where="process", place="file", detected_by="A, 2πfA, (2πf)²A, F(I,v), flow, heat",
        occasion="before first move", reaction="R all", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="matrix-changed", fault="Duplicate IDs or changed matrix",
        where="process", place="file", detected_by="hash",
        occasion="load", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="wrong-damper", fault="Wrong damper",
        where="wire", place="specimen", detected_by="serial number and 0 A signature",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="estop", fault="E-stop during a test",
        where="wire", place="controller", detected_by="read-only input",
        limit_s=0.1, occasion="HW; host ", reaction="HW; current→0, latch", end=StopKind.PRESSURE_OFF, disk="J",
        resume="n",
        code=40, detector="the e-stop chain is open",
    ),
    FaultRow(
        slug="load-train", fault="Crack or loose joint in the load train",
        where="wire", place="specimen", detected_by="peak force, work and servo error of each cycle",
        occasion="1 cycle", reaction="S1", end=StopKind.PRESSURE_OFF, disk="J", resume="n",
    ),
)

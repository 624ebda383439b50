"""The host: signals, processes, clocks, disks, files; and the specimen: rows of the fault matrix, in its order."""

from __future__ import annotations

from rig.faults.row import Ending, FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="sigint", fault="SIGINT",
        where="process", place="signal", detected_by="handler posts event",
        limit_s=0.05, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        test="test_signals.py::test_ctrl_c_stops_and_a_storm_of_further_ones_changes_nothing_and_cuts_nothing_short",
    ),
    FaultRow(
        slug="sigint-storm", fault="Repeated SIGINT",
        where="process", place="signal", detected_by="must not cut stop",
        limit_s=0.05, reaction="continue S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        test="test_signals.py::test_ctrl_c_stops_and_a_storm_of_further_ones_changes_nothing_and_cuts_nothing_short",
    ),
    FaultRow(
        slug="sigterm", fault="SIGTERM/SIGHUP",
        where="process", place="signal", detected_by="explicit handlers",
        limit_s=0.05, reaction="S1", end=StopKind.PRESSURE_OFF, disk="J", resume="c",
        test="test_signals.py::test_the_end_of_the_session_also_takes_the_pressure_away",
    ),
    FaultRow(
        slug="sigkill", fault="SIGKILL, OOM, segfault",
        where="process", place="signal", detected_by="both devices time out",
        limit_s=0.5, reaction="controller S2, ECU 0 A", end=StopKind.FADE_OUT, disk="K", resume="c",
        code=50, detector="application's link ended",
        test="test_signals.py::test_a_killed_application_leaves_a_rig_at_rest_and_a_campaign_that_resumes",
    ),
    FaultRow(
        slug="host-stalled", fault="GC/CPU starvation (SIGSTOP)",
        where="process", place="signal", detected_by="no kick; loop lag",
        limit_s=0.5, reaction="as 46", end=StopKind.FADE_OUT, disk="K", resume="c",
        code=51, detector="no beat from the application within the heartbeat time-out",
        test="test_signals.py::test_an_application_that_stands_still_is_stopped_by_the_station_and_finds_it_so",
    ),
    FaultRow(
        slug="host-late", fault="Station kept from running",
        where="process", place="starvation", detected_by="its threads' own waits, no device heard at all",
        limit_s=0.05, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=54, detector="the station did not run, or heard no device at all, for longer than allowed",
        test="test_host_late.py::test_a_station_that_is_held_up_for_too_long_stops_the_rig_and_blames_nobody_else",
    ),
    FaultRow(
        slug="host-suspend", fault="Laptop suspend",
        where="process", place="clock", detected_by="BOOTTIME–MONOTONIC jump",
        limit_s=0.5, reaction="as 46; never continue", end=StopKind.FADE_OUT, disk="K", resume="c",
        code=58, detector="BOOTTIME went on while MONOTONIC stood still: the machine slept",
        test="test_clocks_and_disks.py::test_a_machine_that_slept_stops_and_never_continues",
    ),
    FaultRow(
        slug="clock-step", fault="NTP step",
        where="process", place="clock", detected_by="monotonic control; log offset",
        limit_s=1.0, reaction="W", end=Ending.WARN, disk="J", resume="a",
        test="test_clocks_and_disks.py::test_a_step_of_the_wall_clock_is_logged_and_disturbs_nothing",
    ),
    FaultRow(
        slug="disk-full", fault="Disk full",
        where="process", place="disk", detected_by="forecast; write error; journal preallocated",
        limit_s=1.0, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        test="test_clocks_and_disks.py::test_a_disk_that_is_full_stops_the_rig_and_what_was_written_is_recovered",
    ),
    FaultRow(
        slug="dir-readonly", fault="Read-only dir, existing file",
        where="process", place="disk", detected_by="preflight",
        occasion="start", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
        test="test_refusals.py::test_a_folder_that_cannot_be_written_is_refused_before_a_rig_is_touched",
    ),
    FaultRow(
        slug="fsync-error", fault="fsync error",
        where="process", place="disk", detected_by="abandon file; never retry-and-trust",
        occasion="1 flush", reaction="S2", end=StopKind.FADE_OUT, disk="K", resume="c",
        test="test_clocks_and_disks.py::test_a_flush_that_failed_is_never_trusted",
    ),
    FaultRow(
        slug="two-instances", fault="Two instances",
        where="process", place="process", detected_by="flock per rig, controller lease",
        occasion="start", reaction="R second", end=Ending.REFUSE, disk="N", resume="c",
        test="test_refusals.py::test_a_second_campaign_on_a_rig_is_refused_and_the_first_goes_on",
    ),
    FaultRow(
        slug="task-dies", fault="Any task dies",
        where="process", place="process", detected_by="supervisor",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=53, detector="a thread of the station ended",
        test="test_clocks_and_disks.py::test_a_thread_of_the_station_that_dies_stops_the_rig",
    ),
    FaultRow(
        slug="config-absurd", fault="Absurd limits, wrong units",
        where="process", place="file", detected_by="typed units, rig envelope",
        occasion="load", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
        test="test_refusals.py::test_an_absurd_bench_is_refused_with_key_and_value_before_anything_is_connected",
    ),
    FaultRow(
        slug="matrix-infeasible", fault="Matrix exceeds stroke/velocity/force",
        where="process", place="file", detected_by="A, 2πfA, (2πf)²A, F(I,v), flow, heat",
        occasion="before first move", reaction="R all", end=Ending.REFUSE, disk="N", resume="c",
        test="test_refusals.py::test_a_matrix_beyond_the_rig_is_refused_whole_and_names_point_and_reason",
    ),
    FaultRow(
        slug="matrix-changed", fault="Duplicate ids, matrix changed",
        where="process", place="file", detected_by="hash",
        occasion="load", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
        test="test_refusals.py::test_a_changed_matrix_or_bench_is_not_resumed_and_a_double_id_not_loaded",
    ),
    FaultRow(
        slug="wrong-damper", fault="Wrong damper",
        where="wire", place="specimen", detected_by="serial plus 0 A signature",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
        test="test_refusals.py::test_a_damper_stronger_than_its_prior_is_refused_before_the_matrix_moves",
    ),
    FaultRow(
        slug="estop", fault="E-stop mid-test",
        where="wire", place="controller", detected_by="read-only input",
        limit_s=0.1, occasion="HW; host ", reaction="HW; current→0, latch", end=StopKind.PRESSURE_OFF, disk="J",
        resume="n",
        code=40, detector="e-stop chain open",
        test="test_controller.py::test_an_opened_e_stop_chain_is_mirrored_and_latched",
    ),
    FaultRow(
        slug="load-train", fault="Load-train crack/looseness",
        where="wire", place="specimen", detected_by="peak, work, servo error per cycle",
        occasion="1 cycle", reaction="S1", end=StopKind.PRESSURE_OFF, disk="J", resume="n",
        test="test_controller.py::test_a_joint_that_works_loose_stops_the_rig_within_a_cycle",
    ),
)

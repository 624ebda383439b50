"""The fault matrix as data: each row with where it is injected, what must follow, and the test that proves it.

One source: `python -m simulators --list-faults` prints it, the station takes its reactions from it, the campaign its
retries, and the fault suite (`tests/faults`) its expectations. A row without a test fails the suite.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from rig.errors import EXIT_DONE, EXIT_NOT_ALL_VALID, EXIT_REFUSED, EXIT_STOPPED, EXIT_USAGE

_SECONDS = {"ms": 1e-3, "s": 1.0}
EXIT_CODES = {"W": EXIT_DONE, "P": EXIT_NOT_ALL_VALID, "R": EXIT_REFUSED}
UNUSABLE_FILES = frozenset({"config-absurd"})
"""Refused while the file is read, as every file with wrong entries: the user mends the file, not the rig."""


@dataclass(frozen=True)
class FaultRow:
    """One fault.

    Attributes:
        slug: name in options, journal and test ids.
        fault: what goes wrong.
        where: "wire", injected by the simulated rig (`--fault SLUG@T`), or "process", injected around the processes.
        place: what is hit: "modbus", "rtu", "controller", "can", "ecu", "sensor", "specimen" on the wire; "signal",
            "silence", "starvation", "clock", "disk", "port look-up", "process", "file" around it.
        detected_by: how the host notices.
        limit: longest time from the fault to the stop command or flag, at speed 1 with real-time rights.
        reaction: R refuse, W warn, P invalid point, S2, S1, SO stops, HW the hard-wired chain.
        stop: how the fault ends when it stays: "R", "W", "P", or the host's stop "S2", "S1", "SO".
        disk: J journal and INVALID, K the last flush survives, N a refusal record only.
        resume: a automatic, c the operator confirms, n re-qualify.
        test: file and function in `tests/faults` that prove the end state; empty while there is none.
        reason: why a row without a test cannot have one on an ordinary machine.
    """

    slug: str
    fault: str
    where: str
    place: str
    detected_by: str
    limit: str
    reaction: str
    stop: str
    disk: str
    resume: str
    test: str
    reason: str = ""

    @property
    def limit_s(self) -> float | None:
        """The limit's time (s); None where it is no time but an occasion."""
        found = re.search(r"([\d.]+) ?(ms|s)$", self.limit)
        return float(found[1]) * _SECONDS[found[2]] if found else None

    @property
    def exit_code(self) -> int:
        """Exit code of `rig run` when the fault stays: the reaction's, but for a file of no use that of bad files."""
        return EXIT_USAGE if self.slug in UNUSABLE_FILES else EXIT_CODES.get(self.stop, EXIT_STOPPED)

    @property
    def tested(self) -> bool:
        """The fault suite proves its end state."""
        return bool(self.test)

    @property
    def missing(self) -> str:
        """Why the row is not tested; empty when it is."""
        return "" if self.tested else self.reason or NO_TEST


_ROWS = (
    FaultRow(
        "modbus-busy", "Modbus exception 06", "wire", "modbus", "bounded retries",
        "150ms", "W→S2", "S2", "J", "a",
        "test_modbus.py::test_a_controller_that_stays_busy_is_stopped_by_its_own_watchdog_and_by_the_current",
    ),
    FaultRow(
        "modbus-reject", "Exception 02/03/04 on write", "wire", "modbus", "no positive ack",
        "50ms", "S2", "S2", "J", "c",
        "test_modbus.py::test_a_controller_that_refuses_writes_is_read_on_and_stopped_by_its_own_watchdog",
    ),
    FaultRow(
        "modbus-reset", "RST mid-response", "wire", "modbus", "outcome unknown: read back before resend",
        "100ms", "S2", "S2", "J", "c",
        "test_modbus.py::test_a_reset_connection_stops_the_rig_over_a_new_one",
    ),
    FaultRow(
        "modbus-halfopen", "Half-open TCP: blackhole", "wire", "modbus", "request deadline",
        "200ms", "S2", "S2", "J", "c",
        "test_modbus.py::test_a_half_open_connection_is_given_up_and_the_rig_stopped_over_a_new_one",
    ),
    FaultRow(
        "modbus-wrong-tid", "Wrong transaction id", "wire", "modbus", "discard; reconnect at second",
        "100ms", "W", "W", "J", "a",
        "test_modbus.py::test_passing_troubles_of_the_link_are_overcome_and_flagged",
    ),
    FaultRow(
        "rtu-stale", "Stale RTU reply (no id)", "wire", "rtu", "drain after timeout; verify effect",
        "200ms", "P", "P", "J", "a",
        "test_modbus.py::test_stale_answers_on_a_serial_line_are_never_believed_and_spoil_the_point",
    ),
    FaultRow(
        "rtu-crc", "RTU CRC, truncated, extra bytes", "wire", "rtu", "strict frame; retry reads only",
        "150ms", "W→S2", "S2", "J", "a",
        "test_modbus.py::test_damaged_answers_on_a_serial_line_are_read_again_and_then_stop_the_rig",
    ),
    FaultRow(
        "modbus-mismatch", "Wrong unit/function/count", "wire", "modbus", "match against request",
        "50ms", "W→S2", "S2", "J", "a",
        "test_modbus.py::test_answers_to_another_function_stop_the_rig",
    ),
    FaultRow(
        "modbus-write-lost", "Write acked, register unchanged", "wire", "controller", "readback plus motion",
        "100ms", "S2", "S2", "J", "c",
        "test_modbus.py::test_lost_writes_are_seen_by_their_missing_effect",
    ),
    FaultRow(
        "actuator-frozen", "Position register frozen", "wire", "controller", "controller heartbeat, LVDT disagreement",
        "100ms", "SO", "SO", "J", "c",
        "test_controller.py::test_a_frozen_position_register_is_not_trusted_and_the_halt_ramp_is_used",
    ),
    FaultRow(
        "actuator-reboot", "Controller reboot, defaults", "wire", "controller", "boot counter, config hash",
        "50ms", "S1", "S1", "J", "n",
        "test_controller.py::test_a_rebooted_controller_is_never_taken_for_the_one_that_was_prepared",
    ),
    FaultRow(
        "host-silent", "Host stops kicking", "process", "silence", "controller latches trip",
        "500ms", "controller S2", "S2", "J/K", "c",
        "test_controller.py::test_a_station_that_falls_silent_is_stopped_by_the_controllers_watchdog",
    ),
    FaultRow(
        "watchdog-absent", "Watchdog disabled or 'freeze'", "wire", "controller", "starve it before each campaign",
        "preflight", "R", "R", "N", "c",
        "test_controller.py::test_a_watchdog_that_does_not_trip_is_refused",
    ),
    FaultRow(
        "second-master", "Second Modbus master", "wire", "controller", "setpoint/owner mismatch",
        "50ms", "S2", "S2", "J", "c",
        "test_controller.py::test_a_second_master_is_noticed_and_the_motion_stopped",
    ),
    FaultRow(
        "stop-ignored", "Stop ignored", "wire", "controller", "LVDT velocity after ramp",
        "ramp+100ms", "S1→trip", "S1", "J", "n",
        "test_controller.py::test_a_program_that_does_not_end_is_stopped_by_taking_the_pressure_away",
    ),
    FaultRow(
        "register-layout", "Word order/scale wrong", "wire", "controller", "signature register",
        "connect", "R", "R", "N", "c",
        "test_controller.py::test_another_word_order_is_refused_at_connect",
    ),
    FaultRow(
        "can-busoff", "CAN bus-off", "wire", "can", "error state, status silence",
        "30ms", "S2", "S2", "J", "c",
        "test_coil_and_bus.py::test_bus_off_is_told_from_a_silent_ecu",
    ),
    FaultRow(
        "ecu-silent", "Status missing", "wire", "ecu", "timeout", "30ms", "S2", "S2", "J", "a",
        "test_coil_and_bus.py::test_a_silent_ecu_stops_the_rig",
    ),
    FaultRow(
        "ecu-late", "Status late/duplicated", "wire", "ecu", "counter delta, age",
        "30ms", "W→S2", "S2", "J", "a",
        "test_coil_and_bus.py::test_status_frames_that_come_twice_warn_and_stop_when_they_keep_coming",
    ),
    FaultRow(
        "ecu-crc", "Wrong counter/CRC", "wire", "ecu", "drop frame; third trips",
        "30ms", "S2", "S2", "J", "a",
        "test_coil_and_bus.py::test_status_frames_with_a_wrong_crc_stop_the_rig",
    ),
    FaultRow(
        "can-malformed", "DLC short, RTR, extended id", "wire", "can", "check before decode",
        "10ms", "as 20", "S2", "J", "a",
        "test_coil_and_bus.py::test_short_remote_and_extended_frames_are_never_decoded",
    ),
    FaultRow(
        "can-babble", "Babbling node", "wire", "can", "bus load, status jitter",
        "100ms", "S2", "S2", "J", "c",
        "test_coil_and_bus.py::test_a_babbling_node_stops_the_rig",
    ),
    FaultRow(
        "can-foreign", "Foreign sender on our command id", "wire", "can", "self-id seen",
        "10ms", "S2", "S2", "J", "c",
        "test_coil_and_bus.py::test_another_sender_on_our_command_id_stops_the_rig",
    ),
    FaultRow(
        "ecu-overtemp", "ECU over-temp/undervoltage", "wire", "ecu", "status bits",
        "20ms", "S2, cool", "S2", "J", "a",
        "test_coil_and_bus.py::test_a_hot_ecu_and_one_without_supply_stop_the_rig",
    ),
    FaultRow(
        "coil-open-short", "Coil open/short", "wire", "ecu", "bits, measured current",
        "20ms", "S2", "S2", "J", "n",
        "test_coil_and_bus.py::test_a_broken_coil_stops_the_rig",
    ),
    FaultRow(
        "current-tracking", "Current tracking error", "wire", "ecu", "tolerance after settling",
        "50ms", "P; overcurrent S2", "P", "J", "a",
        "test_coil_and_bus.py::test_a_current_off_its_setpoint_is_flagged_at_once_and_spoils_the_point",
    ),
    FaultRow(
        "ecu-restart", "ECU restart", "wire", "ecu", "counter/state reset", "30ms", "S2", "S2", "J", "c",
        "test_coil_and_bus.py::test_an_ecu_that_starts_anew_stops_the_rig",
    ),
    FaultRow(
        "current-stuck", "Current persists after zero", "wire", "ecu", "measured current",
        "200ms", "S1, cut coil supply", "S1", "J", "n",
        "test_coil_and_bus.py::test_a_current_that_stays_after_zero_takes_the_hydraulics_away",
    ),
    FaultRow(
        "loadcell-pulled", "Load-cell cable pulled", "wire", "sensor", "EOF, EIO or 5 missing samples",
        "20ms", "S2", "S2", "J", "c",
        "test_sensors.py::test_a_pulled_load_cell_stops_the_rig",
    ),
    FaultRow(
        "lvdt-pulled", "Host LVDT lost", "wire", "sensor", "same; controller position cross-check",
        "20ms", "S2; also control feedback: SO", "S2", "J", "c",
        "test_sensors.py::test_without_its_lvdt_the_host_proves_standstill_by_the_controller",
    ),
    FaultRow(
        "serial-garbage", "Garbage, byte loss, framing shift", "wire", "sensor", "checksum resync, error rate",
        "100ms", "P→S2", "S2", "J", "a",
        "test_sensors.py::test_damaged_frames_warn_and_stop_when_there_are_many",
    ),
    FaultRow(
        "serial-baud", "Baud mismatch (garbled bytes)", "wire", "sensor", "no valid frame",
        "500ms", "R/S2", "S2", "N/J", "c",
        "test_sensors.py::test_bytes_without_one_valid_frame_stop_the_rig",
    ),
    FaultRow(
        "sensor-stuck", "Stuck value", "wire", "sensor", "repeats below noise floor while moving",
        "100ms", "S2", "S2", "J", "c",
        "test_sensors.py::test_a_value_that_repeats_in_motion_stops_the_rig",
    ),
    FaultRow(
        "sensor-saturated", "Saturation", "wire", "sensor", "rail/NE 43 band, 3 samples",
        "12ms", "S2", "S2", "J", "c",
        "test_sensors.py::test_three_saturated_samples_stop_the_rig_and_prove_nothing_of_its_standstill",
    ),
    FaultRow(
        "sensor-spike", "Spike", "wire", "sensor", "slew; flag one, trip on 3",
        "12ms", "W→S2", "S2", "J", "a",
        "test_sensors.py::test_single_spikes_are_flagged_and_three_in_a_row_stop_the_rig",
    ),
    FaultRow(
        "sensor-nan", "NaN/inf/comma text", "wire", "sensor", "strict parser: lost sample",
        "4ms", "P", "P", "J", "a",
        "test_sensors.py::test_samples_that_are_no_numbers_spoil_the_point",
    ),
    FaultRow(
        "sample-gap", "Sample-counter gap, device time backwards", "wire", "sensor",
        "counter/order; store gap, never interpolate",
        "4ms", "P >0.1%", "P", "J", "a",
        "test_sensors.py::test_gaps_are_stored_never_filled_and_spoil_the_point",
    ),
    FaultRow(
        "clock-drift", "Clock drift ±500 ppm", "wire", "sensor", "counter–monotonic fit",
        "60s", "W", "W", "J", "a",
        "test_sensors.py::test_a_clock_that_drifts_is_flagged_and_nothing_else",
    ),
    FaultRow(
        "slow-consumer", "Slow consumer", "process", "starvation", "queue high-water; limits checked at reader",
        "100ms", "P; limit lag S2", "P", "J", "a",
        "test_slow_consumer.py::test_what_the_recorder_could_not_take_spoils_the_point_and_nothing_else",
    ),
    FaultRow(
        "usb-renumber", "USB re-enumerates", "wire", "sensor", "bind by serial number; no reopen in motion",
        "20ms", "S2", "S2", "J", "c",
        "test_sensors.py::test_an_adapter_that_comes_up_elsewhere_stops_the_rig_and_is_not_reopened",
    ),
    FaultRow(
        "sensors-swapped", "Sensors swapped, sign/scale wrong", "wire", "sensor", "low-level proof move",
        "preflight", "R", "R", "N", "c",
        "test_sensors.py::test_exchanged_plugs_are_refused_by_name_before_arming",
    ),
    FaultRow(
        "not-tared", "Not tared, LVDT unplugged", "wire", "sensor", "rest window, shunt cal",
        "preflight", "R", "R", "N", "c",
        "test_sensors.py::test_a_sensor_that_was_not_tared_is_refused_before_arming",
    ),
    FaultRow(
        "sigint", "SIGINT", "process", "signal", "handler posts event", "50ms", "S2", "S2", "J", "c",
        "test_signals.py::test_ctrl_c_stops_and_a_storm_of_further_ones_changes_nothing_and_cuts_nothing_short",
    ),
    FaultRow(
        "sigint-storm", "Repeated SIGINT", "process", "signal", "must not cut stop",
        "50ms", "continue S2", "S2", "J", "c",
        "test_signals.py::test_ctrl_c_stops_and_a_storm_of_further_ones_changes_nothing_and_cuts_nothing_short",
    ),
    FaultRow(
        "sigterm", "SIGTERM/SIGHUP", "process", "signal", "explicit handlers", "50ms", "S1", "S1", "J", "c",
        "test_signals.py::test_the_end_of_the_session_also_takes_the_pressure_away",
    ),
    FaultRow(
        "sigkill", "SIGKILL, OOM, segfault", "process", "signal", "both devices time out",
        "500ms", "controller S2, ECU 0 A", "S2", "K", "c",
        "test_signals.py::test_a_killed_application_leaves_a_rig_at_rest_and_a_campaign_that_resumes",
    ),
    FaultRow(
        "host-stalled", "GC/CPU starvation (SIGSTOP)", "process", "signal", "no kick; loop lag",
        "500ms", "as 46", "S2", "K", "c",
        "test_signals.py::test_an_application_that_stands_still_is_stopped_by_the_station_and_finds_it_so",
    ),
    FaultRow(
        "host-late", "Station kept from running", "process", "starvation",
        "its threads' own waits, no device heard at all", "50ms", "W→S2", "S2", "J", "a",
        "test_host_late.py::test_a_station_that_is_held_up_for_too_long_stops_the_rig_and_blames_nobody_else",
    ),
    FaultRow(
        "host-suspend", "Laptop suspend", "process", "clock", "BOOTTIME–MONOTONIC jump",
        "500ms", "as 46; never continue", "S2", "K", "c",
        "test_clocks_and_disks.py::test_a_machine_that_slept_stops_and_never_continues",
    ),
    FaultRow(
        "clock-step", "NTP step", "process", "clock", "monotonic control; log offset",
        "1s", "W", "W", "J", "a",
        "test_clocks_and_disks.py::test_a_step_of_the_wall_clock_is_logged_and_disturbs_nothing",
    ),
    FaultRow(
        "disk-full", "Disk full", "process", "disk", "forecast; write error; journal preallocated",
        "1s", "S2", "S2", "J", "c",
        "test_clocks_and_disks.py::test_a_disk_that_is_full_stops_the_rig_and_what_was_written_is_recovered",
    ),
    FaultRow(
        "dir-readonly", "Read-only dir, existing file", "process", "disk", "preflight",
        "start", "R", "R", "N", "c",
        "test_refusals.py::test_a_folder_that_cannot_be_written_is_refused_before_a_rig_is_touched",
    ),
    FaultRow(
        "fsync-error", "fsync error", "process", "disk", "abandon file; never retry-and-trust",
        "1 flush", "S2", "S2", "K", "c",
        "test_clocks_and_disks.py::test_a_flush_that_failed_is_never_trusted",
    ),
    FaultRow(
        "two-instances", "Two instances", "process", "process", "flock per rig, controller lease",
        "start", "R second", "R", "N", "c",
        "test_refusals.py::test_a_second_campaign_on_a_rig_is_refused_and_the_first_goes_on",
    ),
    FaultRow(
        "task-dies", "Any task dies", "process", "process", "supervisor", "100ms", "S2", "S2", "J", "c",
        "test_clocks_and_disks.py::test_a_thread_of_the_station_that_dies_stops_the_rig",
    ),
    FaultRow(
        "config-absurd", "Absurd limits, wrong units", "process", "file", "typed units, rig envelope",
        "load", "R", "R", "N", "c",
        "test_refusals.py::test_an_absurd_bench_is_refused_with_key_and_value_before_anything_is_connected",
    ),
    FaultRow(
        "matrix-infeasible", "Matrix exceeds stroke/velocity/force", "process", "file",
        "A, 2πfA, (2πf)²A, F(I,v), flow, heat",
        "before first move", "R all", "R", "N", "c",
        "test_refusals.py::test_a_matrix_beyond_the_rig_is_refused_whole_and_names_point_and_reason",
    ),
    FaultRow(
        "matrix-changed", "Duplicate ids, matrix changed", "process", "file", "hash",
        "load", "R", "R", "N", "c",
        "test_refusals.py::test_a_changed_matrix_or_bench_is_not_resumed_and_a_double_id_not_loaded",
    ),
    FaultRow(
        "wrong-damper", "Wrong damper", "wire", "specimen", "serial plus 0 A signature",
        "preflight", "R", "R", "N", "c",
        "test_refusals.py::test_a_damper_stronger_than_its_prior_is_refused_before_the_matrix_moves",
    ),
    FaultRow(
        "estop", "E-stop mid-test", "wire", "controller", "read-only input",
        "HW; host 100ms", "HW; current→0, latch", "S1", "J",
        "n", "test_controller.py::test_an_opened_e_stop_chain_is_mirrored_and_latched",
    ),
    FaultRow(
        "load-train", "Load-train crack/looseness", "wire", "specimen", "peak, work, servo error per cycle",
        "1 cycle", "S1", "S1", "J", "n",
        "test_controller.py::test_a_joint_that_works_loose_stops_the_rig_within_a_cycle",
    ),
)

MATRIX: dict[str, FaultRow] = {row.slug: row for row in _ROWS}
"""The rows by slug, in the order of the matrix."""

NO_TEST = "the fault suite has no test of its end state yet"

STOPS = frozenset({"S2", "S1", "SO"})


def stop_of(slug: str) -> str:
    """The host's stop for a fault that stays: "S2", "S1" or "SO"; "W" where it only flags or refuses.

    Raises:
        KeyError: not a slug of the matrix.
    """
    stop = MATRIX[slug].stop
    return stop if stop in STOPS else "W"


def restarts_by_itself() -> frozenset[str]:
    """Slugs after which the point may restart without the operator (resume "a")."""
    return frozenset(slug for slug, row in MATRIX.items() if row.resume == "a")

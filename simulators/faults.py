"""The fault matrix as data: sixty rows, each with where it is injected and what must follow.

The injectors are in `injection.py`; a row is `tested` once the fault suite has a test of its end state.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class FaultRow:
    """One fault.

    Attributes:
        slug: name in options, journal and test ids.
        fault: what goes wrong.
        where: "modbus", "rtu", "controller", "can", "ecu", "sensor", "specimen" in the simulated rig; "process" around
            the processes; "file" in what the user gives.
        detected_by: how the host notices.
        limit: longest time from the fault to the stop command or flag, at speed 1 with real-time rights.
        reaction: R refuse, W warn, P invalid point, S2, S1, SO stops, HW the hard-wired chain.
        disk: J journal and INVALID, K the last flush survives, N a refusal record only.
        resume: a automatic, c the operator confirms, n re-qualify.
    """

    slug: str
    fault: str
    where: str
    detected_by: str
    limit: str
    reaction: str
    disk: str
    resume: str


TESTED: frozenset[str] = frozenset()
"""Slugs whose end state the fault suite proves."""

_ROWS = (
    ("modbus-busy", "Modbus exception 06", "modbus", "bounded retries", "150ms", "W→S2", "J", "a"),
    ("modbus-reject", "Exception 02/03/04 on write", "modbus", "no positive ack", "50ms", "S2", "J", "c"),
    ("modbus-reset", "RST mid-response", "modbus", "outcome unknown: read back before resend", "100ms", "S2", "J", "c"),
    ("modbus-halfopen", "Half-open TCP: blackhole", "modbus", "request deadline", "200ms", "S2", "J", "c"),
    ("modbus-wrong-tid", "Wrong transaction id", "modbus", "discard; reconnect at second", "100ms", "W", "J", "a"),
    ("rtu-stale", "Stale RTU reply (no id)", "rtu", "drain after timeout; verify effect", "200ms", "P", "J", "a"),
    ("rtu-crc", "RTU CRC, truncated, extra bytes", "rtu", "strict frame; retry reads only", "150ms", "W→S2", "J", "a"),
    ("modbus-mismatch", "Wrong unit/function/count", "modbus", "match against request", "50ms", "W→S2", "J", "a"),
    (
        "modbus-write-lost", "Write acked, register unchanged", "controller", "readback plus motion", "100ms", "S2",
        "J", "c",
    ),
    (
        "actuator-frozen", "Position register frozen", "controller", "controller heartbeat, LVDT disagreement",
        "100ms", "SO", "J", "c",
    ),
    (
        "actuator-reboot", "Controller reboot, defaults", "controller", "boot counter, config hash", "50ms", "S1",
        "J", "n",
    ),
    ("host-silent", "Host stops kicking", "process", "controller latches trip", "500ms", "controller S2", "J/K", "c"),
    (
        "watchdog-absent", "Watchdog disabled or 'freeze'", "controller", "starve it before each campaign",
        "preflight", "R", "N", "c",
    ),
    ("second-master", "Second Modbus master", "controller", "setpoint/owner mismatch", "50ms", "S2", "J", "c"),
    ("stop-ignored", "Stop ignored", "controller", "LVDT velocity after ramp", "ramp+100ms", "S1→trip", "J", "n"),
    ("register-layout", "Word order/scale wrong", "controller", "signature register", "connect", "R", "N", "c"),
    ("can-busoff", "CAN bus-off", "can", "error state, status silence", "30ms", "S2", "J", "c"),
    ("ecu-silent", "Status missing", "ecu", "timeout", "30ms", "S2", "J", "a"),
    ("ecu-late", "Status late/duplicated", "ecu", "counter delta, age", "30ms", "W→S2", "J", "a"),
    ("ecu-crc", "Wrong counter/CRC", "ecu", "drop frame; third trips", "30ms", "S2", "J", "a"),
    ("can-malformed", "DLC short, RTR, extended id", "can", "check before decode", "10ms", "as 20", "J", "a"),
    ("can-babble", "Babbling node", "can", "bus load, status jitter", "100ms", "S2", "J", "c"),
    ("can-foreign", "Foreign sender on our command id", "can", "self-id seen", "10ms", "S2", "J", "c"),
    ("ecu-overtemp", "ECU over-temp/undervoltage", "ecu", "status bits", "20ms", "S2, cool", "J", "a"),
    ("coil-open-short", "Coil open/short", "ecu", "bits, measured current", "20ms", "S2", "J", "n"),
    (
        "current-tracking", "Current tracking error", "ecu", "tolerance after settling", "50ms", "P; overcurrent S2",
        "J", "a",
    ),
    ("ecu-restart", "ECU restart", "ecu", "counter/state reset", "30ms", "S2", "J", "c"),
    (
        "current-stuck", "Current persists after zero", "ecu", "measured current", "200ms", "S1, cut coil supply",
        "J", "n",
    ),
    ("loadcell-pulled", "Load-cell cable pulled", "sensor", "EOF, EIO or 5 missing samples", "20ms", "S2", "J", "c"),
    (
        "lvdt-pulled", "Host LVDT lost", "sensor", "same; controller position cross-check", "20ms",
        "S2; also control feedback: SO", "J", "c",
    ),
    (
        "serial-garbage", "Garbage, byte loss, framing shift", "sensor", "checksum resync, error rate", "100ms",
        "P→S2", "J", "a",
    ),
    ("serial-baud", "Baud mismatch (garbled bytes)", "sensor", "no valid frame", "500ms", "R/S2", "N/J", "c"),
    ("sensor-stuck", "Stuck value", "sensor", "repeats below noise floor while moving", "100ms", "S2", "J", "c"),
    ("sensor-saturated", "Saturation", "sensor", "rail/NE 43 band, 3 samples", "12ms", "S2", "J", "c"),
    ("sensor-spike", "Spike", "sensor", "slew; flag one, trip on 3", "12ms", "W→S2", "J", "a"),
    ("sensor-nan", "NaN/inf/comma text", "sensor", "strict parser: lost sample", "4ms", "P", "J", "a"),
    (
        "sample-gap", "Sample-counter gap, device time backwards", "sensor",
        "counter/order; store gap, never interpolate", "4ms", "P >0.1%", "J", "a",
    ),
    ("clock-drift", "Clock drift ±500 ppm", "sensor", "counter–monotonic fit", "60s", "W", "J", "a"),
    (
        "slow-consumer", "Slow consumer", "process", "queue high-water; limits checked at reader", "100ms",
        "P; limit lag S2", "J", "a",
    ),
    (
        "usb-renumber", "USB re-enumerates", "process", "bind by serial number; no reopen in motion", "20ms", "S2",
        "J", "c",
    ),
    (
        "sensors-swapped", "Sensors swapped, sign/scale wrong", "sensor", "low-level proof move", "preflight", "R",
        "N", "c",
    ),
    ("not-tared", "Not tared, LVDT unplugged", "sensor", "rest window, shunt cal", "preflight", "R", "N", "c"),
    ("sigint", "SIGINT", "process", "handler posts event", "50ms", "S2", "J", "c"),
    ("sigint-storm", "Repeated SIGINT", "process", "must not cut stop", "50ms", "continue S2", "J", "c"),
    ("sigterm", "SIGTERM/SIGHUP", "process", "explicit handlers", "50ms", "S1", "J", "c"),
    (
        "sigkill", "SIGKILL, OOM, segfault", "process", "both devices time out", "500ms", "controller S2, ECU 0 A",
        "K", "c",
    ),
    ("host-stalled", "GC/CPU starvation (SIGSTOP)", "process", "no kick; loop lag", "500ms", "as 46", "K", "c"),
    (
        "host-suspend", "Laptop suspend", "process", "BOOTTIME–MONOTONIC jump", "500ms", "as 46; never continue",
        "K", "c",
    ),
    ("clock-step", "NTP step", "process", "monotonic control; log offset", "1s", "W", "J", "a"),
    ("disk-full", "Disk full", "process", "forecast; write error; journal preallocated", "1s", "S2", "J", "c"),
    ("dir-readonly", "Read-only dir, existing file", "process", "preflight", "start", "R", "N", "c"),
    ("fsync-error", "fsync error", "process", "abandon file; never retry-and-trust", "1 flush", "S2", "K", "c"),
    ("two-instances", "Two instances", "process", "flock per rig, controller lease", "start", "R second", "N", "c"),
    ("task-dies", "Any task dies", "process", "supervisor", "100ms", "S2", "J", "c"),
    ("config-absurd", "Absurd limits, wrong units", "file", "typed units, rig envelope", "load", "R", "N", "c"),
    (
        "matrix-infeasible", "Matrix exceeds stroke/velocity/force", "file", "A, 2πfA, (2πf)²A, F(I,v), flow, heat",
        "before first move", "R all", "N", "c",
    ),
    ("matrix-changed", "Duplicate ids, matrix changed", "file", "hash", "load", "R", "N", "c"),
    ("wrong-damper", "Wrong damper", "specimen", "serial plus 0 A signature", "preflight", "R", "N", "c"),
    ("estop", "E-stop mid-test", "controller", "read-only input", "HW; host 100ms", "HW; current→0, latch", "J", "n"),
    (
        "load-train", "Load-train crack/looseness", "specimen", "peak, work, servo error per cycle", "1 cycle", "S1",
        "J", "n",
    ),
)

ROWS: dict[str, FaultRow] = {row[0]: FaultRow(*row) for row in _ROWS}
"""The rows by slug, in the order of the matrix."""

PROCESS_REASON = "injected around the process by the fault suite, not by the simulated rig"
FILE_REASON = "injected in the files a campaign is given, by the fault suite"
RTU_REASON = "needs the Modbus RTU transport, which the simulated rig does not serve"


def missing_reason(row: FaultRow, injected: bool) -> str:
    """Why a row is not `tested`; empty when it is."""
    if row.slug in TESTED:
        return ""
    if row.where == "process":
        return PROCESS_REASON
    if row.where == "file":
        return FILE_REASON
    if row.where == "rtu":
        return RTU_REASON
    return "injector exists; the fault suite has no test of its end state yet" if injected else "not injected yet"

"""What the station can trip on, as data: one row a slug, with the stop it demands.

The slug is the name used in events, in the journal and by tests; detectors report by slug and the row decides the
reaction, so a detector is switched off (by tests, see `process`) at one place and a reaction is changed at one place.

Reactions: S2 current to 0 A, controller fades out, hold powered. S1 = S2, then hydraulics off. SO (position no longer
trusted): current to 0 A and the controller's open-loop halt. `halt` marks an S2 whose stop is the halt ramp, because a
hard limit was hit. W only warns; the application judges the point by it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Stop(StrEnum):
    """Kinds of stop, weakest first."""

    W = "W"
    S2 = "S2"
    SO = "SO"
    S1 = "S1"

    @property
    def severity(self) -> int:
        """Rank: a stop under way is only ever replaced by one of a higher rank."""
        return list(Stop).index(self)


@dataclass(frozen=True)
class FaultRow:
    """One thing that can go wrong: `detector` says who sees it and how."""

    slug: str
    code: int
    stop: Stop
    detector: str
    halt: bool = False


_ROWS = (
    FaultRow("stroke-limit", 1, Stop.S2, "LVDT sample beyond the stroke limit, or the controller's own bit", halt=True),
    FaultRow("force-limit", 2, Stop.S2, "load-cell sample beyond its limit, or the controller's own bit", halt=True),
    FaultRow("speed-limit", 3, Stop.S2, "LVDT slew over a window, three times in a row, or the controller's own bit"),
    FaultRow("overcurrent", 4, Stop.S2, "measured coil current beyond the limit"),
    FaultRow("coil-temperature", 5, Stop.S2, "coil temperature beyond the limit"),
    FaultRow("loadcell-pulled", 10, Stop.S2, "load cell's port ended, or no sample within its stale-after"),
    FaultRow("lvdt-pulled", 11, Stop.S2, "LVDT's port ended, or no sample within its stale-after"),
    FaultRow("auxiliary-pulled", 12, Stop.S2, "an auxiliary sensor's port ended, or no sample within its stale-after"),
    FaultRow("sensor-saturated", 13, Stop.S2, "three samples in a row overloaded or at the end of the span"),
    FaultRow("sensor-spike", 14, Stop.S2, "three samples in a row beyond a jump that physics cannot make"),
    FaultRow("sensor-fault", 15, Stop.S2, "three samples in a row flagged by the sensor itself"),
    FaultRow("sensor-stuck", 16, Stop.S2, "one value repeated while the controller moves"),
    FaultRow("sensor-nan", 17, Stop.W, "sample that is not a number"),
    FaultRow("sample-gap", 18, Stop.W, "hole in the sample counter"),
    FaultRow("serial-garbage", 19, Stop.S2, "bytes of a sensor that make no valid frame within its stale-after"),
    FaultRow("ecu-silent", 20, Stop.S2, "no ECU status within its stale-after"),
    FaultRow("ecu-crc", 21, Stop.S2, "three ECU status frames in a row with a wrong counter or CRC"),
    FaultRow("ecu-restart", 22, Stop.S2, "ECU boot count changed, or its restart bit"),
    FaultRow("ecu-overtemp", 23, Stop.S2, "ECU over-temperature or undervoltage bit"),
    FaultRow("coil-open-short", 24, Stop.S2, "ECU open or short bit"),
    FaultRow("ecu-command", 25, Stop.S2, "ECU says that our command frames are late or wrong"),
    FaultRow("can-foreign", 26, Stop.S2, "another sender on our command id"),
    FaultRow("can-lost", 27, Stop.S2, "CAN port ended or refuses to send"),
    FaultRow("can-busoff", 9, Stop.S2, "no ECU status while the CAN interface reports bus errors"),
    FaultRow("current-stuck", 28, Stop.S1, "measured current after 0 A was commanded"),
    FaultRow("modbus-busy", 30, Stop.S2, "controller answers busy beyond the bounded retries"),
    FaultRow("modbus-reject", 31, Stop.S2, "controller refused a write or command while armed"),
    FaultRow("modbus-write-lost", 29, Stop.S2, "written watchdog counter does not come back, three times in a row"),
    FaultRow("modbus-reset", 32, Stop.S2, "connection to the controller ended"),
    FaultRow("modbus-halfopen", 33, Stop.S2, "no status from the controller within its stale-after"),
    FaultRow("modbus-mismatch", 8, Stop.S2, "answers that belong to no request, until the status is stale"),
    FaultRow("actuator-frozen", 34, Stop.SO, "controller heartbeat or position stands still while time or LVDT move"),
    FaultRow("position-disagreement", 35, Stop.SO, "controller position and LVDT apart"),
    FaultRow("actuator-reboot", 36, Stop.S1, "controller clock or state fell back"),
    FaultRow("second-master", 37, Stop.S2, "controller's lease is held by another"),
    FaultRow("controller-trip", 38, Stop.S2, "controller tripped by itself, not at a limit above"),
    FaultRow("host-silent", 39, Stop.S2, "controller's watchdog tripped"),
    FaultRow("estop", 40, Stop.S1, "e-stop chain open"),
    FaultRow("supply-pressure", 41, Stop.S1, "controller's supply-pressure bit"),
    FaultRow("stop-ignored", 42, Stop.S1, "no standstill within the stop's deadline"),
    FaultRow("sigkill", 50, Stop.S2, "application's link ended"),
    FaultRow("host-stalled", 51, Stop.S2, "no beat from the application within the heartbeat time-out"),
    FaultRow("recorder-unwell", 52, Stop.S2, "application says that its recorder is not well"),
    FaultRow("task-dies", 53, Stop.S2, "a thread of the station ended"),
    FaultRow("station-late", 54, Stop.S2, "the interlock loop itself stood still"),
    FaultRow("operator", 60, Stop.S2, "stop asked for by the application; its reason is in the detail"),
)

TABLE: dict[str, FaultRow] = {row.slug: row for row in _ROWS}

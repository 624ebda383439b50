"""What the station can trip on, as data: one row a slug, with the stop it demands.

The slug is the name used in events, in the journal and by tests; detectors report by slug and the row decides the
reaction, so a detector is switched off at one place. Slugs of the fault matrix take their stop from `rig.fault_matrix`;
the others are the station's own.

Reactions: S2 current to 0 A, controller fades out, hold powered. S1 = S2, then hydraulics off. SO (position no longer
trusted): current to 0 A and the controller's open-loop halt. `halt` marks an S2 whose stop is the halt ramp, because a
hard limit was hit. W only warns; the application judges the point by it.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from rig.fault_matrix import stop_of


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


def _matrix_row(slug: str, code: int, detector: str) -> FaultRow:
    """A row of the fault matrix: its stop is the matrix's."""
    return FaultRow(slug, code, Stop(stop_of(slug)), detector)


_ROWS = (
    FaultRow("stroke-limit", 1, Stop.S2, "LVDT sample beyond the stroke limit, or the controller's own bit", halt=True),
    FaultRow("force-limit", 2, Stop.S2, "load-cell sample beyond its limit, or the controller's own bit", halt=True),
    FaultRow("speed-limit", 3, Stop.S2, "LVDT slew over a window, three times in a row, or the controller's own bit"),
    FaultRow("overcurrent", 4, Stop.S2, "measured coil current beyond the limit"),
    FaultRow("coil-temperature", 5, Stop.S2, "coil temperature beyond the limit"),
    _matrix_row("loadcell-pulled", 10, "load cell's port ended, or no value within its stale-after"),
    _matrix_row("lvdt-pulled", 11, "LVDT's port ended, or no value within its stale-after"),
    FaultRow("auxiliary-pulled", 12, Stop.S2, "an auxiliary sensor's port ended, or no value within its stale-after"),
    _matrix_row("sensor-saturated", 13, "three samples in a row overloaded or at the end of the span"),
    _matrix_row("sensor-spike", 14, "three samples in a row beyond a jump that physics cannot make"),
    FaultRow("sensor-fault", 15, Stop.S2, "three samples in a row flagged by the sensor itself"),
    _matrix_row("sensor-stuck", 16, "one value repeated while the controller moves"),
    _matrix_row("sensor-nan", 17, "sample that is not a number"),
    _matrix_row("sample-gap", 18, "hole in the sample counter"),
    _matrix_row("serial-garbage", 19, "a tenth of a sensor's last frames damaged; a single one warns"),
    _matrix_row("serial-baud", 47, "bytes of a sensor that make no valid frame within its stale-after"),
    _matrix_row("usb-renumber", 46, "a sensor's port ended while its name leads to another one"),
    _matrix_row("slow-consumer", 44, "the recorder has left more than half of the ring unread"),
    _matrix_row("clock-drift", 45, "a sensor's clock off the controller's, by arrivals on the host's clock"),
    _matrix_row("ecu-silent", 20, "no ECU status within its stale-after, or no temperature for five of its periods"),
    _matrix_row("ecu-late", 7, "ECU status frames repeated again and again; a single one warns"),
    _matrix_row("can-malformed", 6, "three ECU status frames in a row of a wrong length or kind"),
    _matrix_row("can-babble", 48, "frames of others fill the bus"),
    _matrix_row("current-tracking", 49, "measured current off the commanded one after settling"),
    _matrix_row("ecu-crc", 21, "three ECU status frames in a row with a wrong counter or CRC"),
    _matrix_row("ecu-restart", 22, "ECU boot count changed, or its restart bit"),
    _matrix_row("ecu-overtemp", 23, "ECU over-temperature or undervoltage bit"),
    _matrix_row("coil-open-short", 24, "ECU open or short bit"),
    FaultRow("ecu-command", 25, Stop.S2, "ECU says that our command frames are late or wrong"),
    _matrix_row("can-foreign", 26, "another sender on our command id"),
    FaultRow("can-lost", 27, Stop.S2, "CAN port ended or refuses to send"),
    _matrix_row("can-busoff", 9, "no ECU status while the CAN interface reports bus errors"),
    _matrix_row("current-stuck", 28, "measured current after 0 A was commanded"),
    _matrix_row("modbus-busy", 30, "controller answers busy beyond the bounded retries"),
    _matrix_row("modbus-reject", 31, "controller refused a write or command while armed"),
    _matrix_row("modbus-write-lost", 29, "written counter or stop command is not there, three statuses in a row"),
    _matrix_row("modbus-reset", 32, "connection to the controller ended"),
    _matrix_row("modbus-halfopen", 33, "second time-out in a row, or no status within its stale-after"),
    _matrix_row("modbus-mismatch", 8, "answers that belong to no request, three polls in a row"),
    _matrix_row("modbus-wrong-tid", 55, "answers with the number of another request, thrown away"),
    _matrix_row("rtu-stale", 56, "bytes on the line that answer an earlier request, thrown away"),
    _matrix_row("rtu-crc", 57, "answers cut short, too long or with a wrong checksum, three polls in a row"),
    _matrix_row("actuator-frozen", 34, "controller heartbeat or position stands still while time or LVDT move"),
    FaultRow("position-disagreement", 35, Stop.SO, "controller position and LVDT apart"),
    _matrix_row("actuator-reboot", 36, "controller clock fell back, lease gone, boot count or configuration changed"),
    _matrix_row("second-master", 37, "controller's lease is held by another, or its command has our stop's number"),
    FaultRow("feedback-lost", 61, Stop.SO, "controller's sensor bit, or no finite position, velocity or force from it"),
    FaultRow("controller-trip", 38, Stop.S2, "controller tripped by itself, not at a limit above"),
    _matrix_row("host-silent", 39, "controller's watchdog tripped, or the station did not run for as long"),
    _matrix_row("host-late", 54, "the station did not run, or heard no device at all, for longer than allowed"),
    _matrix_row("estop", 40, "e-stop chain open"),
    FaultRow("supply-pressure", 41, Stop.S1, "controller's supply-pressure bit"),
    _matrix_row("stop-ignored", 42, "program runs on past its end, or no standstill within the stop's deadline"),
    _matrix_row("sigkill", 50, "application's link ended"),
    _matrix_row("host-stalled", 51, "no beat from the application within the heartbeat time-out"),
    _matrix_row("host-suspend", 58, "BOOTTIME went on while MONOTONIC stood still: the machine slept"),
    FaultRow("recorder-unwell", 52, Stop.S2, "application says that its recorder is not well"),
    _matrix_row("task-dies", 53, "a thread of the station ended"),
    FaultRow("operator", 60, Stop.S2, "stop asked for by the application; its reason is in the detail"),
)

TABLE: dict[str, FaultRow] = {row.slug: row for row in _ROWS}

"""The current ECU, the coil and the bus: rows of the fault matrix, in its order."""

from __future__ import annotations

from rig.faults.row import Ending, FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="can-busoff", fault="CAN bus-off",
        where="wire", place="can", detected_by="error state, status silence",
        limit_s=0.03, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=9, detector="no ECU status while the CAN interface reports bus errors",
    ),
    FaultRow(
        slug="ecu-silent", fault="Status missing",
        where="wire", place="ecu", detected_by="timeout",
        limit_s=0.03, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=20, detector="no ECU status within its stale-after, or no temperature for five of its periods",
    ),
    FaultRow(
        slug="ecu-late", fault="Status late/duplicated",
        where="wire", place="ecu", detected_by="counter delta, age",
        limit_s=0.03, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=7, detector="repeated ECU status frames, or one instead of a new one; a single one gives a warning",
    ),
    FaultRow(
        slug="ecu-crc", fault="Wrong counter/CRC",
        where="wire", place="ecu", detected_by="drop frame; third trips",
        limit_s=0.03, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=21, detector="three ECU status frames in a row with a wrong counter or CRC",
    ),
    FaultRow(
        slug="can-malformed", fault="DLC short, RTR, extended id",
        where="wire", place="can", detected_by="check before decode",
        limit_s=0.01, reaction="as 20", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=6, detector="three ECU status frames in a row of a wrong length or kind",
    ),
    FaultRow(
        slug="can-babble", fault="Babbling node",
        where="wire", place="can", detected_by="bus load, status jitter",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=48, detector="frames from other nodes overload the bus",
    ),
    FaultRow(
        slug="can-foreign", fault="Other sender with the host's command identifier",
        where="wire", place="can", detected_by="self-id seen",
        limit_s=0.01, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=26, detector="another sender with the host's command identifier",
    ),
    FaultRow(
        slug="ecu-overtemp", fault="ECU over-temp/undervoltage",
        where="wire", place="ecu", detected_by="status bits",
        limit_s=0.02, reaction="S2, cool", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=23, detector="ECU over-temperature or undervoltage bit",
    ),
    FaultRow(
        slug="coil-open-short", fault="Coil open/short",
        where="wire", place="ecu", detected_by="bits, measured current",
        limit_s=0.02, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="n",
        code=24, detector="ECU open or short bit",
    ),
    FaultRow(
        slug="current-tracking", fault="Current tracking error",
        where="wire", place="ecu", detected_by="tolerance after settling",
        limit_s=0.05, reaction="P; overcurrent S2", end=Ending.INVALID, disk="J", resume="a",
        code=49, detector="measured current differs from the commanded one after settling",
    ),
    FaultRow(
        slug="ecu-restart", fault="ECU restart",
        where="wire", place="ecu", detected_by="counter/state reset",
        limit_s=0.03, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=22, detector="ECU boot count changed, or its restart bit",
    ),
    FaultRow(
        slug="current-stuck", fault="Current persists after zero",
        where="wire", place="ecu", detected_by="measured current",
        limit_s=0.2, reaction="S1; operator cuts coil supply", end=StopKind.PRESSURE_OFF, disk="J", resume="n",
        code=28, detector="measured current after 0 A was commanded", current_stays=True,
    ),
    FaultRow(
        slug="supply-not-zero", fault="Supply that cannot give 0 A",
        where="wire", place="ecu", detected_by="measured current at rest, and at 0 A when arming",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c", current_stays=True,
    ),
)

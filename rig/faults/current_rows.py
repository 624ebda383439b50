"""The current ECU, the coil and the bus: rows of the fault matrix, in its order."""

from __future__ import annotations

from rig.faults.row import Ending, FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="can-busoff", fault="CAN bus-off",
        where="wire", place="can", detected_by="error state, missing status",
        limit_s=0.03, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=9, detector="no ECU status while the CAN interface reports bus errors",
    ),
    FaultRow(
        slug="ecu-silent", fault="Status missing",
        where="wire", place="ecu", detected_by="timeout",
        limit_s=0.03, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=20, detector="no ECU status within stale_after, or no temperature for five temperature periods",
    ),
    FaultRow(
        slug="ecu-late", fault="Status late or duplicated",
        where="wire", place="ecu", detected_by="counter difference, age",
        limit_s=0.03, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=7, detector="ECU status frames were repeated or outdated; a single one causes a warning",
    ),
    FaultRow(
        slug="ecu-crc", fault="Wrong counter or CRC",
        where="wire", place="ecu", detected_by="the frame is discarded; the third one in a row stops the rig",
        limit_s=0.03, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=21, detector="three ECU status frames in a row had a wrong counter or CRC",
    ),
    FaultRow(
        slug="can-malformed", fault="Frame too short, remote frame or extended ID",
        where="wire", place="can", detected_by="check before decoding",
        limit_s=0.01, reaction="as 20", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=6, detector="three ECU status frames in a row had a wrong length or type",
    ),
    FaultRow(
        slug="can-babble", fault="Babbling node",
        where="wire", place="can", detected_by="bus load and jitter of the status",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=48, detector="frames from other nodes overload the bus",
    ),
    FaultRow(
        slug="can-foreign", fault="Another sender with the host's command identifier",
        where="wire", place="can", detected_by="frames with the host's own identifier",
        limit_s=0.01, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=26, detector="another sender uses the host's command identifier",
    ),
    FaultRow(
        slug="ecu-overtemp", fault="ECU over-temperature or undervoltage",
        where="wire", place="ecu", detected_by="status bits",
        limit_s=0.02, reaction="S2, cool", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=23, detector="the ECU reports over-temperature or undervoltage",
    ),
    FaultRow(
        slug="coil-open-short", fault="Coil open or shorted",
        where="wire", place="ecu", detected_by="fault bits, measured current",
        limit_s=0.02, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="n",
        code=24, detector="the ECU reports an open or shorted coil",
    ),
    FaultRow(
        slug="current-tracking", fault="Current tracking error",
        where="wire", place="ecu", detected_by="tolerance after settling",
        limit_s=0.05, reaction="P; overcurrent S2", end=Ending.INVALID, disk="J", resume="a",
        code=49, detector="the measured current differs from the commanded one after settling",
    ),
    FaultRow(
        slug="ecu-restart", fault="ECU restart",
        where="wire", place="ecu", detected_by="reset of counter or state",
        limit_s=0.03, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=22, detector="the ECU's boot count or restart bit changed",
    ),
    FaultRow(
        slug="current-stuck", fault="Current persists after 0 A was commanded",
        where="wire", place="ecu", detected_by="measured current",
        limit_s=0.2, reaction="S1; operator disconnects coil supply", end=StopKind.PRESSURE_OFF, disk="J", resume="n",
        code=28, detector="current is measured after 0 A was commanded", current_stays=True,
    ),
    FaultRow(
        slug="supply-not-zero", fault="Supply cannot be set to 0 A",
        where="wire", place="ecu", detected_by="current measured at rest, or when armed at 0 A",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c", current_stays=True,
    ),
)

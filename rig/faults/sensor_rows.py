"""Sensors and their lines: rows of the fault matrix, in its order."""

from __future__ import annotations

from rig.faults.row import Ending, FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="loadcell-pulled", fault="Load-cell cable unplugged",
        where="wire", place="sensor", detected_by="EOF, EIO or five missing samples",
        limit_s=0.02, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=10, detector="the load cell's port closed, or no value arrived within stale_after",
    ),
    FaultRow(
        slug="lvdt-pulled", fault="LVDT signal lost",
        where="wire", place="sensor",
        detected_by="EOF, EIO or missing samples; comparison with the controller's position",
        limit_s=0.02, reaction="S2; also control feedback: SO", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=11, detector="the LVDT's port closed, or no value arrived within stale_after",
    ),
    FaultRow(
        slug="serial-garbage", fault="Damaged, lost or shifted bytes",
        where="wire", place="sensor", detected_by="resynchronisation by checksum, error rate",
        limit_s=0.1, reaction="P→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=19, detector="a tenth of the sensor's most recent frames were damaged; a single damaged frame "
            "causes a warning",
    ),
    FaultRow(
        slug="serial-baud", fault="Wrong baud rate",
        where="wire", place="sensor", detected_by="no valid frame",
        limit_s=0.5, reaction="R/S2", end=StopKind.FADE_OUT, disk="N/J", resume="c",
        code=47, detector="the bytes of a sensor contained no valid frame within stale_after",
    ),
    FaultRow(
        slug="sensor-stuck", fault="Stuck value",
        where="wire", place="sensor", detected_by="repeated values below the noise floor during motion",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=16, detector="one value is repeated while the controller moves",
    ),
    FaultRow(
        slug="sensor-saturated", fault="Saturation",
        where="wire", place="sensor", detected_by="three samples at the end of the range or in the NE 43 fault band",
        limit_s=0.012, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=13, detector="three samples in a row were overloaded or at the end of the range",
    ),
    FaultRow(
        slug="sensor-spike", fault="Spike",
        where="wire", place="sensor", detected_by="rate of change; one jump is flagged, three in a row stop the rig",
        limit_s=0.012, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=14, detector="an implausible jump was followed by three samples at the new value",
    ),
    FaultRow(
        slug="sensor-nan", fault="NaN, inf or comma in the text",
        where="wire", place="sensor", detected_by="strict parser; the sample counts as lost",
        limit_s=0.004, reaction="P", end=Ending.INVALID, disk="J", resume="a",
        code=17, detector="a sample is not a number",
    ),
    FaultRow(
        slug="sample-gap", fault="Gap in the sample counter, or device time running backwards",
        where="wire", place="sensor",
        detected_by="counter and order of the samples; the gap is stored and never interpolated",
        limit_s=0.004, reaction="P >0.1%", end=Ending.INVALID, disk="J", resume="a",
        code=18, detector="the sample counter has a gap",
    ),
    FaultRow(
        slug="clock-drift", fault="Clock drift of ±500 ppm",
        where="wire", place="sensor", detected_by="fit of the counter to the monotonic clock",
        limit_s=60.0, reaction="W", end=Ending.WARN, disk="J", resume="a",
        code=45, detector="a sensor's clock differs from the controller's clock, as measured by the host's clock",
    ),
    FaultRow(
        slug="slow-consumer", fault="Recorder too slow",
        where="process", place="starvation",
        detected_by="fill level of the ring; limits are checked when samples arrive",
        limit_s=0.1, reaction="P; limit lag S2", end=Ending.INVALID, disk="J", resume="a",
        code=44, detector="the recorder has left more than half of the ring unread",
    ),
    FaultRow(
        slug="usb-renumber", fault="USB adapter reconnected under another name",
        where="wire", place="sensor", detected_by="port identified by serial number; not reopened during motion",
        limit_s=0.02, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=46, detector="a sensor's port closed, and its device name now refers to another port",
    ),
    FaultRow(
        slug="sensors-swapped", fault="Sensors swapped, or wrong sign or scale",
        where="wire", place="sensor", detected_by="small check move",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="not-tared", fault="Sensor not tared, or LVDT unplugged",
        where="wire", place="sensor", detected_by="allowed range at rest, shunt calibration",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
)

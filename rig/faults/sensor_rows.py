"""Sensors and their lines: rows of the fault matrix, in its order."""

from __future__ import annotations

from rig.faults.row import Ending, FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="loadcell-pulled", fault="Load-cell cable pulled",
        where="wire", place="sensor", detected_by="EOF, EIO or 5 missing samples",
        limit_s=0.02, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=10, detector="load cell's port ended, or no value within its stale-after",
    ),
    FaultRow(
        slug="lvdt-pulled", fault="Host LVDT lost",
        where="wire", place="sensor", detected_by="same; controller position cross-check",
        limit_s=0.02, reaction="S2; also control feedback: SO", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=11, detector="LVDT's port ended, or no value within its stale-after",
    ),
    FaultRow(
        slug="serial-garbage", fault="Garbage, byte loss, framing shift",
        where="wire", place="sensor", detected_by="checksum resync, error rate",
        limit_s=0.1, reaction="P→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=19, detector="a tenth of a sensor's last frames damaged; a single one gives a warning",
    ),
    FaultRow(
        slug="serial-baud", fault="Baud mismatch (garbled bytes)",
        where="wire", place="sensor", detected_by="no valid frame",
        limit_s=0.5, reaction="R/S2", end=StopKind.FADE_OUT, disk="N/J", resume="c",
        code=47, detector="bytes of a sensor that make no valid frame within its stale-after",
    ),
    FaultRow(
        slug="sensor-stuck", fault="Stuck value",
        where="wire", place="sensor", detected_by="repeats below noise floor while moving",
        limit_s=0.1, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=16, detector="one value repeated while the controller moves",
    ),
    FaultRow(
        slug="sensor-saturated", fault="Saturation",
        where="wire", place="sensor", detected_by="rail/NE 43 band, 3 samples",
        limit_s=0.012, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=13, detector="three samples in a row overloaded or at the end of the span",
    ),
    FaultRow(
        slug="sensor-spike", fault="Spike",
        where="wire", place="sensor", detected_by="slew; flag one, trip on 3",
        limit_s=0.012, reaction="W→S2", end=StopKind.FADE_OUT, disk="J", resume="a",
        code=14, detector="three samples in a row after an implausible jump",
    ),
    FaultRow(
        slug="sensor-nan", fault="NaN/inf/comma text",
        where="wire", place="sensor", detected_by="strict parser: lost sample",
        limit_s=0.004, reaction="P", end=Ending.INVALID, disk="J", resume="a",
        code=17, detector="sample that is not a number",
    ),
    FaultRow(
        slug="sample-gap", fault="Sample-counter gap, device time backwards",
        where="wire", place="sensor", detected_by="counter/order; store gap, never interpolate",
        limit_s=0.004, reaction="P >0.1%", end=Ending.INVALID, disk="J", resume="a",
        code=18, detector="gap in the sample counter",
    ),
    FaultRow(
        slug="clock-drift", fault="Clock drift ±500 ppm",
        where="wire", place="sensor", detected_by="counter–monotonic fit",
        limit_s=60.0, reaction="W", end=Ending.WARN, disk="J", resume="a",
        code=45, detector="a sensor's clock off the controller's, by arrivals on the host's clock",
    ),
    FaultRow(
        slug="slow-consumer", fault="Slow consumer",
        where="process", place="starvation", detected_by="queue high-water; limits checked at reader",
        limit_s=0.1, reaction="P; limit lag S2", end=Ending.INVALID, disk="J", resume="a",
        code=44, detector="the recorder has left more than half of the ring unread",
    ),
    FaultRow(
        slug="usb-renumber", fault="USB re-enumerates",
        where="wire", place="sensor", detected_by="bind by serial number; no reopen in motion",
        limit_s=0.02, reaction="S2", end=StopKind.FADE_OUT, disk="J", resume="c",
        code=46, detector="a sensor's port ended while its device name points to another port",
    ),
    FaultRow(
        slug="sensors-swapped", fault="Sensors swapped, sign/scale wrong",
        where="wire", place="sensor", detected_by="low-level proof move",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
    FaultRow(
        slug="not-tared", fault="Not tared, LVDT unplugged",
        where="wire", place="sensor", detected_by="rest window, shunt cal",
        occasion="preflight", reaction="R", end=Ending.REFUSE, disk="N", resume="c",
    ),
)

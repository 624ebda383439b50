"""Faults that the station detects in addition to the matrix: limits, its own links, requests of the operator."""

from __future__ import annotations

from rig.faults.row import FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="stroke-limit", end=StopKind.FADE_OUT, halt=True, code=1,
        detector="an LVDT sample is beyond the stroke limit, or the controller reports this fault",
    ),
    FaultRow(
        slug="force-limit", end=StopKind.FADE_OUT, halt=True, code=2,
        detector="a load-cell sample is beyond the force limit, or the controller reports this fault",
    ),
    FaultRow(
        slug="speed-limit", end=StopKind.FADE_OUT, code=3,
        detector="the speed measured by the LVDT over a time window exceeds the limit three times in a row, or the "
            "controller reports this fault",
    ),
    FaultRow(
        slug="overcurrent", end=StopKind.FADE_OUT, code=4, detector="the measured coil current is beyond the limit",
    ),
    FaultRow(
        slug="coil-temperature", end=StopKind.FADE_OUT, code=5, detector="the coil temperature is beyond the limit",
    ),
    FaultRow(
        slug="auxiliary-pulled", end=StopKind.FADE_OUT, code=12,
        detector="an auxiliary sensor's port closed, or no value arrived within stale_after",
    ),
    FaultRow(
        slug="sensor-fault", end=StopKind.FADE_OUT, code=15,
        detector="the sensor flagged three samples in a row as faulty",
    ),
    FaultRow(
        slug="current-unmeasured", end=StopKind.FADE_OUT, resume="a",
        code=69, detector="three answers of the current source in a row contained no measured value",
    ),
    FaultRow(
        slug="ecu-command", end=StopKind.FADE_OUT, code=25,
        detector="the ECU reports late or wrong command frames",
    ),
    FaultRow(
        slug="can-lost", end=StopKind.FADE_OUT, code=27,
        detector="the port of the current source closed or cannot send",
    ),
    FaultRow(
        slug="position-disagreement", end=StopKind.HALT, code=35,
        detector="the controller's position and the LVDT disagree",
    ),
    FaultRow(
        slug="feedback-lost", end=StopKind.HALT, code=61,
        detector="the controller reports a sensor fault, or a position, velocity or force that is not finite",
    ),
    FaultRow(
        slug="controller-trip", end=StopKind.FADE_OUT, code=38,
        detector="the controller tripped for another reason",
    ),
    FaultRow(
        slug="supply-pressure", end=StopKind.PRESSURE_OFF, code=41,
        detector="the controller reports a supply-pressure fault",
    ),
    FaultRow(
        slug="recorder-unwell", end=StopKind.FADE_OUT, code=52,
        detector="the application reports a recorder failure",
    ),
    FaultRow(
        slug="operator", end=StopKind.FADE_OUT, code=60,
        detector="the application requested a stop; the detail states the reason",
    ),
)

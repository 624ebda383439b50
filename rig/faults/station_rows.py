"""Faults that the station detects in addition to the matrix: limits, its own links, requests of the operator."""

from __future__ import annotations

from rig.faults.row import FaultRow, StopKind

ROWS = (
    FaultRow(
        slug="stroke-limit", end=StopKind.FADE_OUT, halt=True, code=1,
        detector="LVDT sample beyond the stroke limit, or the controller's own bit",
    ),
    FaultRow(
        slug="force-limit", end=StopKind.FADE_OUT, halt=True, code=2,
        detector="load-cell sample beyond its limit, or the controller's own bit",
    ),
    FaultRow(
        slug="speed-limit", end=StopKind.FADE_OUT, code=3,
        detector="LVDT slew over a window, three times in a row, or the controller's own bit",
    ),
    FaultRow(
        slug="overcurrent", end=StopKind.FADE_OUT, code=4, detector="measured coil current beyond the limit",
    ),
    FaultRow(
        slug="coil-temperature", end=StopKind.FADE_OUT, code=5, detector="coil temperature beyond the limit",
    ),
    FaultRow(
        slug="auxiliary-pulled", end=StopKind.FADE_OUT, code=12,
        detector="an auxiliary sensor's port ended, or no value within its stale-after",
    ),
    FaultRow(
        slug="sensor-fault", end=StopKind.FADE_OUT, code=15,
        detector="three samples in a row flagged by the sensor itself",
    ),
    FaultRow(
        slug="current-unmeasured", end=StopKind.FADE_OUT, resume="a",
        code=69, detector="three answers of the current source in a row without a measured number",
    ),
    FaultRow(
        slug="ecu-command", end=StopKind.FADE_OUT, code=25,
        detector="the ECU reports late or wrong command frames",
    ),
    FaultRow(
        slug="can-lost", end=StopKind.FADE_OUT, code=27, detector="CAN port ended or refuses to send",
    ),
    FaultRow(
        slug="position-disagreement", end=StopKind.HALT, code=35, detector="controller position and LVDT disagree",
    ),
    FaultRow(
        slug="feedback-lost", end=StopKind.HALT, code=61,
        detector="controller's sensor bit, or no finite position, velocity or force from it",
    ),
    FaultRow(
        slug="controller-trip", end=StopKind.FADE_OUT, code=38,
        detector="controller tripped by itself, not at a limit above",
    ),
    FaultRow(
        slug="supply-pressure", end=StopKind.PRESSURE_OFF, code=41, detector="controller's supply-pressure bit",
    ),
    FaultRow(
        slug="recorder-unwell", end=StopKind.FADE_OUT, code=52,
        detector="the application reports a recorder failure",
    ),
    FaultRow(
        slug="operator", end=StopKind.FADE_OUT, code=60,
        detector="stop requested by the application; its reason is in the detail",
    ),
)

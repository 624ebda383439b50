"""The bench's own instruments: cross-checks between them, instruments without one, and their calibrations."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from rig.campaign.preflight.zero_return import read_zero_checks
from rig.display import SI, Display
from rig.document.blocks import Blocks, Column, Head, Heading, Note, Row, section, table
from rig.document.numbers import NOTHING, PLUS_MINUS, number, signed
from rig.document.words import FAIR, GOOD, PLAIN, POOR, Code, Label, Strong
from rig.recording.hdf5.reading import channel_attributes
from rig.recording.quality.cross_checks import CheckState, CrossCheck, checked, cross_checks, doubts, instruments_of
from rig.recording.recorded_point import RecordedPoint
from rig.recording.run import Run
from rig.report.display_text import in_display
from rig.signals.estimate import Estimate

AUXILIARIES = tuple(f"auxiliary_{n}" for n in range(1, 8))
CHANNELS = ("force", "displacement", *AUXILIARIES)
REST = {"load cell": "force input", "LVDT": "position input"}
SEVERITIES = {CheckState.DISAGREES: FAIR, CheckState.UNCHECKED: PLAIN}

Sensors = Mapping[str, Mapping[str, Any]]
"""Attributes of the channels of one point that have a calibration, by the channel's name."""


def sensors_of(point: RecordedPoint) -> dict[str, dict[str, Any]]:
    """The calibrated channels of a point as its file describes them; none of a point in memory."""
    if point.path is None:
        return {}
    known = {name: channel_attributes(point.path, name) for name in CHANNELS}
    return {name: attributes for name, attributes in known.items() if "serial_number" in attributes}


def instruments(run: Run, sensors: Sensors, display: Display = SI) -> Blocks:
    """A table of all instruments; empty where nothing was recorded on a bench."""
    checks = [*checks_of(run, sensors), *zero_returns(run)]
    if not checks:
        return []
    note = (
        "The load cell and the LVDT are compared with the controller's own force and position inputs, using all "
        f"points; {PLUS_MINUS} is one standard deviation. Two instruments that agree may share the same error, so "
        "this is not a calibration. The allowed values are set in the bench file, in ", Code("[checks]"), ".",
    )  # fmt: skip
    head: list[Head] = ["Instrument", "Property", "Compared with", Column("Difference", "", True), "Allowed", "Result"]
    return [*section("Sensor cross-checks", note), table(head, [_row(check, display) for check in checks])]


def checks_of(run: Run, sensors: Sensors) -> tuple[CrossCheck, ...]:
    """The instruments of the largest group of points that were measured with the same ones."""
    group = max(instruments_of(run.points).values(), key=len, default=[])
    if all(point.quality.tolerances is None for point in group):
        return ()
    names = [str(sensors[name].get("sensor") or name) for name in AUXILIARIES if name in sensors]
    return cross_checks([checked(point.id, point.test, point.quality) for point in group], names)


def zero_returns(run: Run) -> tuple[CrossCheck, ...]:
    """Zero drift of load cell and LVDT over each session, by the controller's own inputs."""
    checks = []
    for session, check in enumerate(read_zero_checks(run.path), start=1):
        if check.start is None or check.end is None:
            continue
        first, last = check.start, check.end
        disagree = {finding.instruments[0] for finding in check.findings()}
        for name, unit, scale, readings in (
            ("load cell", "N", 1.0,
             (first.force_N, first.controller_force_N, last.force_N, last.controller_force_N)),
            ("LVDT", "mm", 1e3, (first.displacement_m, first.position_m, last.displacement_m, last.position_m)),
        ):
            before, before_own, after, after_own = (reading.mean for reading in readings)
            error = math.hypot(*(reading.std / math.sqrt(max(reading.count, 1)) for reading in readings))
            moved = Estimate((after - after_own) - (before - before_own), error)
            checks.append(CrossCheck(
                name, f"zero drift during session {session}",
                f"controller's {REST[name]}, at rest before and after the session",
                f"{moved.times(scale).signed} {unit}", "1 % of the largest value, or the noise",
                CheckState.DISAGREES if name in disagree else CheckState.AGREES,
            ))
    return tuple(checks)


def doubts_of(points: Sequence[RecordedPoint]) -> Blocks:
    """The calibrations that the recordings contradict: needed before any number is believed."""
    return [Note(POOR, (Strong("Calibration in doubt (bench)."), f" {line}")) for line in doubts(points)]


def _row(check: CrossCheck, display: Display) -> Row:
    return Row((
        check.instrument, check.what, check.against,
        signed(in_display(check.difference, display, directed=True)) or NOTHING,
        signed(in_display(check.allowed, display)) or NOTHING,
        Label(str(check.state), SEVERITIES.get(check.state, GOOD)),
    ), faded=check.state == CheckState.UNCHECKED)  # fmt: skip


CALIBRATION = (
    Column("Channel"), Column("Sensor"), Column("Serial number"),
    Column("Scale factor (SI units per transmitted unit)", "", True),
    Column("Certificate"), Column("Due"), Column("Uncertainty", "%", True), Column("Delay", "ms", True),
)  # fmt: skip


def calibrations(sensors: Sensors) -> Blocks:
    """Sensors with their calibration, as recorded in the run's files."""
    rows, overdue = [], []
    for name, attributes in sensors.items():
        late = bool(attributes.get("overdue", 0))
        if late:
            overdue.append(f"{name} ({attributes['serial_number']}, due {attributes.get('due', '')})")
        rows.append(Row((
            name, str(attributes.get("sensor", "")), str(attributes["serial_number"]),
            number(attributes.get("sensitivity"), 6), str(attributes.get("certificate", NOTHING)),
            str(attributes.get("due", NOTHING)) + (" overdue" if late else ""),
            number(attributes.get("uncertainty_percent"), 3),
            number(1e3 * attributes["delay_s"] if "delay_s" in attributes else None, 4),
        ), faded=late))  # fmt: skip
    if not rows:
        return []
    warning: Blocks = [Note(FAIR, f"Calibration overdue: {'; '.join(overdue)}.")] if overdue else []
    return [Heading("Calibration"), *warning, table(CALIBRATION, rows)]

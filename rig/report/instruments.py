"""The bench's own instruments: what was compared with what, what nobody could compare, and their calibrations."""

from __future__ import annotations

import math

from rig.campaign.preflight.zero_return import read_zero_checks
from rig.recording.hdf5.reading import channel_attributes
from rig.recording.quality.cross_checks import CheckState, CrossCheck, checked, cross_checks, doubts, instruments_of
from rig.recording.run import Run
from rig.report.fragment import NOTHING, box, chip, heading, number, signed, table, text
from rig.signals.estimate import Estimate

MOST_AUXILIARIES = 7
REST = {"load cell": "force input", "LVDT": "position input"}


def instruments(run: Run) -> str:
    """A table of all instruments; empty where nothing was recorded on a bench."""
    rows = [_row(check) for check in (*checks_of(run), *zero_returns(run))]
    if not rows:
        return ""
    note = (
        "Load cell and LVDT against the controller's own force and position inputs, all points together; "
        "\N{PLUS-MINUS SIGN} is one standard deviation. Two instruments that agree may both be wrong alike: this is no "
        "calibration. What is allowed stands in the bench file's <code>[checks]</code>."
    )
    head = ["Instrument", "Property", "Compared with", "Found", "Allowed", "Result"]
    return heading("What this bench can cross-check", note) + table(head, rows, (3,))


def checks_of(run: Run) -> tuple[CrossCheck, ...]:
    """What the largest group of the run's points that one bench measured says of its instruments."""
    group = max(instruments_of(run.points).values(), key=len, default=[])
    if all(point.quality.tolerances is None for point in group):
        return ()
    first = group[0]
    names = [] if first.path is None else [
        str(attributes.get("sensor") or name) for name in (f"auxiliary_{n}" for n in range(1, MOST_AUXILIARIES + 1))
        if "serial_number" in (attributes := channel_attributes(first.path, name))
    ]
    return cross_checks([checked(point.id, point.test, point.quality) for point in group], names)


def zero_returns(run: Run) -> tuple[CrossCheck, ...]:
    """Load cell and LVDT at rest after each session's motion against before, by the controller's own inputs."""
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
                name, f"return of its zero after session {session}",
                f"controller's {REST[name]}, at rest before and after",
                f"{moved.times(scale).signed} {unit}", "1 % of the largest measured, or its noise",
                CheckState.DISAGREES if name in disagree else CheckState.AGREES,
            ))
    return tuple(checks)


def doubts_of(run: Run) -> str:
    """What must be known before any number is believed: the calibrations that the files themselves contradict."""
    return "".join(box("bad", f"<b>Calibration in doubt (bench).</b> {text(line)}") for line in doubts(run.points))


def _row(check: CrossCheck) -> tuple[str, list[str]]:
    kind = {CheckState.DISAGREES: "suspect", CheckState.UNCHECKED: "plain"}.get(check.state, "valid")
    shown = signed(text(check.difference)) or NOTHING
    return ("no" if check.state == CheckState.UNCHECKED else "", [
        text(check.instrument), text(check.what), text(check.against), shown, text(check.allowed) or NOTHING,
        chip(check.state, kind),
    ])


def calibrations(run: Run) -> str:
    """Sensors with their calibration, as recorded in the run's files."""
    point = next((point for point in run.points if point.path is not None and not point.imported), None)
    if point is None or point.path is None:
        return ""
    head = ["Channel", "Sensor", "Serial number", "SI per wire unit", "Certificate", "Due", "Uncertainty %", "Delay ms"]
    rows, overdue = [], []
    for name in ("force", "displacement", *(f"auxiliary_{n}" for n in range(1, 8))):
        attributes = channel_attributes(point.path, name)
        if "serial_number" not in attributes:
            continue
        late = bool(attributes.get("overdue", 0))
        if late:
            overdue.append(f"{name} ({attributes['serial_number']}, due {attributes.get('due', '')})")
        rows.append(("no" if late else "", [
            text(name), text(attributes.get("sensor", "")), text(attributes["serial_number"]),
            number(attributes.get("sensitivity"), 6),
            text(attributes.get("certificate", NOTHING)),
            text(attributes.get("due", NOTHING)) + (" overdue" if late else ""),
            number(attributes.get("uncertainty_percent"), 3),
            number(1e3 * attributes["delay_s"] if "delay_s" in attributes else None, 4),
        ]))
    warning = box("warn", f"Calibration overdue: {text('; '.join(overdue))}.") if overdue else ""
    return heading("Calibration") + warning + table(head, rows, (3, 6, 7)) if rows else ""

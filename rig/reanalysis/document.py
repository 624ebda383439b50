"""What a reanalysis has changed, as a document: facts, verdicts, samples, characteristics, fit, remarks."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Sequence

from rig.document.blocks import (
    Block,
    Blocks,
    Column,
    Document,
    Fact,
    Facts,
    Heading,
    Items,
    Note,
    Paragraph,
    Properties,
    Row,
    section,
    table,
)
from rig.document.numbers import NOTHING, known_digits, number, with_uncertainty
from rig.document.words import FAIR, GOOD, OF_VERDICT, PLAIN, POOR, Severity, Words, verdict
from rig.reanalysis.changes import MINOR_CHANGE, MINOR_IN_STD, Cause, PointChange, ValueChange
from rig.reanalysis.result import Reanalysis
from rig.recording.run import Run
from rig.report.cover import mark_of

SIGNIFICANT = 2.0
"""Standard uncertainties from which a change is more than its expanded uncertainty (95 %)."""
UNITS = {
    "N": "N", "J": "J", "A": "A", "m": "m", "Hz": "Hz", "s": "s", "degC": "degC", "m_s": "m/s", "N_s_m": "N s/m",
    "N_s": "N/s", "N_m": "N/m", "1_s": "1/s",
}  # fmt: skip
"""Endings of keys in `characteristics.json`, and the units that they state."""
FIELD_WORDS = {
    "rebound": "force at peak velocity, rebound", "jounce": "force at peak velocity, compression",
    "peak_force_compression": "largest force, compression",
    "peak_force_rebound": "largest force, rebound",
}  # fmt: skip
POINT_HEAD = (
    Column("point"), Column("verdict before"), Column("verdict now"), Column("largest change of force", "%", True),
    Column("change of delay", "ms", True), Column("cause"),
)  # fmt: skip
VALUE_HEAD = (
    Column("value"), Column("unit"), Column("before", "", True), Column("now", "", True), Column("change", "", True),
    Column("in standard uncertainties", "", True), Column("cause"),
)  # fmt: skip


def reanalysis_document(result: Reanalysis, new: Run) -> Document:
    """The page of a result.

    Args:
        result: what has changed.
        new: the new run, for its display and mark.
    """
    blocks: Blocks = [Heading("Reanalysis", 1), Properties({
        "Run": result.run.name, "Recorded and evaluated by": ", ".join(result.recorded_by),
        "Reanalysed by": f"mr-damper-rig {result.software}",
    })]  # fmt: skip
    blocks += [_facts(result), *changes(result, most=None)]
    return Document(f"Reanalysis {result.run.name}", tuple(blocks), mark_of([new]), new.display.paper)


def _facts(result: Reanalysis) -> Facts:
    verdicts = sum(point.before != point.after for point in result.points)
    samples = sum(Cause.ALIGNMENT in point.causes for point in result.points)
    total = len(result.points)
    facts = [
        Fact(f"{verdicts} of {total}", "verdicts changed", FAIR if verdicts else GOOD),
        Fact(f"{samples} of {total}", "points with other aligned samples", FAIR if samples else GOOD),
        _significant(result.characteristics, "characteristics changed"),
    ]
    if result.models[1]:
        facts.append(_significant(result.fit, "fitted values changed"))
    if result.left_out:
        facts.append(Fact(str(len(result.left_out)), "points could not be regenerated", POOR))
    return Facts(tuple(facts))


def _significant(changed: Sequence[ValueChange], meaning: str) -> Fact:
    notable, beyond = (sum(one.notable for one in changed), sum(one.in_std > SIGNIFICANT for one in changed))
    words = f"{meaning}, {beyond} by more than the expanded uncertainty" if notable else meaning
    return Fact(str(notable), words, POOR if beyond else FAIR if notable else GOOD)


def changes(result: Reanalysis, most: int | None) -> Blocks:
    """The differences, at most so many in each table (None: all), and the remarks."""
    blocks: Blocks = []
    if not result.changed:
        blocks.append(Note(GOOD, "No verdict, sample, characteristic or fitted value has changed."))
    before, after = result.specimen
    if before != after:
        text = f"Verdict on the specimen: {before or 'none'} before, {after or 'none'} now"
        blocks.append(Note(GOOD if after == "ok" else POOR, text))
    blocks += _points(result.changed_points, most)
    blocks += _values("Characteristics", result.characteristics, most)
    before, after = result.models
    if result.fit:
        blocks += _values(f"Fit: {after}" if before == after else f"Fit: {before} before, {after} now",
                          result.fit, most)
    listed = [*(one.causes for one in result.points), *(one.causes for one in (*result.characteristics, *result.fit))]
    shown = dict.fromkeys(itertools.chain.from_iterable(listed))
    if shown:
        blocks.append(Paragraph("Causes:"))
        blocks.append(Items(tuple(f"{cause.words}: {cause.meaning}" for cause in shown)))
    if result.fit_error:
        blocks.append(Note(POOR, f"The fit could not be repeated: {result.fit_error}"))
    blocks += [Note(POOR, line) for line in result.left_out]
    return [*blocks, *(Note(FAIR, f"remark: {remark}") for remark in result.remarks)]


def _points(points: Sequence[PointChange], most: int | None) -> Blocks:
    if not points:
        return []
    ordered = sorted(points, key=lambda point: (point.before == point.after, -_size(point.force_percent)))
    rows: list[Row] = []
    reasons: list[Words] = []
    for point in ordered[:most]:
        level = OF_VERDICT.get(point.after, PLAIN) if point.before != point.after else PLAIN
        cells: tuple[Words, ...] = (
            point.id, verdict(point.before), verdict(point.after), _number(point.force_percent),
            _number(1e3 * point.delay_s), _causes(point.causes),
        )
        rows.append(Row(cells, level))
        reasons += [f"{point.id}, new reason: {reason}" for reason in point.added]
        reasons += [f"{point.id}, reason that no longer applies: {reason}" for reason in point.removed]
    return [*section("Points"), table(POINT_HEAD, rows), *([Items(tuple(reasons))] if reasons else []),
            *_omitted(len(ordered), most)]


def _values(title: str, values: Sequence[ValueChange], most: int | None) -> Blocks:
    if not values:
        return []
    notable = [one for one in values if one.notable]
    minor: list[Block] = []
    if len(notable) < len(values):
        which = "Further values" if notable else "Values"
        text = (f"{which} that changed by at most {MINOR_IN_STD:g} standard uncertainties ({MINOR_CHANGE:g} of the "
                f"value where the uncertainty is unknown): {len(values) - len(notable)}.")
        minor = [Paragraph(text, small=True)]
    if not notable:
        return [*section(title), *minor]
    ordered = sorted(notable, key=lambda one: -_size(one.in_std if math.isfinite(one.in_std) else _relative(one)))
    rows = [Row(_cells(one), _level(one)) for one in ordered[:most]]
    return [*section(title), table(VALUE_HEAD, rows), *_omitted(len(ordered), most), *minor]


def _omitted(count: int, most: int | None) -> list[Block]:
    if most is None or count <= most:
        return []
    return [Paragraph(f"{count - most} more; reanalysis.html lists all", small=True)]


def _level(one: ValueChange) -> Severity:
    return FAIR if one.in_std > SIGNIFICANT else PLAIN


def _cells(one: ValueChange) -> tuple[Words, ...]:
    change = known_digits(one.change, one.std) if math.isfinite(one.change) else NOTHING
    if math.isfinite(one.change) and not _digits(change):  # smaller than its uncertainty: not zero all the same
        change = number(one.change, 2)
    name, unit = (one.name, one.unit) if one.unit else _named(one.name)
    return (
        name, unit or NOTHING, with_uncertainty(one.before, one.before_std),
        with_uncertainty(one.after, one.after_std), change, _number(one.in_std), _causes(one.causes),
    )  # fmt: skip


def _named(key: str) -> tuple[str, str]:
    """Words and unit of a number in characteristics: `p001 peak_speed_m_s` is the peak speed of p001 in m/s."""
    suffix = next((one for one in sorted(UNITS, key=len, reverse=True) if key.endswith(f"_{one}")), "")
    words = key.removesuffix(f"_{suffix}") if suffix else key
    test, space, quantity = words.partition(" ")
    return f"{test}{space}{FIELD_WORDS.get(quantity, quantity.replace('_', ' '))}", UNITS.get(suffix, "")


def _digits(shown: str) -> bool:
    """Whether a number as text differs from zero."""
    return any(digit in shown for digit in "123456789")


def _causes(causes: Iterable[Cause]) -> str:
    return "; ".join(cause.words for cause in causes) or NOTHING


def _number(value: float) -> str:
    return number(value, 3)


def _size(value: float) -> float:
    return abs(value) if math.isfinite(value) else -1.0


def _relative(one: ValueChange) -> float:
    """Change over value: of values without an uncertainty, behind those that have one."""
    size = max(abs(one.before), abs(one.after))
    return 1e-6 * abs(one.change) / size if size > 0.0 else math.nan

"""Summary of a comparison, as blocks of a document: verdict, failed values, changes, remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rig.comparison.acceptance import PERCENT, AcceptanceResult, Result, State
from rig.comparison.changes import Change
from rig.comparison.differences import Comparison
from rig.comparison.readings import COVERAGE, LOOP_QUANTITIES, SINGLE_QUANTITIES
from rig.document.blocks import Block, Blocks, Column, Heading, Note, Paragraph, table
from rig.document.numbers import MINUS, known_digits
from rig.document.terminal import Line, lines
from rig.document.words import FAIR, GOOD, POOR

SEVERITIES = {State.PASSED: GOOD, State.FAILED: POOR, State.UNSURE: FAIR, State.MISSING: FAIR}
NOTHING = "-"


def comparison_lines(compared: Comparison, width: int, *, everything: bool) -> Iterator[Line]:
    """The lines and their styles, none longer than `width` where its words allow."""
    return lines(comparison_blocks(compared, everything=everything), width)


def comparison_blocks(compared: Comparison, *, everything: bool) -> Blocks:
    """Verdict, runs, changes against the first, remarks."""
    blocks: Blocks = []
    if compared.judgement is not None:
        blocks += _acceptance(compared.judgement, len(compared.runs) > 1, everything=everything)
    for index, run in enumerate(compared.runs):
        label = "first" if index == 0 and len(compared.runs) > 1 else f"run {index + 1}"
        blocks.append(Paragraph(f"{label}: {run.name}, specimen {run.specimen or 'unknown'}"))
    for index in range(1, len(compared.runs)):
        blocks += _changes(compared, index, everything=everything)
    return blocks + [Note(FAIR, f"remark: {remark}") for remark in compared.remarks]


def _acceptance(acceptance: AcceptanceResult, several: bool, *, everything: bool) -> Blocks:
    total, bad = len(acceptance.results), acceptance.not_passed
    if acceptance.passed:
        least = min(acceptance.results, key=lambda result: _or_infinite(result.margin_percent))
        stated = f"PASS against {acceptance.bands.name}: all {total} values within their bands; smallest margin: "
        verdict = Note(GOOD, stated + f"{least.quantity}, {_margin(least)}")
    else:
        kinds = [f"{count} {state}" for state in (State.FAILED, State.UNSURE, State.MISSING)
                 if (count := sum(result.state == state for result in bad))]  # fmt: skip
        verdict = Note(
            POOR,
            f"FAIL against {acceptance.bands.name}: {len(bad)} of {total} values did not pass ({', '.join(kinds)})",
        )  # fmt: skip
    shown = acceptance.results if everything else bad
    blocks: Blocks = [verdict, *(Note(SEVERITIES[result.state], _result(result, several)) for result in shown)]
    if not everything and len(bad) < total:
        blocks.append(Paragraph(f"{total - len(bad)} passed; use --all to show every value"))
    return [*blocks, Paragraph("")]


def _result(result: Result, several: bool) -> str:
    """One value on a line of its own."""
    name = f"change of {result.quantity}" if result.change else result.quantity
    place = f"{result.where}" + (f" ({', '.join(result.points)})" if result.points else "")
    text = f"{result.state.upper()}  {name} at {place}"
    if several:
        text += f" in {result.run}"
    value = _why(result) if math.isnan(result.value) else f"{_number(result.value)} {_unit(result.unit)}".rstrip()
    text += f": {value}"
    text += f", allowed {band_words(result)}"
    if math.isfinite(result.value):
        text += f", margin {_margin(result)}"
        text += f", +-{_number(result.expanded, 2)}" if math.isfinite(result.expanded) else ""
        text += f"; {result.why}" if result.why else ""
    return text + (f" [{result.note}]" if result.note else "")


def _why(result: Result) -> str:
    return result.why or "not measured"


def band_words(result: Result) -> str:
    """The band in words: "900 to 1100 N", "at least 5 N"."""
    unit = _unit(result.unit)
    if result.low is None:
        return f"at most {_number(result.high)} {unit}".rstrip()
    if result.high is None:
        return f"at least {_number(result.low)} {unit}".rstrip()
    return f"{_number(result.low)} to {_number(result.high)} {unit}".rstrip()


def _margin(result: Result) -> str:
    text = f"{_number(result.margin, 3)} {_unit(result.unit)}".rstrip()
    share = result.margin_percent
    return text if math.isnan(share) or result.unit == "%" else f"{text} ({_number(share, 3)} %)"


SUMMARY = (
    Column("quantity"), Column("tests", "", True), Column("differ", "", True), Column("median", "", True),
    Column("largest", "", True), Column("at"),
)  # fmt: skip
LISTED = (
    Column("motion"), Column("quantity"), Column("first", "", True), Column("now", "", True),
    Column("change", "", True), Column("+-", "", True),
)  # fmt: skip


def _changes(compared: Comparison, index: int, *, everything: bool) -> Blocks:
    """Differences of one run from the first: a line for each quantity, then the motions and parameters that differ."""
    rows, listed = list[tuple[str, ...]](), list[tuple[str, ...]]()
    for quantity in LOOP_QUANTITIES:
        summary = compared.summary(index, quantity.key)
        if summary is None:
            continue
        rows.append((
            quantity.key, str(summary.tests), str(summary.differ), _signed(summary.median_percent, PERCENT),
            _change(summary.largest, quantity.unit)[0], summary.at.label,
        ))  # fmt: skip
        for row in compared.rows:
            one = compared.change(index, quantity.key, row)
            if one is not None and (everything or one.differs):
                first, now = (loop.values[quantity.key].value for loop in (row.loops[0], row.loops[index]) if loop)
                listed.append((row.motion.label, quantity.key, *_cells(first, now, one, quantity.unit)))
    for quantity in SINGLE_QUANTITIES:
        if (one_change := compared.single_change(index, quantity.key)) and (everything or one_change.differs):
            first, now = (compared.runs[place].singles[quantity.key].value for place in (0, index))
            listed.append(("slow triangle", quantity.key, *_cells(first, now, one_change, quantity.unit)))
    for name in compared.parameter_names:
        if (one_change := compared.parameter_change(index, name)) and (everything or one_change.differs):
            fitted = [compared.runs[place].parameters[name] for place in (0, index)]
            first, now = (one.reading.value for one in fitted)
            listed.append(("fit", name, *_cells(first, now, one_change, fitted[0].unit)))
    shown: list[Block] = [table(SUMMARY, rows)] if rows else []
    if listed:
        shown.append(table(LISTED, listed))
    elif rows:
        shown.append(Note(GOOD, "no difference exceeds its expanded uncertainty"))
    return [Heading(f"{compared.runs[index].name} relative to the first run", 3), *shown]


def _cells(first: float, now: float, changed: Change, unit: str) -> tuple[str, str, str, str]:
    return _number(first), _number(now), *_change(changed, unit)


def _change(changed: Change, unit: str) -> tuple[str, str]:
    """A change and its expanded uncertainty: in %, or in the quantity's unit where the first value is near zero."""
    value, std, unit = (
        (changed.percent, changed.percent_std, PERCENT) if math.isfinite(changed.percent)
        else (changed.value, changed.std, _unit(unit))
    )
    expanded = COVERAGE * std
    if not math.isfinite(value) or not expanded > 0.0:  # also where the uncertainty is not known
        return _signed(value, unit), _with(_number(expanded, 2), unit)
    shown, uncertain = (known_digits(one, expanded).replace(MINUS, "-") for one in (value, expanded))
    return _with(shown if shown.startswith("-") else f"+{shown}", unit), _with(uncertain, unit)


def _with(shown: str, unit: str) -> str:
    return shown if shown == NOTHING else f"{shown} {unit}".rstrip()


def _or_infinite(value: float) -> float:
    return value if math.isfinite(value) else math.inf


def _unit(unit: str) -> str:
    return "" if unit == "1" else unit


def _number(value: float | None, digits: int = 4) -> str:
    if value is None or not math.isfinite(value):
        return NOTHING
    shown = f"{value + 0.0:.{digits}g}"  # + 0.0: no minus zero
    return f"{value:.0f}" if "e" in shown and 1.0 <= abs(value) < 1e7 else shown


def _signed(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return NOTHING
    return _with("0" if value == 0.0 else f"{value:+.3g}", unit)

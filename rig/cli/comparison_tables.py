"""Summary of a comparison, as blocks of a document: verdict, failed values, changes, remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rig.comparison.acceptance import PERCENT, AcceptanceResult, Result, State
from rig.comparison.changes import Change
from rig.comparison.differences import MOST_RUNS, Comparison
from rig.comparison.readings import COVERAGE, LOOP_QUANTITIES, SINGLE_QUANTITIES, Reading, plain
from rig.display import Display, Shown
from rig.document.blocks import Block, Blocks, Column, Heading, Note, Paragraph, Row, table
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
        several = len(compared.runs) > 1
        blocks += _acceptance(compared.judgement, compared.display, several=several, everything=everything)
    if len(compared.runs) > MOST_RUNS:
        return [*blocks, *_checked_runs(compared), *_first_remarks(compared)]
    for index, run in enumerate(compared.runs):
        label = "first" if index == 0 and len(compared.runs) > 1 else f"run {index + 1}"
        blocks.append(Paragraph(f"{label}: {run.name}, specimen {run.specimen or 'unknown'}"))
    for index in range(1, len(compared.runs)):
        blocks += _changes(compared, index, everything=everything)
    return blocks + [Note(FAIR, f"remark: {remark}") for remark in compared.remarks]


def _checked_runs(compared: Comparison) -> Blocks:
    """One row per run: its verdict, and the value with the smallest margin."""
    if compared.judgement is None:
        return []
    by_run: dict[str, list[Result]] = {run.name: [] for run in compared.runs}
    for result in compared.judgement.results:
        by_run[result.run].append(result)
    rows = []
    for run in compared.runs:
        results = by_run[run.name]
        bad = [result for result in results if result.state != State.PASSED]
        nearest = min(results, key=lambda result: _or_infinite(result.margin_percent), default=None)
        margin = NOTHING if nearest is None or math.isnan(nearest.value) else _margin(nearest, compared.display)
        title = NOTHING if nearest is None else nearest.title
        verdict, level = ("PASS", GOOD) if results and not bad else ("FAIL", POOR)
        rows.append(Row((run.name, run.specimen or "-", verdict, f"{len(bad)}/{len(results)}", title, margin), level))
    passed = sum(row.severity == GOOD for row in rows)
    note = Note(GOOD if passed == len(rows) else POOR, f"{passed} of {len(rows)} runs passed")
    return [table(CHECKED, rows), note]


def _first_remarks(compared: Comparison) -> Blocks:
    """The first remarks on a comparison of many runs."""
    remarks = compared.remarks
    blocks: Blocks = [Note(FAIR, f"remark: {remark}") for remark in remarks[:MOST_RUNS]]
    if len(remarks) > MOST_RUNS:
        blocks.append(Paragraph(f"{len(remarks) - MOST_RUNS} more remarks; use --json to list them"))
    return blocks


def _acceptance(acceptance: AcceptanceResult, display: Display, *, several: bool, everything: bool) -> Blocks:
    total, bad = len(acceptance.results), acceptance.not_passed
    if acceptance.passed:
        least = min(acceptance.results, key=lambda result: _or_infinite(result.margin_percent))
        stated = f"PASS against {acceptance.bands.name}: all {total} values within their bands; smallest margin: "
        verdict = Note(GOOD, stated + f"{least.title}, {_margin(least, display)}")
    else:
        kinds = [f"{count} {state}" for state in (State.FAILED, State.UNSURE, State.MISSING)
                 if (count := sum(result.state == state for result in bad))]  # fmt: skip
        verdict = Note(
            POOR,
            f"FAIL against {acceptance.bands.name}: {len(bad)} of {total} values did not pass ({', '.join(kinds)})",
        )  # fmt: skip
    shown = acceptance.results if everything else bad
    notes = [Note(SEVERITIES[result.state], _result(result, display, several=several)) for result in shown]
    blocks: Blocks = [verdict, *notes]
    if not everything and len(bad) < total:
        blocks.append(Paragraph(f"{total - len(bad)} passed; use --all to show every value"))
    return [*blocks, Paragraph("")]


def _result(result: Result, display: Display, *, several: bool) -> str:
    """One value on a line of its own."""
    shown = result.shown(display)
    text = f"{result.state.upper()}  {result.title} at {result.location(display)}"
    if several:
        text += f" in {result.run}"
    value = _why(result) if math.isnan(result.value) else _with(_number(shown.signed(result.value)), shown.unit)
    text += f": {value}, allowed {band_words(result, shown)}"
    if math.isfinite(result.value):
        text += f", margin {_margin(result, display)}"
        text += f", +-{_number(shown.value(result.expanded), 2)}" if math.isfinite(result.expanded) else ""
        text += f"; {result.why}" if result.why else ""
    return text + (f" [{result.note}]" if result.note else "")


def _why(result: Result) -> str:
    return result.why or "not measured"


def band_words(result: Result, shown: Shown) -> str:
    """The band in words: "900 to 1100 N", "at least 5 N"."""
    low, high = result.band(shown)
    if low is None:
        return f"at most {_with(_number(high), shown.unit)}"
    if high is None:
        return f"at least {_with(_number(low), shown.unit)}"
    return f"{_number(low)} to {_with(_number(high), shown.unit)}"


def _margin(result: Result, display: Display) -> str:
    shown = result.shown(display)
    text = _with(_number(shown.value(result.margin), 3), shown.unit)
    share = result.margin_percent
    return text if math.isnan(share) or result.unit == "%" else f"{text} ({_number(share, 3)} %)"


CHECKED = (
    Column("run"), Column("specimen"), Column("verdict"), Column("not passed", "", True), Column("smallest margin"),
    Column("", "", True),
)  # fmt: skip
SUMMARY = (
    Column("quantity"), Column("tests", "", True), Column("differ", "", True), Column("median", "", True),
    Column("largest", "", True), Column("at"),
)  # fmt: skip
LISTED = (
    Column("motion"), Column("quantity"), Column("unit"), Column("first", "", True), Column("now", "", True),
    Column("change", "", True), Column("+-", "", True),
)  # fmt: skip


def _changes(compared: Comparison, index: int, *, everything: bool) -> Blocks:
    """Differences of one run from the first: a line for each quantity, then the motions and parameters that differ."""
    rows, listed, display = list[tuple[str, ...]](), list[tuple[str, ...]](), compared.display
    for quantity in LOOP_QUANTITIES:
        summary = compared.summary(index, quantity.key)
        if summary is None:
            continue
        shown = quantity.shown(display)
        at, largest = summary.significant or (None, None)
        rows.append((
            quantity.name, str(summary.tests), str(summary.differ), _signed(summary.median_percent, PERCENT),
            NOTHING if largest is None else _change(largest, shown)[0], NOTHING if at is None else at.phrase(display),
        ))  # fmt: skip
        for row in compared.rows:
            one = compared.change(index, quantity.key, row)
            if one is not None and (everything or one.differs):
                readings = [loop.values[quantity.key] for loop in (row.loops[0], row.loops[index]) if loop]
                listed.append((row.motion.phrase(display), quantity.name, *_cells(readings, one, shown)))
    for quantity in SINGLE_QUANTITIES:
        if (one_change := compared.single_change(index, quantity.key)) and (everything or one_change.differs):
            readings = [compared.runs[place].singles[quantity.key] for place in (0, index)]
            listed.append(("slow triangle", quantity.name, *_cells(readings, one_change, quantity.shown(display))))
    for name in compared.parameter_names:
        if (one_change := compared.parameter_change(index, name)) and (everything or one_change.differs):
            fitted = [compared.runs[place].parameters[name] for place in (0, index)]
            readings = [one.reading for one in fitted]
            listed.append(("fit", name, *_cells(readings, one_change, plain(fitted[0].unit))))
    blocks: list[Block] = [table(SUMMARY, rows)] if rows else []
    if listed:
        blocks.append(table(LISTED, listed))
    elif rows:
        blocks.append(Note(GOOD, "no difference exceeds its expanded uncertainty"))
    return [Heading(display.force.title(f"{compared.runs[index].name} relative to the first run"), 3), *blocks]


def _cells(readings: Sequence[Reading], changed: Change, shown: Shown) -> tuple[str, ...]:
    return shown.unit or NOTHING, *(_number(shown.signed(one.value)) for one in readings), *_change(changed, shown)


def _change(changed: Change, shown: Shown) -> tuple[str, str]:
    """A change and its expanded uncertainty: in %, or in the quantity's unit where the first value is near zero."""
    value, std, unit = (
        (changed.percent, changed.percent_std, PERCENT) if math.isfinite(changed.percent)
        else (shown.signed(changed.value), shown.value(changed.std), shown.unit)
    )
    expanded = COVERAGE * std
    if not math.isfinite(value) or not expanded > 0.0:  # also where the uncertainty is not known
        return _signed(value, unit), _with(_number(expanded, 2), unit)
    digits, uncertain = (known_digits(one, expanded).replace(MINUS, "-") for one in (value, expanded))
    return _with(digits if digits.startswith("-") else f"+{digits}", unit), _with(uncertain, unit)


def _with(shown: str, unit: str) -> str:
    return shown if shown == NOTHING else f"{shown} {unit}".rstrip()


def _or_infinite(value: float) -> float:
    return value if math.isfinite(value) else math.inf


def _number(value: float | None, digits: int = 4) -> str:
    if value is None or not math.isfinite(value):
        return NOTHING
    shown = f"{value + 0.0:.{digits}g}"  # + 0.0: no minus zero
    return f"{value:.0f}" if "e" in shown and 1.0 <= abs(value) < 1e7 else shown


def _signed(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return NOTHING
    return _with("0" if value == 0.0 else f"{value:+.3g}", unit)

"""Summary of a comparison, as blocks of a document: verdict, failed values, changes, remarks."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rig.comparison.acceptance import PERCENT, AcceptanceResult, Result, State
from rig.comparison.changes import Change, ChangeSummary
from rig.comparison.differences import MOST_RUNS, Comparison
from rig.comparison.readings import COVERAGE, LOOP_QUANTITIES, SINGLE_QUANTITIES, Reading, plain
from rig.comparison.specimen import SpecimenResult
from rig.comparison.words import NOTHING, SEVERITIES, SPECIMEN, margin_text, number_text, result_text, with_unit
from rig.display import Display, Shown
from rig.document.blocks import Block, Blocks, Column, Heading, Note, Paragraph, Row, table
from rig.document.numbers import MINUS, known_digits
from rig.document.terminal import Line, lines
from rig.document.words import FAIR, GOOD, POOR, all_of

STATES = (State.FAILED, State.UNSURE, State.MISSING, State.PASSED)
"""In the order in which values are shown."""


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
        margin = NOTHING if nearest is None or math.isnan(nearest.value) else margin_text(nearest, compared.display)
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
        blocks.append(Paragraph(f"Further remarks: {len(remarks) - MOST_RUNS}; use --json to list them"))
    return blocks


def _acceptance(acceptance: AcceptanceResult, display: Display, *, several: bool, everything: bool) -> Blocks:
    total, bad = len(acceptance.results), acceptance.not_passed
    if acceptance.passed:
        least = min(acceptance.results, key=lambda result: _or_infinite(result.margin_percent))
        stated = f"PASS against {acceptance.name}: {all_of(total, 'value')} within the bands; smallest margin: "
        verdict = Note(GOOD, stated + f"{least.title}, {margin_text(least, display)}")
    else:
        kinds = [f"{count} {state}" for state in (State.FAILED, State.UNSURE, State.MISSING)
                 if (count := sum(result.state == state for result in bad))]  # fmt: skip
        verdict = Note(
            POOR,
            f"FAIL against {acceptance.name}: {len(bad)} of {total} values did not pass ({', '.join(kinds)})",
        )  # fmt: skip
    shown = acceptance.results if everything else bad
    blocks: Blocks = [verdict, *(value_note(result, display, several=several) for result in shown)]
    if not everything and len(bad) < total:
        blocks.append(Paragraph(f"{total - len(bad)} passed; use --all to show every value"))
    return [*blocks, Paragraph("")]


def value_note(result: Result, display: Display, *, several: bool = False) -> Note:
    """One value on a line of its own."""
    text = f"{result.state.upper()}  {result_text(result, display, several=several)}"
    return Note(SEVERITIES[result.state], text)


def specimen_blocks(specimen: SpecimenResult, display: Display) -> Blocks:
    """The verdict on the specimen, and every value that did not pass."""
    title, severity = SPECIMEN[specimen.verdict]
    name = f"Specimen {specimen.serial_number}" if specimen.serial_number else "Specimen"
    acceptance = specimen.acceptance
    if acceptance is None:
        return [Note(severity, f"{name}: {title}: {specimen.reason}")]
    total, bad = len(acceptance.results), acceptance.not_passed
    if not bad:
        detail = f"{all_of(total, 'value')} passed; smallest margin: {specimen.reason}"
    else:
        detail = f"{len(bad)} of {total} values did not pass"
    verdict = Note(severity, f"{name}: {title} against {acceptance.name} ({acceptance.decision}): {detail}")
    return [verdict, *(value_note(result, display) for result in sorted(bad, key=lambda one: STATES.index(one.state)))]


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
            quantity.name, str(summary.tests), str(summary.differ), _median(summary, shown),
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
    return shown.unit or NOTHING, *(number_text(shown.signed(one.value)) for one in readings), *_change(changed, shown)


def _change(changed: Change, shown: Shown) -> tuple[str, str]:
    """A change and its expanded uncertainty: in %, or in the quantity's unit where the first value is near zero."""
    value, std, unit = (
        (changed.percent, changed.percent_std, PERCENT) if math.isfinite(changed.percent)
        else (shown.signed(changed.value), shown.value(changed.std), shown.unit)
    )
    expanded = COVERAGE * std
    if not math.isfinite(value) or not expanded > 0.0:  # also where the uncertainty is not known
        return _signed(value, unit), with_unit(number_text(expanded, 2), unit)
    digits, uncertain = (known_digits(one, expanded).replace(MINUS, "-") for one in (value, expanded))
    return with_unit(digits if digits.startswith("-") else f"+{digits}", unit), with_unit(uncertain, unit)


def _median(summary: ChangeSummary, shown: Shown) -> str:
    """The median of the relative changes; without any, that of the changes in the quantity's unit."""
    if math.isfinite(summary.median_percent):
        return _signed(summary.median_percent, PERCENT)
    return _signed(shown.signed(summary.median), shown.unit)


def _or_infinite(value: float) -> float:
    return value if math.isfinite(value) else math.inf


def _signed(value: float, unit: str) -> str:
    if not math.isfinite(value):
        return NOTHING
    return with_unit("0" if value == 0.0 else f"{value:+.3g}", unit)

"""Runs beside each other as one self-contained page: verdict first, bands, loops over each other, changes."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rig.comparison import Comparison
from rig.comparison.changes import Change
from rig.comparison.differences import MotionRow
from rig.comparison.judgement import Judgement, Result, State
from rig.comparison.readings import COVERAGE, LOOP_QUANTITIES, SINGLE_QUANTITIES, Reading
from rig.report.chart import Chart, Trace
from rig.report.document import views_of
from rig.report.fragment import (
    NOTHING,
    PLUS_MINUS,
    block,
    box,
    card,
    chip,
    fact,
    heading,
    key,
    key_line,
    number,
    page,
    table,
    text,
)
from rig.report.loops import DISPLACEMENT, FORCE, VELOCITY, Loop
from rig.report.style import current_colour

CHIP = {State.PASSED: "good", State.FAILED: "poor", State.UNSURE: "fair", State.MISSING: "fair"}
MOST_DRAWN = 24


def comparison_page(compared: Comparison) -> str:
    """The page; nothing is loaded from anywhere."""
    names = [_label(compared, index) for index in range(len(compared.runs))]
    parts = [
        heading("Comparison of damper tests", " \N{MIDDLE DOT} ".join(text(name) for name in names), 1),
        _facts(compared), *(box("warn", text(remark)) for remark in compared.remarks),
    ]
    if compared.judgement is not None:
        parts.append(_bands(compared.judgement, several=len(compared.runs) > 1))
    parts += [_loops(compared, names), _changes(compared, names), _parameters(compared, names)]
    return page("Comparison of damper tests", "".join(parts))


def _label(compared: Comparison, index: int) -> str:
    run = compared.runs[index]
    return f"{run.specimen}: {run.name}" if run.specimen else run.name


def _facts(compared: Comparison) -> str:
    facts = []
    if (judged := compared.judgement) is not None:
        bad = len(judged.not_passed)
        facts.append(
            fact("Accepted", f"by {text(judged.bands.name)}", "good") if judged.passed
            else fact("Not accepted", f"by {text(judged.bands.name)}: {bad} of {len(judged.results)} values", "poor")
        )
        known = [result.margin_percent for result in judged.results if math.isfinite(result.margin_percent)]
        if known:
            facts.append(fact(f"{number(min(known), 3)} %", "least margin, of the nearer limit"))
    both = sum(all(row.loops) for row in compared.rows)
    if len(compared.runs) > 1:
        facts.append(fact(f"{both} of {len(compared.rows)}", "motions that every run has"))
        for quantity in LOOP_QUANTITIES[:3]:
            summary = compared.summary(len(compared.runs) - 1, quantity.key)
            if summary is not None and math.isfinite(summary.median_percent):
                middle = f"{number(summary.median_percent, 3)} %"
                facts.append(fact(middle, f"{text(quantity.title.lower())}: median change, last against first"))
    return block("facts", "".join(facts))


def _bands(judgement: Judgement, *, several: bool) -> str:
    ordered = sorted(judgement.results, key=lambda result: (result.state == State.PASSED, _or_last(result.margin)))
    rows = [("", _result(result, several)) for result in ordered]
    head = [
        "Result", "Quantity", "Where", *(["Run"] if several else []), "Value", f"{PLUS_MINUS} (k = 2)", "From", "To",
        "Unit", "Margin", "Margin %", "Remark",
    ]  # fmt: skip
    first = 4 if several else 3
    note = (
        "Margin: to the nearer limit, negative outside. "
        + ("A value passes only where the margin is at least its expanded uncertainty (ISO 14253-1)."
           if judgement.bands.decision == "guarded" else "The uncertainty does not enter the decision.")
    )  # fmt: skip
    return heading(f"Acceptance bands: {text(judgement.bands.name)}", note) + table(
        head, rows, (first, first + 1, first + 2, first + 3, first + 5, first + 6)
    )


def _result(result: Result, several: bool) -> list[str]:
    where = result.where + (f" ({', '.join(result.points)})" if result.points else "")
    remark = "; ".join(part for part in (result.why, result.note) if part)
    quantity = f"change of {result.quantity}" if result.change else result.quantity
    return [
        chip(result.state, CHIP[result.state]), text(quantity), text(where), *([text(result.run)] if several else []),
        number(result.value), number(result.expanded, 2),
        number(result.low), number(result.high), text("" if result.unit == "1" else result.unit),
        number(result.margin, 3), number(result.margin_percent, 3), text(remark),
    ]  # fmt: skip


def _loops(compared: Comparison, names: Sequence[str]) -> str:
    """The loops of every motion over each other, one colour a run."""
    drawn = [
        {view.point.id: view.loop for view in views_of(run.run, None)[0] if view.loop is not None}
        for run in compared.runs
    ]
    cards = []
    for row in compared.rows[:MOST_DRAWN]:
        over_u, over_v = _traces(row, drawn, names)
        if over_u:
            title = row.motion.label
            pair = (Chart(DISPLACEMENT, FORCE, over_u, title=f"Force over displacement, {title}").svg()
                    + Chart(VELOCITY, FORCE, over_v, title=f"Force over velocity, {title}").svg())  # fmt: skip
            cards.append(card(f"<b>{text(title)}</b>", block("pair", pair)))
    if not cards:
        return ""
    keys = "".join(key(text(name), current_colour(index, len(names))) for index, name in enumerate(names))
    more = len(compared.rows) - MOST_DRAWN
    note = "One cycle from the middle of each test." + (f" {more} more motions: in the tables." if more > 0 else "")
    return heading("Loops over each other", note) + key_line("", keys) + block("cards", "".join(cards))


def _traces(
    row: MotionRow, drawn: Sequence[dict[str, Loop]], names: Sequence[str]
) -> tuple[list[Trace], list[Trace]]:  # fmt: skip
    over_u, over_v = [], []
    for index, reading in enumerate(row.loops):
        loop = None if reading is None else drawn[index].get(reading.ids[0])
        if loop is not None:
            colour = current_colour(index, len(names))
            over_u.append(Trace(loop.displacement_mm, loop.force_N, "m", names[index], colour))
            over_v.append(Trace(loop.velocity_m_s, loop.force_N, "m", names[index], colour))
    return over_u, over_v


def _changes(compared: Comparison, names: Sequence[str]) -> str:
    """A table a quantity: every motion, every run, change against the first."""
    parts = []
    for quantity in LOOP_QUANTITIES:
        rows = []
        for row in compared.rows:
            readings = [None if loop is None else loop.values.get(quantity.key) for loop in row.loops]
            if any(readings):
                changes = [compared.change(index, quantity.key, row) for index in range(1, len(names))]
                rows.append(("", [text(row.motion.label), *_cells(readings, changes, quantity.unit)]))
        unit = "" if quantity.unit == "1" else f", {quantity.unit}"
        parts.append(_quantity_table(f"{quantity.title}{unit}", "Motion", rows, names))
    singles = [
        ("", [text(quantity.title), *_cells(
            [run.singles.get(quantity.key) for run in compared.runs],
            [compared.single_change(index, quantity.key) for index in range(1, len(names))], quantity.unit,
        )])
        for quantity in SINGLE_QUANTITIES if any(quantity.key in run.singles for run in compared.runs)
    ]  # fmt: skip
    parts.append(_quantity_table("Slow triangle at 0 A, N", "Quantity", singles, names))
    body = "".join(parts)
    note = "In bold: more than the expanded uncertainty of the difference."
    return heading("Values and changes", note if len(names) > 1 else "") + body if body else ""


def _parameters(compared: Comparison, names: Sequence[str]) -> str:
    rows = []
    for name in compared.parameter_names:
        fitted = [run.parameters.get(name) for run in compared.runs]
        unit = next((one.unit for one in fitted if one is not None), "")
        readings = [None if one is None or one.why else one.reading for one in fitted]
        changes = [compared.parameter_change(index, name) for index in range(1, len(names))]
        rows.append(("", [text(f"{name} {unit}"), *_cells(readings, changes, unit)]))
    return _quantity_table("Fitted parameters", "Parameter", rows, names, level=2)


def _quantity_table(
    title: str, first: str, rows: Sequence[tuple[str, Sequence[str]]], names: Sequence[str], level: int = 3,
) -> str:  # fmt: skip
    if not rows:
        return ""
    head = [first, text(names[0])]
    for name in names[1:]:
        head += [text(name), "Change", f"{PLUS_MINUS} (k = 2)"]
    return heading(text(title), level=level) + table(head, rows, range(1, len(head)))


def _cells(readings: Sequence[Reading | None], changes: Sequence[Change | None], unit: str) -> list[str]:
    cells = [_reading(readings[0])]
    for reading, one in zip(readings[1:], changes, strict=True):
        shown, expanded = (NOTHING, NOTHING) if one is None else _change(one, unit)
        cells += [_reading(reading), f"<b>{shown}</b>" if one is not None and one.differs else shown, expanded]
    return cells


def _change(one: Change, unit: str) -> tuple[str, str]:
    """A change and its expanded uncertainty: in %, or in the quantity's unit where the first value is near zero."""
    relative = math.isfinite(one.percent)
    value, std, shown_unit = (one.percent, one.percent_std, "%") if relative else (one.value, one.std, unit)
    shown_unit = "" if shown_unit == "1" else shown_unit
    cells = ((value, 3), (COVERAGE * std, 2))
    shown, expanded = (
        f"{number(size, digits)} {text(shown_unit)}".rstrip() if math.isfinite(size) else NOTHING
        for size, digits in cells
    )
    return shown, expanded


def _reading(reading: Reading | None) -> str:
    if reading is None:
        return NOTHING
    spread = f" {PLUS_MINUS} {number(reading.expanded, 2)}" if reading.expanded > 0.0 else ""
    return f"{number(reading.value)}{spread}"


def _or_last(value: float) -> float:
    return value if math.isfinite(value) else math.inf

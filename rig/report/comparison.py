"""Runs compared, as a document: verdict first, then acceptance bands, loops, values and their changes."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rig.comparison import Comparison
from rig.comparison.changes import Change
from rig.comparison.differences import MotionRow
from rig.comparison.readings import COVERAGE, LOOP_QUANTITIES, SINGLE_QUANTITIES, Reading, plain
from rig.display import Display, Shown
from rig.document import html
from rig.document.blocks import (
    Blocks,
    Card,
    Cards,
    Contents,
    Cover,
    Document,
    Fact,
    Facts,
    Figures,
    Head,
    Heading,
    Keys,
    Note,
    section,
    table,
    with_contents,
)
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.moments import local_time
from rig.document.numbers import NOTHING, known_digits, number, with_uncertainty
from rig.document.style import current_colour
from rig.document.words import FAIR, GOOD, POOR, Key, Strong, Words
from rig.report.acceptance import EXPANDED, bands_section
from rig.report.cover import Details, line_of, mark_of, started
from rig.report.document import views_of
from rig.report.loops import displacement_axis, displacement_of, force_axis, velocity_axis, velocity_of
from rig.report.views import Loop

TITLE = "Comparison of damper tests"
MOST_DRAWN = 24


def comparison_page(compared: Comparison) -> str:
    """The comparison as an HTML page; nothing is loaded from anywhere."""
    return html.page(comparison_document(compared))


def comparison_document(compared: Comparison) -> Document:
    """The comparison as a document."""
    names = [_label(compared, index) for index in range(len(compared.runs))]
    lines = tuple(_about(compared, index) for index in range(len(compared.runs)))
    blocks: Blocks = [
        _cover(compared, lines), Contents(paper=False), _facts(compared),
        *(Note(FAIR, remark) for remark in compared.remarks),
    ]  # fmt: skip
    if compared.judgement is not None:
        blocks += bands_section(compared.judgement, compared.display, several=len(compared.runs) > 1)
    blocks += [*_peak_velocity(compared, names), *_loops(compared, names)]
    blocks += [*_changes(compared, names), *_parameters(compared, names)]
    mark = mark_of(run.run for run in compared.runs)
    return Document(TITLE, with_contents(blocks), mark, compared.display.paper)


def _cover(compared: Comparison, lines: Sequence[Words]) -> Cover:
    """The comparison's head: what `[report]` of all runs states alike, then a line for each run."""
    own = [Details.of(run.run) for run in compared.runs]
    customer, order, laboratory, title = (
        value if (value := getattr(own[0].table, key)) and all(getattr(one.table, key) == value for one in own) else ""
        for key in ("customer", "order_number", "laboratory", "title")
    )
    people = line_of((("Customer", customer), ("Order", order), ("Laboratory", laboratory)))
    logo = own[0].logo if all(one.logo == own[0].logo for one in own) else None
    head: list[Words] = [TITLE] if title else []
    return Cover(title or TITLE, (*head, *([people] if people else []), *lines), logo)


def _about(compared: Comparison, index: int) -> Words:
    """One run in a line: specimen, name, time."""
    run = compared.runs[index]
    when = started(run.run)
    return (
        ("First run " if index == 0 else f"Run {index + 1} ") if len(compared.runs) > 1 else "Run ",
        Strong(_label(compared, index)), f" \N{MIDDLE DOT} {local_time(when, seconds=False)}" if when else "",
    )


def _label(compared: Comparison, index: int) -> str:
    run = compared.runs[index]
    return f"{run.specimen}: {run.name}" if run.specimen else run.name


def _facts(compared: Comparison) -> Facts:
    facts = []
    if (acceptance := compared.judgement) is not None:
        bad = len(acceptance.not_passed)
        facts.append(
            Fact("PASS", f"against {acceptance.name}", GOOD) if acceptance.passed
            else Fact("FAIL", f"against {acceptance.name}: {bad} of {len(acceptance.results)} values", POOR)
        )
        known = [result.margin_percent for result in acceptance.results if math.isfinite(result.margin_percent)]
        if known:
            facts.append(Fact(f"{number(min(known), 3)} %", "smallest margin, relative to the nearest limit"))
    if len(compared.runs) > 1:
        both = sum(all(row.loops) for row in compared.rows)
        facts.append(Fact(f"{both} of {len(compared.rows)}", "motions tested in all runs"))
        facts += _differing(compared)
        for quantity in LOOP_QUANTITIES[:3]:
            summary = compared.summary(len(compared.runs) - 1, quantity.key)
            if summary is not None:
                shown = quantity.shown(compared.display)
                middle = (
                    f"{number(summary.median_percent, 2)} %" if math.isfinite(summary.median_percent)
                    else f"{number(shown.signed(summary.median), 2)} {shown.unit}"
                )
                facts.append(Fact(middle, f"{quantity.title.lower()}: median change, last run relative to first run"))
    return Facts(tuple(facts))


def _differing(compared: Comparison) -> list[Fact]:
    """How many values of the last run differ from those of the first by more than their uncertainty."""
    known = [compared.summary(len(compared.runs) - 1, quantity.key) for quantity in LOOP_QUANTITIES]
    total, differ = (sum(getattr(one, name) for one in known if one is not None) for name in ("tests", "differ"))
    if not total:
        return []
    meaning = "values differ by more than their expanded uncertainty, last run relative to first run"
    return [Fact(f"{differ} of {total}", meaning, FAIR if differ else GOOD)]


def _peak_velocity(compared: Comparison, names: Sequence[str]) -> Blocks:
    """Force at peak velocity over peak velocity of all runs, one figure for each current, one colour for each run."""
    display, cards = compared.display, []
    for waveform, current_A in sorted({(row.motion.waveform, row.motion.current_A) for row in compared.rows}):
        rows = [row for row in compared.rows if (row.motion.waveform, row.motion.current_A) == (waveform, current_A)]
        traces: list[Trace] = []
        for index, name in enumerate(names):
            loops = sorted((loop for row in rows if (loop := row.loops[index])), key=lambda loop: loop.speed_m_s)
            for key in ("rebound_force", "jounce_force"):
                known = [(loop.speed_m_s, loop.values[key].value) for loop in loops if key in loop.values]
                speed_m_s, force_N = np.array(known).reshape(-1, 2).T
                drawn = display.speed.value(speed_m_s), display.force.signed(force_N)
                colour = current_colour(index, len(names))
                traces += [Trace(*drawn, name=name, colour=colour)] if len(known) > 1 else []
                traces += [Trace(*drawn, Style.POINTS, name, colour)] if known else []
        if all(trace.style is Style.POINTS for trace in traces):
            continue
        title = f"{waveform}, {round(current_A, 4) + 0.0:.4g} A"
        force, speed = Axis("Force at peak velocity", display.force.unit), Axis("Peak velocity", display.speed.unit)
        figure = Figure(speed, force, traces, title=f"Force at peak velocity, {title}")
        cards.append(Card(Strong(title), (Figures((figure,)),)))
    if not cards:
        return []
    keys = tuple(Key(name, current_colour(index, len(names))) for index, name in enumerate(names))
    note = "One point for each motion and direction; the lines connect the points. The forces include the gas force."
    return [*section("Force at peak velocity for all runs", note), Keys(keys), Cards(tuple(cards))]


def _loops(compared: Comparison, names: Sequence[str]) -> Blocks:
    """The loops of every motion in one figure, one colour for each run."""
    drawn = [
        {view.point.id: view.loop for view in views_of(run.run, None)[0] if view.loop is not None}
        for run in compared.runs
    ]
    cards, display = [], compared.runs[0].run.display
    for row in sorted(compared.rows, key=lambda row: not all(row.loops))[:MOST_DRAWN]:
        over_u, over_v = _traces(row, drawn, names, display)
        if over_u:
            title = row.motion.phrase(display)
            force = force_axis(display)
            pair = (
                Figure(displacement_axis(display), force, over_u, title=f"Force vs. displacement, {title}"),
                Figure(velocity_axis(display), force, over_v, title=f"Force vs. velocity, {title}"),
            )
            cards.append(Card(Strong(title), (Figures(pair, across=2),)))
    if not cards:
        return []
    keys = tuple(Key(name, current_colour(index, len(names))) for index, name in enumerate(names))
    more = len(compared.rows) - MOST_DRAWN
    rest = f" Motions shown only in the tables: {more}." if more > 0 else ""
    note = f"One cycle from the middle of each test.{rest}"
    return [*section("Loops of all runs", note), Keys(keys), Cards(tuple(cards), large=True)]


def _traces(
    row: MotionRow, drawn: Sequence[dict[str, Loop]], names: Sequence[str], display: Display
) -> tuple[list[Trace], list[Trace]]:  # fmt: skip
    over_u, over_v = [], []
    for index, reading in enumerate(row.loops):
        loop = None if reading is None else drawn[index].get(reading.ids[0])
        if loop is not None:
            colour = current_colour(index, len(names))
            force = display.force.signed(loop.force_N)
            over_u.append(Trace(displacement_of(loop, display), force, name=names[index], colour=colour))
            over_v.append(Trace(velocity_of(loop, display), force, name=names[index], colour=colour))
    return over_u, over_v


def _changes(compared: Comparison, names: Sequence[str]) -> Blocks:
    """A table for each quantity: every motion, every run, change against the first."""
    parts: Blocks = []
    display = compared.display
    for quantity in LOOP_QUANTITIES:
        rows = []
        for row in compared.rows:
            readings = [None if loop is None else loop.values.get(quantity.key) for loop in row.loops]
            if any(readings):
                changes = [compared.change(index, quantity.key, row) for index in range(1, len(names))]
                rows.append([row.motion.phrase(display), *_cells(readings, changes, quantity.shown(display))])
        shown = quantity.shown(display)
        unit = f", {shown.unit}" if shown.unit else ""
        parts += _quantity_table(f"{shown.title(quantity.title)}{unit}", "Motion", rows, names)
    singles = [
        [quantity.title, *_cells(
            [run.singles.get(quantity.key) for run in compared.runs],
            [compared.single_change(index, quantity.key) for index in range(1, len(names))], quantity.shown(display),
        )]
        for quantity in SINGLE_QUANTITIES if any(quantity.key in run.singles for run in compared.runs)
    ]  # fmt: skip
    title = f"{display.force.title('Slow triangle at 0 A')}, {display.force.unit}"
    parts += _quantity_table(title, "Quantity", singles, names)
    note = "Changes in bold exceed their expanded uncertainty."
    return [*section("Values and changes", note if len(names) > 1 else ""), *parts] if parts else []


def _parameters(compared: Comparison, names: Sequence[str]) -> Blocks:
    rows = []
    for name in compared.parameter_names:
        fitted = [run.parameters.get(name) for run in compared.runs]
        unit = next((one.unit for one in fitted if one is not None), "")
        readings = [None if one is None or one.why else one.reading for one in fitted]
        changes = [compared.parameter_change(index, name) for index in range(1, len(names))]
        rows.append([f"{name} {unit}", *_cells(readings, changes, plain(unit))])
    return _quantity_table("Fitted parameters", "Parameter", rows, names, level=2)


def _quantity_table(
    title: str, first: str, rows: Sequence[Sequence[Words]], names: Sequence[str], level: int = 3,
) -> Blocks:  # fmt: skip
    if not rows:
        return []
    head: list[Head] = [first, names[0]]
    for name in names[1:]:
        head += [name, "Change", EXPANDED]
    return [Heading(title, level), table(head, rows, range(1, len(head)))]


def _cells(readings: Sequence[Reading | None], changes: Sequence[Change | None], shown: Shown) -> list[Words]:
    cells: list[Words] = [_reading(readings[0], shown)]
    for reading, one in zip(readings[1:], changes, strict=True):
        changed, expanded = (NOTHING, NOTHING) if one is None else _change(one, shown)
        cells += [_reading(reading, shown), Strong(changed) if one is not None and one.differs else changed, expanded]
    return cells


def _change(one: Change, shown: Shown) -> tuple[str, str]:
    """A change and its expanded uncertainty: in %, or in the quantity's unit where the first value is near zero."""
    relative = math.isfinite(one.percent)
    value, std, unit = (
        (one.percent, one.percent_std, "%") if relative
        else (shown.signed(one.value), shown.value(one.std), shown.unit)
    )
    expanded = COVERAGE * std
    changed, uncertain = (
        f"{known_digits(size, expanded)} {unit}".rstrip() if math.isfinite(size) else NOTHING
        for size in (value, expanded)
    )
    return changed, uncertain


def _reading(reading: Reading | None, shown: Shown) -> str:
    if reading is None:
        return NOTHING
    return with_uncertainty(shown.signed(reading.value), shown.value(reading.expanded))

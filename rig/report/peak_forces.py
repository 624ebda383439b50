"""The report's first result: the peak-velocity plot (PVP) and the table of forces by velocity and current."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import TypeVar

import numpy as np

from rig.characteristics.force_table import CONSTANT_VELOCITY, ForceCell, ForceRow, ForceTable, tests_text
from rig.characteristics.loop import LoopCharacteristics
from rig.display import Display
from rig.document.blocks import Beside, Blocks, Column, Figures, Head, Heading, Keys, Paragraph, Row, table
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.numbers import NOTHING, number, signed
from rig.document.style import current_colour
from rig.document.words import Key, Strong, Words
from rig.report.views import AS_AMPLITUDE, MotionTerms, PointView
from rig.signals.arrays import FloatArray
from rig.signals.rounding import rounded

T = TypeVar("T")
MOST_CURRENTS = 8
"""Columns of currents; a table with more of them is a list."""
FILLED = 0.6
"""Share of the motions and currents that were tested together, from which on they are rows and columns."""
MOST_ROWS = 22
"""Of a table, on the first page; all tests are in the table of test points."""
NOTABLE = 0.005
"""Relative difference of velocities that is explained."""
SHARE = 0.47
"""Of the page's width, for the plot."""
TITLE = "Forces and peak-velocity plot (PVP)"


def peak_forces(
    tables: Sequence[ForceTable], display: Display, terms: MotionTerms = AS_AMPLITUDE, gas: str = "",
) -> Blocks:
    """Plot and tables beside each other; empty without any loop. `gas` is the static gas force in words."""
    if not tables:
        return []
    shown = [block for one in tables for block in _table(one, display, terms)]
    note = _note(tables, display, gas)
    figure = peak_velocity_plot(tables, display)
    if figure is None:
        return [Heading(TITLE, listed="Forces"), *shown, note]
    both = len({one.kind for one in tables}) > 1
    marks = "Crosses: triangle at constant velocity; dots: other waveforms. " if both else ""
    plot = (Keys(current_keys(_levels(tables)), marks), Figures((figure,)))
    return [Heading(TITLE, listed="Forces"), Beside(plot, (*shown, note), SHARE)]


def levels_of(tests: Iterable[LoopCharacteristics | PointView]) -> list[float]:
    """The levels of current of some tests, ascending (A)."""
    return sorted({test.level_A for test in tests})


def _levels(tables: Sequence[ForceTable]) -> list[float]:
    return sorted({current_A for one in tables for current_A in one.currents_A})


def current_keys(levels: Sequence[float]) -> tuple[Key, ...]:
    """A key of each level of current, in its colour."""
    return tuple(Key(f"{number(one)} A", current_colour(place, len(levels))) for place, one in enumerate(levels))


def peak_velocity_plot(tables: Sequence[ForceTable], display: Display) -> Figure | None:
    """Force at peak velocity over peak velocity, a line for each current and waveform; None for fewer than two tests.

    Args:
        tables: one for each waveform.
        display: units and signs.
    """
    if sum(len(list(one.tested)) for one in tables) < 2:
        return None
    levels, traces, top = _levels(tables), list[Trace](), 0.0
    for one in tables:
        for place, current_A in enumerate(one.currents_A):
            known = [(row.speed_m_s, cell) for row in one.rows if (cell := row.cells[place]) is not None]
            speeds = display.speed.value(np.array([speed_m_s for speed_m_s, _ in known]))
            colour, name = current_colour(levels.index(current_A), len(levels)), f"{current_A:g} A, {one.waveform}"
            for forces_N in ([cell.rebound_N for _, cell in known], [cell.compression_N for _, cell in known]):
                forces = display.force.signed(np.array(forces_N))
                traces += [Trace(speeds, forces, name=name, colour=colour)] if len(known) > 1 else []
                if one.kind == CONSTANT_VELOCITY:  # each on its own is drawn as a cross
                    traces.append(Trace(_apart(speeds), _apart(forces), name=name, colour=colour))
                else:
                    traces.append(Trace(speeds, forces, Style.POINTS, name, colour))
            top = max([top, *speeds.tolist()])
    force = Axis("Force at peak velocity", display.force.unit)
    speed = Axis("Peak velocity", display.speed.unit, (0.0, 1.05 * top or 1.0))
    return Figure(speed, force, traces, 480, 300, title="Peak-velocity plot (PVP)")


def _apart(values: FloatArray) -> FloatArray:
    """Values (n,) with a gap after each, (2 n,)."""
    return np.column_stack([values, np.full(len(values), math.nan)]).ravel()


def _table(of: ForceTable, display: Display, terms: MotionTerms) -> Blocks:
    """One waveform's forces: rows of velocity and columns of current, or a list where few of them were tested."""
    if len(of.currents_A) > MOST_CURRENTS or len(list(of.tested)) < FILLED * len(of.rows) * len(of.currents_A):
        return _listed(of, display, terms)
    return _by_velocity_and_current(of, display, terms)


def _title(of: ForceTable, display: Display) -> str:
    velocity = "constant velocity" if of.kind == CONSTANT_VELOCITY else "peak velocity"
    return f"{display.force.title(f'Force at {velocity}')} ({display.force.unit}), {of.waveform}"


def _by_velocity_and_current(of: ForceTable, display: Display, terms: MotionTerms) -> Blocks:
    """Rebound, then compression: a row for each motion, by its velocity, a column for each current."""
    rows_of, more = _some(of.rows, MOST_ROWS // 2)
    head: list[Head] = [
        Column("Velocity", display.speed.unit), *([] if of.constant_stroke else [Column("Motion")]),
        *(Column(f"{number(current_A)} A", "", True) for current_A in of.currents_A),
        *([Column("Tests")] if of.averaged else []),
    ]  # fmt: skip
    rows: list[Row] = []
    for title, rebound in (("Rebound", True), ("Compression", False)):
        rows.append(Row((Strong(title), *[""] * (len(head) - 1))))
        for one in rows_of:
            motion = [] if of.constant_stroke else [terms.size(of.waveform, one.amplitude_m, one.frequency_Hz, display)]
            forces = [NOTHING if cell is None else force_text(of, cell, display, rebound=rebound) for cell in one.cells]
            tests = [one.tests] if of.averaged else []
            rows.append(Row((number(display.speed.value(one.speed_m_s), 3), *motion, *forces, *tests)))
    size = f", {terms.length(of.rows[0].amplitude_m, display)}" if of.constant_stroke else ""
    return [table(head, rows, title=_title(of, display) + size), *_more(more)]


def _listed(of: ForceTable, display: Display, terms: MotionTerms) -> Blocks:
    """A row for each test, by current and velocity."""
    head: list[Head] = [
        Column("Current", "A", True), Column("Velocity", display.speed.unit, True), Column("Rebound", "", True),
        Column("Compression", "", True), Column("Motion"),
        *([Column("Tests")] if of.averaged else []),
    ]  # fmt: skip
    shown, more = _some(sorted(of.tested, key=lambda test: test[0]), MOST_ROWS)  # by velocity within each current
    rows: list[list[Words]] = [
        [number(current_A), number(display.speed.value(row.speed_m_s), 3), force_text(of, cell, display, rebound=True),
         force_text(of, cell, display, rebound=False),
         terms.size(of.waveform, row.amplitude_m, row.frequency_Hz, display),
         *([tests_text(len(cell.points), len(cell.points))] if of.averaged else [])] for current_A, row, cell in shown
    ]  # fmt: skip
    return [table(head, rows, title=_title(of, display)), *_more(more)]


def _some(members: Sequence[T], most: int) -> tuple[list[T], int]:
    """At most so many members, evenly spread, first and last among them; and how many are left out."""
    count = min(most, len(members))
    places = sorted(set(np.linspace(0, len(members) - 1, count).round().astype(int).tolist()))
    return [members[place] for place in places], len(members) - len(places)


def _more(count: int) -> Iterator[Paragraph]:
    if count:
        yield Paragraph(f"Further rows in the full report: {count}.", small=True)


def force_text(of: ForceTable, cell: ForceCell, display: Display, *, rebound: bool) -> str:
    """A force at the row's velocity with the decimal places of its table, without the unit."""
    value_N = cell.rebound_N if rebound else cell.compression_N
    if not math.isfinite(value_N):
        return NOTHING
    return signed(rounded(display.force.signed(value_N), of.places(display.force.scale)))


def greatest(tables: Sequence[ForceTable], *, rebound: bool) -> tuple[ForceTable, float, ForceRow, ForceCell] | None:
    """The most positive rebound force (SI) of the tables, or the most negative compression force; None without any.

    Returns:
        The table, the current (A), the row and the cell.
    """
    known = [(one, *tested) for one in tables for tested in one.tested]
    if rebound:
        known = [entry for entry in known if math.isfinite(entry[3].rebound_N)]
        return max(known, key=lambda entry: entry[3].rebound_N, default=None)
    known = [entry for entry in known if math.isfinite(entry[3].compression_N)]
    return min(known, key=lambda entry: entry[3].compression_N, default=None)


def _note(tables: Sequence[ForceTable], display: Display, gas: str) -> Paragraph:
    lines = [
        "Mean force at the velocity of each row, gas force included, with the decimal places of the table's median "
        "standard uncertainty (variation between cycles; calibration not included) and at most four digits.",
        f"Forces are positive in {display.positive}.",
    ]
    faster = max((row.speed_m_s / row.requested_m_s(one.waveform) for one in tables for row in one.rows), default=1.0)
    if faster > 1.0 + NOTABLE and any(one.kind == CONSTANT_VELOCITY for one in tables):
        lines.append(
            "Velocities are measured. At constant velocity they can exceed that of an ideal triangle of the same "
            f"size (here by up to {100.0 * (faster - 1.0):.2g} %), because the reversals are rounded."
        )
    if any(cell.rebound_N < 0.0 for one in tables for _, _, cell in one.tested):
        sign = "positive" if display.positive == "compression" else "negative"
        lines.append(f"A {sign} rebound force means that the gas force exceeds the damping force.")
    if gas:
        lines.append(f"Static gas force: {gas}.")
    return Paragraph(" ".join(lines), small=True)


def peak_force_std_N(loop: LoopCharacteristics) -> float:
    """Standard uncertainty (N) of a loop's peak forces by the variation between its cycles; NaN where unknown."""
    return loop.force_scatter_N / math.sqrt(loop.cycles) if loop.cycles > 0 else math.nan

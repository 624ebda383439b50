"""The report's first result: the peak-velocity plot (PVP) and the table of peak forces by velocity and current."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rig.characteristics.loop import LoopCharacteristics
from rig.display import Display
from rig.document.blocks import Beside, Block, Blocks, Column, Figures, Head, Heading, Keys, Paragraph, Row, table
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.numbers import known_digits, number
from rig.document.style import current_colour
from rig.document.words import Key, Strong, Words

MOST_CURRENTS = 8
"""Columns of currents; a table with more of them is a list."""
FILLED = 0.6
"""Share of the motions and currents that were tested together, from which on they are rows and columns."""
MOST_ROWS = 22
"""Of a list, on the first page; all of them are in the table of points."""
SHARE = 0.47
"""Of the page's width, for the plot."""


def peak_forces(loops: Sequence[LoopCharacteristics], display: Display) -> Blocks:
    """Plot and table beside each other; empty without any loop."""
    known = [loop for loop in loops if loop.peak_force_N.known]
    if not known:
        return []
    table_blocks: tuple[Block, ...] = tuple(_table(known, display))
    figure = peak_velocity_plot(known, display)
    if figure is None:
        return [Heading("Peak forces and peak-velocity plot (PVP)", listed="Peak forces"), *table_blocks]
    plot = (_keys(known), Figures((figure,)))
    return [Heading("Peak forces and peak-velocity plot (PVP)", listed="Peak forces"), Beside(plot, table_blocks, SHARE)]


def levels_of(loops: Sequence[LoopCharacteristics]) -> list[float]:
    """The levels of current of some loops, ascending (A)."""
    return sorted({loop.level_A for loop in loops})


def current_keys(levels: Sequence[float]) -> tuple[Key, ...]:
    """A key of each level of current, in its colour."""
    return tuple(Key(f"{number(one)} A", current_colour(place, len(levels))) for place, one in enumerate(levels))


def _keys(loops: Sequence[LoopCharacteristics]) -> Keys:
    return Keys(current_keys(levels_of(loops)))


def peak_velocity_plot(loops: Sequence[LoopCharacteristics], display: Display) -> Figure | None:
    """Peak force over peak velocity, a line for each current and waveform; None for fewer than two loops."""
    if len(loops) < 2:
        return None
    levels, traces = levels_of(loops), list[Trace]()
    for level_A, waveform in dict.fromkeys((loop.level_A, loop.waveform) for loop in loops):
        members = sorted(
            (loop for loop in loops if (loop.level_A, loop.waveform) == (level_A, waveform)),
            key=lambda loop: loop.peak_speed_m_s,
        )
        speeds = display.speed.value(np.array([loop.peak_speed_m_s for loop in members]))
        colour, name = current_colour(levels.index(level_A), len(levels)), f"{level_A:g} A, {waveform}"
        for column in zip(*(loop.peak_force_N for loop in members), strict=True):
            forces = display.force.signed(np.array(column))
            if len(members) > 1:
                traces.append(Trace(speeds, forces, name=name, colour=colour))
            traces.append(Trace(speeds, forces, Style.POINTS, name, colour))
    top = max(float(np.nanmax(trace.x)) for trace in traces)
    return Figure(
        Axis("Peak velocity", display.speed.unit, (0.0, 1.05 * top)),
        Axis(display.force.title("Peak force"), display.force.unit), traces, 480, 300, title="Peak-velocity plot (PVP)",
    )  # fmt: skip


def _table(loops: Sequence[LoopCharacteristics], display: Display) -> Blocks:
    levels = levels_of(loops)
    cells = {(loop.motion, loop.level_A) for loop in loops}
    motions = {loop.motion for loop in loops}
    together = len(cells) >= FILLED * len(levels) * len(motions)
    if len(levels) <= MOST_CURRENTS and together:
        return _by_velocity_and_current(loops, levels, display)
    return _listed(loops, display)


def _by_velocity_and_current(
    loops: Sequence[LoopCharacteristics], levels: Sequence[float], display: Display
) -> Blocks:
    """Rebound, then compression: a row for each motion, by its velocity, a column for each current."""
    by_motion: dict[tuple[str, float, float], list[LoopCharacteristics]] = {}
    for loop in loops:
        by_motion.setdefault(loop.motion, []).append(loop)
    ordered = sorted(by_motion.items(), key=lambda item: _speed(item[1]))
    named = len({(waveform, amplitude_m) for waveform, amplitude_m, _ in by_motion}) > 1
    head: list[Head] = [
        Column("Peak velocity", display.speed.unit), *([Column("Motion")] if named else []),
        *(Column(f"{number(level)} A", "", True) for level in levels),
    ]  # fmt: skip
    rows: list[Row] = []
    for title, of in (("Rebound", 0), ("Compression", 1)):
        rows.append(Row((Strong(title), *[""] * (len(head) - 1))))
        for motion, members in ordered:
            cells: list[Words] = [number(display.speed.value(_speed(members)), 3)]
            cells += [motion_label(motion, display)] if named else []
            cells += [_mean([one for one in members if one.level_A == level], of, display) for level in levels]
            rows.append(Row(tuple(cells)))
    title = f"{display.force.title('Peak force')} ({display.force.unit})"
    return [table(head, rows, title=title), _note()]


def _note() -> Paragraph:
    text = (
        "Largest force of the mean cycle in each direction, gas force included, rounded to its standard uncertainty "
        "(variation between cycles; calibration not included)."
    )
    return Paragraph(text, small=True)


def _speed(loops: Sequence[LoopCharacteristics]) -> float:
    return float(np.mean([loop.peak_speed_m_s for loop in loops]))


def motion_label(motion: tuple[str, float, float], display: Display) -> str:
    """A motion in few letters: "sine 50 mm 0.5 Hz"."""
    waveform, amplitude_m, frequency_Hz = motion
    return f"{waveform} {display.displacement.text(amplitude_m)} {frequency_Hz:.4g} Hz"


def _mean(loops: Sequence[LoopCharacteristics], of: int, display: Display) -> str:
    """The mean of repeated tests; a dash where there is none."""
    if not loops:
        return number(None)
    forces = [loop.peak_force_N[of] for loop in loops]
    std_N = math.hypot(*(peak_force_std_N(loop) for loop in loops)) / len(loops)
    if len(loops) > 1:
        std_N = max(std_N, float(np.std(forces, ddof=1)) / math.sqrt(len(loops)))
    return known_digits(display.force.signed(float(np.mean(forces))), display.force.value(std_N))


def peak_force_std_N(loop: LoopCharacteristics) -> float:
    """Standard uncertainty (N) of a loop's peak forces by the variation between its cycles; NaN where unknown."""
    return loop.force_scatter_N / math.sqrt(loop.cycles) if loop.cycles > 0 else math.nan


def _listed(loops: Sequence[LoopCharacteristics], display: Display) -> Blocks:
    """A row for each test, by current and velocity; the slowest, the fastest and evenly many between where many."""
    head: list[Head] = [
        Column("Current", "A", True), Column("Peak velocity", display.speed.unit, True),
        Column("Rebound", display.force.unit, True), Column("Compression", display.force.unit, True), Column("Motion"),
    ]  # fmt: skip
    ordered = sorted(loops, key=lambda loop: (loop.level_A, loop.peak_speed_m_s))
    places = sorted(set(np.linspace(0, len(ordered) - 1, min(MOST_ROWS, len(ordered))).round().astype(int).tolist()))
    rows = [
        Row((number(loop.level_A), number(display.speed.value(loop.peak_speed_m_s), 3), _mean([loop], 0, display),
             _mean([loop], 1, display), motion_label(loop.motion, display)))
        for loop in (ordered[place] for place in places)
    ]  # fmt: skip
    more = len(ordered) - len(rows)
    rest: Blocks = [Paragraph(f"{more} more tests are in the table of test points.", small=True)] if more else []
    return [table(head, rows, title=f"{display.force.title('Peak force')}"), *rest, _note()]

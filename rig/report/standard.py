"""The report's standard damper tests: peak-velocity plot, energy, damping, dynamic range, friction, coil lag."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from rig.characteristics import Characteristics
from rig.characteristics.loop import LoopCharacteristics, Measured
from rig.document.blocks import Blocks, Card, Cards, Column, Figures, Heading, Keys, Paragraph, section, table
from rig.document.figure import Axis, Figure, Trace
from rig.document.numbers import NOTHING, PLUS_MINUS, number, plus_minus
from rig.document.style import current_colour
from rig.document.words import Key, Strong, Words
from rig.identification.points.current_steps import CurrentLag
from rig.signals.estimate import Estimate

PEAK_SPEED = Axis("Peak velocity", "m/s")
SHORT_DASH = np.array([0.985, 1.015])
"""A single loop is drawn as a short dash, from and to so many times its speed."""


def standard_tests(characteristics: Characteristics) -> Blocks:
    """Everything measured of the damper itself, without a model; empty where there is nothing."""
    loops = characteristics.loops
    body = [*_plots(loops), *_loops_table(loops), *_ranges(characteristics), *_special(characteristics)]
    if not body:
        return []
    note = (
        f"These values are determined from the measurements without a model. {PLUS_MINUS} is one standard uncertainty "
        "due to the variation between cycles, excluding calibration uncertainty. Forces are mean forces at peak "
        "velocity, in rebound and compression."
    )
    if characteristics.left_out:
        body.append(Paragraph(f"Not measured: {'; '.join(characteristics.left_out)}.", small=True))
    if characteristics.remarks:
        body.append(Paragraph(f"Remarks: {'; '.join(characteristics.remarks)}.", small=True))
    return [*section("Standard damper tests", note), *body]


TITLES = {"force": "Peak-velocity plot (PVP)", "energy": "Energy per cycle", "damping": "Equivalent viscous damping"}


def plots(loops: Sequence[LoopCharacteristics]) -> dict[str, Figure]:
    """Over peak velocity, one line for each current: `force` (rebound and compression); empty for a single loop.

    `energy`, which grows with the stroke, and `damping`, which falls with it, have a line for each amplitude.
    """
    if len(loops) < 2:
        return {}
    return {
        "force": _figure(loops, Axis("Force", "N"), lambda loop: (loop.rebound_N, loop.jounce_N)),
        "energy": _figure(loops, Axis("Energy", "J"), lambda loop: (loop.energy_J,), _amplitude),
        "damping": _figure(loops, Axis("Damping", "N s/m"), lambda loop: (loop.equivalent_damping_N_s_m,), _amplitude),
    }


def _plots(loops: Sequence[LoopCharacteristics]) -> Blocks:
    cards = tuple(Card(Strong(TITLES[name]), (Figures((figure,)),)) for name, figure in plots(loops).items())
    if not cards:
        return []
    currents = sorted({loop.level_A for loop in loops})
    keys = tuple(
        Key(f"{number(current)} A", current_colour(index, len(currents))) for index, current in enumerate(currents)
    )
    strokes = " and amplitude (energy, damping)" if len({_amplitude(loop) for loop in loops}) > 1 else ""
    return [Keys(keys, f"One curve for each current{strokes}. "), Cards(cards)]


def _amplitude(loop: LoopCharacteristics) -> str:
    """The amplitude to which a loop belongs, as a trace names it."""
    return f", {number(1e3 * loop.amplitude_level_m, 4)} mm"


def _any(loop: LoopCharacteristics) -> str:
    del loop
    return ""


def _figure(
    loops: Sequence[LoopCharacteristics], axis: Axis, values: Callable[[LoopCharacteristics], tuple[Measured, ...]],
    apart: Callable[[LoopCharacteristics], str] = _any,
) -> Figure:
    """A line for each current, waveform and value of `apart`, over peak velocity."""
    currents = sorted({loop.level_A for loop in loops})
    traces = []
    for line in dict.fromkeys((loop.level_A, loop.waveform, apart(loop)) for loop in loops):
        members = sorted(
            (loop for loop in loops if (loop.level_A, loop.waveform, apart(loop)) == line),
            key=lambda loop: loop.peak_speed_m_s,
        )
        speeds = np.array([loop.peak_speed_m_s for loop in members])
        for column in zip(*(values(loop) for loop in members), strict=True):
            height = np.array([point.value for point in column])
            if len(members) == 1:
                speeds, height = speeds[0] * SHORT_DASH, np.repeat(height, 2)
            colour = current_colour(currents.index(line[0]), len(currents))
            traces.append(Trace(speeds, height, name=f"{line[0]:g} A, {line[1]}{line[2]}", colour=colour))
    return Figure(PEAK_SPEED, axis, traces, 400, 270, title=f"{axis.label} vs. peak velocity")


def _loops_table(loops: Sequence[LoopCharacteristics]) -> Blocks:
    if not loops:
        return []
    head = [
        Column("Point"), Column("Waveform"), Column("A", "mm", True), Column("f", "Hz", True), Column("I", "A", True),
        Column("Peak velocity", "m/s", True), Column("Rebound", "N", True), Column("Compression", "N", True),
        Column("Energy", "J", True), Column("Damping", "N s/m", True), Column("Force SD", "N", True),
    ]  # fmt: skip
    rows = [
        [
            loop.id, loop.waveform, number(1e3 * loop.amplitude_m), number(loop.frequency_Hz),
            number(loop.current_A), number(loop.peak_speed_m_s, 3), _measured(loop.rebound_N), _measured(loop.jounce_N),
            _measured(loop.energy_J), _measured(loop.equivalent_damping_N_s_m), number(loop.force_scatter_N, 2),
        ]
        for loop in sorted(loops, key=lambda loop: (loop.level_A, loop.peak_speed_m_s))
    ]  # fmt: skip
    note = (
        "The loops at 0 A are the damper's zero-current signature. Force SD: standard deviation from cycle to cycle at "
        "the same phase."
    )
    return [table(head, rows), Paragraph(note, small=True)]


def _ranges(characteristics: Characteristics) -> Blocks:
    if not characteristics.dynamic_range:
        return []
    head = [
        Column("Waveform"), Column("A", "mm", True), Column("f", "Hz", True), Column("I", "A", True),
        Column("Rebound", "", True), Column("Compression", "", True),
    ]  # fmt: skip
    rows = [
        [
            dynamic.motion[0], number(1e3 * dynamic.motion[1]), number(dynamic.motion[2]), number(dynamic.current_A),
            _with_std(dynamic.rebound, dynamic.std), number(dynamic.jounce, 4),
        ]
        for dynamic in characteristics.dynamic_range
    ]  # fmt: skip
    note = (
        "Ratio of the force at peak velocity to the force at peak velocity in the same motion at 0 A, both without "
        "the static force."
    )
    return [*section("Dynamic range", note, 3), table(head, rows)]


def _special(characteristics: Characteristics) -> Blocks:
    rows: list[list[Words]] = []
    for test in characteristics.friction:
        speed = f"{number(1e3 * test.speed_m_s, 3)} mm/s"
        rows += [
            [test.id, "Gas force (static)", _measured(test.gas_force_N), "N", f"at {speed}"],
            [test.id, "Friction", _measured(test.friction_N), "N", f"half the width of the force loop at {speed}, 0 A"],
            [test.id, "Stiffness", _measured(test.stiffness_N_m), "N/m", "slope of the static force at mid-stroke"],
        ]
    if characteristics.lag is not None:
        rows += _lag_rows(characteristics.lag)
    if not rows:
        return []
    head = ["Point", "Quantity", "Value", "Unit", "Method"]
    return [Heading("Gas force, friction, coil lag", 3), table(head, rows, (2,))]


def _lag_rows(lag: CurrentLag) -> list[list[Words]]:
    value = f"{number(lag.eta_1_s, 5)} {PLUS_MINUS} {number(lag.std_1_s, 2)}"
    rows: list[list[Words]] = [
        [NOTHING, "Coil lag eta", value, "1/s", f"{lag.steps} current steps, from command to measured current"],
    ]
    if lag.delay_s is not None:
        rows.append([NOTHING, "Command delay", number(1e3 * lag.delay_s, 3), "ms", "from host to coil, median"])
    return rows


def _measured(value: Measured) -> str:
    return _with_std(value.value, value.std)


def _with_std(value: float, std: float) -> str:
    return plus_minus(Estimate(value, std)) if math.isfinite(std) and std > 0.0 else number(value)

"""The report's standard damper tests: energy, damping, dynamic range, friction, coil lag."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rig.characteristics import Characteristics
from rig.characteristics.force_table import force_tables
from rig.characteristics.loop import LoopCharacteristics
from rig.display import Display
from rig.document.blocks import Blocks, Card, Cards, Column, Figures, Heading, Keys, Paragraph, section, table
from rig.document.figure import Axis, Figure, Trace
from rig.document.numbers import NOTHING, PLUS_MINUS, known_digits, number, with_uncertainty
from rig.document.style import current_colour
from rig.document.words import Strong, Words
from rig.identification.points.current_steps import CurrentLag
from rig.report.peak_forces import current_keys, levels_of, peak_velocity_plot

SHORT_DASH = np.array([0.985, 1.015])
"""A single loop is drawn as a short dash, from and to so many times its speed."""


def standard_tests(characteristics: Characteristics, display: Display) -> Blocks:
    """Everything measured of the damper itself, without a model; empty where there is nothing."""
    loops = characteristics.loops
    body = [*_plots(loops, display), *_ranges(characteristics, display), *_special(characteristics, display)]
    if not body and not characteristics.left_out:
        return []
    note = (
        f"These values are determined from the measurements without a model. {PLUS_MINUS} is one standard uncertainty "
        "due to the variation between cycles, excluding calibration uncertainty. The values of each test are in the "
        "table of test points."
    )
    if characteristics.left_out:
        body.append(Paragraph(f"Not measured: {'; '.join(characteristics.left_out)}.", small=True))
    if characteristics.remarks:
        body.append(Paragraph(f"Remarks: {'; '.join(characteristics.remarks)}.", small=True))
    return [*section("Standard damper tests", note), *body]


TITLES = {"energy": "Energy per cycle", "damping": "Equivalent viscous damping"}


def plots(loops: Sequence[LoopCharacteristics], display: Display) -> dict[str, Figure]:
    """Over peak velocity, a line for each current and amplitude: `energy`, `damping`; empty for a single loop.

    Energy grows with the stroke, and the damping falls with it. `force` is the peak-velocity plot.
    """
    pvp = peak_velocity_plot(force_tables(loops), display)
    return ({} if pvp is None else {"force": pvp}) | _by_amplitude(loops, display)


def _by_amplitude(loops: Sequence[LoopCharacteristics], display: Display) -> dict[str, Figure]:
    """The figures of `TITLES`; empty for a single loop."""
    if len(loops) < 2:
        return {}
    damping, energy = display.damping, display.energy
    return {
        "energy": _figure(
            loops, display, Axis("Energy", energy.unit), lambda loop: energy.value(loop.energy_J.value)
        ),
        "damping": _figure(
            loops, display, Axis("Damping", damping.unit),
            lambda loop: damping.value(loop.equivalent_damping_N_s_m.value),
        ),
    }


def _plots(loops: Sequence[LoopCharacteristics], display: Display) -> Blocks:
    drawn = _by_amplitude(loops, display)
    cards = tuple(Card(Strong(TITLES[name]), (Figures((figure,)),)) for name, figure in drawn.items())
    if not cards:
        return []
    strokes = " and amplitude" if len({_amplitude(loop, display) for loop in loops}) > 1 else ""
    return [Keys(current_keys(levels_of(loops)), f"One curve for each current{strokes}. "), Cards(cards)]


def _amplitude(loop: LoopCharacteristics, display: Display) -> str:
    """The amplitude to which a loop belongs, as a trace names it."""
    return display.displacement.text(loop.amplitude_level_m)


def _figure(
    loops: Sequence[LoopCharacteristics], display: Display, axis: Axis, value: Callable[[LoopCharacteristics], float]
) -> Figure:
    """A line for each current, waveform and amplitude, over peak velocity."""
    currents = levels_of(loops)
    traces = []
    for line in dict.fromkeys((loop.level_A, loop.waveform, _amplitude(loop, display)) for loop in loops):
        members = sorted(
            (loop for loop in loops if (loop.level_A, loop.waveform, _amplitude(loop, display)) == line),
            key=lambda loop: loop.peak_speed_m_s,
        )
        speeds = display.speed.value(np.array([loop.peak_speed_m_s for loop in members]))
        height = np.array([value(loop) for loop in members])
        if len(members) == 1:
            speeds, height = speeds[0] * SHORT_DASH, np.repeat(height, 2)
        colour = current_colour(currents.index(line[0]), len(currents))
        traces.append(Trace(speeds, height, name=f"{line[0]:g} A, {line[1]}, {line[2]}", colour=colour))
    speed = Axis("Peak velocity", display.speed.unit)
    return Figure(speed, axis, traces, 400, 270, title=f"{axis.label} vs. peak velocity")


def _ranges(characteristics: Characteristics, display: Display) -> Blocks:
    if not characteristics.dynamic_range:
        return []
    head = [
        Column("Waveform"), Column("Amplitude", display.displacement.unit, True), Column("Frequency", "Hz", True),
        Column("Current", "A", True), Column("Rebound", "", True), Column("Compression", "", True),
    ]  # fmt: skip
    rows = [
        [
            dynamic.motion[0], number(display.displacement.value(dynamic.motion[1])), number(dynamic.motion[2]),
            number(dynamic.current_A), with_uncertainty(dynamic.rebound, dynamic.std),
            known_digits(dynamic.jounce, dynamic.std),
        ]
        for dynamic in characteristics.dynamic_range
    ]  # fmt: skip
    note = (
        "Ratio of the force at peak velocity to the force at peak velocity in the same motion at 0 A, both without "
        "the static force."
    )
    return [*section("Dynamic range", note, 3), table(head, rows)]


def _special(characteristics: Characteristics, display: Display) -> Blocks:
    rows: list[list[Words]] = []
    force = display.force
    for test in characteristics.friction:
        speed = f"{number(1e3 * test.speed_m_s, 3)} mm/s" if display.usual else display.speed.text(test.speed_m_s, 3)
        gas = with_uncertainty(force.signed(test.gas_force_N.value), force.value(test.gas_force_N.std))
        friction = with_uncertainty(force.value(test.friction_N.value), force.value(test.friction_N.std))
        stiffness = with_uncertainty(test.stiffness_N_m.value, test.stiffness_N_m.std)
        rows += [
            [test.id, force.title("Gas force (static)"), gas, force.unit, f"at {speed}"],
            [test.id, "Friction", friction, force.unit, f"half the width of the force loop at {speed}, 0 A"],
            [test.id, "Stiffness", stiffness, "N/m", "slope of the static force at mid-stroke"],
        ]
    if characteristics.lag is not None:
        rows += _lag_rows(characteristics.lag)
    if not rows:
        return []
    head = ["Point", "Quantity", "Value", "Unit", "Method"]
    return [Heading("Gas force, friction, coil lag", 3), table(head, rows, (2,))]


def _lag_rows(lag: CurrentLag) -> list[list[Words]]:
    value = with_uncertainty(lag.eta_1_s, lag.std_1_s)
    rows: list[list[Words]] = [
        [NOTHING, "Coil lag eta", value, "1/s", f"{lag.steps} current steps, from command to measured current"],
    ]
    if lag.delay_s is not None:
        rows.append([NOTHING, "Command delay", number(1e3 * lag.delay_s, 3), "ms", "from host to coil, median"])
    return rows

"""The report's standard damper tests: peak-velocity plot, energy, damping, dynamic range, friction, the coil's lag."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from rig.characteristics import Characteristics
from rig.characteristics.loop import LoopCharacteristics, Measured
from rig.identification.points.current_steps import CurrentLag
from rig.report.chart import Chart, Trace
from rig.report.fragment import NOTHING, PLUS_MINUS, card, charts, heading, key, key_line, lead, number, table, text
from rig.report.style import current_colour

PEAK_SPEED = "Peak velocity m/s"


def standard_tests(characteristics: Characteristics) -> str:
    """Everything measured of the damper itself, without a model; empty where there is nothing."""
    loops = characteristics.loops
    body = _plots(loops) + _loops_table(loops) + _ranges(characteristics) + _special(characteristics)
    if not body:
        return ""
    note = (
        f"Measured, no model involved. {PLUS_MINUS} is one standard uncertainty from the scatter over the cycles; the "
        "uncertainty of calibrations comes on top. Forces are mean forces at peak velocity, in extension (rebound) and "
        "compression (jounce)."
    )
    left_out = lead(f"Not measured: {text('; '.join(characteristics.left_out))}.") if characteristics.left_out else ""
    remarks = lead(f"Remarks: {text('; '.join(characteristics.remarks))}.") if characteristics.remarks else ""
    return heading("Standard damper tests", note) + body + left_out + remarks


TITLES = {"force": "Peak-velocity plot (PVP)", "energy": "Energy per cycle", "damping": "Equivalent viscous damping"}


def plots(loops: Sequence[LoopCharacteristics]) -> dict[str, Chart]:
    """Over peak velocity, one line a current: `force` (rebound and jounce); none of one loop.

    `energy` and `damping`, which grow with the stroke and fall with it, have a line for each amplitude.
    """
    if len(loops) < 2:
        return {}
    return {
        "force": _chart(loops, "Force N", lambda loop: (loop.rebound_N, loop.jounce_N)),
        "energy": _chart(loops, "Energy J", lambda loop: (loop.energy_J,), _amplitude),
        "damping": _chart(loops, "Damping N s/m", lambda loop: (loop.equivalent_damping_N_s_m,), _amplitude),
    }


def _plots(loops: Sequence[LoopCharacteristics]) -> str:
    cards = [_titled(TITLES[name], chart) for name, chart in plots(loops).items()]
    if not cards:
        return ""
    currents = sorted({loop.level_A for loop in loops})
    keys = "".join(
        key(f"{number(current)} A", current_colour(index, len(currents))) for index, current in enumerate(currents)
    )
    strokes = " and amplitude (energy, damping)" if len({_amplitude(loop) for loop in loops}) > 1 else ""
    return key_line(f"One line a current{strokes}.", keys) + charts(cards)


def _amplitude(loop: LoopCharacteristics) -> str:
    """The amplitude to which a loop belongs, as a trace names it."""
    return f", {number(1e3 * loop.amplitude_level_m, 4)} mm"


def _any(loop: LoopCharacteristics) -> str:
    del loop
    return ""


def _chart(
    loops: Sequence[LoopCharacteristics], label: str, values: Callable[[LoopCharacteristics], tuple[Measured, ...]],
    apart: Callable[[LoopCharacteristics], str] = _any,
) -> Chart:
    """A line for each current, waveform and what stands `apart`, over peak velocity; a single loop is a short dash."""
    currents = sorted({loop.level_A for loop in loops})
    traces = []
    for line in dict.fromkeys((loop.level_A, loop.waveform, apart(loop)) for loop in loops):
        alike = sorted(
            (loop for loop in loops if (loop.level_A, loop.waveform, apart(loop)) == line),
            key=lambda loop: loop.peak_speed_m_s,
        )
        speeds = np.array([loop.peak_speed_m_s for loop in alike])
        for column in zip(*(values(loop) for loop in alike), strict=True):
            height = np.array([point.value for point in column])
            if len(alike) == 1:
                speeds, height = speeds[0] * np.array([0.985, 1.015]), np.repeat(height, 2)
            colour = current_colour(currents.index(line[0]), len(currents))
            traces.append(Trace(speeds, height, "m", f"{line[0]:g} A, {line[1]}{line[2]}", colour))
    return Chart(PEAK_SPEED, label, traces, 400, 270, title=f"{label} over peak velocity")


def _titled(title: str, chart: Chart) -> str:
    return card(f"<b>{text(title)}</b>", chart.svg())


def _loops_table(loops: Sequence[LoopCharacteristics]) -> str:
    if not loops:
        return ""
    head = ["Point", "Waveform", "A mm", "f Hz", "I A", "Peak m/s", "Rebound N", "Jounce N", "Energy J",
            "Damping N s/m", "Force scatter N"]
    rows = [
        ("", [
            text(loop.id), text(loop.waveform), number(1e3 * loop.amplitude_m), number(loop.frequency_Hz),
            number(loop.current_A), number(loop.peak_speed_m_s, 3), _measured(loop.rebound_N), _measured(loop.jounce_N),
            _measured(loop.energy_J), _measured(loop.equivalent_damping_N_s_m), number(loop.force_scatter_N, 2),
        ])
        for loop in sorted(loops, key=lambda loop: (loop.level_A, loop.peak_speed_m_s))
    ]
    note = "Loops at 0 A are the damper's zero-current signature. Force scatter: from cycle to cycle at equal phase."
    return table(head, rows, tuple(range(2, 11))) + lead(note)


def _ranges(characteristics: Characteristics) -> str:
    if not characteristics.dynamic_range:
        return ""
    head = ["Waveform", "A mm", "f Hz", "I A", "Rebound", "Jounce"]
    rows = [
        ("", [
            text(dynamic.motion[0]), number(1e3 * dynamic.motion[1]), number(dynamic.motion[2]),
            number(dynamic.current_A),
            f"{number(dynamic.rebound, 4)} {PLUS_MINUS} {number(dynamic.std, 2)}", number(dynamic.jounce, 4),
        ])
        for dynamic in characteristics.dynamic_range
    ]
    note = "Force at peak velocity over that of the same motion at 0 A, the static force taken off both."
    return heading("Dynamic range", note, 3) + table(head, rows, (1, 2, 3, 4, 5))


def _special(characteristics: Characteristics) -> str:
    rows = []
    for test in characteristics.friction:
        speed = f"{number(1e3 * test.speed_m_s, 3)} mm/s"
        rows.append(("", [text(test.id), "Gas force (static)", _measured(test.gas_force_N), "N", f"at {speed}"]))
        rows.append(("", [
            text(test.id), "Friction", _measured(test.friction_N), "N", f"half the force's width at {speed}, 0 A",
        ]))
        rows.append(("", [
            text(test.id), "Stiffness", _measured(test.stiffness_N_m), "N/m", "slope of the static force, mid-stroke",
        ]))
    if characteristics.lag is not None:
        rows += _lag_rows(characteristics.lag)
    if not rows:
        return ""
    head = ["Point", "Quantity", "Value", "Unit", "How"]
    return heading("Gas force, friction, coil lag", level=3) + table(head, rows, (2,))


def _lag_rows(lag: CurrentLag) -> list[tuple[str, list[str]]]:
    value = f"{number(lag.eta_1_s, 5)} {PLUS_MINUS} {number(lag.std_1_s, 2)}"
    rows = [("", [NOTHING, "Coil lag eta", value, "1/s", f"{lag.steps} current steps, command to measured current"])]
    if lag.delay_s is not None:
        rows.append(("", [NOTHING, "Command delay", number(1e3 * lag.delay_s, 3), "ms", "host to coil, median"]))
    return rows


def _measured(value: Measured, digits: int = 4) -> str:
    spread = f" {PLUS_MINUS} {number(value.std, 2)}" if math.isfinite(value.std) else ""
    return f"{number(value.value, digits)}{spread}"

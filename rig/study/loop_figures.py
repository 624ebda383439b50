"""Figures of the recordings themselves and of the best fit over them: the papers' loops over speed and extension."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from rig.dampers import model as damper_model
from rig.dampers import parameter_set
from rig.document.figure import Axis, Figure, Panels, Trace
from rig.document.style import FITTED, RESIDUAL, category_colour, current_colour
from rig.identification.models.measurement import Measurement, first_cycle, set_of
from rig.identification.models.model_slope import modelled_force
from rig.signals.waveform import TRIANGLE
from rig.study.recordings import TABLE1_AMPLITUDE_M
from rig.study.settings import TITLES, Lines, best_lines
from rig.study.study_file import Data, StudyFile

TRIANGLE_HZ = 1.0
TRIANGLE_A = (0.0, 0.5)
TRIANGLE_RATE_HZ = 1000.0
MOST_PANELS = 4
LOOPS_A = (0.2, 0.8)
"""Currents of paper 2's Figure 12."""
WHOLE, HALF = 860, 430
"""Widths of a figure and of one of two panels, pixels."""
FORCE, VELOCITY, EXTENSION = Axis("Force", "N"), Axis("Velocity", "m/s"), Axis("Extension", "mm")


def motion_figure(study: StudyFile) -> Panels | None:
    """Figure 3: position and velocity of the triangle of Figure 4; None of recorded runs.

    Args:
        study: The study.
    """
    if study.data.simulate != "table1":
        return None
    phase, motion = _triangle()
    axes = (Axis("Position", "m"), VELOCITY)
    return Panels(tuple(
        Figure(Axis("Time", "s"), axis, [Trace(phase / TRIANGLE_HZ, values)], HALF, 240)
        for axis, values in zip(axes, motion[:2], strict=True)
    ))  # fmt: skip


def _triangle() -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Two periods: phase, and displacement (m), velocity (m/s), acceleration (m/s^2), (n,) each."""
    phase = np.arange(0.0, 2.0, TRIANGLE_HZ / TRIANGLE_RATE_HZ, dtype=np.float64)
    return phase, TRIANGLE.motion(phase, TABLE1_AMPLITUDE_M, TRIANGLE_HZ)


def triangle_figure(study: StudyFile) -> Panels | None:
    """Figure 4: the force over a triangle of displacement, of the simulated damper; None of recorded runs.

    Args:
        study: The study.
    """
    if study.data.simulate != "table1":
        return None
    values = parameter_set(study.data.truth)
    damper = damper_model(values.model, values.hysteresis)
    phase, motion = _triangle()
    made = []
    for current_A in TRIANGLE_A:
        force_N = damper.force(values.values, *motion, current_A, 1.0 / TRIANGLE_RATE_HZ)
        loop = Trace(motion[1][phase >= 1.0], force_N[phase >= 1.0])
        made.append(Figure(VELOCITY, FORCE, [loop], HALF, 280, f"I = {current_A:g} A"))
    return Panels(tuple(made))


def _slowest(tests: Sequence[Measurement]) -> tuple[float, list[Measurement]]:
    """The lowest frequency (Hz), and its tests by current."""
    motions = set_of(tests).motions
    lowest_Hz = motions.frequencies_Hz[0]
    slowest = [test for number, test in enumerate(tests) if motions.frequency_Hz(number) == lowest_Hz]
    return lowest_Hz, sorted(slowest, key=lambda one: one.nominal_current_A)


def recorded_figure(tests: Sequence[Measurement]) -> Panels:
    """Figure 5, paper 2's Figure 8: force over speed and extension at the lowest frequency, a line for each current.

    Args:
        tests: The recordings.
    """
    lowest_Hz, slowest = _slowest(tests)
    over_v, over_u = [], []
    for place, test in enumerate(slowest):
        cycle, colour = first_cycle(test), current_colour(place, len(slowest))
        name = f"{test.nominal_current_A:g} A"
        over_v.append(Trace(cycle.v_m_s, cycle.force_N, name=name, colour=colour))
        over_u.append(Trace(1e3 * cycle.u_m, cycle.force_N, name=name, colour=colour))
    return Panels((
        Figure(VELOCITY, FORCE, over_v, HALF, 300, legend=True), Figure(EXTENSION, FORCE, over_u, HALF, 300),
    ), title=f"Recordings at {lowest_Hz:g} Hz")  # fmt: skip


def fitted_figure(study: StudyFile, results: Lines, tests: Sequence[Measurement], over: str) -> Panels | None:
    """Figures 10 and 11: recorded and fitted force at the lowest frequency, the highest currents; None without a fit.

    Args:
        study: The study.
        results: Result lines by key.
        tests: The recordings.
        over: `velocity` or `extension`.
    """
    fit = _best_fit(study, results)
    if fit is None:
        return None
    lowest_Hz, slowest = _slowest(tests)
    damper = damper_model(study.comparison.models[0], study.comparison.hysteresis)
    made = []
    for test in slowest[-MOST_PANELS:]:
        cycle = first_cycle(test)
        x = cycle.v_m_s if over == "velocity" else 1e3 * cycle.u_m
        traces = [
            Trace(x, cycle.force_N, name=recorded(study.data), colour=RESIDUAL),
            Trace(x, modelled_force(damper, fit["parameters"], cycle), name=fit["title"], colour=FITTED),
        ]
        title = f"I = {test.nominal_current_A:g} A, {lowest_Hz:g} Hz"
        made.append(Figure(VELOCITY if over == "velocity" else EXTENSION, FORCE, traces, HALF, 250, title, legend=True))
    return Panels(tuple(made))


def reconstructed_figure(
    outcomes: Mapping[str, Mapping[float, Sequence[Mapping[str, Any]]]],
    tests: Mapping[float, Measurement],
    fitted: Callable[[str, Mapping[str, Any], Measurement], np.ndarray],
    label: str,
) -> Panels:
    """Paper 2's Figure 12: each method's best force over speed, at the currents nearest to 0.2 and 0.8 A.

    Args:
        outcomes: Method -> current (A) -> result lines.
        tests: Current (A) -> its recording.
        fitted: Force (n,), N, of a method's result line on a recording.
        label: Of the recordings, from `recorded`.
    """
    currents = [min(tests, key=lambda current_A: abs(current_A - nearest_A)) for nearest_A in LOOPS_A]
    made = []
    for current_A in dict.fromkeys(currents):
        cycle = first_cycle(tests[current_A])
        traces = [Trace(cycle.v_m_s, cycle.force_N, name=label, colour=RESIDUAL)]
        for place, (method, by_current) in enumerate(outcomes.items()):
            if lines := by_current.get(current_A):
                best = min(lines, key=lambda line: float(line["value"]))
                force_N = fitted(method, best, cycle)
                traces.append(Trace(cycle.v_m_s, force_N, name=TITLES[method], colour=category_colour(place)))
        made.append(Figure(VELOCITY, FORCE, traces, HALF, 300, f"I = {current_A:g} A", legend=True))
    return Panels(tuple(made))


def recorded(data: Data) -> str:
    """What the recordings are called in a figure: nothing synthetic is called measured.

    Args:
        data: Where they come from.
    """
    return "measured" if data.simulate is None else "synthetic, with noise"


def _best_fit(study: StudyFile, results: Lines) -> dict[str, Any] | None:
    """Parameters of c-FOA's best search, of any method's where c-FOA took no part."""
    lines = best_lines(study, results)
    if not lines:
        return None
    best = lines.get("c_foa") or min(lines.values(), key=_value)
    return {"title": TITLES[best["method"]], "parameters": best["parameters"]}


def _value(line: Mapping[str, Any]) -> float:
    return float(line["value"])

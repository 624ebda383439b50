"""Figures of the recordings themselves and of the best fit over them: the papers' loops over speed and extension."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.dampers import model as damper_model
from rig.dampers import parameter_set
from rig.identification.models.measurement import Measurement, first_cycle, set_of
from rig.identification.models.model_slope import modelled_force
from rig.signals.waveform import TRIANGLE
from rig.study.recordings import TABLE1_AMPLITUDE_M
from rig.study.settings import TITLES, Lines, best_lines
from rig.study.study_file import Data, StudyFile

if TYPE_CHECKING:
    from collections.abc import Callable

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TRIANGLE_HZ = 1.0
TRIANGLE_A = (0.0, 0.5)
TRIANGLE_RATE_HZ = 1000.0
MOST_PANELS = 4
LOOPS_A = (0.2, 0.8)
"""Currents of paper 2's Figure 12."""


def motion_figure(study: StudyFile, new: Callable[[float], Figure]) -> Figure | None:
    """Figure 3: position and velocity of the triangle of Figure 4; None of recorded runs.

    Args:
        study: The study.
        new: Makes an empty figure of a height (inch).
    """
    if study.data.simulate != "table1":
        return None
    phase, motion = _triangle()
    figure = new(2.6)
    for axes, values, label in zip(
        figure.subplots(1, 2), motion[:2], ("position / m", "velocity / (m/s)"), strict=True
    ):
        axes.plot(phase / TRIANGLE_HZ, values, linewidth=1)
        _labelled(axes, "time / s", "")
        axes.set_ylabel(label, fontsize=8)
    return figure


def _triangle() -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Two periods: phase, and displacement (m), velocity (m/s), acceleration (m/s^2), (n,) each."""
    phase = np.arange(0.0, 2.0, TRIANGLE_HZ / TRIANGLE_RATE_HZ, dtype=np.float64)
    return phase, TRIANGLE.motion(phase, TABLE1_AMPLITUDE_M, TRIANGLE_HZ)


def triangle_figure(study: StudyFile, new: Callable[[float], Figure]) -> Figure | None:
    """Figure 4: the force over a triangle of displacement, of the simulated damper; None of recorded runs.

    Args:
        study: The study.
        new: Makes an empty figure of a height (inch).
    """
    if study.data.simulate != "table1":
        return None
    values = parameter_set(study.data.truth)
    damper = damper_model(values.model, values.hysteresis)
    phase, motion = _triangle()
    figure = new(3.2)
    for axes, current_A in zip(figure.subplots(1, 2, sharey=True), TRIANGLE_A, strict=True):
        force_N = damper.force(values.values, *motion, current_A, 1.0 / TRIANGLE_RATE_HZ)
        axes.plot(motion[1][phase >= 1.0], force_N[phase >= 1.0], linewidth=1)
        _labelled(axes, "velocity / (m/s)", f"I = {current_A:g} A")
    return figure


def _slowest(tests: Sequence[Measurement]) -> tuple[float, list[Measurement]]:
    """The lowest frequency (Hz), and its tests by current."""
    motions = set_of(tests).motions
    lowest_Hz = motions.frequencies_Hz[0]
    slowest = [test for number, test in enumerate(tests) if motions.frequency_Hz(number) == lowest_Hz]
    return lowest_Hz, sorted(slowest, key=lambda one: one.nominal_current_A)


def recorded_figure(tests: Sequence[Measurement], new: Callable[[float], Figure]) -> Figure:
    """Figure 5, and paper 2's Figure 8: force over speed and extension at the lowest frequency, one loop a current.

    Args:
        tests: The recordings.
        new: Makes an empty figure of a height (inch).
    """
    lowest_Hz, slowest = _slowest(tests)
    figure = new(3.4)
    axes = figure.subplots(1, 2, sharey=True)
    for test in slowest:
        cycle = first_cycle(test)
        axes[0].plot(cycle.v_m_s, cycle.force_N, linewidth=0.8, label=f"{test.nominal_current_A:g} A")
        axes[1].plot(1e3 * cycle.u_m, cycle.force_N, linewidth=0.8)
    _labelled(axes[0], "velocity / (m/s)", f"{lowest_Hz:g} Hz")
    _labelled(axes[1], "extension / mm", "")
    axes[0].legend(fontsize=7)
    return figure


def fitted_figure(
    study: StudyFile, results: Lines, tests: Sequence[Measurement], over: str, new: Callable[[float], Figure]
) -> Figure | None:
    """Figures 10 and 11: recorded and fitted force at the lowest frequency, the highest currents; None without a fit.

    Args:
        study: The study.
        results: Result lines by key.
        tests: The recordings.
        over: `velocity` or `extension`.
        new: Makes an empty figure of a height (inch).
    """
    fit = _best_fit(study, results)
    if fit is None:
        return None
    lowest_Hz, slowest = _slowest(tests)
    shown = slowest[-MOST_PANELS:]
    damper = damper_model(study.comparison.models[0], study.comparison.hysteresis)
    figure = new(2.8 * -(-len(shown) // 2))
    for axes, test in zip(figure.subplots(-(-len(shown) // 2), 2, squeeze=False).flat, shown, strict=False):
        cycle = first_cycle(test)
        x = cycle.v_m_s if over == "velocity" else 1e3 * cycle.u_m
        axes.plot(x, cycle.force_N, linewidth=0.8, color="0.4", label=recorded(study.data))
        axes.plot(x, modelled_force(damper, fit["parameters"], cycle), linewidth=1.0, color="C3", label=fit["title"])
        label = "velocity / (m/s)" if over == "velocity" else "extension / mm"
        _labelled(axes, label, f"I = {test.nominal_current_A:g} A, {lowest_Hz:g} Hz")
    figure.axes[0].legend(fontsize=7)
    return figure


def reconstructed_figure(
    outcomes: Mapping[str, Mapping[float, Sequence[Mapping[str, Any]]]],
    tests: Mapping[float, Measurement],
    fitted: Callable[[str, Mapping[str, Any], Measurement], np.ndarray],
    label: str,
    new: Callable[[float], Figure],
) -> Figure:
    """Paper 2's Figure 12: each method's best force over speed, at the currents nearest to 0.2 and 0.8 A.

    Args:
        outcomes: Method -> current (A) -> result lines.
        tests: Current (A) -> its recording.
        fitted: Force (n,), N, of a method's result line on a recording.
        label: Of the recordings, from `recorded`.
        new: Makes an empty figure of a height (inch).
    """
    currents = [min(tests, key=lambda current_A: abs(current_A - wanted_A)) for wanted_A in LOOPS_A]
    figure = new(3.6)
    panels = list(dict.fromkeys(currents))
    for axes, current_A in zip(figure.subplots(1, len(panels), squeeze=False).flat, panels, strict=True):
        cycle = first_cycle(tests[current_A])
        axes.plot(cycle.v_m_s, cycle.force_N, color="0.6", linewidth=2.0, label=label)
        for method, by_current in outcomes.items():
            lines = by_current.get(current_A)
            if lines:
                best = min(lines, key=lambda line: float(line["value"]))
                axes.plot(cycle.v_m_s, fitted(method, best, cycle), linewidth=0.8, label=TITLES[method])
        _labelled(axes, "velocity / (m/s)", f"I = {current_A:g} A")
        axes.legend(fontsize=7)
    return figure


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


def _labelled(axes: Axes, over: str, title: str) -> None:
    axes.set_xlabel(over, fontsize=8)
    axes.set_ylabel("force / N", fontsize=8)
    axes.set_title(title, fontsize=9)
    axes.tick_params(labelsize=7)
    axes.grid(visible=True, alpha=0.3)

"""The report's section on iterated commands of signals: errors of the trials, response of the machine, command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rig.display import Display
from rig.document.blocks import Blocks, Card, Cards, Column, Figures, Keys, section, table
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.numbers import NOTHING, number
from rig.document.style import MEASURED, OVERLAID, RESIDUAL
from rig.document.words import Key, Strong, Words, verdict
from rig.recording.recorded_point import RecordedPoint
from rig.report.signals import followed_force, middle_of, of_force, rod_at, times
from rig.report.views import PointView
from rig.signals.arrays import FloatArray

NOTE = (
    "The command of each signal was iterated: the response of the machine from command to displacement was identified "
    "with band-limited noise and inverted at the frequencies with sufficient coherence. The command of trial 0 "
    "is the target itself or a stored command. Trials are not recorded as points; their commands are in drives/ of "
    "the campaign's folder. Errors: RMS deviation of the rod from the target after removal of the delay, relative to "
    "the RMS of the target about its mean."
)
FORCE_NOTE = (
    "A force target is compared with the measured force after removal of the means. The expected damper "
    "converts forces to motions: the response is identified from the motion that gives the measured force, and the "
    "first command is the motion that gives the target."
)
HEAD = (
    Column("Point"), Column("Signal"), Column("Errors of the trials", "%"), Column("Recorded", "%", True),
    Column("Tolerance", "%", True), Column("Corrected from", "Hz", True), Column("to", "Hz", True),
    Column("Machine's delay", "ms", True), Column("Delay left", "ms", True), Column("Outcome"), Column("Verdict"),
)  # fmt: skip
SIZE = (400, 220)
"""Of each figure (pixels)."""
OUTCOMES = {
    "converged": "converged", "limit": "limit reached", "not-coherent": "not coherent", "noise-floor": "noise floor",
    "divergence": "divergence", "iterations": "too few iterations",
}


def iteration_section(views: Sequence[PointView]) -> Blocks:
    """Table and plots of the run's iterated signals; empty without any."""
    shown = [(view, iteration) for view in views if (iteration := view.point.commanded.iterated) is not None]
    if not shown:
        return []
    note = f"{NOTE} {FORCE_NOTE}" if any(of_force(view.point) for view, _ in shown) else NOTE
    parts: Blocks = [*section("Drive iteration", note), table(HEAD, [_row(view, of) for view, of in shown])]
    keys = (Key("measured", MEASURED), Key("target", OVERLAID), Key("command", RESIDUAL))
    cards = tuple(Card((Strong(view.point.id), f" {view.point.motion}"), (Figures(_figures(view, of), across=2),))
                  for view, of in shown)
    return [*parts, Keys(keys), Cards(cards, large=True)]


def _row(view: PointView, of: Mapping[str, Any]) -> tuple[Words, ...]:
    point, quality, band_Hz = view.point, view.point.quality.signal, of.get("band_Hz") or (None, None)
    nrms, delay_s = (None, None) if quality is None else (quality.nrms, quality.delay_s)
    values = (
        times(nrms, 100.0), times(point.commanded.tracking_tolerance, 100.0), *band_Hz,
        times(of.get("delay_s"), 1e3), times(delay_s, 1e3),
    )
    errors = ", ".join(number(100.0 * error, 3) for error in of.get("errors", ()))
    outcome = str(of.get("outcome", ""))
    return (
        point.id, point.motion, errors or NOTHING, *(number(value, 3) for value in values),
        OUTCOMES.get(outcome, outcome) or NOTHING, verdict(point.verdict),
    )


def _figures(view: PointView, of: Mapping[str, Any]) -> tuple[Figure, ...]:
    point = view.point
    errors = 100.0 * _array(of, "errors")
    figures = []
    if len(errors):
        trials = np.arange(len(errors), dtype=np.float64)
        ends = (-0.3, max(1.0, trials[-1]) + 0.3)
        tolerance = np.full(2, 100.0 * (point.commanded.tracking_tolerance or 0.0))
        figures.append(Figure(
            Axis("Trial", limits=ends), Axis("RMS error", "%", log=True),
            [Trace(np.array(ends), tolerance, Style.THIN, "tolerance"),
             Trace(trials, errors, Style.THIN, "error"), Trace(trials, errors, Style.POINTS, "error")],
            *SIZE, title=f"{point.id}: RMS error of each trial",
        ))
    frequency_Hz = _array(of, "frequency_Hz")
    if len(frequency_Hz) > 1:
        figures += _response_figures(point, of, frequency_Hz)
    command = _command_figure(point, view.display)
    return (*figures, *([] if command is None else [command]))


def _response_figures(point: RecordedPoint, of: Mapping[str, Any], frequency_Hz: FloatArray) -> list[Figure]:
    axis, limit = Axis("Frequency", "Hz"), np.full(2, float(of.get("least_coherence", 0.0)))
    gain = Trace(frequency_Hz, _array(of, "gain"), name="gain")
    coherence = [
        Trace(frequency_Hz[[0, -1]], limit, Style.THIN, "minimum coherence"),
        Trace(frequency_Hz, _array(of, "coherence"), name="coherence"),
    ]
    return [
        Figure(
            axis, Axis("Gain"), [gain], *SIZE,
            title=f"{point.id}: gain from command to {'equivalent motion' if of_force(point) else 'rod'}",
        ),
        Figure(axis, Axis("Coherence", limits=(0.0, 1.05)), coherence, *SIZE, title=f"{point.id}: coherence"),
    ]


def _array(of: Mapping[str, Any], name: str) -> FloatArray:
    return np.asarray(of.get(name, ()), np.float64)


def _command_figure(point: RecordedPoint, display: Display) -> Figure | None:
    """Command, target and rod, or target and force, over a short time; None where they were not recorded."""
    if of_force(point):
        return _force_figure(point, display)
    quality = point.quality.signal
    sent, target, command = (point.raw(name) for name in ("signal_time", "signal_target", "signal_command"))
    if quality is None or quality.start_s is None or sent is None or target is None or command is None:
        return None
    elapsed_s = np.asarray(sent["value"], np.float64)
    near, shown = middle_of(elapsed_s), display.displacement
    rod_m = rod_at(point, quality.start_s + elapsed_s[near])
    if not len(elapsed_s) == len(target["value"]) == len(command["value"]) or rod_m is None:
        return None
    lines = (
        ("command", np.asarray(command["value"], np.float64)[near], RESIDUAL),
        ("target", np.asarray(target["value"], np.float64)[near], OVERLAID), ("rod", rod_m, MEASURED),
    )
    traces = [Trace(elapsed_s[near], shown.signed(values), name=name, colour=colour) for name, values, colour in lines]
    title = f"{point.id}: command, target and rod"
    return Figure(Axis("Time", "s"), Axis(shown.title("Rod"), shown.unit), traces, *SIZE, title=title)


def _force_figure(point: RecordedPoint, display: Display) -> Figure | None:
    """Target and measured force over a short time, without delay and means; None where they were not recorded."""
    followed = followed_force(point)
    if followed is None:
        return None
    elapsed_s, target_N, force_N = followed
    near, shown = middle_of(elapsed_s), display.force
    lines = (("target", target_N, OVERLAID), ("force", force_N, MEASURED))
    traces = [
        Trace(elapsed_s[near], shown.signed(values[near]), name=name, colour=colour) for name, values, colour in lines
    ]
    return Figure(
        Axis("Time", "s"), Axis(shown.title("Force"), shown.unit), traces, *SIZE, title=f"{point.id}: target and force"
    )

"""The report's section on signals: motions without cycles, compared with their set-points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rig.display import Display, Shown
from rig.document.blocks import Blocks, Card, Cards, Column, Figures, Keys, section, table
from rig.document.figure import Axis, Figure, Trace, thinned
from rig.document.numbers import number
from rig.document.style import MEASURED, OVERLAID, RESIDUAL
from rig.document.words import Key, Strong, Words, verdict
from rig.recording.quality.tracking import SignalQuality
from rig.recording.recorded_point import RecordedPoint
from rig.report.views import PointView
from rig.signals.arrays import BoolArray, FloatArray
from rig.test_point import SIGNAL


def _head(display: Display) -> tuple[Column, ...]:
    return (
        Column("Point"), Column("Signal"), Column("Largest displacement", display.displacement.unit, True),
        Column("Duration", "s", True), Column("Evaluated", "s", True), Column("Highest frequency", "Hz", True),
        Column("I", "A", True), Column("Tracking error", "%", True), Column("Delay", "ms", True),
        Column("Span achieved", "%", True), Column("Fit error", "%", True), Column("Verdict"),
    )  # fmt: skip


NOTE = (
    "Each signal was streamed as individual set-points. The section between the ramps is evaluated and fitted. "
    "Tracking error: RMS deviation of the rod from its target after removal of the delay, relative to the RMS of the "
    "target about its mean. The fitted model is simulated freely from the beginning of the motion."
)
FORCE_NOTE = (
    "For a force target, the tracking error, delay and span are those of the force, without the difference between "
    "the means."
)
SHOWN_S = 2.0
"""Of rod and target, about the middle: a longer time is not legible."""
MOST_DRAWN = 1500


def signals_section(views: Sequence[PointView]) -> Blocks:
    """Table and plots of the run's signals; empty without any."""
    shown = [view for view in views if view.point.kind == SIGNAL]
    if not shown:
        return []
    forces = any(of_force(view.point) for view in shown)
    note = f"{NOTE} {FORCE_NOTE}" if forces else NOTE
    parts: Blocks = [*section("Signals", note), table(_head(shown[0].display), [_row(view) for view in shown])]
    drawn = tuple(made for view in shown if (made := _plots(view.point, view.display)) is not None)
    if drawn:
        measured = "rod or force" if forces else "rod"
        keys = (Key(measured, MEASURED), Key("target", OVERLAID), Key(f"{measured} minus target", RESIDUAL))
        parts += [Keys(keys), Cards(drawn)]
    return parts


def _row(view: PointView) -> tuple[Words, ...]:
    point, quality = view.point, view.point.quality.signal or SignalQuality()
    record_s, highest_Hz = (None, None) if point.record is None else (point.record.duration_s, point.record.highest_Hz)
    evaluated_s = (
        None if quality.judged_start_s is None or quality.judged_end_s is None
        else quality.judged_end_s - quality.judged_start_s
    )
    values = (
        view.display.displacement.value(point.amplitude_m), record_s, evaluated_s, highest_Hz or None,
        point.current_A, times(quality.nrms, 100.0), times(quality.delay_s, 1e3), times(quality.reached, 100.0),
        view.error_percent,
    )
    return (
        point.id, point.motion, *(number(value, 4) for value in values), verdict(point.verdict),
    )


def times(value: float | None, factor: float) -> float | None:
    """A number in another unit; None where there is none."""
    return None if value is None else factor * value


def of_force(point: RecordedPoint) -> bool:
    """Whether a force was to be followed."""
    return point.record is not None and point.record.of_force


def middle_of(elapsed_s: FloatArray) -> BoolArray:
    """Which samples of a signal (n,) are shown: `SHOWN_S` about its middle."""
    return np.asarray(np.abs(elapsed_s - 0.5 * elapsed_s[-1]) <= 0.5 * SHOWN_S)


def rod_at(point: RecordedPoint, at_s: FloatArray) -> FloatArray | None:
    """Displacement of the rod from the centre of its motion at some times (k,), m; None where it was not recorded."""
    known = np.isfinite(point.displacement_m)
    if np.count_nonzero(known) < 2:
        return None
    return np.interp(at_s, point.time_s[known], point.displacement_m[known] - point.centre_m)


def _plots(point: RecordedPoint, display: Display) -> Card | None:
    """Rod and target over a short time, and their distance over all of it; None where they were not recorded."""
    if of_force(point):
        followed = followed_force(point)
        return None if followed is None else _card(point, *followed, display.force, "force")
    quality, sent, target = point.quality.signal, point.raw("signal_time"), point.raw("signal_target")
    if quality is None or quality.start_s is None or sent is None or target is None:
        return None
    elapsed_s, target_m = np.asarray(sent["value"], np.float64), np.asarray(target["value"], np.float64)
    rod_m = rod_at(point, quality.start_s + (quality.delay_s or 0.0) + elapsed_s)
    if len(elapsed_s) != len(target_m) or rod_m is None:
        return None
    return _card(point, elapsed_s, target_m, rod_m, display.displacement, "rod")


def followed_force(point: RecordedPoint) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Time since the begin (s), target and measured force (N) of a force target, each (k,), delay and means removed.

    None where they were not recorded.
    """
    quality, sent, target = point.quality.signal, point.raw("signal_time"), point.raw("signal_force")
    if quality is None or quality.start_s is None or sent is None or target is None:
        return None
    elapsed_s, target_N = np.asarray(sent["value"], np.float64), np.asarray(target["value"], np.float64)
    known = np.isfinite(point.force_N)
    if len(elapsed_s) != len(target_N) or np.count_nonzero(known) < 2:
        return None
    at_s = quality.start_s + (quality.delay_s or 0.0) + elapsed_s
    return elapsed_s, target_N, np.interp(at_s, point.time_s[known], point.force_N[known]) - (quality.mean_N or 0.0)


def _card(
    point: RecordedPoint, elapsed_s: FloatArray, target: FloatArray, measured: FloatArray, shown: Shown, name: str
) -> Card:
    """A measured signal and its target over a short time, and their distance over all of it."""
    near, rows = middle_of(elapsed_s), thinned(len(elapsed_s), MOST_DRAWN)
    time = Axis("Time", "s")
    follow = Figure(
        time, Axis(shown.title(name.capitalize()), shown.unit),
        [Trace(elapsed_s[near], shown.signed(target[near]), name="target", colour=OVERLAID),
         Trace(elapsed_s[near], shown.signed(measured[near]), name=name, colour=MEASURED)],
        480, 220, title=f"{point.id}: {name} and target",
    )
    left = Trace(
        elapsed_s[rows], shown.signed((measured - target)[rows]), name=f"{name} minus target", colour=RESIDUAL
    )
    apart = Figure(time, Axis("Deviation", shown.unit), [left], 480, 160, title=f"{point.id}: {name} minus target")
    return Card((Strong(point.id), f" {point.motion}"), (Figures((follow, apart)),))

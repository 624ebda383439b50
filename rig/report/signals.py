"""The report's part on signals: motions without cycles, each beside the set-points that asked for it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rig.recording.layout import SIGNAL
from rig.recording.quality.tracking import SignalQuality
from rig.recording.recorded_point import RecordedPoint
from rig.report.chart import Chart, Trace, thinned
from rig.report.fragment import NOTHING, card, charts, chip, heading, key, key_line, number, table, text
from rig.report.loops import PointView, named
from rig.report.style import MEASURED, OVERLAID, RESIDUAL
from rig.signals.arrays import FloatArray

HEAD = (
    "Point", "Signal", "Largest mm", "Duration s", "Judged s", "Up to Hz", "I A", "Tracking %", "Delay ms",
    "Span reached %", "Fit's error %", "Verdict",
)
NOTE = (
    "Each was streamed set-point by set-point. Judged and fitted is what lies between the ramps. Tracking: distance of "
    "the rod from its target, RMS, as a share of the target's about its mean, the delay taken off. The fitted model "
    "runs freely from the motion's beginning."
)
SHOWN_S = 2.0
"""Of rod and target, about the middle: more is not legible."""
MOST_DRAWN = 1500


def signals_part(views: Sequence[PointView]) -> str:
    """Table and plots of the run's signals; empty without any."""
    shown = [view for view in views if view.point.kind == SIGNAL]
    if not shown:
        return ""
    parts = [heading("Signals", NOTE), table(HEAD, [("", _row(view)) for view in shown], range(2, 11))]
    drawn = [made for view in shown if (made := _plots(view.point)) is not None]
    if drawn:
        keys = key("rod", MEASURED) + key("target", OVERLAID) + key("rod minus target", RESIDUAL)
        parts += [key_line("", keys), charts(drawn)]
    return "".join(parts)


def _row(view: PointView) -> tuple[str, ...]:
    point, quality = view.point, view.point.quality.signal or SignalQuality()
    judged_s = (
        None if quality.judged_start_s is None or quality.judged_end_s is None
        else quality.judged_end_s - quality.judged_start_s
    )
    values = (
        1e3 * point.amplitude_m, point.test.get("record_s"), judged_s, point.test.get("record_highest_Hz"),
        point.current_A, _times(quality.nrms, 100.0), _times(quality.delay_s, 1e3), _times(quality.reached, 100.0),
        view.error.get("nrmse_percent_of_peak"),
    )
    return (
        text(point.id), text(named(point)), *(NOTHING if value is None else number(value, 4) for value in values),
        chip(point.verdict, point.verdict),
    )


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else factor * value


def _plots(point: RecordedPoint) -> str | None:
    """Rod and target over a short time, and their distance over all of it; None where they were not recorded."""
    quality, sent, target = point.quality.signal, point.raw("signal_time"), point.raw("signal_target")
    if quality is None or quality.start_s is None or sent is None or target is None:
        return None
    elapsed_s, target_m = np.asarray(sent["value"], np.float64), np.asarray(target["value"], np.float64)
    delay_s, centre_m = quality.delay_s or 0.0, float(point.test.get("centre_m", 0.0))
    known = np.isfinite(point.displacement_m)
    if len(elapsed_s) != len(target_m) or np.count_nonzero(known) < 2:
        return None
    rod_m = np.interp(
        quality.start_s + delay_s + elapsed_s, point.time_s[known], point.displacement_m[known] - centre_m
    )
    near = np.abs(elapsed_s - 0.5 * elapsed_s[-1]) <= 0.5 * SHOWN_S
    rows = thinned(len(elapsed_s), MOST_DRAWN)
    follow = Chart(
        "Time s", "Extension mm",
        [_trace(elapsed_s[near], target_m[near], "target", OVERLAID),
         _trace(elapsed_s[near], rod_m[near], "rod", MEASURED)],
        480, 220, title=f"{point.id}: rod and target",
    )
    left = _trace(elapsed_s[rows], (rod_m - target_m)[rows], "rod minus target", RESIDUAL)
    apart = Chart(
        "Time s", "Off mm", [left],
        480, 160, title=f"{point.id}: rod minus target",
    )
    return card(f"<b>{text(point.id)}</b><span>{text(named(point))}</span>", follow.svg(), apart.svg())


def _trace(time_s: FloatArray, values_m: FloatArray, name: str, colour: str) -> Trace:
    return Trace(time_s, 1e3 * values_m, "m", name, colour)

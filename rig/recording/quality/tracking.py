"""A signal in its recording: its start, the evaluated part, and the tracking of the rod.

Every set-point was recorded with its time since the motion started, which locates the motion in the recording; the
ramps at its ends are excluded. The rod lags its set-points by the servo's delay, which does not affect a fit: the
error is taken at the delay that minimises it, and both are reported.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.recording.quality.verdict import Kind, Reason, Section, invalid, stored
from rig.signals.arrays import FloatArray
from rig.signals.following import following
from rig.signals.force_motion import equivalent_motion
from rig.signals.record import STEP_S, Record, RecordFacts
from rig.test_point import TestPoint

if TYPE_CHECKING:
    from rig.recording.alignment.alignment import Alignment, Overview

LARGEST_GAP_S = 0.05
"""Without a sample of the sensor, in a run from which the next command is to be calculated."""
TRACKING_SUSPECT, TRACKING_INVALID = 0.10, 0.25
"""Distance from the target, RMS, as a share of the target's about its mean: standing far out is not following."""
INCOMPLETE_SHARE = 0.005
"""Of a signal's duration, which may be missing at its end: the last set-point lies a poll before it."""


@dataclass(frozen=True)
class Window:
    """Where a signal lies in a recording, s on the file's time base.

    Attributes:
        begin_s, end_s: of the motion.
        evaluated_s: beginning and end of what is judged: without the ramps.
    """

    begin_s: float
    end_s: float
    evaluated_s: tuple[float, float]

    def evaluates(self, time_s: FloatArray) -> NDArray[np.bool_]:
        """Which times (n,), s, lie in the evaluated part."""
        first_s, last_s = self.evaluated_s
        return np.asarray((time_s >= first_s) & (time_s <= last_s), np.bool_)


@dataclass(frozen=True)
class Tracking:
    """How a signal was followed between its ramps.

    Attributes:
        window: where it lies.
        played_s: of the signal, how much was sent (s).
        nrms: root mean square of the rod's distance from its target (of its mean too), delay taken off, as a share of
            the target's about the target's own mean.
        delay_s: of the rod behind its target (s).
        reached: the rod's span over the target's.
        mean_m: of the rod's distance from its target (m); None of a force target.
        mean_N: of the force less its target (N), which the other numbers leave out; None of a displacement target.
    """

    window: Window
    played_s: float
    nrms: float
    delay_s: float
    reached: float
    mean_m: float | None
    mean_N: float | None = None


@dataclass(frozen=True)
class SignalQuality(Section):
    """A signal as it was followed, as `rig.recording.quality.tracking` measures it between its ramps.

    `start_s`, `end_s` are of the whole motion on the file's time base, `judged_start_s`, `judged_end_s` without ramps.
    """

    start_s: float | None = stored("signal_start_s")
    end_s: float | None = stored("signal_end_s")
    judged_start_s: float | None = stored("signal_judged_start_s")
    judged_end_s: float | None = stored("signal_judged_end_s")
    played_s: float | None = stored("signal_played_s")
    nrms: float | None = stored("tracking_nrms")
    delay_s: float | None = stored("tracking_delay_s")
    reached: float | None = stored("tracking_reached")
    mean_m: float | None = stored("tracking_mean_m")
    mean_N: float | None = stored("tracking_mean_N")


def signal_quality(tracking: Tracking | None) -> SignalQuality | None:
    """How a signal was followed; None where there is none."""
    if tracking is None:
        return None
    window = tracking.window
    return SignalQuality(
        window.begin_s, window.end_s, *window.evaluated_s, tracking.played_s, tracking.nrms, tracking.delay_s,
        tracking.reached, tracking.mean_m, tracking.mean_N,
    )


def window_of(
    time_s: FloatArray, elapsed_s: FloatArray, query_s: float, ramp_s: float
) -> Window | None:
    """The window of a signal by its recorded set-points; None where there are none.

    Args:
        time_s: when each was sent, on the file's time base (k,), s.
        elapsed_s: which time of the signal it was for (k,), s.
        query_s: duration of the signal (s).
        ramp_s: of either ramp (s).
    """
    if len(time_s) < 2:
        return None
    begin_s = float(np.median(time_s - elapsed_s))
    end_s = begin_s + min(query_s, float(elapsed_s[-1]))
    return Window(begin_s, end_s, (begin_s + ramp_s, max(begin_s + ramp_s, min(end_s, begin_s + query_s - ramp_s))))


def played(record: RecordFacts, alignment: Alignment) -> tuple[FloatArray, Window] | None:
    """The times of a signal for which set-points were recorded (k,), s, and its window; None where there are none.

    Args:
        record: the motion that was commanded.
        alignment: the channels of its run.
    """
    sent = alignment.timed.get("signal_time")
    if sent is None:
        return None
    elapsed_s = np.asarray(sent.records[:]["value"], np.float64)
    window = window_of(np.asarray(sent.time_s) - alignment.origin_s, elapsed_s, record.duration_s, record.ramp_s)
    return None if window is None else (elapsed_s, window)


def tracking_of(point: TestPoint, alignment: Alignment, seen: Overview) -> Tracking | None:
    """How a signal was followed; None where too little of it was recorded to say.

    Args:
        point: the point.
        alignment: its channels.
        seen: displacement and force over time.
    """
    if point.record is None:
        return None
    of_force = point.record.of_force
    wanted = alignment.timed.get("signal_force" if of_force else "signal_target")
    signal = played(point.record, alignment)
    if signal is None or wanted is None:
        return None
    elapsed_s, window = signal
    target = np.asarray(wanted.records[:]["value"], np.float64)
    measured = seen.force_N if of_force else seen.displacement_m
    known = np.isfinite(measured)
    if len(target) != len(elapsed_s) or np.count_nonzero(known) < 2:
        return None
    at_s = window.begin_s + elapsed_s
    inside = window.evaluates(at_s)
    if np.count_nonzero(inside) < 2:
        return None
    played_s = min(point.record.duration_s, float(elapsed_s[-1]))
    offset = point.centre_m
    if of_force:
        evaluated = known & window.evaluates(seen.time_s)
        offset = float(np.mean(measured[evaluated])) - float(np.mean(target[inside])) if evaluated.any() else 0.0
    compared = following(seen.time_s[known], measured[known], at_s[inside], target[inside] + offset)
    mean_m, mean_N = (None, offset) if of_force else (compared.mean, None)
    return Tracking(window, played_s, compared.nrms, compared.delay_s, compared.reached, mean_m, mean_N)


class Run(NamedTuple):
    """What was measured in a run from which the next command is calculated.

    Attributes:
        motion_m: (n,) of the rod about its centre, every `STEP_S` from the begin; of a force target the motion with
            which the expected damper would give the force.
        force_N: (n,) of a force target; else None.
    """

    motion_m: FloatArray
    force_N: FloatArray | None = None


def run_of(commanded: RecordFacts, target: Record, centre_m: float, alignment: Alignment) -> Run | None:
    """What a run has measured; None where it is not known over the whole run.

    Args:
        commanded: the motion that was commanded.
        target: what is to be followed.
        centre_m: of the motion.
        alignment: the channels of the run.
    """
    if target.force is None:
        rod_m = _along(commanded, alignment, "displacement")
        return None if rod_m is None else Run(rod_m - centre_m)
    force_N = _along(commanded, alignment, "force")
    return None if force_N is None else Run(equivalent_motion(target.force, commanded, target, force_N), force_N)


def _along(record: RecordFacts, alignment: Alignment, name: str) -> FloatArray | None:
    """A channel every `STEP_S` from the begin of a signal, (n,); None where it is not known.

    Args:
        record: the motion that was commanded.
        alignment: the channels of its run.
        name: of the channel.
    """
    from scipy.interpolate import CubicSpline  # 0.2 s to load, and only iterated signals need it

    signal = played(record, alignment)
    time_s, values = np.asarray(alignment.time_s), np.asarray(alignment.values[name])
    known = np.isfinite(values)
    if signal is None or np.count_nonzero(known) < 2:
        return None
    elapsed_s, window = signal
    if elapsed_s[-1] < (1.0 - INCOMPLETE_SHARE) * record.duration_s:
        return None
    time_s, values = time_s[known], values[known]
    inside = (time_s >= window.begin_s) & (time_s <= window.end_s)
    if np.max(np.diff(time_s[inside]), initial=0.0) > LARGEST_GAP_S or np.count_nonzero(inside) < 2:
        return None
    query_s = window.begin_s + STEP_S * np.arange(round(record.duration_s / STEP_S) + 1)
    spline = CubicSpline(time_s, values)
    return np.asarray(spline(np.clip(query_s, time_s[0], time_s[-1])), np.float64)


def tracking_reasons(
    point: TestPoint, tracking: Tracking | None, *, stopped: bool, tolerance: float | None = None
) -> list[Reason]:
    """What speaks against a signal's recording: what replaces the count and the amplitude of cycles.

    Args:
        point: the point.
        tracking: how it was followed; None: too little was recorded.
        stopped: the point was stopped, and that is said already.
        tolerance: of an iterated signal; None: the usual limits.
    """
    if point.record is None or stopped:
        return []
    played_s = 0.0 if tracking is None else tracking.played_s
    if tracking is None or played_s < (1.0 - INCOMPLETE_SHARE) * point.record.duration_s:
        text = f"only {played_s:.4g} s of {point.record.duration_s:.4g} s were played and recorded"
        return [invalid("signal-incomplete", text)]
    allowed = TRACKING_SUSPECT if tolerance is None else tolerance
    if tracking.nrms <= allowed:
        return []
    limits = f"limit {100 * TRACKING_INVALID:g} %" if tolerance is None else f"tolerance {100 * tolerance:g} %"
    follower = "force" if point.record.of_force else "rod"
    text = (
        f"RMS tracking error of the {follower}: {100 * tracking.nrms:.3g} % of the target, after correction for a "
        f"delay of {1e3 * tracking.delay_s:.3g} ms ({limits}); the {follower} reached {100 * tracking.reached:.3g} % "
        "of the span"
    )
    kind = Kind.INVALID if tracking.nrms > TRACKING_INVALID else Kind.SUSPECT
    return [Reason("tracking", kind, text, {"nrms": tracking.nrms, "delay_s": tracking.delay_s})]

"""What a lag is wrong by where what is measured goes in steps with the controller's polls.

A rod that follows streamed set-points gets a new one at every poll: its force steps, and where the controller holds a
set-point until the next one comes, its place too. The controller's record shows one phase of these steps only; the
sensor's samples, smoothed over a step, show their mean. The part u that smoothing takes away is then no noise: at the
polls it goes with the slope s, and moves the lag by B = mean(u s) / mean(s^2). The sensor sees u at all phases of the
polls, so B is known from its own samples at each: u = s B(phase), by least squares, phase 0 at the polls.

With the lag wrong by e, the polls seem to be at the phase -e: e = B(-e), up to what is in doubt. Where several e
explain themselves, the stated error covers them.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rig.signals.arrays import FloatArray, TimeSeries
from rig.signals.delay_estimation.sample_match import Course, Match, match, smoothed

FEWEST_SAMPLES = 100
HARMONICS = 4
"""Of the polls, in B, at most: as many as the phases that the samples see can tell apart."""
FEWEST_HARMONICS = 2
DOUBT_SHARE = 0.4
"""What is locked to the polls is not all in proportion to the slope: so much of B's amplitude stays in doubt."""
SENSOR_SHARE = 1.25
"""The lag's own error knows nothing of the smoothed samples' noise."""
UNKNOWN_SHARE = 0.3
"""Of the time between polls: the standard deviation of where in it the sensor's samples lie, if they do not say."""
SPAN_SHARE = 0.75
"""Half the window under which steps are no part of the course any more, as a share of the time between polls."""
WIDE_SHARE = 0.5
"""The sharper of two ways is believed no further than to so much of the other's error, and of what lies between."""
BINS = 20
LEAST_SHARE = 0.1
"""Of the mean: phases of the polls with less of the motion are not seen."""
ERRORS = 801
PHASES = np.linspace(0.0, 1.0, 200, endpoint=False)


def stepped_match(
    reference: TimeSeries, sensor: TimeSeries, period_s: float, reach_s: float, cycle_s: float, *, with_drift: bool,
) -> Match | None:
    """A sensor's samples over the controller's record, one value each poll, where both go in steps with the polls.

    Args:
        reference: the controller's record (m,), any unit.
        sensor: the sensor's samples (n,), on the reference's clock as far as it is known.
        period_s: nominal sample period of the sensor, s.
        reach_s: the lag is searched within plus and minus this (s).
        cycle_s: period of the motion, s; infinite for none.
        with_drift: fit a drift of the sensor's clock too.

    Returns:
        None when the two cannot be laid over each other.
    """
    half = half_window(reference.time_s, period_s)
    course = Course(cycle_s, half)
    laid = match(reference, sensor, period_s, reach_s=reach_s, with_drift=with_drift, course=course)
    return None if laid is None else over_steps(laid, reference.time_s, sensor, half)


def half_window(reference_s: FloatArray, period_s: float) -> int:
    """Samples either side of one, `period_s` apart, that smoothing has to take in, for polls at these times (m,), s."""
    return math.ceil(SPAN_SHARE * _between(reference_s) / period_s)


def over_steps(laid: Match, reference_s: FloatArray, sensor: TimeSeries, least_half: int) -> Match:
    """The lag under streamed set-points without what their steps make of it, and what of that is in doubt.

    Args:
        laid: the sensor, smoothed over `least_half` samples either side at least, over the controller's record.
        reference_s: times of the polls (m,) on the controller's clock.
        sensor: the sensor's samples (n,) on its clock as it was when they were laid over each other.
        least_half: of `half_window`.
    """
    period_s, own_s = _between(reference_s), SENSOR_SHARE * laid.lag_std_s
    known = _by_phase(laid, reference_s, sensor, least_half)
    if known is None:
        return laid.widened(math.hypot(own_s, UNKNOWN_SHARE * period_s))
    effects_s, covariance = known
    harmonics = len(effects_s) // 2
    around = _waves(PHASES, harmonics)
    amplitude_s = float(np.max(np.abs(around @ effects_s)))
    spread_s = math.sqrt(float(np.max(np.einsum("ij,jk,ik->i", around, covariance, around))))
    if spread_s > UNKNOWN_SHARE * period_s:
        return laid.widened(math.hypot(own_s, UNKNOWN_SHARE * period_s))
    std_s = math.hypot(own_s, spread_s, DOUBT_SHARE * amplitude_s)
    reach_s = amplitude_s + 4.0 * std_s
    errors_s = np.linspace(-reach_s, reach_s, ERRORS)
    left_s = errors_s - _waves(-errors_s / period_s, harmonics) @ effects_s
    weights = np.exp(-0.5 * (left_s / std_s) ** 2)
    weights /= np.sum(weights)
    error_s = float(weights @ errors_s)
    between_s = math.sqrt(float(weights @ (errors_s - error_s) ** 2))
    return replace(laid, lag_s=laid.lag_s - error_s).widened(max(std_s, between_s))


def together(own: Match, wide: Match) -> Match:
    """What two ways of taking steps off a lag say of it, neither of which is right alone.

    Args:
        own: by one harmonic, the samples' usual smoothing and the cycles: sharper where steps are gentle.
        wide: of `over_steps`.
    """
    least_s = max(own.lag_std_s, WIDE_SHARE * wide.lag_std_s)
    weight, other = least_s**-2, wide.lag_std_s**-2
    lag_s = (weight * own.lag_s + other * wide.lag_s) / (weight + other)
    return replace(own, lag_s=lag_s).widened(max(least_s, WIDE_SHARE * abs(own.lag_s - wide.lag_s)))


def _between(reference_s: FloatArray) -> float:
    """The time between polls, s."""
    return float(np.median(np.diff(reference_s)))


def _waves(phases: FloatArray, harmonics: int) -> FloatArray:
    """Cosines and sines (n, 2 `harmonics`) at phases (n,) in turns."""
    turns = 2.0 * np.pi * np.outer(phases, np.arange(1, harmonics + 1))
    return np.column_stack([np.cos(turns), np.sin(turns)])


def _by_phase(
    laid: Match, reference_s: FloatArray, sensor: TimeSeries, least_half: int
) -> tuple[FloatArray, FloatArray] | None:
    """B as effects (p,) of `_waves`, s, and their covariance (p, p); None where the samples do not see all phases."""
    smooth = smoothed(sensor.values, least_half)
    if smooth is None or len(reference_s) < FEWEST_SAMPLES:
        return None
    slope, rest = np.gradient(smooth, sensor.time_s), sensor.values - smooth
    at_s = sensor.time_s - laid.lag_s - laid.drift * (sensor.time_s - laid.middle_s)
    poll = np.searchsorted(reference_s, at_s, side="right") - 1
    used = (poll >= 0) & (poll < len(reference_s) - 1) & np.isfinite(slope) & np.isfinite(rest)
    if np.count_nonzero(used) < FEWEST_SAMPLES:
        return None
    at_s, slope, rest, poll, course = at_s[used], slope[used], rest[used], poll[used], smooth[used]
    phase = (at_s - reference_s[poll]) / (reference_s[poll + 1] - reference_s[poll])
    seen = np.bincount((BINS * phase).astype(np.int64), slope**2, BINS)
    harmonics = min(HARMONICS, (int(np.count_nonzero(seen > LEAST_SHARE * np.mean(seen))) - 1) // 2)
    if harmonics < FEWEST_HARMONICS:
        return None
    waves, course = _waves(phase, harmonics), (course - np.mean(course)) / np.std(course)
    design = np.column_stack([slope[:, None] * waves, course[:, None] * waves, waves])
    effects, _, rank, _ = np.linalg.lstsq(design, rest, rcond=1e-9)
    if rank < design.shape[1]:
        return None
    variance = float(np.mean((rest - design @ effects) ** 2))
    lags = slice(0, 2 * harmonics)
    return effects[lags], variance * np.linalg.inv(design.T @ design)[lags, lags]

"""What a lag is wrong by where the force jumps in step with the controller's polls.

A rod that follows streamed set-points gets a new one at every poll, and its force a step. The controller's record shows
the force at one phase of these steps only; the sensor's smoothed samples show their mean. The part u of the force
that smoothing takes away is then no noise: at the polls it has the sign of the slope s, and moves the lag by
mean(u s) / mean(s^2). The sensor sees u at all phases of the polls, so it is known from its own samples:
u = s (a cos + b sin)(2 pi phase) by least squares, phase 0 at the polls.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from rig.signals.arrays import FloatArray, TimeSeries
from rig.signals.delay_estimation.sample_match import Match, smoothed

FEWEST_SAMPLES = 100
DOUBT_SHARE = 0.4
"""Steps are no sines: so much of the amplitude stays in doubt."""
UNKNOWN_SHARE = 0.125
"""Of the time between polls: what steps may do to the lag where their effect on it cannot be told."""
LARGEST_FEEDBACK = 1.25
"""The phase comes from the lag that is sought: beyond about 1 several lags explain themselves, and none is taken."""


def corrected(laid: Match, reference_s: FloatArray, sensor: TimeSeries) -> Match:
    """The lag of a force under streamed set-points without what their steps make of it, and what of that is in doubt.

    Args:
        laid: the sensor over the controller's record.
        reference_s: times of the polls (m,) on the controller's clock.
        sensor: the sensor's samples (n,) on its clock as it was when they were laid over each other.
    """
    period_s = float(np.median(np.diff(reference_s)))
    turn, unknown_s = 2.0 * np.pi / period_s, UNKNOWN_SHARE * period_s
    cosine_s, sine_s, spread_s = _steps(laid, reference_s, sensor)
    amplitude_s = float(np.hypot(cosine_s, sine_s))
    if spread_s > unknown_s:
        return laid.widened(float(np.hypot(laid.lag_std_s, unknown_s)))
    if amplitude_s * turn > LARGEST_FEEDBACK:
        return laid.widened(float(np.hypot(laid.lag_std_s, max(amplitude_s, unknown_s))))
    # With the wrong lag the polls seem to be at the phase -bias: the bias that explains itself.
    biases_s = np.linspace(-amplitude_s, amplitude_s, 401)
    phases = -turn * biases_s
    left_s = np.abs(biases_s - cosine_s * np.cos(phases) - sine_s * np.sin(phases))
    moved = replace(laid, lag_s=laid.lag_s - float(biases_s[np.argmin(left_s)]))
    return moved.widened(math.hypot(laid.lag_std_s, DOUBT_SHARE * amplitude_s, spread_s))


def _steps(laid: Match, reference_s: FloatArray, sensor: TimeSeries) -> tuple[float, float, float]:
    """How wrong the lag is at the phases 0 and a quarter of the polls, and how sure that is (s; infinite: unknown)."""
    unknown = 0.0, 0.0, math.inf
    smooth = smoothed(sensor.values)
    if smooth is None or len(sensor.time_s) < FEWEST_SAMPLES or len(reference_s) < FEWEST_SAMPLES:
        return unknown
    slope, rest = np.gradient(smooth, sensor.time_s), sensor.values - smooth
    at_s = sensor.time_s - laid.lag_s - laid.drift * (sensor.time_s - laid.middle_s)
    poll = np.searchsorted(reference_s, at_s, side="right") - 1
    used = (poll >= 0) & (poll < len(reference_s) - 1) & np.isfinite(slope) & np.isfinite(rest)
    # A parabola through three samples takes nothing away, and shows nothing.
    if np.count_nonzero(used) < FEWEST_SAMPLES or np.max(np.abs(rest[used])) < 1e-9 * np.ptp(smooth[used]):
        return unknown
    at_s, slope, rest, poll = at_s[used], slope[used], rest[used], poll[used]
    phase = 2.0 * np.pi * (at_s - reference_s[poll]) / (reference_s[poll + 1] - reference_s[poll])
    design = slope[:, None] * np.column_stack([np.cos(phase), np.sin(phase)])
    effects, _, rank, _ = np.linalg.lstsq(design, rest, rcond=1e-6)
    if rank < design.shape[1]:
        return unknown
    variances = float(np.mean((rest - design @ effects) ** 2)) * np.diag(np.linalg.inv(design.T @ design))
    return float(effects[0]), float(effects[1]), float(np.sqrt(np.max(variances)))

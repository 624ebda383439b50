"""The time shift between two records of one signal: a sensor's own samples against the controller's coarse input.

The controller reports position and force with its status, on its own clock. A sensor that measures the same quantity
is laid over them: `reference(t) = offset + gain x(t + lag + drift (t - mean t))`, by least squares on the four
(Gauss-Newton after a coarse search). It works at any rate of the device clocks, without edges, and it is the only way
to see a delay that a sensor's conditioner does not declare.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from rig.signals.arrays import BoolArray, FloatArray, TimeSeries
from rig.signals.interpolation import cubic_at, linear_at

FEWEST_SAMPLES = 12
MOST_REFERENCES = 6000
PHASE_BINS = 50
COARSE_STEP_S = 2e-3
MOST_COARSE_STEPS = 400
ROUNDS = 12
CONVERGED_S = 1e-8
OUTLIER_DEVIATIONS = 5.0
JUMP_DEVIATIONS = 4.0
UNRESOLVED_DEVIATIONS = 0.5
"""Where cubic and straight line through the samples differ by more than this share of the noise, neither is trusted."""
SMALLEST_CORRELATION = 0.9
HALF_WIDTHS = (1, 2, 3, 5, 8, 12, 20, 32, 50)
SMALL_SAMPLE = 20.0
"""The noise is estimated from the same few samples: their variance is widened by (1 + this / count)."""
SLOPE_NOISE = 0.1
"""Noise may make up this share of the smoothed signal's slope; more would pull the lag towards where it began."""


@dataclass(frozen=True)
class Match:
    """How one signal lies over the other.

    Attributes:
        lag_s: by how much the sensor lags the reference at mid-record (s); `lag_std_s` its standard deviation.
        drift: change of the lag per second (1), 0 when not fitted; `drift_std` its standard deviation.
        middle_s: time of mid-record on the reference's clock (s).
        correlation: of the two signals once laid over each other.
        samples: reference samples that were used.
        gain: sensor = gain * reference + offset + compliance * force; `gain_std` its standard deviation.
        offset: at a reference of 0, in the sensor's unit; `offset_std` its standard deviation.
        compliance: how far the sensor moves against the reference for one newton (m/N); None where it was not fitted;
            `compliance_std` its standard deviation, `coupling` the covariance of lag and compliance (s m/N).
    """

    lag_s: float
    lag_std_s: float
    drift: float
    drift_std: float
    middle_s: float
    correlation: float
    samples: int
    gain: float = 1.0
    gain_std: float = math.inf
    offset: float = 0.0
    offset_std: float = math.inf
    compliance: float | None = None
    compliance_std: float = math.inf
    coupling: float = 0.0

    def widened(self, lag_std_s: float) -> Match:
        """The same with a larger standard deviation of the lag (s); what is as unsure of the compliance is kept so.

        How the lag goes with the compliance stays as it is: what makes a lag unsure turns no load train into another.
        """
        factor = lag_std_s / self.lag_std_s
        return replace(
            self, lag_std_s=lag_std_s, compliance_std=self.compliance_std * factor, coupling=self.coupling * factor**2,
        )


class Course(NamedTuple):
    """What is known of a motion.

    Attributes:
        cycle_s: its period, s: errors at equal phase repeat, so they count once.
        least_half: samples either side that smoothing takes in at least, as `smoothed`.
    """

    cycle_s: float = math.inf
    least_half: int = 0


COURSE = Course()


def student(freedom: int) -> float:
    """By how much Student's t of so many degrees of freedom is wider than a normal distribution, for 95 % of it."""
    if freedom < 1:
        return math.inf
    # Cornish and Fisher (1938), for the quantile of a normal distribution z.
    z = 1.959964
    first, second = (z**3 + z) / 4.0, (5.0 * z**5 + 16.0 * z**3 + 3.0 * z) / 96.0
    third = (3.0 * z**7 + 19.0 * z**5 + 17.0 * z**3 - 15.0 * z) / 384.0
    return (z + first / freedom + second / freedom**2 + third / freedom**3) / z


def match(
    reference: TimeSeries, sensor: TimeSeries, period_s: float,
    *, reach_s: float, with_drift: bool, course: Course = COURSE,
) -> Match | None:
    """Lay a sensor's samples over the controller's record of the same quantity.

    Args:
        reference: the reference (m,), any unit.
        sensor: the sensor's samples (n,), on the reference's clock as far as it is known.
        period_s: nominal sample period of the sensor, s.
        reach_s: the lag is searched within plus and minus this (s).
        with_drift: fit a drift of the sensor's clock too.
        course: of the motion.

    Returns:
        None when the two cannot be laid over each other: too few samples, nothing moves, or no likeness.
    """
    time_s, values = sensor.time_s, sensor.values
    good = np.isfinite(reference.values) & np.isfinite(reference.time_s)
    chosen = np.flatnonzero(good)
    if len(chosen) > MOST_REFERENCES:
        chosen = chosen[:: -(-len(chosen) // MOST_REFERENCES)]
    at_s, target = reference.time_s[chosen], reference.values[chosen]
    finite = np.isfinite(values)
    if len(at_s) < FEWEST_SAMPLES or np.count_nonzero(finite) < FEWEST_SAMPLES or np.ptp(target) == 0.0:
        return None
    smooth = smoothed(values, course.least_half)
    if smooth is None:
        return None
    values, finite = smooth, np.isfinite(smooth)
    if np.count_nonzero(finite) < FEWEST_SAMPLES:
        return None
    lag_s = _coarse(at_s, target, time_s[finite], values[finite], reach_s)
    drift, middle_s = 0.0, float(np.mean(at_s))
    problem = _Problem(at_s, target, time_s, values, period_s, middle_s, with_drift, course.cycle_s)
    used: BoolArray | None = None
    step = None
    for _ in range(ROUNDS):
        step = problem.step(lag_s, drift, used)
        if step is None:
            break
        lag_s, drift = lag_s + step.lag_s, drift + step.drift
        used = step.keep
        if abs(step.lag_s) < CONVERGED_S and abs(step.drift) < CONVERGED_S:
            break
    if step is None or step.correlation < SMALLEST_CORRELATION or abs(lag_s) > 1.5 * reach_s:
        return None
    count = int(np.sum(step.keep))
    widening = np.sqrt(1.0 + SMALL_SAMPLE / count)
    return Match(
        lag_s, float(widening * step.lag_std_s), drift, float(widening * step.drift_std), middle_s, step.correlation,
        count,
    )


def smoothed(values: FloatArray, least_half: int = 0) -> FloatArray | None:
    """The samples under the narrowest local parabola that leaves little noise in their slope; None when none does.

    The window is symmetric, so it moves no feature in time. NaN within half a window of a missing sample.

    Args:
        values: (n,).
        least_half: the window has so many samples either side at least, as far as windows go; what is narrower than
            that is meant to be smoothed away, and no jump is left out for it. 0: as narrow as may be.
    """
    third = np.diff(values, 3)
    third = third[np.isfinite(third)]
    if len(third) == 0:
        return None
    noise = float(np.median(np.abs(third))) / (0.6745 * np.sqrt(20.0))
    least_half = min(least_half, HALF_WIDTHS[-1])
    for half in (half for half in HALF_WIDTHS if half >= least_half):
        if len(values) <= 2 * half + 4:
            return None
        offsets = np.arange(-half, half + 1)
        inverse = np.linalg.pinv(np.vander(offsets, 3, increasing=True))
        smooth = np.full(len(values), np.nan)
        smooth[half:-half] = np.convolve(values, inverse[0][::-1], "valid")
        slope = np.convolve(values, inverse[1][::-1], "valid")
        slope = slope[np.isfinite(slope)]
        if len(slope) and noise**2 * float(inverse[1] @ inverse[1]) <= (SLOPE_NOISE**2) * float(np.mean(slope**2)):
            return smooth if least_half else _resolved(values, smooth, noise, half)
    return None


def _resolved(values: FloatArray, smooth: FloatArray, noise: float, half: int) -> FloatArray:
    """The smoothed samples without those around a jump, which no parabola follows: there the lag is undetermined."""
    with np.errstate(invalid="ignore"):
        jumps = np.abs(values - smooth) > JUMP_DEVIATIONS * noise
    near = np.convolve(jumps, np.ones(2 * (half + 2) + 1), "same") > 0.0
    return np.where(near, np.nan, smooth)


@dataclass(frozen=True)
class _Step:
    lag_s: float
    drift: float
    lag_std_s: float
    drift_std: float
    correlation: float
    keep: BoolArray


def _coarse(at_s: FloatArray, target: FloatArray, time_s: FloatArray, values: FloatArray, reach_s: float) -> float:
    """The lag (s) within reach at which the two correlate best; 0 when the reach is small beside the signal."""
    best, best_lag_s = -2.0, 0.0
    steps = min(MOST_COARSE_STEPS, 2 * int(np.ceil(reach_s / COARSE_STEP_S)))
    for lag_s in np.linspace(-reach_s, reach_s, steps + 1):
        shown = np.interp(at_s + lag_s, time_s, values)
        if np.ptp(shown) == 0.0:
            continue
        likeness = float(np.corrcoef(shown, target)[0, 1])
        if likeness > best:
            best, best_lag_s = likeness, float(lag_s)
    return best_lag_s


@dataclass(frozen=True)
class _Problem:
    """The least squares: reference (m,) at its times, the sensor's samples (n,) at theirs, what is fitted."""

    at_s: FloatArray
    target: FloatArray
    time_s: FloatArray
    values: FloatArray
    period_s: float
    middle_s: float
    with_drift: bool
    cycle_s: float

    def step(self, lag_s: float, drift: float, used: BoolArray | None) -> _Step | None:
        """One Gauss-Newton step about (lag, drift), with what it says about itself; None when too little is left."""
        shifted_s = self.at_s + lag_s + drift * (self.at_s - self.middle_s)
        shown = cubic_at(shifted_s, self.time_s, self.values, self.period_s)
        straight = linear_at(shifted_s, self.time_s, self.values, self.period_s)
        apart_s = 0.1 * self.period_s
        after, before = (
            cubic_at(moved_s, self.time_s, self.values, self.period_s)
            for moved_s in (shifted_s + apart_s, shifted_s - apart_s)
        )
        slope = (after - before) / (2.0 * apart_s)
        keep = np.isfinite(shown) & np.isfinite(straight) & np.isfinite(slope)
        if np.count_nonzero(keep) < FEWEST_SAMPLES:
            return None
        noise = _noise(self.target[keep], shown[keep])
        keep &= np.abs(np.nan_to_num(shown - straight)) <= max(UNRESOLVED_DEVIATIONS * noise, 1e-12)
        if used is not None and np.count_nonzero(keep & used) >= FEWEST_SAMPLES:
            keep &= used
        if np.count_nonzero(keep) < FEWEST_SAMPLES or _is_constant(shown[keep]):
            return None
        keep &= np.abs(_residual(self.target, shown, keep)) <= OUTLIER_DEVIATIONS * noise
        count = int(np.count_nonzero(keep))
        if count < FEWEST_SAMPLES:
            return None
        columns = [np.ones(count), shown[keep], slope[keep]]
        if self.with_drift:
            columns.append(slope[keep] * (self.at_s[keep] - self.middle_s))
        design = np.column_stack(columns)
        scale = np.sqrt(np.mean(design**2, axis=0))
        scale[scale == 0.0] = 1.0
        solution, _, rank, _ = np.linalg.lstsq(design / scale, self.target[keep], rcond=None)
        gain = solution[1] / scale[1]
        if rank < design.shape[1] or gain <= 0.0:
            return None
        rest = self.target[keep] - (design / scale) @ solution
        variance = float(rest @ rest) / max(count - design.shape[1], 1)
        inverse = np.linalg.inv((design / scale).T @ (design / scale))
        repeated = _repeated(design / scale * rest[:, None], (self.at_s[keep] - self.middle_s) / self.cycle_s)
        spread = np.sqrt(np.maximum(variance * np.diag(inverse), np.diag(inverse @ repeated @ inverse))) / scale / gain
        power = float(np.sum((self.target[keep] - np.mean(self.target[keep])) ** 2))
        estimates = solution / scale / gain
        correlation = float(np.sqrt(max(0.0, 1.0 - float(rest @ rest) / power)))
        drift, drift_std = (float(estimates[3]), float(spread[3])) if self.with_drift else (0.0, 0.0)
        return _Step(float(estimates[2]), drift, float(spread[2]), drift_std, correlation, keep)


def _is_constant(shown: FloatArray) -> bool:
    """Whether a signal (m,) moves by no more than its rounding: no line can be laid through that.

    A cubic through equal samples leaves their last digit open. A least-squares line has full rank where the deviation
    is above `2 m eps` of the signal.
    """
    resolved = 4.0 * len(shown) * float(np.finfo(np.float64).eps)
    return float(np.std(shown)) <= resolved * float(np.max(np.abs(shown)))


def _repeated(scores: FloatArray, cycles: FloatArray) -> FloatArray:
    """Covariance (p, p) of the summed scores (n, p) when those at equal phase of the cycle share their error."""
    bins = np.floor(PHASE_BINS * (cycles % 1.0)).astype(np.int64)
    sums = np.array([np.bincount(bins, column, PHASE_BINS) for column in scores.T])
    filled = int(np.count_nonzero(np.bincount(bins, minlength=PHASE_BINS)))
    return np.asarray(sums @ sums.T * (filled / max(filled - scores.shape[1], 1)), np.float64)


def _residual(target: FloatArray, shown: FloatArray, keep: BoolArray) -> FloatArray:
    """What a straight line from shown to wanted, fitted where `keep`, leaves (m,); infinite where nothing is shown."""
    gain, offset = np.polyfit(shown[keep], target[keep], 1)
    rest = target - offset - gain * np.nan_to_num(shown)
    return np.where(np.isfinite(shown), rest, np.inf)


def _noise(target: FloatArray, shown: FloatArray) -> float:
    """Robust standard deviation of what a straight line from shown to wanted leaves."""
    if _is_constant(shown):
        return float(np.std(target))
    gain, offset = np.polyfit(shown, target, 1)
    rest = target - offset - gain * shown
    return float(1.4826 * np.median(np.abs(rest - np.median(rest))))

"""Response time of a quantity to a step, from repeated records: dead time, lag, and the times to 63, 90 and 95 %.

Each record is the quantity around one step, on a time axis with the step at 0. Before the step and long after it the
quantity may drift linearly (a spring at constant velocity). Two estimates are made of the same records:

- **Fit.** A first-order lag T with dead time d, seen through the sensor's filter:
  y = a + b t + (D + c t) s(t), s = 1 - exp(-(t - d) / T) for t > d. Variable projection: a, b, D and c of each record
  are linear and are eliminated; d and T are common to all records of a group.
- **Crossing.** No shape is assumed. The line through the baseline and the line through the settled end, each
  extrapolated to t, divide a sample: r = (y - A) / (E - A). The time at which r reaches the level is read from a local
  parabola through the samples of all records, laid over each other. The fit only says where the end begins, what
  little of the step is left there, and where to look for the level.

Standard errors contain the noise of the samples with its autocorrelation (autoregression of the residuals) and,
where the records scatter by more than that explains (5 % level), the scatter from record to record with Student's t of
the number of records. What is common to all records, the uncertainty of the clock alignment, is added.

A result states what it is: measured; faster or slower than can be measured, with the limit; or not determined.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum

import numpy as np
from scipy import optimize, stats

from rig.signals.arrays import BoolArray, FloatArray
from rig.signals.sensor_filter import FILTER_DELAY

LEVELS = (0.632, 0.90, 0.95)
"""Shares of the step whose times are stated; the first is that of a time constant, 1 - 1/e."""
LEVEL_NAMES = tuple(f"t{100 * level:.0f}" for level in LEVELS)
CONFIDENCE = 0.95
NORMAL = float(stats.norm.ppf(0.5 + 0.5 * CONFIDENCE))
"""Standard deviations of a normal variable within which this share of it lies."""
FEWEST_BEFORE, FEWEST_AFTER = 4, 6
"""Samples of a record before its step and after it."""
SETTLED_LAGS = 5.0
"""Time constants after which the settled end begins: 0.7 % of the step is left, which is taken from the fit."""
LEAST_TAIL = 0.3
"""Share of the window that the settled end takes at least."""
SLOWEST_WINDOW = 4.0
"""Time constants that the window must hold; with fewer, the drift cannot be distinguished from the response."""
FASTEST_OF_WINDOW = 1e-4
HETEROGENEOUS = 0.05
"""Probability below which the scatter from record to record is more than the noise."""
MOST_ORDER, MOST_LAGS = 6, 200
FEWEST_INSIDE = 2
"""Samples of all records within three lags; with fewer, the response lies between two samples."""
LEAST_STD_S = 1e-6
NOISE_FREE = 1e-6
"""Noise of so small a share of the step is rounding."""
VISIBLE = 5.0
"""Standard errors that the step itself must be."""
KNOWN = 0.5
"""A time with a larger relative standard error is not determined."""
REACHES = (0.5, 0.6, 0.8)
"""Half width of the parabola for each level, in fitted lags."""
WIDER, TIMES_WIDER = 1.25, 4
"""It is widened by this factor, so many times at most, until there are enough samples in it."""
FEWEST_PLACES = 6
"""Different instants of samples within a parabola."""


class State(StrEnum):
    """What a result is."""

    MEASURED = "measured"
    FASTER = "faster"
    SLOWER = "slower"
    UNKNOWN = "unknown"


@dataclass(frozen=True)
class TimeResult:
    """A time (s) with its standard error and 95 % interval; NaN where it is not known.

    Attributes:
        state: measured; or faster or slower than `limit_s`, or not determined.
        limit_s: the limit of what can be measured; NaN where none is reached.
    """

    value_s: float = math.nan
    std_s: float = math.nan
    low_s: float = math.nan
    high_s: float = math.nan
    state: State = State.UNKNOWN
    limit_s: float = math.nan

    @property
    def measured(self) -> bool:
        """Whether the value counts."""
        return self.state is State.MEASURED


NOT_KNOWN = TimeResult()


@dataclass(frozen=True)
class Record:
    """One step.

    Attributes:
        time_s: (n,) s after the step, rising; samples before it are negative.
        value: (n,) the quantity.
    """

    time_s: FloatArray
    value: FloatArray


@dataclass(frozen=True)
class Seen:
    """How the records were taken.

    Attributes:
        bandwidth_Hz: cut-off frequency of the sensor's filter (second order, Butterworth), whose delay at low
            frequencies is already removed from the times; None: no filter.
        time_std_s: standard uncertainty of the origin of the times, common to all records (s).
        drifts: whether the quantity drifts linearly before and after the step.
    """

    bandwidth_Hz: float | None = None
    time_std_s: float = 0.0
    drifts: bool = True


@dataclass(frozen=True)
class StepResponse:
    """Response to the steps of a group.

    Attributes:
        steps: number of records.
        size: mean change of the quantity at the step, with its standard error.
        noise: standard deviation of the samples about the fit; `correlation` from one sample to the next.
        dead, lag: of the fit (s).
        fit: time to each level by the fit, (3,), from the origin of the times.
        crossing: time to each level without a model, (3,).
        settling_s: mean delay of the response, the area between it and its end (s), with its standard error; NaN where
            it did not settle in the window.
        fits: whether the first-order lag describes the records within their noise.
        scatters: whether the records scatter by more than their noise explains.
        why: why nothing could be determined; empty where something is.
    """

    steps: int
    size: float = math.nan
    size_std: float = math.nan
    noise: float = math.nan
    correlation: float = 0.0
    dead: TimeResult = NOT_KNOWN
    lag: TimeResult = NOT_KNOWN
    fit: tuple[TimeResult, ...] = (NOT_KNOWN,) * len(LEVELS)
    crossing: tuple[TimeResult, ...] = (NOT_KNOWN,) * len(LEVELS)
    settling_s: tuple[float, float] = (math.nan, math.nan)
    fits: bool = True
    scatters: bool = False
    why: str = ""
    curve: Callable[[FloatArray], FloatArray] | None = field(default=None, compare=False, repr=False)


def filtered_lag(time_s: FloatArray, dead_s: float, lag_s: float, bandwidth_Hz: float | None) -> FloatArray:
    """Unit step response of a first-order lag with dead time, seen through a second-order Butterworth filter.

    The delay of the filter at low frequencies, sqrt(2) / omega, is removed from the time.

    Args:
        time_s: (n,) s after the step.
        dead_s: dead time d (s).
        lag_s: time constant T (s), > 0.
        bandwidth_Hz: cut-off frequency of the filter; None: no filter.

    Returns:
        (n,) share of the step.
    """
    if bandwidth_Hz is None:
        since_s = np.maximum(time_s - dead_s, 0.0)
        return np.asarray(-np.expm1(-since_s / lag_s))
    omega = math.tau * bandwidth_Hz
    since_s = np.maximum(time_s - dead_s + FILTER_DELAY / omega, 0.0)
    damped = omega / math.sqrt(2.0)  # zeta omega, and omega sqrt(1 - zeta^2), for zeta = 1 / sqrt(2)
    rate = 1.0 / lag_s
    lagging = omega**2 / (rate**2 - math.sqrt(2.0) * omega * rate + omega**2)
    cosine, sine = 1.0 - lagging, (lagging * rate + (1.0 - lagging) * damped) / damped
    ringing = np.exp(-damped * since_s) * (cosine * np.cos(damped * since_s) + sine * np.sin(damped * since_s))
    return np.asarray(1.0 - lagging * np.exp(-rate * since_s) - ringing)


@dataclass(frozen=True)
class _Noise:
    """Autocovariance of the samples' noise: variance, and correlation at lags 0, 1, ...; (m,)."""

    variance: float
    correlation: FloatArray

    def variance_of(self, weights: FloatArray) -> float:
        """Variance of a weighted sum of consecutive samples; weights (n,)."""
        total = float(weights @ weights)
        for lag in range(1, min(len(self.correlation), len(weights))):
            total += 2.0 * float(self.correlation[lag]) * float(weights[lag:] @ weights[:-lag])
        return self.variance * max(total, 0.0)


def step_response(records: Sequence[Record], seen: Seen = Seen()) -> StepResponse:
    """The response to repeated steps of one size.

    Args:
        records: one for each step; those with too few samples on one side are not used.
        seen: how they were taken.
    """
    usable = [
        record for record in records
        if np.count_nonzero(record.time_s < 0.0) >= FEWEST_BEFORE
        and np.count_nonzero(record.time_s >= 0.0) >= FEWEST_AFTER
    ]
    if not usable:
        return StepResponse(0, why="too few samples before or after the step")
    return _Group(usable, seen).response()


def _drift(time_s: FloatArray, *, drifts: bool) -> FloatArray:
    """Columns of the line that a quantity follows before a step or long after it, (n, 2); without drift (n, 1)."""
    return np.column_stack((np.ones(len(time_s)), time_s)) if drifts else np.ones((len(time_s), 1))


class _Group:
    """Records of one group with what is derived from them."""

    def __init__(self, records: Sequence[Record], seen: Seen) -> None:
        self.records, self.seen = records, seen
        self.window_s = float(min(record.time_s[-1] for record in records))
        steps_s = np.concatenate([np.diff(record.time_s) for record in records])
        self.sample_s = float(np.median(steps_s))
        self.count = sum(len(record.time_s) for record in records)
        self._columns = [_drift(record.time_s, drifts=seen.drifts) for record in records]

    def response(self) -> StepResponse:
        """Everything that the records say."""
        theta = self.fitted()
        residuals = self.residuals(theta)
        noise = self._noise(residuals)
        size, size_std = self._size(theta, noise)
        known = StepResponse(
            len(self.records), size, size_std, math.sqrt(noise.variance),
            float(noise.correlation[1]) if len(noise.correlation) > 1 else 0.0,
        )
        if not abs(size) > VISIBLE * size_std:
            return replace(known, why="the step does not stand out from the noise")
        covariance, scatters, quantile = self._covariance(theta, residuals, noise)
        dead_s, lag_s = float(theta[0]), math.exp(float(theta[1]))
        slow = SLOWEST_WINDOW * lag_s + dead_s > self.window_s
        gap_s = self._gap_s(dead_s, lag_s)

        def of_fit(gradient: FloatArray, value_s: float, *, absolute: bool) -> TimeResult:
            std_s = math.sqrt(max(0.0, float(gradient @ covariance @ gradient)))
            if gap_s and not absolute:
                return TimeResult(value_s, gap_s, 0.0, gap_s, State.FASTER, gap_s)
            return self.result(value_s, math.hypot(std_s, gap_s), quantile, absolute=absolute, slow=slow)

        log_levels = [-math.log1p(-level) for level in LEVELS]
        fit = tuple(
            of_fit(np.array([1.0, factor * lag_s]), dead_s + factor * lag_s, absolute=True) for factor in log_levels
        )
        known = replace(
            known, scatters=scatters, fit=fit, dead=of_fit(np.array([1.0, 0.0]), dead_s, absolute=True),
            lag=of_fit(np.array([0.0, lag_s]), lag_s, absolute=False),
            curve=lambda time_s: filtered_lag(np.asarray(time_s, np.float64), dead_s, lag_s, self.seen.bandwidth_Hz),
        )
        if slow:
            return replace(known, crossing=tuple(replace(result, value_s=math.nan) for result in fit))
        fits = self._fits(residuals, dead_s, lag_s)
        lag_std_s = lag_s * math.sqrt(max(0.0, float(covariance[1, 1])))
        crossings = _Crossings(self, dead_s, lag_s, noise)
        # The end is corrected by what the fit says is left of the step there.
        others = [_Crossings(self, dead_s, lag_s + min(lag_std_s, 0.5 * lag_s), noise, crossings.settled_s)]
        delay_s, delay_std_s = crossings.area()
        if not fits or crossings.cut_short:
            blind = _Crossings(self, dead_s, lag_s, noise, crossings.settled_s, corrected=False)
            delay_std_s = math.hypot(delay_std_s, 0.5 * (blind.area()[0] - delay_s))
            others.append(blind)
        crossing = tuple(
            self._widened(
                crossings.crossing(place),
                [*(other.crossing(place) for other in others), crossings.crossing(place, WIDER)],
            ) for place in range(len(LEVELS))
        )
        return replace(known, crossing=crossing, settling_s=(delay_s, delay_std_s), fits=fits)

    def _gap_s(self, dead_s: float, lag_s: float) -> float:
        """Interval (s) between samples in which the whole response lies; 0 where samples show its course."""
        times_s = np.sort(np.concatenate([record.time_s for record in self.records]))
        if np.count_nonzero((times_s >= dead_s) & (times_s <= dead_s + 3.0 * lag_s)) >= FEWEST_INSIDE:
            return 0.0
        before, after = times_s[times_s < dead_s], times_s[times_s > dead_s + 3.0 * lag_s]
        return float(after[0] - before[-1]) if len(before) and len(after) else self.sample_s

    @staticmethod
    def _widened(result: TimeResult, others: Sequence[TimeResult]) -> TimeResult:
        """A time whose interval contains by how much it depends on the fit and on the width of the parabola."""
        if not result.measured:
            return result
        shifts_s = [other.value_s - result.value_s for other in others if other.measured]
        more_s = math.sqrt(sum(shift_s**2 for shift_s in shifts_s))
        half_s = math.hypot(result.high_s - result.value_s, NORMAL * more_s)
        return replace(
            result, std_s=math.hypot(result.std_s, more_s), low_s=result.value_s - half_s,
            high_s=result.value_s + half_s,
        )

    def result(
        self, value_s: float, std_s: float, quantile: float, *, absolute: bool, slow: bool = False
    ) -> TimeResult:
        """A time with its interval; `absolute`: it is counted from the origin of the times."""
        common_s, std_s = self.seen.time_std_s if absolute else 0.0, max(std_s, LEAST_STD_S)
        half_s = math.hypot(quantile * std_s, NORMAL * common_s)
        result = TimeResult(value_s, math.hypot(std_s, common_s), value_s - half_s, value_s + half_s, State.MEASURED)
        if slow:
            return replace(result, state=State.SLOWER, limit_s=self.window_s)
        if not absolute and (result.low_s <= 0.0 or std_s > KNOWN * value_s):
            return replace(result, low_s=0.0, state=State.FASTER, limit_s=max(result.high_s, self.sample_s))
        if not half_s < self.window_s:
            return replace(result, state=State.UNKNOWN)
        return result

    # Fit

    def residuals(self, theta: FloatArray) -> list[FloatArray]:
        """What the best a, b, D and c leave of each record at this dead time and logarithm of the lag."""
        return self.rest([float(theta[0])] * len(self.records), math.exp(float(theta[1])))

    def rest(self, dead_s: Sequence[float], lag_s: float) -> list[FloatArray]:
        """What the best a, b, D and c leave of each record at its dead time (s) and a common lag (s)."""
        left = []
        for place, record in enumerate(self.records):
            basis, _ = np.linalg.qr(self._design(place, dead_s[place], lag_s))
            left.append(record.value - basis @ (basis.T @ record.value))
        return left

    def _design(self, place: int, dead_s: float, lag_s: float) -> FloatArray:
        """Columns of a, b, D and c for a record, (n, 4) or (n, 2)."""
        drift = self._columns[place]
        shape = filtered_lag(self.records[place].time_s, dead_s, lag_s, self.seen.bandwidth_Hz)
        return np.column_stack((drift, drift * shape[:, None]))

    def _all_residuals(self, theta: FloatArray) -> FloatArray:
        """The residuals of all records (n,)."""
        return np.concatenate(self.residuals(theta))

    def fitted(self) -> FloatArray:
        """Dead time (s) and logarithm of the lag, by least squares from several starts.

        The sum of squares has a separate minimum wherever the dead time passes a sample, so that starts are spread
        over the intervals of the sampling.
        """
        first = self._guess()
        shift_s = min(self.sample_s, 0.5 * math.exp(first[1]))
        coarse = math.exp(first[1]) < 2.0 * self.sample_s
        starts = [
            first + np.array([shift * shift_s, stretch]) for shift in (-0.5, 0.0, 0.5) if coarse or shift == 0.0
            for stretch in ((-0.7, 0.0) if coarse else (0.0,))
        ]
        lowest, highest = math.log(FASTEST_OF_WINDOW * self.window_s), math.log(self.window_s)
        bounds = ([-self.window_s, lowest], [self.window_s, highest])
        best: tuple[float, FloatArray] | None = None
        for start in starts:
            start = np.clip(start, np.array(bounds[0]) + 1e-9, np.array(bounds[1]) - 1e-9)
            solved = optimize.least_squares(
                self._all_residuals, start, bounds=bounds, x_scale=(self.sample_s, 0.2), diff_step=(1e-4, 1e-4),
                xtol=1e-7, ftol=1e-9, max_nfev=40,
            )
            if best is None or solved.cost < best[0]:
                best = float(solved.cost), np.asarray(solved.x)
        return first if best is None else best[1]

    def _guess(self) -> FloatArray:
        """First guess from the times to 28 and 63 % (Smith): T = 1.5 (t63 - t28), d = t63 - T."""
        time_s, share = self.shares(0.5 * self.window_s)
        order = np.argsort(time_s)
        time_s, share = time_s[order], share[order]
        after = time_s >= 0.0
        width = max(3, len(self.records))
        smooth = np.convolve(share, np.ones(width) / width, mode="same")

        def reached_s(level: float) -> float:
            beyond = np.flatnonzero(after & (smooth >= level))
            return float(time_s[beyond[0]]) if len(beyond) else 0.5 * self.window_s

        low_s, high_s = reached_s(0.28), reached_s(0.632)
        lag_s = max(1.5 * (high_s - low_s), 0.25 * self.sample_s, 2.0 * FASTEST_OF_WINDOW * self.window_s)
        return np.array([high_s - lag_s, math.log(lag_s)])

    def shares(self, settled_s: float) -> tuple[FloatArray, FloatArray]:
        """Times and shares of the step of all samples (n,), by the baseline and the end that begins at `settled_s`."""
        times, shares = [], []
        for record in self.records:
            lines = _Lines(record, settled_s, np.ones(len(record.time_s)), drifts=self.seen.drifts)
            times.append(record.time_s)
            shares.append((record.value - lines.before) / lines.change)
        return np.concatenate(times), np.concatenate(shares)

    def _size(self, theta: FloatArray, noise: _Noise) -> tuple[float, float]:
        """Mean change of the quantity at the step (t = 0), and its standard error."""
        sizes, variance = [], 0.0
        for place, record in enumerate(self.records):
            inverse = np.linalg.pinv(self._design(place, float(theta[0]), math.exp(float(theta[1]))))
            row = np.asarray(inverse[self._columns[place].shape[1]], np.float64)
            sizes.append(float(row @ record.value))
            variance += noise.variance_of(row)
        return float(np.mean(sizes)), math.sqrt(variance) / len(sizes)

    def _noise(self, residuals: Sequence[FloatArray]) -> _Noise:
        """Noise of the samples by an autoregression of the residuals (Yule and Walker; order by BIC)."""
        spent = len(self.records) * 2 * self._columns[0].shape[1] + 2
        freedom = max(1, self.count - spent)
        variance = sum(float(rest @ rest) for rest in residuals) / freedom
        power = sum(float(rest @ rest) for rest in residuals)
        if not power > 0.0:
            return _Noise(0.0, np.ones(1))
        shortest = min(map(len, residuals))
        rho = np.ones(MOST_ORDER + 1)
        for lag in range(1, min(MOST_ORDER, shortest // 4) + 1):
            rho[lag] = sum(float(rest[lag:] @ rest[:-lag]) for rest in residuals) / power
        best: tuple[float, FloatArray] = (0.0, np.zeros(0))
        for order in range(1, min(MOST_ORDER, shortest // 4) + 1):
            matrix = rho[np.abs(np.subtract.outer(np.arange(order), np.arange(order)))]
            terms = np.linalg.lstsq(matrix, rho[1 : order + 1], rcond=None)[0]
            left = 1.0 - float(terms @ rho[1 : order + 1])
            if left > 0.0 and self.count * math.log(left) + order * math.log(self.count) < best[0]:
                best = self.count * math.log(left) + order * math.log(self.count), np.asarray(terms, np.float64)
        terms = best[1]
        if not len(terms):
            return _Noise(variance, np.ones(1))
        correlation = np.ones(MOST_LAGS)
        correlation[1 : len(terms) + 1] = rho[1 : len(terms) + 1]
        for lag in range(len(terms) + 1, MOST_LAGS):
            correlation[lag] = float(terms @ correlation[lag - len(terms) : lag][::-1])
        small = np.flatnonzero(np.abs(correlation) < 1e-3)
        return _Noise(variance, correlation[: int(small[0]) if len(small) else MOST_LAGS])

    def _covariance(
        self, theta: FloatArray, residuals: Sequence[FloatArray], noise: _Noise
    ) -> tuple[FloatArray, bool, float]:
        """Covariance of dead time and logarithm of the lag, whether the records scatter, and the 95 % quantile."""
        step = np.array([0.02 * min(self.sample_s, math.exp(theta[1])), 0.02])
        slopes = []
        for place in range(2):
            shift = np.where(np.arange(2) == place, step, 0.0)
            above, below = self.residuals(theta + shift), self.residuals(theta - shift)
            slopes.append([(up - down) / (2.0 * step[place]) for up, down in zip(above, below, strict=True)])
        jacobians = [np.column_stack(pair) for pair in zip(*slopes, strict=True)]
        information = sum((one.T @ one for one in jacobians), np.zeros((2, 2)))
        inverse = np.linalg.pinv(information)
        # Influence of each record on both parameters, and the variance that its noise gives it.
        influences = np.array([
            -inverse @ (one.T @ rest) for one, rest in zip(jacobians, residuals, strict=True)
        ])
        inner = np.zeros((2, 2))
        variances = []
        for one in jacobians:
            rows = inverse @ one.T
            both = _variances(rows, noise)
            inner += both
            variances.append(np.diag(both))
        return _with_scatter(inner, influences, np.array(variances))

    def _fits(self, residuals: Sequence[FloatArray], dead_s: float, lag_s: float) -> bool:
        """Whether the fit leaves no more around the response than before it and after it (F test at 1 %)."""
        change = max(float(np.ptp(record.value)) for record in self.records)
        inside, outside, counts = 0.0, 0.0, [0, 0]
        for record, rest in zip(self.records, residuals, strict=True):
            near = (record.time_s > dead_s - self.sample_s) & (record.time_s < dead_s + 4.0 * lag_s)
            inside += float(rest[near] @ rest[near])
            outside += float(rest[~near] @ rest[~near])
            counts[0] += int(np.count_nonzero(near))
            counts[1] += int(np.count_nonzero(~near))
        if min(counts) < FEWEST_AFTER or outside <= counts[1] * (NOISE_FREE * change) ** 2:
            return True
        ratio = (inside / counts[0]) / (outside / counts[1])
        return bool(ratio < stats.f.ppf(0.99, *counts))


def _variances(rows: FloatArray, noise: _Noise) -> FloatArray:
    """Covariance (2, 2) of two weighted sums of consecutive samples; rows (2, n)."""
    own = [noise.variance_of(row) for row in rows]
    both = noise.variance_of(rows[0] + rows[1])
    cross = 0.5 * (both - own[0] - own[1])
    return np.array([[own[0], cross], [cross, own[1]]])


def _with_scatter(
    covariance: FloatArray, influences: FloatArray, variances: FloatArray
) -> tuple[FloatArray, bool, float]:
    """Covariance widened where records scatter by more than their noise, whether they do, and the 95 % quantile.

    The influence of a record on a parameter has the variance that its noise gives it; over n records the sum of the
    squares, each over its variance, is chi-square with n - 1 degrees of freedom (Birge 1932).

    Args:
        covariance: (p, p) by the noise.
        influences: (n, p) of each record on each parameter.
        variances: (n, p) of the influences by the noise.
    """
    count = len(influences)
    if count < 3:
        return covariance, False, NORMAL
    weights = variances / np.maximum(np.sum(variances, axis=0), 1e-300)
    apart = influences - weights * np.sum(influences, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        chi = np.nansum(np.where(variances > 0.0, apart**2 / variances, 0.0), axis=0)
    worst = float(np.max(chi))
    if stats.chi2.sf(worst, count - 1) >= HETEROGENEOUS / influences.shape[1]:
        return covariance, False, NORMAL
    return covariance * worst / (count - 1), True, float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, count - 1))


class _Lines:
    """The lines through baseline and settled end of a record, as weights on its samples.

    Args (construction):
        record: the samples.
        settled_s: when the settled end begins.
        reached: (n,) share of the step that has been reached by then, nearly 1.
        drifts: whether the lines are inclined.

    Attributes:
        baseline, settled: (n,) which samples are in each.
        before, change: (n,) the baseline at each sample, and the distance of the end from it.
    """

    def __init__(self, record: Record, settled_s: float, reached: FloatArray, *, drifts: bool) -> None:
        self._columns = _drift(record.time_s, drifts=drifts)
        self.baseline = record.time_s < 0.0
        self.settled = record.time_s >= settled_s
        there = reached[self.settled]
        self._before, self._end = self._fit(self.baseline), self._fit(self.settled)
        self.before = self._columns @ (self._before @ record.value[self.baseline])
        settled = (record.value[self.settled] - (1.0 - there) * self.before[self.settled]) / there
        self.change = self._columns @ (self._end @ settled) - self.before

    def _fit(self, chosen: BoolArray) -> FloatArray:
        return np.asarray(np.linalg.pinv(self._columns[chosen]))

    def spread(self, weights: FloatArray, shares: FloatArray) -> FloatArray:
        """Weights on the samples (n,) of a weighted sum of shares, baseline and end included.

        dr = dy / (E - A) - (1 - r) dA / (E - A) - r dE / (E - A).
        """
        scaled = weights / self.change
        total = scaled.copy()
        total[self.baseline] -= (scaled * (1.0 - shares)) @ self._columns @ self._before
        total[self.settled] -= (scaled * shares) @ self._columns @ self._end
        return np.asarray(total)


class _Crossings:
    """Times to the levels without a model; the fit only says where to look and how wide.

    Attributes:
        settled_s: when the settled end begins (s).
        cut_short: whether it begins earlier than `SETTLED_LAGS`, because the window is short: much of the result is
            then the fit's.
    """

    def __init__(
        self, group: _Group, dead_s: float, lag_s: float, noise: _Noise, settled_s: float | None = None, *,
        corrected: bool = True,
    ) -> None:
        self._group, self._noise = group, noise
        self._dead_s, self._lag_s = dead_s, lag_s
        latest_s = (1.0 - LEAST_TAIL) * group.window_s
        own_s = min(max(dead_s, 0.0) + SETTLED_LAGS * lag_s, latest_s)
        self.settled_s = own_s if settled_s is None else settled_s
        self.cut_short = own_s == latest_s
        self._lines = []
        for record in group.records:
            reached = filtered_lag(record.time_s, dead_s, lag_s, group.seen.bandwidth_Hz)
            reached = reached if corrected else np.ones(len(reached))
            self._lines.append(_Lines(record, self.settled_s, reached, drifts=group.seen.drifts))
        self._shares = [
            (record.value - lines.before) / lines.change
            for record, lines in zip(group.records, self._lines, strict=True)
        ]

    @property
    def _settles(self) -> bool:
        """Whether every record has enough samples in its settled end."""
        return min(int(np.count_nonzero(lines.settled)) for lines in self._lines) >= FEWEST_BEFORE

    def crossing(self, place: int, wider: float = 1.0) -> TimeResult:
        """Time to one of `LEVELS`, by a parabola that is wider than usual by this factor."""
        return self._crossing(LEVELS[place], wider * REACHES[place]) if self._settles else NOT_KNOWN

    def _crossing(self, level: float, reach: float) -> TimeResult:
        """Time at which the local parabola reaches the level; it is laid once more about the time first found."""
        at_s, half_s = self._dead_s - self._lag_s * math.log1p(-level), reach * self._lag_s
        for last in (False, True):
            samples = self._local(at_s, half_s)
            if samples is None:
                return self._too_coarse(at_s)
            chosen, time_s, share = samples
            columns = np.vander(time_s - at_s, 3, increasing=True)
            inverse = np.linalg.pinv(columns)
            height, slope, bend = inverse @ share
            if not slope > 0.0:
                return NOT_KNOWN
            move_s = _root(height - level, slope, bend)
            if abs(move_s) > half_s:
                return NOT_KNOWN
            if last:
                weights = np.array([1.0, move_s, move_s**2]) @ inverse / (slope + 2.0 * bend * move_s)
                return self._with_errors(at_s + move_s, chosen, weights, share - columns @ (inverse @ share))
            at_s += move_s
        return NOT_KNOWN

    def _local(self, at_s: float, half_s: float) -> tuple[list[BoolArray], FloatArray, FloatArray] | None:
        """Samples around a time: which of each record, their times and shares; None where there are too few.

        No sample from before the end of the dead time is among them: there the response has a corner.
        """
        records = self._group.records
        for _ in range(TIMES_WIDER):
            low_s = max(at_s - half_s, self._dead_s)
            chosen = [(record.time_s >= low_s) & (record.time_s <= at_s + half_s) for record in records]
            time_s = np.concatenate([one.time_s[rows] for one, rows in zip(records, chosen, strict=True)])
            if len(np.unique(np.round(time_s / (0.05 * self._group.sample_s)))) >= FEWEST_PLACES:
                share = np.concatenate([one[rows] for one, rows in zip(self._shares, chosen, strict=True)])
                return chosen, time_s, share
            half_s *= WIDER
        return None

    def _with_errors(
        self, at_s: float, chosen: Sequence[BoolArray], weights: FloatArray, rest: FloatArray
    ) -> TimeResult:
        """The time with its standard error, and the correction for the sensor's filter.

        Args:
            at_s: the time (s).
            chosen: which samples of each record the parabola is laid through.
            weights: of their shares in the time, s (k,).
            rest: what the parabola leaves of their shares (k,).
        """
        group, first = self._group, 0
        influences, variances = [], []
        for record, lines, shares, rows in zip(group.records, self._lines, self._shares, chosen, strict=True):
            count = int(np.count_nonzero(rows))
            own = np.zeros(len(record.time_s))
            own[rows] = weights[first : first + count]
            influences.append([-float(own[rows] @ rest[first : first + count])])
            variances.append([self._noise.variance_of(lines.spread(own, shares))])
            first += count
        total = np.array([[sum(variance[0] for variance in variances)]])
        widened, _, quantile = _with_scatter(total, np.array(influences), np.array(variances))
        std_s = math.sqrt(float(widened[0, 0]))
        return group.result(at_s - self._filter_s(at_s), std_s, quantile, absolute=True)

    def _filter_s(self, at_s: float) -> float:
        """By how much the sensor's filter moves the crossing at this time (s), for the fitted lag."""
        bandwidth_Hz = self._group.seen.bandwidth_Hz
        if bandwidth_Hz is None:
            return 0.0
        reached = float(filtered_lag(np.array([at_s]), self._dead_s, self._lag_s, bandwidth_Hz)[0])
        if not 0.0 < reached < 1.0:
            return 0.0
        return at_s - (self._dead_s - self._lag_s * math.log1p(-reached))

    def _too_coarse(self, at_s: float) -> TimeResult:
        """Too few samples around a crossing: it is faster than the samples show."""
        return TimeResult(state=State.FASTER, limit_s=max(at_s, 0.0) + self._group.sample_s)

    def area(self) -> tuple[float, float]:
        """Mean delay: integral of 1 - r from the origin to the settled end (s), and its standard error.

        It is additive: the delay of a chain is the sum of the delays of its parts, whatever their shapes.
        """
        delays, variances = [], []
        if not self._settles:
            return math.nan, math.nan
        for record, lines, shares in zip(self._group.records, self._lines, self._shares, strict=True):
            inside = (record.time_s >= 0.0) & (record.time_s <= self.settled_s)
            if np.count_nonzero(inside) < FEWEST_BEFORE:
                return math.nan, math.nan
            time_s = record.time_s[inside]
            widths = np.zeros(len(time_s))
            gaps = np.diff(time_s)
            widths[:-1] += 0.5 * gaps
            widths[1:] += 0.5 * gaps
            widths[0] += 0.5 * time_s[0]
            own = np.zeros(len(record.time_s))
            own[inside] = widths
            delays.append(float(widths @ (1.0 - shares[inside])) + 0.5 * float(time_s[0]))
            variances.append(self._noise.variance_of(lines.spread(own, shares)))
        count = len(delays)
        std_s = math.sqrt(sum(variances)) / count
        if count >= 4:
            std_s = max(std_s, float(np.std(delays, ddof=1)) / math.sqrt(count))
        # The trapezoid cuts the corner at the end of the dead time.
        return float(np.mean(delays)), math.hypot(std_s, self._group.sample_s**2 / (12.0 * self._lag_s))


def _root(height: float, slope: float, bend: float) -> float:
    """The root nearest to 0 of height + slope x + bend x^2; of the line where the parabola has none."""
    inside = slope**2 - 4.0 * bend * height
    if abs(bend) * abs(height) < 1e-12 * slope**2 or inside < 0.0:
        return -height / slope
    return -2.0 * height / (slope + math.sqrt(inside))


def onsets(records: Sequence[Record]) -> tuple[FloatArray, float] | None:
    """When each record leaves its level, by one lag that is common to all of them.

    For a quantity with constant levels whose step was commanded at an unknown time.

    Args:
        records: one for each step; time 0 is near the step.

    Returns:
        The instants (n,), s, and their mean standard error (s); None where no lag describes the records, or the lag is
        shorter than the interval of the samples.
    """
    group = _Group(records, Seen(drifts=False))
    first = group.fitted()
    count = len(records)
    start = np.concatenate((np.full(count, float(first[0])), [float(first[1])]))

    def residuals(theta: FloatArray) -> FloatArray:
        return np.concatenate(group.rest(theta[:-1].tolist(), math.exp(float(theta[-1]))))

    scale = np.append(np.full(count, group.sample_s), 0.2)
    solved = optimize.least_squares(residuals, start, x_scale=scale, max_nfev=30)
    power = 2.0 * float(solved.cost) / max(1, group.count - 3 * count - 1)
    slopes = np.asarray(solved.jac, np.float64)
    covariance = power * np.linalg.pinv(slopes.T @ slopes)
    std_s = math.sqrt(float(np.mean(np.diag(covariance)[:-1])))
    # Between two samples, the instant and the lag cannot be distinguished.
    resolved = math.exp(float(solved.x[-1])) >= group.sample_s
    known = resolved and np.all(np.isfinite(solved.x)) and std_s < 0.5 * group.sample_s
    return (np.asarray(solved.x[:-1]), std_s) if known else None

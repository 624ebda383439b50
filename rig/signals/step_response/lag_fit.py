"""Fit of one or two lags with dead time to the records of a group.

y = a + b t + (D + c t) s(t), with s the response of the lags from the end of the dead time on, seen through the
sensor's filter. Variable projection: a, b, D and c of each record are linear and are eliminated; dead time and lags are
common to all records of a group.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import optimize, stats

from rig.signals.arrays import FloatArray
from rig.signals.step_response.lags import Lags, lags_to
from rig.signals.step_response.lines import Lines
from rig.signals.step_response.noise import Noise, noise_of, with_scatter
from rig.signals.step_response.records import Record, Seen, drift_columns

SETTLING_SHARE = -math.expm1(-4.0)
"""Share of the step after which the response counts as settled; 4 time constants of one lag."""
COURSE_SHARE = -math.expm1(-3.0)
"""Share of the step up to which samples show the course of the response; 3 time constants of one lag."""
FASTEST_OF_WINDOW = 1e-4
HIGHEST_PRODUCT = 1.0
"""Of two lags; the damping ratio is 0.5 there and the response overshoots by 16 %."""
PRODUCT_STARTS = (0.06, 0.2)
SPLIT = 1.5
"""By how much the dead time of a single lag is longer than that of two, in products of the lags over their sum."""
FEWEST_FOR_TWO = 8
"""Samples of all records on the course of the response; with fewer, two lags are not distinguished from one."""
SCREENED = 1.0
"""Least gain by a linear step, in variances of the noise, for which two lags are fitted at all."""
FEWEST_AFTER = 6
NOISE_FREE = 1e-6
"""Noise of so small a share of the step is rounding."""
PRODUCT, PRODUCT_STEP = 2, 0.01
"""Place of the product among the parameters, and its step for numeric derivatives."""


class Group:
    """Records of one group with what is derived from them."""

    def __init__(self, records: Sequence[Record], seen: Seen) -> None:
        self.records, self.seen = records, seen
        self.window_s = float(min(record.time_s[-1] for record in records))
        steps_s = np.concatenate([np.diff(record.time_s) for record in records])
        self.sample_s = float(np.median(steps_s))
        self.count = sum(len(record.time_s) for record in records)
        self._time_s = np.concatenate([record.time_s for record in records])
        self._splits = np.cumsum([len(record.time_s) for record in records])[:-1]
        self.columns = [drift_columns(record.time_s, drifts=seen.drifts) for record in records]

    def rest(self, lags: Sequence[Lags]) -> list[FloatArray]:
        """What the best a, b, D and c leave of each record, each with its lags."""
        return self._rest([self.seen_of(one, record.time_s) for one, record in zip(lags, self.records, strict=True)])

    def rest_of(self, lags: Lags) -> list[FloatArray]:
        """What the best a, b, D and c leave of each record with the same lags."""
        return self._rest(np.split(self.seen_of(lags, self._time_s), self._splits))

    def _rest(self, shapes: Sequence[FloatArray]) -> list[FloatArray]:
        left = []
        for record, drift, shape in zip(self.records, self.columns, shapes, strict=True):
            basis, _ = np.linalg.qr(np.hstack((drift, drift * shape[:, None])))
            left.append(record.value - basis @ (basis.T @ record.value))
        return left

    def design(self, place: int, lags: Lags) -> FloatArray:
        """Columns of a, b, D and c for a record, (n, 4) or (n, 2)."""
        drift = self.columns[place]
        return np.column_stack((drift, drift * self.seen_of(lags, self.records[place].time_s)[:, None]))

    def seen_of(self, lags: Lags, time_s: FloatArray) -> FloatArray:
        """Share of the step at these times (n,), through the sensor's filter."""
        return lags.reached(time_s, self.seen.bandwidth_Hz)

    def inside(self, begin_s: float, end_s: float) -> int:
        """Samples of all records between two times (s)."""
        return int(np.count_nonzero((self._time_s >= begin_s) & (self._time_s <= end_s)))

    @property
    def resolution(self) -> float:
        """Smallest difference of two values that differ."""
        steps = np.diff(np.unique(np.concatenate([record.value for record in self.records])))
        return float(np.min(steps)) if len(steps) else 0.0

    def gap_s(self, begin_s: float, end_s: float) -> float:
        """Interval between the last sample before a time and the first one after another (s)."""
        times_s = self._time_s
        before, after = times_s[times_s < begin_s], times_s[times_s > end_s]
        return float(np.min(after) - np.max(before)) if len(before) and len(after) else self.sample_s


def lags_of(theta: FloatArray) -> Lags:
    """Lags by the parameters: dead time (s), logarithm of the sum of the lags, and their product for two lags."""
    return Lags(float(theta[0]), math.exp(float(theta[1])), float(theta[2]) if len(theta) > 2 else 0.0)


@dataclass(frozen=True)
class LagFit:
    """A fit with its errors.

    Attributes:
        theta: (p,) parameters, see `lags_of`; p = 2 for one lag, 3 for two.
        covariance: (p, p) of them.
        scatters: whether the records scatter by more than their noise explains.
        quantile: standard errors of a half 95 % interval.
        noise: of the samples.
        residuals: of each record (n,).
    """

    theta: FloatArray
    covariance: FloatArray
    scatters: bool
    quantile: float
    noise: Noise
    residuals: list[FloatArray]

    @property
    def lags(self) -> Lags:
        """Dead time and lags."""
        return lags_of(self.theta)

    @property
    def order(self) -> int:
        """Number of lags."""
        return len(self.theta) - 1

    def std(self, gradient: FloatArray) -> float:
        """Standard error of a quantity with this gradient over the parameters (p,)."""
        return math.sqrt(max(0.0, float(gradient @ self.covariance @ gradient)))

    def level_gradient(self, level: float) -> FloatArray:
        """Gradient (p,) of the time to a level: d + T f(p)."""
        lags = self.lags
        slopes = [1.0, lags.total_s * lags_to(level, lags.product)]
        if self.order == 2:
            low, high = max(0.0, lags.product - PRODUCT_STEP), lags.product + PRODUCT_STEP
            slopes.append(lags.total_s * (lags_to(level, high) - lags_to(level, low)) / (high - low))
        return np.array(slopes)

    def tail_shift(self, at_s: float) -> Lags:
        """The lags one standard error away in the direction that most changes what is left of the step at a time."""
        at = np.array([at_s])
        slopes = np.array([
            float(high.reached(at)[0] - low.reached(at)[0]) / apart
            for high, low, apart in _differences(self.theta, self.lags.total_s)
        ])
        change = self.covariance @ slopes / max(self.std(slopes), 1e-300)
        moved = self.theta + np.clip(change, -0.4, 0.4)
        if self.order == 2:
            moved[2] = min(max(moved[2], 0.0), HIGHEST_PRODUCT)
        return lags_of(moved)


def _differences(theta: FloatArray, least_s: float) -> Iterator[tuple[Lags, Lags, float]]:
    """Lags above and below these parameters, one parameter after the other, and by how much it differs between both.

    Args:
        theta: (p,).
        least_s: the shortest time in the response (s).
    """
    for place, step in enumerate((0.02 * least_s, 0.02, PRODUCT_STEP)[: len(theta)]):
        high, low = theta.copy(), theta.copy()
        high[place] += step
        low[place] = max(0.0, low[place] - step) if place == PRODUCT else low[place] - step
        yield lags_of(high), lags_of(low), float(high[place] - low[place])


def fit_one_lag(group: Group) -> LagFit:
    """Dead time and one lag, by least squares from several starts.

    The sum of squares has a separate minimum wherever the dead time passes a sample, so that starts are spread over the
    intervals of the sampling.
    """
    first = _guess(group)
    shift_s = min(group.sample_s, 0.5 * math.exp(first[1]))
    coarse = math.exp(first[1]) < 2.0 * group.sample_s
    starts = [
        first + np.array([shift * shift_s, stretch]) for shift in (-0.5, 0.0, 0.5) if coarse or shift == 0.0
        for stretch in ((-0.7, 0.0) if coarse else (0.0,))
    ]
    return _errors(group, _solved(group, starts))


def fit_two_lags(group: Group, one: LagFit) -> LagFit | None:
    """Dead time and two lags, from a fit of one lag; None where too few samples show the course of the response."""
    lags = one.lags
    if group.inside(lags.dead_s, lags.time_to_s(COURSE_SHARE)) < FEWEST_FOR_TWO:
        return None
    # A linear step from one lag: most plants with one lag are decided by it.
    left = np.concatenate(one.residuals)
    shifted = _differences(np.append(one.theta, 0.0), min(group.sample_s, lags.total_s))
    slopes = np.column_stack([np.concatenate(group.rest_of(high)) - left for high, _, _ in shifted])
    basis, _ = np.linalg.qr(slopes)
    if float(np.sum((basis.T @ left) ** 2)) < SCREENED * one.noise.variance:
        return None
    starts = []
    for product in PRODUCT_STARTS:
        moved_s = SPLIT * product * lags.total_s
        starts.append(np.array([lags.dead_s - moved_s, math.log(lags.total_s + moved_s), product]))
    return _errors(group, _solved(group, starts))


def gain_of(one: LagFit, two: LagFit) -> float:
    """By how much the sum of squares is smaller with two lags, over what noise alone takes off on average.

    The square of a standard normal variable where there is one lag; the autocorrelation of the noise along the
    difference of both fits is taken into account.
    """
    taken = sum(float(a @ a) - float(b @ b) for a, b in zip(one.residuals, two.residuals, strict=True))
    apart = [a - b for a, b in zip(one.residuals, two.residuals, strict=True)]
    power = sum(float(rest @ rest) for rest in apart)
    if not power > 0.0:
        return 0.0
    expected = sum(two.noise.variance_of(rest) for rest in apart) / power
    return taken / expected if expected > 0.0 else math.inf


def describes(group: Group, fit: LagFit) -> bool:
    """Whether the fit leaves no more around the response than before it and after it (F test at 1 %)."""
    change = max(float(np.ptp(record.value)) for record in group.records)
    begin_s, end_s = fit.lags.dead_s - group.sample_s, fit.lags.time_to_s(SETTLING_SHARE)
    inside, outside, counts = 0.0, 0.0, [0, 0]
    for record, rest in zip(group.records, fit.residuals, strict=True):
        near = (record.time_s > begin_s) & (record.time_s < end_s)
        inside += float(rest[near] @ rest[near])
        outside += float(rest[~near] @ rest[~near])
        counts[0] += int(np.count_nonzero(near))
        counts[1] += int(np.count_nonzero(~near))
    if min(counts) < FEWEST_AFTER or outside <= counts[1] * (NOISE_FREE * change) ** 2:
        return True
    ratio = (inside / counts[0]) / (outside / counts[1])
    return bool(ratio < stats.f.ppf(0.99, *counts))


def step_size(group: Group, fit: LagFit) -> tuple[float, float]:
    """Mean change of the quantity at the step (t = 0), and its standard error."""
    sizes, variance = [], 0.0
    for place, record in enumerate(group.records):
        inverse = np.linalg.pinv(group.design(place, fit.lags))
        row = np.asarray(inverse[group.columns[place].shape[1]], np.float64)
        sizes.append(float(row @ record.value))
        variance += fit.noise.variance_of(row)
    return float(np.mean(sizes)), math.sqrt(variance) / len(sizes)


def _solved(group: Group, starts: Sequence[FloatArray]) -> FloatArray:
    """The best parameters from these starts."""
    size = len(starts[0])
    low = np.array([-group.window_s, math.log(FASTEST_OF_WINDOW * group.window_s), 0.0])[:size]
    high = np.array([group.window_s, math.log(group.window_s), HIGHEST_PRODUCT])[:size]
    scale = np.array([group.sample_s, 0.2, 0.1])[:size]

    def off(theta: FloatArray) -> FloatArray:
        return np.concatenate(group.rest_of(lags_of(theta)))

    best: tuple[float, FloatArray] | None = None
    for start in starts:
        solved = optimize.least_squares(
            off, np.clip(start, low + 1e-9, high - 1e-9), bounds=(low, high), x_scale=scale,
            diff_step=np.full(size, 1e-4), xtol=1e-7, ftol=1e-9, max_nfev=40,
        )
        if best is None or solved.cost < best[0]:
            best = float(solved.cost), np.asarray(solved.x)
    return starts[0] if best is None else best[1]


def _errors(group: Group, theta: FloatArray) -> LagFit:
    """The fit with noise and covariance by what it leaves."""
    residuals = group.rest_of(lags_of(theta))
    noise = noise_of(residuals, len(group.records) * 2 * group.columns[0].shape[1] + len(theta))
    slopes = []
    for high, low, apart in _differences(theta, min(group.sample_s, math.exp(theta[1]))):
        above, below = group.rest_of(high), group.rest_of(low)
        slopes.append([(up - down) / apart for up, down in zip(above, below, strict=True)])
    jacobians = [np.column_stack(several) for several in zip(*slopes, strict=True)]
    size = len(theta)
    inverse = np.linalg.pinv(sum((one.T @ one for one in jacobians), np.zeros((size, size))))
    # Influence of each record on the parameters, and the variance that its noise gives it.
    influences = np.array([-inverse @ (one.T @ left) for one, left in zip(jacobians, residuals, strict=True)])
    own = [noise.covariance_of(inverse @ one.T) for one in jacobians]
    variances = np.array([np.diag(one) for one in own])
    return LagFit(
        theta, *with_scatter(sum(own, np.zeros((size, size))), influences, variances), noise, residuals
    )


def _guess(group: Group) -> FloatArray:
    """First guess from the times to 28 and 63 % (Smith): T = 1.5 (t63 - t28), d = t63 - T."""
    times, shares = [], []
    for record in group.records:
        lines = Lines(record, 0.5 * group.window_s, np.ones(len(record.time_s)), drifts=group.seen.drifts)
        times.append(record.time_s)
        shares.append(lines.share)
    time_s, share = np.concatenate(times), np.concatenate(shares)
    order = np.argsort(time_s)
    time_s, share = time_s[order], share[order]
    after = time_s >= 0.0
    width = max(3, len(group.records))
    smooth = np.convolve(share, np.ones(width) / width, mode="same")

    def reached_s(level: float) -> float:
        beyond = np.flatnonzero(after & (smooth >= level))
        return float(time_s[beyond[0]]) if len(beyond) else 0.5 * group.window_s

    low_s, high_s = reached_s(0.28), reached_s(0.632)
    lag_s = max(1.5 * (high_s - low_s), 0.25 * group.sample_s, 2.0 * FASTEST_OF_WINDOW * group.window_s)
    return np.array([high_s - lag_s, math.log(lag_s)])

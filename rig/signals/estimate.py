"""Values with their standard deviations: pooled, compared with a tolerance, laid over time and current.

Whether a zero moves while a campaign runs is told from its value at each point: with time (drift), or with the coil's
current (crosstalk). Where the points' order does not tell the two apart, each is what would explain everything alone.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.rounding import places_of, rounded

PROBABLE = 2.0
"""Standard deviations."""
OUTLYING = 6.0
"""Standard deviations."""
MOST_OUTLYING = 1.0 / 3.0
SCATTER_FACTOR = math.log(2.0)
"""Standard deviation of the logarithm of a population's scatter, before it is measured: a factor of 2 ..."""
SCATTER_REACH, SCATTERS = math.log(64.0), 61
"""... looked for within this logarithm on either side, in so many steps."""
COLLINEAR = 0.98
"""Points whose time and current rise together so closely cannot tell drift from crosstalk."""
FEWEST_FOR_BOTH = 4


@dataclass(frozen=True)
class Estimate:
    """A value and its standard deviation."""

    value: float
    std: float

    @property
    def known(self) -> bool:
        """Whether it says anything."""
        return math.isfinite(self.value) and math.isfinite(self.std) and self.std >= 0.0

    @property
    def signed(self) -> str:
        """`+5.00 +- 0.08`."""
        return f"{'' if self.alone.startswith('-') else '+'}{self.plain}"

    @property
    def plain(self) -> str:
        """`2.00 +- 0.08`, a minus where there is one."""
        return f"{self.alone} +- {rounded(self.std, self._places) if math.isfinite(self.std) else self.std}"

    @property
    def alone(self) -> str:
        """The value without its deviation, with no more digits than that lets be known."""
        return rounded(self.value, self._places) if math.isfinite(self.value) else f"{self.value}"

    @property
    def _places(self) -> int:
        """Decimal places that the deviation lets be known."""
        return places_of(self.std) if math.isfinite(self.std) and self.std > 0.0 else 2

    def times(self, factor: float) -> Estimate:
        """The same in another unit, or over a span."""
        return Estimate(self.value * factor, abs(factor) * self.std if math.isfinite(self.std) else math.inf)

    def widened(self, floor: float) -> Estimate:
        """The same with at least so much doubt."""
        return Estimate(self.value, math.hypot(self.std, floor))

    def beyond(self, nominal: float, tolerance: float, k: float) -> bool:
        """Whether it certainly differs from the nominal value, and very probably by more than a tolerance.

        Args:
            nominal: what it should be.
            tolerance: what it may differ by.
            k: standard deviations that make a difference certain.
        """
        apart = abs(self.value - nominal)
        return self.known and apart > tolerance + PROBABLE * self.std and apart > k * self.std


def pooled(estimates: Iterable[Estimate]) -> Estimate | None:
    """Weighted mean, its deviation widened when the estimates scatter more than they say; None without any."""
    known = [estimate for estimate in estimates if estimate.known and estimate.std > 0.0]
    if not known:
        return None
    weights = [estimate.std**-2 for estimate in known]
    mean = math.fsum(w * estimate.value for w, estimate in zip(weights, known, strict=True)) / math.fsum(weights)
    chi = math.fsum(w * (estimate.value - mean) ** 2 for w, estimate in zip(weights, known, strict=True))
    widening = max(1.0, chi / (len(known) - 1)) if len(known) > 1 else 1.0
    return Estimate(mean, math.sqrt(widening / math.fsum(weights)))


def next_member(estimates: Sequence[Estimate], scatter: float) -> Estimate:
    """What is known of one more member of a population by estimates of some: random effects.

    `value_i = mean + effect_i + error_i`. The standard deviation of the effects is integrated over: a log-normal prior,
    times what the estimates say of it. So one estimate is worth no more than `scatter`, and members that differ by more
    than they state widen the answer.

    Args:
        estimates: (n,) of members, n >= 1, finite, `std` > 0.
        scatter: median of the prior of the effects' standard deviation, > 0.
    """
    values, variances = np.array([e.value for e in estimates]), np.array([e.std**2 for e in estimates])
    logs = np.linspace(-SCATTER_REACH, SCATTER_REACH, SCATTERS)
    effects = (scatter * np.exp(logs)) ** 2
    weights = 1.0 / (variances + effects[:, None])
    means_var = 1.0 / np.sum(weights, axis=1)
    means = means_var * (weights @ values)
    chi = np.sum(weights * (values - means[:, None]) ** 2, axis=1)
    likely = 0.5 * (np.sum(np.log(weights), axis=1) + np.log(means_var) - chi - (logs / SCATTER_FACTOR) ** 2)
    share = np.exp(likely - np.max(likely))
    share /= np.sum(share)
    mean = float(share @ means)
    return Estimate(mean, math.sqrt(float(share @ (means_var + effects + (means - mean) ** 2))))


def outlying(estimates: Mapping[str, Estimate]) -> frozenset[str]:
    """Names of the estimates that are certainly not of what most of the others are of; none among fewer than three.

    A property of an instrument does not change from point to point: an estimate far from the weighted median of all is
    a failed one, unless there are many of them.
    """
    known = {name: estimate for name, estimate in estimates.items() if estimate.known and estimate.std > 0.0}
    if len(known) < 3:
        return frozenset()
    ordered = sorted(known.values(), key=lambda estimate: estimate.value)
    half = 0.5 * math.fsum(1.0 / estimate.std for estimate in ordered)
    reached, median = 0.0, ordered[-1]
    for estimate in ordered:
        reached += 1.0 / estimate.std
        if reached >= half:
            median = estimate
            break
    far = {
        name for name, estimate in known.items()
        if abs(estimate.value - median.value) > OUTLYING * math.hypot(estimate.std, median.std)
    }
    return frozenset(far) if len(far) <= MOST_OUTLYING * len(known) else frozenset()


UNKNOWN = Estimate(0.0, float("inf"))


@dataclass(frozen=True)
class ZeroSeen:
    """The load cell's offset (N) at one point: when it began (s), and at what current of the coil (A)."""

    time_s: float
    current_A: float
    offset_N: Estimate


@dataclass(frozen=True)
class ZeroChange:
    """How the zero moved over a campaign.

    Attributes:
        drift_N_s: per second; `crosstalk_N_A` per ampere of the coil.
        over_time_N, over_current_N: what that makes between the first and the last point, and between the smallest and
            the largest current (N).
        separable: whether the points separate the two; else each is what explains all alone.
    """

    drift_N_s: Estimate
    crosstalk_N_A: Estimate
    over_time_N: Estimate
    over_current_N: Estimate
    separable: bool

    def moved(self, tolerance_N: float, k: float) -> tuple[bool, bool]:
        """Whether it certainly moved by more than a tolerance with time, and with the current."""
        drift, crosstalk = (change.beyond(0.0, tolerance_N, k) for change in (self.over_time_N, self.over_current_N))
        return drift, crosstalk


def zero_changes(seen: Sequence[ZeroSeen], floor_N: float) -> tuple[ZeroChange, ...]:
    """The zero over time and current: both together where the points allow it, and each alone (the last).

    Args:
        seen: the points that tell an offset.
        floor_N: what no offset is known better than (one standard deviation).

    Returns:
        Nothing for fewer than two points.
    """
    known = [point for point in seen if point.offset_N.known]
    if len(known) < 2:
        return ()
    time_s = np.array([point.time_s for point in known])
    current_A = np.array([point.current_A for point in known])
    offset_N = np.array([point.offset_N.value for point in known])
    std_N = np.array([point.offset_N.widened(floor_N).std for point in known])
    (drift,), (crosstalk,) = (_slopes((column,), offset_N, std_N) for column in (time_s, current_A))
    alone = _change(drift, crosstalk, time_s, current_A, separable=False)
    both_vary = len(known) >= FEWEST_FOR_BOTH and np.ptp(time_s) > 0.0 and np.ptp(current_A) > 0.0
    if not both_vary or abs(float(np.corrcoef(time_s, current_A)[0, 1])) > COLLINEAR:
        return (alone,)
    drift, crosstalk = _slopes((time_s, current_A), offset_N, std_N)
    return (_change(drift, crosstalk, time_s, current_A, separable=True), alone)


def _change(
    drift: Estimate, crosstalk: Estimate, time_s: FloatArray, current_A: FloatArray, *, separable: bool,
) -> ZeroChange:
    long_s, wide_A = float(np.ptp(time_s)), float(np.ptp(current_A))
    over_time_N = drift.times(long_s) if long_s > 0.0 else UNKNOWN
    over_current_N = crosstalk.times(wide_A) if wide_A > 0.0 else UNKNOWN
    return ZeroChange(drift, crosstalk, over_time_N, over_current_N, separable)


def _slopes(columns: Sequence[FloatArray], values: FloatArray, std: FloatArray) -> list[Estimate]:
    """Weighted least squares with a constant; what the residuals scatter beyond `std` widens the deviations."""
    spans = [float(np.ptp(column)) for column in columns]
    if not all(span > 0.0 for span in spans):
        return [UNKNOWN] * len(columns)
    scaled = [(column - np.mean(column)) / span for column, span in zip(columns, spans, strict=True)]
    design = np.column_stack((np.ones(len(values)), *scaled)) / std[:, None]
    solution, *_ = np.linalg.lstsq(design, values / std, rcond=None)
    rest = values / std - design @ solution
    freedom = len(values) - design.shape[1]
    widening = max(1.0, float(rest @ rest) / freedom) if freedom > 0 else 1.0
    deviations = np.sqrt(widening * np.diag(np.linalg.inv(design.T @ design)))
    return [
        Estimate(float(solution[i + 1]) / span, float(deviations[i + 1]) / span) for i, span in enumerate(spans)
    ]

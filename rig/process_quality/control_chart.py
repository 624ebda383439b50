"""Control charts for individual values and their moving ranges, with the Western Electric rules.

Limits are determined from the values of phase I and then judge all values (phase II). Values of phase I beyond the
limits are removed from the limits, one round after the other, because a single disturbance would widen them.

Sources: D. C. Montgomery, Introduction to Statistical Quality Control, 6.4 and 5.3.4; Western Electric, Statistical
Quality Control Handbook, 1956; ISO 7870-2. Constants for moving ranges of two values: d2 = 1.128, D4 = 3.267.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.fits.plain import plain
from rig.signals.arrays import FloatArray

D2 = 2.0 / math.sqrt(math.pi)
"""Mean range of two values of a normal distribution over its standard deviation: 1.128."""
D4 = 1.0 + 3.0 * math.sqrt(2.0 * (1.0 - 2.0 / math.pi)) / D2
"""Upper limit of the moving range over its mean: 3.267."""
FEWEST = 8
"""Values of phase I below which there are no limits: the standard deviation would be known to less than 30 %."""
ADVISED = 20
"""Values of phase I from which limits are reliable."""
USUAL_BASELINE = 25
MOST_ROUNDS = 10
MOST_REMOVED = 0.2
"""Share of phase I that may be removed; beyond it, the process was not in control and has no limits of its own."""
RESOLUTION = 1e-6
"""Share of a value below which a difference is no measurement: a sensor with 20 bits at its full range."""
CORRELATED = 2.0
"""Standard errors of the lag-1 autocorrelation from which values are not independent."""


class Rule(StrEnum):
    """A Western Electric rule; the value is its key in JSON."""

    BEYOND = "beyond-3-sigma"
    TWO_OF_THREE = "2-of-3-beyond-2-sigma"
    FOUR_OF_FIVE = "4-of-5-beyond-1-sigma"
    EIGHT = "8-on-one-side"
    RANGE = "moving-range"

    @property
    def words(self) -> str:
        """The rule in words."""
        return WORDS[self]


WORDS = {
    Rule.BEYOND: "1 value beyond 3 sigma",
    Rule.TWO_OF_THREE: "2 of 3 consecutive values beyond 2 sigma on the same side",
    Rule.FOUR_OF_FIVE: "4 of 5 consecutive values beyond 1 sigma on the same side",
    Rule.EIGHT: "8 consecutive values on the same side of the centre line",
    Rule.RANGE: "difference from the previous value beyond the limit of the moving range",
}
ZONES = ((Rule.TWO_OF_THREE, 2, 3, 2.0), (Rule.FOUR_OF_FIVE, 4, 5, 1.0), (Rule.EIGHT, 8, 8, 0.0))
"""Rule, number of values beyond the zone, number of successive values, zone in standard deviations."""


class TooFewValues(ValueError):
    """A statistic needs more values than there are; the message states both numbers."""


@dataclass(frozen=True)
class Violation:
    """Value number `index` (from 0) violates a rule; `side` is +1 (above), -1 (below) or 0 (moving range)."""

    index: int
    rule: Rule
    side: int


@dataclass(frozen=True)
class ControlChart:
    """Individuals and moving-range chart.

    Attributes:
        values: individual values in the order of time, (n,); NaN in phase II where there is no value.
        baseline: number of the first values, which belong to phase I.
        removed: indices of values of phase I that were removed from the limits.
        centre: mean of phase I.
        sigma: standard deviation from the mean moving range of phase I.
        mean_range: mean moving range of phase I.
        violations: in the order of the values.
        autocorrelation: of lag 1, of phase I; NaN if unknown.
        remarks: what must be known before the limits are believed.
    """

    values: FloatArray
    baseline: int
    removed: tuple[int, ...]
    centre: float
    sigma: float
    mean_range: float
    violations: tuple[Violation, ...]
    autocorrelation: float = math.nan
    remarks: tuple[str, ...] = field(default=())

    @property
    def limits(self) -> tuple[float, float]:
        """Lower and upper control limit of individual values."""
        return self.centre - 3.0 * self.sigma, self.centre + 3.0 * self.sigma

    @property
    def range_limit(self) -> float:
        """Upper control limit of the moving range."""
        return D4 * self.mean_range

    @property
    def ranges(self) -> FloatArray:
        """Moving ranges, (n - 1,)."""
        return np.abs(np.diff(self.values))

    @property
    def signals(self) -> tuple[Violation, ...]:
        """Violations in phase II; those of phase I are in the remarks and in `violations`."""
        return tuple(one for one in self.violations if one.index >= self.baseline)

    @property
    def in_control(self) -> bool:
        """Whether no rule is violated in phase II (in phase I, if there are no further values)."""
        return not (self.signals if len(self.values) > self.baseline else self.violations)

    def continued(self, values: FloatArray) -> ControlChart:
        """The chart of more values with the same limits.

        Args:
            values: those of phase I, then the further ones, (n,); NaN where there is no value.
        """
        violations = violations_of(values, self.centre, self.sigma, self.mean_range)
        return replace(self, values=values, violations=violations)

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        low, high = self.limits
        return {
            "values": plain(self.values.tolist()),
            "baseline": self.baseline, "removed": list(self.removed),
            "centre": self.centre, "sigma": self.sigma, "lower_limit": low, "upper_limit": high,
            "mean_range": self.mean_range, "range_limit": self.range_limit, "in_control": self.in_control,
            "violations": [{"index": one.index, "rule": str(one.rule), "side": one.side} for one in self.violations],
            "autocorrelation": plain(self.autocorrelation), "remarks": list(self.remarks),
        }  # fmt: skip


def control_chart(
    values: FloatArray, baseline: int | None = None, resolution: float = 0.0, removed_beyond: float = 3.0
) -> ControlChart:
    """Chart of individual values and moving ranges.

    Args:
        values: finite values in the order of time, (n,).
        baseline: number of first values that belong to phase I; None: the first `USUAL_BASELINE`, or all of fewer.
        resolution: smallest sigma, in the values' unit: the standard uncertainty of a value by repeatability, or the
            resolution of its measurement. Smaller differences are not known.
        removed_beyond: values of phase I that are so many sigma from the centre are not part of the limits.

    Raises:
        TooFewValues: phase I has fewer than `FEWEST` values.
        ValueError: a value is not finite.
    """
    values = np.asarray(values, np.float64)
    if not np.all(np.isfinite(values)):
        raise ValueError("control chart: got a value that is not finite")
    count = min(len(values), USUAL_BASELINE if baseline is None else baseline)
    if count < FEWEST:
        raise TooFewValues(f"got {count} values of phase I, expected at least {FEWEST}")
    kept = np.ones(count, bool)
    least = D2 * resolution
    centre, mean_range = _limits(values[:count], kept, least)
    for _ in range(MOST_ROUNDS):
        beyond = kept & (np.abs(values[:count] - centre) > removed_beyond * mean_range / D2)
        if not np.any(beyond) or np.count_nonzero(~kept | beyond) > MOST_REMOVED * count:
            break
        kept &= ~beyond
        centre, mean_range = _limits(values[:count], kept, least)
    sigma = mean_range / D2
    removed = tuple(np.flatnonzero(~kept).tolist())
    correlation = lag_one(values[:count][kept])
    remarks = tuple(_remarks(count, removed, correlation, sigma, floored=0.0 < mean_range <= least))
    return ControlChart(
        values, count, removed, centre, sigma, mean_range, violations_of(values, centre, sigma, mean_range),
        correlation, remarks,
    )  # fmt: skip


def _limits(values: FloatArray, kept: NDArray[np.bool_], least: float) -> tuple[float, float]:
    """Mean, and mean moving range of at least `least`; ranges next to a removed value are left out."""
    ranges = np.abs(np.diff(values))[kept[1:] & kept[:-1]]
    return float(np.mean(values[kept])), max(least, float(np.mean(ranges)) if len(ranges) else 0.0)


def _remarks(
    count: int, removed: tuple[int, ...], correlation: float, sigma: float, *, floored: bool
) -> list[str]:
    remarks = []
    if count < ADVISED:
        share = 100.0 * math.sqrt(moving_range_variance(count))
        remarks.append(f"phase I has only {count} values, so sigma is known to {share:.0f} %; at least {ADVISED} are "
            "advised")
    if removed:
        remarks.append("values of phase I beyond the limits, which the limits do not include: "
            f"{len(removed)} of {count}")
    if floored:
        remarks.append("the values of phase I vary by less than the uncertainty of a value; sigma is the repeatability "
            "of a value, or the resolution of the measurement if that is larger")
    elif sigma == 0.0:
        remarks.append("all values of phase I are equal: every other value is beyond the limits")
    elif abs(correlation) > CORRELATED / math.sqrt(count):
        remarks.append(f"successive values are correlated ({correlation:.2f}); the limits assume independent values "
            "and are therefore too " + ("narrow" if correlation > 0.0 else "wide"))
    return remarks


def violations_of(values: FloatArray, centre: float, sigma: float, mean_range: float) -> tuple[Violation, ...]:
    """Violations of the Western Electric rules, and of the limit of the moving range, in the order of the values.

    A value is reported if it completes a pattern and is itself part of it. The return from a value beyond the limits is
    not reported as a moving range. In time proportional to the number of values.
    """
    deviation = values - centre
    beyond_limits = np.abs(deviation) > 3.0 * sigma
    listed = []
    for side in (1, -1):
        over = side * deviation
        listed += [Violation(index, Rule.BEYOND, side) for index in np.flatnonzero(over > 3.0 * sigma).tolist()]
        for rule, least, of, zone in ZONES:
            beyond = over > zone * sigma
            total = np.concatenate(([0], np.cumsum(beyond)))
            first = np.maximum(np.arange(len(values)) - of + 1, 0)
            complete = beyond & (total[1:] - total[first] >= least)
            listed += [Violation(index, rule, side) for index in np.flatnonzero(complete).tolist()]
    returns = beyond_limits[:-1] & ~beyond_limits[1:]
    far = np.flatnonzero((np.abs(np.diff(values)) > D4 * mean_range) & ~returns) + 1
    listed += [Violation(index, Rule.RANGE, 0) for index in far.tolist()]
    return tuple(sorted(listed, key=lambda one: (one.index, list(Rule).index(one.rule))))


def lag_one(values: FloatArray) -> float:
    """Autocorrelation of lag 1; NaN of fewer than three values, or of equal ones."""
    centred = values - np.mean(values)
    total = float(centred @ centred)
    return float(centred[1:] @ centred[:-1]) / total if len(values) > 2 and total > 0.0 else math.nan


def moving_range_variance(count: int) -> float:
    """Relative variance of the standard deviation from the mean moving range of `count` normal values.

    (0.8264 n - 1.082) / (n - 1)^2, K. C. B. Roes, R. J. M. M. Does, Y. Schurink, J. Quality Technology 25 (1993) 188.
    """
    return (0.8264 * count - 1.082) / (count - 1) ** 2


def moving_range_freedom(count: int) -> float:
    """Degrees of freedom of a chi-squared distribution with this relative variance."""
    return 0.5 / moving_range_variance(count)

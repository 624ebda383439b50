"""Capability of a process and of a measurement: Cp, Cpk, Pp, Ppk, Cg, Cgk, with 95 % intervals.

Sources: ISO 22514-2 and -7; D. C. Montgomery, Introduction to Statistical Quality Control, 8.3; intervals of Cp and Pp
by the chi-squared distribution, of Cpk, Ppk and Cgk by A. F. Bissell, Applied Statistics 39 (1990) 331.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import stats

from rig.fits.plain import plain
from rig.process_quality.control_chart import D2, RESOLUTION, TooFewValues, moving_range_freedom
from rig.signals.arrays import FloatArray

CONFIDENCE = 0.95
FEWEST = 10
"""Values below which an interval of a capability index has no practical use."""
NOT_NORMAL = 0.01
"""Probability of the Shapiro-Wilk test below which values are not taken as normal."""
MOST_TESTED = 5000
"""Values that the Shapiro-Wilk test accepts."""
GAUGE_SHARE = 0.2
"""Share of the tolerance that the spread of a gauge is compared with (Cg)."""
REQUIRED = 1.33
"""Usual requirement for an index."""


@dataclass(frozen=True)
class Index:
    """A capability index and its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Capability:
    """Capability of a process; an index is None if the limits do not define it.

    Attributes:
        count: number of values.
        mean: of the values.
        within: standard deviation from moving ranges (short term).
        overall: standard deviation of all values (long term).
        low, high: specification limits; None: open.
        cp, cpk: by `within`; `pp`, `ppk`: by `overall`.
        normal_p: probability of the Shapiro-Wilk test; NaN if unknown.
        expected_ppm: values outside the limits in a million, by `overall` and a normal distribution.
        outside: number of values outside the limits.
    """

    count: int
    mean: float
    within: float
    overall: float
    low: float | None
    high: float | None
    cp: Index | None
    cpk: Index
    pp: Index | None
    ppk: Index
    normal_p: float
    expected_ppm: float
    outside: int

    @property
    def remarks(self) -> tuple[str, ...]:
        """What must be known before the indices are believed."""
        if self.normal_p < NOT_NORMAL:
            return (f"the values are not normally distributed (Shapiro-Wilk p = {self.normal_p:.2g}), which the "
                    "indices assume",)
        return ()

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {**plain(self), "remarks": list(self.remarks)}


def process_capability(values: FloatArray, low: float | None, high: float | None) -> Capability:
    """Capability of a process for its specification limits.

    Args:
        values: in the order of time, (n,).
        low: lower limit; None: open.
        high: upper limit; None: open.

    Raises:
        TooFewValues: fewer than `FEWEST` values.
        ValueError: no limit, limits in the wrong order, or equal values.
    """
    values = np.asarray(values, np.float64)
    _check(values, low, high)
    count, mean = len(values), float(np.mean(values))
    overall = float(np.std(values, ddof=1))
    within = float(np.mean(np.abs(np.diff(values)))) / D2
    freedoms = (moving_range_freedom(count), float(count - 1))
    both = None if low is None or high is None else high - low
    cp, pp = (
        None if both is None else spread_index(both / (6.0 * std), freedom)
        for std, freedom in zip((within, overall), freedoms, strict=True)
    )
    nearest = min((mean - low if low is not None else math.inf), (high - mean if high is not None else math.inf))
    cpk, ppk = (
        distance_index(nearest / (3.0 * std), count, freedom)
        for std, freedom in zip((within, overall), freedoms, strict=True)
    )
    normal = stats.norm(mean, overall)
    beyond = (0.0 if low is None else float(normal.cdf(low))) + (0.0 if high is None else float(normal.sf(high)))
    outside = int(np.count_nonzero((values < (-math.inf if low is None else low)) |
                                   (values > (math.inf if high is None else high))))  # fmt: skip
    normal_p = float(stats.shapiro(values).pvalue) if count <= MOST_TESTED else math.nan
    return Capability(
        count, mean, within, overall, low, high, cp, cpk, pp, ppk, normal_p, 1e6 * beyond, outside,
    )


def _check(values: FloatArray, low: float | None, high: float | None) -> None:
    """Reject what has no capability.

    Raises:
        TooFewValues: fewer than `FEWEST` values.
        ValueError: no limit, limits in the wrong order, or equal values.
    """
    if low is None and high is None:
        raise ValueError("capability requires a lower or an upper limit")
    if low is not None and high is not None and not low < high:
        raise ValueError(f"got the limits {low:g} and {high:g}, expected the lower limit first")
    if len(values) < FEWEST:
        raise TooFewValues(f"got {len(values)} values, expected at least {FEWEST}")
    if not np.std(values) > RESOLUTION * np.max(np.abs(values)):
        raise ValueError("all values are equal: the resolution of the measurement is too coarse")


def spread_index(value: float, freedom: float) -> Index:
    """Interval of an index that is inversely proportional to a standard deviation with these degrees of freedom."""
    tail = 0.5 * (1.0 - CONFIDENCE)
    low, high = (math.sqrt(float(stats.chi2.ppf(share, freedom)) / freedom) for share in (tail, 1.0 - tail))
    return Index(value, value * low, value * high)


def distance_index(value: float, count: int, freedom: float) -> Index:
    """Interval of an index that is a distance of a mean over three standard deviations (Bissell).

    Args:
        value: the index.
        count: number of values of the mean.
        freedom: degrees of freedom of the standard deviation.
    """
    half = float(stats.norm.ppf(0.5 + 0.5 * CONFIDENCE)) * math.sqrt(1.0 / (9.0 * count) + value**2 / (2.0 * freedom))
    return Index(value, value - half, value + half)


@dataclass(frozen=True)
class GaugeCapability:
    """Capability of a measurement, from repeated measurements of one specimen.

    Attributes:
        count: number of values.
        mean: of the values.
        std: standard deviation of the values.
        tolerance: width of the tolerance.
        reference: reference value; None: unknown.
        cg: repeatability against a fifth of the tolerance.
        cgk: repeatability and bias; None without a reference value.
        bias: mean minus reference; None without a reference value.
        bias_p: probability of such a bias of a gauge without one (t test).
        uncertainty_percent: expanded uncertainty (2 standard uncertainties), doubled, in % of the tolerance; NaN if
            unknown (VDA 5: at most 30 %).
    """

    count: int
    mean: float
    std: float
    tolerance: float
    reference: float | None
    cg: Index
    cgk: Index | None
    bias: float | None
    bias_p: float
    uncertainty_percent: float

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {**plain(self)}


def gauge_capability(
    values: FloatArray, tolerance: float, reference: float | None = None, uncertainty: float = math.nan
) -> GaugeCapability:
    """Cg = 0.2 T / 6 s and Cgk = (0.1 T - |bias|) / 3 s of repeated measurements of one specimen (type-1 study).

    Args:
        values: repeated measurements, (n,).
        tolerance: width T of the tolerance, in the values' unit.
        reference: reference value of the specimen; None: unknown.
        uncertainty: standard uncertainty of a measurement; NaN: unknown.

    Raises:
        TooFewValues: fewer than `FEWEST` values.
        ValueError: the tolerance is not positive, or all values are equal.
    """
    values = np.asarray(values, np.float64)
    if not tolerance > 0.0:
        raise ValueError(f"got the tolerance {tolerance:g}, expected a positive width")
    _check(values, 0.0, None)
    count, mean, std = len(values), float(np.mean(values)), float(np.std(values, ddof=1))
    cg = spread_index(GAUGE_SHARE * tolerance / (6.0 * std), count - 1.0)
    cgk = bias = None
    bias_p = math.nan
    if reference is not None:
        bias = mean - reference
        cgk = distance_index((0.5 * GAUGE_SHARE * tolerance - abs(bias)) / (3.0 * std), count, count - 1.0)
        bias_p = float(stats.ttest_1samp(values, reference).pvalue)
    return GaugeCapability(
        count, mean, std, tolerance, reference, cg, cgk, bias, bias_p, uncertainty_percent(uncertainty, tolerance),
    )


def uncertainty_percent(uncertainty: float, tolerance: float) -> float:
    """Expanded uncertainty (2 standard uncertainties), doubled, in % of the tolerance (VDA 5)."""
    return 100.0 * 2.0 * 2.0 * uncertainty / tolerance

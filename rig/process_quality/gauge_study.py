"""Gauge repeatability and reproducibility by the analysis of variance (AIAG, Measurement Systems Analysis, 4th ed.).

Crossed study: every operator measures every part several times. The interaction of operator and part is pooled with the
repeatability if it is not significant. Of one operator, repeatability and part variation are determined.

The numbers of trials may differ. The sums of squares of parts, operators and interaction are then those of the
unweighted means of the combinations, multiplied by the harmonic mean of the numbers of trials; their expectations are
those of a balanced study with that number of trials, and all values contribute to the repeatability (R. K. Burdick,
F. A. Graybill, Confidence Intervals on Variance Components, 1992, chapter 6). Of a balanced study, both are the same.

Intervals are generalised confidence intervals (M. Hamada, S. Weerahandi, J. Quality Technology 32 (2000) 241; R. K.
Burdick, C. M. Borror, D. C. Montgomery, Design and Analysis of Gauge R&R Studies, 2005): the sums of squares over their
expected mean squares are chi-squared distributed, so draws of these give draws of every function of the variances.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from rig.errors import some
from rig.fits.plain import plain
from rig.process_quality.control_chart import RESOLUTION, TooFewValues
from rig.signals.arrays import FloatArray

POOLED_FROM = 0.05
"""Probability of the interaction's F test from which it is pooled with the repeatability (AIAG MSA 4)."""
STUDY = 6.0
"""Standard deviations of the study variation: 99.73 % of a normal distribution."""
CATEGORIES = 1.41
"""Factor of the number of distinct categories, rounded as in the manual."""
CONFIDENCE = 0.95
DRAWS = 40_000
SEED = 20_000_318
FEWEST_PARTS, FEWEST_TRIALS = 2, 2
ADVISED_PARTS, ADVISED_OPERATORS = 5, 2
GOOD_PERCENT, FAIR_PERCENT = 10.0, 30.0
"""AIAG: %GRR below 10 % is good, above 30 % not acceptable."""
FEWEST_CATEGORIES = 5
MOST_NAMED = 5
"""Missing combinations in a message."""


@dataclass(frozen=True)
class Source:
    """One row of the analysis of variance; F and p are NaN where there is no test."""

    name: str
    freedom: int
    sum_of_squares: float
    mean_square: float
    F: float = math.nan
    p: float = math.nan


@dataclass(frozen=True)
class Component:
    """Standard deviation of one source of variation.

    Attributes:
        std: standard deviation, in the values' unit; its 95 % interval is `low` to `high`.
        contribution_percent: variance in % of the total variance.
        study_percent: standard deviation in % of the total one (%GRR for the gauge), `study_low` to `study_high`.
        tolerance_percent: 6 standard deviations in % of the tolerance, with its interval; NaN without a tolerance.
    """

    std: float
    low: float
    high: float
    contribution_percent: float
    study_percent: float
    study_low: float
    study_high: float
    tolerance_percent: float = math.nan
    tolerance_low: float = math.nan
    tolerance_high: float = math.nan


@dataclass(frozen=True)
class GaugeStudy:
    """Result of a gauge study.

    Attributes:
        parts, operators: size of the study.
        trials: of each combination of part and operator; of an unbalanced study the harmonic mean.
        most_trials, fewest_trials: of any combination.
        count: number of values.
        anova: rows of the analysis of variance, the interaction pooled or not.
        pooled: whether the interaction was pooled with the repeatability; None with one operator.
        components: `gauge`, `repeatability`, `reproducibility`, `operator`, `interaction`, `part`, `total`.
        categories: number of distinct categories (ndc), not rounded, and its 95 % interval.
        tolerance: width of the tolerance; None without one.
        resolved: whether trials of one combination differ by more than the resolution of a measurement.
    """

    parts: int
    operators: int
    trials: float
    fewest_trials: int
    most_trials: int
    count: int
    anova: tuple[Source, ...]
    pooled: bool | None
    components: Mapping[str, Component]
    categories: tuple[float, float, float]
    tolerance: float | None = None
    resolved: bool = True

    @property
    def ndc(self) -> int:
        """Number of distinct categories as the manual states it: rounded down, at least 1."""
        return max(1, math.floor(self.categories[0])) if math.isfinite(self.categories[0]) else 0

    @property
    def remarks(self) -> tuple[str, ...]:
        """What must be known before the result is believed."""
        remarks = []
        if self.fewest_trials < self.most_trials:
            remarks.append(f"the numbers of trials differ ({self.fewest_trials} to {self.most_trials}): unweighted "
                "means are used, so the intervals are approximate")
        if not self.resolved:
            remarks.append("the trials of each combination are equal within the resolution of a measurement, so the "
                "repeatability is not known: %GRR is a lower limit, ndc an upper limit")
        if self.operators == 1:
            remarks.append("one operator: the reproducibility is not known")
        elif self.operators <= ADVISED_OPERATORS + 1:
            remarks.append(f"{self.operators} operators: their variation has {self.operators - 1} degrees of freedom, "
                "so its interval is wide")
        if self.parts < ADVISED_PARTS:
            remarks.append(f"only {self.parts} parts; recommended: at least {ADVISED_PARTS} (10 in the MSA manual)")
        return tuple(remarks)

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {
            "parts": self.parts, "operators": self.operators, "trials": self.trials, "count": self.count,
            "fewest_trials": self.fewest_trials, "most_trials": self.most_trials, "pooled": self.pooled,
            "anova": plain(self.anova), "components": plain(self.components),
            "ndc": self.ndc, "categories": dict(zip(("value", "low", "high"), plain(self.categories), strict=True)),
            "tolerance": self.tolerance, "remarks": list(self.remarks),
        }  # fmt: skip


def gauge_study(values: NDArray[np.float64], tolerance: float | None = None, *, pool: bool | None = None) -> GaugeStudy:
    """Analysis of a crossed study.

    Args:
        values: measured values, shape (parts, operators, trials); NaN where a combination has fewer trials.
        tolerance: width of the tolerance, in the values' unit; None: unknown.
        pool: whether the interaction is pooled; None: if it is not significant.

    Raises:
        TooFewValues: fewer than two parts, or no combination with two trials.
        ValueError: a combination has no value, a value is infinite, all values are equal, or the tolerance is not
            positive.
    """
    values = np.asarray(values, np.float64)
    if values.ndim != 3 or np.any(np.isinf(values)):
        raise ValueError("gauge study: expected finite values of shape (parts, operators, trials)")
    if tolerance is not None and not tolerance > 0.0:
        raise ValueError(f"got the tolerance {tolerance:g}, expected a positive width")
    parts, operators, _ = values.shape
    trials = np.count_nonzero(np.isfinite(values), axis=2)
    if np.any(trials == 0):
        raise ValueError("gauge study: expected at least one finite value of each part and operator")
    most = int(np.max(trials, initial=0))
    if parts < FEWEST_PARTS or most < FEWEST_TRIALS:
        raise TooFewValues(f"number of parts: got {parts}, expected at least {FEWEST_PARTS}; number of trials: got "
            f"{most}, expected at least {FEWEST_TRIALS}. Fix: test several specimens, each several times")
    scale = RESOLUTION * float(np.nanmax(np.abs(values)))
    if not np.nanmax(values) - np.nanmin(values) > scale:
        raise ValueError("all values are equal: the resolution of the measurement is too coarse")
    harmonic = trials.size / float(np.sum(1.0 / trials))
    squares = _sums_of_squares(values, harmonic)
    error = squares["repeatability"]
    resolved = error[0] > error[1] * scale**2
    if not resolved:
        squares["repeatability"] = (error[1] * scale**2, error[1])
    pooled = None
    if operators > 1:
        interaction, error = squares["interaction"], squares["repeatability"]
        ratio = _ratio(interaction, error)
        pooled = bool(stats.f.sf(ratio, interaction[1], error[1]) > POOLED_FROM) if pool is None else pool
        if pooled:
            squares["repeatability"] = (error[0] + interaction[0], error[1] + interaction[1])
            del squares["interaction"]
    means = {name: total / freedom for name, (total, freedom) in squares.items()}
    anova = _anova(squares, "interaction" if "interaction" in squares else "repeatability")
    shape = (parts, operators, harmonic)
    estimates = _variances(means, shape)
    draws = _variances(_drawn(squares), shape)
    components = {name: _component(estimates, draws, name, tolerance) for name in estimates}
    return GaugeStudy(
        parts, operators, round(harmonic) if harmonic == round(harmonic) else harmonic, int(np.min(trials)), most,
        int(np.sum(trials)), anova, pooled, components, _interval_of(
            estimates, draws, lambda one: CATEGORIES * np.sqrt(one["part"] / _positive(one["gauge"]))
        ), tolerance, resolved,
    )  # fmt: skip


Squares = dict[str, tuple[float, int]]
"""Source -> sum of squares and degrees of freedom."""


def _sums_of_squares(values: NDArray[np.float64], trials: float) -> Squares:
    """Sums of squares of the means of the combinations, and those within the combinations.

    Args:
        values: (parts, operators, trials), NaN where there is none.
        trials: of a combination, harmonic mean.
    """
    parts, operators, _ = values.shape
    of_cells = np.nanmean(values, axis=2)
    mean = float(np.mean(of_cells))
    of_parts, of_operators = of_cells.mean(axis=1), of_cells.mean(axis=0)
    error = float(np.nansum((values - of_cells[:, :, None]) ** 2))
    squares = {"part": (operators * trials * float(np.sum((of_parts - mean) ** 2)), parts - 1)}
    if operators > 1:
        rest = of_cells - of_parts[:, None] - of_operators + mean
        squares |= {
            "operator": (parts * trials * float(np.sum((of_operators - mean) ** 2)), operators - 1),
            "interaction": (trials * float(np.sum(rest**2)), (parts - 1) * (operators - 1)),
        }
    return {**squares, "repeatability": (error, int(np.count_nonzero(np.isfinite(values))) - parts * operators)}


def _ratio(one: tuple[float, int], other: tuple[float, int]) -> float:
    mean_square = other[0] / other[1]
    return one[0] / one[1] / mean_square if mean_square > 0.0 else math.inf


def _anova(squares: Squares, error: str) -> tuple[Source, ...]:
    rows = []
    for name, (total, freedom) in squares.items():
        F = p = math.nan
        against = "repeatability" if name == "interaction" else error
        if name != "repeatability":
            F = _ratio(squares[name], squares[against])
            p = float(stats.f.sf(F, freedom, squares[against][1]))
        rows.append(Source(name, freedom, total, total / freedom, F, p))
    return tuple(rows)


Variances = dict[str, Any]
"""Source -> variance: numbers, or arrays of draws."""


def _variances(means: Mapping[str, Any], shape: tuple[int, int, float]) -> Variances:
    """Variance components from mean squares by their expectations; negative ones are 0."""
    parts, operators, trials = shape
    error = means["repeatability"]
    crossed = means.get("interaction", error)
    zero = 0.0 * error
    part = np.maximum((means["part"] - crossed) / (operators * trials), 0.0)
    operator = np.maximum((means["operator"] - crossed) / (parts * trials), 0.0) if "operator" in means else zero
    interaction = np.maximum((crossed - error) / trials, 0.0) if "interaction" in means else zero
    return {
        "gauge": error + operator + interaction, "repeatability": error, "reproducibility": operator + interaction,
        "operator": operator, "interaction": interaction, "part": part,
        "total": error + operator + interaction + part,
    }  # fmt: skip


def _drawn(squares: Squares) -> dict[str, FloatArray]:
    """Draws of the expected mean squares: sums of squares over draws of their chi-squared distributions."""
    random = np.random.default_rng(SEED)
    return {name: total / random.chisquare(freedom, DRAWS) for name, (total, freedom) in squares.items()}


def _positive(value: Any) -> Any:  # noqa: ANN401 - a number or an array
    return np.maximum(value, np.finfo(np.float64).tiny)


def _interval_of(
    estimates: Variances, draws: Variances, function: Callable[[Variances], Any]
) -> tuple[float, float, float]:
    """A function of the variances: its value and its 95 % interval, which always contains the value."""
    value = float(function(estimates))
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = (float(end) for end in np.percentile(function(draws), [tail, 100.0 - tail]))
    return value, min(low, value), max(high, value)


def _component(estimates: Variances, draws: Variances, name: str, tolerance: float | None) -> Component:
    std = _interval_of(estimates, draws, lambda one: np.sqrt(one[name]))
    share = _interval_of(estimates, draws, lambda one: 100.0 * np.sqrt(one[name] / _positive(one["total"])))
    contribution = 100.0 * float(estimates[name] / estimates["total"])
    of_tolerance = (math.nan,) * 3 if tolerance is None else [100.0 * STUDY * one / tolerance for one in std]
    return Component(*std, contribution, *share, *of_tolerance)


def table_of(cells: Mapping[tuple[str, str], Sequence[float]]) -> tuple[NDArray[np.float64], list[str], list[str]]:
    """Values of a study as an array.

    Args:
        cells: (part, operator) -> values of the trials, in the order of time.

    Returns:
        Values (parts, operators, trials), NaN where a combination has fewer trials; names of the parts and of the
        operators.

    Raises:
        ValueError: an operator did not measure a part; the message names the first of these.
    """
    parts, operators = (sorted({key[place] for key in cells}) for place in (0, 1))
    missing = [f"{part} by {operator}" for part in parts for operator in operators if not cells.get((part, operator))]
    if missing:
        raise ValueError(f"combinations not measured ({len(missing)} of {len(parts) * len(operators)}): "
            f"{some(missing, '; ', MOST_NAMED)}. Fix: test them; the analysis of variance requires each combination at "
            "least once")
    values = np.full((len(parts), len(operators), max(map(len, cells.values()))), np.nan)
    for row, part in enumerate(parts):
        for column, operator in enumerate(operators):
            trials = cells[part, operator]
            values[row, column, : len(trials)] = trials
    return values, parts, operators

"""Statistics over repeats: best, mean and standard deviation, and the Kruskal-Wallis test over settings."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Summary:
    """What the papers state of repeated searches.

    Attributes:
        best: BV, lowest objective value.
        mean: MV.
        deviation: SD with N - 1; nan for a single repeat.
        median: Median, beside the papers.
        repeats: How many.
    """

    best: float
    mean: float
    deviation: float
    median: float
    repeats: int


def summarise(values: Sequence[float]) -> Summary:
    """BV, MV, SD and median of repeats.

    Args:
        values: Objective values, at least one.

    Returns:
        The summary.

    Raises:
        ValueError: There is no value.
    """
    if not values:
        raise ValueError("no repeats to summarise")
    array = np.asarray(values, dtype=np.float64)
    deviation = float(np.std(array, ddof=1)) if len(array) > 1 else float("nan")
    return Summary(float(array.min()), float(array.mean()), deviation, float(np.median(array)), len(array))


@dataclass(frozen=True)
class KruskalWallis:
    """Rank test of the hypothesis that every setting draws from one distribution.

    Attributes:
        statistic: H, corrected for ties.
        p: Probability of so large an H under the hypothesis.
        mean_ranks: Mean rank of each setting over all values together, lower is better.
        note: What the reader must know of the values; empty when nothing.
    """

    statistic: float
    p: float
    mean_ranks: Mapping[str, float]
    note: str = ""


def kruskal_wallis(groups: Mapping[str, Sequence[float]], note: str = "") -> KruskalWallis | None:
    """Kruskal-Wallis test over settings.

    Args:
        groups: Values of each setting, independent of each other.
        note: Kept with the test.

    Returns:
        The test; None when there are fewer than two settings, a setting has fewer than two values, or all values are
        equal.
    """
    from scipy.stats import kruskal, rankdata  # only studies need SciPy's statistics

    values = [np.asarray(group, dtype=np.float64) for group in groups.values()]
    if len(values) < 2 or min(len(group) for group in values) < 2:
        return None
    pooled = np.concatenate(values)
    if np.all(pooled == pooled[0]):
        return None
    outcome = kruskal(*values)
    ranks = np.split(rankdata(pooled), np.cumsum([len(group) for group in values])[:-1])
    mean_ranks = {name: float(np.mean(part)) for name, part in zip(groups, ranks, strict=True)}
    return KruskalWallis(float(outcome.statistic), float(outcome.pvalue), mean_ranks, note)

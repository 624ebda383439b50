"""Which groups differ after a Kruskal-Wallis test: Dunn's test of all pairs, with Holm's correction.

Dunn (Technometrics 6, 1964): z = (R_i - R_j) / sqrt((N (N + 1) / 12 - T) (1/n_i + 1/n_j)), R mean ranks over all N
values together, T = sum(t^3 - t) / (12 (N - 1)) over groups of t tied values. Holm (Scandinavian Journal of Statistics
6, 1979): the k-th smallest of m probabilities times m - k + 1, never below the one before.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np


@dataclass(frozen=True)
class Pair:
    """Two groups compared.

    Attributes:
        first: The group with the lower (better) mean rank.
        second: The other.
        z: Difference of their mean ranks in standard errors, not negative.
        p: Probability of so large a difference, two-sided, of this pair alone.
        p_holm: The same among all pairs, after Holm.
    """

    first: str
    second: str
    z: float
    p: float
    p_holm: float


def dunn(groups: Mapping[str, Sequence[float]]) -> tuple[Pair, ...]:
    """Every pair of groups, the clearest difference first.

    Args:
        groups: Values of each group, independent of each other; at least two groups, not all values equal.

    Returns:
        All pairs.

    Raises:
        ValueError: There are fewer than two groups, one is empty, or all values are equal.
    """
    from scipy.stats import rankdata  # only studies need SciPy's statistics

    if len(groups) < 2 or min(len(group) for group in groups.values()) < 1:
        raise ValueError("Dunn's test requires at least two groups with values")
    sizes = np.array([len(group) for group in groups.values()])
    pooled = np.concatenate([np.asarray(group, dtype=np.float64) for group in groups.values()])
    count = pooled.size
    ties = np.unique(pooled, return_counts=True)[1].astype(np.float64)
    variance = count * (count + 1.0) / 12.0 - float(np.sum(ties**3 - ties)) / (12.0 * (count - 1.0))
    if variance <= 0.0:
        raise ValueError("all values are equal")
    ranks = np.split(rankdata(pooled), np.cumsum(sizes)[:-1])
    means = dict(zip(groups, (float(np.mean(part)) for part in ranks), strict=True))
    alone = []
    for (one, size_1), (other, size_2) in combinations(zip(groups, sizes.tolist(), strict=True), 2):
        first, second = (one, other) if means[one] <= means[other] else (other, one)
        z = (means[second] - means[first]) / math.sqrt(variance * (1.0 / size_1 + 1.0 / size_2))
        alone.append((first, second, z, math.erfc(z / math.sqrt(2.0))))
    alone.sort(key=lambda pair: pair[3])
    pairs, least = [], 0.0
    for place, (first, second, z, p) in enumerate(alone):
        least = max(least, min(1.0, p * (len(alone) - place)))
        pairs.append(Pair(first, second, z, p, least))
    return tuple(pairs)

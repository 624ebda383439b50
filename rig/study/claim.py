"""A statement of a paper beside a study's result, and the test that says whether two groups of searches differ."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

HOLDS, FAILS, OPEN = "holds", "does not hold", "cannot be told"
EQUAL_SHARE = 0.1
"""Relative difference of means below which nothing is said to be better."""
SIGNIFICANT = 0.05


@dataclass(frozen=True)
class Claim:
    """One statement of a paper beside this study's result.

    Attributes:
        slug: Which statement.
        verdict: `holds`, `does not hold` or `cannot be told`, on these recordings.
        text: What the paper says, what was found, why.
    """

    slug: str
    verdict: str
    text: str


def rank_test(one: Sequence[float], other: Sequence[float]) -> float:
    """Probability, two-sided, that two groups of independent values differ so much by chance.

    It is the Kruskal-Wallis test of two groups; 1.0 where it cannot be done. Its chi-squared is that of large groups:
    of small ones the probability is no less than that of the most extreme order (of 3 and 3 values: 0.1).

    Args:
        one: Values.
        other: Values.
    """
    from scipy.stats import kruskal  # only studies need SciPy's statistics

    pooled = np.array([*one, *other])
    if min(len(one), len(other)) < 2 or np.all(pooled == pooled[0]):
        return 1.0
    most_extreme = 2.0 / math.comb(pooled.size, len(one))
    return max(float(kruskal(one, other).pvalue), most_extreme)

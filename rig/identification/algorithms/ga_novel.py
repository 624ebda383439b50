"""The novel genetic algorithm of paper 2, with its statistical stop.

Against the standard one: parents by rank weight among the better half; a father is never his child's mother
(redrawn); a fixed number of crossovers each generation; an evaluation between crossover and mutation, so that the
best child cannot be mutated away; mutation of single variables, mu (N_pop - 1) N_var of them, uniform inside the
bounds, the elite excluded.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rig.identification.algorithms.inheritance import Pool, StatisticalGenetic, blend, pick, rank_weights
from rig.identification.algorithms.search import Array, Search, require


@dataclass(frozen=True)
class NovelGenetic(StatisticalGenetic):
    """Settings of the novel GA; mutation is uniform in the bounds, so they matter (the paper sets them by trial).

    Attributes:
        mutation_rate: mu, share of the variables outside the elite mutated each generation.
        crossovers: Couples each generation; 0: as many as fill the discarded half.
    """

    method: ClassVar[str] = "ga_novel"
    mutation_rate: float = 0.2
    crossovers: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.method, "mutation_rate", self.mutation_rate, 0.0, 1.0)
        require(self.method, "crossovers", self.crossovers, 0, 10**6)

    def generation(self, search: Search, pool: Pool) -> None:
        """Crossover into the discarded half, evaluation, mutation of all but the best, evaluation.

        Args:
            search: Evaluates and draws.
            pool: The chromosomes.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        rng, kept = search.rng, search.population // 2
        couples = (search.population - kept) // 2
        couples = min(self.crossovers or couples, couples)
        weights = rank_weights(kept)
        pool.sort()
        mothers = pick(weights, rng.random(couples))
        fathers = other_parents(weights, mothers, rng)
        children = np.concatenate(blend(pool.members[mothers], pool.members[fathers], rng.random((couples, 1))))
        born = np.arange(kept, kept + 2 * couples)
        pool.members[born] = search.inside(children)
        pool.evaluate(search, born)
        pool.sort()
        count = round(self.mutation_rate * (search.population - 1) * search.n_parameters)
        pool.evaluate(search, mutate(pool.members, pool.low, pool.high, count, rng))


def other_parents(weights: Array, mothers: npt.NDArray[np.int64], rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Fathers by rank weight, redrawn until none is the mother.

    Args:
        weights: Shape (n,), n at least 2.
        mothers: Shape (m,): indices.
        rng: Where draws come from.

    Returns:
        Shape (m,).
    """
    fathers = pick(weights, rng.random(len(mothers)))
    while (same := fathers == mothers).any():
        fathers[same] = pick(weights, rng.random(int(same.sum())))
    return fathers


def mutate(members: Array, low: Array, high: Array, count: int, rng: np.random.Generator) -> npt.NDArray[np.int64]:
    """Replace `count` single variables outside row 0 (the elite), in place, by uniform draws.

    Args:
        members: Shape (N, p), best first.
        low: Shape (p,).
        high: Shape (p,).
        count: Different variables to replace, at most (N - 1) p.
        rng: Where draws come from.

    Returns:
        Rows that changed, ascending.
    """
    rows, size = members.shape
    places = rng.choice((rows - 1) * size, size=min(count, (rows - 1) * size), replace=False)
    row, column = 1 + places // size, places % size
    members[row, column] = low[column] + (high - low)[column] * rng.random(len(places))
    return np.unique(row)

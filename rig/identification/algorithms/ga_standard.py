"""The standard genetic algorithm paper 2 compares with, reconstructed from what its own does differently.

The better half survives; couples are drawn by roulette on 1 / error, mother and father possibly the same; a couple
mates with a probability, else its copies go on; single variables mutate; everything new is evaluated once, after
mutation, so a good child can be mutated away; the best survives.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rig.identification.algorithms.ga_novel import mutate
from rig.identification.algorithms.inheritance import Pool, StatisticalGenetic, blend, pick
from rig.identification.algorithms.search import Array, Search, require


@dataclass(frozen=True)
class StandardGenetic(StatisticalGenetic):
    """Settings of the standard GA.

    Attributes:
        crossover: Probability that a couple mates.
        mutation_rate: Share of the variables outside the elite mutated each generation.
    """

    method: ClassVar[str] = "ga_standard"
    crossover: float = 0.9
    mutation_rate: float = 0.2

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.method, "crossover", self.crossover, 0.0, 1.0)
        require(self.method, "mutation_rate", self.mutation_rate, 0.0, 1.0)

    def generation(self, search: Search, pool: Pool) -> None:
        """Crossover into the discarded half, mutation of all but the best, one evaluation of what is new.

        Args:
            search: Evaluates and draws.
            pool: The chromosomes.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        rng, kept = search.rng, search.population // 2
        couples = (search.population - kept) // 2
        pool.sort()
        wheel = roulette(pool.values[:kept])
        mothers, fathers = pick(wheel, rng.random(couples)), pick(wheel, rng.random(couples))
        mate = rng.random((couples, 1)) < self.crossover
        shares = mate * rng.random((couples, 1))
        born = np.arange(kept, kept + 2 * couples)
        pool.members[born] = search.inside(np.concatenate(blend(pool.members[mothers], pool.members[fathers], shares)))
        count = round(self.mutation_rate * (search.population - 1) * search.n_parameters)
        pool.evaluate(search, np.union1d(mutate(pool.members, pool.low, pool.high, count, rng), born))


def roulette(errors: Array) -> Array:
    """Shares of a wheel proportional to 1 / error.

    Args:
        errors: Shape (n,), positive or zero, possibly infinite.

    Returns:
        Shape (n,), sums to 1; equal shares when no error is finite.
    """
    finite = np.isfinite(errors)
    if not finite.any():
        return np.full(len(errors), 1.0 / len(errors))
    least = max(float(errors[finite].min()), float(np.finfo(np.float64).tiny))
    fitness = np.zeros(len(errors))
    fitness[finite] = least / np.maximum(errors[finite], least)
    return np.asarray(fitness / fitness.sum())

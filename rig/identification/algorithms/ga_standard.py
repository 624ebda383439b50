"""The standard genetic algorithm paper 2 compares with, reconstructed from what its own does differently.

The better half survives; couples are drawn by roulette on 1 / error, mother and father possibly the same; a couple
mates with a probability, else its copies go on; single variables mutate; everything new is evaluated once, after
mutation, so a good child can be mutated away; the best survives.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.identification.algorithms.ga_novel import mutate
from rig.identification.algorithms.inheritance import StatisticalStop, blend, pick, require_stop
from rig.identification.algorithms.search import Array, Search, require


@dataclass(frozen=True)
class StandardGenetic:
    """Settings of the standard GA.

    The first population is uniform in the bounds (within +-`reach` where there are none), `start` its first member.

    Attributes:
        crossover: Probability that a couple mates.
        mutation_rate: Share of the variables outside the elite mutated each generation.
        q_min: Generations before the statistical stop counts.
        p: Chance at which the statistical stop ends the search; 0 never.
        reach: Half width of the first population and of mutation where unbounded.
    """

    crossover: float = 0.9
    mutation_rate: float = 0.2
    q_min: int = 50
    p: float = 0.05
    reach: float = 10.0

    def __post_init__(self) -> None:
        require("ga_standard", "crossover", self.crossover, 0.0, 1.0)
        require("ga_standard", "mutation_rate", self.mutation_rate, 0.0, 1.0)
        require("ga_standard", "reach", self.reach, 1e-300, 1e300)
        require_stop("ga_standard", self.q_min, self.p)

    def run(self, search: Search) -> str:
        """Search until the statistical stop, or until the budget is spent.

        Args:
            search: Evaluates, counts and archives.

        Returns:
            `statistics`.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        rng = search.rng
        members = search.draw(self.reach)
        values = search.evaluate(members)
        stop = StatisticalStop(self.q_min, self.p)
        kept = search.population // 2
        couples = (search.population - kept) // 2
        low, high = search.box(self.reach)
        while True:
            order = np.argsort(values, kind="stable")
            members, values = members[order], values[order]
            wheel = roulette(values[:kept])
            mothers, fathers = pick(wheel, rng.random(couples)), pick(wheel, rng.random(couples))
            mate = rng.random((couples, 1)) < self.crossover
            children = np.concatenate(blend(members[mothers], members[fathers], mate * rng.random((couples, 1))))
            members[kept : kept + 2 * couples] = search.inside(children)
            count = round(self.mutation_rate * (search.population - 1) * search.n_parameters)
            changed = np.union1d(mutate(members, low, high, count, rng), np.arange(kept, kept + 2 * couples))
            values[changed] = search.evaluate(members[changed])
            search.generation_done()
            if stop.add(float(values.min())):
                return "statistics"


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

"""The efficient genetic algorithm of Kwok et al. 2007, as both papers describe it.

No selection stage: two chromosomes drawn at random make a child by linear blending, which replaces the first of them;
how many is left to chance. A chromosome chosen for mutation is perturbed as a whole by a Gaussian kernel. After both,
2 % of the chromosomes, the worst, are replaced by copies of the best ever. It stops by statistics. The probabilities
and the kernel's width are in neither paper: they are settings here.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from rig.identification.algorithms.inheritance import Pool, StatisticalGenetic, blend
from rig.identification.algorithms.search import Search, require


@dataclass(frozen=True)
class KwokGenetic(StatisticalGenetic):
    """Settings of Kwok's GA; its population is 50.

    Attributes:
        crossover: Probability of a chromosome to be the first parent of a child that replaces it.
        mutation: Probability of a chromosome to be perturbed.
        width: Standard deviation of the perturbation, in widths of the first population.
        replaced: Share replaced by copies of the best.
    """

    method: ClassVar[str] = "ga_kwok"
    crossover: float = 0.8
    mutation: float = 0.1
    width: float = 0.05
    replaced: float = 0.02

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.method, "crossover", self.crossover, 0.0, 1.0)
        require(self.method, "mutation", self.mutation, 0.0, 1.0)
        require(self.method, "width", self.width, 0.0, 10.0)
        require(self.method, "replaced", self.replaced, 0.0, 0.5)

    def generation(self, search: Search, pool: Pool) -> None:
        """Blending, perturbation, evaluation, copies of the best in the place of the worst.

        Args:
            search: Evaluates and draws.
            pool: The chromosomes.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        rng, (rows, size) = search.rng, pool.members.shape
        first = np.flatnonzero(rng.random(rows) < self.crossover)
        second = (first + rng.integers(1, rows, len(first))) % rows
        children, _ = blend(pool.members[first], pool.members[second], rng.random((len(first), 1)))
        pool.members[first] = children
        mutated = np.flatnonzero(rng.random(rows) < self.mutation)
        kernel = self.width * (pool.high - pool.low) * rng.standard_normal((len(mutated), size))
        pool.members[mutated] = search.inside(pool.members[mutated] + kernel)
        pool.evaluate(search, np.union1d(first, mutated))
        copies = max(1, round(self.replaced * rows))
        worst = np.argsort(pool.values, kind="stable")[-copies:]
        pool.members[worst], pool.values[worst] = search.best, search.value

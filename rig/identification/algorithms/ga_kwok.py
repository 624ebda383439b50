"""The efficient genetic algorithm of Kwok et al. 2007, as both papers describe it.

No selection stage: two chromosomes drawn at random make a child by linear blending, which replaces the first of them;
how many is left to chance. A chromosome chosen for mutation is perturbed as a whole by a Gaussian kernel. After both,
2 % of the chromosomes, the worst, are replaced by copies of the best ever. It stops by statistics. The probabilities
and the kernel's width are in neither paper: they are settings here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.identification.algorithms.inheritance import StatisticalStop, blend, require_stop
from rig.identification.algorithms.search import Search, require


@dataclass(frozen=True)
class KwokGenetic:
    """Settings of Kwok's GA; its population is 50.

    The first population is uniform in the bounds (within +-`reach` where there are none), `start` its first member.

    Attributes:
        crossover: Probability of a chromosome to be the first parent of a child that replaces it.
        mutation: Probability of a chromosome to be perturbed.
        width: Standard deviation of the perturbation, in widths of the first population.
        replaced: Share replaced by copies of the best.
        q_min: Generations before the statistical stop counts.
        p: Chance at which the statistical stop ends the search; 0 never.
        reach: Half width of the first population where unbounded.
    """

    crossover: float = 0.8
    mutation: float = 0.1
    width: float = 0.05
    replaced: float = 0.02
    q_min: int = 50
    p: float = 0.05
    reach: float = 10.0

    def __post_init__(self) -> None:
        require("ga_kwok", "crossover", self.crossover, 0.0, 1.0)
        require("ga_kwok", "mutation", self.mutation, 0.0, 1.0)
        require("ga_kwok", "width", self.width, 0.0, 10.0)
        require("ga_kwok", "replaced", self.replaced, 0.0, 0.5)
        require("ga_kwok", "reach", self.reach, 1e-300, 1e300)
        require_stop("ga_kwok", self.q_min, self.p)

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
        rows, size = members.shape
        copies = max(1, round(self.replaced * rows))
        low, high = search.box(self.reach)
        while True:
            first = np.flatnonzero(rng.random(rows) < self.crossover)
            second = (first + rng.integers(1, rows, len(first))) % rows
            children, _ = blend(members[first], members[second], rng.random((len(first), 1)))
            members[first] = children
            mutated = np.flatnonzero(rng.random(rows) < self.mutation)
            members[mutated] += self.width * (high - low) * rng.standard_normal((len(mutated), size))
            members[mutated] = search.inside(members[mutated])
            changed = np.union1d(first, mutated)
            values[changed] = search.evaluate(members[changed])
            worst = np.argsort(values, kind="stable")[-copies:]
            members[worst], values[worst] = search.best, search.value
            search.generation_done()
            if stop.add(float(values.min())):
                return "statistics"

"""The novel genetic algorithm of paper 2, with its statistical stop.

Against the standard one: parents by rank weight among the better half; a father is never his child's mother
(redrawn); a fixed number of crossovers each generation; an evaluation between crossover and mutation, so that the
best child cannot be mutated away; mutation of single variables, mu (N_pop - 1) N_var of them, uniform inside the
bounds, the elite excluded.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.identification.algorithms.inheritance import StatisticalStop, blend, pick, rank_weights, require_stop
from rig.identification.algorithms.search import Array, Search, require


@dataclass(frozen=True)
class NovelGenetic:
    """Settings of the novel GA; mutation is uniform in the bounds, so they matter (the paper sets them by trial).

    The first population is uniform in the bounds (within +-`reach` where there are none), `start` its first member.

    Attributes:
        mutation_rate: mu, share of the variables outside the elite mutated each generation.
        crossovers: Couples each generation; 0: as many as fill the discarded half.
        q_min: Generations before the statistical stop counts.
        p: Chance at which the statistical stop ends the search; 0 never.
        reach: Half width of the first population and of mutation where unbounded.
    """

    mutation_rate: float = 0.2
    crossovers: int = 0
    q_min: int = 50
    p: float = 0.05
    reach: float = 10.0

    def __post_init__(self) -> None:
        require("ga_novel", "mutation_rate", self.mutation_rate, 0.0, 1.0)
        require("ga_novel", "crossovers", self.crossovers, 0, 10**6)
        require("ga_novel", "reach", self.reach, 1e-300, 1e300)
        require_stop("ga_novel", self.q_min, self.p)

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
        couples = min(self.crossovers or (search.population - kept) // 2, (search.population - kept) // 2)
        weights = rank_weights(kept)
        low, high = search.box(self.reach)
        while True:
            _sort(members, values)
            mothers = pick(weights, rng.random(couples))
            fathers = other_parents(weights, mothers, rng)
            children = np.concatenate(blend(members[mothers], members[fathers], rng.random((couples, 1))))
            members[kept : kept + 2 * couples] = search.inside(children)
            values[kept : kept + 2 * couples] = search.evaluate(members[kept : kept + 2 * couples])
            _sort(members, values)
            count = round(self.mutation_rate * (search.population - 1) * search.n_parameters)
            changed = mutate(members, low, high, count, rng)
            values[changed] = search.evaluate(members[changed])
            search.generation_done()
            if stop.add(float(values.min())):
                return "statistics"


def _sort(members: Array, values: Array) -> None:
    order = np.argsort(values, kind="stable")
    members[:], values[:] = members[order], values[order]


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

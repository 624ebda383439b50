"""Improved artificial bee colony I-ABC (Li, Niu, Xiao 2012), reconstructed: the paper names it and gives Phi2 = 1.

For one component j and another food source k, both drawn at random:

    v_ij = w_i x_ij + 2 (phi - 0.5) (x_ij - x_kj) Phi1_i + psi (x_best,j - x_ij) Phi2_i
    w_i = Phi1_i = 1 / (1 + exp(-fit_i / ap)),  Phi2 = 1 for employed bees, Phi1_i for onlookers
    fit = 1 / (1 + f) for f >= 0, else 1 + |f|;  ap = best fitness of the first colony

Employed bees try every source once, onlookers choose sources in proportion to fitness; greedy selection; a source
that failed `limit` times is abandoned to a scout. Bees of one phase move at the same time (the original moves them
one after another), so that a phase is one population; of several onlookers at one source the best counts.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.optimisers.arrays import FloatArray
from rig.optimisers.search import Search, require

Indices = npt.NDArray[np.int64]


@dataclass(frozen=True)
class ImprovedBeeColony:
    """Settings of I-ABC. The population is the number of employed bees; as many onlookers follow.

    The first sources are uniform in the bounds (within +-`reach` where there are none), `start` the first of them.

    Attributes:
        limit: Failed trials before a source is abandoned, as a multiple of N p (the usual ABC value is 1).
        reach: Half width of the first colony where unbounded.
    """

    limit: float = 1.0
    reach: float = 10.0

    def __post_init__(self) -> None:
        require("i_abc", "limit", self.limit, 0.0, 1e9)
        require("i_abc", "reach", self.reach, 1e-300, 1e300)

    def run(self, search: Search) -> str:
        """Search until the budget is spent (the paper's only stop).

        Args:
            search: Evaluates, counts and archives.

        Returns:
            Never: the search ends by its budget.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        rng = search.rng
        sources = search.draw(self.reach)
        values = search.evaluate(sources)
        rows, size = sources.shape
        failures = np.zeros(rows, dtype=np.int64)
        scale = max(float(np.max(fitness(values))), float(np.finfo(np.float64).tiny))
        while True:
            for onlookers in (False, True):
                chosen: Indices = np.arange(rows)
                if onlookers:
                    chosen = np.asarray(rng.choice(rows, size=rows, p=shares(fitness(values))))
                weight = inertia(fitness(values)[chosen], scale)
                draws = Draws.draw(rng, chosen, rows, size)
                best_pull = weight if onlookers else np.ones(rows)
                tried = search.inside(neighbours(sources, chosen, search.best, weight, best_pull, draws))
                _greedy(sources, values, failures, chosen, tried, search.evaluate(tried))
            tired = int(np.argmax(failures))
            if failures[tired] > self.limit * rows * size:
                low, high = search.box(self.reach)
                sources[tired] = low + (high - low) * rng.random(size)
                values[tired] = search.evaluate(sources[tired : tired + 1])[0]
                failures[tired] = 0
            search.generation_done()


@dataclass(frozen=True)
class Draws:
    """Random draws of one phase, each shape (n,).

    Attributes:
        component: j of each bee.
        other: k of each bee, never its own source.
        phi: Uniform in [0, 1).
        psi: Uniform in [0, 1).
    """

    component: Indices
    other: Indices
    phi: FloatArray
    psi: FloatArray

    @classmethod
    def draw(cls, rng: np.random.Generator, chosen: Indices, rows: int, size: int) -> Draws:
        """Fresh draws for bees at the sources `chosen` of `rows` sources with `size` components.

        Args:
            rng: Where they come from.
            chosen: Shape (n,): each bee's source.
            rows: Number of sources.
            size: Number of parameters.

        Returns:
            The draws.
        """
        count = len(chosen)
        other = (chosen + rng.integers(1, rows, count)) % rows
        return cls(rng.integers(0, size, count), other, rng.random(count), rng.random(count))


def fitness(values: FloatArray) -> FloatArray:
    """ABC fitness: 1 / (1 + f) for f >= 0, else 1 + |f|.

    Args:
        values: Shape (N,): objective values.

    Returns:
        Shape (N,), larger is better.
    """
    return np.where(values >= 0.0, 1.0 / (1.0 + np.maximum(values, 0.0)), 1.0 - np.minimum(values, 0.0))


def shares(fit: FloatArray) -> FloatArray:
    """How often an onlooker chooses each source: by its share of the fitness; any, where no source has a finite value.

    Args:
        fit: Shape (N,): fitness of each source.

    Returns:
        Shape (N,), summing to 1.
    """
    total = float(np.sum(fit))
    return fit / total if total > 0.0 else np.full(fit.size, 1.0 / fit.size)


def inertia(fit: FloatArray, scale: float) -> FloatArray:
    """Weights w = Phi1 = 1 / (1 + exp(-fit / ap)): a half for the unfit, 0.73 for as good as the first colony's best.

    Args:
        fit: Shape (n,): fitness of each bee's source.
        scale: ap, best fitness of the first colony.

    Returns:
        Shape (n,).
    """
    return np.asarray(1.0 / (1.0 + np.exp(-fit / scale)))


def neighbours(
    sources: FloatArray, chosen: Indices, best: FloatArray, weight: FloatArray, best_pull: FloatArray, draws: Draws
) -> FloatArray:
    """Candidate sources: one component of each chosen source moved as in the module's first equation.

    Args:
        sources: Shape (N, p).
        chosen: Shape (n,): each bee's source.
        best: Shape (p,): best source ever.
        weight: Shape (n,): w = Phi1.
        best_pull: Shape (n,): Phi2.
        draws: Component, other source, phi and psi of each bee.

    Returns:
        Shape (n, p).
    """
    bees, j = np.arange(len(chosen)), draws.component
    tried: FloatArray = sources[chosen]
    x, x_other = tried[bees, j], sources[draws.other, j]
    tried[bees, j] = (
        weight * x + 2.0 * (draws.phi - 0.5) * (x - x_other) * weight + draws.psi * (best[j] - x) * best_pull
    )
    return tried


def _greedy(
    sources: FloatArray,
    values: FloatArray,
    failures: Indices,
    chosen: Indices,
    tried: FloatArray,
    tried_values: FloatArray,
) -> None:
    """Keep, at each source in place, the best of what its bees tried if it is better; count failures otherwise."""
    for bee in np.argsort(tried_values, kind="stable"):
        source = chosen[bee]
        if tried_values[bee] < values[source]:
            sources[source], values[source], failures[source] = tried[bee], tried_values[bee], 0
        else:
            failures[source] += 1

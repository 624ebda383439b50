"""Genetic algorithm as the c-FOA paper words it: MATLAB's `ga` with real numbers and no knowledge of the range.

Each generation: the best `elite` share survives; `crossover` of the rest are children of two parents, the others
mutants of one. Scaling is by rank, expectation proportional to 1 / sqrt(rank); parents come from a wheel walked in
equal steps from one random offset (stochastic uniform); a child is a weighted average, p1 + r (p2 - p1), r uniform
for each variable. Mutation is

    Gaussian: parent + scale (1 - shrink k / K) randn, scale the first population's width, K the generations the
        budget allows;
    feasible direction: parent + step times a random direction of a random orthonormal basis, scaled by the magnitude
    of the population's mean; the step grows 4 x after a generation that improved and shrinks 4 x after one that did
    not; a direction that leaves the bounds is turned round, then the step is halved until it fits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.optimisers.arrays import FloatArray
from rig.optimisers.search import Search, SearchError, require

SMALLEST_STEP = 1e-8
HALVINGS = 30


@dataclass(frozen=True)
class Genetic:
    """Settings of the genetic algorithm with MATLAB's and the paper's values.

    The first population is uniform in the bounds (within +-`reach` where there are none), `start` its first member.

    Attributes:
        mutation: `gaussian` (MATLAB's choice without constraints) or `feasible direction`.
        elite: Share of the population that survives unchanged.
        crossover: Share of the others that are children of two.
        scale: Width of Gaussian mutation at the start, in widths of the first population.
        shrink: How much of that width is gone at the last generation.
        reach: Half width of the first population where unbounded.
        stall_generations: Stop after so many generations without change; 0 never.
        tolerance: Mean relative change of the best value below which it has not changed.
    """

    mutation: str = "gaussian"
    elite: float = 0.05
    crossover: float = 0.8
    scale: float = 1.0
    shrink: float = 1.0
    reach: float = 10.0
    stall_generations: int = 200
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        if self.mutation not in {"gaussian", "feasible direction"}:
            raise SearchError(f"ga: mutation: got {self.mutation!r}, expected 'gaussian' or 'feasible direction'")
        require("ga", "elite", self.elite, 0.0, 0.9)
        require("ga", "crossover", self.crossover, 0.0, 1.0)
        require("ga", "scale", self.scale, 0.0, 1e300)
        require("ga", "shrink", self.shrink, 0.0, 1.0)
        require("ga", "reach", self.reach, 1e-300, 1e300)
        require("ga", "stall_generations", self.stall_generations, 0, 10**9)
        require("ga", "tolerance", self.tolerance, 0.0, 1.0)

    def run(self, search: Search) -> str:
        """Search until the budget is spent or the best value stalls.

        Args:
            search: Evaluates, counts and archives.

        Returns:
            `stall`.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        members = search.draw(self.reach)
        values = search.evaluate(members)
        elite = math.ceil(self.elite * search.population)
        children = round(self.crossover * (search.population - elite))
        mutants = search.population - elite - children
        last = max(1, search.budget // max(1, search.population - elite))
        best_values, step = [search.value], 1.0
        while True:
            order = np.argsort(values, kind="stable")
            members, values = members[order], values[order]
            parents = stochastic_uniform(expectation(len(values)), 2 * children + mutants, search.rng.random())
            parents = search.rng.permutation(parents)
            first, second = members[parents[:children]], members[parents[children : 2 * children]]
            crossed = weighted_average(first, second, search.rng.random(first.shape))
            mutated = self._mutants(search, members, parents[2 * children :], step, search.generations / last)
            offspring = search.inside(np.concatenate([crossed, mutated]))
            offspring_values = search.evaluate(offspring)
            members = np.concatenate([members[:elite], offspring])
            values = np.concatenate([values[:elite], offspring_values])
            best_values.append(search.value)
            step = min(1.0, 4.0 * step) if best_values[-1] < best_values[-2] else max(SMALLEST_STEP, 0.25 * step)
            search.generation_done()
            if stalled(best_values, self.stall_generations, self.tolerance):
                return "stall"

    def _mutants(
        self, search: Search, members: FloatArray, parents: npt.NDArray[np.int64], step: float, elapsed: float
    ) -> FloatArray:
        if self.mutation == "gaussian":
            low, high = search.box(self.reach)
            width = self.scale * (1.0 - self.shrink * min(elapsed, 1.0)) * (high - low)
            return members[parents] + width * search.rng.standard_normal((len(parents), search.n_parameters))
        return feasible_directions(search, members, parents, step)


def expectation(members: int) -> FloatArray:
    """Expected share of parents by rank, proportional to 1 / sqrt(rank).

    Args:
        members: Population N, best first.

    Returns:
        Shape (N,), sums to 1.
    """
    weights = 1.0 / np.sqrt(np.arange(1, members + 1))
    return np.asarray(weights / np.sum(weights))


def stochastic_uniform(shares: FloatArray, parents: int, draw: float) -> npt.NDArray[np.int64]:
    """Parents from a wheel walked in equal steps from one random offset.

    Args:
        shares: Shape (N,), sums to 1.
        parents: How many to pick.
        draw: Uniform in [0, 1): the offset in steps.

    Returns:
        Shape (parents,): indices, ascending.
    """
    places = (np.arange(parents) + draw) / max(parents, 1)
    return np.minimum(np.searchsorted(np.cumsum(shares), places, side="right"), len(shares) - 1)


def weighted_average(first: FloatArray, second: FloatArray, draws: FloatArray) -> FloatArray:
    """Children p1 + r (p2 - p1).

    Args:
        first: Shape (n, p).
        second: Shape (n, p).
        draws: Shape (n, p): r, uniform in [0, 1).

    Returns:
        Shape (n, p).
    """
    return np.asarray(first + draws * (second - first))


def feasible_directions(search: Search, members: FloatArray, parents: npt.NDArray[np.int64], step: float) -> FloatArray:
    """Mutants along random directions, inside the bounds.

    Args:
        search: Its bounds and generator are used.
        members: Shape (N, p).
        parents: Shape (n,): who is mutated.
        step: Step in multiples of each variable's magnitude.

    Returns:
        Shape (n, p).
    """
    size = search.n_parameters
    magnitude = np.maximum(np.abs(np.mean(members, axis=0)), SMALLEST_STEP)
    scale = 2.0 ** np.round(np.log2(magnitude))
    basis = np.linalg.qr(search.rng.standard_normal((size, size)))[0]
    chosen = basis[search.rng.integers(0, size, len(parents))]
    moves: FloatArray = step * scale * chosen * search.rng.choice([-1.0, 1.0], (len(parents), 1))
    origin = members[parents]
    for _ in range(HALVINGS):
        outside = _leaves(origin + moves, search)
        if not outside.any():
            return origin + moves
        turned = outside & ~_leaves(origin - moves, search)
        moves[turned] *= -1.0
        moves[outside & ~turned] *= 0.5
    return search.inside(origin + moves)


def _leaves(points: FloatArray, search: Search) -> npt.NDArray[np.bool_]:
    return np.asarray(np.any((points < search.low) | (points > search.high), axis=1))


def stalled(best_values: list[float], generations: int, tolerance: float) -> bool:
    """Whether the best value changed less than `tolerance` a generation, relatively, over the last `generations`.

    Args:
        best_values: Best value after every generation.
        generations: Length of the window; 0 never stalls.
        tolerance: Mean relative change.

    Returns:
        True when it stalled.
    """
    if generations == 0 or len(best_values) <= generations:
        return False
    change = best_values[-1 - generations] - best_values[-1]
    return change <= tolerance * generations * max(1.0, abs(best_values[-1]))

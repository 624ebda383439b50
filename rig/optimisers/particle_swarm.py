"""Particle swarm with adaptive neighbourhood: MATLAB `particleswarm` as its pages and the c-FOA paper word it.

    v <- w v + phi1 b1 (p_i - x) + phi2 b2 (p_g - x),  x <- x + v,  b1, b2 uniform for each component   (20)
    better than ever: c = max(0, c - 1), N_h = N_min;  else c = c + 1, N_h = min(N_h + N_min, N)        (22)
    then w doubled if c < 2, halved if c > 5, kept in [0.1, 1.1]                                        (21)

p_g is the best of N_h particles drawn afresh each generation, the particle itself among them;
N_min = max(2, floor(0.25 N)).

Equation (21) has no condition, MATLAB's page applies it only after an improvement. Read so (`inertia_rule="when
better"`), w stays at its first 1.1 while nothing improves, the swarm flies apart and seldom improves again; the
default is the paper's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from rig.optimisers.arrays import FloatArray
from rig.optimisers.search import Search, SearchError, require


@dataclass(frozen=True)
class ParticleSwarm:
    """Settings of the swarm with the published values.

    The first swarm is uniform in the bounds (within +-`reach` where there are none), `start` its first particle;
    velocities are uniform within plus and minus the first swarm's width.

    Attributes:
        self_weight: phi1.
        social_weight: phi2.
        inertia_low: Lowest w.
        inertia_high: Highest w, and the first.
        neighbours: Smallest neighbourhood as a share of the swarm.
        reach: Half width of the first swarm where unbounded.
        inertia_rule: `every generation` (21) or `when better` (MATLAB's page).
        stall_generations: Stop after so many generations without a relative improvement of `tolerance`; 0 never (the
            paper).
        tolerance: Relative improvement that counts.
    """

    self_weight: float = 1.49
    social_weight: float = 1.49
    inertia_low: float = 0.1
    inertia_high: float = 1.1
    neighbours: float = 0.25
    reach: float = 1000.0
    inertia_rule: str = "every generation"
    stall_generations: int = 0
    tolerance: float = 1e-6

    def __post_init__(self) -> None:
        require("pso", "self_weight", self.self_weight, 0.0, 10.0)
        require("pso", "social_weight", self.social_weight, 0.0, 10.0)
        require("pso", "inertia_low", self.inertia_low, 0.0, self.inertia_high)
        require("pso", "inertia_high", self.inertia_high, 0.0, 10.0)
        require("pso", "neighbours", self.neighbours, 0.0, 1.0)
        if self.inertia_rule not in {"every generation", "when better"}:
            raise SearchError(
                f"pso: inertia_rule: got {self.inertia_rule!r}, expected 'every generation' or 'when better'"
            )
        require("pso", "reach", self.reach, 1e-300, 1e300)
        require("pso", "stall_generations", self.stall_generations, 0, 10**9)

    def run(self, search: Search) -> str:
        """Search until the budget is spent or the swarm stalls.

        Args:
            search: Evaluates, counts and archives.

        Returns:
            `stall`.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        rng = search.rng
        places = search.draw(self.reach)
        low, high = search.box(self.reach)
        speeds = (high - low) * (2.0 * rng.random(places.shape) - 1.0)
        own, own_values = places.copy(), search.evaluate(places)
        smallest = max(2, int(self.neighbours * search.population))
        limits = self.inertia_low, self.inertia_high
        swarm = SwarmState(self.inertia_high, smallest, 0, smallest, search.population, *limits)
        marks = [search.value]
        while True:
            leaders = leaders_of(own_values, rng.random((len(places), len(places))), swarm.neighbours)
            speeds = self.accelerated(speeds, places, own, own[leaders], rng.random((2, *places.shape)), swarm.inertia)
            places, speeds = stopped_at_bounds(places + speeds, speeds, search.low, search.high)
            before = search.value
            values = search.evaluate(places)
            improved = values < own_values
            own[improved], own_values[improved] = places[improved], values[improved]
            swarm = swarm.after(better=search.value < before, always=self.inertia_rule == "every generation")
            search.generation_done()
            marks.append(search.value)
            if self._stalled(marks):
                return "stall"

    def accelerated(
        self,
        speeds: FloatArray,
        places: FloatArray,
        own: FloatArray,
        leader: FloatArray,
        draws: FloatArray,
        inertia: float,
    ) -> FloatArray:
        """New velocities, equation (20).

        Args:
            speeds: Shape (N, p).
            places: Shape (N, p): x.
            own: Shape (N, p): each particle's best place, p_i.
            leader: Shape (N, p): the best place in its neighbourhood, p_g.
            draws: Shape (2, N, p): b1, b2, uniform in [0, 1).
            inertia: w.

        Returns:
            Shape (N, p).
        """
        pull_own = self.self_weight * draws[0] * (own - places)
        pull_leader = self.social_weight * draws[1] * (leader - places)
        return np.asarray(inertia * speeds + pull_own + pull_leader)

    def _stalled(self, marks: list[float]) -> bool:
        back = self.stall_generations
        if back == 0 or len(marks) <= back:
            return False
        return marks[-1 - back] - marks[-1] <= self.tolerance * max(1.0, abs(marks[-1]))


@dataclass(frozen=True)
class SwarmState:
    """Inertia, neighbourhood and stall counter of the swarm.

    Attributes:
        inertia: w.
        neighbours: N_h.
        stalls: c.
        smallest: N_min.
        particles: N.
        inertia_low: Lowest w.
        inertia_high: Highest w.
    """

    inertia: float
    neighbours: int
    stalls: int
    smallest: int
    particles: int
    inertia_low: float = 0.1
    inertia_high: float = 1.1

    def after(self, *, better: bool, always: bool = True) -> SwarmState:
        """State after a generation, equations (21) and (22).

        Args:
            better: Whether the swarm found a value better than ever.
            always: Whether w changes after every generation, or only after a better one.

        Returns:
            The next swarm.
        """
        stalls = max(0, self.stalls - 1) if better else self.stalls + 1
        neighbours = self.smallest if better else min(self.neighbours + self.smallest, self.particles)
        inertia = self.inertia
        if better or always:
            factor = 2.0 if stalls < 2 else 0.5 if stalls > 5 else 1.0
            inertia = min(max(factor * inertia, self.inertia_low), self.inertia_high)
        return replace(self, inertia=inertia, neighbours=neighbours, stalls=stalls)


def leaders_of(own_values: FloatArray, draws: FloatArray, neighbours: int) -> npt.NDArray[np.int64]:
    """Index of the best particle of each particle's random neighbourhood.

    Args:
        own_values: Shape (N,): best value of each particle.
        draws: Shape (N, N), uniform: row i orders the others; its `neighbours - 1` smallest are i's neighbours,
            besides i itself.
        neighbours: N_h, itself included.

    Returns:
        Shape (N,).
    """
    order = draws.copy()
    np.fill_diagonal(order, -1.0)
    group = np.argsort(order, axis=1)[:, :neighbours]
    winner = np.argmin(own_values[group], axis=1)
    leaders: npt.NDArray[np.int64] = np.take_along_axis(group, winner[:, None], axis=1)[:, 0]
    return leaders


def stopped_at_bounds(
    places: FloatArray, speeds: FloatArray, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Particles that left the bounds are put on them and lose that component of their velocity.

    Args:
        places: Shape (N, p).
        speeds: Shape (N, p).
        low: Shape (p,).
        high: Shape (p,).

    Returns:
        Places and velocities, each shape (N, p).
    """
    inside = np.clip(places, low, high)
    return inside, np.where(inside == places, speeds, 0.0)

"""What paper 2's three genetic algorithms share: their run, rank weights, blending of parents, the statistical stop.

Paper 2 is the novel GA for Bouc-Wen identification; its equations follow Haupt's continuous GA and Kwok et al. 2007.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rig.identification.algorithms.search import Array, Search, require


def rank_weights(kept: int) -> Array:
    """Probability of each survivor to be a parent, best first: P_k = (N_keep - k + 1) / sum(1..N_keep).

    Args:
        kept: N_keep.

    Returns:
        Shape (kept,), sums to 1.
    """
    ranks = np.arange(kept, 0, -1, dtype=np.float64)
    return np.asarray(ranks / ranks.sum())


def pick(weights: Array, draws: Array) -> npt.NDArray[np.int64]:
    """The first m whose cumulative probability reaches the draw.

    Args:
        weights: Shape (n,), sums to 1.
        draws: Any shape, uniform in [0, 1).

    Returns:
        Indices, the draws' shape.
    """
    return np.minimum(np.searchsorted(np.cumsum(weights), draws, side="left"), len(weights) - 1)


def blend(mothers: Array, fathers: Array, draws: Array) -> tuple[Array, Array]:
    """Two children of each couple: o1 = ma - r (ma - pa), o2 = pa + r (ma - pa).

    Args:
        mothers: Shape (n, p).
        fathers: Shape (n, p).
        draws: Shape (n, 1) or (n, p): r, uniform in [0, 1).

    Returns:
        First and second children, each shape (n, p).
    """
    difference = mothers - fathers
    return mothers - draws * difference, fathers + draws * difference


@dataclass
class StatisticalStop:
    """Stop when another 20 % improvement of the largest minimum error has become improbable.

    By maximum entropy the minimum error e of the generations is taken as exponentially distributed about its mean;
    the chance of an error above 0.2 e_max is exp(-0.2 e_max / mean e). Stop when q >= q_min and that chance is at
    most p.

    Attributes:
        q_min: Generations needed before the statistics count.
        p: Largest chance at which to stop.
        errors: Minimum error of every generation so far.
    """

    q_min: int
    p: float
    errors: list[float] = field(default_factory=list)

    def add(self, minimum_error: float) -> bool:
        """Add a generation.

        Args:
            minimum_error: Its smallest objective value, positive or zero.

        Returns:
            Whether to stop.
        """
        self.errors.append(minimum_error)
        if len(self.errors) < self.q_min:
            return False
        return self.chance() <= self.p

    def chance(self) -> float:
        """Chance exp(-0.2 e_max / mean e); 0 once every error is 0."""
        mean = math.fsum(self.errors) / len(self.errors)
        return math.exp(-0.2 * max(self.errors) / mean) if mean > 0.0 else 0.0


@dataclass
class Pool:
    """The chromosomes of one search.

    Attributes:
        members: Shape (N, p).
        values: Shape (N,): objective of each.
        low: Shape (p,): lowest value of the first population and of mutation.
        high: Shape (p,): highest.
    """

    members: Array
    values: Array
    low: Array
    high: Array

    @classmethod
    def drawn(cls, search: Search, reach: float) -> Pool:
        """A first population, evaluated.

        Args:
            search: Draws and evaluates.
            reach: Half width where the search is unbounded.

        Returns:
            The pool.
        """
        members = search.draw(reach)
        return cls(members, search.evaluate(members), *search.box(reach))

    def sort(self) -> None:
        """Best first."""
        order = np.argsort(self.values, kind="stable")
        self.members, self.values = self.members[order], self.values[order]

    def evaluate(self, search: Search, rows: npt.NDArray[np.int64]) -> None:
        """Values of the chromosomes `rows`, shape (n,), that have changed."""
        self.values[rows] = search.evaluate(self.members[rows])


@dataclass(frozen=True)
class StatisticalGenetic(ABC):
    """A genetic algorithm with the statistical stop; a subclass says what one generation does.

    The first population is uniform in the bounds (within +-`reach` where there are none), `start` its first member.

    Attributes:
        q_min: Generations before the statistical stop counts.
        p: Chance at which the statistical stop ends the search; 0 never.
        reach: Half width of the first population and of mutation where unbounded.
    """

    method: ClassVar[str]
    q_min: int = 50
    p: float = 0.05
    reach: float = 10.0

    def __post_init__(self) -> None:
        require(self.method, "q_min", self.q_min, 1, 10**9)
        require(self.method, "p", self.p, 0.0, 1.0)
        require(self.method, "reach", self.reach, 1e-300, 1e300)

    def run(self, search: Search) -> str:
        """Search until the statistical stop, or until the budget is spent.

        Args:
            search: Evaluates, counts and archives.

        Returns:
            `statistics`.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        pool = Pool.drawn(search, self.reach)
        stop = StatisticalStop(self.q_min, self.p)
        while True:
            self.generation(search, pool)
            search.generation_done()
            if stop.add(float(pool.values.min())):
                return "statistics"

    @abstractmethod
    def generation(self, search: Search, pool: Pool) -> None:
        """One generation: parents, children, mutation, evaluation, in place.

        Args:
            search: Evaluates and draws.
            pool: The chromosomes.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """

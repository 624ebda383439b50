"""Paper 2's three genetic algorithms (novel, standard, Kwok's): their run, rank weights, blending, statistical stop.

Paper 2 is the novel GA for Bouc-Wen identification; its equations follow Haupt's continuous GA and Kwok et al. 2007.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
import numpy.typing as npt

from rig.optimisers.arrays import FloatArray
from rig.optimisers.search import Search, require


def rank_weights(kept: int) -> FloatArray:
    """Probability of each survivor to be a parent, best first: P_k = (N_keep - k + 1) / sum(1..N_keep).

    Args:
        kept: N_keep.

    Returns:
        Shape (kept,), sums to 1.
    """
    ranks = np.arange(kept, 0, -1, dtype=np.float64)
    return np.asarray(ranks / ranks.sum())


def pick(weights: FloatArray, draws: FloatArray) -> npt.NDArray[np.int64]:
    """The first m whose cumulative probability reaches the draw.

    Args:
        weights: Shape (n,), sums to 1.
        draws: Any shape, uniform in [0, 1).

    Returns:
        Indices, the draws' shape.
    """
    return np.minimum(np.searchsorted(np.cumsum(weights), draws, side="left"), len(weights) - 1)


def blend(mothers: FloatArray, fathers: FloatArray, draws: FloatArray) -> tuple[FloatArray, FloatArray]:
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

    members: FloatArray
    values: FloatArray
    low: FloatArray
    high: FloatArray

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


@dataclass(frozen=True)
class NovelGenetic(StatisticalGenetic):
    """The novel genetic algorithm of paper 2, with its statistical stop.

    Against the standard one: parents by rank weight among the better half; a father is never his child's mother
    (redrawn); a fixed number of crossovers each generation; an evaluation between crossover and mutation, so that the
    best child cannot be mutated away; mutation of single variables, mu (N_pop - 1) N_var of them, uniform inside the
    bounds, the elite excluded. The bounds matter therefore (the paper sets them by trial).

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


def other_parents(
    weights: FloatArray, mothers: npt.NDArray[np.int64], rng: np.random.Generator
) -> npt.NDArray[np.int64]:
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


def mutate(
    members: FloatArray, low: FloatArray, high: FloatArray, count: int, rng: np.random.Generator
) -> npt.NDArray[np.int64]:
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


@dataclass(frozen=True)
class StandardGenetic(StatisticalGenetic):
    """The standard genetic algorithm paper 2 compares with, reconstructed from what its own does differently.

    The better half survives; couples are drawn by roulette on 1 / error, mother and father possibly the same; a couple
    mates with a probability, else its copies go on; single variables mutate; everything new is evaluated once, after
    mutation, so a good child can be mutated away; the best survives.

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


def roulette(errors: FloatArray) -> FloatArray:
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


@dataclass(frozen=True)
class KwokGenetic(StatisticalGenetic):
    """The efficient genetic algorithm of Kwok et al. 2007, as both papers describe it; its population is 50.

    No selection stage: two chromosomes drawn at random make a child by linear blending, which replaces the first of
    them; how many is left to chance. A chromosome chosen for mutation is perturbed as a whole by a Gaussian kernel.
    After both, 2 % of the chromosomes, the worst, are replaced by copies of the best ever. It stops by statistics. The
    probabilities and the kernel's width are in neither paper: they are settings here.

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

"""What every algorithm searches with: the objective, the box, the budget, the archive of the true best.

An algorithm asks `Search.evaluate` for values and never counts, archives or stops by itself: the budget cannot be
exceeded, the best point ever seen cannot be lost, and the history is monotone whatever the algorithm does.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from rig.errors import RigError
from rig.optimisers.arrays import FloatArray
from rig.optimisers.evaluation import Evaluation, Objective

Bounds = Sequence[tuple[float, float]] | FloatArray


class SearchError(RigError):
    """A search cannot start: a setting, start or bound is wrong; the message says which, and what would fit."""


class SearchEndedError(Exception):
    """Raised inside a search to end it; `reason` becomes `Result.stopped_by`. Never leaves `minimise`."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(reason)


@dataclass(frozen=True)
class Progress:
    """Where a running search stands; handed to the callback after every generation's evaluations."""

    evaluations: int
    budget: int
    value: float
    best: FloatArray


Callback = Callable[[Progress], bool | None]


@dataclass(frozen=True)
class Result:
    """What a search found.

    Attributes:
        best: Best point ever evaluated, shape (p,).
        value: Objective there.
        evaluations: Objective evaluations spent, never more than the budget.
        history: Shape (k, 2): evaluations spent, best value so far; one row for each evaluated generation, values
            never rise.
        generations: Generations the algorithm completed.
        stopped_by: `budget`, `callback`, `stall`, `statistics` or `converged`.
        seconds: Wall time of the search.
        marks: Evaluations -> best point (p,) and value after so many; the end's where the search ended earlier.
    """

    best: FloatArray
    value: float
    evaluations: int
    history: FloatArray
    generations: int
    stopped_by: str
    seconds: float
    marks: Mapping[int, tuple[FloatArray, float]] = field(default_factory=dict)


@dataclass
class Search:
    """One running search: evaluates, counts, archives, reports.

    Attributes:
        objective: What is minimised.
        start: Shape (p,), or None when the caller gave none.
        low: Shape (p,): lower bounds, -inf where unbounded.
        high: Shape (p,): upper bounds, +inf where unbounded.
        population: Candidates a generation, N.
        budget: Evaluations allowed.
        rng: The only source of randomness.
        callback: Called after each evaluation with `Progress`; returning True ends the search.
        marks: Evaluations after which the best point is kept apart, though a generation is under way.
    """

    objective: Objective
    start: FloatArray | None
    low: FloatArray
    high: FloatArray
    population: int
    budget: int
    rng: np.random.Generator
    callback: Callback | None = None
    evaluation: Evaluation = field(default_factory=Evaluation)
    marks: tuple[int, ...] = ()
    best: FloatArray = field(init=False)
    value: float = field(init=False, default=float("inf"))
    evaluations: int = field(init=False, default=0)
    generations: int = field(init=False, default=0)
    history: list[tuple[int, float]] = field(init=False, default_factory=list)
    marked: dict[int, tuple[FloatArray, float]] = field(init=False, default_factory=dict)

    def __post_init__(self) -> None:
        self.best = np.full(self.objective.n_parameters, np.nan) if self.start is None else self.start.copy()

    @property
    def n_parameters(self) -> int:
        """Number of parameters p."""
        return self.objective.n_parameters

    @property
    def bounded(self) -> bool:
        """Whether every parameter has two finite bounds."""
        return bool(np.all(np.isfinite(self.low)) and np.all(np.isfinite(self.high)))

    @property
    def remaining(self) -> int:
        """Evaluations left."""
        return self.budget - self.evaluations

    def box(self, reach: float) -> tuple[FloatArray, FloatArray]:
        """Where a first population is drawn: the bounds, and `reach` either side of 0 where there is none.

        Args:
            reach: Half width for unbounded parameters, in the parameter's own unit.

        Returns:
            Two arrays (p,): lowest and highest initial values.
        """
        low = np.where(np.isfinite(self.low), self.low, np.minimum(-reach, self.high - 2 * reach))
        high = np.where(np.isfinite(self.high), self.high, np.maximum(reach, self.low + 2 * reach))
        return low, high

    def draw(self, reach: float, count: int | None = None) -> FloatArray:
        """First population, uniform in `box(reach)`; the caller's start, if any, is its first member.

        Args:
            reach: Half width for unbounded parameters.
            count: Rows; the population's size when None.

        Returns:
            Shape (count, p).
        """
        low, high = self.box(reach)
        rows = self.population if count is None else count
        points = low + (high - low) * self.rng.random((rows, self.n_parameters))
        if self.start is not None:
            points[0] = self.start
        return points

    def inside(self, points: FloatArray) -> FloatArray:
        """Points moved to the nearest place inside the bounds.

        Args:
            points: Shape (..., p).

        Returns:
            Same shape.
        """
        return np.clip(points, self.low, self.high)

    def evaluate(self, points: FloatArray) -> FloatArray:
        """Values of a generation; spends budget, archives the best, reports.

        Args:
            points: Shape (N, p).

        Returns:
            Shape (N,); NaN replaced by infinity.

        Raises:
            SearchEndedError: The budget is spent (what it still allowed has been evaluated and archived) or the
                callback said so.
        """
        allowed = points[: self.remaining]
        values = np.asarray(self.evaluation.values(self.objective, allowed), dtype=np.float64)
        values = np.where(np.isnan(values), np.inf, values)
        self.record(allowed, values)
        if len(allowed) < len(points):
            raise SearchEndedError("budget")
        return values

    def record(self, points: FloatArray, values: FloatArray) -> None:
        """Count and archive values that were found outside `evaluate` (local refinement).

        Args:
            points: Shape (N, p).
            values: Shape (N,).

        Raises:
            SearchEndedError: The callback said stop.
        """
        if not len(points):
            return
        before = self.evaluations
        after = before + len(points)
        ends = [*(mark for mark in self.marks if before < mark < after), after]
        for first, last in itertools.pairwise([0, *(end - before for end in ends)]):
            winner = first + int(np.argmin(values[first:last]))
            if self.evaluations == 0 or values[winner] < self.value:
                self.best, self.value = points[winner].copy(), float(values[winner])
            self.evaluations = before + last
            if self.evaluations in self.marks:
                self.marked[self.evaluations] = (self.best, self.value)
        self.history.append((self.evaluations, self.value))
        if self.callback is None:
            return
        if self.callback(Progress(self.evaluations, self.budget, self.value, self.best.copy())):
            raise SearchEndedError("callback")

    def generation_done(self) -> None:
        """Count a completed generation; end the search when nothing is left to spend.

        Raises:
            SearchEndedError: The budget is spent.
        """
        self.generations += 1
        if self.remaining <= 0:
            raise SearchEndedError("budget")

    def result(self, stopped_by: str, started_ns: int) -> Result:
        """What was found.

        Args:
            stopped_by: Why the search ended.
            started_ns: `time.monotonic_ns()` at its start.

        Returns:
            The finished result.
        """
        history = np.array(self.history, dtype=np.float64).reshape(-1, 2)
        seconds = (time.monotonic_ns() - started_ns) * 1e-9
        marks = {mark: self.marked.get(mark, (self.best, self.value)) for mark in self.marks}
        return Result(self.best, self.value, self.evaluations, history, self.generations, stopped_by, seconds, marks)


def require(algorithm: str, setting: str, value: float, low: float, high: float) -> None:
    """Refuse a setting outside its range.

    Args:
        algorithm: Name of the algorithm, for the message.
        setting: Name of the setting.
        value: What was given.
        low: Smallest value allowed.
        high: Largest value allowed.

    Raises:
        SearchError: The value is outside [low, high] or not a number.
    """
    if not low <= value <= high:
        raise SearchError(f"{algorithm}: {setting}: got {value!r}, expected {low:g} to {high:g}")


def make_search(
    objective: Objective,
    *,
    start: npt.ArrayLike | None,
    bounds: Bounds | None,
    population: int,
    budget: int,
    seed: int,
    callback: Callback | None,
    executor: Executor | None,
    chunks: int | None,
    marks: Sequence[int] = (),
) -> Search:
    """Check what the caller gave and make a `Search` of it.

    Args:
        objective: What is minimised.
        start: Shape (p,), or None.
        bounds: Shape (p, 2): lowest and highest value of each parameter; None for unbounded.
        population: Candidates a generation, at least 4.
        budget: Evaluations allowed, at least 1.
        seed: Seed of the generator.
        callback: Called after each evaluation; True ends the search.
        executor: Where populations are evaluated; None: here.
        chunks: Parts a population is cut into for the executor; None: one for each processor of this machine.
        marks: Evaluations after which the best point is kept apart.

    Returns:
        A search that has evaluated nothing yet.

    Raises:
        SearchError: Shapes, bounds, population or budget do not make sense.
    """
    size = objective.n_parameters
    require("search", "population", population, 4, 1_000_000)
    require("search", "budget", budget, 1, 1e12)
    low, high = np.full(size, -np.inf), np.full(size, np.inf)
    if bounds is not None:
        box = np.asarray(bounds, dtype=np.float64)
        if box.shape != (size, 2):
            raise SearchError(f"bounds: got shape {box.shape}, expected ({size}, 2) for {size} parameters")
        low, high = box[:, 0].copy(), box[:, 1].copy()
        wrong = np.flatnonzero(~(low < high))
        if wrong.size:
            raise SearchError(
                f"bounds[{wrong[0]}]: got ({low[wrong[0]]:g}, {high[wrong[0]]:g}), expected the first value to be less "
                "than the second"
            )
    first = None if start is None else _checked_start(np.asarray(start, dtype=np.float64), low, high)
    rng = np.random.default_rng(seed)
    return Search(
        objective,
        first,
        low,
        high,
        population,
        budget,
        rng,
        callback,
        Evaluation(executor, chunks),
        tuple(sorted(set(marks))),
    )


def _checked_start(start: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    if start.shape != low.shape:
        raise SearchError(f"start: got shape {start.shape}, expected ({low.size},) for {low.size} parameters")
    outside = np.flatnonzero(~((start >= low) & (start <= high)) | ~np.isfinite(start))
    if outside.size:
        at = outside[0]
        raise SearchError(f"start[{at}]: got {start[at]:g}, expected {low[at]:g} to {high[at]:g}")
    return start

"""The algorithms by name, the one call that runs any of them, and the hybrid that ends with local least squares."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from typing import Protocol, cast, runtime_checkable

import numpy as np
import numpy.typing as npt

from protocols.near_miss import near_names
from rig.optimisers.arrays import FloatArray
from rig.optimisers.bee_colony import ImprovedBeeColony
from rig.optimisers.differential_evolution import DifferentialEvolution
from rig.optimisers.evaluation import Objective
from rig.optimisers.fruit_fly import ContrastFruitFly, FruitFly
from rig.optimisers.genetic import Genetic
from rig.optimisers.particle_swarm import ParticleSwarm
from rig.optimisers.search import (
    Bounds,
    Callback,
    Result,
    Search,
    SearchEndedError,
    SearchError,
    make_search,
    require,
)
from rig.optimisers.statistical_genetic import KwokGenetic, NovelGenetic, StandardGenetic
from rig.plugins import METHODS as PLUG_INS
from rig.plugins import Catalogue

STEERED_BY_BUDGET = frozenset({"ga", "hybrid"})
"""Methods whose path depends on the budget (mutation that shrinks until its end, a share of it). Any other search is
the beginning of every longer one with the same seed."""


class Algorithm(Protocol):
    """An algorithm with its settings; `run` searches until the search ends or the algorithm itself stops."""

    def run(self, search: Search) -> str:
        """Search.

        Args:
            search: Evaluates, counts and archives.

        Returns:
            Why the algorithm stopped by itself: `stall`, `statistics` or `converged`.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """


@runtime_checkable
class HasResiduals(Protocol):
    """An objective that is a sum of squares and can name its terms."""

    def residuals(self, vector: FloatArray, /) -> FloatArray:
        """Residuals, shape (n,), whose squares sum to the objective, at `vector` (p,)."""


@dataclass(frozen=True)
class Hybrid:
    """A swarm, then local least squares: the future work the c-FOA paper announces.

    Any of the other algorithms spends its share of the budget; from its best point the trust-region least squares of
    SciPy (scaled by the Jacobian) goes on. Every residual evaluation counts, finite differences included. The objective
    must offer `residuals(vector) -> (n,)`.

    Attributes:
        first: Name of the algorithm that searches globally.
        settings: That algorithm's settings.
        share: Part of the budget it may spend.
        tolerance: Relative change of value, point and gradient at which the local search has converged.
    """

    first: str = "c_foa"
    settings: Mapping[str, object] = field(default_factory=dict)
    share: float = 0.75
    tolerance: float = 1e-10

    def __post_init__(self) -> None:
        require("hybrid", "share", self.share, 1e-6, 1.0)
        require("hybrid", "tolerance", self.tolerance, 1e-15, 0.1)
        if self.first == "hybrid":
            raise SearchError(
                "hybrid: first: got 'hybrid', expected another method, because hybrid cannot start itself"
            )

    def run(self, search: Search) -> str:
        """Search globally, then refine.

        Args:
            search: Evaluates, counts and archives.

        Returns:
            `converged` when the local search ended by itself.

        Raises:
            SearchError: The objective has no residuals.
            SearchEndedError: The budget is spent or the callback said stop.
        """
        if not isinstance(search.objective, HasResiduals):
            raise SearchError(
                f"hybrid: {type(search.objective).__name__} has no residuals(vector). Fix: use {self.first!r}"
            )
        algorithm = make_algorithm(self.first, **self.settings)
        whole = search.budget
        search.budget = max(1, int(self.share * whole))
        try:
            algorithm.run(search)
        except SearchEndedError as end:
            if end.reason != "budget":
                raise
        finally:
            search.budget = whole
        self._refine(search, search.objective)
        return "converged"

    def _refine(self, search: Search, objective: HasResiduals) -> None:
        from scipy.optimize import least_squares  # only this needs SciPy

        def counted(vector: FloatArray) -> FloatArray:
            if search.remaining <= 0:
                raise SearchEndedError("budget")
            residuals = objective.residuals(vector)
            value = float(residuals @ residuals)
            search.record(vector[None, :], np.array([value if np.isfinite(value) else np.inf]))
            return residuals

        least_squares(
            counted,
            search.best.copy(),
            bounds=(search.low, search.high),
            x_scale="jac",
            ftol=self.tolerance,
            xtol=self.tolerance,
            gtol=self.tolerance,
        )
        search.generations += 1


OWN: dict[str, type[Algorithm]] = {
    "c_foa": ContrastFruitFly,
    "foa": FruitFly,
    "ga": Genetic,
    "de": DifferentialEvolution,
    "pso": ParticleSwarm,
    "i_abc": ImprovedBeeColony,
    "ga_standard": StandardGenetic,
    "ga_kwok": KwokGenetic,
    "ga_novel": NovelGenetic,
    "hybrid": Hybrid,
}
"""This program's methods: name -> settings class."""


def method_of_plug_in(name: str, brought: object) -> type[Algorithm]:
    """A plug-in's method: a dataclass of its settings, with `run(search) -> str`.

    Raises:
        ValueError: It is something else.
    """
    if not isinstance(brought, type) or not is_dataclass(brought) or not callable(getattr(brought, "run", None)):
        raise ValueError(f"got {brought!r}, expected a dataclass with a method run(search) -> str")
    for setting in fields(brought):
        if setting.default is MISSING and setting.default_factory is MISSING:
            raise ValueError(
                f"setting {setting.name!r}: has no default, which is required because `--method {name}` cannot "
                "specify settings"
            )
    return cast("type[Algorithm]", brought)


METHODS: Mapping[str, type[Algorithm]] = Catalogue(OWN, PLUG_INS, method_of_plug_in)
"""Method name -> its settings class; plug-ins (entry points `mr_rig.methods`) behind our own."""


def make_algorithm(method: str, **settings: object) -> Algorithm:
    """Algorithm by name with its settings.

    Args:
        method: A key of `METHODS`.
        **settings: Fields of the algorithm's settings class; unnamed ones keep the published value.

    Returns:
        The algorithm, ready to run.

    Raises:
        SearchError: Unknown method or setting, or a value outside its range; the message names what would fit.
        PlugInProblem: It is a plug-in's, and that cannot be used.
    """
    if method not in METHODS:
        raise SearchError(
            f"method: got {method!r}{_closest(method, list(METHODS))}, expected one of {', '.join(METHODS)}"
        )
    known = [setting.name for setting in fields(METHODS[method])]  # type: ignore[arg-type]  # settings are dataclasses
    for name in settings:
        if name not in known:
            raise SearchError(
                f"{method}: got setting {name!r}{_closest(name, known)}, expected one of {', '.join(known)}"
            )
    return METHODS[method](**settings)


def minimise(
    objective: Objective,
    *,
    method: str,
    start: npt.ArrayLike | None = None,
    bounds: Bounds | None = None,
    population: int = 50,
    budget: int = 16_000,
    seed: int = 0,
    callback: Callback | None = None,
    executor: Executor | None = None,
    chunks: int | None = None,
    marks: Sequence[int] = (),
    **settings: object,
) -> Result:
    """Minimise an objective with one of the published algorithms.

    Args:
        objective: Has `n_parameters` (p) and `batch((N, p)) -> (N,)`.
        method: A key of `METHODS`.
        start: Shape (p,): a point to start from; each algorithm says what it does with it and without it.
        bounds: Shape (p, 2): lowest and highest value of each parameter; None for an unbounded search, as the papers
            search.
        population: Candidates a generation, N.
        budget: Objective evaluations allowed; never exceeded.
        seed: The same seed gives the same result, whatever the executor.
        callback: Called with `Progress` after every evaluated generation; returning True ends the search.
        executor: Any `concurrent.futures.Executor`; populations are split into `chunks`, the objective travels once a
            worker.
        chunks: Parts of a population; None: one for each processor of this machine (give the cluster's size for a
            cluster).
        marks: Evaluations after which `Result.marks` says what was found: what a search of that budget finds, where
            the method is not in `STEERED_BY_BUDGET`.
        **settings: The algorithm's own settings, by the names of its class.

    Returns:
        Best point, value, evaluations, history, why it stopped, wall seconds.

    Raises:
        SearchError: Something given does not make sense; nothing was evaluated.
    """
    algorithm = make_algorithm(method, **settings)
    search = make_search(
        objective,
        start=start,
        bounds=bounds,
        population=population,
        budget=budget,
        seed=seed,
        callback=callback,
        executor=executor,
        chunks=chunks,
        marks=marks,
    )
    started_ns = time.monotonic_ns()
    try:
        stopped_by = algorithm.run(search)
    except SearchEndedError as end:
        stopped_by = end.reason
    return search.result(stopped_by, started_ns)


def _closest(name: str, known: list[str]) -> str:
    near = near_names(name, known)
    return f" (did you mean {near[0]!r}?)" if near else ""

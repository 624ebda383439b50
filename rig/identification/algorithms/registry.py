"""The algorithms by name, and the one call that runs any of them."""

from __future__ import annotations

import dataclasses
import difflib
import importlib
import time
from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Protocol

import numpy.typing as npt

from rig.identification.algorithms.search import (
    Bounds,
    Callback,
    Objective,
    Result,
    Search,
    SearchEndedError,
    SearchError,
    make_search,
)

_PACKAGE = "rig.identification.algorithms"

METHODS: dict[str, tuple[str, str]] = {
    "c_foa": ("c_foa", "ContrastFruitFly"),
    "foa": ("foa", "FruitFly"),
    "ga": ("ga", "Genetic"),
    "de": ("de", "DifferentialEvolution"),
    "pso": ("pso", "ParticleSwarm"),
    "i_abc": ("i_abc", "ImprovedBeeColony"),
    "ga_standard": ("ga_standard", "StandardGenetic"),
    "ga_kwok": ("ga_kwok", "KwokGenetic"),
    "ga_novel": ("ga_novel", "NovelGenetic"),
    "hybrid": ("hybrid", "Hybrid"),
}
"""Method name -> module of this package and its settings class."""

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


def make_algorithm(method: str, **settings: object) -> Algorithm:
    """Algorithm by name with its settings.

    Args:
        method: A key of `METHODS`.
        **settings: Fields of the algorithm's settings class; unnamed ones keep the published value.

    Returns:
        The algorithm, ready to run.

    Raises:
        SearchError: Unknown method or setting, or a value outside its range; the message names what would fit.
    """
    if method not in METHODS:
        raise SearchError(f"method {method!r} is unknown{_closest(method, list(METHODS))}; known: {', '.join(METHODS)}")
    module_name, class_name = METHODS[method]
    settings_class = getattr(importlib.import_module(f"{_PACKAGE}.{module_name}"), class_name)
    known = [field.name for field in dataclasses.fields(settings_class)]
    for name in settings:
        if name not in known:
            raise SearchError(f"{method} has no setting {name!r}{_closest(name, known)}; it has: {', '.join(known)}")
    algorithm: Algorithm = settings_class(**settings)
    return algorithm


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
    near = difflib.get_close_matches(name, known, n=1)
    return f" (did you mean {near[0]!r}?)" if near else ""

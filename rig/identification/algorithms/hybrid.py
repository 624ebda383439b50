"""A swarm, then local least squares: the future work the c-FOA paper announces.

Any of the other algorithms spends its share of the budget; from its best point the trust-region least squares of
SciPy (scaled by the Jacobian) goes on. Every residual evaluation counts, finite differences included.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np

from rig.identification.algorithms.search import Array, Search, SearchEndedError, SearchError, require


@runtime_checkable
class HasResiduals(Protocol):
    """An objective that is a sum of squares and can name its terms."""

    def residuals(self, vector: Array, /) -> Array:
        """Residuals, shape (n,), whose squares sum to the objective, at `vector` (p,)."""


@dataclass(frozen=True)
class Hybrid:
    """Settings of the hybrid. The objective must offer `residuals(vector) -> (n,)`.

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
            raise SearchError("hybrid: first = 'hybrid' would never start; name another method")

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
        from rig.identification.algorithms.registry import (
            make_algorithm,
        )  # the registry imports every algorithm by name

        if not isinstance(search.objective, HasResiduals):
            raise SearchError(f"hybrid: {type(search.objective).__name__} has no residuals(vector); use {self.first!r}")
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

        def counted(vector: Array) -> Array:
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

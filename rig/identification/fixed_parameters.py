"""A problem with some of its parameters held, so that a search has none to find that the tests cannot tell."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rig.identification.problem import Problem

FloatArray = NDArray[np.float64]


class FixedParameters:
    """Equation (12) as a function of a problem's other parameters.

    Attributes:
        problem: the whole problem.
        names: names of the free parameters, in the vector's order.
    """

    def __init__(self, problem: Problem, fixed: Mapping[str, float], scale: float = 1.0) -> None:
        """Hold some parameters.

        Args:
            problem: the whole problem.
            fixed: values (SI) of those that are held; names the problem does not have are ignored.
            scale: factor on the objective.
        """
        self.problem = problem
        self.names = tuple(name for name in problem.names if name not in fixed)
        self._free = [problem.names.index(name) for name in self.names]
        self._whole = np.array([fixed.get(name, 0.0) for name in problem.names])
        self._scale = scale

    @property
    def n_parameters(self) -> int:
        """Number of free parameters p."""
        return len(self.names)

    @property
    def bounds(self) -> FloatArray:
        """Admissible range of each free parameter, shape (p, 2)."""
        return np.asarray(self.problem.bounds[self._free])

    @property
    def start(self) -> FloatArray:
        """A sensible first guess of the free parameters, shape (p,)."""
        return np.asarray(self.problem.start[self._free])

    def whole(self, population: FloatArray) -> FloatArray:
        """Vectors of the problem, shape (N, all parameters), for free parameters of shape (N, p)."""
        vectors = np.tile(self._whole, (len(population), 1))
        vectors[:, self._free] = population
        return vectors

    def batch(self, population: FloatArray) -> FloatArray:
        """Values of candidates of shape (N, p), shape (N,).

        Raises:
            ValueError: the second dimension is not `n_parameters`.
        """
        return np.asarray(self._scale * self.problem.batch(self.whole(population)))

    def residuals(self, vector: FloatArray) -> FloatArray:
        """Residuals of one candidate, shape (n_samples,), whose squares sum to its value; the vector has shape (p,).

        Raises:
            ValueError: the vector's length is not `n_parameters`.
        """
        return np.asarray(math.sqrt(self._scale) * self.problem.residuals(self.whole(vector[None, :])[0]))

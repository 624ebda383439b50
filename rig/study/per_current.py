"""Paper 2's searches: one test at one current, a Bouc-Wen model without affine terms, its fitness and its boxes."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rig.dampers import model as damper_model
from rig.identification.algorithms import Result
from rig.identification.algorithms.zhu_three_step import identify
from rig.identification.measurement import Measurement
from rig.identification.problem import Problem
from rig.study.result_line import error_summary, result_line
from rig.study.search_cell import SearchCell
from rig.study.study_file import CurrentStudy

Array = npt.NDArray[np.float64]

CURRENT_BOXES: dict[str, dict[str, tuple[float, float]]] = {
    "bouc_wen": {
        "c0": (0.0, 5e3), "k0": (0.0, 2e4), "x0": (-0.05, 0.05), "alpha": (0.0, 2e5), "gamma": (0.0, 2e5),
        "beta": (0.0, 2e5), "n": (1.0, 3.0),
    },
    "normalized_bouc_wen": {
        "kx": (0.0, 2e4), "kv": (0.0, 5e3), "kw": (0.0, 5e3), "f0": (-500.0, 500.0), "rho": (10.0, 1e4),
        "sigma": (0.5, 5.0), "n": (1.0, 5.0),
    },
}  # fmt: skip
"""Search boxes of paper 2's genetic algorithms, which mutate uniformly in them; wide for a damper of a few kN."""

CURRENT_FIXED: dict[str, dict[str, float]] = {
    "bouc_wen": {"c0_b": 0.0, "alpha_b": 0.0, "A": 40.0},
    "normalized_bouc_wen": {"kv_b": 0.0, "kw_b": 0.0},
}
"""Held when one current is fitted: the affine terms, and A, which is redundant with alpha."""


class FixedParameters:
    """An objective with some of a problem's parameters held, so that one current's test has no affine terms to find.

    Attributes:
        names: Names of the free parameters, in the vector's order.
    """

    def __init__(self, problem: Problem, fixed: Mapping[str, float], scale: float = 1.0) -> None:
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
    def bounds(self) -> Array:
        """Range of each free parameter, shape (p, 2)."""
        return np.asarray(self.problem.bounds[self._free])

    def whole(self, population: Array) -> Array:
        """Vectors of the problem.

        Args:
            population: Shape (N, p).

        Returns:
            Shape (N, all parameters).
        """
        vectors = np.tile(self._whole, (len(population), 1))
        vectors[:, self._free] = population
        return vectors

    def batch(self, population: Array) -> Array:
        """Values of candidates.

        Args:
            population: Shape (N, p).

        Returns:
            Shape (N,), in multiples of 1 / scale.
        """
        return np.asarray(self._scale * self.problem.batch(self.whole(population)))


def current_objective(test: Measurement, wanted: CurrentStudy) -> FixedParameters:
    """Paper 2's fitness of one test: mean(((F_sim - F_exp) / SD(F_exp))^2).

    Args:
        test: The recording, at constant current.
        wanted: Its model.

    Returns:
        The objective over the parameters that one current can tell.
    """
    problem = Problem([test], wanted.model, "1")
    scale = 1.0 / (len(test.force_N) * float(np.var(test.force_N, ddof=1)))
    return FixedParameters(problem, CURRENT_FIXED[wanted.model], scale)


def current_box(wanted: CurrentStudy, names: Sequence[str]) -> Array:
    """Search box of the per-current study.

    Args:
        wanted: Its model.
        names: Free parameters.

    Returns:
        Shape (p, 2).
    """
    return np.array([CURRENT_BOXES[wanted.model][name] for name in names])


def three_steps(cell: SearchCell, test: Measurement) -> dict[str, Any]:
    """Zhu's three steps on one test, as a results line.

    Args:
        cell: The search.
        test: The recording; its first cycle settles the model and does not count in the errors.

    Returns:
        A line of the results file; `evaluations` are integrations of the transitions.

    Raises:
        IdentificationFailed: The loop has no saturated branch or too few samples.
    """
    started_ns = time.monotonic_ns()
    fit = identify(test.u_m, test.v_m_s, test.force_N)
    seconds = (time.monotonic_ns() - started_ns) * 1e-9
    names = ("kx", "kv", "kw", "f0", "rho", "sigma", "n")
    values = {name: float(getattr(fit, name)) for name in names}
    force_N = damper_model("normalized_bouc_wen").force(
        {**values, "kv_b": 0.0, "kw_b": 0.0}, test.u_m, test.v_m_s, test.a_m_s2, test.current_A, test.dt_s
    )
    error_N = (test.force_N - force_N)[test.samples_per_cycle :]
    value = float(np.mean(error_N**2) / np.var(test.force_N, ddof=1))
    history = np.array([[fit.evaluations, value]])
    found = Result(np.array(list(values.values())), value, fit.evaluations, history, 0, "converged", seconds)
    return result_line(cell, names, found, **error_summary(error_N))

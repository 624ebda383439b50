"""Paper 2's searches: one test at one current, a Bouc-Wen model without affine terms, its fitness and its boxes."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from rig.dampers import model as damper_model
from rig.dampers.arrays import FloatArray
from rig.errors import IdentificationFailed
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.problem import FixedParameters, Problem
from rig.identification.models.three_steps import identify
from rig.optimisers import Result
from rig.study.result_line import error_summary, failure_line, result_line
from rig.study.search_cell import SearchCell
from rig.study.study_file import CurrentStudy

CURRENT_FIXED: dict[str, dict[str, float]] = {
    "bouc_wen": {"c0_b": 0.0, "alpha_b": 0.0, "A": 40.0},
    "normalized_bouc_wen": {"kv_b": 0.0, "kw_b": 0.0},
}
"""Held when one current is fitted: the affine terms, and A, which is redundant with alpha."""


def current_objective(test: Measurement, wanted: CurrentStudy) -> FixedParameters:
    """Paper 2's fitness of one test: mean(((F_sim - F_exp) / SD(F_exp))^2).

    Args:
        test: The recording, at constant current.
        wanted: Its model.

    Returns:
        The objective over the parameters that one current can tell.
    """
    problem = Problem([test], wanted.model, "1")
    measured_N = test.force_N[test.scored]
    scale = 1.0 / (len(measured_N) * float(np.var(measured_N, ddof=1)))
    return FixedParameters(problem, CURRENT_FIXED[wanted.model], scale)


def current_box(wanted: CurrentStudy, names: Sequence[str]) -> FloatArray:
    """Search box of the per-current study.

    Args:
        wanted: Its model and boxes.
        names: Free parameters.

    Returns:
        Shape (p, 2).
    """
    return np.array([wanted.boxes[name] for name in names])


def three_steps(cell: SearchCell, test: Measurement) -> dict[str, Any]:
    """Zhu's three steps on one test, as a results line.

    Args:
        cell: The search.
        test: The recording.

    Returns:
        A line of the results file; `evaluations` are integrations of the transitions. Where the loop has no saturated
        branch or too few samples, a line that says so.
    """
    started_ns = time.monotonic_ns()
    try:
        fit = identify(*(samples[test.scored] for samples in (test.u_m, test.v_m_s, test.force_N)))
    except IdentificationFailed as error:
        return failure_line(cell, f"{test.id}: {error}")
    seconds = (time.monotonic_ns() - started_ns) * 1e-9
    names = ("kx", "kv", "kw", "f0", "rho", "sigma", "n")
    values = {name: float(getattr(fit, name)) for name in names}
    force_N = modelled_force(damper_model("normalized_bouc_wen"), {**values, "kv_b": 0.0, "kw_b": 0.0}, test)
    error_N = (test.force_N - force_N)[test.scored]
    value = float(np.mean(error_N**2) / np.var(test.force_N[test.scored], ddof=1))
    history = np.array([[fit.evaluations, value]])
    found = Result(np.array(list(values.values())), value, fit.evaluations, history, 0, "converged", seconds)
    return result_line(cell, names, found, **error_summary(error_N))

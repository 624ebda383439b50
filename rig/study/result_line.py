"""What a results line holds: the search, what it found, and the fit's errors in newton."""

from __future__ import annotations

import os
import socket
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from rig.identification.algorithms import Result
from rig.identification.problem import Problem
from rig.study.search_cell import SearchCell

Array = npt.NDArray[np.float64]

HISTORY_ROWS = 80


def result_line(cell: SearchCell, names: Sequence[str], found: Result, **more: object) -> dict[str, Any]:
    """A line of the results file.

    Args:
        cell: The search.
        names: Parameter names, in the order of `found.best`.
        found: What the search found.
        **more: Further entries.

    Returns:
        Plain values, ready for JSON.
    """
    return {
        "key": cell.key,
        "problem": cell.problem,
        "method": cell.method,
        "population": cell.population,
        "budget": cell.budget,
        "repeat": cell.repeat,
        "settings": dict(cell.settings),
        "value": found.value,
        "parameters": {name: float(each) for name, each in zip(names, found.best, strict=True)},
        "evaluations": found.evaluations,
        "generations": found.generations,
        "stopped_by": found.stopped_by,
        "seconds": found.seconds,
        "host": f"{socket.gethostname()}:{os.getpid()}",
        "history": thin_history(found.history),
        **more,
    }


def thin_history(history: Array) -> list[list[float]]:
    """At most `HISTORY_ROWS` rows of a history, evenly spaced, the last one included.

    Args:
        history: Shape (k, 2): evaluations, best value.

    Returns:
        Rows as lists.
    """
    if not len(history):
        return []
    rows = np.unique(np.linspace(0, len(history) - 1, HISTORY_ROWS).astype(int))
    return [[int(history[row, 0]), float(history[row, 1])] for row in rows]


def force_errors(problem: Problem, vector: Array) -> dict[str, float]:
    """Errors of a fit in newton, whatever the objective's weight (PHYSICS: RMSE, MAE, SD always reported).

    Args:
        problem: Its tests and model.
        vector: Shape (p,).

    Returns:
        `rmse_N`, `mae_N` (mean |e|) and `sd_N` (sqrt(sum (e - mean e)^2 / (N - 1))).
    """
    values = {**dict.fromkeys(problem.model.names, 1.0), **problem.values(vector)}
    errors = [
        test.force_N - problem.model.force(values, test.u_m, test.v_m_s, test.a_m_s2, test.current_A, test.dt_s)
        for test in problem.measurements
    ]
    return error_summary(np.concatenate(errors))


def error_summary(error_N: Array) -> dict[str, float]:
    """RMSE, MAE and SD of force errors.

    Args:
        error_N: Shape (n,), measured minus model, N.

    Returns:
        `rmse_N`, `mae_N`, `sd_N`.
    """
    return {
        "rmse_N": float(np.sqrt(np.mean(error_N**2))),
        "mae_N": float(np.mean(np.abs(error_N))),
        "sd_N": float(np.std(error_N, ddof=1)),
    }

"""What a results line holds: the search, what it found, and the fit's errors in newton."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.problem import Problem
from rig.optimisers import Result
from rig.study.search_cell import SearchCell

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
        "parameters": _named(names, found.best),
        "evaluations": found.evaluations,
        "generations": found.generations,
        "stopped_by": found.stopped_by,
        "seconds": found.seconds,
        "host": f"{socket.gethostname()}:{os.getpid()}",
        "history": thin_history(found.history),
        "marks": {
            str(mark): {"value": value, "parameters": _named(names, best)}
            for mark, (best, value) in found.marks.items()
        },
        **more,
    }


def failure_line(cell: SearchCell, why: str) -> dict[str, Any]:
    """A line of the results file for a method that cannot do what was asked: it is not tried again.

    Args:
        cell: The search.
        why: What the data lack.

    Returns:
        Plain values; `failed` instead of a value.
    """
    return {
        "key": cell.key,
        "problem": cell.problem,
        "method": cell.method,
        "budget": cell.budget,
        "repeat": cell.repeat,
        "seconds": 0.0,
        "marks": {},
        "failed": why,
    }


def shorter_lines(line: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Results at the smaller budgets a search served.

    Args:
        line: From `result_line`.

    Yields:
        A line without what only the whole search has.
    """
    for mark, found in line["marks"].items():
        same = {name: line[name] for name in ("problem", "method", "population", "repeat", "settings")}
        cell = SearchCell(budget=int(mark), **same)
        history = [row for row in line["history"] if row[0] <= cell.budget]
        spent = min(cell.budget, line["evaluations"])
        yield {**same, **found, "key": cell.key, "budget": cell.budget, "evaluations": spent, "history": history}


def thin_history(history: FloatArray) -> list[list[float]]:
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


def force_errors(problem: Problem, vector: FloatArray) -> dict[str, float]:
    """Errors of a fit in newton, whatever the objective's weight (PHYSICS: RMSE, MAE, SD always reported).

    Args:
        problem: Its tests and model.
        vector: Shape (p,).

    Returns:
        `rmse_N`, `mae_N` (mean |e|) and `sd_N` (sqrt(sum (e - mean e)^2 / (N - 1))).
    """
    values = problem.values(vector)
    errors = [
        (test.force_N - modelled_force(problem.model, values, test))[test.scored] for test in problem.measurements
    ]
    return error_summary(np.concatenate(errors))


def error_summary(error_N: FloatArray) -> dict[str, float]:
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


def _named(names: Sequence[str], vector: FloatArray) -> dict[str, float]:
    return {name: float(each) for name, each in zip(names, vector, strict=True)}

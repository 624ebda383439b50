"""The study's results: what a line holds, and the append-only file of lines, safe against an interrupted write.

One line is one search, a JSON object with a key. A line's `marks` are results of their own: the values of the same
search at smaller budgets.
"""

from __future__ import annotations

import io
import json
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np

from drivers.posix import fcntl
from rig.dampers.arrays import FloatArray
from rig.errors import FileProblem
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.problem import Problem
from rig.optimisers import Result
from rig.recording.atomic_write import open_to_append
from rig.study.provenance import SOFTWARE
from rig.study.search_cell import SearchCell

HISTORY_ROWS = 80


def result_line(cell: SearchCell, names: Sequence[str], result: Result, **more: object) -> dict[str, Any]:
    """A line of the results file.

    Args:
        cell: The search.
        names: Parameter names, in the order of `result.best`.
        result: What the search found.
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
        "value": result.value,
        "parameters": _named(names, result.best),
        "evaluations": result.evaluations,
        "generations": result.generations,
        "stopped_by": result.stopped_by,
        "seconds": result.seconds,
        "host": f"{socket.gethostname()}:{os.getpid()}",
        "software": SOFTWARE,
        "history": thin_history(result.history),
        "marks": {
            str(mark): {"value": value, "parameters": _named(names, best)}
            for mark, (best, value) in result.marks.items()
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
        "software": SOFTWARE,
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
    for mark, entry in line["marks"].items():
        same = {name: line[name] for name in ("problem", "method", "population", "repeat", "settings")}
        cell = SearchCell(budget=int(mark), **same)
        history = [row for row in line["history"] if row[0] <= cell.budget]
        spent = min(cell.budget, line["evaluations"])
        yield {**same, **entry, "key": cell.key, "budget": cell.budget, "evaluations": spent, "history": history}


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
    return {name: float(value) for name, value in zip(names, vector, strict=True)}


FORMAT = 2


class ResultsFile:
    """Results of a study by key; opened, it first reads what earlier sessions left.

    The first line names the format and the fingerprint of study and recordings. A last line without its end, left by
    a session that was killed, is cut off. One process at a time holds the file.

    Attributes:
        fingerprint: Of the study and its recordings.
        lines: Results by key.
    """

    def __init__(self, path: Path, fingerprint: str) -> None:
        self.path = path
        self.fingerprint = fingerprint
        self.lines: dict[str, dict[str, Any]] = {}
        self._file = io.TextIOWrapper(open_to_append(path), encoding="utf-8", write_through=True)
        try:
            self._hold()
            self._read()
        except BaseException:
            self._file.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def __contains__(self, key: object) -> bool:
        return key in self.lines

    def add(self, line: dict[str, Any]) -> None:
        """Append one result and make it durable.

        Args:
            line: Has `key`.
        """
        self._write(line)
        self._take(line)

    def _take(self, line: dict[str, Any]) -> None:
        self.lines[str(line["key"])] = line
        for shorter in shorter_lines(line):
            self.lines[shorter["key"]] = shorter

    def _hold(self) -> None:
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise FileProblem(
                str(self.path), ["another `rig study` is using this folder. Fix: wait until it has finished, or "
                    "specify another folder with --out"]
            ) from error

    def _write(self, line: dict[str, Any]) -> None:
        self._file.write(json.dumps(line, separators=(",", ":")) + "\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def _read(self) -> None:
        text = self.path.read_text(encoding="utf-8")
        whole = text[: text.rfind("\n") + 1]
        if not whole:
            os.truncate(self.path, 0)
            self._write({"format": FORMAT, "fingerprint": self.fingerprint})
            return
        if len(whole) < len(text):
            os.truncate(self.path, len(whole.encode()))
        for number, line in enumerate(whole.splitlines()):
            try:
                entry = json.loads(line)
            except json.JSONDecodeError as error:
                raise FileProblem(
                    str(self.path), [f"line {number + 1}: not valid JSON ({error.msg}). Fix: delete that line"]
                ) from error
            if number == 0:
                self._check(entry)
            else:
                self._take(entry)

    def _check(self, header: dict[str, Any]) -> None:
        if header.get("format") != FORMAT:
            raise FileProblem(
                str(self.path),
                [f"line 1: format: got {header.get('format')!r}, expected {FORMAT}. Fix: specify another folder with "
                    "--out"],
            )
        if header.get("fingerprint") != self.fingerprint:
            raise FileProblem(
                str(self.path),
                [
                    f"line 1: fingerprint: got {header.get('fingerprint')!r}, expected {self.fingerprint}: the results "
                    "belong to other recordings or settings. Fix: specify another folder with --out"
                ],
            )

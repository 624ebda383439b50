"""Run the missing searches of a study; each worker process receives the recordings once."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from rig.jobs.cluster import abandoned
from rig.jobs.workers import Job, Workers
from rig.study.results import ResultsFile
from rig.study.search_cell import SearchCell, searches
from rig.study.workbench import Workbench


def run_search(bench: Workbench, cell: SearchCell) -> dict[str, Any]:
    """In a worker: run one search.

    Args:
        bench: The study with its recordings.
        cell: The search.

    Returns:
        A line of the results file.
    """
    return bench.run(cell, lambda progress: abandoned())


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is.

    Attributes:
        done: Searches finished, those of earlier sessions included.
        total: Searches of the study.
        seconds_left: Estimate from what each kind of search has cost; None before the first result.
        last: Key of the search that just finished; empty at the start.
        doing: What is being done.
    """

    done: int
    total: int
    seconds_left: float | None
    last: str
    doing: str = "searches"


def run_cells(
    bench: Workbench,
    cells: list[SearchCell],
    results: ResultsFile,
    workers: Workers,
    report: Callable[[StudyProgress], None] | None = None,
) -> None:
    """Run the searches of every cell that has no result yet.

    Args:
        bench: The study with its recordings.
        cells: All cells of the study.
        results: File of the results, extended with each new result.
        workers: Workers that run the searches.
        report: Called at the start and after every search.

    Raises:
        KeyboardInterrupt: Passed on; finished searches are kept.
        RigError: The workers can no longer be used; finished searches are kept.
    """
    todo = searches(cells, results.lines)
    total = done = len(searches(cells, ()))
    done -= len(todo)
    report_progress = report or (lambda progress: None)
    report_progress(StudyProgress(done, total, None, ""))
    clock = _Clock(todo, workers.count)
    shared = workers.share(bench)
    for _, line in workers.results(Job(cell.key, run_search, (shared, cell)) for cell in todo):
        results.add(line)
        done += 1
        report_progress(StudyProgress(done, total, clock.finished(line), str(line["key"])))


class _Clock:
    """Time left: what each kind of search costs an evaluation, times the evaluations it still may spend."""

    def __init__(self, todo: list[SearchCell], workers: int) -> None:
        self._workers = workers
        self._left: Counter[tuple[str, str]] = Counter()
        self._spent: Counter[tuple[str, str]] = Counter()
        self._seconds: dict[tuple[str, str], float] = {}
        for cell in todo:
            self._left[cell.method, cell.problem] += cell.budget

    def finished(self, line: Mapping[str, Any]) -> float:
        """Seconds left after a search has finished."""
        kind = (line["method"], line["problem"])
        self._left[kind] -= line["budget"]
        self._spent[kind] += line["budget"]
        self._seconds[kind] = self._seconds.get(kind, 0.0) + line["seconds"]
        usual = sum(self._seconds.values()) / self._spent.total()
        costs = {kind: self._seconds[kind] / self._spent[kind] for kind in self._seconds}
        return sum(left * costs.get(kind, usual) for kind, left in self._left.items()) / self._workers

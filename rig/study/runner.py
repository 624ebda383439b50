"""Runs what is missing of a study and keeps the results file; knows how much time is left."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from typing import Any

from rig.study.results_file import ResultsFile
from rig.study.search_cell import SearchCell, searches
from rig.study.study_file import StudyFile
from rig.study.workers import Workers, run_search

QUEUED_PER_WORKER = 2


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
    study: StudyFile,
    cells: list[SearchCell],
    results: ResultsFile,
    workers: Workers,
    report: Callable[[StudyProgress], None] | None = None,
) -> None:
    """Run the searches of every cell that has no result yet.

    Args:
        study: The study.
        cells: All its cells.
        results: Where results are, and go as they come.
        workers: Who searches.
        report: Called at the start and after every search.

    Raises:
        KeyboardInterrupt: Passed on; finished searches are kept.
    """
    todo = searches(cells, results.lines)
    total = len(searches(cells, ()))
    tell = report or (lambda progress: None)
    tell(StudyProgress(total - len(todo), total, None, ""))
    clock = _Clock(todo, workers.count)
    waiting = list(reversed(todo))
    running: set[Future[dict[str, Any]]] = set()
    try:
        while waiting or running:
            while waiting and len(running) < QUEUED_PER_WORKER * workers.count:
                running.add(workers.executor.submit(run_search, study, results.fingerprint, waiting.pop()))
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                line = future.result()
                results.add(line)
                left_s = clock.finished(line)
                tell(StudyProgress(total - len(waiting) - len(running), total, left_s, str(line["key"])))
    finally:
        for future in running:
            future.cancel()


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

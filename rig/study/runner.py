"""Runs what is missing of a study on a pool of processes and keeps the results file; knows how much time is left."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.synchronize import Event
from typing import Any

from rig.study.results_file import ResultsFile
from rig.study.search_cell import SearchCell
from rig.study.study_file import StudyFile
from rig.study.workbench import Workbench

QUEUED_PER_PROCESS = 2

_bench: Workbench | None = None
_stop: Event | None = None


@dataclass(frozen=True)
class StudyProgress:
    """How far a study is.

    Attributes:
        done: Searches finished, those of earlier sessions included.
        total: Searches of the study.
        seconds_left: Estimate from this session's evaluations a second; None before the first result.
        last: Key of the search that just finished; empty at the start.
    """

    done: int
    total: int
    seconds_left: float | None
    last: str


def run_cells(
    study: StudyFile,
    cells: list[SearchCell],
    results: ResultsFile,
    processes: int | None = None,
    report: Callable[[StudyProgress], None] | None = None,
) -> None:
    """Run every search that has no result yet.

    Args:
        study: The study.
        cells: All its searches.
        results: Where results are, and go as they come.
        processes: Worker processes; None: one for each processor.
        report: Called at the start and after every search.

    Raises:
        KeyboardInterrupt: Passed on after the searches that run are abandoned; finished ones are kept.
    """
    todo = [cell for cell in cells if cell.key not in results]
    clock = _Clock(todo)
    tell = report or (lambda progress: None)
    tell(StudyProgress(len(cells) - len(todo), len(cells), None, ""))
    if not todo:
        return
    count = min(processes or os.cpu_count() or 1, len(todo))
    context = get_context("spawn")
    stop = context.Event()
    pool = ProcessPoolExecutor(count, context, initializer=_set_bench, initargs=(study, stop))
    try:
        waiting = list(reversed(todo))
        running: set[Future[dict[str, Any]]] = set()
        while waiting or running:
            while waiting and len(running) < QUEUED_PER_PROCESS * count:
                running.add(pool.submit(_run, waiting.pop()))
            finished, running = wait(running, return_when=FIRST_COMPLETED)
            for future in finished:
                line = future.result()
                results.add(line)
                left = clock.finished(int(line["budget"]))
                tell(StudyProgress(len(cells) - len(waiting) - len(running), len(cells), left, str(line["key"])))
    finally:
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)


class _Clock:
    """Time left, from the evaluations still to spend and the rate so far."""

    def __init__(self, todo: list[SearchCell]) -> None:
        self._left = sum(cell.budget for cell in todo)
        self._spent = 0
        self._started_ns = time.monotonic_ns()

    def finished(self, budget: int) -> float:
        self._left -= budget
        self._spent += budget
        elapsed_s = (time.monotonic_ns() - self._started_ns) * 1e-9
        return elapsed_s * self._left / max(self._spent, 1)


def _set_bench(study: StudyFile, stop: Event) -> None:
    """In a worker: its recordings once, for all its searches, and the sign to abandon the one that runs."""
    global _bench, _stop
    _bench, _stop = Workbench(study), stop


def _run(cell: SearchCell) -> dict[str, Any]:
    if _bench is None:
        raise RuntimeError("this worker has no recordings: its initializer did not run")
    return _bench.run(cell, lambda progress: _stop is not None and _stop.is_set())

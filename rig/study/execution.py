"""Runs what is missing of a study, on processes here or a Dask scheduler's workers; each holds the recordings once."""

from __future__ import annotations

import os
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ProcessPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process
from multiprocessing.synchronize import Event
from typing import Any

from rig.errors import RigError
from rig.study.results import ResultsFile
from rig.study.search_cell import SearchCell, searches
from rig.study.study_file import StudyFile
from rig.study.workbench import Workbench


@dataclass(frozen=True)
class Workers:
    """Where searches run.

    Attributes:
        executor: Takes `run_search`.
        count: Searches that run at the same time.
    """

    executor: Executor
    count: int


@contextmanager
def local_workers(count: int) -> Iterator[Workers]:
    """Processes on this machine while the block runs; those still searching at its end give up.

    Args:
        count: How many.

    Yields:
        The workers.
    """
    context = get_context("spawn")
    stop = context.Event()
    pool = ProcessPoolExecutor(count, context, initializer=_follow, initargs=(stop,))
    try:
        yield Workers(pool, count)
    finally:
        stop.set()
        pool.shutdown(wait=True, cancel_futures=True)


_stop: Event | None = None
_benches: dict[str, Workbench] = {}


def run_search(study: StudyFile, fingerprint: str, cell: SearchCell) -> dict[str, Any]:
    """In a worker: run one search.

    Args:
        study: The study; its recordings are loaded once a worker.
        fingerprint: Of the study and its recordings where it was started.
        cell: The search.

    Returns:
        A line of the results file.

    Raises:
        RigError: This worker sees other recordings than those the study was started with.
    """
    if fingerprint not in _benches:
        bench = Workbench(study)
        if bench.fingerprint != fingerprint:
            raise RigError(
                f"recordings or software of this worker differ: got fingerprint {bench.fingerprint}, expected "
                f"{fingerprint}. Fix: install the same version on all workers, with the same files in the same folders"
            )
        _benches.clear()
        _benches[fingerprint] = bench
    return _benches[fingerprint].run(cell, lambda progress: _stop is not None and _stop.is_set())


def _follow(stop: Event) -> None:
    """In a process of this machine: give up when told so, leave Ctrl-C to the parent and do not outlive it."""
    global _stop
    _stop = stop
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


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
    report_progress = report or (lambda progress: None)
    report_progress(StudyProgress(total - len(todo), total, None, ""))
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
                report_progress(StudyProgress(total - len(waiting) - len(running), total, left_s, str(line["key"])))
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

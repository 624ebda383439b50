"""Who runs a study's searches: processes here, or the workers of a Dask scheduler; each holds the recordings once."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process
from multiprocessing.synchronize import Event
from typing import Any

from rig.errors import RigError
from rig.study.search_cell import SearchCell
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
                f"this worker's recordings or software differ (fingerprint {bench.fingerprint}, the study's is "
                f"{fingerprint}): workers need the same version and the same files at the same place"
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

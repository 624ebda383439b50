"""Local worker processes."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import connection
from pathlib import Path
from typing import TypeVar, cast

from rig.jobs.workers import ExecutorWorkers, Shared

T = TypeVar("T")
TERMINATION_S = 3.0
"""Maximum time that a process takes to terminate (s)."""


def follow_parent(leave: Callable[[], object] | None = None) -> None:
    """In a new worker process: leave Ctrl-C to the parent, and terminate with it.

    Args:
        leave: terminates the process when the parent has ended; None: immediate exit.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, args=(leave,), daemon=True).start()


def _end_with_parent(leave: Callable[[], object] | None) -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        if leave is not None:
            leave()
        os._exit(1)


class LocalWorkers(ExecutorWorkers):
    """Local processes, started and stopped by `local_workers`."""

    def __init__(self, count: int, begin: Callable[[], None], jobs_per_process: int | None, folder: Path) -> None:
        self._begin = begin
        self._jobs_per_process = jobs_per_process
        self._folder = folder
        super().__init__(self._started(count), count)

    def share(self, value: T) -> T:
        """See `Workers.share`."""
        descriptor, name = tempfile.mkstemp(dir=self._folder)
        with os.fdopen(descriptor, "wb") as file:
            pickle.dump(value, file, protocol=pickle.HIGHEST_PROTOCOL)
        return cast("T", Shared(name, Path(name)))  # placeholder in the arguments of jobs

    def end(self) -> None:
        """Terminate the processes immediately."""
        workers = list(multiprocessing.active_children())
        self.executor.shutdown(wait=False, cancel_futures=True)
        for worker in workers:
            worker.terminate()
        until_s = time.monotonic() + TERMINATION_S
        for worker in workers:
            worker.join(max(0.0, until_s - time.monotonic()))
            worker.kill()

    def finish(self) -> None:
        """Stop the processes once they are idle."""
        self.executor.shutdown()

    def _started(self, count: int) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(
            count, mp_context=multiprocessing.get_context("spawn"), initializer=self._begin,
            max_tasks_per_child=self._jobs_per_process,
        )  # fmt: skip

    def _restart(self) -> None:
        self.finish()
        self.executor = self._started(self.count)


@contextmanager
def local_workers(
    count: int, begin: Callable[[], None] = follow_parent, jobs_per_process: int | None = None
) -> Iterator[LocalWorkers]:
    """Provide local processes for the duration of the block; an exception terminates them.

    Args:
        count: number of processes.
        begin: called first in each new process; must end with `follow_parent`.
        jobs_per_process: number of jobs after which a process is replaced; None: never.

    Yields:
        The workers.
    """
    with tempfile.TemporaryDirectory(prefix="rig-jobs-") as folder:
        workers = LocalWorkers(count, begin, jobs_per_process, Path(folder))
        try:
            yield workers
        except BaseException:
            workers.end()
            raise
        workers.finish()

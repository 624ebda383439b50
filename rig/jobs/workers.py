"""Jobs as values, and the interface of workers, implemented here for this process and for executors.

If a worker process fails, only its jobs are lost and run again. A job during which `MOST_FAILURES` worker processes
failed is reported.
"""

from __future__ import annotations

import pickle
import warnings
from abc import abstractmethod
from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, Executor, Future
from dataclasses import dataclass, field
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeVar

from rig.errors import DataWarning, RigError

T = TypeVar("T")
AHEAD = 2
"""Jobs submitted per worker: one runs, one is queued."""
MOST_FAILURES = 3
"""Number of worker processes that may fail during one job before the job is abandoned."""
LOOK_S = 1.0
"""Interval between checks of the workers while no result arrives (s)."""


class WorkersFailed(RigError):
    """The workers can no longer be reached, or fail repeatedly during one job; earlier results are not lost."""

    slug = "workers-failed"


@dataclass(frozen=True, eq=False)
class Job(Generic[T]):
    """One independent computation, compared by identity.

    Attributes:
        name: name of the job in messages.
        function: module-level function, which a worker process can import.
        arguments: small values, and values of `Workers.share`.
    """

    name: str
    function: Callable[..., T]
    arguments: tuple[Any, ...] = field(default=())


class Workers:
    """Runs jobs one after another in this process.

    Attributes:
        count: number of jobs that run at the same time.
        executor: for functions that need a `concurrent.futures.Executor`, such as the evaluation of a population; None
            here.
    """

    executor: Executor | None = None

    @property
    def count(self) -> int:
        """Number of jobs that run at the same time."""
        return 1

    def share(self, value: T) -> T:
        """Return a placeholder for the arguments of many jobs; the value is sent to each worker process once."""
        return value

    def check_files(self, files: Sequence[Path]) -> None:
        """Check that these files have the same content on every worker.

        Raises:
            RigError: a file differs on a worker; the message names both.
        """

    def results(self, jobs: Iterable[Job[T]]) -> Iterator[tuple[Job[T], T]]:
        """Run the jobs; an exception in a job is raised here and cancels the others.

        Args:
            jobs: taken as workers become free.

        Yields:
            A job and its result, in order of completion.

        Raises:
            WorkersFailed: see there; the message names the job.
        """
        for job in jobs:
            yield job, job.function(*job.arguments)

    def in_order(self, jobs: Iterable[Job[T]], finished: Callable[[Job[T], int], None] | None = None) -> list[T]:
        """All results, in the order of the jobs.

        Args:
            jobs: as for `results`, each with its own name.
            finished: called with each finished job and the number of finished jobs.

        Raises:
            WorkersFailed: as `results`.
        """
        listed = list(jobs)
        values: dict[Job[T], T] = {}
        for job, value in self.results(listed):
            values[job] = value
            if finished is not None:
                finished(job, len(values))
        return [values[job] for job in listed]


HERE = Workers()


@dataclass(frozen=True)
class Shared:
    """Placeholder for a shared value in the arguments of a job: its token and, if there is one, its file."""

    token: str
    path: Path | None = None


@dataclass(frozen=True)
class Answer(Generic[T]):
    """Result of a job in a worker, with the data warnings raised there."""

    value: T
    remarks: tuple[str, ...]


@dataclass(frozen=True)
class Missing:
    """Answer of a worker process without a shared value: the token and the worker's address."""

    token: str
    worker: str = ""


KEPT_VALUES = 4
"""Maximum number of shared values that a worker process stores; the oldest is deleted first."""
_known: OrderedDict[str, Any] = OrderedDict()


def keep(token: str, payload: bytes) -> None:
    """In a worker: store a shared value."""
    _known[token] = pickle.loads(payload)
    while len(_known) > KEPT_VALUES:
        _known.popitem(last=False)


def forget(tokens: Sequence[str]) -> None:
    """In a worker: delete shared values."""
    for token in tokens:
        _known.pop(token, None)


def answered(function: Callable[..., T], arguments: Sequence[Any]) -> Answer[T] | Missing:
    """In a worker: run a job if all its shared values are stored here."""
    values = []
    for argument in arguments:
        if isinstance(argument, Shared):
            if argument.token not in _known and argument.path is not None:
                keep(argument.token, argument.path.read_bytes())
            if argument.token not in _known:
                return Missing(argument.token)
            argument = _known[argument.token]
        values.append(argument)
    with warnings.catch_warnings(record=True) as raised:
        warnings.simplefilter("always", DataWarning)
        value = function(*values)
    remarks = [str(one.message) for one in raised if issubclass(one.category, DataWarning)]
    return Answer(value, tuple(dict.fromkeys(remarks)))


class RemoteWorkers(Workers):
    """Runs jobs in other processes; `AHEAD` jobs are submitted per worker."""

    @abstractmethod
    def _submit(self, job: Job[T]) -> Any:  # noqa: ANN401 - a future of `concurrent.futures` or of Dask
        """A future with `add_done_callback`, and a `result` that is an `Answer`."""

    @abstractmethod
    def _restart(self) -> None:
        """Replace worker processes that have ended.

        Raises:
            WorkersFailed: that is not possible.
        """

    def _supply(self, missing: Missing) -> None:
        """Send a shared value to a worker process that does not have it.

        Raises:
            WorkersFailed: that is not possible.
        """
        raise WorkersFailed(f"a worker process lost the shared value {missing.token}. Fix: run the command again")

    def _look(self) -> None:
        """Check the workers while no result arrives.

        Raises:
            WorkersFailed: they can no longer be reached.
        """

    def _cancel(self, futures: Sequence[Any]) -> None:
        """Cancel jobs that are no longer needed."""
        for future in futures:
            future.cancel()

    def results(self, jobs: Iterable[Job[T]]) -> Iterator[tuple[Job[T], T]]:
        """See `Workers.results`. After a worker process fails, each job that it may have run is run alone."""
        waiting, done = iter(jobs), SimpleQueue[Any]()
        running: dict[Any, Job[T]] = {}
        failures: Counter[Job[T]] = Counter()
        suspects: deque[Job[T]] = deque()
        retried: list[Job[T]] = []
        try:
            while True:
                room = 1 if suspects else AHEAD * self.count
                try:
                    while len(running) < room and (job := _next_of(suspects, retried, waiting)) is not None:
                        future = self._submit(job)
                        running[future] = job
                        future.add_done_callback(done.put)
                    if not running:
                        return
                    future = self._next(done)
                    if future not in running:
                        continue  # it was lost with worker processes that have been replaced
                    job = running.pop(future)
                    answer: Answer[T] | Missing = future.result()
                except BrokenExecutor as error:
                    ended = [] if job is None else [job]
                    ended += [one for one in running.values() if one is not job]
                    running.clear()
                    suspects.extend(one for one in ended if one not in suspects)
                    _count_failures(ended, failures, error)
                    self._restart()
                    continue
                if isinstance(answer, Missing):
                    self._supply(answer)
                    retried.append(job)
                    continue
                if suspects and suspects[0] is job:
                    suspects.popleft()
                for remark in answer.remarks:
                    warnings.warn(remark, DataWarning, stacklevel=2)
                yield job, answer.value
        finally:
            self._cancel(list(running))

    def _next(self, done: SimpleQueue[Any]) -> Any:  # noqa: ANN401 - as `_submit`
        while True:
            try:
                return done.get(timeout=LOOK_S)
            except Empty:
                self._look()


def _next_of(suspects: Sequence[Job[T]], retried: list[Job[T]], waiting: Iterator[Job[T]]) -> Job[T] | None:
    """The next job to submit; None if there is none."""
    if suspects:
        return suspects[0]
    return retried.pop() if retried else next(waiting, None)


def _count_failures(jobs: Sequence[Job[T]], failures: Counter[Job[T]], error: BaseException) -> None:
    """Count the failure of a worker process for the jobs that it may have run.

    Raises:
        WorkersFailed: too many for one of them.
    """
    for job in jobs:
        failures[job] += 1
        if failures[job] >= MOST_FAILURES:
            raise WorkersFailed(given_up(job.name, MOST_FAILURES)) from error


def given_up(name: str, failures: int) -> str:
    """Message about a job during which several worker processes failed."""
    return (
        f"{name}: {failures} worker processes ended while running this job (out of memory?). "
        "Fix: check the memory of the worker, or use fewer worker processes"
    )


class ExecutorWorkers(RemoteWorkers):
    """Any `concurrent.futures.Executor` as workers.

    Args:
        executor: runs the jobs.
        count: number of jobs that it runs at the same time.
    """

    def __init__(self, executor: Executor, count: int) -> None:
        self.executor: Executor = executor
        self._count = count

    @property
    def count(self) -> int:
        """See `Workers.count`."""
        return self._count

    def _submit(self, job: Job[T]) -> Future[Answer[T] | Missing]:
        return self.executor.submit(answered, job.function, job.arguments)

    def _restart(self) -> None:
        raise WorkersFailed("a worker process was killed (out of memory?). Fix: use fewer worker processes")

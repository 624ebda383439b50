"""Jobs and workers: results as they come, a death that costs its job only, shared values, errors on their way."""

from __future__ import annotations

import os
import pickle
import threading
import warnings
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Future, ThreadPoolExecutor
from operator import mul, neg
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import pytest

from rig.errors import DataWarning, FileProblem, Refused, RigError
from rig.jobs.local import local_workers
from rig.jobs.time_left import TimeLeft
from rig.jobs.workers import (
    AHEAD,
    HERE,
    MOST_FAILURES,
    ExecutorWorkers,
    Job,
    Missing,
    RemoteWorkers,
    Shared,
    WorkersFailed,
    answered,
    keep,
)


class Dying(RemoteWorkers):
    """Two workers, of which one dies with every job that `deadly` counts."""

    count = 2

    def __init__(self, deadly: dict[str, int]) -> None:
        self.deadly = Counter(deadly)
        self.restarts = 0
        self.together: list[frozenset[str]] = []
        self._open: dict[Future[Any], Job[Any]] = {}

    def _submit(self, job: Job[Any]) -> Future[Any]:
        future: Future[Any] = Future()
        self._open[future] = job
        return future

    def _restart(self) -> None:
        self.restarts += 1

    def _next(self, done: SimpleQueue[Any]) -> Future[Any]:
        assert done.empty() or done.get().done()
        names = frozenset(job.name for job in self._open.values())
        self.together.append(names)
        struck = next((job.name for job in self._open.values() if self.deadly[job.name] > 0), None)
        future, job = next(iter(self._open.items()))
        if struck is None:
            del self._open[future]
            future.set_result(answered(job.function, job.arguments))
            return future
        self.deadly[struck] -= 1
        for one in self._open:
            one.set_exception(BrokenExecutor())
        self._open.clear()
        return future


def squares(count: int) -> Iterator[Job[int]]:
    return (Job(f"job {number}", mul, (number, number)) for number in range(count))


def test_in_this_process_a_job_is_taken_when_the_one_before_has_ended() -> None:
    seen: list[int] = []

    def jobs() -> Iterator[Job[int]]:
        for number in range(3):
            yield Job("one", neg, (len(seen) + number,))

    for _, value in HERE.results(jobs()):
        seen.append(value)
    assert seen == [0, -2, -4]


def test_results_come_in_the_order_of_the_jobs_whoever_ends_first() -> None:
    gate, done = threading.Event(), []

    def first() -> int:
        gate.wait(10.0)
        return 1

    def second() -> int:
        gate.set()
        return 2

    with ThreadPoolExecutor(2) as threads:
        workers = ExecutorWorkers(threads, 2)
        values = workers.in_order([Job("a", first), Job("b", second)], lambda job, count: done.append(count))
    assert values == [1, 2]
    assert done == [1, 2]


def test_no_more_jobs_are_taken_than_workers_need() -> None:
    taken = []

    def jobs() -> Iterator[Job[int]]:
        for job in squares(100):
            taken.append(job.name)
            yield job

    results = Dying({}).results(jobs())
    next(results)
    assert len(taken) == 2 * AHEAD
    results.close()


def test_a_death_costs_its_jobs_only_and_each_suspect_runs_alone() -> None:
    workers = Dying({"job 2": 1})
    found = {job.name: value for job, value in workers.results(squares(7))}
    assert found == {f"job {number}": number * number for number in range(7)}
    assert workers.restarts == 1
    died = next(place for place, names in enumerate(workers.together) if "job 2" in names)
    suspects = workers.together[died]
    assert workers.together[died + 1 : died + 1 + len(suspects)] == [frozenset({name}) for name in sorted(suspects)]


def test_a_job_that_kills_its_workers_is_named_and_others_are_not_blamed() -> None:
    workers = Dying({"job 3": MOST_FAILURES})
    found: list[str] = []
    with pytest.raises(WorkersFailed, match=r"job 3: 3 worker processes ended"):
        found.extend(job.name for job, _ in workers.results(squares(7)))
    assert {"job 0", "job 1", "job 2"} <= set(found)


def test_a_shared_value_is_read_once_by_a_worker_and_asked_for_where_it_is_missing(tmp_path: Path) -> None:
    file = tmp_path / "value"
    file.write_bytes(pickle.dumps(20))
    stored = Shared("in a file", file)
    assert answered(mul, (stored, 2)).value == 40
    file.unlink()
    assert answered(mul, (stored, 3)).value == 60
    assert answered(mul, (Shared("elsewhere"), 2)) == Missing("elsewhere")
    keep("elsewhere", pickle.dumps(5))
    assert answered(mul, (Shared("elsewhere"), 2)).value == 10


def doubtful() -> int:
    warnings.warn("point p003 is left out", DataWarning, stacklevel=2)
    return 1


def test_a_warning_about_data_reaches_the_user_from_a_worker() -> None:
    with ThreadPoolExecutor(1) as threads, pytest.warns(DataWarning, match="point p003 is left out"):
        assert ExecutorWorkers(threads, 1).in_order([Job("a", doubtful)]) == [1]


@pytest.mark.parametrize(
    "error", [RigError("text"), FileProblem("run.h5", ["damaged", "late"], "slug"), Refused("limits", "text")], ids=repr
)
def test_errors_survive_the_way_from_a_worker(error: RigError) -> None:
    received = pickle.loads(pickle.dumps(error))
    assert (type(received), str(received), vars(received)) == (type(error), str(error), vars(error))


def test_time_left_follows_from_what_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    times_s = iter([0.0, 60.0, 90.0])
    monkeypatch.setattr("time.monotonic", lambda: next(times_s))
    clock = TimeLeft(3)
    assert clock.text(1) == "1 of 3, 2 min 0 s left"
    assert clock.text(3) == "3 of 3"


@pytest.mark.wire
@pytest.mark.nightly
def test_a_worker_process_that_is_killed_costs_its_jobs_only(tmp_path: Path) -> None:
    killed = tmp_path / "killed"
    with local_workers(2) as workers:
        jobs = [Job(str(number), die_once, (number, killed)) for number in range(6)]
        found = {job.name: value for job, value in workers.results(jobs)}
    assert found == {str(number): number for number in range(6)}
    assert killed.exists()


def die_once(number: int, mark: Path) -> int:
    if number == 2 and not mark.exists():
        mark.touch()
        os._exit(9)
    return number

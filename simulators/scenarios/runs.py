"""Worlds run and judged, one by one or in the processes of a pool."""

from __future__ import annotations

import contextlib
import functools
import gc
import os
import shutil
import signal
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from rig.jobs.cluster import cluster
from rig.jobs.local import LocalWorkers, follow_parent, local_workers
from rig.jobs.workers import Job
from simulators.scenarios.invariants import violations
from simulators.scenarios.plan import ScenarioPlan
from simulators.scenarios.request import ScenarioRequest
from simulators.scenarios.scenario import MOST_SESSIONS, Scenario
from simulators.scenarios.stage import load_everything

SCENARIOS_PER_WORKER = 100
"""A worker begins anew after so many: what killed processes held is given back with it."""
ROOM = 256 << 20
"""A worker's worlds take no more than that (bytes)."""
SELDOM = 50_000
"""A world makes much and keeps it: the garbage collector looks after so many objects."""

T = TypeVar("T")
_under_way: list[str] = []
"""Folders of the worlds that this process runs."""


@dataclass(frozen=True)
class Ended:
    """A world that has ended.

    Attributes:
        failed: invariant and words of everything that did not hold, with the virtual time (s).
        digest: of everything it made; `events` of what happened in it, by name.
        rig_s: virtual seconds; `wall_s` the real ones it took, `cpu_s` those of the processor.
        scheduled: what was to happen in it; `not_happened`: of these what was to come later than its campaign's end.
        moved_s: for how long the rod moved (s).
    """

    seed: int
    failed: tuple[tuple[str, str, float], ...]
    digest: str
    rig_s: float
    wall_s: float
    sessions: tuple[int | None, ...]
    cpu_s: float = 0.0
    scheduled: tuple[str, ...] = ()
    moved_s: float = 0.0
    events: str = ""
    not_happened: tuple[str, ...] = ()


def live(
    plan: ScenarioPlan, root: Path, until_s: float | None = None, begin: Callable[[Scenario], None] | None = None,
    most_sessions: int = MOST_SESSIONS,
) -> tuple[Scenario, Ended]:
    """Run a world and judge it; `begin` is called with it first."""
    began_s, cpu_s = time.perf_counter(), time.process_time()
    scenario = Scenario(plan, root, most_sessions=most_sessions)
    if begin is not None:
        begin(scenario)
    scenario.run(until_s)
    broken = () if until_s is not None else violations(scenario)
    # Paths as they are in every run of this world, not in this one's folder, which is gone soon.
    failed = tuple((invariant, words.replace(f"{root}/", ""), at_s) for invariant, words, at_s in broken)
    wall_s, cpu_s = time.perf_counter() - began_s, time.process_time() - cpu_s
    codes = tuple(session.exit_code for session in scenario.sessions)
    scheduled = tuple(map(str, plan.events))
    moved_s = sum(session.truth.moved_s for session in scenario.sessions)
    return scenario, Ended(
        plan.seed, failed, scenario.digest(), scenario.kernel.time_s, wall_s, codes, cpu_s, scheduled, moved_s,
        scenario.events(), () if until_s is not None else tuple(map(str, scenario.not_happened)),
    )  # fmt: skip


def one(seed: int, request: ScenarioRequest) -> Ended:
    """Run the world of a seed."""
    return alone(request.plan(seed), request.until_s)


def one_in_worker(seed: int, request: ScenarioRequest) -> Ended:
    """Run the scenario of a seed, possibly in a worker process of another scheduler."""
    load_worker()
    return one(seed, request)


def alone(
    plan: ScenarioPlan, until_s: float | None = None, begin: Callable[[Scenario], None] | None = None,
    most_sessions: int = MOST_SESSIONS,
) -> Ended:
    """Run a world in a folder that is gone with it; one that breaks the simulation itself has failed."""
    with tempfile.TemporaryDirectory(prefix="world-", dir=memory()) as name:
        _under_way.append(name)
        try:
            _, ended = live(plan, Path(name), until_s, begin, most_sessions)
        except Exception:  # noqa: BLE001 - told as this world's failure, the others go on
            words = traceback.format_exc(limit=-6)
            scheduled = tuple(map(str, plan.events))
            return Ended(plan.seed, (("world", words, 0.0),), "", 0.0, 0.0, (), scheduled=scheduled)
        finally:
            _under_way.remove(name)
    return ended


def memory() -> str | None:
    """A folder in memory, where there is one with room: worlds write much and keep nothing."""
    shared = Path("/dev/shm")
    roomy = shared.is_dir() and shutil.disk_usage(shared).free > ROOM * (os.cpu_count() or 1)
    return str(shared) if roomy else None


def begin_worker() -> None:
    """What a process does before its first world; an interrupt is its parent's business, whom it does not outlive."""
    signal.signal(signal.SIGTERM, _leave)
    follow_parent(_leave)
    load_worker()


@functools.cache
def load_worker() -> None:
    """Load the modules that every scenario needs, and exclude them from garbage collection."""
    load_everything()
    gc.collect()
    gc.freeze()
    gc.set_threshold(SELDOM, 20, 100)


def _leave(*_: object) -> None:
    """End this process now, and its world with all files: what takes its place removes them, undisturbed."""
    with contextlib.suppress(OSError, ValueError):
        if _under_way:
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM})
            os.execvp("rm", ["rm", "-rf", "--", *_under_way])
    os._exit(1)


def every(seeds: range, request: ScenarioRequest, jobs: int, scheduler: str | None = None) -> Iterator[Ended]:
    """Results of the scenarios of these seeds in order of completion, from local processes or a Dask scheduler.

    Raises:
        WorkersFailed: processes or workers failed repeatedly, or the scheduler was lost.
        RigError: the scheduler or its workers cannot be used.
    """
    with cluster(scheduler) if scheduler is not None else _processes(min(jobs, len(seeds))) as workers:
        workers.check_files(request.named_files)
        shared = workers.share(request)
        for _, ended in workers.results(Job(f"scenario {seed}", one_in_worker, (seed, shared)) for seed in seeds):
            yield ended


def in_a_worker(do: Callable[..., T], *arguments: object) -> T:
    """Run a function on scenarios in a separate process, so an interrupt stops the process and not part of a scenario.

    Raises:
        WorkersFailed: the process was killed repeatedly.
    """
    with _processes(1) as workers:
        return workers.in_order([Job("scenario", do, arguments)])[0]


def _processes(count: int) -> contextlib.AbstractContextManager[LocalWorkers]:
    """Processes that run scenarios."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # for the workers: one world is one thread
    return local_workers(count, begin_worker, SCENARIOS_PER_WORKER)

"""What holds for every test; how `dev.py test` divides tests among processes."""

from __future__ import annotations

import fcntl
import gc
import os
import signal
import time
from collections.abc import Iterator
from contextlib import suppress
from hashlib import sha256
from itertools import chain, groupby
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# A shell that starts a program in the background has it ignore Ctrl-C, and so would every process these tests start.
signal.signal(signal.SIGINT, signal.default_int_handler)

# One thread for linear algebra, here and in every process the tests start: a second one mostly waits, and keeps a core
# busy with it. Read once, when numpy is loaded.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# How long an example takes says how busy the machine is, and nothing of what is tested.
settings.register_profile("any-machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any-machine")

SELDOM = 50_000
"""The garbage collector looks after so many objects; what was collected of the tests it does not look at any more."""
COMPILING = Path(__file__).parent / "rig" / "dampers"
"""Tests that one process runs first: they compile nearly every model, which the others then find compiled."""
COMPUTING = (
    *(Path(__file__).parent / "rig" / name for name in (
        "characteristics", "comparison", "document", "export", "hybrid", "identification", "matrix", "optimisers",
        "process_quality", "reanalysis", "report", "signals", "study", "units", "vehicle",
    )),
    Path(__file__).parent / "docs", Path(__file__).parent / "fuzz",
)  # fmt: skip
"""Tests that look at no clock: what is left of them goes on, giving way, beside those on real processes and wires."""
CROWDED = 0.6
"""Who had less of a core so far is on a busy machine, and would starve if it gave way."""
BEGAN_S = time.monotonic()
STARTS_PROCESSES = frozenset({"start", "run_wired", "in_motion", "start_brisk", "start_campaign", "wired_station_rig",
                              "simulated_rig"})
"""Fixtures that start real processes on real transports: tests that use them are marked `wire`."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--shared", type=Path, help="Folder in which processes say which tests each one takes.")
    parser.addoption("--then-wires", action="store_true", help="With --shared: then also those on real processes and "
                     "wires, when no other process runs any that looks at a clock.")
    parser.addoption("--lock", type=int, help="With --shared: locked file, let go when this process runs none of these "
                     "any more.")
    parser.addoption("--failures", type=Path, help="File at whose end the names of the tests that failed are written.")
    parser.addoption("--short", action="store_true", help="Leave to the night what is marked `nightly` or `few`.")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if STARTS_PROCESSES.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("wire")
    if config.getoption("--short"):
        short = set(by_day(items))
        config.hook.pytest_deselected(items=[item for item in items if item not in short])
        items[:] = [item for item in items if item in short]


def by_day(items: list[pytest.Item]) -> Iterator[pytest.Item]:
    """All tests but the nightly ones; of those marked `few` so many cases, the first and the last with them."""
    for _, group in groupby(items, lambda item: item.nodeid.partition("[")[0]):
        cases = [item for item in group if item.get_closest_marker("nightly") is None]
        few = cases[0].get_closest_marker("few") if cases else None
        kept = min(few.args[0], len(cases)) if few else len(cases)
        yield from (cases[round(number * (len(cases) - 1) / max(1, kept - 1))] for number in range(kept))


def pytest_collection_finish(session: pytest.Session) -> None:
    gc.collect()
    gc.freeze()
    gc.set_threshold(SELDOM, 20, 100)
    folder = session.config.getoption("--shared")
    if folder is not None:
        (folder / "collected").touch()


def pytest_runtestloop(session: pytest.Session) -> bool | None:
    """With --shared this process runs the tests that no other one has taken yet; pytest's own loop else."""
    folder = session.config.getoption("--shared")
    if folder is None or session.testsfailed or session.config.option.collectonly:
        return None
    ours = ours_of(session, folder)
    item = next(ours, None)
    while item is not None:
        following = next(ours, None)
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if session.shouldfail:
            raise session.Failed(session.shouldfail)
        if session.shouldstop:
            raise session.Interrupted(session.shouldstop)
        item = following
    return True


def ours_of(session: pytest.Session, folder: Path) -> Iterator[pytest.Item]:
    """What this process takes of the tests without wires; with --then-wires, the others done, then those on wires."""
    wired = [item for item in session.items if item.get_closest_marker("wire")]
    free = [item for item in session.items if item not in set(wired)]
    computing = [item for item in free if any(map(item.path.is_relative_to, COMPUTING))]
    timed = [item for item in free if item not in set(computing)]
    timed.sort(key=lambda item: not item.path.is_relative_to(COMPILING))
    first, lock = session.config.getoption("--then-wires"), session.config.getoption("--lock")
    yield from chain.from_iterable(taken(timed, folder, backwards=not first))
    units = taken(computing, folder, backwards=not first)
    if first:
        yield from chain.from_iterable(until_alone(units, folder))
        session.config.get_terminal_writer().line("\non real processes and wires:")
        yield from wired
        session.config.get_terminal_writer().line("\nno more processes and wires:")
    for item in chain.from_iterable(units):
        yield item
        if lock is not None and had() > CROWDED:  # asked for one more: the last that looks at a clock has run
            give_way(lock)


def until_alone(units: Iterator[list[pytest.Item]], folder: Path) -> Iterator[list[pytest.Item]]:
    """Units to run while another process still runs tests that look at a clock; returns when none does."""
    with (folder / "others").open("w") as others:
        for unit in units:
            yield unit
            with suppress(BlockingIOError):
                fcntl.flock(others, fcntl.LOCK_EX | fcntl.LOCK_NB)
                return
        fcntl.flock(others, fcntl.LOCK_EX)


def had() -> float:
    """Cores that this process and those it waited for had since it began: 1 on a machine with nothing else to do."""
    spent = os.times()
    return sum(spent[:4]) / (time.monotonic() - BEGAN_S)


def give_way(lock: int) -> None:
    """Let the tests on wires begin, and have from now on only the time that nobody else wants."""
    fcntl.flock(lock, fcntl.LOCK_UN)
    if hasattr(os, "SCHED_IDLE"):
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def taken(items: list[pytest.Item], folder: Path, *, backwards: bool) -> Iterator[list[pytest.Item]]:
    """The tests of each file that is free when its turn comes, and those marked `apart` each by itself.

    Who begins at the other end neither compiles nor waits for what the first one is compiling.
    """
    units = [(name, list(tests)) for name, tests in groupby(items, unit)]
    for name, tests in reversed(units) if backwards else units:
        try:
            (folder / sha256(name.encode()).hexdigest()).touch(exist_ok=False)
        except FileExistsError:
            continue
        yield tests


def unit(item: pytest.Item) -> str:
    """What one process takes at once."""
    return item.nodeid if item.get_closest_marker("apart") else str(item.path)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Name the tests that failed where --failures asks for it."""
    path, reporter = session.config.getoption("--failures"), session.config.pluginmanager.get_plugin("terminalreporter")
    if path is None or reporter is None:
        return
    names = [report.nodeid for kind in ("failed", "error") for report in reporter.stats.get(kind, [])]
    with path.open("a", encoding="utf-8") as file:
        file.writelines(f"{name}\n" for name in names)

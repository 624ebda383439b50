"""Processes of a world: deaths, signals, exit codes, locks, pipes to programs; and the real modules afterwards."""

from __future__ import annotations

import contextlib
import datetime
import errno
import fcntl
import os
import pathlib
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

import drivers.ring
import rig.recording.atomic_write
import rig.station.process
from simulators.scenarios.machine import Machine, Process
from simulators.scenarios.os_stubs import REAL, Installed, NoCounterpart, stubs

Make = Callable[[int], tuple[Machine, Path]]
SEEDS = range(10)


@pytest.fixture
def machine(make: Make) -> Machine:
    """One machine."""
    return make(1)[0]


def tools(machine: Machine) -> SimpleNamespace:
    """What stands for the modules."""
    found = stubs(machine)
    real = {"os": os, "signal": signal, "subprocess": subprocess, "threading": threading, "time": time, "fcntl": fcntl}
    return SimpleNamespace(**{name: found[id(module)] for name, module in real.items()}, sys=found[id(sys)])


def run(machine: Machine, program: Callable[[], object]) -> Process:
    """Run a program to its end."""
    process = machine.start("program", program)
    machine.kernel.run(lambda: not process.alive)
    return process


def leave(code: object) -> Callable[[], object]:
    """A program that ends so."""

    def program() -> object:
        if isinstance(code, BaseException):
            raise code
        return code

    return program


CODES = {
    "pass": (leave(None), 0), "sys.exit(5)": (leave(5), 5), "import sys; sys.exit(3)": (leave(SystemExit(3)), 3),
    "import sys; sys.exit('words')": (leave(SystemExit("words")), 1), "raise ValueError": (leave(ValueError()), 1),
    "raise KeyboardInterrupt": (leave(KeyboardInterrupt()), -2),
}  # fmt: skip


@pytest.mark.parametrize("real", CODES)
def test_exit_codes_are_those_of_an_interpreter(machine: Machine, real: str) -> None:
    program, code = CODES[real]
    assert run(machine, program).exit_code == code
    if real != "sys.exit(5)":
        assert subprocess.run([sys.executable, "-c", real], check=False, capture_output=True).returncode == code


def test_a_process_waits_for_its_threads_and_pools_unless_they_are_daemons(machine: Machine) -> None:
    from simulators.scenarios.futures import ThreadPoolExecutor

    scenario, log = tools(machine), []

    def work(name: str, length_s: float) -> None:
        scenario.time.sleep(length_s)
        log.append(name)

    def program() -> None:
        scenario.threading.Thread(target=work, args=("thread", 1.0)).start()
        scenario.threading.Thread(target=work, args=("daemon", 2.0), daemon=True).start()
        pool = ThreadPoolExecutor(machine.kernel, 1)
        pool.submit(work, "pool", 0.5)
        pool.submit(work, "pool", 0.2)
        pool.shutdown(wait=False)

    assert run(machine, program).exit_code == 0
    assert log == ["pool", "pool", "thread"]


@pytest.mark.parametrize(
    ("number", "code"),
    [(signal.SIGTERM, -15), (signal.SIGHUP, -1), (signal.SIGUSR1, -10), (signal.SIGKILL, -9), (signal.SIGINT, -2)],
)
def test_a_signal_without_a_handler_ends_a_process(machine: Machine, number: int, code: int) -> None:
    log: list[str] = []

    def program() -> None:
        try:
            machine.kernel.block()
        finally:
            log.append("finally")

    process = machine.start("program", program)
    machine.kernel.spawn("sender", process, lambda: machine.signal(process, number), 10**9)
    machine.kernel.run(lambda: not process.alive)
    assert process.exit_code == code
    assert log == (["finally"] if number == signal.SIGINT else [])


def test_a_handler_runs_in_the_main_thread_and_what_waits_goes_on(machine: Machine) -> None:
    scenario, log = tools(machine), []

    def handle(number: int, _: object) -> None:
        log.append((number, scenario.threading.current_thread() is scenario.threading.main_thread()))

    def program() -> None:
        scenario.signal.signal(signal.SIGTERM, handle)
        scenario.signal.signal(signal.SIGINT, signal.SIG_IGN)
        began_s = scenario.time.monotonic()
        scenario.time.sleep(2.0)
        log.append(scenario.time.monotonic() - began_s >= 2.0)

    process = machine.start("program", program)
    for number, after_ns in ((signal.SIGTERM, 10**9), (signal.SIGINT, 1_500_000_000)):
        machine.kernel.spawn("sender", process, lambda number=number: machine.signal(process, number), after_ns)
    machine.kernel.run(lambda: not process.alive)
    assert log == [(signal.SIGTERM, True), True]


def test_a_process_killed_by_itself_does_nothing_more(machine: Machine) -> None:
    scenario, log = tools(machine), []

    def program() -> None:
        try:
            scenario.os.kill(scenario.os.getpid(), signal.SIGKILL)
        finally:
            log.append("went on")

    assert run(machine, program).exit_code == -9
    machine.start("other", lambda: machine.kernel.sleep_ns(10**9))
    machine.kernel.run(lambda: machine.kernel.time_s > 0.9)
    assert log == []
    with pytest.raises(ProcessLookupError):
        scenario.os.kill(1001, 0)


def test_a_lock_of_a_killed_process_is_free_unless_a_child_holds_it(make: Make) -> None:
    for seed in SEEDS:
        machine, folder = make(seed)
        scenario, path = tools(machine), folder / "lock"
        machine.programs["child"] = lambda _, machine=machine: machine.kernel.sleep_ns(3 * 10**9)

        def owner() -> None:
            handle = scenario.os.open(path, os.O_RDWR | os.O_CREAT)  # noqa: B023 - runs within this turn
            scenario.fcntl.flock(handle, fcntl.LOCK_EX)  # noqa: B023
            scenario.subprocess.Popen(["python", "-m", "child"], start_new_session=True, pass_fds=(handle,))  # noqa: B023
            machine.kernel.block()  # noqa: B023

        def other() -> int:
            machine.kernel.sleep_ns(2 * 10**9)  # noqa: B023
            handle = scenario.os.open(path, os.O_RDWR)  # noqa: B023
            with pytest.raises(BlockingIOError):
                scenario.fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)  # noqa: B023
            scenario.fcntl.flock(handle, fcntl.LOCK_EX)  # noqa: B023
            return int(machine.kernel.time_s)  # noqa: B023

        first = machine.start("owner", owner)
        machine.kernel.spawn("killer", first, lambda: machine.signal(first, 9), 10**9)  # noqa: B023
        process = machine.start("late", other)
        machine.kernel.run(lambda: not process.alive)  # noqa: B023
        assert process.errors == []
        assert process.exit_code == 3


def child(machine: Machine) -> Callable[[list[str]], int]:
    """A program that answers in capitals until its input ends."""

    def program(arguments: list[str]) -> int:
        system = tools(machine).sys
        for line in system.stdin:
            system.stdout.write(line.upper())
            system.stdout.flush()
        system.stderr.write("the end\n")
        return int(arguments[0])

    return program


def test_a_program_answers_through_its_pipes_and_its_code_is_waited_for(make: Make) -> None:
    for seed in SEEDS:
        machine, folder = make(seed)
        scenario, got = tools(machine), []
        machine.programs["child"] = child(machine)

        def program() -> None:
            started = scenario.subprocess.Popen(  # noqa: B023 - runs within this turn
                ["python", "-m", "child", "7"], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
            )
            with pytest.raises(subprocess.TimeoutExpired):
                started.wait(0.1)
            started.stdin.write("one\ntwo\n")
            started.stdin.close()
            got.append((list(started.stdout), started.wait(1.0), started.poll()))  # noqa: B023

        process = machine.start("program", program, stderr=folder / "log")
        machine.kernel.run(lambda: not process.alive)  # noqa: B023
        assert process.errors == []
        assert got == [(["ONE\n", "TWO\n"], 7, 7)]
        assert (folder / "log").read_text() == "the end\n"


def test_a_child_sees_the_end_of_its_input_when_its_parent_is_killed(machine: Machine) -> None:
    scenario, started = tools(machine), []
    machine.programs["child"] = child(machine)

    def program() -> None:
        started.append(scenario.subprocess.Popen(["python", "-m", "child", "4"], stdin=subprocess.PIPE))
        machine.kernel.block()

    process = machine.start("program", program)
    machine.kernel.run(lambda: bool(started))
    machine.end(process, -9)
    machine.kernel.run(lambda: started[0].poll() is not None)
    assert started[0].poll() == 4


def test_clocks_begin_with_the_scenario(machine: Machine) -> None:
    scenario = tools(machine)
    assert scenario.time.time() == pytest.approx(datetime.datetime(2026, 1, 1, 8, tzinfo=datetime.UTC).timestamp())
    assert scenario.time.gmtime().tm_year == 2026
    assert scenario.time.strftime("%Y") == "2026"
    machine.wall_step_s = 3600.0
    assert scenario.time.gmtime().tm_hour == 9


def test_what_has_no_counterpart_says_so(machine: Machine) -> None:
    with pytest.raises(NoCounterpart, match=r"os\.fork"):
        _ = tools(machine).os.fork
    with pytest.raises(NoCounterpart, match=r"time\.localtime"):
        _ = tools(machine).time.localtime


def test_chance_comes_from_the_seed(make: Make) -> None:
    import secrets

    drawn = [[stubs(make(seed)[0])[id(secrets)].token_hex(3) for _ in range(2)] for seed in (1, 1, 2)]  # type: ignore[attr-defined]
    assert drawn[0] == drawn[1] != drawn[2]


def places() -> Iterator[tuple[Any, str]]:
    """Names under which modules of the project hold what a world replaces; those in `REAL` keep the computer's."""
    real = {id(module) for module in (os, time, threading, subprocess, signal, fcntl)}
    for name, module in list(sys.modules.items()):
        if name.split(".")[0] in {"rig", "drivers", "protocols"} and not name.startswith(REAL):
            yield from ((module, key) for key, value in vars(module).items() if id(value) in real)


def test_the_project_has_its_real_modules_again(machine: Machine) -> None:
    before = [(module, key, getattr(module, key)) for module, key in places()]
    assert len(before) > 10
    with contextlib.suppress(ZeroDivisionError), Installed(machine):
        assert rig.recording.atomic_write.os is not os
        assert rig.station.process.threading is not threading
        assert list(places()) == []
        raise ZeroDivisionError
    paths: Any = sys.modules.get("pathlib._local", pathlib)  # Python 3.13 has them there
    assert rig.recording.atomic_write.os is drivers.ring.os is paths.os is os
    assert rig.station.process.threading is threading
    assert all(getattr(module, key) is value for module, key, value in before)


def test_outside_of_its_processes_an_installed_scenario_leaves_files_alone(machine: Machine, tmp_path: Path) -> None:
    machine.disk.refuses = errno.ENOSPC
    with Installed(machine):
        (tmp_path / "file").write_text("words")
        (tmp_path / "file").rename(tmp_path / "other")
    assert (tmp_path / "other").read_text() == "words"

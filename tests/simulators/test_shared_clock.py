"""The simulated rig's clock waits for processes that watch it and have not had their turn, and for no others."""

from __future__ import annotations

import asyncio
import os
import signal
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import simulators.rig
from drivers import clock
from drivers.clock import AHEAD, CLOCK, MACHINE, OFFSET_PID, ROLES, SEQUENCE, ClockRefused, Role, running
from drivers.clock import LOOK_NS as READER_LOOKS_NS
from drivers.roles import FaultBit, WatchdogAction
from simulators.bench import Addresses
from simulators.options import RigOptions
from simulators.pace import LONGEST_WAIT_S
from simulators.rig import RunOptions, SimulatedRig
from simulators.shared_clock import (
    AHEAD_NS,
    HANGS_S,
    LATE_NS,
    LONGEST_WAIT_NS,
    LOOK_NS,
    SETPOINT_LATE_NS,
    STOPPED_S,
    Follower,
    SharedClock,
)

MS, SECOND = 1_000_000, 1_000_000_000
MINE = ("modbus-tcp://127.0.0.1:1", "/dev/pts/1")


@pytest.fixture(autouse=True)
def own_time() -> Iterator[None]:
    yield
    clock.follow("", None)


@pytest.fixture
def written(tmp_path: Path) -> Iterator[SharedClock]:
    """The clock of a rig, which this process keeps."""
    kept = SharedClock(tmp_path / "clock", MINE, time.monotonic_ns(), fast=False)
    yield kept
    kept.close()


class Stores:
    """The words of a clock's file, and each that was written: what another process can read at any moment."""

    def __init__(self, words: memoryview) -> None:
        self.words = words
        self.made: list[tuple[int, int]] = []

    def __getitem__(self, place: int) -> int:
        return int(self.words[place])

    def __setitem__(self, place: int, value: int) -> None:
        self.words[place] = value
        self.made.append((place, value))


def test_no_reader_sees_a_part_of_a_number(written: SharedClock, tmp_path: Path) -> None:
    reader = clock.SharedClock(tmp_path / "clock", Role.STATION)
    words = written._words
    stores = Stores(words)
    written._words = reader._words = stores  # type: ignore[assignment]  # as far as they use it
    reader.due(1, 5 * MS)
    reader.due(1, 7 * MS)
    place = ROLES + 2 * Role.STATION
    assert stores.made == [(place + 1, 5 * MS), (place, os.getpid()), (place + 1, 7 * MS), (place, os.getpid())]
    stores.made.clear()
    written.go_on(waiting=False)
    assert [place for place, _ in stores.made] == [SEQUENCE, CLOCK, MACHINE, AHEAD, SEQUENCE]
    assert [value % 2 for place, value in stores.made if place == SEQUENCE] == [1, 0]
    written._words = words
    assert struct.unpack_from("=3q", written._map, 24) == tuple(value for _, value in stores.made[1:4])


def state(process: subprocess.Popen[bytes], expected: str) -> None:
    """Wait until a process is in a state."""
    while Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()[0] != expected:
        time.sleep(0.001)


@pytest.fixture(params=["busy", "idle", "stopped", "dead"])
def watching(request: pytest.FixtureRequest) -> Iterator[tuple[str, int]]:
    """A process that watches a rig: what it does, and its id."""
    program = "while True: pass" if request.param == "busy" else "import time; time.sleep(60)"
    process = subprocess.Popen([sys.executable, "-S", "-E", "-c", program])
    if request.param == "idle":
        state(process, "S")
    if request.param == "stopped":
        process.send_signal(signal.SIGSTOP)
        state(process, "T")
    if request.param == "dead":
        process.kill()
        process.wait()
    yield request.param, process.pid
    process.kill()
    process.wait()


def test_a_busy_process_is_waited_for_a_stopped_one_for_seconds_and_one_that_hangs_or_is_dead_is_not(
    watching: tuple[str, int],
) -> None:
    does, process = watching
    follower, due_ns = Follower(process, LATE_NS), SECOND
    assert not follower.waits(due_ns, due_ns + LATE_NS, 0), "in time"
    late_ns, machine_ns = due_ns + LATE_NS + 1, MS
    assert follower.waits(due_ns, late_ns, machine_ns)
    longest_ns = {
        "busy": LONGEST_WAIT_NS, "idle": int(1.5 * HANGS_S * SECOND), "stopped": int(STOPPED_S * SECOND)
    }.get(does, LOOK_NS)
    while follower.waits(due_ns, late_ns, machine_ns) and machine_ns < 2 * LONGEST_WAIT_NS:
        machine_ns += LOOK_NS if does != "busy" or machine_ns < SECOND else SECOND
    assert machine_ns >= longest_ns * (does in {"busy", "stopped"})
    assert machine_ns <= longest_ns + 2 * SECOND * (does == "busy") + 4 * LOOK_NS
    assert machine_ns > LONGEST_WAIT_NS or does != "busy"
    assert not follower.waits(due_ns + SECOND, late_ns, machine_ns), "it has had its turn again"
    assert running(process) == (does in {"busy", "idle"})


@pytest.mark.parametrize("watching", ["stopped"], indirect=True)
def test_a_stopped_process_is_given_up_after_seconds_of_the_computers_time_however_seldom_it_is_looked_at(
    watching: tuple[str, int],
) -> None:
    follower, looks_ns = Follower(watching[1], LATE_NS), SECOND // 2
    waited = [follower.waits(0, LATE_NS + 1, (look + 1) * looks_ns) for look in range(20)]
    assert 0.9 * STOPPED_S <= 1e-9 * looks_ns * sum(waited) <= 1.3 * STOPPED_S


def test_time_pauses_with_the_rigs_clock_and_never_goes_back(written: SharedClock, tmp_path: Path) -> None:
    clock.follow(str(tmp_path / "clock"), Role.STATION, MINE)
    begin_ns = written.now_ns
    assert clock.monotonic_ns() == begin_ns, "it has not begun to run"
    written.look(time.monotonic_ns())
    written.go_on(waiting=False)
    time.sleep(3e-9 * AHEAD_NS)
    ahead_ns = clock.monotonic_ns()
    assert ahead_ns == begin_ns + AHEAD_NS, "it runs on without its rig for so long"
    written.look(time.monotonic_ns())
    assert written.now_ns == ahead_ns
    written.go_on(waiting=True)
    time.sleep(0.002)
    assert clock.monotonic_ns() == ahead_ns
    clock.leave()
    before_ns, machine_ns = clock.monotonic_ns(), time.monotonic_ns()
    time.sleep(0.002)
    assert clock.monotonic_ns() - before_ns == pytest.approx(time.monotonic_ns() - machine_ns, abs=MS)
    assert before_ns < begin_ns + SECOND, "time goes on from where it was"


@pytest.mark.parametrize("gone", ["dead", "closed"])
def test_time_goes_on_when_the_rig_has_ended(tmp_path: Path, gone: str) -> None:
    path = tmp_path / "clock"
    kept = SharedClock(path, MINE, time.monotonic_ns(), fast=False)
    if gone == "dead":
        ended = subprocess.Popen(["true"])
        ended.wait()
        with path.open("r+b") as file:
            file.seek(OFFSET_PID)
            file.write(struct.pack("<I", ended.pid))
    clock.follow(str(path), Role.STATION, MINE)
    if gone == "closed":
        kept.close()
    time.sleep(2e-9 * READER_LOOKS_NS)
    clock.monotonic_ns()
    before_ns = clock.monotonic_ns()
    time.sleep(0.01)
    assert clock.monotonic_ns() - before_ns >= 9 * MS
    if gone == "dead":
        kept.close()


def test_a_threads_due_time_is_the_earliest_of_its_process(written: SharedClock, tmp_path: Path) -> None:
    clock.follow(str(tmp_path / "clock"), Role.STATION, MINE)
    begin_ns = written.now_ns
    other = threading.Thread(target=lambda: clock.back_within(0.010))
    other.start()
    other.join()
    clock.back_within(60.0)
    assert not written.look(time.monotonic_ns())
    written.now_ns = begin_ns + 10 * MS + LATE_NS + MS
    assert written.look(time.monotonic_ns())
    clock.leave()
    assert not written.look(time.monotonic_ns()), "a process that watches the rig no longer is not waited for"


def test_the_clock_does_not_pass_a_set_point_that_is_due_and_goes_on_at_once_when_it_comes(
    written: SharedClock, tmp_path: Path
) -> None:
    """Also while its answer is awaited, and while this rig itself has no turn; not for a link that a fault slows."""
    clock.follow(str(tmp_path / "clock"), Role.STATION, MINE)
    written.look(machine_ns := time.monotonic_ns())
    begin_ns = written.now_ns
    clock.setpoint_due(begin_ns + 2 * MS)
    clock.back_within(60.0)
    assert not written.look(machine_ns)
    written.go_on(waiting=False)
    last_ns = begin_ns + 2 * MS + SETPOINT_LATE_NS + 1
    assert written.at(machine_ns + SECOND) == last_ns
    assert written.look(machine_ns + 2 * MS + SETPOINT_LATE_NS + 10)
    written.go_on(waiting=True)
    clock.setpoint_due(begin_ns + 6 * MS)
    assert not written.look(machine_ns + SECOND), "it has come"
    written.go_on(waiting=False)
    assert written.at(machine_ns + 2 * SECOND) == min(last_ns + AHEAD_NS, begin_ns + 6 * MS + SETPOINT_LATE_NS + 1)
    written.look(machine_ns + 2 * SECOND)
    assert not written.look(machine_ns + 2 * SECOND, setpoints=False)
    written.go_on(waiting=False)
    assert written.at(machine_ns + 3 * SECOND) == written.now_ns + AHEAD_NS
    clock.setpoint_due(None)
    assert not written.look(machine_ns + 3 * SECOND), "no motion is streamed"
    clock.step_due(begin_ns := written.now_ns)
    written.go_on(waiting=False)
    assert not written.look(machine_ns + 3 * SECOND, setpoints=False)
    written.go_on(waiting=False)
    assert written.at(machine_ns + 4 * SECOND) == begin_ns + SETPOINT_LATE_NS + 1, "no link's fault delays a step"
    clock.leave()
    assert not written.look(machine_ns + 4 * SECOND)


def test_after_a_campaign_the_process_has_the_time_that_it_had_before(written: SharedClock, tmp_path: Path) -> None:
    @clock.restored()
    def campaign() -> None:
        clock.follow(str(tmp_path / "clock"), Role.APPLICATION, MINE)
        clock.leave()
        assert clock.monotonic_ns() < time.monotonic_ns() - SECOND
        raise InterruptedError

    written.now_ns -= 2 * SECOND
    written.go_on(waiting=True)
    for _ in range(2):
        with pytest.raises(InterruptedError):
            campaign()
        assert abs(clock.monotonic_ns() - time.monotonic_ns()) < SECOND


def test_no_other_device_is_evaluated_by_a_clock_that_waits(written: SharedClock, tmp_path: Path) -> None:
    path = tmp_path / "clock"
    with pytest.raises(ClockRefused, match="/dev/ttyUSB0"):
        clock.follow(str(path), Role.STATION, [*MINE, "/dev/ttyUSB0"])
    (tmp_path / "copy").write_bytes(path.read_bytes())
    (tmp_path / "text").write_text("format = 1", encoding="utf-8")
    (tmp_path / "link").symlink_to(path)
    for refused in ("copy", "text", "link", "missing"):
        with pytest.raises(ClockRefused):
            clock.follow(str(tmp_path / refused), Role.STATION, MINE)
    assert abs(clock.monotonic_ns() - time.monotonic_ns()) < SECOND, "the machine's own clock as before"


def test_the_rig_and_its_watchdog_pause_while_a_busy_host_is_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """This process is the busy one: it has its turn, and none of its threads looks at the rig."""
    now = {"ns": time.monotonic_ns()}
    monkeypatch.setattr(simulators.rig, "monotonic_ns", lambda: now["ns"])

    def run(rig: SimulatedRig, seconds: float) -> float:
        began_s = rig.plant.time_s
        for _ in range(round(seconds / 0.002)):
            now["ns"] += 2 * MS
            rig.tick()
        return rig.plant.time_s - began_s

    async def campaign() -> None:
        rig = SimulatedRig(RigOptions(), RunOptions(ports="socket"))
        addresses = await rig.open()
        rig.share_clock(tmp_path / "clock", addresses)
        watched = rig.actuator
        limits = replace(watched.limits, watchdog_ms=500, watchdog_action=WatchdogAction.FADE_AND_HOLD)
        assert watched.configure(limits)
        watched.owner = 1
        watched.feed(1)
        clock.follow(str(tmp_path / "clock"), Role.STATION, addresses.listed)
        clock.back_within(0.010)
        assert run(rig, 2.0) < 0.05
        assert not watched.watchdog_starved
        clock.back_within(60.0)
        rig.bank.polled_s = watched.served_s + 60.0
        assert run(rig, 1.0) == pytest.approx(1.0, abs=0.1)
        assert watched.fault_bits & FaultBit.WATCHDOG
        await rig.close()

    asyncio.run(campaign())


def test_a_rig_that_nobody_watches_does_not_wait(tmp_path: Path) -> None:
    addresses = Addresses(MINE[0], 2, MINE[1], "/dev/pts/2", ())
    rig = SimulatedRig(RigOptions(), RunOptions())
    rig.share_clock(tmp_path / "clock", addresses)
    assert f'shared = "{tmp_path}/clock"' in rig.bench(addresses, real_time=False)
    began_s, until_ns = rig.plant.time_s, time.monotonic_ns() + 200 * MS
    while time.monotonic_ns() < until_ns:
        rig.tick()
        time.sleep(0.001)
    assert rig.plant.time_s > began_s
    assert os.path.exists(tmp_path / "clock")
    assert LONGEST_WAIT_S >= HANGS_S
    asyncio.run(rig.close())

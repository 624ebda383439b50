"""Current steps during a motion: what is refused before it starts, what is commanded, and what ends the commands."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from station_bench import Journal, config_for

from drivers import clock
from drivers.clock import Role
from drivers.current_source import SourceCounters, SourceTiming, SourceTraits
from drivers.errors import LinkLost
from drivers.roles import State
from rig.clock import monotonic_ns
from rig.station.current_program import CurrentProgram, CurrentSteps, current_program
from rig.station.errors import StationRefused
from rig.station.interlocks.current_interlock import EcuInterlock
from rig.station.supervisor import Supervisor
from rig.station.threads.current_source_thread import CurrentSourceThread
from simulators.shared_clock import SETPOINT_LATE_NS, SharedClock

MS = 1_000_000
STEPS = {"time_s": [0.0, 0.02, 0.05], "current_A": [0.0, 1.5, 0.5]}


class Source:
    """A current source that keeps what it is asked for."""

    timing, counters, status, send_error = SourceTiming(), SourceCounters(), None, None

    def __init__(self, *, by_hand: bool = False, lowest_A: float | None = None) -> None:
        self.traits = SourceTraits(by_hand=by_hand, lowest_A=lowest_A)
        self.sent: list[tuple[int, float]] = []
        self.breaks = False
        self.commanded_A = 0.0

    def command(self, current_A: float, *, enable: bool = True, clear_faults: bool = False) -> None:
        del clear_faults
        self.commanded_A = current_A if enable else 0.0

    def send_now(self) -> None:
        if self.breaks and self.commanded_A:
            raise LinkLost("ecu", "can0", "the bus is gone")
        self.sent.append((monotonic_ns(), self.commanded_A))

    def start(self, period_s: float) -> None:
        """Commands are sent at the start, and then when they change."""
        del period_s
        self.send_now()


class Rig:
    """A station whose motion runs until `state` is changed; `rate` device seconds pass in a second."""

    def __init__(self, rate: float = 1.0, **source: Any) -> None:  # noqa: ANN401 - the source's own arguments
        self.journal, config = Journal(), config_for()
        self.supervisor = Supervisor(config, self.journal.append, lambda _: None, lambda _: None, lambda: 0.0)
        self.source = Source(**source)
        interlock = EcuInterlock(3.3, 120.0, lambda: 0)
        self.coil = CurrentSourceThread(config.ecu, self.source, interlock, self.supervisor, lambda _: None)
        self.coil.begin()
        self.state = State.RUNNING
        actuator = SimpleNamespace(
            interlock=self, controller_s=lambda host_ns: 7.0 + 1e-9 * rate * host_ns
        )
        station = SimpleNamespace(limits=config.limits, device_rate=rate)
        self.devices: Any = SimpleNamespace(coil=self.coil, actuator=actuator, config=station)

    @property
    def status(self) -> SimpleNamespace:
        """Of the controller."""
        return SimpleNamespace(state=self.state)

    def run(self, given: dict[str, list[float]]) -> int:
        """Start the steps; when their motion began (ns)."""
        begun_ns = monotonic_ns()
        CurrentSteps(current_program(given, self.devices), begun_ns, self.devices, self.supervisor).start()
        return begun_ns

    def commanded(self) -> list[float]:
        """Every current commanded since the coil was prepared."""
        return [current_A for _, current_A in self.source.sent[1:]]


@pytest.fixture(autouse=True)
def ended() -> Iterator[None]:
    """No program goes on after its test: a shared clock of a later test would wait for it."""
    yield
    for thread in threading.enumerate():
        if isinstance(steps := getattr(getattr(thread, "_target", None), "__self__", None), CurrentSteps):
            steps._coil.follow_law(law=False)
            thread.join(2.0)


def until(true: Callable[[], bool]) -> None:
    """Wait for something another thread does."""
    for _ in range(400):
        if true():
            return
        time.sleep(0.005)
    raise AssertionError("not reached within 2 s")


@pytest.mark.parametrize("rate", [1.0, 0.5])
def test_each_step_is_commanded_at_its_time_of_the_controllers_clock(rate: float) -> None:
    rig = Rig(rate)
    begun_ns = rig.run(STEPS)
    until(lambda: len(rig.commanded()) == 2)
    assert rig.commanded() == [1.5, 0.5]
    late_ms = [(at_ns - begun_ns) / MS - 1e3 * at_s / rate for (at_ns, _), at_s in
               zip(rig.source.sent[1:], STEPS["time_s"][1:], strict=True)]
    assert min(late_ms) >= 0.0, "never before its time"
    rig.state = State.HOLD
    until(lambda: rig.coil._program is None)


def test_a_simulated_rigs_clock_waits_for_each_step_of_a_station_that_has_its_turn_late(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = {"time_s": [0.0, 0.2, 0.4, 0.6], "current_A": [0.0, 1.5, 0.5, 1.0]}
    written = SharedClock(tmp_path / "clock", ("a",), time.monotonic_ns(), fast=True)
    clock.follow(str(tmp_path / "clock"), Role.STATION, ("a",))
    try:
        rig = Rig(rate=10.0)
        steps = CurrentSteps(current_program(given, rig.devices), begun_ns := monotonic_ns(), rig.devices,
            rig.supervisor)
        wait = steps._next_look.wait
        monkeypatch.setattr(steps._next_look, "wait", lambda wait_s: wait(wait_s + 0.025))
        steps.start()

        def commanded() -> bool:
            late = written.look(time.monotonic_ns())
            written.go_on(waiting=late)
            return len(rig.commanded()) == 3

        until(commanded)
        late_ns = [at_ns - begun_ns - 1e8 * at_s for (at_ns, _), at_s in
                   zip(rig.source.sent[1:], given["time_s"][1:], strict=True)]
        assert min(late_ns) >= 0.0, "never before its time"
        assert max(late_ns) <= SETPOINT_LATE_NS + 2
        rig.state = State.HOLD
        until(lambda: rig.coil._program is None)
    finally:
        clock.follow("", None)
        written.close()


def _trip(rig: Rig) -> None:
    rig.coil.zero_now()


def _other_command(rig: Rig) -> None:
    rig.coil.set_current(0.25)


def _end(rig: Rig) -> None:
    time.sleep(0.03)  # the motion must have been seen to run
    rig.state = State.HOLD


@pytest.mark.parametrize(("change", "last_A"), [(_trip, [0.0]), (_other_command, [0.25]), (_end, [])])
def test_nothing_is_commanded_after_a_trip_another_command_or_the_end_of_the_motion(
    change: Callable[[Rig], None], last_A: list[float]
) -> None:
    rig = Rig()
    rig.run({"time_s": [0.0, 0.15, 0.2], "current_A": [0.0, 1.5, 2.5]})
    change(rig)
    time.sleep(0.25)
    assert rig.commanded() == last_A


def test_a_trip_and_its_reset_between_two_steps_end_the_program() -> None:
    """The coil is prepared anew after a trip; a step that was due later must not be commanded."""
    rig = Rig()
    rig.run({"time_s": [0.0, 0.1], "current_A": [0.0, 1.5]})
    rig.coil.zero_now()
    rig.coil.begin()
    time.sleep(0.15)
    assert rig.commanded() == [0.0, 0.0]


def test_the_end_of_a_program_does_not_end_the_check_of_the_next_one() -> None:
    """The thread of a program notices its end some milliseconds later, when the next one may have started."""
    rig = Rig()
    interlock, first, second = rig.coil._law_interlock, object(), object()
    rig.coil.follow_program(first, steps=True)
    assert interlock._commanded
    rig.coil.set_current(0.5)
    assert not interlock._commanded, "the current is constant from this command on"
    rig.coil.follow_program(second, steps=True)
    rig.coil.leave_program(first)
    assert interlock._commanded
    assert rig.coil.follows_program(second)
    rig.coil.leave_program(second)
    assert not interlock._commanded
    rig.coil.follow_program(first, steps=True)
    rig.coil.follow_law(law=True)
    rig.coil.set_current(1.0)
    assert interlock._commanded, "a control law commands each current anew"


def test_a_step_that_is_overtaken_by_the_next_one_is_not_commanded() -> None:
    rig = Rig(rate=1000.0)  # both are due before the thread runs
    rig.run(STEPS)
    until(lambda: bool(rig.commanded()))
    assert rig.commanded()[-1] == 0.5


def test_a_bus_that_breaks_during_a_program_is_reported() -> None:
    rig = Rig()
    rig.source.breaks = True
    rig.run(STEPS)
    until(lambda: "can-lost" in rig.journal.slugs("warning"))


@pytest.mark.parametrize(
    ("given", "source", "message"),
    [
        ({"time_s": [0.0, 1.0], "current_A": [0.0, 3.1]}, {}, "contains 3.1 A, allowed: -3 A to 3 A"),
        ({"time_s": [0.0, 1.0], "current_A": [0.0, -0.1]}, {"lowest_A": 0.0}, "contains -0.1 A, allowed: 0 A to 3 A"),
        ({"time_s": [0.0, 1.0], "current_A": [0.5, 1.0]}, {}, "starts at 0.5 A, but 0 A is commanded now"),
        (STEPS, {"by_hand": True}, "set manually"),
        ({"time_s": [0.1, 1.0], "current_A": [0.0, 1.0]}, {}, "must start at 0 s"),
        ({"time_s": [0.0, 0.001], "current_A": [0.0, 1.0]}, {}, "increase by at least 0.002 s"),
        ({"time_s": [0.0], "current_A": [0.0, 1.0]}, {}, "1 times and 2 currents"),
        ({"time_s": [0.0, float("nan")], "current_A": [0.0, 1.0]}, {}, "not finite"),
        ({"time_s": [0.01 * k for k in range(2001)], "current_A": [0.0] * 2001}, {}, "allowed: 1 to 2000"),
        ({"time_s": 0.0, "current_A": 0.0}, {}, "expected a current program"),
        ([0.0, 1.0], {}, "not a table"),
    ],
)  # fmt: skip
def test_a_program_beyond_the_limits_of_a_constant_current_does_not_start(
    given: object, source: dict[str, Any], message: str
) -> None:
    with pytest.raises(StationRefused, match=message):
        current_program(given, Rig(**source).devices)


def test_a_program_of_one_current_is_a_constant_current() -> None:
    assert CurrentProgram.from_json({"time_s": [0.0], "current_A": [1.0]}).current_A == (1.0,)

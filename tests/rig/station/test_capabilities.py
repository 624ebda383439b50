"""What an actuator cannot do is neither asked of it nor taken for a fault; one that nothing stops is refused."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import pytest
from station_bench import Journal, config_for

from drivers.capabilities import Capabilities, WatchdogKind
from drivers.connection import LinkKind
from drivers.errors import DriverError
from drivers.roles import ActuatorIdentity, ActuatorLimits, ActuatorStatus, Command, Input, Move, Program, State
from rig.clock import monotonic_ns
from rig.station import requests
from rig.station.command_channel import CommandChannel
from rig.station.errors import StationRefused
from rig.station.interlocks.actuator_interlock import ActuatorInterlock
from rig.station.preparation import Preparation
from rig.station.requests import OFF_REPEATS, PRESSURE_STAYS, Requests
from rig.station.safe_stop import StopAction
from rig.station.supervisor import Supervisor
from rig.station.threads.actuator_thread import ActuatorThread

PATIENCE_S = 5.0


class Lvdt:
    """An LVDT that sees the rod stand."""

    speed_m_s = 0.0
    changed = True

    def still_s(self, now_ns: int) -> float:
        del now_ns
        return 1.0

    def restart_still(self) -> None:
        """It stands."""

    def hold_place(self) -> None:
        """It stays."""

    def left_place(self, now_ns: int) -> bool:
        del now_ns
        return False

    def position_m(self, now_ns: int) -> float:
        del now_ns
        return 0.01


class LittleActuator:
    """An actuator that holds, and can do as little as it says."""

    link_kind = LinkKind.TCP
    is_open = True
    stale = busy = 0

    def __init__(self, capabilities: Capabilities) -> None:
        self.capabilities = capabilities
        self.pressure = Input.HYDRAULICS_ON
        self.loses = 0
        self.position_m = 0.01
        self.sent: list[tuple[int, int]] = []
        self.fed = 0

    def open(self) -> None:
        """It is there."""

    def close(self) -> None:
        """It stays there."""

    def read_identity(self) -> ActuatorIdentity:
        return ActuatorIdentity()

    def read_status(self) -> ActuatorStatus:
        now_ns = monotonic_ns()
        values: dict[str, float] = dict.fromkeys(ActuatorStatus._fields, 0)
        values |= {
            "received_ns": now_ns, "heartbeat": now_ns // 10_000_000 % 65536, "state": State.HOLD,
            "clock_us": now_ns // 1000 % (1 << 32), "position_m": self.position_m,
            "inputs": Input.E_STOP_CLOSED | self.pressure,
        }
        return ActuatorStatus(**values)  # type: ignore[arg-type]  # numbers by name

    def exchange(self, watchdog_counter: int) -> ActuatorStatus:
        del watchdog_counter
        self.fed += 1
        return self.read_status()

    def send(self, command: Command, order: Move | Program | None = None) -> int:
        del order
        self.sent.append((len(self.sent) + 1, int(command)))
        self.loses -= 1
        if command == Command.HYDRAULICS_OFF and self.loses < 0:
            self.pressure = Input(0)
        return len(self.sent)


class Rig:
    """The station's thread at such an actuator, armed."""

    def __init__(self, capabilities: Capabilities) -> None:
        config = config_for()
        self.journal = Journal()
        self.driver = LittleActuator(capabilities)
        self.supervisor = Supervisor(config, self.journal.append, lambda _: None, lambda _: None, lambda: 0.0)
        interlock = ActuatorInterlock(7, capabilities, frozen_after_ns=10**9, disagreement_m=1.0, lag_s=0.0)
        self.thread = ActuatorThread(
            config.actuator, self.driver, interlock, Lvdt(), self.supervisor, lambda _: None  # type: ignore[arg-type]  # does what is asked of it
        )
        devices = SimpleNamespace(actuator=self.thread, owner_id=7)
        self.commands = CommandChannel(self.thread, self.supervisor)
        self.preparation = Preparation(config, self.supervisor, devices, self.commands)  # type: ignore[arg-type]  # only its actuator is asked for
        self.requests = Requests(config, self.supervisor, devices)  # type: ignore[arg-type]  # likewise
        self.supervisor.arm()
        self.supervisor.beat(healthy=True)
        self.thread.start()


@pytest.fixture
def rig() -> Iterator[Callable[..., Rig]]:
    made: list[Rig] = []

    def make(*, watchdog: WatchdogKind = WatchdogKind.NONE, hydraulics: bool = True, **able: bool) -> Rig:
        made.append(Rig(Capabilities(watchdog=watchdog, hydraulics=hydraulics, **able)))
        return made[-1]

    yield make
    for one in made:
        one.thread.end()


def wait_for(true: Callable[[], bool]) -> bool:
    deadline = time.monotonic() + PATIENCE_S
    while not true() and time.monotonic() < deadline:
        time.sleep(0.002)
    return true()


def test_an_actuator_that_nothing_would_stop_is_refused(rig: Callable[..., Rig]) -> None:
    with pytest.raises(StationRefused, match="nothing would stop the actuator") as refused:
        rig(hydraulics=False).requests.handle("connect", {})
    assert refused.value.slug == "watchdog-absent"


def test_a_watchdog_that_is_not_there_is_neither_fed_nor_proved(rig: Callable[..., Rig]) -> None:
    without = rig()
    assert wait_for(lambda: without.thread.polls > 20)
    assert without.driver.fed == 0
    assert without.preparation.starve_watchdog() is None
    timed = rig(watchdog=WatchdogKind.TIMEOUT)
    assert wait_for(lambda: timed.driver.fed > 20)
    assert not timed.journal, "no echo is expected of it, no lease, no acknowledgement"


@pytest.mark.parametrize("able", ["limits_read_back", "settings_written"])
def test_what_it_holds_of_the_limits_is_written_and_compared(able: str, rig: Callable[..., Rig]) -> None:
    here = rig(**{able: True})
    held: list[ActuatorLimits] = []
    here.driver.write_limits = held.append  # type: ignore[attr-defined]  # it holds what is written
    here.driver.read_limits = lambda: held[-1]  # type: ignore[attr-defined]
    assert here.preparation.prepare_controller() == held[0]
    assert held[0].watchdog_ms == round(1e3 * config_for().actuator.watchdog_s)


def test_a_status_that_has_become_stale_does_not_say_that_the_rod_stands(rig: Callable[..., Rig]) -> None:
    held = rig()
    assert wait_for(lambda: held.thread.rests(monotonic_ns()))
    assert not held.thread.interlock.moving(0.0)
    assert not held.thread.rests(monotonic_ns() + 10**12)


def test_without_acknowledgement_a_command_is_taken_when_it_is_written(rig: Callable[..., Rig]) -> None:
    little = rig()
    before_ns = monotonic_ns()
    assert little.commands.command(Command.HALT).received_ns > before_ns
    little.thread.act(StopAction.FADE)
    assert wait_for(lambda: (2, Command.FADE_STOP) in little.driver.sent)
    assert wait_for(lambda: little.thread.stop_taken)


def test_without_lease_and_limits_nothing_of_it_is_prepared_but_the_thread_commands(rig: Callable[..., Rig]) -> None:
    little = rig()
    assert wait_for(lambda: little.thread.polls > 0)
    limits = little.preparation.prepare_controller()
    assert limits.force_max_N == 5000.0
    assert little.thread.interlock.leased
    assert little.driver.sent == []
    assert wait_for(lambda: little.thread.polls > 20)
    assert not little.journal


def test_where_no_pressure_can_be_taken_away_a_stop_ends_with_the_rod_standing(rig: Callable[..., Rig]) -> None:
    held = rig(watchdog=WatchdogKind.TIMEOUT, hydraulics=False)
    assert wait_for(lambda: held.thread.stop_inputs(monotonic_ns())[0] is False)
    moving, _, low, off = held.thread.stop_inputs(monotonic_ns())
    assert (moving, low, off) == (False, True, True)
    held.thread.act(StopAction.HYDRAULICS_OFF)
    assert wait_for(lambda: held.thread.stop_taken)
    assert held.driver.sent == []
    assert held.requests._hydraulics({"level": "off"})["state"] == "HOLD"


def test_a_pressure_that_stays_is_ordered_off_again(
    rig: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A write that is acknowledged and lost shows by nothing else where commands are not acknowledged."""
    monkeypatch.setattr(requests, "OFF_AGAIN_S", 0.05)
    little = rig()
    little.driver.loses = 2
    little.requests._hydraulics({"level": "off"})
    assert [command for _, command in little.driver.sent] == [Command.HYDRAULICS_OFF] * 3


@pytest.mark.parametrize("takes", [0, 1, 2, 99])
def test_a_pressure_that_stays_after_off_was_taken_is_no_link_fault_though_the_link_then_fails(
    takes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Found by seed 1090062: it ended with 4, as if the controller had taken no command."""
    monkeypatch.setattr(Requests, "_await_rest", lambda *_: None)
    sent: list[Command] = []

    class Commands:
        def command(self, command: Command) -> None:
            sent.append(command)
            if len(sent) > takes:
                raise DriverError("actuator", "modbus-tcp://1.2.3.4:502", "exception 4 (device failure)")

        def await_status(self, reached: object, slug: str, message: str, *_: float, until_trip: bool) -> None:
            del reached, until_trip
            raise StationRefused(slug, message)

    able = SimpleNamespace(hydraulics=True)
    actuator = SimpleNamespace(capabilities=able, wait_status=lambda *_: None)
    station = Requests(config_for(), None, SimpleNamespace(actuator=actuator))  # type: ignore[arg-type]  # only its actuator is asked
    station._commands = Commands()  # type: ignore[assignment]
    with pytest.raises(StationRefused if takes else DriverError) as refused:
        station._hydraulics({"level": "off"})
    assert sent == [Command.HYDRAULICS_OFF] * (1 + OFF_REPEATS if takes else 1)
    assert not takes or refused.value.slug == PRESSURE_STAYS


def test_a_rod_that_leaves_its_place_is_not_safe_where_no_pressure_can_be_taken_away(rig: Callable[..., Rig]) -> None:
    held = rig(watchdog=WatchdogKind.TIMEOUT, hydraulics=False)
    assert wait_for(lambda: held.thread.stop_inputs(monotonic_ns())[2] is True)
    held.thread.hold_place()
    held.driver.position_m += 0.0025
    assert wait_for(lambda: held.thread.left_place(monotonic_ns()))
    assert wait_for(lambda: held.thread.stop_inputs(monotonic_ns())[0] is False)
    assert held.thread.stop_inputs(monotonic_ns())[2:] == (False, False)


@pytest.mark.parametrize(("coil_degC", "refused"), [(120.0, False), (120.1, True), (math.nan, False)])
def test_a_coil_that_is_too_hot_before_anything_moves_is_a_refusal(coil_degC: float, refused: bool) -> None:
    """A limit below the room's temperature was a stop (exit code 4) as soon as the station was armed."""
    coil = SimpleNamespace(
        begin=lambda: None, wait_clear=lambda _: True, wait_taken=lambda _: True, fresh_current_A=0.0,
        coil_degC=coil_degC,
    )
    preparation = Preparation(config_for(), None, SimpleNamespace(coil=coil), None)  # type: ignore[arg-type]  # its coil alone is asked
    if not refused:
        assert preparation.prepare_coil() == 0.0
        return
    with pytest.raises(StationRefused) as refusal:
        preparation.prepare_coil()
    assert refusal.value.slug == "coil-temperature"

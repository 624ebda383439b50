"""Requirements for an actuator's driver (`drivers.roles.Actuator`).

The peer moves by 5 mm and runs two cycles of 2 mm: never use a machine with a specimen, keep its guard area clear.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest

from drivers.capabilities import WatchdogKind
from drivers.catalogue import make_actuator
from drivers.connection import ActuatorConnection, LinkKind
from drivers.errors import DriverError
from drivers.plugins import members_of
from drivers.roles import (
    Actuator,
    ActuatorLimits,
    ActuatorStatus,
    Command,
    Move,
    Program,
    Result,
    State,
    Waveform,
)
from rig.conformance.peer import Peer

OWNER = 4711
POLL_S = 0.01
TIMEOUT_S = 0.2
PROMPT_S = 2.0
LIMITS = ActuatorLimits(-0.05, 0.06, 0.5, 30.0, 4000.0, 1.0, 10.0, 500)
STEP_M = 0.005
PROGRAM = Program(Waveform.SINE, 0.002, 2.0, cycles=20.0, ramp_in_cycles=1.0, ramp_out_cycles=1.0)


class Driven:
    """A driver, polled as the station polls it."""

    def __init__(self, driver: Actuator) -> None:
        self.driver = driver
        self.fed = True
        self._counter = 0

    def poll(self) -> ActuatorStatus:
        """The next status, the watchdog being fed where there is one."""
        time.sleep(POLL_S)
        if self.fed and self.driver.capabilities.watchdog is not WatchdogKind.NONE:
            self._counter = (self._counter + 1) % 65_536
            return self.driver.exchange(self._counter)
        return self.driver.read_status()

    def until(self, true: Callable[[ActuatorStatus], bool], what: str, seconds: float = 5.0) -> ActuatorStatus:
        """Poll until a status is so; fails when none is."""
        until_s = time.monotonic() + seconds
        status = self.poll()
        while not true(status):
            if time.monotonic() > until_s:
                pytest.fail(f"{what} did not occur within {seconds:g} s; the last status is {status}")
            status = self.poll()
        return status

    def do(self, command: Command, order: Move | Program | None = None) -> ActuatorStatus:
        """Send a command and wait until it is acknowledged as done."""
        sequence = self.driver.send(command, order)
        assert (sequence, int(command)) in list(self.driver.sent), "the driver must list the commands sent"
        if not self.driver.capabilities.acknowledge:
            return self.poll()
        status = self.until(
            lambda status: status.acknowledges(command, sequence) and status.result not in {Result.IDLE, Result.BUSY},
            f"acknowledgement of {command.name}",
        )
        assert status.result == Result.DONE, f"{command.name}: {status}"
        return status

    def take(self) -> None:
        """Take the lease, clear a trip, write the limits, full pressure."""
        able = self.driver.capabilities
        if able.lease:
            self.do(Command.ACQUIRE)
        if able.limits_read_back:
            self.driver.write_limits(LIMITS)
        if self.poll().state == State.TRIPPED:
            self.do(Command.RESET)
        if able.hydraulics:
            self.do(Command.HYDRAULICS_LOW)
            self.until(lambda status: status.state == State.LOW, "low pressure")
            self.do(Command.HYDRAULICS_ON)
        self.until(lambda status: status.state == State.HOLD, "holding")

    def leave(self) -> None:
        """Stop, pressure off, lease given back."""
        able = self.driver.capabilities
        self.do(Command.FADE_STOP)
        if able.hydraulics:
            self.do(Command.HYDRAULICS_OFF)
            self.until(lambda status: status.hydraulics_off, "no pressure")
        if able.lease:
            self.do(Command.RELEASE)


Made = Callable[..., Driven]


@pytest.fixture
def made(driver_name: str, peer: Peer) -> Iterator[Made]:
    """Makes drivers on the peer; what is open at the end is closed."""
    begun: list[Driven] = []

    def make(url: str = peer.url) -> Driven:
        connection = ActuatorConnection(url, timeout_s=TIMEOUT_S, owner_id=OWNER)
        begun.append(Driven(make_actuator(driver_name.rpartition(":")[2], connection)))
        return begun[-1]

    yield make
    for driven in begun:
        driven.driver.close()


@pytest.fixture
def taken(made: Made) -> Iterator[Driven]:
    """A driver that may move its peer; stopped at the end."""
    driven = made()
    driven.driver.open()
    driven.take()
    yield driven
    driven.leave()


def test_it_has_what_the_role_has_and_says_what_it_can_do(made: Made) -> None:
    driver = made().driver
    assert [name for name in members_of(Actuator) if not hasattr(driver, name)] == []
    assert driver.capabilities.can_be_stopped, "the device needs a watchdog or pressure control"
    assert driver.link_kind in set(LinkKind)


def test_it_opens_closes_and_opens_again(made: Made) -> None:
    driver = made().driver
    known = [driver.is_open]
    driver.open()
    known.append(driver.is_open)
    assert driver.read_status().received_ns > 0
    driver.close()
    driver.close()
    known.append(driver.is_open)
    assert known == [False, True, False]
    with pytest.raises(DriverError):
        driver.read_status()
    driver.open()
    assert driver.read_status().received_ns > 0


def test_opening_a_dead_port_raises_and_names_the_port(made: Made, peer: Peer) -> None:
    with pytest.raises(DriverError) as raised:
        made(peer.without_listener).driver.open()
    assert raised.value.port


def test_its_identity_is_the_same_every_time(made: Made) -> None:
    driver = made().driver
    driver.open()
    assert driver.read_identity() == driver.read_identity()


def test_its_status_is_fresh_and_in_si(made: Made) -> None:
    driven = made()
    driven.driver.open()
    began_ns = time.monotonic_ns()
    first, second = driven.poll(), driven.poll()
    assert began_ns <= first.received_ns < second.received_ns <= time.monotonic_ns(), (
        "arrival times must be on the host's monotonic clock (ns)"
    )
    assert abs(second.position_m) < 1.0, "the position must be in metres"
    assert abs(second.velocity_m_s) < 0.01, "the velocity at rest must be 0 m/s"
    assert math.isnan(second.force_N) == (not driven.driver.capabilities.force_input)
    driven.until(lambda status: status.heartbeat != first.heartbeat, "another heartbeat", 2.0)


def test_limits_are_held_as_they_were_written(made: Made) -> None:
    driven = made()
    if not driven.driver.capabilities.limits_read_back:
        pytest.skip("limits cannot be read back (capabilities.limits_read_back)")
    driven.driver.open()
    driven.do(Command.ACQUIRE)
    driven.driver.write_limits(LIMITS)
    held = driven.driver.read_limits()
    for name in ActuatorLimits.__dataclass_fields__:
        assert getattr(held, name) == pytest.approx(getattr(LIMITS, name), rel=1e-6), name
    driven.do(Command.RELEASE)


def test_it_moves_to_a_position_in_metres_and_holds_there(taken: Driven) -> None:
    begin_m = taken.poll().position_m
    target_m = begin_m + (STEP_M if begin_m < 0.0 else -STEP_M)
    taken.do(Command.MOVE_TO, Move(target_m, 0.01))
    status = taken.until(lambda status: status.state == State.HOLD, "end of the move")
    assert status.position_m == pytest.approx(target_m, abs=5e-4)


def test_a_program_runs_and_a_stop_ends_it_at_rest(taken: Driven) -> None:
    centre_m = taken.poll().position_m
    for stop in (Command.FADE_STOP, Command.HALT):
        taken.do(Command.START, replace(PROGRAM, centre_m=centre_m))
        taken.until(lambda status: status.state == State.RUNNING, "the programmed motion")
        seen = [taken.poll() for _ in range(100)]
        travel_m = max(status.position_m for status in seen) - min(status.position_m for status in seen)
        assert travel_m == pytest.approx(2.0 * PROGRAM.amplitude_m, rel=0.25)
        taken.do(stop)
        status = taken.until(lambda status: status.state == State.HOLD, f"holding after {stop.name}", 3.0)
        assert abs(status.velocity_m_s) < 0.005


def test_an_actuator_that_is_not_fed_stops_by_itself(taken: Driven) -> None:
    if taken.driver.capabilities.watchdog is WatchdogKind.NONE:
        pytest.skip("no watchdog (as reported on connection): the rig relies on switching the pressure off")
    taken.poll()
    taken.fed = False
    taken.until(lambda status: status.state == State.TRIPPED, "watchdog trip", 3.0)
    taken.fed = True
    taken.do(Command.RESET)


def test_silence_raises_in_time(made: Made, peer: Peer) -> None:
    driven = made()
    driven.driver.open()
    driven.poll()
    peer.silence()
    began_s = time.monotonic()
    with pytest.raises(DriverError):
        driven.driver.read_status()
    assert time.monotonic() - began_s < 3.0 * TIMEOUT_S + 1.0


def test_a_lost_connection_raises(made: Made, peer: Peer) -> None:
    driven = made()
    driven.driver.open()
    driven.poll()
    peer.hang_up()
    with pytest.raises(DriverError):
        driven.until(lambda status: False, "an error", PROMPT_S)

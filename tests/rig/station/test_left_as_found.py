"""A controller is left as it was found: given back, and no trip of its watchdog latched by this host's leaving."""

from __future__ import annotations

import pytest
from station_bench import config_for
from test_capabilities import LittleActuator, Rig, wait_for

from drivers.capabilities import Capabilities, WatchdogKind
from drivers.roles import ActuatorStatus, Command, FaultBit, Move, Program
from rig.clock import monotonic_ns

WATCHDOG_NS = int(1e9 * config_for().actuator.watchdog_s)


class Watched(LittleActuator):
    """Its watchdog runs from the first feed on, trips when it is not fed, and waits for a first feed after a reset."""

    fed_ns = 0
    own_faults = 0

    @property
    def trip(self) -> int:
        """Its fault bits."""
        late = self.fed_ns and monotonic_ns() - self.fed_ns > WATCHDOG_NS
        return self.own_faults | (int(FaultBit.WATCHDOG) if late else 0)

    def read_status(self) -> ActuatorStatus:
        return super().read_status()._replace(fault_bits=self.trip)

    def exchange(self, watchdog_counter: int) -> ActuatorStatus:
        if not self.trip:
            self.fed_ns = monotonic_ns()
        return super().exchange(watchdog_counter)

    def send(self, command: Command, order: Move | Program | None = None) -> int:
        if command is Command.RESET:
            self.fed_ns = self.own_faults = 0
        return super().send(command, order)


def left(monkeypatch: pytest.MonkeyPatch, own_faults: int = 0, **able: bool) -> tuple[Rig, list[int]]:
    """The rig after its controller was left, and the commands that were sent."""
    monkeypatch.setattr("test_capabilities.LittleActuator", Watched)
    here = Rig(Capabilities(WatchdogKind.TIMEOUT, hydraulics=True, **able))
    assert isinstance(here.driver, Watched)
    assert wait_for(lambda: here.driver.fed > 3)
    here.driver.own_faults = own_faults
    assert wait_for(
        lambda: here.thread.interlock.status is not None and here.thread.interlock.status.fault_bits == own_faults
    )
    here.supervisor.disarm()
    here.preparation.leave_controller()
    return here, [command for _, command in here.driver.sent]


def test_the_watchdogs_trip_that_follows_is_reset_and_does_not_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    here, sent = left(monkeypatch)
    assert sent == [Command.RESET]
    polls = here.thread.polls
    assert wait_for(lambda: here.thread.polls > polls + 20)
    assert here.driver.trip == 0  # type: ignore[attr-defined]  # a `Watched`
    assert not here.journal, "its trip was expected"
    here.thread.end()


def test_a_trip_of_its_own_is_left_to_the_operator(monkeypatch: pytest.MonkeyPatch) -> None:
    here, sent = left(monkeypatch, own_faults=int(FaultBit.FOLLOWING_ERROR))
    assert sent == []
    here.thread.end()


@pytest.mark.parametrize("able", [{"lease": True, "releases": True}, {"releases": True}])
def test_it_is_given_back_whether_or_not_it_shows_who_has_it(
    able: dict[str, bool], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, sent = left(monkeypatch, **able)
    assert sent[0] == Command.RELEASE
    assert (Command.RESET in sent) is not able.get("lease", False)
    here.thread.end()


def test_control_is_taken_by_a_command_without_an_owner_too() -> None:
    here = Rig(Capabilities(WatchdogKind.NONE, hydraulics=True, acquires=True))
    here.preparation.acquire()
    assert [command for _, command in here.driver.sent] == [Command.ACQUIRE]
    here.thread.end()

"""A watchdog that works only under power is tested there, at rest; the power is off at the end, however it ends."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest
from station_bench import config_for
from test_capabilities import LittleActuator, Rig, wait_for

from drivers.capabilities import Capabilities, WatchdogKind
from drivers.roles import ActuatorStatus, Command, FaultBit, Input, Move, Program, State
from rig.clock import monotonic_ns
from rig.station.errors import StationRefused

WATCHDOG_NS = int(1e9 * config_for().actuator.watchdog_s)
SHOWN = {State.OFF: Input(0), State.LOW: Input.HYDRAULICS_LOW, State.HOLD: Input.HYDRAULICS_ON}
STATE_AFTER = {
    Command.HYDRAULICS_LOW: State.LOW, Command.HYDRAULICS_ON: State.HOLD, Command.HYDRAULICS_OFF: State.OFF,
}


class Powered(LittleActuator):
    """Its watchdog runs from the first feed under power on, and its trip may take the power away or move the rod."""

    state = State.OFF
    fed_ns = tripped = 0
    deaf = switches_off = False
    jumps_m = 0.0

    def read_status(self) -> ActuatorStatus:
        late = self.state is State.HOLD and self.fed_ns and monotonic_ns() - self.fed_ns > WATCHDOG_NS
        if late and not self.deaf and not self.tripped:
            self.tripped = int(FaultBit.WATCHDOG)
            self.position_m += self.jumps_m
            self.state = State.OFF if self.switches_off else self.state
        shown = super().read_status()._replace(fault_bits=self.tripped, inputs=Input.E_STOP_CLOSED | SHOWN[self.state])
        return shown._replace(state=State.TRIPPED if self.tripped else self.state)

    def exchange(self, watchdog_counter: int) -> ActuatorStatus:
        self.fed_ns = monotonic_ns() if self.state is State.HOLD else 0
        return super().exchange(watchdog_counter)

    def send(self, command: Command, order: Move | Program | None = None) -> int:
        self.state = STATE_AFTER.get(command, self.state)
        if command is Command.RESET:
            self.tripped = self.fed_ns = 0
        return super().send(command, order)


@pytest.fixture
def powered(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., tuple[Rig, Powered]]]:
    monkeypatch.setattr("test_capabilities.LittleActuator", Powered)
    made: list[Rig] = []

    def make(**behaviour: object) -> tuple[Rig, Powered]:
        here = Rig(Capabilities(WatchdogKind.TIMEOUT, hydraulics=True, low_pressure=False, watchdog_tested="on"))
        made.append(here)
        assert isinstance(here.driver, Powered)
        for name, value in behaviour.items():
            setattr(here.driver, name, value)
        assert wait_for(lambda: here.thread.rests(monotonic_ns()))
        return here, here.driver

    yield make
    for one in made:
        one.thread.end()


@pytest.mark.parametrize("switches_off", [False, True])
def test_it_trips_under_power_and_is_reset_without(
    switches_off: bool, powered: Callable[..., tuple[Rig, Powered]]
) -> None:
    here, driver = powered(switches_off=switches_off)
    after_s = here.requests._starve_watchdog({})["tripped_after_s"]
    assert after_s == pytest.approx(1e-9 * WATCHDOG_NS, abs=0.15)
    assert (driver.state, driver.tripped) == (State.OFF, 0)
    commands = [command for _, command in driver.sent]
    assert commands == [Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON, Command.HYDRAULICS_OFF, Command.RESET]
    polls = here.thread.polls
    assert wait_for(lambda: here.thread.polls > polls + 20)
    assert here.supervisor.trip is None
    assert not here.journal, "its trip was expected"


@pytest.mark.parametrize(
    ("behaviour", "slug", "text"), [({"deaf": True}, "watchdog-absent", "did not trip"),
                                    ({"jumps_m": 0.003}, "not-at-rest", "moved 3.00 mm")],
)  # fmt: skip
def test_a_refusal_leaves_it_without_power(
    behaviour: dict[str, object], slug: str, text: str, powered: Callable[..., tuple[Rig, Powered]]
) -> None:
    here, driver = powered(**behaviour)
    with pytest.raises(StationRefused, match=text) as refused:
        here.requests._starve_watchdog({})
    assert refused.value.slug == slug
    assert driver.state is State.OFF

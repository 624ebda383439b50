"""The actuator's thread against Modbus bytes: a stop gets through, and no answer is taken for more than it is."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator

import pytest
from demo_registers import STATUS
from modbus_device import ModbusDevice, demo_actuator, framed
from station_bench import Journal, config_for

from drivers.register_maps.map_file import controller as described
from drivers.roles import Command, Input, State
from rig.bench.settings import ActuatorConfig
from rig.clock import monotonic_ns
from rig.faults.row import StopKind
from rig.station.interlocks.actuator_interlock import ActuatorInterlock
from rig.station.interlocks.finding import Finding
from rig.station.safe_stop import StopAction, StopPhase
from rig.station.supervisor import Supervisor
from rig.station.threads.actuator_thread import ActuatorThread

MS = 1_000_000
NEVER_NS = 1 << 60
PATIENCE_S = 8.0
NAP_S = 0.002
MOST_STOP_S = 4.0
"""2.3 s until a controller that is lost counts as one that ignores the stop, 1 s for its hydraulics."""


class Coil:
    """A coil that is always at 0 A."""

    fresh_current_A = 0.0
    zero_within_s = 0.25
    falls_within_s = 0.25
    own_timeout_s = 0.1

    def zero_now(self) -> None:
        """Nothing to do."""


class MovingRod:
    """An LVDT that sees the rod move for ever."""

    changed = True

    def still_s(self, now_ns: int) -> float:
        del now_ns
        return 0.0

    def restart_still(self) -> None:
        """It never stood still."""

    def hold_place(self) -> None:
        """Nothing was proved."""

    def left_place(self, now_ns: int) -> bool:
        del now_ns
        return False

    def position_m(self, now_ns: int) -> None:
        del now_ns

    speed_m_s = math.nan


class Controller:
    """A running controller as a Modbus device, with the station's thread at it."""

    def __init__(self, poll_s: float, frozen_after_ns: int) -> None:
        self.device = ModbusDevice()
        self.show(State.RUNNING)
        self.journal = Journal()
        self.supervisor = Supervisor(
            config_for(), self.journal.append, lambda records: None, lambda now_ns: None, lambda: 0.0
        )
        self.thread = ActuatorThread(
            ActuatorConfig(url=self.device.url, poll_s=poll_s),
            demo_actuator(self.device.url, timeout_s=0.1, owner_id=77),
            ActuatorInterlock(
                77, described("demo").capabilities, frozen_after_ns=frozen_after_ns, disagreement_m=1.0, lag_s=0.0
            ),
            MovingRod(),
            self.supervisor,
            lambda records: None,
        )
        self.thread.open()
        self.supervisor.attach(Coil(), self.thread, MovingRod(), ())
        self.supervisor.arm()

    def show(self, state: State, clock_us: int = 0) -> None:
        inputs = Input.E_STOP_CLOSED | Input.HYDRAULICS_ON
        values = {"state": int(state), "inputs": int(inputs), "owner": 77, "position": 0.01, "clock": clock_us}
        self.device.put(STATUS.address, STATUS.encode(values))

    def written(self) -> list[int]:
        """Commands that came over the wire, executed or not."""
        return [words[0] for _, address, words in self.device.requests if address == 300]

    def close(self) -> None:
        self.supervisor.end()
        self.thread.end()
        self.thread.close()
        self.device.close()


Make = Callable[..., Controller]


@pytest.fixture
def controller() -> Iterator[Make]:
    made: list[Controller] = []

    def make(poll_s: float = 0.01, frozen_after_ns: int = NEVER_NS) -> Controller:
        made.append(Controller(poll_s, frozen_after_ns))
        return made[-1]

    yield make
    for each in made:
        each.close()


def wait_for(condition: Callable[[], bool]) -> bool:
    return waited_s(condition) < PATIENCE_S


def waited_s(condition: Callable[[], bool]) -> float:
    """Seconds until this is so, counted in naps: time for which this process was not run is in none of them."""
    naps = 0
    while not condition() and naps * NAP_S < PATIENCE_S:
        time.sleep(NAP_S)
        naps += 1
    return naps * NAP_S


def refuse_halts(frame: bytes, right: bytes) -> list[bytes]:
    function, address, command = frame[7], frame[8:10], frame[13:15]
    if (function, address, command) == (16, (300).to_bytes(2, "big"), int(Command.HALT).to_bytes(2, "big")):
        return [framed(frame, bytes([0x90, 4]))]
    return [framed(frame, right)]


def test_a_stop_whose_number_another_master_used_first_is_sent_again_and_the_other_master_named(
    controller: Make,
) -> None:
    rig = controller(poll_s=5.0)
    rig.thread.start()
    assert wait_for(lambda: rig.thread.polls == 1)
    sequence = rig.thread.call(lambda driver: driver.send(Command.START), PATIENCE_S)
    assert wait_for(lambda: rig.thread.polls == 2), "its number is seen, the other's is not"
    rig.device.command(Command.ACQUIRE, sequence + 1)
    rig.supervisor.ask_stop(StopKind.FADE_OUT, "operator", "now")
    assert wait_for(lambda: Command.FADE_STOP in rig.device.executed)
    assert wait_for(lambda: rig.thread.stop_taken)
    assert rig.journal.slugs("also") == ["second-master"]


def test_a_fade_out_that_is_not_acknowledged_does_not_take_the_place_of_a_halt_that_waits(controller: Make) -> None:
    rig = controller()
    rig.device.ignore_writes = True
    rig.device.faults = [refuse_halts] * 100_000
    rig.thread.start()
    rig.supervisor.ask_stop(StopKind.FADE_OUT, "operator", "now")
    rig.thread.act(StopAction.HALT)
    assert wait_for(lambda: rig.written().count(Command.FADE_STOP) == 2)
    rig.device.ignore_writes = False
    rig.device.faults = []
    assert wait_for(lambda: Command.HALT in rig.device.executed)
    assert wait_for(lambda: rig.thread.stop_taken)
    assert rig.device.executed[-1] == Command.HALT, "nothing weaker follows it"


def test_of_stops_that_wait_together_the_strongest_has_the_last_word(controller: Make) -> None:
    rig = controller()
    for action in (StopAction.HYDRAULICS_OFF, StopAction.FADE, StopAction.HALT):
        rig.thread.act(action)
    rig.thread.start()
    assert wait_for(lambda: rig.thread.stop_taken)
    assert rig.device.executed == [Command.FADE_STOP, Command.HALT, Command.HYDRAULICS_OFF]


def leave_fade_outs_unanswered(frame: bytes, right: bytes) -> list[bytes]:
    fade = (16, (300).to_bytes(2, "big"), int(Command.FADE_STOP).to_bytes(2, "big"))
    return [] if (frame[7], frame[8:10], frame[13:15]) == fade else [framed(frame, right)]


def test_no_stronger_stop_waits_for_a_weaker_one_that_is_not_answered(controller: Make) -> None:
    rig = controller()
    rig.device.faults = [leave_fade_outs_unanswered] * 100_000
    for action in (StopAction.HYDRAULICS_OFF, StopAction.FADE):
        rig.thread.act(action)
    rig.thread.start()
    assert wait_for(lambda: Command.HYDRAULICS_OFF in rig.device.executed)
    assert wait_for(lambda: rig.thread.stop_taken), "what is weaker than the pressure's end is not needed any more"


def test_a_job_that_was_given_up_before_it_began_never_runs(controller: Make) -> None:
    rig = controller()
    with pytest.raises(TimeoutError):
        rig.thread.call(lambda driver: driver.send(Command.START), 0.05)
    rig.thread.start()
    rig.thread.call(lambda driver: driver.send(Command.ACQUIRE), PATIENCE_S)
    assert rig.device.executed == [Command.ACQUIRE]


def test_a_stop_that_waits_for_a_lost_controller_leaves_the_machine_to_the_others(controller: Make) -> None:
    rig = controller()
    rig.thread.start()
    assert wait_for(lambda: rig.thread.polls > 0)
    rig.device.close()
    rig.thread.act(StopAction.FADE)
    assert wait_for(lambda: rig.thread.failures > 2)
    failures, used_s, began_s = rig.thread.failures, time.process_time(), time.monotonic()
    time.sleep(0.5)
    lasted_s = time.monotonic() - began_s  # more than asked for on a busy machine
    assert rig.thread.failures - failures <= 120 * lasted_s, "one attempt in 10 ms"
    assert time.process_time() - used_s < 0.5 * lasted_s


def test_a_controller_without_a_position_leaves_the_proof_of_standstill_to_the_lvdt(controller: Make) -> None:
    rig = controller()
    rig.device.put(STATUS.address, STATUS.encode({"state": int(State.HOLD), "inputs": 1, "owner": 77}))
    rig.device.put(106, [0x7FC0, 0])  # a quiet NaN
    rig.thread.start()
    assert wait_for(lambda: rig.supervisor.trip is not None)
    assert rig.supervisor.trip is not None
    assert (rig.supervisor.trip.slug, rig.supervisor.trip.stop) == ("feedback-lost", StopKind.HALT)
    assert wait_for(lambda: Command.HALT in rig.device.executed)
    moving, clock_s, _, _ = rig.thread.stop_inputs(monotonic_ns())
    assert moving is None
    assert clock_s is not None


def test_what_the_controller_reported_before_the_stop_was_sent_is_no_proof_that_the_rod_stands(
    controller: Make,
) -> None:
    rig = controller()
    clock_us = itertools.count(0, 2000)

    def rests() -> bool:
        rig.show(State.HOLD, clock_us=next(clock_us))
        return rig.thread.rests(monotonic_ns())

    rig.thread.start()
    assert wait_for(rests)
    rig.thread.restart_still()
    polls = rig.thread.polls
    assert wait_for(lambda: not rests() and rig.thread.polls > polls + 20), "a start may be on its way"
    rig.thread.act(StopAction.FADE)
    assert wait_for(rests)
    assert Command.FADE_STOP in rig.device.executed


def test_a_status_that_stands_in_running_is_no_view_and_the_stop_ends_in_time_without_proof(controller: Make) -> None:
    rig = controller(frozen_after_ns=150 * MS)
    rig.thread.start()
    rig.supervisor.start()
    assert wait_for(lambda: rig.supervisor.trip is not None)
    assert rig.supervisor.trip is not None
    # A host that is itself held up is late first.
    assert wait_for(lambda: "actuator-frozen" in [rig.supervisor.trip.slug, *rig.journal.slugs("also")])
    assert rig.thread.stop_inputs(monotonic_ns()) == (None, None, None, None)
    assert waited_s(lambda: (stop := rig.supervisor.stop) is not None and stop.step is StopPhase.UNKNOWN) < MOST_STOP_S
    assert Command.HYDRAULICS_OFF in rig.device.executed
    assert "stop-ignored" in rig.journal.slugs("also")


def test_a_defect_on_its_thread_stops_the_motion_which_nobody_else_could(controller: Make) -> None:
    def defect(*arguments: object) -> list[Finding]:
        raise RuntimeError("a defect")

    rig = controller()
    rig.thread.interlock.check = defect  # type: ignore[method-assign]  # stands for any defect on this thread
    rig.thread.start()
    assert wait_for(lambda: Command.FADE_STOP in rig.device.executed)
    assert rig.thread.alive
    assert rig.journal.slugs("trip") == ["task-dies"]

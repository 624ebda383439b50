"""What the controller does must have been asked for here: other clients, and hands at its panel, are noticed."""

from __future__ import annotations

import pytest

from drivers.roles import ActuatorStatus, Command, FaultBit, Input, Result, State
from rig.station.interlocks.actuator_interlock import CommandWatch

CLOSED = int(Input.E_STOP_CLOSED)
POWERED = CLOSED | int(Input.HYDRAULICS_ON)
ARMED = [(1, Command.ACQUIRE), (2, Command.HYDRAULICS_LOW), (3, Command.HYDRAULICS_ON)]
STARTED = [*ARMED, (4, Command.START)]
ORDERED = 8.0


def status(acked: tuple[int, int], state: State = State.RUNNING, **changes: float) -> ActuatorStatus:
    values: dict[str, float] = dict.fromkeys(ActuatorStatus._fields, 0)
    values |= {"acked_sequence": acked[0], "acked_command": acked[1], "result": Result.DONE, "state": state}
    values |= {"inputs": POWERED, "program_id": 4, "owner": 77}
    return ActuatorStatus(**(values | changes))  # type: ignore[arg-type]  # numbers by name


def found(sent: list[tuple[int, int]], *answers: ActuatorStatus) -> list[list[tuple[str, bool]]]:
    watch = CommandWatch(acknowledged=True)
    watch.expect_program(ORDERED)
    return [[(finding.slug, finding.warns) for finding in watch.check(answer, sent)] for answer in answers]


STOPS = [("second-master", False)]


@pytest.mark.parametrize("command", [Command.FADE_STOP, Command.HALT, Command.HYDRAULICS_OFF, Command.MOVE_TO, 99])
@pytest.mark.parametrize("number", [4, 5, 60_000])
def test_another_clients_command_stops_whatever_its_number(command: int, number: int) -> None:
    assert found(STARTED, status(STARTED[-1]), status((number, command))) == [[], STOPS]


def test_another_hosts_question_that_was_refused_is_reported_once_and_stops_nothing() -> None:
    knock = status((9, Command.ACQUIRE), result=Result.REFUSED_OWNER)
    assert found(STARTED, knock, knock, status(STARTED[-1])) == [[("second-master", True)], [], []]


def test_what_was_requested_before_this_host_came_is_nobodys_doing_and_a_change_of_it_is() -> None:
    """A controller without a lease still shows yesterday's last command."""
    shown = [(512, Command.HALT), (513, Command.RESET), (9, Command.START)]
    yesterday, ours, theirs = (status(one, State.HOLD, program_id=0) for one in shown)
    watch = CommandWatch(acknowledged=True)
    sent: list[tuple[int, int]] = []
    assert [watch.check(yesterday, sent), watch.check(yesterday, sent)] == [[], []]
    sent.append((513, Command.RESET))
    assert [watch.check(yesterday, sent), watch.check(ours, sent)] == [[], []]
    assert [finding.slug for finding in watch.check(yesterday, sent)] == ["second-master"], "after ours it is new"
    assert [finding.slug for finding in watch.check(theirs, sent)] == ["second-master"]


def test_a_motion_command_without_the_lease_is_no_question() -> None:
    assert found(STARTED, status((9, Command.START), result=Result.REFUSED_OWNER)) == [STOPS]


@pytest.mark.parametrize("state", [State.FADING, State.HALTING, State.MOVING])
def test_a_stop_or_a_move_at_the_controllers_own_panel_is_seen_by_what_it_does(state: State) -> None:
    panel = status(STARTED[-1], state)
    assert found(STARTED, status(STARTED[-1]), panel, panel) == [[], [], STOPS]


@pytest.mark.parametrize("state", [State.OFF, State.LOW])
def test_pressure_that_goes_without_a_fault_was_somebodys_doing(state: State) -> None:
    gone = status(ARMED[-1], state, inputs=CLOSED, program_id=0)
    assert found(ARMED, status(ARMED[-1], State.HOLD), gone, gone) == [[], [], STOPS]


def test_pressure_that_was_not_reached_yet_has_not_gone() -> None:
    low = status(ARMED[-1], State.LOW, program_id=0)
    assert found(ARMED, low, low, low, status(ARMED[-1], State.HOLD)) == [[], [], [], []]


@pytest.mark.parametrize(("done", "message"), [(7, STOPS), (8, []), (0, STOPS)])
def test_a_program_that_ends_before_its_cycles_are_done_was_stopped_by_somebody(
    done: int, message: list[tuple[str, bool]]
) -> None:
    ended = status(STARTED[-1], State.HOLD, cycles_done=done)
    assert found(STARTED, status(STARTED[-1]), ended, ended) == [[], message, []]


def test_a_program_that_was_not_started_here_is_somebody_elses() -> None:
    assert found(STARTED, status(STARTED[-1]), status(STARTED[-1], program_id=9)) == [[], STOPS]


@pytest.mark.parametrize("stop", [Command.FADE_STOP, Command.HALT, Command.HYDRAULICS_OFF])
def test_our_own_stops_are_ours_however_often_they_are_sent(stop: Command) -> None:
    sent = [*STARTED, (5, stop), (40_000, stop)]
    on_its_way = status(STARTED[-1], State.FADING)
    answers = [on_its_way, status((5, stop), State.FADING), status((40_000, stop), State.HALTING)]
    ended = status((40_000, stop), State.HOLD, cycles_done=2)
    assert found(sent, status(STARTED[-1]), *answers, ended) == [[]] * 5


def test_a_motion_after_our_stop_is_watched_anew() -> None:
    again = [*STARTED, (5, Command.FADE_STOP), (6, Command.RESET), (7, Command.START)]
    fading = status(again[-1], State.FADING, program_id=7)
    assert found(again, status(again[-1], program_id=7), fading, fading)[-1] == STOPS


def test_what_the_controller_does_for_a_fault_has_that_faults_name() -> None:
    fading = status(STARTED[-1], State.FADING, fault_bits=int(FaultBit.WATCHDOG))
    tripped = status(STARTED[-1], State.TRIPPED, fault_bits=int(FaultBit.SUPPLY_PRESSURE), inputs=CLOSED)
    chain = status(STARTED[-1], State.OFF, inputs=0)
    assert found(STARTED, status(STARTED[-1]), fading, tripped, tripped, chain, chain) == [[]] * 6


def test_a_short_program_that_was_never_seen_running_is_no_finding() -> None:
    assert found(STARTED, status(STARTED[-1], State.HOLD, cycles_done=0)) == [[]]

"""A current set by hand: who is asked when, and what may happen meanwhile. Every reachable state: `test_sequencer`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from matrices import matrix_text

from rig.bench.model import Bench
from rig.campaign.results import RigState
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.action import Request
from rig.campaign.sequencer.state import Conditions, ManualState, Phase, State, conditions_of, start_state
from rig.campaign.sequencer.step import step
from rig.campaign.stop_cause import StopCause
from rig.faults.row import StopKind
from rig.matrix.model import load_matrix
from rig.test_point import TestPoint
from simulators.scenarios.drawn_rig import bench_file

SINE = TestPoint("p001", "sine", 0.02, 2.0, 0.0, cycles=3)
UP = (
    ev.ZerosJudged(None), ev.Done(Request.ARM), ev.Done(Request.STARVE_WATCHDOG), ev.Done(Request.HYDRAULICS_LOW),
    ev.Done(Request.HYDRAULICS_ON), ev.ProofLegDone(), ev.ProofJudged(None),
)  # fmt: skip


def through(state: State, *events: ev.Event) -> tuple[State, list[act.Action]]:
    done: list[act.Action] = []
    for event in events:
        state, actions = step(state, event)
        done += actions
    return state, done


def requested_currents(actions: list[act.Action]) -> list[float]:
    return [action.current_A for action in actions if isinstance(action, act.AskOperator)]


def connected(*currents_A: float, pressure: str = "off", rest_s: float = 0.0) -> tuple[State, list[act.Action]]:
    numbered = enumerate(currents_A)
    points = tuple(replace(SINE, id=f"p{number}", current_A=at_A, rest_s=rest_s) for number, at_A in numbered)
    first = start_state(points, 0, Conditions(hand=ManualState(pressure, 600.0)))
    return through(first, ev.Begin(), ev.Done(Request.CONNECT))


def run(state: State) -> tuple[State, list[act.Action]]:
    return through(
        state, ev.Centred(), ev.CurrentSettled(), ev.ProgramEnded(at_centre=True), ev.CurrentSettled(),
    )  # fmt: skip


def test_0_A_is_confirmed_before_anything_is_armed() -> None:
    state, actions = connected(0.0)
    assert (state.phase, requested_currents(actions)) == (Phase.ASKING, [0.0])
    state, actions = through(state, ev.OperatorAnswered())
    assert act.SetCurrent(0.0) in actions
    state, _ = through(state, ev.CurrentSettled())
    assert state.phase is Phase.CHECKING_ZEROS


def test_one_question_serves_every_point_of_a_current_and_0_A_is_requested_at_the_end() -> None:
    state, actions = connected(0.0, 1.0, 1.0)
    state, _ = through(state, ev.OperatorAnswered(), ev.CurrentSettled(), *UP)
    state, more = run(state)
    assert requested_currents(actions + more) == [0.0]
    assert (state.phase, state.powered) == (Phase.YIELDING, False)
    assert act.Ask(Request.HYDRAULICS_OFF) in more
    state, more = through(state, ev.Done(Request.HYDRAULICS_OFF))
    assert (requested_currents(more), state.pressurised) == ([1.0], False)
    state, more = through(
        state, ev.OperatorAnswered(), ev.CurrentSettled(), ev.Done(Request.HYDRAULICS_LOW),
        ev.Done(Request.HYDRAULICS_ON),
    )  # fmt: skip
    assert act.SetCurrent(1.0) in more
    assert not any(isinstance(action, act.ProveSensors) for action in more), "the 0 A signature is not asked of 1 A"
    state, more = run(state)
    assert requested_currents(more) == []
    assert act.SetCurrent(0.0) not in more, "nobody here can set 0 A"
    state, more = through(state, ev.CurrentSettled(), ev.ProgramEnded(at_centre=True), ev.CurrentSettled())
    state, more = through(state, ev.Done(Request.HYDRAULICS_OFF))
    assert requested_currents(more) == [0.0]


@pytest.mark.parametrize(("pressure", "lowered"), [("low", Request.HYDRAULICS_LOW), ("on", None)])
def test_the_bench_says_what_pressure_there_is_meanwhile(pressure: str, lowered: Request | None) -> None:
    state, _ = connected(0.0, 1.0, pressure=pressure)
    state, _ = through(state, ev.OperatorAnswered(), ev.CurrentSettled(), *UP)
    state, actions = run(state)
    if lowered is None:
        assert (state.phase, requested_currents(actions)) == (Phase.ASKING, [1.0])
    else:
        assert act.Ask(lowered) in actions


def test_a_rest_is_at_0_A() -> None:
    state, _ = connected(1.0, 1.0, pressure="on", rest_s=60.0)
    state, _ = through(
        state, ev.OperatorAnswered(), ev.CurrentSettled(), *UP, ev.OperatorAnswered(), ev.CurrentSettled()
    )
    state, actions = run(state)
    assert requested_currents(actions) == [0.0]
    state, actions = through(state, ev.OperatorAnswered(), ev.CurrentSettled())
    assert (state.phase, act.Rest(60.0) in actions) == (Phase.RESTING, True)


def test_after_a_stop_it_is_requested_to_be_taken_away_without_pressure_and_silence_is_unknown() -> None:
    state, _ = connected(1.0)
    state, _ = through(state, ev.OperatorAnswered(), ev.CurrentSettled(), *UP, ev.Done(Request.HYDRAULICS_OFF))
    state, actions = through(state, ev.Tripped(StopKind.FADE_OUT, StopCause("force-limit")), ev.Safe())
    assert requested_currents(actions) == [], "1 A was asked for and may flow, but first the pressure goes"
    state, actions = through(state, ev.Done(Request.DISARM))
    assert (state.phase, requested_currents(actions)) == (Phase.TAKING_AWAY, [0.0])
    after, _ = through(state, ev.OperatorAnswered(), ev.CurrentSettled())
    assert (after.phase, after.rig_state) == (Phase.ENDED, RigState.SAFE)
    for event in (ev.TimedOut(Phase.TAKING_AWAY), ev.Abort(StopKind.FADE_OUT, StopCause("sigint"))):
        unsaid, actions = through(state, event)
        assert (unsaid.phase, unsaid.rig_state) == (Phase.ENDED, RigState.UNKNOWN)
        assert any("may still be flowing" in action.text for action in actions if isinstance(action, act.Note))


@pytest.mark.parametrize(("register_map", "pressure"), [("demo", "low"), ("delta-rmc", "off")])
def test_a_controller_with_one_pressure_is_switched_off_in_place_of_low(
    register_map: str, pressure: str, tmp_path: Path
) -> None:
    """Its campaign waited 10 s for a pressure that it does not have, and was refused (seed 1031375)."""
    source = {"by_hand": True, "pressure_while_asked": "low"}
    (tmp_path / "bench.toml").write_text(bench_file(register_map, source=source), encoding="utf-8")
    (tmp_path / "matrix.toml").write_text(matrix_text("1 A", amplitude="5 mm", frequency="1 Hz"), encoding="utf-8")
    hand = conditions_of(load_matrix(tmp_path / "matrix.toml"), Bench.load(tmp_path / "bench.toml")).hand
    assert hand is not None
    assert hand.pressure == pressure

"""Blocks of an endurance test in the sequencer: waiting for the count, going on with the rest, stop rules."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest

from rig.campaign.endurance import summary_of
from rig.campaign.sequencer import action as act
from rig.campaign.sequencer import event as ev
from rig.campaign.sequencer.endurance import left_of, without_rest_of
from rig.campaign.sequencer.state import Conditions, Drive, Phase, State, start_state
from rig.campaign.sequencer.step import step
from rig.campaign.stop_cause import StopCause
from rig.faults.row import StopKind
from rig.recording.endurance import FollowedRule, rule_text
from rig.signals.wear_trend import NO_SECTIONS, Forecast, StopRule
from rig.test_point import ENDURANCE, EnduranceStep, TestPoint


def block(number: int, before: int) -> TestPoint:
    step = EnduranceStep("e", before, 300, number, 100, 10)
    return TestPoint(f"e-b{number}", "sine", 0.01, 2.0, 1.0, 100, kind=ENDURANCE, endurance=step)


def performance(before: int) -> TestPoint:
    return TestPoint(f"p-e-{before}", "sine", 0.01, 1.0, 0.5, 5, endurance=EnduranceStep("e", before, 300))


QUEUE = (block(1, 0), block(2, 100), performance(200), block(3, 200), performance(300))
RESTARTABLE = StopCause("ecu-silent", "no status")


def running(queue: tuple[TestPoint, ...] = QUEUE, retries: int = 1, conditions: Conditions | None = None) -> State:
    """A block runs, everything before it was proved."""
    state = start_state(queue, retries) if conditions is None else start_state(queue, retries, conditions)
    return replace(
        state, phase=Phase.RUNNING, armed=True, proved=True, pressurised=True, powered=True, moved=True, recording=True,
        attempts=(queue[0].id,),
    )


def after(state: State, *events: ev.Event) -> tuple[State, list[act.Action]]:
    taken: list[act.Action] = []
    for event in events:
        state, actions = step(state, event)
        taken += actions
    return state, taken


def counted(left: int, run: int, ended_by: str = "", point: str = "e-b1") -> ev.Judged:
    return ev.Judged(point, valid=left == 0, block=ev.BlockCounted(left, run, ended_by))


ENDED = (ev.ProgramEnded(at_centre=True), ev.CurrentSettled())


def test_the_next_block_waits_until_the_cycles_of_the_last_one_are_counted() -> None:
    state, actions = after(running(), *ENDED)
    assert state.phase is Phase.EVALUATING
    assert not any(isinstance(action, act.Start) for action in actions)
    state, _ = after(state, counted(0, 100))
    assert [point.id for point in state.queue] == ["e-b2", "p-e-200", "e-b3", "p-e-300"]
    assert state.phase is Phase.SETTLING


def test_a_count_that_comes_before_the_current_is_off_is_not_lost() -> None:
    state, _ = after(running(), ENDED[0], counted(0, 100), ENDED[1])
    assert state.point.id == "e-b2"
    assert state.phase is Phase.SETTLING


def test_a_stopped_block_goes_on_with_the_cycles_that_are_left() -> None:
    stopped = (ev.Tripped(StopKind.FADE_OUT, RESTARTABLE), ev.Safe(StopKind.FADE_OUT))
    state, actions = after(running(), *stopped, counted(58, 42))
    assert next(action for action in actions if isinstance(action, act.EndRecording)).fault == RESTARTABLE
    assert state.phase is Phase.RESETTING
    assert (state.point.id, state.point.cycles) == ("e-b1", 58)
    assert state.point.endurance == EnduranceStep("e", 42, 300, 1, 100, 10)


def test_what_is_left_of_a_block_ends_with_the_last_current_that_was_commanded() -> None:
    """Whether the coil is demagnetised before the next point depends on it."""
    whole = replace(block(1, 0), steps_s=(0.0, 10.0, 40.0), steps_A=(0.0, 1.0, 0.5))
    rest = left_of(whole, 20)  # 11 s with its ramps
    state = replace(running((rest,)), phase=Phase.SETTLING, recording=False)
    assert after(state, ev.CurrentSettled())[0].last_current_A == 1.0
    assert rest.steps_in_motion == ((0.0, 0.0), (10.0, 1.0))
    assert after(replace(state, queue=(whole,)), ev.CurrentSettled())[0].last_current_A == 0.5


def test_a_block_whose_cycles_were_all_run_before_the_stop_is_not_repeated() -> None:
    stopped = (ev.Tripped(StopKind.FADE_OUT, RESTARTABLE), ev.Safe(StopKind.FADE_OUT))
    state, _ = after(running(), *stopped, counted(0, 100))
    assert state.point.id == "e-b2"


def test_a_bad_verdict_repeats_no_cycle() -> None:
    state, _ = after(running(retries=2), *ENDED, ev.Judged("e-b1", valid=False, block=ev.BlockCounted(0, 100)))
    assert state.point.id == "e-b2"


def test_a_block_that_cannot_be_recorded_is_given_up_after_its_retries() -> None:
    lost = counted(100, 0)
    state, _ = after(running(retries=0), *ENDED, lost)
    assert state.point.id == "e-b2"
    state, _ = after(running(retries=1), *ENDED, lost)
    assert (state.point.id, state.point.cycles) == ("e-b1", 100)


def test_a_stop_rule_leaves_only_the_last_performance_points_with_the_cycles_run() -> None:
    state, actions = after(running(), *ENDED, counted(0, 100, "force_down"))
    assert [(point.id, point.endurance.cycles_before) for point in state.queue if point.endurance] == [("p-e-300", 100)]
    assert [action for action in actions if isinstance(action, act.Withdraw)] == [
        act.Withdraw("e", ("e-b2", "p-e-200", "e-b3"))
    ]
    assert state.latch is None


def test_another_test_goes_on_after_a_stop_rule() -> None:
    other = replace(block(1, 0), id="f-b1", endurance=EnduranceStep("f", 0, 100, 1, 100, 10))
    assert without_rest_of((block(2, 100), other), "e", 100) == (other,)


def test_a_block_out_of_tolerance_is_kept_and_corrects_the_next_one() -> None:
    conditions = Conditions(tolerance=0.01)
    state = running(conditions=conditions)
    state = replace(state, drives=(Drive("sine", 0.01, 2.0, 1.0, 0.01),))
    state, actions = after(state, ev.ProgramEnded(at_centre=True, motion=ev.MeasuredMotion(0.009, 0.0)))
    assert not any(isinstance(action, act.DropRecording) for action in actions)
    assert any(isinstance(action, act.EndRecording) for action in actions)
    assert state.drives[0].command_m == pytest.approx(0.01 / 0.9)


def test_without_a_count_the_rig_is_stopped() -> None:
    state, _ = after(running(), *ENDED, ev.TimedOut(Phase.EVALUATING))
    assert state.phase is Phase.STOPPING
    assert state.latch is not None
    assert state.latch.cause.slug == "not-written"


def test_what_is_left_of_a_block_begins_where_it_was_interrupted() -> None:
    rest = left_of(left_of(block(3, 200), 70), 10)
    assert (rest.cycles, rest.endurance) == (10, EnduranceStep("e", 290, 300, 3, 100, 10))


def followed(last: float, state: Literal["none", "unknown"] = "unknown") -> FollowedRule:
    return FollowedRule(NO_SECTIONS, np.array([last]), Forecast(state), math.nan)


def test_the_temperature_of_a_stop_rule_is_stated_with_its_unit() -> None:
    text = rule_text(StopRule("temperature", 90.0), followed(24.04, "none"))
    rule = {"name": "temperature", "value": 24.04, "text": text}
    test = {"id": "wear", "cycles_run": 80, "cycles_planned": 480, "cycles_unrecorded_at_most": 0, "rules": [rule]}
    expected = "coil temperature 24 degC (limit 90 degC, no forecast: no significant trend toward the limit)"
    assert summary_of(test) == f"wear: 80 of 480 cycles; {expected}"


def test_a_change_of_nothing_has_no_sign_and_an_unknown_one_its_reason() -> None:
    rule = StopRule("force_down", 0.2)
    assert rule_text(rule, followed(-0.0)) == (
        "decrease of the peak force 0 % (limit 20 %, no forecast: fewer than 8 sections of cycles)"
    )
    assert rule_text(rule, followed(math.nan)).endswith("unknown (limit 20 %): no baseline yet")
    assert rule_text(rule, followed(math.nan), "noise").endswith("not evaluated (limit 20 %): noise")

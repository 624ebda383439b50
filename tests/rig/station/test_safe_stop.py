"""The stop machine: order, proof, deadlines, escalation, and that nothing unproved is ever called safe."""

from __future__ import annotations

import itertools
from dataclasses import replace

import pytest

from rig.faults.row import StopKind
from rig.station import safe_stop
from rig.station.events import unknown_reason
from rig.station.safe_stop import SafeStop, StopAction, StopInputs, StopPhase

MS = 1_000_000
MOVING = StopInputs(0, 0.0, True, 0.0, False, False, 1.0, period_s=1.0, lvdt_changed=True)
AT_REST = replace(MOVING, still_s=1.0, controller_moving=False, current_A=0.0)
OFF = replace(AT_REST, hydraulics_low=True, hydraulics_off=True)
LOST = replace(MOVING, still_s=None, controller_moving=None, controller_clock_s=None, current_A=None,
               hydraulics_low=None, hydraulics_off=None)  # fmt: skip


def at(inputs: StopInputs, ms: float, device_rate: float = 1.0) -> StopInputs:
    clock_s = None if inputs.controller_clock_s is None else ms / 1e3 * device_rate
    return replace(inputs, now_ns=int(ms * MS), controller_clock_s=clock_s)


def begin(
    kind: StopKind = StopKind.FADE_OUT, *, halt: bool = False, fade_s: float = 1.0, device_rate: float = 1.0
) -> SafeStop:
    return safe_stop.begin(kind, 0, halt=halt, fade_s=fade_s, device_rate=device_rate)[0]


def run(
    stop: SafeStop, inputs: StopInputs, until_ms: int, from_ms: int = 0
) -> tuple[SafeStop, list[tuple[int, StopAction]]]:
    done: list[tuple[int, StopAction]] = []
    for ms in range(from_ms, until_ms, 5):
        stop, actions = safe_stop.advance(stop, at(inputs, ms, stop.device_rate))
        done += [(ms, action) for action in actions]
    return stop, done


@pytest.mark.parametrize(
    ("kind", "halt", "command"),
    [
        (StopKind.FADE_OUT, False, StopAction.FADE),
        (StopKind.FADE_OUT, True, StopAction.HALT),
        (StopKind.PRESSURE_OFF, False, StopAction.FADE),
        (StopKind.HALT, False, StopAction.HALT),
    ],
)
def test_current_and_motion_are_commanded_at_once_and_together(kind: StopKind, halt: bool, command: StopAction) -> None:
    _, actions = safe_stop.begin(kind, 0, halt=halt, fade_s=1.0, device_rate=1.0)
    assert actions == (StopAction.ZERO_CURRENT, command)


def test_s2_is_safe_after_standstill_and_zero_current_and_leaves_hydraulics_on() -> None:
    stop, actions = run(begin(), MOVING, 800)
    assert stop.step is StopPhase.STOPPING
    stop, more = run(stop, AT_REST, 810, from_ms=800)
    assert stop.step is StopPhase.SAFE
    assert stop.standstill
    assert stop.current_zero
    assert StopAction.HYDRAULICS_OFF not in [action for _, action in actions + more]


def test_s1_lowers_then_switches_off_only_after_standstill() -> None:
    stop, before = run(begin(StopKind.PRESSURE_OFF), replace(MOVING, current_A=0.0), 500)
    assert before == []
    stop, during = run(stop, AT_REST, 520, from_ms=500)
    assert [action for _, action in during] == [StopAction.HYDRAULICS_LOW]
    stop, after = run(stop, replace(AT_REST, hydraulics_low=True), 540, from_ms=520)
    assert [action for _, action in after] == [StopAction.HYDRAULICS_OFF]
    assert stop.step is StopPhase.OFF
    stop, _ = run(stop, OFF, 550, from_ms=540)
    assert stop.step is StopPhase.SAFE


def test_one_source_that_says_moving_is_enough_not_to_be_at_rest() -> None:
    for inputs in (replace(AT_REST, still_s=0.0), replace(AT_REST, controller_moving=True)):
        stop, _ = run(begin(), inputs, 600)
        assert stop.step is StopPhase.STOPPING


def test_without_the_controller_standstill_needs_a_whole_period_at_rest() -> None:
    alone = replace(AT_REST, controller_moving=None, controller_clock_s=None, hydraulics_low=None, hydraulics_off=None)
    stop, _ = run(begin(), replace(alone, still_s=0.5, period_s=2.0), 300)
    assert stop.step is StopPhase.STOPPING
    stop, _ = run(stop, replace(alone, still_s=2.0, period_s=2.0), 310, from_ms=300)
    assert stop.step is StopPhase.SAFE


def test_without_the_controller_an_lvdt_that_repeats_its_value_proves_nothing() -> None:
    alone = replace(AT_REST, controller_moving=None, controller_clock_s=None, hydraulics_low=None, hydraulics_off=None)
    stop, actions = run(begin(), replace(alone, still_s=60.0, period_s=0.4, lvdt_changed=False), 10_000)
    assert (stop.step, stop.standstill) == (StopPhase.UNKNOWN, False)
    assert StopAction.HYDRAULICS_OFF in [action for _, action in actions]


@pytest.mark.parametrize("slug", ["actuator-frozen", "feedback-lost"])
def test_a_controller_that_is_not_trusted_with_its_position_proves_no_standstill_alone(slug: str) -> None:
    stop = safe_stop.after_fault(safe_stop.after_fault(begin(StopKind.HALT), slug), "lvdt-pulled")
    assert safe_stop.after_fault(stop, slug) is stop
    ended, _ = run(stop, replace(AT_REST, still_s=None, hydraulics_low=True, hydraulics_off=True), 10_000)
    assert (ended.step, ended.standstill) == (StopPhase.UNKNOWN, False)
    ended, _ = run(stop, AT_REST, 400)
    assert ended.step is StopPhase.SAFE, "the LVDT agrees"
    again, _ = safe_stop.escalate(ended, StopKind.PRESSURE_OFF, 500 * MS)
    assert not again.position_trusted


def test_without_the_lvdt_the_controllers_own_standstill_is_the_proof() -> None:
    stop, _ = run(begin(), replace(AT_REST, still_s=None), 20)
    assert stop.step is StopPhase.SAFE


def test_stop_that_is_ignored_escalates_to_hydraulics_off_after_fade_and_margin() -> None:
    stop, actions = run(begin(fade_s=1.0), replace(MOVING, current_A=0.0), 2000)
    late = [(ms, action) for ms, action in actions if action in {StopAction.STOP_IGNORED, StopAction.HYDRAULICS_OFF}]
    assert [action for _, action in late][:2] == [StopAction.STOP_IGNORED, StopAction.HYDRAULICS_OFF]
    assert 1200 <= late[0][0] <= 1400
    assert stop.kind is StopKind.PRESSURE_OFF


def test_fade_deadline_runs_on_the_device_clock_so_a_slowed_rig_is_waited_for() -> None:
    stop = begin(fade_s=1.0)
    for ms in range(0, 5000, 5):
        inputs = replace(MOVING, now_ns=ms * MS, controller_clock_s=ms / 10_000, current_A=0.0)
        stop, actions = safe_stop.advance(stop, inputs)
        assert StopAction.STOP_IGNORED not in actions
    assert stop.step is StopPhase.STOPPING


def test_fast_device_clock_leaves_the_command_its_wall_time() -> None:
    stop, actions = run(begin(fade_s=1.0, device_rate=50.0), replace(MOVING, current_A=0.0), 150)
    assert actions == []
    _, actions = run(stop, replace(MOVING, current_A=0.0), 400, from_ms=150)
    assert StopAction.STOP_IGNORED in [action for _, action in actions]


def test_halt_has_its_own_short_deadline() -> None:
    _, actions = run(begin(StopKind.HALT, fade_s=10.0), replace(MOVING, current_A=0.0), 1000)
    first_ms = next(ms for ms, action in actions if action is StopAction.STOP_IGNORED)
    assert 300 <= first_ms <= 650


def test_current_that_persists_is_reported_once_after_its_deadline() -> None:
    _, actions = run(begin(), MOVING, 900)
    stuck = [ms for ms, action in actions if action is StopAction.CURRENT_STUCK]
    assert stuck == [255]


def test_a_current_that_persists_at_standstill_is_reported_before_anything_is_concluded() -> None:
    stop, actions = run(begin(), replace(AT_REST, current_A=1.0), 260)
    assert [action for _, action in actions] == [StopAction.CURRENT_STUCK]
    assert stop.step is StopPhase.STOPPING


def test_current_that_comes_back_is_not_zero() -> None:
    stop, _ = run(begin(), replace(MOVING, current_A=0.0), 100)
    assert stop.current_zero
    stop, _ = run(stop, MOVING, 110, from_ms=100)
    assert not stop.current_zero


def test_a_current_that_comes_back_after_its_deadline_is_stuck_and_reported_each_time() -> None:
    stop, _ = run(begin(), replace(MOVING, current_A=0.0), 400)
    stop, actions = run(stop, MOVING, 800, from_ms=400)
    assert actions == [(655, StopAction.CURRENT_STUCK)], "given the time of a first 0 A: one sample may be noise"
    stop, _ = run(stop, replace(MOVING, current_A=0.0), 820, from_ms=800)
    _, actions = run(stop, MOVING, 1200, from_ms=820)
    assert actions == [(1075, StopAction.CURRENT_STUCK)]


def test_a_current_that_is_measured_to_the_end_is_no_safe_end_also_when_its_source_is_lost_then() -> None:
    stuck, actions = run(begin(StopKind.PRESSURE_OFF), replace(OFF, current_A=1.5), 300)
    assert StopAction.CURRENT_STUCK in [action for _, action in actions]
    assert (stuck.step, stuck.current_left_A, stuck.standstill) == (StopPhase.UNKNOWN, 1.5, True)
    reason = unknown_reason(stuck, replace(AT_REST, current_A=1.5), {})
    assert "1.5 A" in reason
    waiting, _ = run(begin(), replace(MOVING, current_A=1.5), 300)
    lost, _ = run(waiting, replace(AT_REST, current_A=None), 310, from_ms=300)
    assert (lost.step, lost.current_left_A) == (StopPhase.UNKNOWN, 1.5)
    gone, _ = run(waiting, replace(AT_REST, current_A=0.0), 310, from_ms=300)
    assert (gone.step, gone.current_left_A) == (StopPhase.SAFE, None)


def test_one_sample_of_noise_after_a_proved_0_A_is_no_stuck_current_but_evaluated_before_the_end() -> None:
    stop, _ = run(begin(), replace(MOVING, current_A=0.0), 400)
    stop, actions = run(stop, replace(AT_REST, current_A=0.051), 410, from_ms=400)
    assert (stop.step, stop.current_zero, actions) == (StopPhase.STOPPING, False, [])
    stop, actions = run(stop, AT_REST, 420, from_ms=410)
    assert (stop.step, stop.current_zero, actions) == (StopPhase.SAFE, True, [])


def test_a_rod_that_moves_on_while_the_current_is_waited_for_takes_its_standstill_back() -> None:
    stop, _ = run(begin(), replace(AT_REST, current_A=None), 100)
    assert (stop.step, stop.standstill) == (StopPhase.STOPPING, True)
    stop, _ = run(stop, replace(MOVING, current_A=0.0), 110, from_ms=100)
    assert (stop.step, stop.standstill) == (StopPhase.STOPPING, False)
    _, actions = safe_stop.escalate(stop, StopKind.HALT, 110 * MS, halt=True)
    assert actions == (StopAction.HALT,)


def test_a_halt_requested_while_the_pressure_is_taken_away_does_not_give_that_its_time_again() -> None:
    stop, actions = run(begin(fade_s=0.5), replace(MOVING, current_A=0.0), 1000)
    assert StopAction.HYDRAULICS_OFF in [action for _, action in actions]
    assert stop.step is StopPhase.OFF
    after, halts = safe_stop.escalate(stop, StopKind.HALT, 1000 * MS, halt=True)
    assert (after.step, after.step_ns, halts) == (StopPhase.OFF, stop.step_ns, (StopAction.HALT,))
    assert after.kind is StopKind.PRESSURE_OFF


def test_a_frozen_position_beside_an_lvdt_that_repeats_its_value_proves_nothing() -> None:
    stop = safe_stop.after_fault(begin(StopKind.HALT), "actuator-frozen")
    ended, _ = run(stop, replace(AT_REST, lvdt_changed=False, hydraulics_low=True, hydraulics_off=True), 10_000)
    assert (ended.step, ended.standstill) == (StopPhase.UNKNOWN, False)


def test_everything_lost_ends_unknown_and_tries_to_stop_until_then() -> None:
    stop, actions = run(begin(fade_s=0.5), LOST, 10_000)
    assert stop.step is StopPhase.UNKNOWN
    assert not stop.standstill
    repeated = [action for _, action in actions if action is StopAction.FADE]
    assert len(repeated) > 5


def test_hydraulics_that_do_not_go_off_end_unknown() -> None:
    stop, _ = run(begin(StopKind.PRESSURE_OFF), AT_REST, 10_000)
    assert stop.step is StopPhase.UNKNOWN


def test_stronger_stop_replaces_a_weaker_one_and_never_the_other_way() -> None:
    kinds = [StopKind.FADE_OUT, StopKind.HALT, StopKind.PRESSURE_OFF]
    for first, second in itertools.product(kinds, kinds):
        stop, _ = safe_stop.escalate(begin(first), second, 10 * MS)
        assert stop.kind is max(first, second, key=lambda kind: kind.severity)
        assert stop.halt == (StopKind.HALT in {first, second})


def test_stop_that_ended_safe_is_taken_up_again_for_s1() -> None:
    stop, _ = run(begin(), AT_REST, 20)
    assert stop.step is StopPhase.SAFE
    stop, _ = safe_stop.escalate(stop, StopKind.PRESSURE_OFF, 30 * MS)
    stop, actions = run(stop, AT_REST, 40, from_ms=30)
    assert [action for _, action in actions] == [StopAction.HYDRAULICS_LOW]


VALUES = {
    "still_s": (None, 0.0, 5.0),
    "controller_moving": (None, True, False),
    "hydraulics_low": (None, False, True),
    "hydraulics_off": (None, False, True),
    "current_A": (None, 0.0, 1.0),
}


@pytest.mark.parametrize("kind", [StopKind.FADE_OUT, StopKind.HALT, StopKind.PRESSURE_OFF])
def test_every_constant_view_ends_and_safe_always_means_standstill_was_shown(kind: StopKind) -> None:
    for values in itertools.product(*VALUES.values()):
        given = dict(zip(VALUES, values, strict=True))
        clock_s = None if given["controller_moving"] is None else 0.0
        inputs = replace(MOVING, controller_clock_s=clock_s, **given)  # type: ignore[arg-type]  # values by name
        stop = begin(kind, fade_s=0.5)
        for ms in range(0, 12_000, 50):
            stop, _ = safe_stop.advance(stop, at(inputs, ms))
        assert stop.finished, given
        if stop.step is StopPhase.SAFE:
            assert given["still_s"] != 0.0, given
            assert given["controller_moving"] is not True, given
            assert (given["still_s"], given["controller_moving"]) != (None, None), given
            if stop.kind is StopKind.PRESSURE_OFF:
                assert given["hydraulics_off"] is True, given


def test_a_stop_that_reaches_nobody_waits_for_the_controllers_own_watchdog_before_it_is_late() -> None:
    refused = replace(MOVING, stop_taken=False)
    stop = replace(begin(fade_s=1.0), watchdog_s=0.5)
    _, done = run(stop, refused, 3000)
    late_ms = next(ms for ms, action in done if action is StopAction.STOP_IGNORED)
    assert 500 + 1000 + 200 <= late_ms <= 500 + 1000 + 400
    _, done = run(stop, MOVING, 3000)
    assert next(ms for ms, action in done if action is StopAction.STOP_IGNORED) < 1500


@pytest.mark.parametrize("kind", [StopKind.PRESSURE_OFF, StopKind.HALT])
def test_a_stop_taken_up_again_is_commanded_and_proved_anew(kind: StopKind) -> None:
    stop, _ = run(begin(), AT_REST, 400)
    assert stop.step is StopPhase.SAFE
    stop, actions = safe_stop.escalate(stop, kind, 400 * MS, halt=True)
    assert actions == (StopAction.ZERO_CURRENT, StopAction.HALT)
    moving = replace(MOVING, current_A=0.0, hydraulics_off=True, hydraulics_low=True)
    stop, _ = run(stop, moving, 700, from_ms=400)
    assert stop.step is not StopPhase.SAFE, "what was proved before is not so now"
    stop, _ = run(stop, OFF, 900, from_ms=700)
    assert (stop.step, stop.standstill) == (StopPhase.SAFE, True)


@pytest.mark.parametrize(
    ("seen", "is_broken"),
    [
        ({}, False),
        ({"controller_moving": True}, False),
        ({"still_s": 0.0}, False),
        ({"controller_moving": True, "still_s": 0.0}, True),
        ({"controller_moving": True, "still_s": None}, True),
        ({"controller_moving": None, "still_s": 0.0}, True),
        ({"controller_moving": None, "still_s": None}, False),
        ({"controller_moving": True, "still_s": 0.0, "hydraulics_low": True}, False),
        ({"left_place": True}, True),
        ({"left_place": True, "hydraulics_low": None}, True),
        ({"left_place": True, "hydraulics_low": True}, False),
    ],
    ids=str,
)
def test_a_proved_standstill_is_broken_when_nobody_who_can_see_it_says_it_rests(
    seen: dict[str, object], is_broken: bool
) -> None:
    stop, _ = run(begin(), AT_REST, 400)
    assert safe_stop.broken(stop, replace(AT_REST, **seen)) is is_broken  # type: ignore[arg-type]  # fields by name
    assert not safe_stop.broken(begin(), MOVING), "a stop under way has its own deadlines"


@pytest.mark.parametrize(("low", "is_broken"), [(None, False), (True, False), (False, True)])
def test_a_rod_that_leaves_its_place_without_pressure_is_held_by_nothing(low: bool | None, is_broken: bool) -> None:
    stop, _ = run(begin(StopKind.PRESSURE_OFF), OFF, 400)
    assert stop.step is StopPhase.SAFE
    assert safe_stop.broken(stop, replace(OFF, left_place=True, hydraulics_low=low)) is is_broken


def test_a_fade_out_longer_than_any_stop_may_take_becomes_a_halt() -> None:
    assert not begin(fade_s=safe_stop.LONGEST_FADE_S).halt
    assert begin(fade_s=safe_stop.LONGEST_FADE_S + 0.1).halt


def test_a_source_that_is_not_heard_and_keeps_its_current_leaves_the_state_unknown() -> None:
    silent = StopInputs(0, 1.0, False, 1.0, False, False, None)
    for falls_s, ends in ((0.25, StopPhase.SAFE), (None, StopPhase.UNKNOWN)):
        stop = replace(begin(fade_s=0.0), current_s=0.6, current_falls_s=falls_s)
        stop, _ = safe_stop.advance(stop, replace(silent, now_ns=int(0.55e9)))
        assert not stop.finished, "a slow source has its own time"
        stop, _ = safe_stop.advance(stop, replace(silent, now_ns=int(0.65e9)))
        assert stop.step is ends
        again, _ = safe_stop.escalate(stop, StopKind.PRESSURE_OFF, int(0.7e9))
        assert (again.current_s, again.current_falls_s) == (0.6, falls_s)


def test_a_source_that_is_not_heard_is_given_the_time_after_which_it_falls_by_itself() -> None:
    silent = StopInputs(0, 1.0, False, 1.0, False, False, None)
    stop = replace(begin(fade_s=0.0), current_s=0.25, current_falls_s=0.75)
    stop, _ = safe_stop.advance(stop, replace(silent, now_ns=int(0.7e9)))
    assert not stop.finished, "it may still drive its current"
    heard, actions = safe_stop.advance(stop, replace(silent, now_ns=int(0.7e9), current_A=1.5))
    assert StopAction.CURRENT_STUCK in actions, "heard again, it has had its time"
    assert not heard.finished
    stop, _ = safe_stop.advance(stop, replace(silent, now_ns=int(0.8e9)))
    assert stop.step is StopPhase.SAFE


def test_a_source_that_falls_by_itself_later_than_anybody_waits_for_proves_nothing() -> None:
    class Source:
        zero_within_s = 0.25

        def __init__(self, falls_within_s: float | None) -> None:
            self.falls_within_s = falls_within_s

    stops = [safe_stop.of_source(begin(), Source(falls_s)).current_falls_s for falls_s in (0.6, 5.0, 5.1, 60.0, None)]
    assert stops == [0.6, 5.0, None, None, None]

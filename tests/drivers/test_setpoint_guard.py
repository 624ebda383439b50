"""Set-points stay within reach: of the last one taken, of the rod, of speed, acceleration and travel."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.roles import Move, Program, State, Waveform
from drivers.servo_lag import ServoLag
from drivers.setpoint_generator import RodLimits, Setpoint, SetpointGenerator, halting_rate
from drivers.setpoint_guard import TURN_S, SetpointGuard

LIMITS = RodLimits(-0.085, 0.085, 0.8, 60.0)
PERIOD_S = 0.01
SINE = Program(Waveform.SINE, 0.06, 1.5, cycles=20.0)
FASTEST_M_S = 0.06 * 2.0 * math.pi * 1.5


def sine(now_s: float) -> Setpoint:
    angle = 2.0 * math.pi * 1.5 * now_s
    return Setpoint(0.06 * math.sin(angle), FASTEST_M_S * math.cos(angle))


def streamed(guard: SetpointGuard, from_s: float, until_s: float) -> list[tuple[float, Setpoint]]:
    sent, now_s = [], from_s
    while now_s < until_s:
        setpoint = guard.reachable(sine(now_s), now_s, FASTEST_M_S)
        guard.taken(setpoint, now_s)
        sent.append((now_s, setpoint))
        now_s += PERIOD_S
    return sent


def test_a_motion_within_its_limits_is_passed_on_unchanged_however_its_polls_jitter() -> None:
    guard, chance = SetpointGuard(LIMITS, PERIOD_S), random.Random(1)
    guard.begin(sine(0.0), 0.0)
    now_s = 0.0
    for _ in range(300):
        now_s += chance.uniform(0.6, 1.6) * PERIOD_S
        assert guard.reachable(sine(now_s), now_s, FASTEST_M_S) == sine(now_s)
        guard.taken(sine(now_s), now_s)


@given(st.floats(0.0, 0.67), st.floats(-0.08, 0.08), st.floats(-0.5, 0.5))
def test_from_wherever_the_rod_is_the_set_points_return_to_the_motion_without_a_step_and_within_limits(
    phase_s: float, position_m: float, velocity_m_s: float
) -> None:
    # A rod that cannot be stopped within the travel is another test's.
    left_m = LIMITS.position_max_m - math.copysign(position_m, position_m * velocity_m_s)
    if velocity_m_s**2 / (2.0 * 40.0) > left_m:
        return
    guard = SetpointGuard(LIMITS, PERIOD_S)
    guard.measured(Setpoint(position_m, velocity_m_s), phase_s, catch_up=True)
    sent = streamed(guard, phase_s + PERIOD_S, phase_s + 1.5)
    points = [(phase_s, Setpoint(position_m, velocity_m_s)), *sent]
    for (_, before), (_, after) in pairwise(points):
        assert abs(after.position_m - before.position_m - before.velocity_m_s * PERIOD_S) < 0.31 * 60.0 * PERIOD_S**2
        assert abs(after.velocity_m_s - before.velocity_m_s) <= 60.0 * PERIOD_S + 1e-9
        assert LIMITS.position_min_m <= after.position_m <= LIMITS.position_max_m
        assert abs(after.velocity_m_s) <= max(FASTEST_M_S, abs(velocity_m_s)) + 1e-9
    last_s, last = sent[-1]
    assert last == sine(last_s)
    assert not guard.catching_up


def test_a_jump_is_caught_up_with() -> None:
    guard = SetpointGuard(LIMITS, PERIOD_S)
    guard.begin(Setpoint(0.0, 0.3), 0.0)
    jumped = guard.reachable(Setpoint(0.05, 0.3), PERIOD_S, 0.3)
    assert guard.catching_up
    assert jumped.position_m == pytest.approx(0.003)


def triangle(now_s: float, period_s: float, speed_m_s: float) -> Setpoint:
    """Of 50 mm, with the mean speed of the coming period."""
    def place_m(at_s: float) -> float:
        share = at_s * speed_m_s / 0.2 % 1.0
        return 0.05 * (4.0 * abs((share + 0.75) % 1.0 - 0.5) - 1.0)

    return Setpoint(place_m(now_s), (place_m(now_s + period_s) - place_m(now_s)) / period_s)


@pytest.mark.parametrize("period_s", [0.002, 0.004, 0.007, 0.01, 0.02, 0.04])
def test_a_corner_that_a_loop_turns_within_the_acceleration_limit_is_passed_on(period_s: float) -> None:
    """0.92 of the loop's corner times the speed is the loop's acceleration: 60 m/s^2 at 0.346 m/s, at any poll."""
    guard = SetpointGuard(LIMITS, period_s)
    guard.begin(triangle(0.0, period_s, 0.345), 0.0)
    for step in range(1, round(2.0 / period_s)):
        setpoints = triangle(step * period_s, period_s, 0.345)
        assert guard.reachable(setpoints, step * period_s, 0.345) == setpoints
        guard.taken(setpoints, step * period_s)


@pytest.mark.parametrize("period_s", [0.002, 0.004, 0.007, 0.01, 0.02, 0.04])
def test_a_corner_beyond_the_acceleration_limit_is_rounded_without_a_step(period_s: float) -> None:
    guard, last = SetpointGuard(LIMITS, period_s), triangle(0.0, period_s, 0.5)
    guard.begin(last, 0.0)
    for step in range(1, round(2.0 / period_s)):
        now_s = step * period_s
        sent = guard.reachable(triangle(now_s, period_s, 0.5), now_s, 0.5)
        guard.taken(sent, now_s)
        step_m = sent.position_m - last.position_m - last.velocity_m_s * period_s
        assert abs(step_m) <= 0.05 * LIMITS.acceleration_m_s2 * period_s**2 + 1e-6
        assert abs(sent.velocity_m_s - last.velocity_m_s) <= LIMITS.acceleration_m_s2 * (TURN_S + 1e-3)
        assert abs(sent.velocity_m_s) <= 0.5 + 1e-9
        last = sent


@pytest.mark.parametrize("speed_m_s", [0.2, 0.5, 0.79])
@pytest.mark.parametrize("period_s", [0.002, 0.01, 0.02])
def test_a_motion_that_leaves_the_travel_is_braked_before_its_end(speed_m_s: float, period_s: float) -> None:
    """It was clamped there: from its speed to rest at once."""
    # One of its set-points is 0.02 mm before the end.
    begin_m = 0.08498 % (speed_m_s * period_s)
    guard, last = SetpointGuard(LIMITS, period_s), Setpoint(begin_m, speed_m_s)
    guard.begin(last, 0.0)
    for step in range(1, round(1.0 / period_s)):
        now_s = step * period_s
        sent = guard.reachable(Setpoint(begin_m + speed_m_s * now_s, speed_m_s), now_s, speed_m_s)
        guard.taken(sent, now_s)
        assert abs(sent.velocity_m_s - last.velocity_m_s) <= 60.0 * max(period_s, TURN_S) + 1e-9
        assert sent.position_m - last.position_m - last.velocity_m_s * period_s == pytest.approx(0.0, abs=1e-6)
        last = sent
    assert 0.065 < last.position_m <= 0.085


def test_without_limits_and_without_a_period_everything_is_passed_on() -> None:
    guard = SetpointGuard()
    assert guard.reachable(Setpoint(3.0, 0.0), 1.0, math.inf) == Setpoint(3.0, 0.0)


@given(st.floats(-0.084, 0.084), st.floats(-0.8, 0.8), st.sampled_from([2.0, 5.0, 20.0]))
def test_a_halt_ends_within_the_travel_whenever_the_acceleration_limit_allows_it(
    position_m: float, velocity_m_s: float, usual_m_s2: float
) -> None:
    made = SetpointGenerator(0.0, halt_deceleration_m_s2=usual_m_s2, limits=LIMITS)
    begin = Setpoint(position_m, velocity_m_s)
    made.halt_from(begin, 5.0)
    end = made.at(5.0 + 1.0)
    rate = halting_rate(begin, usual_m_s2, LIMITS)
    assert made.state is State.HOLD
    assert usual_m_s2 <= rate <= 60.0
    left_m = 0.085 - math.copysign(position_m, position_m * velocity_m_s)
    if velocity_m_s**2 / (2.0 * 60.0) <= left_m - 1e-3:
        assert abs(end.position_m) <= 0.085
    else:
        assert rate == 60.0
    if velocity_m_s**2 / (2.0 * usual_m_s2) <= left_m - 1e-3:
        assert rate == usual_m_s2


@pytest.mark.parametrize("order", [SINE, Program(Waveform.TRIANGLE, 0.05, 1.0, cycles=5.0), Move(0.05, 0.3)])
def test_what_is_ahead_is_what_comes_and_asking_changes_nothing(order: Program | Move) -> None:
    made, queried = SetpointGenerator(0.0), SetpointGenerator(0.0)
    for one in (made, queried):
        one.move(order, 0.0) if isinstance(order, Move) else one.start(order, 0.0)
    foreseen_m = None
    for step in range(700):
        now_s = step * PERIOD_S
        assert queried.at(now_s) == made.at(now_s)
        if foreseen_m is not None:
            assert queried.last.position_m == pytest.approx(foreseen_m, abs=1e-12)
        foreseen_m = queried.ahead(now_s + PERIOD_S)
    assert queried.state is made.state


def test_the_lag_of_the_servo_is_learned_and_leads_from_the_rod_to_its_set_point() -> None:
    lag = ServoLag()
    assert lag.setpoint_of(0.01, 0.5) == Setpoint(0.01, 0.5)
    lag.add(Setpoint(0.01, 0.5), math.nan)
    for step in range(200):
        now_s = step * PERIOD_S
        lag.add(sine(now_s), sine(now_s - 0.0074).position_m + random.Random(step).gauss(0.0, 2e-5))
    assert lag.lag_s == pytest.approx(0.0074, abs=2e-4)
    assert lag.setpoint_of(0.01, 0.5).position_m == pytest.approx(0.0137, abs=1e-4)

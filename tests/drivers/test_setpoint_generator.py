"""Set-points made by the host: moves, programs, fades and halts end where and when they should, without a jump."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.roles import Move, Program, ProgramPhase, State, Waveform
from drivers.setpoint_generator import Setpoint, SetpointGenerator
from protocols.errors import LocalProtocolError

SINE = Program(Waveform.SINE, 0.02, 2.0, 0.005, cycles=3.0, ramp_in_cycles=1.0, ramp_out_cycles=1.0)
STEP_S = 1e-3


def played(made: SetpointGenerator, from_s: float, until_s: float) -> list[Setpoint]:
    steps = round((until_s - from_s) / STEP_S)
    return [made.at(from_s + n * STEP_S) for n in range(steps)]


def assert_smooth(points: list[Setpoint], fastest_m_s: float) -> None:
    """No set-point is further from the last one than its speed takes it, and the speed is the position's slope."""
    for before, after in pairwise(points):
        assert abs(after.position_m - before.position_m) <= 1.02 * fastest_m_s * STEP_S + 1e-12
        mean_m_s = 0.5 * (before.velocity_m_s + after.velocity_m_s)
        assert (after.position_m - before.position_m) / STEP_S == pytest.approx(mean_m_s, abs=0.05 * fastest_m_s)


@given(st.floats(-0.08, 0.08), st.floats(-0.08, 0.08), st.floats(0.001, 0.5))
def test_a_move_ends_at_its_target_and_never_faster_than_requested(
    begin_m: float, target_m: float, speed_m_s: float
) -> None:
    made = SetpointGenerator(begin_m)
    made.move(Move(target_m, speed_m_s), 10.0)
    longest_s = abs(target_m - begin_m) / speed_m_s + 2 * speed_m_s / made.acceleration_m_s2 + 1.0
    points = [made.at(10.0 + longest_s * n / 200) for n in range(201)]
    assert made.state is State.HOLD
    assert points[-1] == Setpoint(target_m, 0.0)
    assert max(abs(point.velocity_m_s) for point in points) <= speed_m_s * (1 + 1e-9)
    low_m, high_m = min(begin_m, target_m) - 1e-9, max(begin_m, target_m) + 1e-9
    assert all(low_m <= point.position_m <= high_m for point in points)


@pytest.mark.parametrize("waveform", [Waveform.SINE, Waveform.TRIANGLE])
def test_a_program_ramps_in_runs_its_cycles_ramps_out_and_holds_at_its_centre(waveform: Waveform) -> None:
    made = SetpointGenerator(0.005)
    program = Program(waveform, 0.02, 2.0, 0.005, cycles=3.0, ramp_in_cycles=1.0, ramp_out_cycles=1.0)
    made.start(program, 5.0)
    ramp = played(made, 5.0, 5.5)
    assert made.phase is ProgramPhase.RAMP_IN
    full = played(made, 5.5, 7.0)
    assert made.phase is ProgramPhase.FULL_AMPLITUDE
    assert made.state is State.RUNNING
    assert max(point.position_m for point in full) == pytest.approx(0.025, abs=1e-6)
    rest = played(made, 7.0, 7.6)
    assert (made.state, made.phase, made.cycles_done) == (State.HOLD, ProgramPhase.IDLE, 5)
    assert rest[-1] == Setpoint(0.005, 0.0)
    if waveform is Waveform.SINE:
        assert_smooth([*ramp, *full, *rest], 0.02 * 2 * math.pi * 2.0 * 1.2)


@pytest.mark.parametrize("at_s", [0.2, 0.77, 1.3, 2.2])
def test_a_fade_takes_the_amplitude_away_without_a_jump(at_s: float) -> None:
    made = SetpointGenerator(0.005)
    made.start(SINE, 0.0)
    points = played(made, 0.0, at_s)
    made.fade(at_s)
    assert made.state is State.FADING
    points += played(made, at_s, at_s + 0.6)
    assert made.state is State.HOLD
    assert points[-1] == Setpoint(0.005, 0.0)
    assert_smooth(points, 0.02 * 2 * math.pi * 2.0 * 1.5)


@pytest.mark.parametrize("waveform", [Waveform.SINE, Waveform.TRIANGLE])
@pytest.mark.parametrize("fade_out_cycles", [1.0, 2.5])
def test_no_fade_is_faster_than_the_motion_and_a_sine_begins_it_without_a_step(
    waveform: Waveform, fade_out_cycles: float
) -> None:
    """A linear fade of a triangle over one cycle went 1.25 times as fast as the triangle."""
    program = Program(waveform, 0.02, 2.0, 0.005, cycles=9.0, ramp_in_cycles=1.0, ramp_out_cycles=1.0)
    fastest, begins, ends = 0.0, [], []
    for at_s in np.arange(1.0, 1.5, 0.01):
        made = SetpointGenerator(0.005, fade_out_cycles=fade_out_cycles)
        made.start(program, 0.0)
        begin = made.at(at_s)
        made.fade(at_s)
        points = [made.at(at_s + 0.5 * fade_out_cycles * share) for share in np.linspace(0.0, 1.0, 101)]
        fastest = max(fastest, *(abs(point.velocity_m_s) for point in points))
        begins.append(abs(points[0].velocity_m_s - begin.velocity_m_s))
        ends.append(abs(points[-2].velocity_m_s))
        assert abs(points[0].position_m - begin.position_m) < 1e-12
        assert points[-1] == pytest.approx((0.005, 0.0), abs=1e-9)
    own_m_s = {Waveform.SINE: 2.0 * math.pi, Waveform.TRIANGLE: 4.0}[waveform] * 0.04
    assert 0.97 * own_m_s < fastest <= own_m_s * (1.0 + 1e-9)
    assert max(begins) < (1e-9 if waveform is Waveform.SINE else 0.16 * own_m_s)
    assert max(ends) < 0.02 * own_m_s


def test_a_halt_stops_within_the_deceleration_and_a_second_one_changes_nothing() -> None:
    made = SetpointGenerator(0.005)
    made.start(SINE, 0.0)
    points = played(made, 0.0, 1.0)
    made.halt(1.0)
    points += played(made, 1.0, 1.006)
    made.halt(1.006)
    assert made.state is State.HALTING
    points += played(made, 1.006, 1.014)
    assert made.state is State.HOLD
    assert points[-1].velocity_m_s == 0.0
    assert_smooth(points, 0.02 * 2 * math.pi * 2.0 * 1.2)


def test_a_move_that_is_faded_halts_and_a_halt_at_rest_is_nothing() -> None:
    made = SetpointGenerator(0.0)
    made.halt(0.0)
    made.fade(0.0)
    assert made.state is State.HOLD
    made.move(Move(0.05, 0.1), 0.0)
    played(made, 0.0, 0.2)
    made.fade(0.2)
    assert made.state is State.HALTING
    assert made.at(0.3).velocity_m_s == 0.0
    assert made.state is State.HOLD
    made.rest(0.03)
    assert made.at(1.0) == Setpoint(0.03, 0.0)


@pytest.mark.parametrize(
    "order",
    [Move(math.nan, 0.1), Move(0.01, 0.0), Program(Waveform.TABLE, 0.0, 1.0), Program(Waveform.SINE, 0.01, 0.0),
     Program(Waveform.SINE, math.inf, 1.0)],
)  # fmt: skip
def test_an_order_that_makes_no_sense_begins_nothing(order: Move | Program) -> None:
    made = SetpointGenerator(0.01)
    with pytest.raises(LocalProtocolError):
        made.move(order, 0.0) if isinstance(order, Move) else made.start(order, 0.0)
    assert made.at(1.0) == Setpoint(0.01, 0.0)


def test_nothing_begins_while_something_moves() -> None:
    made = SetpointGenerator(0.005)
    made.start(SINE, 0.0)
    with pytest.raises(LocalProtocolError, match="START while RUNNING"):
        made.start(SINE, 0.1)
    with pytest.raises(LocalProtocolError, match="MOVE_TO while RUNNING"):
        made.move(Move(0.0, 0.1), 0.1)

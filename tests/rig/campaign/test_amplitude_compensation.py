"""Compensation of the commanded motion: converges where the machine can, says why where it cannot, within limits."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from rig.campaign.sequencer.event import MeasuredMotion
from rig.campaign.sequencer.point_preparation import (
    MOST_STEPS,
    commanded,
    drive_for,
    learned,
    remembered,
    trial,
    wants_trial,
    within,
)
from rig.campaign.sequencer.state import Ceiling, Drive
from rig.test_point import TestPoint

POINT = TestPoint("p001", "sine", 0.03, 2.0, 1.0)
FREE = Ceiling(low_m=-0.085, high_m=0.085, where="the specimen's stroke")
Machine = Callable[[float, float], MeasuredMotion]


def adapt(point: TestPoint, machine: Machine, ceiling: Ceiling = FREE, tolerance: float = 0.01) -> tuple[Drive, int]:
    """Let a machine run a point until its drive is settled; how many programs that took."""
    drive, programs = drive_for(point, (), ceiling), 0
    while not drive.settled:
        program = commanded(point, drive)
        assert program.amplitude_m <= ceiling.amplitude_m
        assert program.centre_m + program.amplitude_m <= ceiling.high_m + 1e-12
        assert program.centre_m - program.amplitude_m >= ceiling.low_m - 1e-12
        drive = learned(drive, point, machine(program.amplitude_m, program.centre_m), tolerance, ceiling)
        programs += 1
        assert programs <= MOST_STEPS + 1
    return drive, programs


@pytest.mark.parametrize("droop", [0.0, 0.02, 0.08, 0.3])
def test_a_droop_is_compensated_in_one_correction(droop: float) -> None:
    drive, programs = adapt(POINT, lambda command_m, centre_m: MeasuredMotion((1 - droop) * command_m, centre_m))
    assert drive.cannot == ""
    assert drive.command_m == pytest.approx(0.03 / (1 - droop))
    assert programs == (1 if droop < 0.01 else 2)


def test_a_softening_machine_is_compensated_within_three_corrections() -> None:
    drive, _ = adapt(POINT, lambda command_m, centre_m: MeasuredMotion(0.04 * math.tanh(command_m / 0.04), centre_m))
    assert drive.cannot == ""
    assert 0.04 * math.tanh(drive.command_m / 0.04) == pytest.approx(0.03, rel=0.01)
    assert drive.steps <= MOST_STEPS


def test_an_offset_of_the_mean_is_taken_out_by_the_centre() -> None:
    drive, programs = adapt(POINT, lambda command_m, centre_m: MeasuredMotion(command_m, centre_m + 0.0008))
    assert drive.shift_m == pytest.approx(-0.0008)
    assert programs == 2


def test_a_limit_of_the_bench_is_named_and_never_passed() -> None:
    ceiling = Ceiling(0.0305, "the bench's speed limit, 0.384 m/s")
    drive, _ = adapt(POINT, lambda command_m, centre_m: MeasuredMotion(0.9 * command_m, centre_m), ceiling)
    assert "beyond the bench's speed limit" in drive.cannot
    assert drive.command_m == pytest.approx(0.0305)


def test_a_shift_known_from_other_motions_never_leads_beyond_the_position_limits() -> None:
    limits = Ceiling(2.0, "speed", -0.084, 0.084, "the positions allowed")

    def sensor_zero_3_mm_off(command_m: float, centre_m: float) -> MeasuredMotion:
        return MeasuredMotion(0.99 * command_m, centre_m + 0.003)

    learned_on, _ = adapt(POINT, sensor_zero_3_mm_off, limits, tolerance=0.005)
    assert learned_on.shift_m == pytest.approx(-0.003)
    large = TestPoint("p002", "sine", 0.083, 0.5, 0.0)
    drive, programs = drive_for(large, (learned_on,), limits), 0
    while not drive.settled:
        program = commanded(large, drive)
        assert program.centre_m - program.amplitude_m >= limits.low_m - 1e-12
        drive = learned(drive, large, sensor_zero_3_mm_off(program.amplitude_m, program.centre_m), 0.005, limits)
        programs += 1
    assert "about a centre of -3 mm would be needed, beyond the positions allowed" in drive.cannot
    assert programs <= 2


def test_a_speed_limit_takes_nothing_from_the_room_for_the_centre() -> None:
    ceiling = Ceiling(0.0305, "the bench's speed limit", -0.084, 0.084, "the positions allowed")
    drive, _ = adapt(
        POINT, lambda command_m, centre_m: MeasuredMotion(0.99 * command_m, centre_m + 0.004), ceiling, 0.005
    )
    assert drive.cannot == ""
    assert drive.command_m == pytest.approx(0.03 / 0.99)
    assert drive.shift_m == pytest.approx(-0.004)


def test_a_centre_too_far_off_is_named() -> None:
    drive, programs = adapt(POINT, lambda command_m, centre_m: MeasuredMotion(command_m, centre_m + 0.008))
    assert "the centre would have to be moved by -8 mm, but only -5 mm is allowed" in drive.cannot
    assert programs == 2


def test_a_small_motion_beside_a_limit_keeps_room_to_move() -> None:
    ceiling = Ceiling(1.0, "speed", -0.084, 0.084, "the positions allowed")
    beside = TestPoint("p003", "sine", 0.002, 1.0, 0.0, centre_m=-0.082)
    drive, _ = adapt(beside, lambda command_m, centre_m: MeasuredMotion(command_m, centre_m + 0.004), ceiling)
    assert drive.cannot
    assert drive.command_m >= 0.001 - 1e-12


def test_a_saturated_valve_is_named() -> None:
    drive, _ = adapt(POINT, lambda command_m, centre_m: MeasuredMotion(min(command_m, 0.027), centre_m, True, 0.004))
    assert "valve is saturated" in drive.cannot
    assert "-10.0 %" in drive.cannot


def test_a_motion_that_does_not_follow_is_named_with_its_following_error() -> None:
    drive, _ = adapt(POINT, lambda command_m, centre_m: MeasuredMotion(min(command_m, 0.027), centre_m, False, 0.0042))
    assert "following error up to 4.2 mm" in drive.cannot


@pytest.mark.parametrize("reached", [0.027, 0.0])
def test_set_points_that_were_omitted_are_named_as_the_cause(reached: float) -> None:
    def machine(command_m: float, centre_m: float) -> MeasuredMotion:
        return MeasuredMotion(min(command_m, reached), centre_m, False, 0.0042, disturbed="7 of 50 omitted")

    drive, _ = adapt(POINT, machine)
    assert drive.cannot.count("7 of 50 omitted") == 1
    assert "following error" not in drive.cannot, "the actuator is not blamed"


def test_what_was_learned_begins_points_of_the_same_motion_at_another_current_without_a_trial() -> None:
    drive, _ = adapt(POINT, lambda command_m, centre_m: MeasuredMotion(0.92 * command_m, centre_m))
    known = remembered((), drive)
    other = TestPoint("p002", "sine", 0.03, 2.0, 0.0)
    assert drive_for(other, known, FREE) == Drive("sine", 0.03, 2.0, 0.0, drive.command_m, drive.shift_m)
    assert not wants_trial(other, known, 0.01)


def softer_with_current(point: TestPoint) -> Machine:
    """A servo of finite stiffness: the force at a current takes its own share of a small motion."""
    lost = 0.002 + 0.02 * point.current_A
    return lambda command_m, centre_m: MeasuredMotion((1.0 - lost) * command_m, centre_m)


def test_each_current_has_its_own_correction_and_none_of_them_uses_up_the_others() -> None:
    """Currents in turn, over and over: a correction for one current is wrong for the next."""
    known: tuple[Drive, ...] = ()
    programs = 0
    for current_A in (0.0, 2.0, 0.5, 1.5, 1.0, 0.0, 2.0, 1.0):
        point = TestPoint("p", "sine", 0.001, 2.0, current_A)
        while True:
            drive = drive_for(point, known, FREE)
            seen = softer_with_current(point)(commanded(point, drive).amplitude_m, 0.0)
            drive = learned(drive, point, seen, 0.01, FREE)
            known = remembered(known, drive)
            programs += 1
            assert not drive.cannot
            if drive.settled:
                break
        assert within(point, seen, 0.01)
    assert programs <= 8 + 2, "two currents had to be learned; those between them were predicted"


def test_beyond_the_currents_that_are_known_to_matter_a_trial_comes_first() -> None:
    known = tuple(Drive("sine", 0.03, 2.0, current_A, gain * 0.03, settled=True)
                  for current_A, gain in ((0.0, 1.0), (1.0, 1.02)))
    assert wants_trial(TestPoint("p", "sine", 0.03, 2.0, 2.0), known, 0.01)
    assert not wants_trial(TestPoint("p", "sine", 0.03, 2.0, 0.5), known, 0.01)
    assert drive_for(TestPoint("p", "sine", 0.03, 2.0, 0.5), known, FREE).gain == pytest.approx(1.01)
    assert drive_for(TestPoint("p", "sine", 0.03, 2.0, 2.0), known, FREE).gain == pytest.approx(1.04)
    assert drive_for(TestPoint("p", "sine", 0.03, 2.0, 9.0), known, FREE).gain == pytest.approx(1.04)


def test_a_new_motion_begins_with_the_droop_known_motions_predict_and_is_tried_first() -> None:
    machine_gain = {2.0: 0.92, 1.0: 0.979}
    known: tuple[Drive, ...] = ()
    for frequency_Hz, gain in machine_gain.items():
        point = TestPoint("p", "sine", 0.03, frequency_Hz, 0.0)
        drive, _ = adapt(point, lambda command_m, centre_m, gain=gain: MeasuredMotion(gain * command_m, centre_m))
        known = remembered(known, drive)
    new = TestPoint("p003", "sine", 0.03, 0.5, 0.0)
    assert drive_for(new, known, FREE).gain == pytest.approx(1.005, abs=0.004)
    assert wants_trial(new, known, 0.01)
    assert trial(new, drive_for(new, known, FREE)).motion_s < 0.5 * new.motion_s


def test_a_good_machine_is_never_tried() -> None:
    drive, programs = adapt(POINT, lambda command_m, centre_m: MeasuredMotion(0.998 * command_m, centre_m))
    assert programs == 1
    assert not wants_trial(TestPoint("p002", "sine", 0.03, 5.0, 0.0), remembered((), drive), 0.01)


def test_within_judges_amplitude_and_mean() -> None:
    assert within(POINT, MeasuredMotion(0.0302, 0.0002), 0.01)
    assert not within(POINT, MeasuredMotion(0.0304, 0.0), 0.01)
    assert not within(POINT, MeasuredMotion(0.03, 0.0004), 0.01)

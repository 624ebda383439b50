"""Tests are grouped by current and motion as finely as their measurement separates them, and no finer."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rig.fits.plain import plain
from rig.signals.test_set import (
    CurrentReading,
    MotionReading,
    TestSet,
    current_levels,
    motion_groups,
    names_current,
    read_current,
    rounded_levels,
    same_current,
)


def measured(*means_A: float, noise_A: float = 0.001, step_A: float = 0.0) -> list[CurrentReading | None]:
    return [CurrentReading(mean_A, noise_A, step_A) for mean_A in means_A]


def requested(*pairs: tuple[float, float], noise_A: float = 0.001) -> list[CurrentReading | None]:
    """Tests by (requested, measured) current (A)."""
    return [CurrentReading(mean_A, noise_A, requested_A=target_A) for target_A, mean_A in pairs]


@pytest.mark.parametrize("noise_A", [0.0, 0.001, 0.01])
def test_steps_of_25_mA_are_levels_where_the_noise_allows_it(noise_A: float) -> None:
    levels = current_levels(measured(0.0, 0.025, 0.05, 0.075, 0.1, 0.0251, noise_A=noise_A))
    assert levels.of_test == (0, 1, 2, 3, 4, 1)
    assert levels.names_A == (0.0, 0.025, 0.05, 0.075, 0.1)
    assert levels.zero == 0
    assert not levels.merged


def test_steps_within_the_noise_are_merged_and_reported() -> None:
    levels = current_levels(measured(0.0, 0.025, 0.05, 0.075, 0.1, noise_A=0.02))
    assert 1 < len(levels) < 5
    assert levels.merged


def test_repeats_within_their_noise_are_one_level() -> None:
    assert len(current_levels(measured(1.0, 1.004, noise_A=0.01))) == 1
    assert len(current_levels(measured(1.0, 1.1, noise_A=0.01))) == 2
    assert len(current_levels(measured(0.2, 0.21, noise_A=0.001, step_A=0.0122))) == 1, "the step of the numbers"


def test_a_chain_of_near_neighbours_is_not_one_level_without_a_word() -> None:
    fine = current_levels(measured(*(0.01 * k for k in range(11)), noise_A=0.001))
    assert len(fine) == 11
    blurred = current_levels(measured(*(0.01 * k for k in range(11)), noise_A=0.01))
    assert len(blurred) > 3
    assert len(blurred.merged) == len(blurred)
    for level in range(len(blurred)):
        members = blurred.members(level)
        assert 0.01 * (members[-1] - members[0]) <= 0.02 + 1e-9


def test_requested_currents_decide_unless_the_measurement_contradicts_them() -> None:
    noisy = current_levels(requested((0.0, 0.003), (0.01, 0.009), (0.02, 0.022), (0.01, 0.012), noise_A=0.02))
    assert noisy.of_test == (0, 1, 2, 1)
    assert noisy.names_A == (0.0, 0.01, 0.02)
    off = current_levels(requested((0.5, 0.5), (1.0, 1.0), (1.0, 0.5), (1.0, 0.98)))
    assert off.of_test == (0, 1, 0, 1), "requested 1 A, measured 0.5 A: it ran at 0.5 A"
    assert off.contradicting == (2,)
    gain = current_levels(requested((0.0, 0.0), (0.5, 0.45), (1.0, 0.9), (0.5, 0.451)))
    assert gain.of_test == (0, 1, 2, 1), "an ammeter that shows too little groups in the same way"


def test_measured_tests_join_the_level_of_requested_ones() -> None:
    levels = current_levels([*requested((0.5, 0.501), (1.0, 1.0)), *measured(0.498, 0.7)])
    assert levels.of_test == (0, 2, 0, 1)
    assert levels.names_A == (0.5, 0.7, 1.0)


def test_a_current_that_changes_has_no_level_and_one_that_is_noisy_has() -> None:
    rng = np.random.default_rng(1)
    noise = rng.normal(0.0, 0.05, 2000)
    assert read_current(np.linspace(0.0, 1.0, 2000)) is None
    reading = read_current(1.0 + noise)
    assert reading is not None
    assert (reading.mean_A, reading.scatter_A) == pytest.approx((1.0, 0.05), rel=0.05)
    assert current_levels([reading, None]).of_test == (0, None)
    unmeasured = read_current(np.full(4, np.nan), 0.3)
    assert unmeasured is not None
    assert (unmeasured.mean_A, unmeasured.requested) == (0.3, True)


def test_an_offset_without_current_is_zero_and_a_small_step_is_not() -> None:
    assert current_levels(measured(0.004, 1.0)).zero == 0
    assert current_levels(measured(0.025, 0.05)).zero is None
    assert current_levels(measured(-1.0, 0.5)).zero is None
    assert current_levels([]).zero is None


def test_the_levels_and_the_resolution_are_stated() -> None:
    assert current_levels(measured(0.0, 0.025, 0.05, noise_A=0.0015)).statement == (
        "currents 0, 25, 50 mA distinguished; resolution 3 mA"
    )
    assert current_levels(requested((0.5, 0.5), (1.0, 1.0))).statement.startswith("currents 0.5, 1 A distinguished")
    assert current_levels([None]).statement == "no test has a constant current"


def test_labels_are_as_fine_as_the_levels_need() -> None:
    assert rounded_levels((0.0, 0.4993, 1.0021)) == (0.0, 0.5, 1.0)
    assert rounded_levels((0.0, 0.025, 0.05)) == (0.0, 0.025, 0.05)
    assert rounded_levels((0.0, 0.125, 0.25)) == (0.0, 0.125, 0.25)
    assert rounded_levels((1.234,)) == (1.23,)


def test_what_a_user_calls_a_current_is_exact_where_it_was_requested() -> None:
    assert names_current(0.5, CurrentReading(0.51, 0.001))
    assert not names_current(0.5, CurrentReading(0.51, 0.001, requested_A=0.51))
    assert current_levels(requested((0.0, 0.0), (0.01, 0.01))).named(0.01) == 1
    assert current_levels(measured(0.0, 0.496, 1.0)).named(0.5) == 1
    assert current_levels(measured(0.0, 0.5, 1.0)).named(0.7) is None
    assert same_current(CurrentReading(1.0), CurrentReading(1.01))


def motion(amplitude_mm: float, frequency_Hz: float, waveform: str = "sine") -> MotionReading:
    return MotionReading(waveform, 1e-3 * amplitude_mm, frequency_Hz)


def test_measured_motions_are_grouped_by_amplitude_frequency_and_waveform() -> None:
    groups = motion_groups([
        motion(24.84, 0.2550), motion(24.81, 0.5094), motion(24.79, 0.2549), motion(4.62, 3.05),
        motion(24.84, 0.2550, "triangle"), motion(26.0, 0.2550),
    ])  # fmt: skip
    assert groups.of_test == (1, 3, 1, 0, 2, 4)
    assert len(groups.frequencies_Hz) == 3
    assert groups.frequency_Hz(0) == groups.frequency_Hz(4)
    assert groups.amplitude_m(0) == groups.amplitude_m(1), "one stroke at two frequencies"


def test_near_frequencies_that_were_each_repeated_exactly_are_two_motions() -> None:
    low, high = [0.32003, 0.32004, 0.32003], [0.32514, 0.32515, 0.32515]  # 1.6 % apart: 0.05 m/s and 2 in/s
    groups = motion_groups([motion(24.8, frequency_Hz) for frequency_Hz in (*low, *high)])
    assert groups.of_test == (0, 0, 0, 1, 1, 1)
    three = motion_groups([motion(24.8, one) for one in (1.0, 1.0001, 1.005, 1.0051, 1.012, 1.0121)])
    assert three.of_test == (0, 0, 1, 1, 2, 2)
    for scattered in ((0.320, 0.322, 0.325, 0.327), (0.320, 0.3252), (0.3200, 0.3201, 0.3205, 0.3206)):
        assert set(motion_groups([motion(24.8, one) for one in scattered]).of_test) == {0}, "a machine's own scatter"
    noisy = [MotionReading("sine", 0.0248, one, frequency_std_Hz=0.002) for one in (*low, *high)]
    assert set(motion_groups(noisy).of_test) == {0}, "the frequencies are not known so well"


@pytest.mark.parametrize(("std_share", "apart"), [(1e-5, True), (0.0, False), (1e-3, False)])
def test_near_frequencies_that_were_tested_once_are_two_motions_if_the_machine_holds_its_frequency(
    std_share: float, apart: bool
) -> None:
    """As at a single current, without repeats: 0.05 m/s and 2 in/s, 1.6 % apart."""
    read = [MotionReading("sine", 0.0248, one, frequency_std_Hz=std_share * one) for one in (0.160, 0.32003, 0.32514)]
    assert motion_groups(read).of_test == ((0, 1, 2) if apart else (0, 1, 1))


def test_requested_motions_decide_however_far_a_servo_reached() -> None:
    reached = [MotionReading("sine", amplitude, 1.0, requested=(0.05, 1.0)) for amplitude in (0.0498, 0.0471)]
    groups = motion_groups([*reached, MotionReading("sine", 0.0484, 1.0), MotionReading("sine", 0.0601, 1.0)])
    assert groups.of_test == (0, 0, 0, 1)
    assert groups.motions[0].nominal == (0.05, 1.0)
    assert MotionReading("sine", 0.005, 1.0, requested=(0.05, 1.0)).requested is None, "ten times too small"


def test_a_test_set_is_written_with_its_statement() -> None:
    summary = TestSet.of(measured(0.0, 0.5), [motion(10.0, 1.0), MotionReading("random", 0.01, math.nan)]).summary
    entry = plain(summary)
    assert entry["currents_A"] == [0.0, 0.5]
    assert entry["current_resolution_A"] == pytest.approx([0.002, 0.01])
    assert [one["frequency_Hz"] for one in entry["motions"]] == [1.0, None]

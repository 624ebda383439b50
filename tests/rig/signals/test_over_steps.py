"""What steps with every set-point, polled in step with them: the lag is not the steps', the stated error says so."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.arrays import FloatArray, TimeSeries
from rig.signals.delay_estimation.over_steps import half_window, over_steps
from rig.signals.delay_estimation.sample_match import Course, Match, match, smoothed

SETPOINT_S, SERVO_S = 0.010, 0.007
SECONDS, FINE_S = 5.0, 1e-4


def held_m(servo_s: float, setpoint_s: float) -> FloatArray:
    """Place of a rod at 2 Hz that goes after each set-point, held until the next, as a first-order servo does."""
    fine_s = np.arange(0.0, SECONDS + 0.1, FINE_S)
    requested_m = 0.010 * np.sin(2.0 * np.pi * 2.0 * setpoint_s * np.floor(fine_s / setpoint_s + 1e-6))
    place_m, decay = np.empty(len(fine_s)), np.exp(-FINE_S / servo_s)
    position_m = 0.0
    for index, target_m in enumerate(requested_m):
        place_m[index] = position_m
        position_m = target_m + (position_m - target_m) * decay
    return place_m


def damper_N(place_m: FloatArray) -> FloatArray:
    """A damper's force."""
    velocity_m_s = np.gradient(place_m, FINE_S)
    return 400.0 * np.tanh(velocity_m_s / 0.05) + 800.0 * velocity_m_s


def overlaid(
    signal: FloatArray, seed: int, late_s: float, poll_s: float, *, noise: float, step_s: float = SETPOINT_S,
    sample_s: float = 0.00400016,
) -> tuple[Match, Match]:
    """A sensor, so late, over polls that come so long after the set-points: as laid, and corrected.

    `signal` is what both see, every `FINE_S`.
    """
    fine_s, random = FINE_S * np.arange(len(signal)), np.random.default_rng(seed)
    polls_s = poll_s + step_s * np.arange(round(0.5 / step_s), round(4.5 / step_s))
    samples_s = random.uniform(0.0, sample_s) + np.arange(0.3, SECONDS - 0.3, sample_s)
    reference = TimeSeries(polls_s, np.interp(polls_s, fine_s, signal) + random.normal(0.0, 2.0 * noise, len(polls_s)))
    seen = np.interp(samples_s, fine_s, signal) + random.normal(0.0, noise, len(samples_s))
    sensor, half = TimeSeries(samples_s + late_s, seen), half_window(polls_s, sample_s)
    laid = match(reference, sensor, sample_s, reach_s=0.012, with_drift=True, course=Course(0.5, half))
    assert laid is not None
    return laid, over_steps(laid, polls_s, sensor, half)


@pytest.mark.parametrize(("poll_s", "late_s"), [(0.0002, 0.0), (0.0095, 0.002), (0.005, -0.001), (0.0025, 0.0)])
def test_whatever_steps_in_step_with_the_polls_do_the_stated_error_covers(poll_s: float, late_s: float) -> None:
    sent_N = damper_N(held_m(SERVO_S, SETPOINT_S))
    for seed in range(6):
        laid, found = overlaid(sent_N, seed, late_s, poll_s, noise=5.0)
        assert abs(found.lag_s - late_s) < 2.0 * found.lag_std_s
        assert found.lag_std_s > laid.lag_std_s


@pytest.mark.parametrize(("step_s", "sample_s"), [(0.020, 0.001), (0.010, 0.001), (0.020, 0.0020001), (0.010, 0.010)])
@pytest.mark.parametrize("servo_s", [0.002, 0.007, 0.015])
def test_a_rod_that_is_held_between_set_points_steps_too(servo_s: float, step_s: float, sample_s: float) -> None:
    """Its place stands still while the next set-point is awaited; samples as seldom as polls see one phase of that."""
    sent_m = held_m(servo_s, step_s)
    for seed, share in enumerate((0.01, 0.3, 0.6, 0.95)):
        _, found = overlaid(sent_m, seed, 0.001, share * step_s, noise=5e-6, step_s=step_s, sample_s=sample_s)
        assert abs(found.lag_s - 0.001) < 2.0 * found.lag_std_s, (share, found)


def test_what_is_narrower_than_the_window_requested_is_smoothed_away() -> None:
    """A ripple of sixteen samples on a ramp: under a window that takes it in the ramp is left, without one it stays."""
    count = np.arange(400.0)
    ramp, ripple = 2.0 * count, np.sin(2.0 * np.pi * count / 16.0)
    narrow, wide = smoothed(ramp + ripple), smoothed(ramp + ripple, 20)
    assert narrow is not None
    assert wide is not None
    assert np.nanmax(np.abs(wide - ramp)) < 0.3
    assert np.nanmax(np.abs(narrow - ramp)) > 0.9

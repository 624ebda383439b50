"""A force that steps with every set-point, polled in step with them: the lag is not the steps'."""

from __future__ import annotations

import numpy as np
import pytest

from rig.signals.arrays import FloatArray, TimeSeries
from rig.signals.delay_estimation.poll_locked import corrected
from rig.signals.delay_estimation.sample_match import Course, Match, match

SETPOINT_S, SERVO_S = 0.010, 0.007
SECONDS = 5.0


def force_N(time_s: FloatArray, *, stepped: bool) -> FloatArray:
    """A damper's force at 2 Hz; stepped, the rod goes after each set-point as a first-order servo does."""
    period_s = SETPOINT_S if stepped else 1e-4
    fine_s = np.arange(0.0, SECONDS + 0.1, 1e-4)
    requested_m = 0.010 * np.sin(2.0 * np.pi * 2.0 * period_s * np.floor(fine_s / period_s + 1e-6))
    position_m, velocity_m_s = 0.0, np.empty(len(fine_s))
    for index, target_m in enumerate(requested_m):
        velocity_m_s[index] = (target_m - position_m) / SERVO_S
        position_m += 1e-4 * velocity_m_s[index]
    return np.interp(time_s, fine_s, 400.0 * np.tanh(velocity_m_s / 0.05) + 800.0 * velocity_m_s)


def overlaid(seed: int, late_s: float, poll_s: float, share: float = 1.0) -> tuple[Match, Match]:
    """The load cell, so late, over polls that come so long after the set-points: as laid, and corrected.

    So much of the force steps.
    """

    def sent_N(time_s: FloatArray) -> FloatArray:
        return share * force_N(time_s, stepped=True) + (1.0 - share) * force_N(time_s - SETPOINT_S / 2.0, stepped=False)

    random = np.random.default_rng(seed)
    polls_s = poll_s + SETPOINT_S * np.arange(50, 450)
    samples_s = random.uniform(0.0, 0.004) + np.arange(0.3, SECONDS - 0.3, 0.00400016)
    reference = TimeSeries(polls_s, sent_N(polls_s) + random.normal(0.0, 10.0, len(polls_s)))
    force = sent_N(samples_s) + random.normal(0.0, 5.0, len(samples_s))
    sensor = TimeSeries(samples_s + late_s, force)
    laid = match(reference, sensor, 0.004, reach_s=0.008, with_drift=True, course=Course(0.5))
    assert laid is not None
    return laid, corrected(laid, polls_s, sensor)


@pytest.mark.few(2)
@pytest.mark.parametrize(("poll_s", "late_s"), [(0.0002, 0.0), (0.0095, 0.002), (0.005, -0.001), (0.0025, 0.0)])
def test_whatever_steps_in_step_with_the_polls_do_the_stated_error_covers(poll_s: float, late_s: float) -> None:
    for seed in range(6):
        laid, found = overlaid(seed, late_s, poll_s)
        assert abs(found.lag_s - late_s) < 3.0 * found.lag_std_s
        assert found.lag_std_s > laid.lag_std_s


def test_gentle_steps_are_taken_off_the_lag() -> None:
    before_s, after_s = [], []
    for seed in range(6):
        laid, found = overlaid(seed, 0.0, 0.0002, share=0.25)
        before_s.append(laid.lag_s)
        after_s.append(found.lag_s)
    assert abs(np.mean(after_s)) < 0.6 * abs(np.mean(before_s))

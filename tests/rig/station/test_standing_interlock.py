"""Sensors that stand still while the rod moves, however slowly; and coarse ones that only seem to."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rig.station.interlocks.channel_interlock import ChannelInterlock, ChannelLimits
from rig.station.interlocks.motion_interlock import Reference, StandingInterlock

RATE_HZ = 250.0
POLL_SAMPLES = 3
SAMPLES = 20
FLOOR_N = 100.0


def force_N(displacement_m: float, velocity_m_s: float, strong: float) -> float:
    return strong * (math.tanh(velocity_m_s / 1e-3) + 0.1 * displacement_m / 1e-3)


def first_stuck(
    amplitude_m: float, frequency_Hz: float, *, strong: float, resolution_N: float, noise_N: float,
    stuck_s: float = math.inf,
) -> float | None:
    """When a load cell is called stuck (s); its value stands from `stuck_s` on. The rod rests for the first second."""
    random = np.random.default_rng(3)
    channel = ChannelInterlock("load_cell", "force-limit", ChannelLimits(low=-1e5, high=1e5, span=1e5))
    interlock = StandingInterlock(SAMPLES, FLOOR_N)
    path_m, before_m, held, reference = 0.0, 0.0, math.nan, Reference(0, 0.0, 0.0)
    for number in range(int((1.0 + 4.0 / frequency_Hz) * RATE_HZ)):
        t_s = number / RATE_HZ
        phase = 2.0 * math.pi * frequency_Hz * max(0.0, t_s - 1.0)
        x_m = amplitude_m * math.sin(phase)
        v_m_s = amplitude_m * 2.0 * math.pi * frequency_Hz * math.cos(phase) if t_s > 1.0 else 0.0
        path_m, before_m = path_m + abs(x_m - before_m), x_m
        true_N = force_N(x_m, v_m_s, strong)
        if number % POLL_SAMPLES == 0:
            reference = Reference(number // POLL_SAMPLES, path_m, true_N + 10.0 * random.standard_normal())
        value_N = round((true_N + noise_N * random.standard_normal()) / resolution_N) * resolution_N
        held = value_N if t_s < stuck_s else held
        channel.check([(number, number, held, number, 1, 0)])
        step_N = channel.step if math.isfinite(channel.step) else 0.0
        if interlock.check(channel.repeats, reference, fine=channel.fine, step=step_N):
            return t_s
    return None


@pytest.mark.parametrize(("amplitude_m", "frequency_Hz"), [(0.5e-3, 0.1), (0.5e-3, 1.0), (5e-3, 0.1), (20e-3, 2.0)])
@pytest.mark.parametrize(("resolution_N", "noise_N"), [(0.05, 5.0), (1.0, 3.0)])
def test_a_fine_load_cell_that_stands_is_seen_at_any_speed_once_the_rod_has_moved(
    amplitude_m: float, frequency_Hz: float, resolution_N: float, noise_N: float
) -> None:
    well = {"strong": 50.0, "resolution_N": resolution_N, "noise_N": noise_N}
    assert first_stuck(amplitude_m, frequency_Hz, **well) is None
    stuck_s = 1.0 + 1.3 / frequency_Hz
    seen_s = first_stuck(amplitude_m, frequency_Hz, **well, stuck_s=stuck_s)
    assert seen_s is not None
    assert 0.07 <= seen_s - stuck_s <= 0.12 + 0.35 / frequency_Hz


@pytest.mark.parametrize("noise_N", [0.0, 1.0, 5.0])
@pytest.mark.parametrize("strong", [3.0, 15.0, 200.0])
@pytest.mark.parametrize("frequency_Hz", [0.2, 1.0])
def test_a_coarse_load_cell_that_is_well_is_not_stuck(strong: float, frequency_Hz: float, noise_N: float) -> None:
    assert first_stuck(10e-3, frequency_Hz, strong=strong, resolution_N=20.0, noise_N=noise_N) is None


@pytest.mark.parametrize("frequency_Hz", [0.2, 1.0])
def test_a_coarse_load_cell_that_stands_is_seen_by_the_controllers_own_force(frequency_Hz: float) -> None:
    stuck_s = 1.0 + 1.3 / frequency_Hz
    seen_s = first_stuck(10e-3, frequency_Hz, strong=200.0, resolution_N=20.0, noise_N=2.0, stuck_s=stuck_s)
    assert seen_s is not None
    assert stuck_s < seen_s < stuck_s + 1.0 / frequency_Hz


def test_a_rod_at_rest_calls_nothing_stuck() -> None:
    interlock = StandingInterlock(SAMPLES, FLOOR_N)
    found = [interlock.check(number, Reference(number, 0.0, 5.0), fine=True, step=0.0) for number in range(1000)]
    assert not any(found)


def test_an_lvdt_of_coarse_steps_stands_at_a_reversal_and_is_well() -> None:
    interlock, path_m = StandingInterlock(SAMPLES, 1e-3), 0.0
    for number in range(100):
        path_m += 1e-5
        assert not interlock.check(number, Reference(number, path_m, 1e-5 * number % 2e-4), fine=False, step=1e-4)


def is_stuck(interlock: StandingInterlock, repeats: int, polls: int, path_m: float) -> bool:
    return interlock.check(repeats, Reference(polls, path_m, 5.0), fine=True, step=0.0)


def test_samples_that_come_later_than_the_controllers_word_call_nothing_stuck() -> None:
    """A rig twenty times faster than life: what was sent at rest is read after the motion's first polls."""
    interlock = StandingInterlock(SAMPLES, FLOOR_N)
    for number in range(40):  # at rest, noise changes the value now and then, the last time just before the motion
        interlock.forget(Reference(number, 0.0, 5.0))
    assert not is_stuck(interlock, 1, 39, 0.0)
    assert not any(is_stuck(interlock, 1 + 30 * late, 39 + late, 5e-3 * late) for late in range(1, 6))


def test_a_value_that_stands_from_the_rest_on_is_seen_five_polls_after_the_motion() -> None:
    interlock = StandingInterlock(SAMPLES, FLOOR_N)
    assert not any(is_stuck(interlock, 1 + number, number, 0.0) for number in range(40))
    found = [is_stuck(interlock, 41 + late, 40 + late, 1e-3 * late) for late in range(10)]
    assert found.index(True) == 6, "in the first poll it had gone no way, in the second it had"


def test_a_value_that_followed_the_motion_and_then_stands_is_seen_at_once() -> None:
    interlock = StandingInterlock(SAMPLES, FLOOR_N)
    for number in range(10):
        interlock.forget(Reference(number, 1e-3 * number, 5.0))
    found = [is_stuck(interlock, 1 + 10 * late, 10 + late, 1e-3 * (10 + late)) for late in range(10)]
    assert found.index(True) == math.ceil((SAMPLES - 1) / 10)


def test_a_rod_that_came_to_rest_after_the_controllers_last_word_is_not_stuck() -> None:
    interlock = StandingInterlock(SAMPLES, FLOOR_N)
    for number in range(10):
        interlock.forget(Reference(number, 1e-3 * number, 5.0))
    assert not is_stuck(interlock, 1, 9, 9e-3)
    assert not any(is_stuck(interlock, 1 + 30 * late, 9 + late, 12e-3) for late in range(1, 20))

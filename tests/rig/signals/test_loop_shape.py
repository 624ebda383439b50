from __future__ import annotations

import numpy as np
import pytest

from rig.signals.loop_shape import loop_shape, noise_of, resting_travel_m, standing

RATE_Hz, FREQUENCY_Hz, CYCLES = 250.0, 1.0, 6
TIME_S = np.arange(CYCLES * RATE_Hz / FREQUENCY_Hz + 1) / RATE_Hz
PHASE = 2.0 * np.pi * FREQUENCY_Hz * TIME_S
STARTS_S = np.arange(CYCLES + 1) / FREQUENCY_Hz
NOISE_N = 5.0 * np.random.default_rng(3).standard_normal(len(TIME_S))


def damper_N(displacement_m: np.ndarray, rod_m: np.ndarray) -> np.ndarray:
    """A viscous damper with yield force on `displacement_m`; nothing where it stands while the rod moves on."""
    speed_m_s = np.gradient(displacement_m, 1.0 / RATE_Hz)
    return np.where(np.abs(speed_m_s) < 1e-9, 0.0, 900.0 * speed_m_s + 240.0 * np.tanh(50.0 * speed_m_s))


def with_play(rod_m: np.ndarray, play_m: float) -> np.ndarray:
    """The damper's end behind a joint with free play."""
    end_m = np.empty_like(rod_m)
    end_m[0] = rod_m[0]
    for k in range(1, len(rod_m)):
        end_m[k] = np.clip(end_m[k - 1], rod_m[k] - play_m / 2, rod_m[k] + play_m / 2)
    return end_m


@pytest.mark.parametrize("play_m", [1e-3, 3e-3])
def test_a_loose_joint_shows_as_rest_of_the_force_at_zero(play_m: float) -> None:
    rod_m = 0.03 * np.sin(PHASE)
    force_N = damper_N(with_play(rod_m, play_m), rod_m) + NOISE_N
    shape = loop_shape(TIME_S, rod_m, force_N, STARTS_S)
    assert shape is not None
    assert 0.5 * play_m < shape.free_play_m < 2.0 * play_m + 0.5e-3


def test_a_tight_joint_shows_none() -> None:
    rod_m = 0.03 * np.sin(PHASE)
    shape = loop_shape(TIME_S, rod_m, damper_N(rod_m, rod_m) + NOISE_N, STARTS_S)
    assert shape is not None
    assert shape.free_play_m == 0.0
    assert shape.scatter_N < 2.0
    assert abs(shape.change_N) < 0.01 * shape.span_N


@pytest.mark.parametrize("plateau_N", [60.0, 80.0])
def test_play_is_seen_where_the_force_stands_at_a_low_plateau_behind_it(plateau_N: float) -> None:
    # After each reversal: 30 of 400 phases at zero, then the friction of the joint, then the damper's force.
    phases = np.arange(400)
    half = np.where(phases[:200] < 30, 0.0, np.where(phases[:200] < 110, plateau_N, 450.0))
    force_N = np.concatenate((-half, half))
    move_m = 0.02 * np.cos(2.0 * np.pi * phases / 400)
    random = np.random.default_rng(3)
    seen = [
        resting_travel_m(force_N + 4.5 * random.standard_normal((2, 400)), np.stack((move_m, move_m)), 4.5)
        for _ in range(40)
    ]
    assert np.mean([play_m is not None and 0.5e-3 < play_m < 4e-3 for play_m in seen]) > 0.8


def test_a_specimen_that_weakens_changes_and_one_that_wobbles_scatters() -> None:
    rod_m = 0.03 * np.sin(PHASE)
    clean_N = damper_N(rod_m, rod_m)
    weakening = loop_shape(TIME_S, rod_m, clean_N * (1.0 - 0.03 * TIME_S) + NOISE_N, STARTS_S)
    assert weakening is not None
    assert weakening.change_N / weakening.span_N == pytest.approx(-0.12, abs=0.03)
    factor = np.repeat([1.0, 0.8, 1.1, 0.9, 1.2, 1.0], int(RATE_Hz))
    wobbling = loop_shape(TIME_S[:-1], rod_m[:-1], clean_N[:-1] * factor + NOISE_N[:-1], STARTS_S)
    assert wobbling is not None
    assert wobbling.scatter_N > 0.04 * wobbling.span_N


@pytest.mark.parametrize("late", [0.0, 0.5])
@pytest.mark.parametrize(("amplitude_m", "cycles"), [(1e-3, 3), (3e-3, 3), (3e-3, 10)])
def test_noise_alone_makes_no_specimen_scatter_or_change(amplitude_m: float, cycles: int, late: float) -> None:
    random = np.random.default_rng(7)
    time_s = np.arange(int(cycles * RATE_Hz) + 1) / RATE_Hz
    force_s = time_s + late / RATE_Hz
    for _ in range(40):
        sampled_N = 900.0 * 2.0 * np.pi * amplitude_m * np.cos(2.0 * np.pi * force_s)
        sampled_N = sampled_N + 5.0 * random.standard_normal(len(time_s))
        rod_m = amplitude_m * np.sin(2.0 * np.pi * time_s)
        shape = loop_shape(time_s, rod_m, np.interp(time_s, force_s, sampled_N), np.arange(cycles + 1.0))
        assert shape is not None
        assert shape.scatter_N == 0.0
        assert abs(shape.change_N) < 4.0 * shape.change_std_N


def test_scatter_below_the_noise_is_found_in_many_samples() -> None:
    rod_m = 0.01 * np.sin(PHASE)
    factor = np.repeat([1.0, 0.8, 1.1, 0.9, 1.2, 1.0], int(RATE_Hz))
    force_N = 56.0 * np.cos(PHASE[:-1]) * factor + NOISE_N[:-1]
    shape = loop_shape(TIME_S[:-1], rod_m[:-1], force_N, STARTS_S)
    assert shape is not None
    assert 3.0 < shape.scatter_N < 9.0
    assert abs(shape.change_N) > 4.0 * shape.change_std_N


def test_two_cycles_say_nothing_about_scatter() -> None:
    assert loop_shape(TIME_S, np.sin(PHASE), np.cos(PHASE), STARTS_S[:3]) is None


def test_the_noise_of_a_smooth_signal_is_distinguished_from_its_neighbours() -> None:
    assert noise_of(500.0 * np.sin(PHASE) + NOISE_N) == pytest.approx(5.0, rel=0.1)


def test_an_amplifier_at_its_end_and_a_stuck_value_are_distinguished() -> None:
    moving = 500.0 * np.sin(PHASE) + NOISE_N
    clipped = standing(np.minimum(moving, 450.0))
    assert clipped.at_extreme > 20
    assert clipped.ends
    stuck = moving.copy()
    stuck[300:360] = stuck[300]
    assert standing(stuck).longest == 60
    assert standing(stuck).at_extreme < 5
    assert not standing(stuck).ends
    assert standing(np.round(3.0 * np.sin(PHASE))).at_extreme == 0


def coarse_force(step_N: float, noise_N: float, frequency_Hz: float = 1.0) -> np.ndarray:
    """Four cycles at 250 Hz of a force that rises quickly and stays, rounded to a step (n,)."""
    time_s = np.arange(0.0, 4.0 / frequency_Hz, 0.004)
    force_N = 300.0 * np.tanh(8.0 * np.cos(2.0 * np.pi * frequency_Hz * time_s))
    force_N += noise_N * np.random.default_rng(5).standard_normal(len(time_s))
    return np.round(force_N / step_N) * step_N


@pytest.mark.parametrize(("step_N", "noise_N", "frequency_Hz"), [(20.0, 5.0, 1.0), (20.0, 1.0, 0.5), (50.0, 5.0, 1.0)])
def test_a_coarse_resolution_is_neither_stuck_nor_saturated(step_N: float, noise_N: float, frequency_Hz: float) -> None:
    found = standing(coarse_force(step_N, noise_N, frequency_Hz))
    assert found.coarse
    assert found.at_extreme == 0
    assert found.step == pytest.approx(step_N)
    assert found.longest < 0.75 * 250.0 / frequency_Hz


def test_a_sensor_that_sticks_or_clips_is_not_taken_for_a_coarse_one() -> None:
    fine = coarse_force(0.05, 5.0)
    stuck, clipped, coarse = fine.copy(), np.clip(fine, -250.0, 250.0), coarse_force(20.0, 5.0)
    stuck[300:400] = stuck[300]
    coarse[300:600] = coarse[300]
    assert (standing(stuck).longest, standing(stuck).coarse) == (100, False)
    assert not standing(clipped).coarse
    assert standing(clipped).at_extreme > 20
    assert standing(coarse).longest >= 300

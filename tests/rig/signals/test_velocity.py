from __future__ import annotations

import numpy as np
import pytest

from rig.signals.derivatives import HALF_WIDTH, velocity_of
from rig.signals.interpolation import cubic_at, flags_at, linear_at, monotone_at

TIME_S = np.arange(500) / 250.0


def test_velocity_of_a_sine_has_its_amplitude_and_no_phase() -> None:
    displacement = 0.05 * np.sin(2 * np.pi * 2.0 * TIME_S)
    velocity, _ = velocity_of(TIME_S, displacement)
    inner = slice(HALF_WIDTH, -HALF_WIDTH)
    expected = 0.2 * np.pi * np.cos(2 * np.pi * 2.0 * TIME_S)
    assert np.max(np.abs(velocity[inner] - expected[inner])) < 0.01 * 0.2 * np.pi
    phase = np.angle(np.sum((velocity * np.exp(-2j * np.pi * 2.0 * TIME_S))[125:375]))
    assert phase == pytest.approx(0.0, abs=1e-3)


def test_velocity_is_missing_where_displacement_is_and_nowhere_else() -> None:
    time_s = np.delete(TIME_S, [200, 201, 204, 300, 302, 305])
    displacement = 0.05 * np.sin(2 * np.pi * time_s)
    displacement[[0, 1, 3, 400, 402, 410]] = np.nan
    velocity, _ = velocity_of(time_s, displacement)
    assert np.array_equal(np.isnan(velocity), np.isnan(displacement))
    expected = 0.1 * np.pi * np.cos(2 * np.pi * time_s)
    assert np.nanmax(np.abs(velocity - expected)) < 0.03 * 0.1 * np.pi


@pytest.mark.parametrize("spread", [0.02, 0.1, 0.2])
def test_velocity_is_that_at_the_samples_own_times_when_these_are_not_even(spread: float) -> None:
    random = np.random.default_rng(4)
    time_s = np.sort(TIME_S + spread / 250.0 * random.standard_normal(len(TIME_S)))
    whole_ms = np.round(np.arange(0.0, 2.0, 0.0025) * 1e3) / 1e3  # 400 Hz in whole milliseconds
    for times_s in (time_s, whole_ms):
        velocity, _ = velocity_of(times_s, 0.05 * np.sin(2 * np.pi * times_s))
        expected = 0.1 * np.pi * np.cos(2 * np.pi * times_s)
        assert np.max(np.abs(velocity - expected)) < 0.01 * 0.1 * np.pi


@pytest.mark.parametrize("count", [0, 1, 2, 3, 5, 8, 9, 10])
def test_velocity_of_a_few_samples_is_their_slope(count: int) -> None:
    velocity, _ = velocity_of(TIME_S[:count], 0.1 * TIME_S[:count])
    assert np.isnan(velocity).all() if count < 2 else velocity == pytest.approx(0.1)


def test_a_cubic_is_given_back_exactly_and_nothing_outside() -> None:
    values = TIME_S**3 - TIME_S
    query_s = np.array([-0.1, 0.001, 0.5013, 1.0, 1.9970, 3.0])
    found = cubic_at(query_s, TIME_S, values, 0.004)
    assert np.isnan(found[[0, 1, 4, 5]]).all()
    assert found[2:4] == pytest.approx(query_s[2:4] ** 3 - query_s[2:4], abs=1e-9)


@pytest.mark.parametrize("interpolate", [cubic_at, linear_at, monotone_at])
def test_nothing_is_drawn_across_a_lost_sample(interpolate: object) -> None:
    time_s = np.delete(TIME_S, 100)
    found = interpolate(TIME_S + 0.002, time_s, np.ones(499), 0.004)  # type: ignore[operator]  # one of two functions
    assert np.isnan(found[99:101]).all()
    assert np.isfinite(found[110:480]).all()


@pytest.mark.parametrize("seed", range(5))
def test_a_resampled_value_never_leaves_the_range_of_its_two_neighbours(seed: int) -> None:
    random = np.random.default_rng(seed)
    time_s = TIME_S + 1e-5 * random.uniform(-1.0, 1.0, len(TIME_S))
    values = 500.0 * np.abs((5.0 * time_s) % 2.0 - 1.0) * np.sign(np.sin(31.0 * time_s))
    query_s = np.sort(random.uniform(0.01, 1.98, 4000))
    found = monotone_at(query_s, time_s, values, 0.004)
    right = np.searchsorted(time_s, query_s, side="right")
    low, high = (choose(values[right - 1], values[right]) for choose in (np.minimum, np.maximum))
    assert np.all((found >= low) & (found <= high))
    overshooting = cubic_at(query_s, time_s, values, 0.004)
    assert np.any((overshooting < low) | (overshooting > high)), "what a cubic does there"


def test_a_resampled_sine_misses_little_of_its_amplitude() -> None:
    query_s = np.linspace(0.01, 1.98, 3000)
    found = monotone_at(query_s, TIME_S, np.sin(4 * np.pi * TIME_S), 0.004)
    assert np.max(np.abs(found - np.sin(4 * np.pi * query_s))) < 5.0 / 125.0**2


def test_flags_of_both_neighbours_are_joined() -> None:
    flags = np.zeros(500, np.int8)
    flags[10], flags[11] = 1, 4
    assert flags_at(TIME_S[9:12] + 0.001, TIME_S, flags).tolist() == [1, 5, 4]

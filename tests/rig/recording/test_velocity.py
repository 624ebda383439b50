from __future__ import annotations

import numpy as np
import pytest

from rig.recording.interpolation import cubic_at, flags_at, linear_at
from rig.recording.velocity import HALF_WIDTH, velocity_of

TIME_S = np.arange(500) / 250.0


def test_velocity_of_a_sine_has_its_amplitude_and_no_phase() -> None:
    displacement = 0.05 * np.sin(2 * np.pi * 2.0 * TIME_S)
    velocity, _ = velocity_of(TIME_S, displacement)
    inner = slice(HALF_WIDTH, -HALF_WIDTH)
    wanted = 0.2 * np.pi * np.cos(2 * np.pi * 2.0 * TIME_S)
    assert np.max(np.abs(velocity[inner] - wanted[inner])) < 0.01 * 0.2 * np.pi
    phase = np.angle(np.sum((velocity * np.exp(-2j * np.pi * 2.0 * TIME_S))[125:375]))
    assert phase == pytest.approx(0.0, abs=1e-3)


def test_velocity_is_missing_at_ends_gaps_and_missing_values() -> None:
    time_s = np.delete(TIME_S, [200, 201])
    displacement = 0.1 * time_s
    displacement[400] = np.nan
    velocity, _ = velocity_of(time_s, displacement)
    missing = np.flatnonzero(np.isnan(velocity))
    expected = {*range(HALF_WIDTH), *range(200 - HALF_WIDTH, 200 + HALF_WIDTH),
                *range(400 - HALF_WIDTH, 401 + HALF_WIDTH), *range(498 - HALF_WIDTH, 498)}
    assert set(missing.tolist()) == expected
    assert np.nanmax(np.abs(velocity - 0.1)) < 1e-9


def test_a_cubic_is_given_back_exactly_and_nothing_outside() -> None:
    values = TIME_S**3 - TIME_S
    wanted_s = np.array([-0.1, 0.001, 0.5013, 1.0, 1.9970, 3.0])
    found = cubic_at(wanted_s, TIME_S, values, 0.004)
    assert np.isnan(found[[0, 1, 4, 5]]).all()
    assert found[2:4] == pytest.approx(wanted_s[2:4] ** 3 - wanted_s[2:4], abs=1e-9)


@pytest.mark.parametrize("interpolate", [cubic_at, linear_at])
def test_nothing_is_drawn_across_a_lost_sample(interpolate: object) -> None:
    time_s = np.delete(TIME_S, 100)
    found = interpolate(TIME_S + 0.002, time_s, np.ones(499), 0.004)  # type: ignore[operator]  # one of two functions
    assert np.isnan(found[99:101]).all()
    assert np.isfinite(found[110:480]).all()


def test_flags_of_both_neighbours_are_joined() -> None:
    flags = np.zeros(500, np.int8)
    flags[10], flags[11] = 1, 4
    assert flags_at(TIME_S[9:12] + 0.001, TIME_S, flags).tolist() == [1, 5, 4]

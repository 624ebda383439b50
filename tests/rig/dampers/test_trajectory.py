"""Force and states along a motion from a known start, and the current that gives a force, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from rig.dampers import model
from rig.dampers.kernel import force_series
from rig.dampers.trajectory import _for_any_layout, amplified, inverse_of, rates_N_s, smoothed_rate, trajectory_of

DAMPER = model("asymmetric")
VALUES = {
    "m": 0.0, "F0": -270.0, "beta": 1e4, "delta": 0.0, "Fya": 60.0, "Fyb": 238.0, "Ca_plus": 700.0, "Ca_minus": 700.0,
    "Cb_plus": 110.0, "Cb_minus": 110.0, "Ka": 0.0, "Kb": 0.0, "eta": 25.0,
}  # fmt: skip
"""A Bingham damper: the hyperbolic tangent is a step. Other tests compile this model's loops too."""
P = DAMPER.vector(VALUES)[None, :]
GRID = np.linspace(0.0, 2.0, 5)
STILL = np.zeros((1, 1))


def answer(speeds: list[float], targets: list[float]) -> np.ndarray:
    v = np.array(speeds)
    none = np.zeros_like(v)
    return np.asarray(inverse_of(DAMPER)(P, GRID, GRID, STILL, none, v, none, np.array(targets), none, 0.0))


def test_the_force_along_a_motion_is_the_models() -> None:
    v, current, none = np.array([0.1, -0.2]), np.array([1.0, 0.0]), np.zeros(2)
    force, _ = trajectory_of(DAMPER)(P, STILL[0], none, v, none, current, 1e-3)
    assert force == pytest.approx([298.0 + 81.0 - 270.0, -60.0 - 140.0 - 270.0])
    later = np.vstack((P, DAMPER.vector({**VALUES, "F0": 0.0})))  # parameters change from sample to sample
    force, _ = trajectory_of(DAMPER)(later, STILL[0], none, v, none, current, 1e-3)
    assert force == pytest.approx([109.0, -200.0])


def test_the_current_that_gives_a_force_and_what_it_is_worth() -> None:
    # at 0.1 m/s: F = 60 + 70 - 270 + (238 + 11) I
    rows = answer([0.1, 0.1, 0.1], [109.0, -140.0 + 249.0 * 0.7, 358.0])
    assert rows[:, 0] == pytest.approx([1.0, 0.7, 2.0])
    assert rows[:, 1] == pytest.approx([109.0, 34.3, 358.0])
    assert rows[:, 2] == pytest.approx([249.0] * 3)
    assert list(rows[:, 3]) == [1.0, 1.0, 1.0]


def test_a_force_out_of_reach_gets_the_current_whose_force_is_nearest() -> None:
    # at 0.1 m/s currents give -140 to 358 N; at -0.1 m/s -400 to -898 N
    rows = answer([0.1, 0.1, -0.1], [5000.0, -200.0, 0.0])
    assert list(rows[:, 3]) == [0.0, 0.0, 0.0]
    assert rows[:, 0] == pytest.approx([2.0, 0.0, 0.0])
    assert rows[:, 1] == pytest.approx([358.0, -140.0, -400.0])
    assert rows[:, 4] == pytest.approx([-140.0, -140.0, -898.0])
    assert rows[:, 5] == pytest.approx([358.0, 358.0, -400.0])


def test_the_rate_of_a_force_lags_nothing_where_what_comes_after_is_known() -> None:
    t = np.arange(0.0, 0.5, 1e-3)
    rate = rates_N_s(200.0 * np.sin(30.0 * t), 1e-3)  # its true rate: 6000 cos(30 t) N/s
    inside = slice(20, -20)
    assert rate[inside] == pytest.approx(6000.0 * np.cos(30.0 * t[inside]), abs=0.003 * 6000.0)
    assert list(rates_N_s(np.array([1.0, 5.0]), 0.0)) == [0.0, 0.0]  # without a time nobody knows
    assert rates_N_s(np.array([1.0, 5.0]), 0.5) == pytest.approx([8.0, 8.0])


def test_white_noise_of_a_force_is_amplified_by_its_rate_as_a_simulation_shows() -> None:
    noise, one = np.random.default_rng(0).normal(0.0, 1.0, 200_000), np.ones(1)
    for dt_s in (1e-4, 1e-3, 4e-3):
        both = noise + 2e-3 * rates_N_s(noise, dt_s)
        assert amplified(one, 2e-3 * one, dt_s, causal=False)[0] == pytest.approx(float(np.std(both)), rel=0.01)
        now = [0.0]
        for change in np.diff(noise[:50_000]).tolist():
            now.append(smoothed_rate(now[-1], change, dt_s))
        both = noise[:50_000] + 2e-3 * np.array(now)
        assert amplified(one, 2e-3 * one, dt_s, causal=True)[0] == pytest.approx(float(np.std(both)), rel=0.02)
    assert amplified(-one, one, 0.0, causal=False)[0] == 1.0


@pytest.mark.nightly
def test_states_follow_the_motion_and_the_currents_that_are_found() -> None:
    damper, dt_s = model("normalized_bouc_wen"), 1e-3
    p = damper.vector(damper.demonstration)
    time_s = np.arange(400) * dt_s
    u, v = 0.01 * np.sin(12.0 * time_s), 0.12 * np.cos(12.0 * time_s)
    a, one = -1.44 * np.sin(12.0 * time_s), np.ones(time_s.size)
    start = damper.initial_state()
    force, states = trajectory_of(damper)(p[None, :], start, u, v, a, one, dt_s)
    assert force == pytest.approx(force_series(damper, p, start, u, v, a, one, dt_s, 0), rel=1e-3, abs=1.0)
    assert states[0, 0] == 0.0  # from rest
    assert states[100, 0] == pytest.approx(1.0, abs=1e-3)  # yielded: 9.3 mm of travel, rho = 1500 1/m
    assert np.max(np.abs(states)) <= 1.0
    found = inverse_of(damper)(p[None, :], GRID, GRID, start[None, :], u, v, a, force, np.zeros_like(force), dt_s)
    clear = np.abs(found[:, 2]) > 20.0  # N/A: around a reversal of the loop the current has no say
    assert np.count_nonzero(clear) > 300
    assert found[clear, 0] == pytest.approx(one[clear], abs=1e-3)
    assert found[:, 6] == pytest.approx(1.0)  # the force follows at once: an error of it is the current's alone
    assert found[:, 8] == pytest.approx(states[:, 0], abs=1e-6)


def test_a_force_that_is_no_number_leaves_no_least_and_no_greatest_one() -> None:
    grid, none = np.array([0.0, np.nan, 1.0]), np.zeros(1)
    rows = inverse_of(DAMPER)(P, grid, grid, STILL, none, none + 0.1, none, none + 109.0, none, 0.0)
    assert np.isnan(rows[0, 4:6]).all()


def test_a_loop_is_compiled_once_whatever_the_layout_of_its_arrays() -> None:
    """Numba compiles it again for read-only arrays, such as columns of a data frame, and for strided ones."""
    read_only, strided, plain = np.zeros(3), np.arange(6.0)[::2], np.ones(3)
    read_only.flags.writeable = False
    taken: list[np.ndarray] = []
    _for_any_layout(lambda *given: taken.extend(given))(read_only, strided, plain)
    assert all(array.flags.writeable and array.flags.c_contiguous for array in taken)
    assert [list(array) for array in taken] == [[0.0, 0.0, 0.0], [0.0, 2.0, 4.0], [1.0, 1.0, 1.0]]
    assert taken[2] is plain, "not copied"

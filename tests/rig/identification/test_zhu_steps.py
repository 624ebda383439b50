"""Zhu's three steps on one loop: each step by itself, and the whole."""

from __future__ import annotations

import numpy as np
import pytest

from rig.dampers import model
from rig.errors import IdentificationFailed
from rig.identification.models.three_steps import (
    identify,
    integrated_w,
    saturated_branch,
    slope_at_zero,
    travel_since_reversal,
)


def loop(sigma: float, n: float, noise_N: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    interval_s, amplitude_m, omega = 1e-3, 0.02, 2.0 * np.pi
    t = np.arange(4000) * interval_s
    u, v = amplitude_m * np.sin(omega * t), amplitude_m * omega * np.cos(omega * t)
    values = {"kx": 900.0, "kv": 700.0, "kv_b": 0.0, "kw": 400.0, "kw_b": 0.0, "f0": -30.0, "rho": 800.0}
    values |= {"sigma": sigma, "n": n}
    force = model("normalized_bouc_wen").force(values, u, v, -(omega**2) * u, 0.0, interval_s)
    return u[1000:], v[1000:], force[1000:] + np.random.default_rng(1).normal(0.0, noise_N, 3000)


@pytest.mark.parametrize(("sigma", "n"), [(0.6, 1.3), (0.9, 2.0), (1.5, 1.6)])
def test_three_steps_find_a_normalised_bouc_wen_loop(sigma: float, n: float) -> None:
    fit = identify(*loop(sigma, n, noise_N=1.0))
    found = [fit.kx, fit.kv, fit.kw, fit.f0, fit.rho, fit.sigma, fit.n]
    assert found == pytest.approx([900.0, 700.0, 400.0, -30.0, 800.0, sigma, n], rel=0.08)


def test_the_hysteretic_variable_integrates_to_saturation_on_its_branch() -> None:
    u = np.linspace(-0.02, 0.02, 400)
    w = integrated_w(u, -1.0, 500.0, 0.8, 2.0)
    assert w[-1] == pytest.approx(1.0, abs=1e-3)
    assert np.all(np.diff(w) >= -1e-12)
    linear = integrated_w(np.array([0.0, 1e-6]), 0.0, 500.0, 0.8, 2.0)
    assert linear[1] == pytest.approx(500.0 * 1e-6, rel=1e-6)  # slope rho at w = 0


def test_step_1_is_a_plane_with_a_step_through_the_saturated_samples() -> None:
    v = np.repeat([1.0, -1.0, 2.0, -2.0], 10)
    u = np.linspace(-0.01, 0.01, 40)
    force = 900.0 * u + 700.0 * v + 400.0 * np.sign(v) - 30.0
    found = saturated_branch(u, v, force, np.ones(40, dtype=bool))
    assert found == pytest.approx((900.0, 700.0, 400.0, -30.0))


def test_step_2_is_the_slope_where_the_hysteretic_variable_crosses_zero() -> None:
    u = np.linspace(-0.002, 0.002, 41)
    w = 500.0 * u + 3.0e4 * u**2  # slope 500 at w = 0, 545 or 455 at |w| = 0.3
    assert slope_at_zero(u, np.ones(41), w) == pytest.approx(500.0, rel=1e-6)
    back = slope_at_zero(-u, -np.ones(41), -w)  # the way back has the same slope
    assert back == pytest.approx(500.0, rel=1e-6)


@pytest.mark.parametrize(("sigma", "n"), [(0.8, 2.0), (1.5, 1.0)])
def test_step_3_integrates_the_normalised_equation(sigma: float, n: float) -> None:
    # loading from w = 0: dw/du = rho (1 - w^n), so w = tanh(rho u) for n = 2 and 1 - exp(-rho u) for n = 1
    u = np.linspace(0.0, 0.004, 4001)
    exact = np.tanh(500.0 * u) if n == 2.0 else 1.0 - np.exp(-500.0 * u)
    assert np.allclose(integrated_w(u, 0.0, 500.0, sigma, n), exact, atol=1e-6)
    # unloading from w = 1: dw/du = rho (1 - (1 - 2 sigma) w^n) for v < 0 < w
    down = integrated_w(1.0 - np.linspace(0.0, 1e-6, 2), 1.0, 500.0, sigma, n)
    assert (down[1] - down[0]) / -1e-6 == pytest.approx(500.0 * 2.0 * sigma, rel=1e-3)


def test_travel_counts_from_the_last_reversal() -> None:
    u = np.array([0.0, 1.0, 2.0, 1.5, 1.0, 1.25])
    v = np.array([1.0, 1.0, 1.0, -1.0, -1.0, 1.0])
    assert travel_since_reversal(u, v).tolist() == [0.0, 0.0, 0.0, 0.0, 0.5, 0.0]


def test_a_loop_that_never_saturates_is_refused_with_what_would_help() -> None:
    u, v, force = loop(0.8, 2.0, 0.0)
    part = slice(0, 30)
    with pytest.raises(IdentificationFailed, match="record a larger amplitude or more cycles"):
        identify(u[part], v[part], force[part])

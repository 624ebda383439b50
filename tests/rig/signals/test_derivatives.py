"""Velocity and acceleration from noisy displacement, against the motion that made it."""

import numpy as np
import pytest

from rig.signals.derivatives import NotDifferentiable, harmonic, is_white, savitzky_golay

NOISE_M = 5e-6


def sampled_sine(jitter_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(3)
    t = np.arange(0.0, 8.0, 0.004) + rng.uniform(0.0, jitter_s, 2000)
    return t, 0.003 + 0.05 * np.sin(2.0 * np.pi * 1.01 * t + 0.4) + rng.normal(0.0, NOISE_M, t.size)


@pytest.mark.parametrize("jitter_s", [0.0, 1e-3])
def test_harmonic_fit_averages_the_noise_away(jitter_s: float) -> None:
    t, u = sampled_sine(jitter_s)
    fit = harmonic(t, u, 1.0)
    assert fit.frequency_Hz == pytest.approx(1.01, abs=1e-6)
    assert fit.residual_m == pytest.approx(NOISE_M, rel=0.05)
    assert fit.white
    assert fit.repeats
    omega = 2.0 * np.pi * 1.01
    _, v, a = fit.at(t + 0.0013)
    phase = omega * (t + 0.0013) + 0.4
    assert np.max(np.abs(v - 0.05 * omega * np.cos(phase))) < 1e-5
    assert np.max(np.abs(a + 0.05 * omega**2 * np.sin(phase))) < 1e-4


def test_harmonic_fit_follows_the_rounded_corners_of_a_triangle() -> None:
    t = np.arange(0.0, 8.0, 0.004)
    orders = np.arange(1, 60, 2)
    signs = (-1.0) ** np.arange(orders.size)
    rounded = signs * 8.0 / np.pi**2 / orders**2 / (1.0 + (orders / 30.0) ** 4)
    phases = 2.0 * np.pi * np.outer(t, orders)
    u, v = np.sin(phases) @ rounded * 0.05, np.cos(phases) @ (rounded * 2.0 * np.pi * orders) * 0.05
    fit = harmonic(t, u + np.random.default_rng(4).normal(0.0, NOISE_M, t.size), 1.0)
    assert fit.white
    assert np.max(np.abs(fit.at(t)[1] - v)) < 1e-3


def cornered(rate_Hz: float = 250.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A triangle of 50 mm at 1 Hz rounded at 30 Hz: times (s), displacement (m) with noise, velocity (m/s)."""
    t = np.arange(0.0013, 8.0, 1.0 / rate_Hz)
    orders = np.arange(1, 2001, 2)
    rounded = (-1.0) ** np.arange(orders.size) * 8.0 / np.pi**2 / orders**2 / (1.0 + (orders / 30.0) ** 2)
    phases = 2.0 * np.pi * np.outer(t, orders)
    u, v = np.sin(phases) @ rounded * 0.05, np.cos(phases) @ (rounded * 2.0 * np.pi * orders) * 0.05
    return t, u + np.random.default_rng(4).normal(0.0, NOISE_M, t.size), v


def test_what_the_samples_do_not_show_of_a_corner_is_forereported_by_size_and_place() -> None:
    t, u, v = cornered()
    fit = harmonic(t, u, 1.0)
    unseen = fit.unseen_at(t)
    assert unseen is not None
    missed = np.abs(v - fit.at(t)[1])
    assert 0.4 * missed.max() < np.abs(unseen[0]).max() < 3.0 * missed.max()
    at_corners = np.abs(v) < 0.8 * np.abs(v).max()
    assert np.abs(unseen[0][at_corners]).mean() > 3.0 * np.abs(unseen[0][~at_corners]).mean()


def test_a_sine_hides_nothing() -> None:
    fit = harmonic(*sampled_sine(), 1.0)
    assert fit.unseen_at(sampled_sine()[0]) is None


def test_motion_that_fades_does_not_repeat() -> None:
    t = np.arange(0.0, 8.0, 0.004)
    fit = harmonic(t, 0.05 * (1.0 - 0.05 * t) * np.sin(2.0 * np.pi * t), 1.0)
    assert not fit.repeats


def test_local_polynomial_is_exact_for_a_cubic_up_to_the_ends() -> None:
    t = np.arange(0.0, 2.0, 0.004)
    motion = savitzky_golay(t, t**3 - t, 0.08)
    assert np.max(np.abs(motion.u_m - (t**3 - t))) < 1e-12
    assert np.max(np.abs(motion.v_m_s - (3.0 * t**2 - 1.0))) < 1e-10
    assert np.max(np.abs(motion.a_m_s2 - 6.0 * t)) < 1e-7


def test_local_polynomial_has_no_phase() -> None:
    t = np.arange(0.0, 4.0, 0.004)
    motion = savitzky_golay(t, np.sin(2.0 * np.pi * t), 0.08)
    inside = slice(100, -100)
    lag = np.sum(motion.v_m_s[inside] * np.sin(2.0 * np.pi * t[inside])) / np.sum(motion.v_m_s[inside] ** 2)
    assert abs(lag) < 1e-3


def test_too_little_data_is_refused_by_name() -> None:
    t = np.arange(0.0, 8.0, 0.004)
    u = np.sin(2.0 * np.pi * t)
    with pytest.raises(NotDifferentiable, match="at least 16"):
        harmonic(t[:10], u[:10], 1.0)
    gap = u.copy()
    gap[500:800] = np.nan
    with pytest.raises(NotDifferentiable, match=r"gap of 1\.204 s"):
        harmonic(t, gap, 1.0)
    with pytest.raises(NotDifferentiable, match="window of"):
        savitzky_golay(t[:10], u[:10], 0.08)


def test_whiteness_tells_noise_from_a_slow_error() -> None:
    noise = np.random.default_rng(5).normal(size=2000)
    assert is_white(noise)
    assert not is_white(noise + 0.5 * np.sin(np.arange(2000) / 30.0))
    assert is_white(np.zeros(100))

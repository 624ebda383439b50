"""Harmonics that are significant: noise, steps and slow changes of a plain sine give none, real ones are found."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from rig.signals.derivatives import harmonic
from rig.signals.fourier import coefficient_errors, quantisation_step

NOISE_M = 5e-6
Change = Callable[[np.random.Generator, np.ndarray, np.ndarray, float], np.ndarray]


def white(random: np.random.Generator, t: np.ndarray, u: np.ndarray, frequency_Hz: float) -> np.ndarray:
    return u + random.normal(0.0, NOISE_M, t.size)


def coloured(random: np.random.Generator, t: np.ndarray, u: np.ndarray, frequency_Hz: float) -> np.ndarray:
    pole = random.uniform(0.5, 0.98)
    return u + lfilter([1.0], [1.0, -pole], random.normal(0.0, NOISE_M, t.size + 500))[500:]


def quantised(random: np.random.Generator, t: np.ndarray, u: np.ndarray, frequency_Hz: float) -> np.ndarray:
    step_m = np.exp(random.uniform(np.log(0.1e-6), np.log(20e-6)))
    noise_m = step_m * random.choice((0.0, 0.05, 0.2, 0.5, 1.0))
    return np.round((u + random.normal(0.0, noise_m, t.size)) / step_m) * step_m


def wandering(random: np.random.Generator, t: np.ndarray, u: np.ndarray, frequency_Hz: float) -> np.ndarray:
    steps = np.cumsum(random.normal(0.0, 1e-3, int(t[-1] * frequency_Hz) + 2))
    size = 1.0 + np.interp(t * frequency_Hz, np.arange(steps.size), steps)
    return u * size + random.normal(0.0, NOISE_M, t.size)


def settling(random: np.random.Generator, t: np.ndarray, u: np.ndarray, frequency_Hz: float) -> np.ndarray:
    size = 1.0 + random.uniform(-1e-2, 1e-2) * np.exp(-t * frequency_Hz / random.uniform(0.5, 3.0))
    return u * size + random.normal(0.0, NOISE_M, t.size)


def sine(random: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """Times (s), displacement (m), frequency (Hz): 3 to 20 cycles of 50 to 1,000 samples, some in step with them."""
    frequency_Hz, cycles = float(np.exp(random.uniform(np.log(0.1), np.log(5.0)))), int(random.integers(3, 21))
    a_cycle = int(np.exp(random.uniform(np.log(50), np.log(1000))))
    dt_s = (1.0 + random.choice((0.0, 1.0)) * random.uniform(-1e-2, 1e-2)) / (frequency_Hz * a_cycle)
    t = np.arange(int(cycles / frequency_Hz / dt_s)) * dt_s
    amplitude_m = np.exp(random.uniform(np.log(1e-3), np.log(5e-2)))
    return t, amplitude_m * np.sin(2.0 * np.pi * frequency_Hz * t + random.uniform(0.0, 6.28)), frequency_Hz


@pytest.mark.few(2)
@pytest.mark.parametrize("change", [white, coloured, quantised, wandering, settling])
def test_a_sine_gets_a_false_harmonic_in_one_fit_in_a_hundred_at_most(change: Change) -> None:
    random = np.random.default_rng(5)
    false = 0
    for _ in range(120):
        t, u, frequency_Hz = sine(random)
        fit = harmonic(t, 0.003 + change(random, t, u, frequency_Hz), frequency_Hz)
        false += fit.orders.tolist() != [1]
    assert false <= 1


@pytest.mark.parametrize("order", [2, 3, 17])
def test_a_harmonic_well_above_the_noise_is_found(order: int) -> None:
    random = np.random.default_rng(order)
    t = np.arange(0.0, 8.0, 0.004)
    size_m = 10.0 * NOISE_M * np.sqrt(2.0 / t.size)
    phase = 2.0 * np.pi * t
    u = 0.05 * np.sin(phase) + size_m * np.sin(order * phase) + random.normal(0.0, NOISE_M, t.size)
    assert harmonic(t, u, 1.0).orders.tolist() == [1, order]


def amplitude(t: np.ndarray, u: np.ndarray, frequency_Hz: float) -> float:
    """Of a sine without noise (m)."""
    columns = np.column_stack((np.sin(2.0 * np.pi * frequency_Hz * t), np.cos(2.0 * np.pi * frequency_Hz * t)))
    return float(np.hypot(*np.linalg.lstsq(columns, u)[0]))


@pytest.mark.few(1)
@pytest.mark.parametrize("change", [white, coloured, quantised])
def test_the_errors_of_the_coefficients_are_as_large_as_stated(change: Change) -> None:
    random = np.random.default_rng(7)
    scores = []
    for _ in range(200):
        t, u, frequency_Hz = sine(random)
        measured = change(random, t, u, frequency_Hz)
        fit = harmonic(t, measured, frequency_Hz)
        true_m = amplitude(t, u, frequency_Hz)
        left = measured - fit.at(t)[0]
        stated = coefficient_errors(t - fit.origin_s, left, fit.omega_rad_s, fit.orders, quantisation_step(measured))
        scores.append((fit.amplitude_m - true_m) / stated[1])
    assert 0.5 < np.sqrt(np.mean(np.square(scores))) < 1.3


def test_the_step_of_a_grid_is_found_and_none_where_there_is_none() -> None:
    random = np.random.default_rng(3)
    values = 0.05 * np.sin(random.uniform(0.0, 6.28, 600))
    assert quantisation_step(np.round(values / 1e-6) * 1e-6) == pytest.approx(1e-6, rel=1e-3)
    assert quantisation_step(np.round(values / 3e-5).astype(np.float32) * np.float32(3e-5)) == pytest.approx(3e-5, 1e-3)
    printed = np.round(np.round(values / 2.803e-5) * 2.803e-5 + 1.234e-3, 8)
    assert quantisation_step(printed) == pytest.approx(2.803e-5, rel=1e-3), "scaled, then printed with few digits"
    assert quantisation_step(values) < 1e-8
    assert quantisation_step(np.zeros(100)) == 0.0

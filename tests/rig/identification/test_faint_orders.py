"""Motion whose small harmonics are lost in the sensor's noise, and are those of a servo that the force pushes away."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.identification.points.faint_orders import FAINT_ORDERS, expected
from rig.signals.derivatives import harmonic, with_orders
from rig.signals.fourier import coefficient_errors

RATE_Hz, CYCLES, AMPLITUDE_m, NOISE_m, NOISE_N = 250.0, 3, 0.06, 5e-6, 5.0
OMEGA = math.tau
LOW = 7


def motion_and_force(
    compliance_m_N: float, seed: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.complex128]]:
    """Times, noisy displacement and force of a sine with a soft servo, and the true orders (c - i s)."""
    time_s = np.arange(int(RATE_Hz * CYCLES)) / RATE_Hz
    fine_s = np.arange(4096) / 4096
    force_N = 600.0 * np.tanh(50.0 * AMPLITUDE_m * OMEGA * np.cos(OMEGA * fine_s) / 1.0)
    orders = np.arange(FAINT_ORDERS + 1)
    harmonics_N = 2.0 * np.fft.rfft(force_N)[: FAINT_ORDERS + 1] / len(force_N)
    truth = -compliance_m_N * harmonics_N / (1.0 + 1j * orders / 10.0)
    truth[0] = 0.0
    truth[1] += -1j * AMPLITUDE_m
    waves = np.exp(1j * OMEGA * np.outer(time_s, orders))
    random = np.random.default_rng(seed)
    displacement_m = np.real(waves @ truth) + NOISE_m * random.standard_normal(len(time_s))
    shown_N = np.real(waves @ harmonics_N) + NOISE_N * random.standard_normal(len(time_s))
    return time_s, displacement_m, shown_N, truth[1:]


def harmonics_found(compliance_m_N: float, seed: int) -> tuple[NDArray[np.complex128], NDArray[np.complex128], float]:
    """True and found orders, by what the cosine of the 9th order is off, in its stated standard errors."""
    time_s, displacement_m, force_N, truth = motion_and_force(compliance_m_N, seed)
    fit = harmonic(time_s, displacement_m, 1.0)
    orders = np.arange(1, FAINT_ORDERS + 1)
    series = with_orders(fit, time_s, displacement_m, orders)
    left_m = displacement_m - series.at(time_s)[0]
    errors_m = coefficient_errors(time_s, left_m, series.omega_rad_s, orders, 1e-9)
    known, error = expected(series, errors_m, orders <= LOW, time_s, force_N)
    found = np.zeros(FAINT_ORDERS, np.complex128)
    turned = np.exp(-1j * known.orders * known.omega_rad_s * known.origin_s)
    found[known.orders - 1] = (known.cosine_m - 1j * known.sine_m) * turned
    ninth = np.flatnonzero(known.orders == 9)
    std_m = (
        float(np.hypot(error.errors_m[ninth], np.sqrt(0.5 * np.sum(np.abs(error.common_m[:, ninth]) ** 2)))[0])
        if len(ninth)
        else math.inf
    )
    return truth, found, float(np.real(found - truth)[8]) / std_m


def slope_error(truth: NDArray[np.complex128], found: NDArray[np.complex128]) -> float:
    """RMS error of the velocity by the faint orders, m/s."""
    orders = np.arange(1, FAINT_ORDERS + 1)
    return float(np.sqrt(0.5 * np.sum(np.abs((found - truth)[LOW:] * orders[LOW:] * OMEGA) ** 2)))


@pytest.mark.parametrize("seed", range(3))
def test_what_the_force_does_to_a_soft_servo_is_known_far_below_the_sensors_noise(seed: int) -> None:
    truth, found, _ = harmonics_found(6e-8, seed)
    left_out = np.where(np.arange(FAINT_ORDERS) < LOW, found, 0.0)
    assert np.max(np.abs(truth[LOW:])) < NOISE_m
    assert slope_error(truth, found) < 0.6 * slope_error(truth, left_out)


def test_a_stiff_servo_gets_no_motion_from_noise() -> None:
    measured = NOISE_m * math.sqrt(2.0 / (RATE_Hz * CYCLES)) * np.sqrt(np.sum((OMEGA * np.arange(8, 49)) ** 2))
    off = [slope_error(*harmonics_found(0.0, seed)[:2]) for seed in range(20)]
    assert np.mean(off) < 0.4 * measured


@pytest.mark.few(1)
@pytest.mark.parametrize("compliance_m_N", [1e-8, 6e-8])
def test_the_stated_errors_hold(compliance_m_N: float) -> None:
    off = np.array([harmonics_found(compliance_m_N, seed)[2] for seed in range(150)])
    assert 0.8 < np.sqrt(np.mean(off**2)) < 1.2

"""Sums over harmonics in linear time, against the sums themselves."""

import numpy as np
import pytest

from rig.signals.derivatives import harmonic
from rig.signals.phase_sums import phase_sums, series_at


@pytest.mark.parametrize(("count", "highest"), [(40, 3), (700, 60), (3000, 1)])
def test_sums_are_those_of_every_sample_and_harmonic(count: int, highest: int) -> None:
    random = np.random.default_rng(count)
    turns, values = np.sort(random.uniform(-20.0, 20.0, count)), random.normal(size=count)
    waves = np.exp(2j * np.pi * np.outer(turns, np.arange(highest + 1)))
    ones, weighted = phase_sums(turns, (None, values), highest, powers=1)
    np.testing.assert_allclose(ones[0], waves.sum(axis=0), atol=1e-11 * count)
    np.testing.assert_allclose(weighted[1], (values * turns) @ waves, atol=1e-11 * count * 20.0)
    spectra = random.normal(size=(2, highest + 1)) + 1j * random.normal(size=(2, highest + 1))
    np.testing.assert_allclose(series_at(turns, spectra), (spectra @ waves.T).real, atol=1e-11 * highest)


def test_a_motion_with_hundreds_of_harmonics_is_found_to_the_standard_error() -> None:
    """100 s of a triangle-like motion at 1 kHz and 0.997 Hz, 5 um of noise: every harmonic, and the frequency."""
    orders, omega = np.arange(1, 200, 2), 2.0 * np.pi * 0.997
    sizes_m = 0.02 / orders**2 * np.sin(orders * np.pi / 2.0)
    time_s = np.arange(100_000) / 1000.0
    (u_m,) = series_at(time_s * 0.997, np.array([np.bincount(orders, sizes_m)]) * -1j)
    fit = harmonic(time_s, u_m + np.random.default_rng(1).normal(0.0, 5e-6, time_s.size), 0.9965)
    error_m = 5e-6 * np.sqrt(2.0 / time_s.size)
    assert fit.omega_rad_s == pytest.approx(omega, abs=4.0 * np.sqrt(12.0) * error_m / 0.02 / 100.0)
    assert fit.orders[:20].tolist() == orders[:20].tolist()
    amplitudes_m = np.hypot(fit.cosine_m, fit.sine_m)
    np.testing.assert_allclose(amplitudes_m[:20], np.abs(sizes_m[:20]), atol=4.5 * error_m)
    assert fit.residual_m == pytest.approx(5e-6, rel=0.01)

"""Random motion is differentiated twice without its noise taking over."""

import numpy as np
import pytest

from rig.signals.derivatives import NotDifferentiable
from rig.signals.free_motion import cutoff_Hz, free_motion, mean_rate_Hz

RATE_HZ = 1000.0


def band_limited(top_Hz: float, seconds: float = 20.0) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Random motion of 5 mm RMS whose spectrum ends at `top_Hz`, with its exact derivatives."""
    count = int(seconds * RATE_HZ)
    frequency = np.fft.rfftfreq(count, 1.0 / RATE_HZ)
    rng = np.random.default_rng(3)
    lines = (rng.normal(size=frequency.size) + 1j * rng.normal(size=frequency.size)) * (
        (frequency > 0.2) & (frequency < top_Hz)
    )
    rate = 2j * np.pi * frequency
    u, v, a = (np.fft.irfft(lines * rate**k, count) for k in range(3))
    scale = 0.005 / u.std()
    return np.arange(count) / RATE_HZ, scale * u, scale * v, scale * a


@pytest.mark.parametrize("top_Hz", [5.0, 20.0])
def test_motion_ends_where_its_spectrum_does_whatever_the_noise(top_Hz: float) -> None:
    time_s, u, v, a = band_limited(top_Hz)
    noisy = u + np.random.default_rng(1).normal(0.0, 2e-6, u.size)
    assert top_Hz < cutoff_Hz(noisy, 1.0 / RATE_HZ) < 2.5 * top_Hz
    motion = free_motion(time_s, noisy, time_s)
    assert np.std(motion.v_m_s - v) < 0.02 * v.std()
    assert np.std(motion.a_m_s2 - a) < 0.25 * a.std()


def test_motion_without_noise_is_differentiated_as_it_is() -> None:
    time_s, _, v, a = band_limited(10.0)
    motion = free_motion(time_s, band_limited(10.0)[1], time_s)
    assert np.std(motion.v_m_s - v) < 1e-4 * v.std()
    assert np.std(motion.a_m_s2 - a) < 1e-3 * a.std()


def test_crossings_of_a_sine_are_its_frequency() -> None:
    time_s = np.arange(5000) / RATE_HZ
    assert mean_rate_Hz(time_s, 3.0 + np.sin(2.0 * np.pi * 4.0 * time_s - 0.5)) == pytest.approx(4.0, rel=0.05)


def test_a_handful_of_samples_is_refused_with_its_number() -> None:
    with pytest.raises(NotDifferentiable, match="100 displacement samples"):
        free_motion(np.arange(100) / RATE_HZ, np.zeros(100), np.zeros(3))

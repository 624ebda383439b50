"""What the machine achieved: amplitude, mean, frequency, phase and distortion of known motions."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.signals.cycles import fundamental_phase, measured_motion

RATE_HZ = 250.0


def ramped(amplitude_m: float, frequency_Hz: float, shape: str, cycles: int = 8) -> tuple[NDArray, NDArray]:
    """A program with one ramp cycle on each side, sampled with a start between two samples and 5 um of noise."""
    length_s = (cycles + 2) / frequency_Hz
    time_s = np.arange(0.0, length_s, 1.0 / RATE_HZ) + 1.3e-3
    phase = time_s * frequency_Hz
    wave = np.sin(math.tau * phase) if shape == "sine" else 2.0 / math.pi * np.arcsin(np.sin(math.tau * phase))
    envelope = np.clip(np.minimum(phase, cycles + 2 - phase), 0.0, 1.0)
    noise = 5e-6 * np.random.default_rng(1).standard_normal(len(time_s))
    return time_s, amplitude_m * envelope * wave + noise


@pytest.mark.parametrize("shape", ["sine", "triangle"])
@pytest.mark.parametrize(("amplitude_m", "frequency_Hz"), [(0.05, 2.0), (0.01, 0.5), (0.005, 8.0)])
def test_amplitude_is_known_to_a_tenth_of_a_percent(shape: str, amplitude_m: float, frequency_Hz: float) -> None:
    time_s, displacement_m = ramped(amplitude_m, frequency_Hz, shape)
    motion = measured_motion(time_s, displacement_m + 0.002, shape)
    assert motion is not None
    assert motion.amplitude_m == pytest.approx(amplitude_m, rel=1e-3 + 6e-6 / amplitude_m)
    assert motion.mean_m == pytest.approx(0.002, abs=2e-3 * amplitude_m)
    assert motion.frequency_Hz == pytest.approx(frequency_Hz, rel=1e-3)
    assert motion.cycles == pytest.approx(8, abs=1)
    assert len(motion.waveform.amplitude_m) == motion.cycles


@pytest.mark.parametrize(
    ("frequency_Hz", "rate_Hz"), [(0.5, 250.0), (1.0, 250.0), (2.0, 250.0), (2.0, 1000.0), (4.7, 250.0)],
)
@pytest.mark.parametrize("bandwidth_Hz", [20.0, 30.0, 60.0])
def test_the_amplitude_of_a_triangle_is_that_of_its_rounded_corners(
    frequency_Hz: float, rate_Hz: float, bandwidth_Hz: float
) -> None:
    fine_s = np.arange(0.0, 10.0 / frequency_Hz, 1e-4)
    phase = fine_s * frequency_Hz
    reported = (
        0.02 * np.clip(np.minimum(phase, 10 - phase), 0.0, 1.0) * 2 / math.pi * np.arcsin(np.sin(math.tau * phase))
    )
    moved = np.zeros((2, len(reported)))
    for k in range(1, len(reported)):
        # A servo of second order with damping 0.7, semi-implicit Euler.
        pull = (math.tau * bandwidth_Hz) ** 2 * (reported[k] - moved[0, k - 1])
        moved[1, k] = moved[1, k - 1] + 1e-4 * (pull - 1.4 * math.tau * bandwidth_Hz * moved[1, k - 1])
        moved[0, k] = moved[0, k - 1] + 1e-4 * moved[1, k]
    steady = (phase > 3.0) & (phase < 7.0)
    peak_m = 0.5 * float(np.ptp(moved[0][steady]))
    time_s = np.arange(1.3e-3, fine_s[-1], 1.0 / rate_Hz)
    noise_m = 5e-6 * np.random.default_rng(3).standard_normal(len(time_s))
    motion = measured_motion(time_s, np.interp(time_s, fine_s, moved[0]) + noise_m, "triangle")
    assert motion is not None
    assert motion.amplitude_m == pytest.approx(peak_m, rel=4e-3)
    assert motion.fundamental_amplitude_m == pytest.approx(0.02, rel=5e-3)
    assert motion.amplitude_m < motion.fundamental_amplitude_m


def test_an_ideal_waveform_has_no_distortion_and_the_wrong_one_has() -> None:
    time_s, displacement_m = ramped(0.03, 1.0, "triangle")
    as_triangle = measured_motion(time_s, displacement_m, "triangle")
    as_sine = measured_motion(time_s, displacement_m, "sine")
    assert as_triangle is not None
    assert as_sine is not None
    assert np.median(as_triangle.waveform.distortion) < 0.002
    # Harmonics of the triangle beyond the first: 1/9, 1/25, 1/49, 1/81.
    assert np.median(as_sine.waveform.distortion) == pytest.approx(math.hypot(1 / 9, 1 / 25, 1 / 49, 1 / 81), rel=0.02)


def test_a_third_harmonic_of_two_percent_is_two_percent_of_distortion() -> None:
    time_s = np.arange(0.0, 6.0, 1.0 / RATE_HZ)
    displacement_m = 0.02 * (np.sin(math.tau * time_s) + 0.02 * np.sin(3 * math.tau * time_s + 0.4))
    motion = measured_motion(time_s, displacement_m, "sine")
    assert motion is not None
    assert np.median(motion.waveform.distortion) == pytest.approx(0.02, rel=0.01)


def test_a_cycle_with_a_gap_says_nothing_and_the_others_do() -> None:
    time_s, displacement_m = ramped(0.03, 1.0, "sine")
    displacement_m[(time_s > 4.1) & (time_s < 4.3)] = np.nan
    motion = measured_motion(time_s, displacement_m, "sine")
    assert motion is not None
    unknown = ~np.isfinite(motion.waveform.amplitude_m)
    assert np.count_nonzero(unknown) == 1
    assert motion.amplitude_m == pytest.approx(0.03, rel=1e-3)


def test_a_rod_at_rest_has_no_motion() -> None:
    assert measured_motion(np.arange(100) / RATE_HZ, np.zeros(100)) is None


def test_the_phase_is_found_in_sparse_samples_and_refused_in_samples_on_one_phase() -> None:
    time_s = np.sort(np.random.default_rng(2).uniform(0.0, 7.0, 20))
    assert fundamental_phase(time_s, 3.0 + np.sin(math.tau * 2.0 * time_s - 0.7), 2.0) == pytest.approx(-0.7, abs=1e-9)
    stroboscopic_s = np.arange(20) * 0.5
    assert fundamental_phase(stroboscopic_s, np.sin(math.tau * 2.0 * stroboscopic_s), 2.0) is None

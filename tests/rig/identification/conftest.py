"""Tests as a rig records them: a finer plant, filters, noise, quantisation, separate clocks."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from scipy.signal import bilinear, lfilter, lfilter_zi

from rig.dampers import model, parameter_set
from rig.identification import Measurement
from rig.recording.recorded_point import ForceSamples, RecordedPoint

PLANT_STEP_S = 1.0 / 8000.0
FORCE_FILTER_HZ, DISPLACEMENT_FILTER_HZ = 1000.0, 500.0
MID_STROKE_M = 0.003
SKEW_STD_S = 2e-6


def low_pass(x: np.ndarray, corner_Hz: float, damping: float = 2.0**-0.5) -> np.ndarray:
    """Second-order low-pass on the plant's grid."""
    omega = 2.0 * np.pi * corner_Hz
    numerator, denominator = bilinear([omega**2], [1.0, 2.0 * damping * omega, omega**2], 1.0 / PLANT_STEP_S)
    return np.asarray(lfilter(numerator, denominator, x, zi=lfilter_zi(numerator, denominator) * x[0])[0])


def plant(
    set_name: str,
    current_A: float,
    frequency_Hz: float,
    amplitude_m: float = 0.05,
    waveform: str = "sine",
    cycles: int = 10,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Time (s), filtered displacement (m) and filtered force (N) on the plant's grid, servo lag and ramps included."""
    t = np.arange(0.0, (cycles + 2) / frequency_Hz + 1.0, PLANT_STEP_S)
    phase = (t - 0.5) * frequency_Hz
    envelope = np.clip(phase, 0.0, 1.0) * np.clip(cycles + 2 - phase, 0.0, 1.0)
    wave = np.sin(2.0 * np.pi * phase)
    if waveform == "triangle":
        wave = 2.0 / np.pi * np.arcsin(wave)
    u = low_pass(amplitude_m * envelope * wave, 30.0, 0.7)
    v = np.gradient(u, PLANT_STEP_S)
    a = np.gradient(v, PLANT_STEP_S)
    chosen = parameter_set(set_name)
    force = model(chosen.model).force(chosen.values, u, v, a, current_A, PLANT_STEP_S)
    return t, low_pass(u + MID_STROKE_M, DISPLACEMENT_FILTER_HZ), low_pass(force, FORCE_FILTER_HZ)


def record(
    truth: tuple[np.ndarray, np.ndarray, np.ndarray],
    rng: np.random.Generator,
    *,
    name: str,
    current_A: float,
    frequency_Hz: float,
    amplitude_m: float = 0.05,
    waveform: str = "sine",
    noise_N: float = 5.0,
) -> RecordedPoint:
    """Sample the plant at 250 Hz by two drifting clocks; 5 N and 5 um rms noise, 0.05 N and 1 um steps."""
    t, displacement, force = truth

    def clock() -> np.ndarray:
        return np.arange(0.02 + rng.uniform(0.0, 0.004), t[-1] - 0.02, 0.004 * (1.0 + rng.normal(0.0, 20e-6)))

    u_s, f_s = clock(), clock()
    u_m = np.round((np.interp(u_s, t, displacement) + rng.normal(0.0, 5e-6, u_s.size)) / 1e-6) * 1e-6
    f_N = np.round((np.interp(f_s, t, force) + rng.normal(0.0, noise_N, f_s.size)) / 0.05) * 0.05
    u_s = u_s - 2.0**0.5 / (2.0 * np.pi * DISPLACEMENT_FILTER_HZ) + rng.normal(0.0, SKEW_STD_S)
    f_s = f_s - 2.0**0.5 / (2.0 * np.pi * FORCE_FILTER_HZ)
    point = RecordedPoint.from_arrays(
        id=name,
        time_s=u_s,
        displacement_m=u_m,
        force_N=np.interp(u_s, f_s, f_N),
        waveform=waveform,
        current_measured_A=current_A + rng.normal(0.0, 0.002, u_s.size),
        amplitude_m=amplitude_m,
        cycles=10,
        frequency_Hz=frequency_Hz,
        current_A=current_A,
        mid_stroke_m=MID_STROKE_M,
        skew_std_s=SKEW_STD_S,
    )
    point.__dict__["force_samples"] = ForceSamples(f_s, f_N, np.zeros(f_s.size, dtype=np.int64))
    return point


def campaign(
    set_name: str, currents_A: Sequence[float], frequencies_Hz: Sequence[float], seed: int = 0, waveform: str = "sine"
) -> list[RecordedPoint]:
    """A matrix of recorded tests of one simulated damper."""
    rng = np.random.default_rng(seed)
    points = []
    for current in currents_A:
        for frequency in frequencies_Hz:
            truth = plant(set_name, current, frequency, waveform=waveform)
            name = f"{waveform[0]}{len(points) + 1:03d}"
            points.append(record(truth, rng, name=name, current_A=current, frequency_Hz=frequency, waveform=waveform))
    return points


def synthetic(
    values: dict[str, float],
    currents_A: Sequence[float] = (0.0, 0.5, 1.0, 1.5, 2.0),
    frequencies_Hz: Sequence[float] = (0.5, 1.0, 1.5, 2.0),
    *,
    name: str = "asymmetric",
    form: str = "kwok",
    noise_N: float = 5.0,
    seed: int = 0,
    cycles: int = 8,
) -> list[Measurement]:
    """The Table-1 problem without a rig: exact motion, white noise on the force."""
    rng = np.random.default_rng(seed)
    damper = model(name, form)
    measurements = []
    for current in currents_A:
        for frequency in frequencies_Hz:
            t = np.arange(round(cycles / frequency * 250)) / 250.0 + 0.0013
            omega = 2.0 * np.pi * frequency
            u, v, a = 0.05 * np.sin(omega * t), 0.05 * omega * np.cos(omega * t), -0.05 * omega**2 * np.sin(omega * t)
            amps = np.full_like(u, current)
            force = damper.force(values, u, v, a, amps, 0.004) + rng.normal(0.0, noise_N, u.size)
            measurements.append(
                Measurement(
                    id=f"p{len(measurements) + 1:03d}",
                    u_m=u,
                    v_m_s=v,
                    a_m_s2=a,
                    force_N=force,
                    current_A=amps,
                    dt_s=0.004,
                    amplitude_m=0.05,
                    frequency_Hz=frequency,
                    nominal_current_A=current,
                    noise_N=noise_N,
                    samples_per_cycle=round(250 / frequency),
                )
            )
    return measurements


@pytest.fixture(scope="session")
def make_synthetic() -> Callable[..., list[Measurement]]:
    """The Table-1 problem without a rig."""
    return synthetic


@pytest.fixture(scope="session")
def make_campaign() -> Callable[..., list[RecordedPoint]]:
    """Recorded campaigns of any simulated damper."""
    return campaign


@pytest.fixture(scope="session")
def demo_points() -> list[RecordedPoint]:
    """Nine sine tests of the demo damper: 0, 1, 2 A at 0.5, 1, 2 Hz."""
    return campaign("demo", (0.0, 1.0, 2.0), (0.5, 1.0, 2.0))

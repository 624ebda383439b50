"""Random campaigns with known truth, recorded in numpy: exact physics, sensors with noise, steps, clocks and skew.

The motion is a sine, or a triangle whose corners are rounded as by a servo, with small harmonics of its own; force and
displacement are sampled at their own times by separate clocks, each with white noise and a quantisation step; force
lags by a random skew whose standard deviation is stated. A campaign of eight points takes a few milliseconds.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rig.dampers import model, parameter_set
from rig.recording.quality.point_quality import PointQuality, RestQuality
from rig.recording.recorded_point import ForceSamples, RecordedPoint

SERVO_Hz = 30.0
ORDERS = np.arange(1, 160)


@dataclass(frozen=True)
class Setting:
    """What is the same in all points of a campaign; drawn by `random_setting`."""

    values: dict[str, float]
    currents_A: tuple[float, ...]
    frequencies_Hz: tuple[float, ...]
    amplitude_m: float
    cycles: int
    rate_Hz: float
    noise_N: float
    noise_m: float
    step_N: float
    step_m: float
    skew_std_s: float
    zero_std_N: float = 0.0
    waveform: str = "sine"
    model: str = "asymmetric"
    harmonics: float = 1e-3
    extra: dict[str, float] = field(default_factory=dict)


def random_setting(random: np.random.Generator, name: str = "demo") -> Setting:
    """A setting and a truth, the parameters log-uniform within a factor 2 of a set."""
    truth = parameter_set(name)
    values = {key: value * 2.0 ** random.uniform(-1.0, 1.0) for key, value in truth.values.items()}
    currents = np.round(np.sort(random.choice(np.arange(0.0, 2.01, 0.25), random.integers(2, 5), replace=False)), 3)
    frequencies = np.sort(random.choice((0.5, 0.75, 1.0, 1.5, 2.0, 2.5), random.integers(3, 5), replace=False))
    return Setting(
        values=values,
        model=truth.model,
        currents_A=tuple(currents.tolist()),
        frequencies_Hz=tuple(frequencies.tolist()),
        amplitude_m=float(np.exp(random.uniform(np.log(0.015), np.log(0.05)))),
        cycles=int(random.integers(5, 11)),
        rate_Hz=float(random.choice((250.0, 500.0, 1000.0))),
        noise_N=float(np.exp(random.uniform(np.log(1.0), np.log(10.0)))),
        noise_m=float(np.exp(random.uniform(np.log(0.5e-6), np.log(10e-6)))),
        step_N=float(random.choice((0.05, 0.5, 2.0, 5.0))),
        step_m=float(random.choice((0.1e-6, 1e-6, 5e-6))),
        skew_std_s=float(np.exp(random.uniform(np.log(2e-6), np.log(50e-6)))),
        harmonics=float(random.choice((0.0, 1e-4, 1e-3))),
    )


def record(setting: Setting, random: np.random.Generator) -> list[RecordedPoint]:
    """All points of a campaign."""
    skew_s = setting.skew_std_s * random.standard_normal()
    zero_N = setting.zero_std_N * random.standard_normal()
    points = []
    for current_A in setting.currents_A:
        for frequency_Hz in setting.frequencies_Hz:
            number = f"p{len(points) + 1:03}"
            points.append(_point(setting, random, number, current_A, frequency_Hz, skew_s, zero_N))
    return points


def _point(
    setting: Setting,
    random: np.random.Generator,
    name: str,
    current_A: float,
    frequency_Hz: float,
    skew_s: float,
    zero_N: float,
) -> RecordedPoint:
    cosine_m, sine_m = _series(setting, random, frequency_Hz)
    end_s = (setting.cycles + 0.1) / frequency_Hz
    u_s, f_s = (_clock(random, end_s, setting.rate_Hz) for _ in range(2))
    clean_m = _motion(cosine_m, sine_m, frequency_Hz, u_s)[0]
    u, v, a = _motion(cosine_m, sine_m, frequency_Hz, f_s - skew_s)
    damper = model(setting.model)
    force_N = damper.force(setting.values, u, v, a, np.full_like(u, current_A), 1.0 / setting.rate_Hz)
    measured_N = _measured(random, force_N + zero_N, setting.noise_N, setting.step_N)
    measured_m = _measured(random, clean_m, setting.noise_m, setting.step_m)
    point = RecordedPoint.from_arrays(
        id=name,
        time_s=u_s,
        displacement_m=measured_m,
        force_N=np.interp(u_s, f_s, measured_N),
        waveform=setting.waveform,
        amplitude_m=setting.amplitude_m,
        cycles=setting.cycles,
        frequency_Hz=frequency_Hz,
        current_A=current_A,
        mid_stroke_m=0.0,
        skew_std_s=setting.skew_std_s,
        quality=PointQuality(rest=RestQuality(force_zero_std_N=setting.zero_std_N or None)),
    )
    point.__dict__["force_samples"] = ForceSamples(f_s, measured_N, np.zeros(f_s.size, dtype=np.int64))
    return point


def _series(setting: Setting, random: np.random.Generator, frequency_Hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Cosine and sine amplitudes (m) of `ORDERS`: the waveform behind a servo, and harmonics of its own."""
    complex_m = np.zeros(ORDERS.size, complex)
    if setting.waveform == "sine":
        complex_m[0] = -1j * setting.amplitude_m
    else:
        odd = ORDERS % 2 == 1
        signs = np.where(ORDERS % 4 == 1, 1.0, -1.0)
        complex_m[odd] = -1j * setting.amplitude_m * (8.0 / np.pi**2) * (signs / ORDERS**2)[odd]
    ratio = 1j * ORDERS * frequency_Hz / SERVO_Hz
    complex_m /= 1.0 + 1.4 * ratio + ratio**2
    for order in (2, 3, 5):
        drawn = random.standard_normal(2) @ (1.0, 1j)
        complex_m[order - 1] += setting.harmonics * setting.amplitude_m * drawn / order**2
    return complex_m.real, -complex_m.imag


def _motion(
    cosine_m: np.ndarray, sine_m: np.ndarray, frequency_Hz: float, time_s: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    used = (cosine_m != 0.0) | (sine_m != 0.0)
    rate = 2.0 * np.pi * frequency_Hz * ORDERS[used]
    phase = np.outer(time_s, rate)
    cosine, sine, c, s = np.cos(phase), np.sin(phase), cosine_m[used], sine_m[used]
    velocity = cosine @ (s * rate) - sine @ (c * rate)
    return cosine @ c + sine @ s, velocity, -(cosine @ (c * rate**2)) - sine @ (s * rate**2)


def _clock(random: np.random.Generator, end_s: float, rate_Hz: float) -> np.ndarray:
    interval_s = (1.0 + random.normal(0.0, 50e-6)) / rate_Hz
    return np.arange(random.uniform(0.0, 1.0) / rate_Hz, end_s, interval_s)


def _measured(random: np.random.Generator, values: np.ndarray, noise: float, step: float) -> np.ndarray:
    return np.asarray(np.round((values + noise * random.standard_normal(values.size)) / step) * step)

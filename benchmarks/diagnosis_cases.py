"""Campaigns of known dampers with one thing wrong, for `diagnosis.py`: exact sines, white noise, and the corruption.

Truths are within a factor 2 of a model's demonstration; currents (2 to 5 of 0 to 2 A), frequencies (2 to 4 of 0.5 to
2.5 Hz), amplitude (8 to 50 mm), cycles (3 to 5), rate (250 or 500 Hz) and noise (1 to 10 N) are random.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers import model, parameter_set
from rig.identification import Measurement

SETS = ("demo", "demo-kwok", "demo-normalized-bouc-wen", "demo-symmetric", "demo-bingham")
Shown = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""From the share of the campaign (n,) and of the test (n,) to the factor on the force (n,)."""


@dataclass(frozen=True)
class Plant:
    """A damper and how it is tested."""

    model: str
    values: dict[str, float]
    currents_A: tuple[float, ...]
    frequencies_Hz: tuple[float, ...]
    amplitude_m: float
    cycles: int
    rate_Hz: float
    noise_N: float


def drawn(random: np.random.Generator, name: str, levels: int | None = None, lowest_A: float = 0.0) -> Plant:
    """A random damper of a set, and a random campaign."""
    truth = parameter_set(name)
    count = int(random.integers(2, 6)) if levels is None else levels
    return Plant(
        truth.model,
        values_near(random, name),
        tuple(np.sort(random.choice(np.arange(lowest_A, 2.01, 0.25), count, replace=False)).tolist()),
        tuple(np.sort(random.choice((0.5, 0.75, 1.0, 1.5, 2.0, 2.5), random.integers(2, 5), replace=False)).tolist()),
        float(np.exp(random.uniform(np.log(0.008), np.log(0.05)))),
        int(random.integers(3, 6)),
        float(random.choice((250.0, 500.0))),
        float(np.exp(random.uniform(0.0, np.log(10.0)))),
    )


def values_near(random: np.random.Generator, name: str) -> dict[str, float]:
    return {key: value * 2.0 ** random.uniform(-1.0, 1.0) for key, value in parameter_set(name).values.items()}


def record(
    random: np.random.Generator,
    plant: Plant,
    *,
    skew_s: float = 0.0,
    acting: Callable[[float], float] = lambda current_A: current_A,
    others: tuple[dict[str, float], ...] = (),
    gain: Shown | None = None,
    ends_N: tuple[float, float] | None = None,
    temperature_degC: Callable[[np.ndarray], np.ndarray] | None = None,
) -> list[Measurement]:
    """All tests; `others` are the values of each test's damper where not all are the plant's."""
    damper, tests = model(plant.model), []
    points = [(current, frequency) for current in plant.currents_A for frequency in plant.frequencies_Hz]
    for number, (current_A, frequency_Hz) in enumerate(points):
        rate, cycle = 2.0 * np.pi * frequency_Hz, round(plant.rate_Hz / frequency_Hz)
        count = round(plant.cycles * plant.rate_Hz / frequency_Hz)
        time_s = np.arange(-cycle, count) / plant.rate_Hz + 0.0013
        u, v, a = _motion(plant.amplitude_m, rate, time_s - skew_s)
        values = others[number] if others else plant.values
        force_N = damper.force(values, u, v, a, np.full_like(u, acting(current_A)), 1.0 / plant.rate_Hz)[-count:]
        share = np.linspace(0.0, 1.0, count)
        in_all = (number + share) / len(points)
        force_N = force_N if gain is None else force_N * gain(in_all, share)
        force_N = force_N if ends_N is None else np.clip(force_N, *ends_N)
        u, v, a = _motion(plant.amplitude_m, rate, time_s[-count:])
        tests.append(
            Measurement(
                id=f"p{number + 1:03d}", u_m=u, v_m_s=v, a_m_s2=a,
                force_N=force_N + random.normal(0.0, plant.noise_N, count), current_A=np.full(count, current_A),
                dt_s=1.0 / plant.rate_Hz, amplitude_m=plant.amplitude_m, frequency_Hz=frequency_Hz,
                nominal_current_A=current_A, noise_N=plant.noise_N, samples_per_cycle=cycle,
                temperature_degC=None if temperature_degC is None else temperature_degC(in_all),
            )
        )  # fmt: skip
    return tests


def _motion(amplitude_m: float, rate: float, time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    sine, cosine = amplitude_m * np.sin(rate * time_s), amplitude_m * np.cos(rate * time_s)
    return sine, rate * cosine, -(rate**2) * sine


Case = Callable[[np.random.Generator, str], tuple[str, list[Measurement]]]


def _simple(**wrong: object) -> Case:
    def case(random: np.random.Generator, name: str) -> tuple[str, list[Measurement]]:
        plant = drawn(random, name)
        return plant.model, record(random, plant, **wrong)

    return case


def _changed(change: Callable[[Measurement], Measurement]) -> Case:
    def case(random: np.random.Generator, name: str) -> tuple[str, list[Measurement]]:
        damper, tests = _simple()(random, name)
        return damper, [change(test) for test in tests]

    return case


def _outliers(random: np.random.Generator, name: str) -> tuple[str, list[Measurement]]:
    damper, tests = _simple()(random, name)
    peak_N, spoiled = max(test.peak_force_N for test in tests), []
    for test in tests:
        hit = np.where(random.random(test.force_N.size) < 0.005, random.choice((-1.0, 1.0), test.force_N.size), 0.0)
        force_N = test.force_N + hit * peak_N * random.uniform(0.3, 1.0, hit.size)
        spoiled.append(replace(test, force_N=force_N))
    return damper, spoiled


def _clipped(random: np.random.Generator, name: str) -> tuple[str, list[Measurement]]:
    plant = drawn(random, name)
    top_N = max(float(np.max(np.abs(test.force_N))) for test in record(random, plant))
    end_N = top_N * float(random.uniform(0.6, 0.85))
    return plant.model, record(random, plant, ends_N=(-end_N, end_N))


def _saturating(levels: int) -> Case:
    def case(random: np.random.Generator, name: str) -> tuple[str, list[Measurement]]:
        scale_A = float(random.uniform(0.5, 1.2))
        plant = drawn(random, name, levels, 0.5 if levels == 2 else 0.0)
        return plant.model, record(random, plant, acting=lambda x: scale_A * (1.0 - float(np.exp(-x / scale_A))))

    return case


def _mixed(random: np.random.Generator, name: str) -> tuple[str, list[Measurement]]:
    plant, other = drawn(random, name), values_near(random, name)
    second = random.random(len(plant.currents_A) * len(plant.frequencies_Hz)) < 0.5
    second[:2], second[2:4] = True, False
    return plant.model, record(random, plant, others=tuple(other if x else plant.values for x in second))


def _warming(random: np.random.Generator, name: str) -> tuple[str, list[Measurement]]:
    rise_K, plant = float(random.uniform(15.0, 40.0)), drawn(random, name)

    def warm_K(share: np.ndarray) -> np.ndarray:
        return np.asarray(rise_K * (1.0 - np.exp(-2.0 * share)))

    return plant.model, record(
        random, plant,
        gain=lambda in_all, _: 1.0 - 0.005 * warm_K(in_all), temperature_degC=lambda in_all: 25.0 + warm_K(in_all),
    )  # fmt: skip


def _turned(test: Measurement) -> Measurement:
    return replace(test.moved(-test.u_m, -test.v_m_s, -test.a_m_s2), force_N=-test.force_N)


def _asymmetric(change: Callable[[Measurement], Measurement]) -> Case:
    return lambda random, _: _changed(change)(random, "demo")


def _no_gas(random: np.random.Generator, name: str) -> tuple[str, list[Measurement]]:
    plant = drawn(random, name)
    values = {**plant.values, **{key: 0.0 for key in ("f0", "F0") if key in plant.values}}
    tests = record(random, replace(plant, values=values))
    offset_N = 0.2 * float(np.median([test.peak_force_N for test in tests]))
    return plant.model, [replace(test, force_N=test.force_N + offset_N) for test in tests]


CASES: dict[str, tuple[Case, str]] = {
    "skew 0.7 ms": (_simple(skew_s=0.7e-3), "skew"),
    "skew 3 ms": (_simple(skew_s=3e-3), "skew"),
    "drift 25 % in each test": (_simple(gain=lambda _, share: 1.0 + 0.25 * share), "force-drift"),
    "drift 25 % over all tests": (_simple(gain=lambda in_all, _: 1.0 + 0.25 * in_all), "force-drift"),
    "outliers 0.5 %": (_outliers, "outliers"),
    "clipping": (_clipped, "clipping"),
    "saturating law, 2 currents from 0.5 A": (_saturating(2), "current-law"),
    "saturating law, 5 currents": (_saturating(5), "current-law"),
    "mixed specimens": (_mixed, "mixed-specimens"),
    "temperature, -0.5 %/K": (_warming, "temperature"),
    "kN for N": (_changed(lambda t: replace(t, force_N=1e-3 * t.force_N, noise_N=1e-3 * t.noise_N)), "units-force"),
    "ms for s": (
        _changed(lambda t: replace(t, dt_s=1e3 * t.dt_s, v_m_s=1e-3 * t.v_m_s, a_m_s2=1e-6 * t.a_m_s2)), "units-time",
    ),
    "mm for m": (_changed(lambda t: t.moved(1e3 * t.u_m, 1e3 * t.v_m_s, 1e3 * t.a_m_s2)), "units-displacement"),
    "mA for A": (_changed(lambda t: replace(t, current_A=1e3 * t.current_A)), "units-current"),
    "both signs reversed, asymmetric dampers": (_asymmetric(_turned), "signs-reversed"),
    "force off by +0.2 of the peak, no gas": (_no_gas, "force-offset"),
    "clean": (_simple(), ""),
}  # fmt: skip
"""What is wrong -> the campaign, and the slug to be named first."""

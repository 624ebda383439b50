"""Prediction errors: how many samples of hidden motions lie within the stated band of 95 %, and how wide it is.

    RIG_MEASURED_DATA=DIR python benchmarks/prediction_coverage.py measured [MODEL ...]
    python benchmarks/prediction_coverage.py simulated [MODEL ...] --seeds 8

Measured: each motion of the UTFSM tests is hidden in turn, the band is made from the others. Simulated: random dampers
of four models of the library, and two outside of it (`slips`: friction by five Maxwell slips, a power law of the speed
and a gas spring; `knee`: saturation, an overshoot after the reversal, a lag and a knee); a grid of three to nine
motions at three to five currents with noise and scatter between tests; ten hidden motions within the tested ranges,
half of them at currents between the tested ones, and four beyond. For comparison: the 95 % residuals of the fitted
tests, which were the band before.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path

import numpy as np
from campaign_process import machine
from measured_damper import measured

from rig.clock import utc_now
from rig.dampers import model
from rig.errors import IdentificationFailed
from rig.identification import Fit, Measurement, identify
from rig.identification.models.coverage import beyond
from rig.identification.models.measurement import first_cycle
from rig.identification.uncertainty.prediction_error import error_band

Force = Callable[[np.ndarray, np.ndarray, np.ndarray, float, float], np.ndarray]
FINER, RATE_Hz, CYCLES = 8, 250.0, 2
HIDDEN, BEYOND = 10, 4
POOR = 0.8


def slips(random: np.random.Generator) -> Force:
    """Five Maxwell slips whose forces grow with the current, a power law of the speed, a gas spring."""
    share, limits_m = random.dirichlet(np.full(5, 2.0)), 5e-4 * np.geomspace(0.3, 3.0, 5)
    friction_N, more_N, bend_A = random.uniform((100.0, 500.0, 0.8), (250.0, 1500.0, 2.0))
    rebound, compression = np.exp(random.uniform(np.log(600.0), np.log(3000.0), 2))
    power, thicker_1_A, gas_N_m, harder_1_m = random.uniform((0.5, 0.3, 500.0, 0.0), (0.9, 1.0, 4000.0, 2.0))

    def force(u: np.ndarray, v: np.ndarray, a: np.ndarray, current_A: float, dt_s: float) -> np.ndarray:
        level_N = friction_N + more_N * np.tanh(current_A / bend_A)
        steps, state, slipping = np.diff(u, prepend=u[0]), np.zeros(5), np.empty(u.size)
        for place in range(u.size):
            state = np.clip(state + level_N * share / limits_m * steps[place], -level_N * share, level_N * share)
            slipping[place] = np.sum(state)
        viscous = 0.1 * np.where(v > 0.0, rebound, compression) * np.sign(v) * np.abs(v / 0.1) ** power
        return slipping + (1.0 + thicker_1_A * current_A) * viscous + gas_N_m * u / (1.0 - harder_1_m * u) + 300.0

    return force


def knee(random: np.random.Generator) -> Force:
    """Yield force with saturation and an overshoot after the reversal, behind a lag; a knee in the viscous force."""
    friction_N, more_N, bend_A = random.uniform((80.0, 400.0, 1.0), (200.0, 1200.0, 3.0))
    width_m_s, slope, knee_m_s, soft = random.uniform((0.003, 800.0, 0.05, 0.2), (0.02, 3000.0, 0.2, 0.5))
    stiffness, lag_s, skewed = random.uniform((0.0, 0.001, -0.1), (2000.0, 0.008, 0.1))

    def force(u: np.ndarray, v: np.ndarray, a: np.ndarray, current_A: float, dt_s: float) -> np.ndarray:
        from scipy.signal import lfilter

        yielding = friction_N + more_N * (current_A / bend_A) / np.hypot(1.0, current_A / bend_A)
        speed = np.minimum(np.abs(v), knee_m_s + soft * np.maximum(np.abs(v) - knee_m_s, 0.0))
        raw = yielding * np.tanh(v / width_m_s) * (1.0 + 0.15 * np.exp(-np.abs(v) / 0.02))
        raw = raw + slope * (1.0 + skewed * np.sign(v)) * np.sign(v) * speed
        return lfilter([dt_s / (lag_s + dt_s)], [1.0, -lag_s / (lag_s + dt_s)], raw) + stiffness * u + 200.0

    return force


def of_library(name: str) -> Callable[[np.random.Generator], Force]:
    """A model's demonstration with every value changed by up to a factor 1.4."""

    def made(random: np.random.Generator) -> Force:
        damper = model(name)
        truth = {key: value * 2.0 ** random.uniform(-0.5, 0.5) for key, value in damper.demonstration.items()}
        return lambda u, v, a, current_A, dt_s: damper.force(truth, u, v, a, np.full(u.size, current_A), dt_s)

    return made


LIBRARY = ("asymmetric", "thinning_bouc_wen", "lugre", "sprung_bouc_wen")
PLANTS = {**{name: of_library(name) for name in LIBRARY}, "slips": slips, "knee": knee}


def campaign(name: str, seed: int) -> tuple[list[Measurement], list[Measurement], list[Measurement]]:
    """Tests, hidden tests within their ranges, and hidden tests beyond."""
    random = np.random.default_rng((seed, 42))
    force, noise, scatter = PLANTS[name](random), 10.0 ** random.uniform(-3.0, -2.0), random.choice([0.0, 0.01, 0.02])
    amplitudes_m = np.geomspace(random.uniform(0.002, 0.006), random.uniform(0.012, 0.03), random.integers(2, 4))
    frequencies_Hz = np.geomspace(random.uniform(0.4, 0.8), random.uniform(2.0, 6.0), random.integers(2, 4))
    motions = list(product(amplitudes_m.tolist(), frequencies_Hz.tolist()))
    limit = random.uniform(1.3, 4.0) * float(np.median([a * f for a, f in motions]))
    motions = [(a, f) for a, f in motions if a * f <= limit]
    levels_A = np.linspace(0.0, random.uniform(1.0, 2.0), random.integers(3, 6)).tolist()

    def test(amplitude_m: float, frequency_Hz: float, current_A: float) -> Measurement:
        cycle = round(RATE_Hz / frequency_Hz)
        t = np.arange(-2 * cycle * FINER, CYCLES * cycle * FINER) / (FINER * RATE_Hz)
        rate = 2.0 * np.pi * frequency_Hz
        u, v = amplitude_m * np.sin(rate * t), amplitude_m * rate * np.cos(rate * t)
        force_N = force(u, v, -(rate**2) * u, current_A, 1.0 / (FINER * RATE_Hz))
        u, v, force_N = (each[2 * cycle * FINER :: FINER] for each in (u, v, force_N))
        noise_N = noise * float(np.max(np.abs(force_N)))
        force_N = force_N * (1.0 + scatter * random.standard_normal()) + random.normal(0.0, noise_N, u.size)
        return Measurement(
            id=f"{1e3 * amplitude_m:.1f} mm {frequency_Hz:.2f} Hz {current_A:.2f} A", u_m=u, v_m_s=v,
            a_m_s2=-(rate**2) * u, force_N=force_N, current_A=np.full(u.size, current_A), dt_s=1.0 / RATE_Hz,
            amplitude_m=amplitude_m, frequency_Hz=frequency_Hz, nominal_current_A=current_A, noise_N=noise_N,
            samples_per_cycle=cycle,
        )  # fmt: skip

    tests = [test(*motion, current_A) for motion, current_A in product(motions, levels_A)]
    fastest, hidden = max(a * f for a, f in motions), []
    while len(hidden) < HIDDEN:
        amplitude_m = float(np.exp(random.uniform(*np.log(amplitudes_m[[0, -1]]))))
        frequency_Hz = float(np.exp(random.uniform(*np.log(frequencies_Hz[[0, -1]]))))
        current_A = float(random.choice(levels_A) if len(hidden) % 2 else random.uniform(0.0, levels_A[-1]))
        if amplitude_m * frequency_Hz <= fastest:
            hidden.append(test(amplitude_m, frequency_Hz, current_A))
    outside = [test(times * float(amplitudes_m[-1]), fastest / float(amplitudes_m[-1]), levels_A[-1])
               for times in np.linspace(1.5, 3.0, BEYOND)]  # fmt: skip
    return tests, hidden, outside


def held(fit: Fit, fitted: list[Measurement], hidden: list[Measurement]) -> Iterator[tuple[float, float, float]]:
    """Of each hidden test: share of samples in the band, in that of the residuals; half width (% of peak)."""
    assert fit.tested is not None
    before = error_band(fit.law, fitted, [], "", to_the_noise=False)
    for test in map(first_cycle, hidden):
        motion = {"displacement_m": test.u_m, "velocity_m_s": test.v_m_s, "current_A": test.current_A}
        outside = fit.tested.outside(motion)
        kept = test.scored & ~np.any([np.zeros(test.u_m.size, bool), *outside.values()], axis=0)
        if not np.any(kept) or beyond(fit.tested, test) or not fit.tested.band.of_predictions:
            continue
        error_N = np.abs(test.force_N - fit.law.force_of(test))[kept]
        half_N = fit.tested.band.at(test.current_A)[kept]
        yield (
            float(np.mean(error_N <= half_N)), float(np.mean(error_N <= before.at(test.current_A)[kept])),
            100.0 * float(np.mean(half_N)) / test.peak_force_N,
        )  # fmt: skip


def row(what: str, found: list[tuple[float, float, float]], cpu_s: float, none: int) -> None:
    """One line of the table."""
    if not found:
        print(f"| {what} | 0 | - | - | - | - | {none} | {cpu_s:.1f} |", flush=True)
        return
    share, before, width = np.array(found).T
    print(
        f"| {what} | {share.size} | **{100 * np.mean(share):.1f}** | {100 * np.mean(before):.1f} | "
        f"{100 * np.mean(share < POOR):.0f} / {100 * np.mean(before < POOR):.0f} | {np.mean(width):.1f} | {none} | "
        f"{cpu_s:.1f} |", flush=True,
    )  # fmt: skip


def with_bands_beyond(fit: Fit, outside: list[Measurement]) -> int:
    """How many samples beyond the tested range have a band all the same."""
    count = 0
    for test in outside:
        table = {
            "time_s": np.arange(test.u_m.size) * test.dt_s, "displacement_m": test.u_m, "velocity_m_s": test.v_m_s,
            "current_A": test.current_A,
        }  # fmt: skip
        predicted = fit.predict(table)
        count += int(predicted.loc[predicted["extrapolates"], "low_N"].notna().sum())
    return count


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["measured", "simulated"])
    parser.add_argument("models", nargs="*", default=["asymmetric", "thinning_bouc_wen"])
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--first", type=int, default=0)
    given = parser.parse_args()
    print(f"{utc_now().date()}, {machine()}\n")
    print(
        "| plant, model | hidden tests | in the band, % | in the residuals' | tests below 80 % | half width, % of peak "
        "| no band | CPU s |\n|---|---|---|---|---|---|---|---|"
    )
    everything: list[tuple[float, float, float]] = []
    began = time.process_time()
    if given.what == "measured":
        tests = measured(Path(os.environ["RIG_MEASURED_DATA"]))
        motions = sorted({(round(each.amplitude_m, 4), round(each.frequency_Hz, 2)) for each in tests})
        for name in given.models:
            found, none, started = [], 0, time.process_time()
            for motion in motions:
                out = [each for each in tests if (round(each.amplitude_m, 4), round(each.frequency_Hz, 2)) == motion]
                kept = [each for each in tests if not any(each is other for other in out)]
                one = list(held(identify(kept, model=name, diagnose=False), kept, out))
                found, none = [*found, *one], none + len(out) - len(one)
            row(f"measured, {name}", found, time.process_time() - started, none)
            everything += found
    else:
        false = 0
        for plant, name in product(PLANTS, given.models):
            found, none, started = [], 0, time.process_time()
            for seed in range(given.first, given.first + given.seeds):
                tests, hidden, outside = campaign(plant, seed)
                try:
                    fit = identify(tests, model=name, diagnose=False)
                except IdentificationFailed as error:
                    print(f"{plant} {seed} {name}: {error}")
                    continue
                one = list(held(fit, tests, hidden))
                found, none = [*found, *one], none + len(hidden) - len(one)
                false += with_bands_beyond(fit, outside)
            row(f"{plant}, {name}", found, time.process_time() - started, none)
            everything += found
        print(f"\nsamples beyond the tested range that have a band: {false}\n")
    row("all", everything, time.process_time() - began, 0)


if __name__ == "__main__":
    main()

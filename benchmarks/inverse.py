"""The inverse on simulated plants: error of the current, and of the force that a controller makes a lagging coil give.

    python benchmarks/inverse.py
    python benchmarks/inverse.py --plant sprung_bouc_wen --drawn 6

The first simulates Table 1 of each plant (5 N of noise), fits the plant's own model, and then, on
a motion and a current that no test had: finds the current from force (5 N of noise) and motion, its error over the
samples where the force is attainable and tells the current, in % of the current's range; and lets the controller track
a force at 1 kHz through a coil of eta = 25 1/s, its error over the samples where, besides, the coil can follow, in % of
the peak force. The second finds the current alone, of so many plants whose forces, dampings and stiffnesses are
drawn about the demonstration's (a third of them, one standard deviation), each with noise of its own.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import replace

import numpy as np

from rig.dampers import model
from rig.dampers.kernel import advance_of
from rig.identification import Estimate, Fit, Measurement, identify

PLANTS = (
    "asymmetric", "kwok", "bouc_wen", "normalized_bouc_wen", "modified_bouc_wen", "lost_motion", "sprung_bouc_wen",
    "thixotropic_bouc_wen",
)  # fmt: skip
CURRENTS_A, FREQUENCIES_HZ = (0.0, 0.5, 1.0, 1.5, 2.0), (0.5, 1.0, 1.5, 2.0)
RATE_HZ, NOISE_N, ETA_1_S = 250.0, 5.0, 25.0
Arrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def measured(name: str, values: dict[str, float], seed: int = 0) -> list[Measurement]:
    """Table 1 of a damper, 30 mm, the first cycle left out."""
    rng, damper, tests = np.random.default_rng(seed), model(name), []
    for current_A in CURRENTS_A:
        for frequency_Hz in FREQUENCIES_HZ:
            omega = 2.0 * math.pi * frequency_Hz
            t = np.arange(round(5.0 / frequency_Hz * RATE_HZ)) / RATE_HZ
            u, v = 0.03 * np.sin(omega * t), 0.03 * omega * np.cos(omega * t)
            a, amps = -(omega**2) * u, np.full(t.size, current_A)
            force = damper.force(values, u, v, a, amps, 1.0 / RATE_HZ) + rng.normal(0.0, NOISE_N, t.size)
            kept = slice(round(RATE_HZ / frequency_Hz), None)
            arrays = (part[kept] for part in (u, v, a, force, amps))
            tests.append(Measurement(
                f"{current_A:g}A{frequency_Hz:g}Hz", *arrays, 1.0 / RATE_HZ, amplitude_m=0.03, noise_N=NOISE_N,
                frequency_Hz=frequency_Hz, nominal_current_A=current_A, samples_per_cycle=round(RATE_HZ / frequency_Hz),
            ))  # fmt: skip
    return tests


def ride() -> Arrays:
    """Time (s), extension, velocity and acceleration of two sines that do not repeat together, 4 s at 1 kHz."""
    t = np.arange(0.0, 4.0, 1e-3)
    parts = [(0.018, 0.9, 0.0), (0.006, 2.3, 1.0)]
    turns = [(size, 2.0 * math.pi * rate, phase) for size, rate, phase in parts]
    u = sum(size * np.sin(omega * t + phase) for size, omega, phase in turns)
    v = sum(size * omega * np.cos(omega * t + phase) for size, omega, phase in turns)
    a = -sum(size * omega**2 * np.sin(omega * t + phase) for size, omega, phase in turns)
    return t, np.asarray(u), np.asarray(v), np.asarray(a)


def plant_force(name: str, values: dict[str, float], motion: Arrays, coil_A: np.ndarray) -> np.ndarray:
    """The plant's force (N), shape (n,)."""
    _, u, v, a = motion
    return np.asarray(model(name).force(values, u, v, a, coil_A, 1e-3))


def current_error(
    fit: Fit, force: np.ndarray, motion: Arrays, coil_A: np.ndarray, seed: int = 1
) -> dict[str, float]:
    """Error of the current (% of its range), and how many samples it is stated for (%)."""
    t, u, v, a = motion
    noisy = force + np.random.default_rng(seed).normal(0.0, NOISE_N, t.size)
    answer = fit.inverse(noisy, v, u, time_s=t, acceleration_m_s2=a)
    counted = (answer["attainable"] & answer["resolvable"]).to_numpy()
    error_A = (answer["current_A"].to_numpy() - coil_A)[counted]
    held = (answer["low_A"].to_numpy() <= coil_A) & (coil_A <= answer["high_A"].to_numpy())
    percent = 100.0 / (CURRENTS_A[-1] - CURRENTS_A[0])
    return {
        "current_rms_percent": percent * float(np.sqrt(np.mean(error_A**2))),
        "in_band_percent": 100.0 * float(np.mean(held[counted])), "stated_percent": 100.0 * float(np.mean(counted)),
    }  # fmt: skip


def tracking_error(
    fit: Fit, name: str, values: dict[str, float], motion: Arrays, target: np.ndarray
) -> dict[str, float]:
    """Error of the force that the controller makes (% of the peak), and for how many samples it is stated (%)."""
    t, u, v, a = motion
    damper, stays = model(name), math.exp(-ETA_1_S * 1e-3)
    advance, p, state = advance_of(damper), damper.vector(values), damper.initial_state(float(u[0]))
    controller = fit.controller(1e-3, limits_A=(0.0, 5.0))
    coil, command, given, counted = 0.0, 0.0, [], []
    for k in range(t.size):
        coil = stays * coil + (1.0 - stays) * command
        given.append(float(advance(p, state, u[k], v[k], a[k], coil, 1e-3 if k else 0.0)))
        step = controller.step(float(target[k]), float(u[k]), float(v[k]), float(a[k]))
        command = step.command_A
        counted.append(step.attainable and step.resolvable and abs(step.target_A - step.coil_A) < 0.05)
    good = np.array(counted)
    error = (np.array(given) - target)[good]
    return {
        "tracking_rms_percent": 100.0 * float(np.sqrt(np.mean(error**2)) / np.max(np.abs(target))),
        "tracked_percent": 100.0 * float(np.mean(good)),
    }  # fmt: skip


def drawn(name: str, seed: int, motion: Arrays, coil_A: np.ndarray) -> dict[str, float]:
    """`current_error` of a plant with parameters and noise of its own."""
    rng, values = np.random.default_rng((seed, 5)), dict(model(name).demonstration)
    for parameter in model(name).parameters:
        if parameter.unit.startswith("N"):
            values[parameter.name] *= math.exp(rng.normal(0.0, 1.0 / 3.0))
    fit = identify(measured(name, values, seed), model=name, diagnose=False)
    return current_error(fit, plant_force(name, values, motion, coil_A), motion, coil_A, 1000 + seed)


def main() -> None:
    """Print one line a plant as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plant", choices=PLANTS, action="append")
    parser.add_argument("--drawn", type=int, default=0, help="plants with drawn parameters, their current alone")
    given, motion = parser.parse_args(), ride()
    coil_A = 1.0 + 0.8 * np.sin(2.0 * math.pi * 0.7 * motion[0])
    for name in given.plant or PLANTS:
        if given.drawn:
            rows = [drawn(name, seed, motion, coil_A) for seed in range(1, given.drawn + 1)]
            mean = {key: round(float(np.mean([row[key] for row in rows])), 2) for key in rows[0]}
            worst = {f"worst_{key}": round(max(row[key] for row in rows), 2) for key in ("current_rms_percent",)}
            least = {f"least_{key}": round(min(row[key] for row in rows), 2) for key in ("in_band_percent",)}
            print(json.dumps({"plant": name, "drawn": given.drawn, **mean, **worst, **least}), flush=True)
            continue
        values = dict(model(name).demonstration)
        fit = identify(measured(name, values), model=name)
        eta = {**fit.parameters, "eta": Estimate(ETA_1_S, "1/s")}
        force = plant_force(name, values, motion, coil_A)
        row = current_error(fit, force, motion, coil_A)
        row |= tracking_error(replace(fit, parameters=eta), name, values, motion, force)
        row |= {"invertible_from_m_s": fit.control_range().attrs["invertible_from_m_s"]}
        print(json.dumps({"plant": name, **{key: value and round(value, 3) for key, value in row.items()}}), flush=True)


if __name__ == "__main__":
    main()

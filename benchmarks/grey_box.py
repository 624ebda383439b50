"""The grey-box model: prediction error on plants outside the library and on a measured damper, energy of random drives.

    python benchmarks/grey_box.py plants                        the four plants of outside_plants.py
    RIG_MEASURED_DATA=DIR python benchmarks/grey_box.py measured [MODEL ...]
    python benchmarks/grey_box.py drives [--count 1000]         a free run and an inverse along random motions

plants: fitted to 20 tests (5 motions, 4 currents), judged on 9 tests of other motions and currents, which decide
nothing. measured: each motion of the shared UTFSM tests left out; model, parts and ridge chosen without it. drives: of
the fits to the plants, random motions of 0.1 to 1.5 times the tested amplitude at random currents: worst energy per
energy of the physical model alone, largest force over the largest tested one, and for the current that `inverse` finds
for half of the force range, how far the force then is from the requested one.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from campaign_process import machine
from measured_damper import measured
from outside_plants import CURRENTS_A, MOTIONS, PLANTS, UNSEEN_CURRENTS_A, UNSEEN_MOTIONS, campaign

from rig.clock import utc_now
from rig.dampers.arrays import FloatArray
from rig.dampers.grey_box import GreyBoxModel, physical
from rig.identification import Fit, identify
from rig.identification.cross_validation import pairs_of
from rig.identification.models.measurement import all_but

STEP_S, LASTS_S, TONES = 4e-3, 8.0, 12


def plants(names: Sequence[str]) -> None:
    """One line a plant: error on unseen tests with and without the residual, and CPU."""
    print("| plant | model | unseen, % of peak | best physical | ratio | CPU s |\n|---|---|---|---|---|---|")
    for name in names or PLANTS:
        unseen = campaign(name, UNSEEN_MOTIONS, UNSEEN_CURRENTS_A, 1)
        tests, began = campaign(name, MOTIONS, CURRENTS_A), time.process_time()
        fit = identify(tests, model="grey", holdout=unseen)
        cpu_s = time.process_time() - began
        own = min(
            one.holdout_nrmse_percent_of_peak for one in fit.selection
            if "+grey" not in one.model and one.holdout_nrmse_percent_of_peak is not None
        )  # fmt: skip
        assert fit.holdout is not None
        error = float(np.mean([one.nrmse_percent_of_peak for one in fit.holdout.per_test]))
        print(f"| {name} | {fit.model} | {error:.2f} | {own:.2f} | {error / own:.2f} | {cpu_s:.1f} |", flush=True)


def measured_pairs(names: Sequence[str]) -> None:
    """Leave-one-pair-out on the measured damper."""
    tests = measured(Path(os.environ["RIG_MEASURED_DATA"]))
    for name in names or ["thixotropic_bouc_wen", "thixotropic_bouc_wen+grey"]:
        errors, began = [], time.process_time()
        for motion, numbers in pairs_of(tests):
            left_out = [tests[number] for number in numbers]
            fit = identify(all_but(tests, numbers), model=name, holdout=left_out, diagnose=False)
            assert fit.holdout is not None
            pair = [one.nrmse_percent_of_peak for one in fit.holdout.per_test]
            errors += pair
            shown = " ".join(f"{error:5.1f}" for error in pair)
            print(f"  {motion.nominal}: {shown}  mean {np.mean(pair):.2f}  {fit.model}", flush=True)
        print(f"{name}: {np.mean(errors):.2f} % of peak, {time.process_time() - began:.0f} s of CPU", flush=True)


def motion_of(random: np.random.Generator, amplitude_m: float, top_m_s: float) -> tuple[FloatArray, FloatArray]:
    """Extension (m) and velocity (m/s) of a random periodic motion within these ends."""
    t = np.arange(0.0, LASTS_S, STEP_S)
    rates = 2.0 * np.pi / LASTS_S * random.integers(1, 40, TONES)
    size, phase = random.normal(size=TONES) / rates, random.uniform(0.0, 2.0 * np.pi, TONES)
    u, v = np.sin(np.outer(t, rates) + phase) @ size, np.cos(np.outer(t, rates) + phase) @ (size * rates)
    scale = min(amplitude_m / float(np.max(np.abs(u))), top_m_s / float(np.max(np.abs(v))))
    return scale * u, scale * v


def drives(count: int, names: Sequence[str]) -> None:
    """One line a plant: energy, force and inverse along random motions."""
    print("| plant | drives | least energy over the physical model's | energy made | largest force | inverse, RMS |")
    print("|---|---|---|---|---|---|")
    for name in names or PLANTS:
        fit = identify(campaign(name, MOTIONS, CURRENTS_A), model="grey", diagnose=False)
        print(_driven(name, fit, count), flush=True)


def _driven(name: str, fit: Fit, count: int) -> str:
    model, values, random = fit.damper, fit.known_values(), np.random.default_rng(9)
    own = model.of_base(values) if isinstance(model, GreyBoxModel) else values
    tested = fit.tested
    assert tested is not None
    largest_N = max(float(np.max(np.abs(test.force_N))) for test in fit.tests)
    least, made, most, misses = np.inf, 0, 0.0, []
    for number in range(count):
        size = random.uniform(0.1, 1.5)
        u, v = motion_of(random, size * tested.displacement_m[1], size * tested.velocity_m_s[1])
        a, current_A = np.gradient(v, STEP_S), random.uniform(*tested.current_A)
        force_N = model.force(values, u, v, a, current_A, STEP_S)
        # The second period of the motion: the states have forgotten their start.
        twice = [np.tile(each, 2) for each in (u, v, a)]
        energy, alone = (
            float(np.sum(one.force(known, *twice, current_A, STEP_S)[u.size :] * v)) * STEP_S
            for one, known in ((model, values), (physical(model), own))
        )
        least, made = min(least, energy / alone), made + (energy < 0.0)
        most = max(most, float(np.max(np.abs(force_N)))) if np.all(np.isfinite(force_N)) else np.inf
        if number < count // 20:
            misses.append(_inverted(fit, u, v, largest_N))
    return f"| {name} | {count} | {least:.2f} | {made} | {most / largest_N:.2f} | {np.mean(misses):.2%} |"


def _inverted(fit: Fit, u: FloatArray, v: FloatArray, largest_N: float) -> float:
    """RMS of force minus requested force where that is attainable, over the largest tested force."""
    time_s = STEP_S * np.arange(u.size)
    requested = 0.5 * largest_N * np.tanh(v / 0.02)
    found = fit.inverse(requested, v, u, time_s=time_s)
    given = fit.simulate(time_s, u, found.current_A.to_numpy(), velocity_m_s=v).force_N.to_numpy()
    reached = found.attainable.to_numpy(dtype=bool)
    return float(np.sqrt(np.mean((given - requested)[reached] ** 2))) / largest_N if np.any(reached) else 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["plants", "measured", "drives"])
    parser.add_argument("names", nargs="*")
    parser.add_argument("--count", type=int, default=1000)
    given = parser.parse_args()
    print(f"{utc_now().date()}, {machine()}\n")
    if given.what == "plants":
        plants(given.names)
    elif given.what == "measured":
        measured_pairs(given.names)
    else:
        drives(given.count, given.names)


if __name__ == "__main__":
    main()

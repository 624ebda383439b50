"""Every model as the plant of `rig identify --model all`: which one is picked, and do its intervals hold the truth?

    python benchmarks/any_plant.py                                one random damper of each model
    python benchmarks/any_plant.py --seeds 3 --only lugre --only dahl

A damper is its model's demonstration with every value changed by up to a factor 1.4; its campaign is sines of two
amplitudes, two frequencies and four currents, with white noise of a thousandth to a hundredth of each test's peak. The
plant moves in eight times finer steps than the fit sees. Picked: the plant's own model, or one whose unseen tests are
as good to 1 %. Inside: true values in the stated 95 % intervals of the plant's own model.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from campaign_process import machine

from rig.clock import utc_now
from rig.dampers import MODELS, model
from rig.identification import Fit, Measurement, identify

FINER, RATE_Hz, CYCLES, EQUIVALENT = 8, 250.0, 3, 1.01


def campaign(name: str, seed: int) -> tuple[dict[str, float], list[Measurement]]:
    """True values, and the tests."""
    random, damper, tests = np.random.default_rng((seed, 11)), model(name), []
    truth = {key: value * 2.0 ** random.uniform(-0.5, 0.5) for key, value in damper.demonstration.items()}
    noise = 10.0 ** random.uniform(-3.0, -2.0)
    amplitudes_m = np.exp(random.uniform(np.log([0.003, 0.012]), np.log([0.008, 0.03])))
    frequencies_Hz = random.choice([0.5, 1.0, 1.25], 1).tolist() + random.choice([2.0, 2.5, 5.0], 1).tolist()
    for amplitude_m in amplitudes_m.tolist():
        for frequency_Hz in frequencies_Hz:
            for current_A in (0.0, 0.5, 1.0, 2.0):
                cycle = round(RATE_Hz / frequency_Hz)
                t = np.arange(-2 * cycle * FINER, CYCLES * cycle * FINER) / (FINER * RATE_Hz)
                rate = 2.0 * np.pi * frequency_Hz
                u, v = amplitude_m * np.sin(rate * t), amplitude_m * rate * np.cos(rate * t)
                current = np.full(t.size, current_A)
                force_N = damper.force(truth, u, v, -(rate**2) * u, current, 1.0 / (FINER * RATE_Hz))
                noise_N = noise * float(np.max(np.abs(force_N)))
                u, v, force_N, current = (each[2 * cycle * FINER :: FINER] for each in (u, v, force_N, current))
                tests.append(
                    Measurement(
                        id=f"p{len(tests) + 1:03d}", u_m=u, v_m_s=v, a_m_s2=-(rate**2) * u,
                        force_N=force_N + random.normal(0.0, noise_N, u.size), current_A=current,
                        dt_s=1.0 / RATE_Hz, amplitude_m=amplitude_m, frequency_Hz=frequency_Hz,
                        nominal_current_A=current_A, noise_N=noise_N, samples_per_cycle=cycle,
                    )
                )  # fmt: skip
    return truth, tests


def inside(fit: Fit, truth: dict[str, float]) -> tuple[int, list[str]]:
    """How many true values could be stated, and those that lie outside of their interval."""
    stated = {name: value for name, value in fit.parameters.items() if value.identifiable and value.low is not None}
    missed = [name for name, value in stated.items() if not value.low <= truth.get(name, value.value) <= value.high]
    return len(stated), missed


def main() -> None:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--seeds", type=int, default=1)
    arguments.add_argument("--first", type=int, default=0, help="first seed")
    arguments.add_argument("--only", choices=list(MODELS), action="append")
    given = arguments.parse_args()
    print(f"{utc_now().date()}, {machine()}\n")
    print("| plant | picked | its unseen tests | the plant's own | adequate | inside | missed | CPU s |")
    print("|---|---|---|---|---|---|---|---|")
    for name in given.only or MODELS:
        for seed in range(given.first, given.first + given.seeds):
            print(line(name, seed), flush=True)


def line(name: str, seed: int) -> str:
    """One line of the table."""
    truth, tests = campaign(name, seed)
    started = time.process_time()
    fit = identify(tests, model="all")
    cpu_s = time.process_time() - started
    errors = {one.model: one.holdout_nrmse_percent_of_peak for one in fit.selection}
    best, own = errors[fit.model], errors[name]
    picked = fit.model == name or (own is not None and best is not None and own <= EQUIVALENT * best)
    count, missed = inside(fit if fit.model == name else identify(tests, model=name), truth)
    cells = [
        name, fit.model if picked else f"**{fit.model}**",
        *("-" if error is None else f"{error:.3f}" for error in (best, own)),
        "yes" if fit.adequate else "no", f"{count - len(missed)} of {count}", ", ".join(missed), f"{cpu_s:.0f}",
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()

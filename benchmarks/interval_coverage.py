"""How often the stated 95 % intervals cover the true parameters, pooled over seeded campaigns.

    python benchmarks/interval_coverage.py                   100 campaigns on the simulated rig's plant and sensors
    python benchmarks/interval_coverage.py --campaigns 300
    python benchmarks/interval_coverage.py --set demo-sprung-bouc-wen --currents 0 0.7 1.3 2 --campaigns 24
    python benchmarks/interval_coverage.py --numpy --campaigns 1000
    python benchmarks/interval_coverage.py --numpy --one-frequency --campaigns 300

With `--numpy` truths, settings, noise and steps of force and displacement are random (`coverage_case.py`), and what is
falsely called not adequate is counted too; with `--one-frequency` m must never be stated.

Else each campaign is six points (two currents, three frequencies, six cycles) on a simulated rig of its own: clocks
and drifts, noise, filter corners, all random, that miss the declared delay by its tolerance (5 %), and in every fifth a
load-cell delay of 1 to 4 ms that the bench does not declare at all. Recorded, aligned and judged as in a run, fitted by
default settings. Counted over all identifiable parameters. `--set` is another damper for the plant, fitted with its own
model; what was not identified, and how often, is printed too.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from campaign_process import machine
from coverage_case import random_setting, record
from recorded_rig import RecordedRig

from rig.clock import utc_now
from rig.dampers import parameter_set
from rig.identification import Fit, identify
from rig.signals.delay_estimation.delay_model import DELAY_TOLERANCE
from simulators.options import DamperOptions, RigOptions

CURRENTS_A = (0.5, 1.5)
FREQUENCIES_Hz = (1.0, 1.5, 2.0)
FORGOTTEN_EVERY = 5


def options_of(seed: int, name: str) -> RigOptions:
    """A random rig; its sensors' corners differ from those the delays were declared for."""
    random = np.random.default_rng((seed, 1))
    options = replace(RigOptions(), damper=DamperOptions(set=name))
    changed = {}
    for name in ("load_cell", "lvdt"):
        sensor = getattr(options, name)
        off = np.exp(DELAY_TOLERANCE * random.standard_normal())
        skew_s = random.uniform(1e-3, 4e-3) if name == "load_cell" and seed % FORGOTTEN_EVERY == 0 else 0.0
        changed[name] = replace(
            sensor, clock_ppm=random.uniform(-300.0, 300.0), latency_s=random.uniform(0.0, 5e-3), skew_s=skew_s,
            bandwidth_Hz=sensor.bandwidth_Hz * off,
        )
    return replace(options, **changed)


def campaign(
    seed: int, speed: float, folder: Path, name: str = "demo", currents_A: Sequence[float] = CURRENTS_A
) -> tuple[dict[str, tuple[bool, float]], Fit]:
    """Whether each identifiable parameter's interval covers the truth, and its error in standard errors; the fit."""
    rig = RecordedRig(options_of(seed, name), speed=speed, seed=seed, declared_delays_s=(0.2251e-3, 0.4502e-3))
    points = []
    for number, (current_A, frequency_Hz) in enumerate(
        ((current, frequency) for current in currents_A for frequency in FREQUENCIES_Hz), start=1
    ):
        point = {
            "id": f"p{number:03}", "waveform": "sine", "amplitude_m": 0.03, "frequency_Hz": frequency_Hz,
            "current_A": current_A, "cycles": 6, "ramp_in_cycles": 1.0, "ramp_out_cycles": 1.0, "centre_m": 0.0,
            "repeat": 1, "rest_s": 0.0,
        }
        points.append(rig.run_point(point, folder)[0])
    fit = identify(points, model=parameter_set(name).model, diagnose=False)
    return _coverage(fit, rig.plant.values), fit


def numpy_campaign(seed: int, *, one_frequency: bool) -> tuple[dict[str, tuple[bool, float]], bool | None, bool]:
    """The same of a random campaign recorded in numpy; whether it was called adequate, and whether m was stated."""
    random = np.random.default_rng((seed, 11))
    setting = random_setting(random)
    if one_frequency:
        setting = replace(setting, frequencies_Hz=setting.frequencies_Hz[:1])
    fit = identify(record(setting, random), model=setting.model)
    return _coverage(fit, setting.values), fit.adequate, fit.parameters["m"].identifiable


def _coverage(fit: Fit, truth: Mapping[str, float]) -> dict[str, tuple[bool, float]]:
    found = {}
    for name in fit.identifiable:
        each = fit.parameters[name]
        if each.value is None or each.low is None or each.high is None or each.standard_error is None:
            continue
        found[name] = (each.low <= truth[name] <= each.high, (each.value - truth[name]) / each.standard_error)
    return found


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--campaigns", type=int, default=100)
    arguments.add_argument("--first", type=int, default=1, help="first seed")
    arguments.add_argument("--speed", type=float, default=1.0)
    arguments.add_argument("--numpy", action="store_true", help="random campaigns recorded in numpy")
    arguments.add_argument("--one-frequency", action="store_true", help="of each of those only the lowest frequency")
    arguments.add_argument("--set", default="demo", help="parameter set of the plant, fitted with its own model")
    arguments.add_argument("--currents", type=float, nargs="+", default=CURRENTS_A, help="in A")
    given = arguments.parse_args()
    seeds = range(given.first, given.first + given.campaigns)
    covered: dict[str, list[bool]] = defaultdict(list)
    scores: dict[str, list[float]] = defaultdict(list)
    missing: dict[str, int] = defaultdict(int)
    refused = stated = 0
    started = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        for seed in seeds:
            if given.numpy:
                found, adequate, with_m = numpy_campaign(seed, one_frequency=given.one_frequency)
                refused += adequate is not True
                stated += with_m
            else:
                found, fit = campaign(seed, given.speed, Path(folder), given.set, given.currents)
                refused += fit.adequate is not True
                for name in set(fit.parameters) - set(fit.identifiable):
                    missing[name] += 1
            for name, (inside, score) in found.items():
                covered[name].append(inside)
                scores[name].append(score)
    what = "random campaigns recorded in numpy" if given.numpy else f"campaigns, set {given.set}, speed {given.speed:g}"
    print(f"{utc_now().date()}, {machine()}; {given.campaigns} {what}")
    if given.numpy:
        each_s = (time.process_time() - started) / given.campaigns
        print(f"not adequate: {refused}; m stated: {stated}; {each_s:.2f} s of CPU each")
    else:
        print(f"not adequate: {refused}; not identified: {dict(missing)}")
    print("| parameter | covered | root mean square of error / standard error |\n|---|---|---|")
    for name, hits in covered.items():
        print(f"| {name} | {100 * np.mean(hits):.1f} % | {np.sqrt(np.mean(np.square(scores[name]))):.2f} |")
    pooled = 100 * float(np.mean([hit for hits in covered.values() for hit in hits]))
    print(f"| pooled | {pooled:.1f} % | |")
    wrong = given.numpy and (refused > 0.02 * given.campaigns or (given.one_frequency and stated > 0))
    return 0 if 92.0 <= pooled <= 98.0 and not wrong else 1


if __name__ == "__main__":
    sys.exit(main())

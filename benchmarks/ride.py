"""What the c-FOA paper says of its three fits (section 4.2), on its own fits, a simulated and a measured damper.

    python benchmarks/ride.py [--road NAME]                  its published fits; a simulated damper
    RIG_MEASURED_DATA=DIR python benchmarks/ride.py          the UTFSM tests too (see measured_damper.py)

A simulated damper (parameter set `demo`, the paper's Table 1, 5 N noise) and the measured one are fitted by c-FOA, GA
and PSO with the paper's budget (16,000 evaluations, 50 candidates, unbounded), and by this program's own method. Each
set is driven over the paper's sweep; printed are the largest differences of any two fits in each band and phase.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from measured_damper import measured

from rig import dampers
from rig.identification import identify
from rig.identification.models.measurement import Measurement
from rig.identification.models.problem import Problem
from rig.optimisers import minimise
from rig.study.recordings import table1
from rig.vehicle.car import load_car
from rig.vehicle.fitted_damper import FittedDamper, fitted_damper
from rig.vehicle.laws import Control
from rig.vehicle.motion import CornerDamper
from rig.vehicle.response import BANDS
from rig.vehicle.ride import NotComparable, RideStudy, ride_study
from rig.vehicle.road_file import load_road

METHODS = ("c_foa", "ga", "pso")
SEEDS = (1, 2, 3)


def searched(tests: Sequence[Measurement], method: str) -> FittedDamper:
    """The best of a few searches, as the paper takes its best."""
    problem = Problem(tests, "asymmetric", "v")
    start = np.ones(problem.n_parameters) if method == "c_foa" else None
    best = min((minimise(problem, method=method, start=start, seed=seed) for seed in SEEDS), key=lambda one: one.value)
    values = dict(zip(problem.names, map(float, best.best), strict=True))
    shown = ", ".join(f"{name} {value:.4g}" for name, value in values.items())
    print(f"  {method}: objective {best.value:.4g}; {shown}")
    values |= {"eta": 25.0, "m": max(0.0, values["m"])}
    return FittedDamper(method, CornerDamper(dampers.model("asymmetric"), values))


def separable(tests: Sequence[Measurement]) -> FittedDamper:
    """This program's own fit."""
    fit = identify(list(tests), model="asymmetric")
    values = {name: parameter.value for name, parameter in fit.parameters.items() if parameter.value is not None}
    start = {parameter.name: parameter.start for parameter in dampers.model("asymmetric").parameters}
    shown = ", ".join(f"{name} {value:.4g}" for name, value in values.items())
    print(f"  separable: {fit.error.nrmse_percent_of_peak:.2f} % of peak; {shown}")
    return FittedDamper("separable", CornerDamper(dampers.model("asymmetric"), {**start, **values, "eta": 25.0}))


def show(title: str, study: RideStudy) -> None:
    """One line a motion and band."""
    print(f"{title}, step {1e3 * study.step_s:g} ms{'' if study.step_close else ' (not small enough)'}")
    for motion in study.own.body:
        for band in BANDS:
            cells = []
            for phase in study.driven:
                known = [
                    (difference[0], pair) for pair in study.pairs()
                    if (difference := study.difference(phase, motion, band, pair)) is not None
                ]  # fmt: skip
                largest = max(known, default=None)
                cells.append(f"{phase} -" if largest is None else f"{phase} {largest[0]:.1f} ({'/'.join(largest[1])})")
            print(f"  {motion:5s} {band:8s} " + "   ".join(cells))
    print("  weighted heave RMS m/s^2: " + ", ".join(
        f"{variant.name} {study.number(variant.name, 'weighted_rms heave')[0]:.3f}" for variant in study.variants
    ), flush=True)


def drive(title: str, fits: Sequence[FittedDamper], currents_A: Sequence[float], road: str) -> None:
    """The fits at each current."""
    for current_A in currents_A:
        try:
            study = ride_study(load_car("compact-suv"), load_road(road), fits, [Control(current_A=current_A)])
        except NotComparable as problem:
            print(f"{title}, {current_A:g} A: {problem}")
            continue
        show(f"{title}, {current_A:g} A", study)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--road", default="paper-sweep")
    parser.add_argument("--only", choices=("paper", "simulated", "measured"))
    arguments = parser.parse_args()
    if arguments.only in {None, "paper"}:
        published = [fitted_damper(f"cfoa-table5-fit{count}", 0) for count in (1, 2, 3)]
        drive("the paper's fits", published, (0.0, 0.5, 1.0), arguments.road)
    if arguments.only in {None, "simulated"}:
        print("simulated damper")
        tests = table1("demo", 5.0, 1)
        truth = FittedDamper("truth", fitted_damper("demo", 0).damper)
        fits = [truth, separable(tests), *(searched(tests, method) for method in METHODS)]
        drive("simulated damper", fits, (0.0, 1.0), arguments.road)
    if arguments.only in {None, "measured"} and "RIG_MEASURED_DATA" in os.environ:
        print("measured damper")
        tests = measured(Path(os.environ["RIG_MEASURED_DATA"]))
        fits = [separable(tests), *(searched(tests, method) for method in METHODS)]
        drive("measured damper", fits, (0.0, 1.0), arguments.road)


if __name__ == "__main__":
    main()

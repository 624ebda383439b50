"""How fast a full car with four nonlinear dampers runs: one ride on one core, and an ensemble of many in parallel.

    python benchmarks/vehicle.py [--members 1000] [--seconds 20]

7 degrees of freedom, steps of 1 ms, ISO 8608 class C at 20 m/s, passive at 1 A. CPU time beside wall time: on a busy
machine only the first says what the code needs. The ensemble's members have every parameter drawn within 5 %.
"""

from __future__ import annotations

import argparse
import os
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from rig import dampers
from rig.vehicle.car import load_car
from rig.vehicle.laws import Control
from rig.vehicle.motion import CornerDamper, DrivenCar
from rig.vehicle.road_file import load_road
from rig.vehicle.structure import Structure, structure

SETS = ("cfoa-table5-fit1", "cfoa-table5-fit2", "cfoa-table5-fit3", "demo", "demo-bouc-wen", "demo-lost-motion")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--members", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=20.0)
    arguments = parser.parse_args()
    own = structure(load_car("compact-suv"))
    steps = round(arguments.seconds / 1e-3) + 1
    _, height, rate = (array[:steps] for array in load_road("iso8608-c").under(own.car, 1e-3))
    for name in SETS:
        values = dampers.parameter_set(name)
        damper = CornerDamper(dampers.model(values.model, values.hysteresis), dict(values.values))
        car = DrivenCar(own, damper, control=Control(current_A=1.0))
        car.drive(height[:10], rate[:10], 1e-3)
        cpu, wall = time.process_time(), time.monotonic()
        car.drive(height, rate, 1e-3)
        cpu, wall = time.process_time() - cpu, time.monotonic() - wall
        print(
            f"{name}: {arguments.seconds / cpu:.0f} x real time by CPU, {arguments.seconds / wall:.0f} x by the clock"
        )
    ensemble(own, (height, rate), arguments.members, arguments.seconds)


def ensemble(own: Structure, road: tuple[np.ndarray, np.ndarray], members: int, seconds: float) -> None:
    """Many rides with other parameters, by 1 thread and by one a core."""
    values, random = dampers.parameter_set("cfoa-table5-fit1"), np.random.default_rng(1)
    model = dampers.model(values.model, values.hysteresis)
    drawn = [
        {name: value * (1.0 + 0.05 * random.uniform(-1.0, 1.0)) for name, value in values.values.items()}
        for _ in range(members)
    ]

    def drive(one: dict[str, float]) -> float:
        ride = DrivenCar(own, CornerDamper(model, one), control=Control(current_A=1.0)).drive(*road, 1e-3)
        return float(np.std(ride.acceleration[:, 0]))

    for threads, share in ((1, drawn[: max(1, members // 10)]), (os.cpu_count() or 1, drawn)):
        cpu, wall = time.process_time(), time.monotonic()
        with ThreadPoolExecutor(threads) as pool:
            answers = list(pool.map(drive, share))
        cpu, wall = time.process_time() - cpu, time.monotonic() - wall
        ridden_s = seconds * len(answers)
        print(
            f"{len(answers)} members, {threads} threads: {wall:.1f} s, {ridden_s / wall:.0f} x real time by the clock, "
            f"{ridden_s / cpu:.0f} x by CPU; heave {np.mean(answers):.3f} +- {np.std(answers):.3f} m/s^2"
        )


if __name__ == "__main__":
    main()

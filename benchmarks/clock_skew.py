"""Skew between force and displacement after correction, against the truth, over random clocks and latencies.

    python benchmarks/clock_skew.py                   60 settings of each kind
    python benchmarks/clock_skew.py --settings 200

Each setting draws clock offsets over the counters' whole range, drifts of +-300 ppm, transport latencies of 0 to 5 ms
with bursts, sampling jitter, filter corners, and records one point. Kinds:

- `edge`: the cycle pulse latched in the sensors' clocks.
- `edge+forgotten`: the same with up to 5 ms of delay in the load cell's conditioner that the bench does not declare.
- `device clock`: no edges; the clocks are tied by the signals themselves, over the controller's own record.
- `arrival`: neither edges nor a controller's record to rely on: arrival times only, at speed 1.

Error: lag of the corrected force over the plant's true force, less the same for displacement; both by least squares on
25 us of grid. Covered: within 1.96 of the stated standard deviations.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from campaign_process import machine
from recorded_rig import RecordedRig, Truth

from rig.clock import utc_now
from rig.recording.recorded_point import RecordedPoint
from simulators.options import RigOptions

KINDS = ("edge", "edge+forgotten", "device clock", "arrival")
POINT = {
    "id": "p001", "waveform": "sine", "amplitude_m": 0.03, "frequency_Hz": 2.0, "current_A": 1.5, "cycles": 10,
    "ramp_in_cycles": 1.0, "ramp_out_cycles": 1.0, "centre_m": 0.0, "repeat": 1, "rest_s": 0.0,
}


@dataclass(frozen=True)
class Result:
    """One setting: error of the skew left after correction and its stated standard deviation (s)."""

    error_s: float
    std_s: float
    found_s: float
    set_s: float


def settings(seed: int, kind: str) -> RigOptions:
    """A random rig."""
    random = np.random.default_rng((seed, KINDS.index(kind)))
    options = RigOptions()
    changed = {}
    for name in ("load_cell", "lvdt"):
        sensor = getattr(options, name)
        forgotten = kind == "edge+forgotten" and name == "load_cell"
        changed[name] = replace(
            sensor, clock_ppm=random.uniform(-300.0, 300.0), latency_s=random.uniform(0.0, 5e-3),
            burst_rate_Hz=random.uniform(0.0, 1.0), burst_s=random.uniform(2e-3, 20e-3),
            jitter_s=random.uniform(0.0, 20e-6), bandwidth_Hz=sensor.bandwidth_Hz * random.uniform(0.95, 1.05),
            latches_edges=kind.startswith("edge"), skew_s=random.uniform(0.0, 5e-3) if forgotten else 0.0,
        )
    return replace(options, controller=replace(options.controller, clock_ppm=random.uniform(-100.0, 100.0)), **changed)


def one(seed: int, kind: str, speed: float, folder: Path) -> Result:
    """Record a point on a random rig and measure what skew is left in it."""
    options = settings(seed, kind)
    rig = RecordedRig(
        options, speed=1.0 if kind == "arrival" else speed, seed=seed, declares_input_delay=kind != "arrival",
        wake_up_s=3e-4, declared_delays_s=(0.2251e-3, 0.4502e-3),
    )
    point, truth = rig.run_point(POINT, folder)
    error_s = lag(point, truth, "force") - lag(point, truth, "displacement")
    return Result(error_s, point.skew_std_s, point.skew_s, options.load_cell.skew_s)


def lag(point: RecordedPoint, truth: Truth, name: str) -> float:
    """By how much a corrected channel's own samples lag the plant's true values (s)."""
    raw = point.raw(name)
    if raw is None:
        raise ValueError(f"{name} is missing")
    time_s = raw["time"] + float(point.test["controller_clock_at_zero_s"])
    quality = point.quality
    first = (quality.motion.start_s or 0.0) + float(point.test["controller_clock_at_zero_s"])
    last = (quality.motion.end_s or 0.0) + float(point.test["controller_clock_at_zero_s"])
    inside = (time_s > first) & (time_s < last)
    time_s, value = time_s[inside], raw["value"][inside]
    true = truth.force_N if name == "force" else truth.displacement_m

    def misfit(lag_s: float) -> float:
        return float(np.sum((value - np.interp(time_s - lag_s, truth.controller_s, true)) ** 2))

    centre, reach = 0.0, 12e-3
    while reach > 1e-7:
        tried = centre + np.linspace(-reach, reach, 25)
        centre = float(tried[np.argmin([misfit(each) for each in tried])])
        reach /= 6.0
    return centre


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--settings", type=int, default=60)
    arguments.add_argument("--speed", type=float, default=1.0, help="of all kinds but `arrival`")
    arguments.add_argument("--kind", choices=KINDS, action="append")
    given = arguments.parse_args()
    print(f"{utc_now().date()}, {machine()}; {given.settings} settings a kind, speed {given.speed:g} (arrival: 1)")
    print("| kind | error, median | 95 % of errors below | largest | stated std, median | covered by 95 % interval |")
    print("|---|---|---|---|---|---|")
    good = True
    with tempfile.TemporaryDirectory() as folder:
        for kind in given.kind or KINDS:
            results = [one(seed, kind, given.speed, Path(folder)) for seed in range(given.settings)]
            errors = np.abs([each.error_s for each in results])
            covered = np.mean([abs(each.error_s) <= 1.96 * each.std_s for each in results])
            std = float(np.median([each.std_s for each in results]))
            row = [1e6 * np.median(errors), 1e6 * np.quantile(errors, 0.95), 1e6 * errors.max(), 1e6 * std]
            cells = [*(f"{value:.1f} us" for value in row), f"{100 * covered:.0f} %"]
            print(f"| {kind} | " + " | ".join(cells) + " |", flush=True)
            good = good and covered >= 0.9
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

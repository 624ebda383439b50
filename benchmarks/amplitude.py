"""Amplitude after compensation, against the truth, over random servos: `python benchmarks/amplitude.py`.

    python benchmarks/amplitude.py                  100 servos
    python benchmarks/amplitude.py --servos 300

Each servo has a bandwidth of 6 to 40 Hz, damping of 0.4 to 1, a valve for 0.3 to 1.5 m/s, and a position sensor of its
own that differs from the LVDT by a gain of +-10 % and an offset of +-3 mm; its position loop is 5 to 100 kN/mm stiff,
so that the damper's force takes its share. Each runs three random sines or triangles that the plan accepts on the demo
bench, each at two currents in turn, as a campaign does: what is learned serves the next.

Error: true amplitude of the program that would be recorded, over the wanted one; true mean, over the wanted amplitude.
A motion is one the machine can make when it reaches 99 % of the wanted amplitude with the largest command that is
allowed about the centre it needs.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from campaign_process import machine
from recorded_rig import RecordedRig, Truth

from rig.bench.model import Bench
from rig.campaign.execution.observer import MotionMeasurement, RequestedMotion
from rig.campaign.sequencer.event import MeasuredMotion
from rig.campaign.sequencer.point_preparation import (
    MOST_STEPS,
    commanded,
    drive_for,
    learned,
    remembered,
    trial,
    wants_trial,
)
from rig.campaign.sequencer.state import Ceiling, Drive, Drives, conditions_of
from rig.clock import utc_now
from rig.matrix.model import Matrix
from rig.matrix.plan import plan
from rig.recording.journal.ring_reader import RecordBlock
from rig.test_point import TestPoint
from simulators.options import RigOptions

BENCH = Path(__file__).parents[1] / "examples" / "demo-bench.toml"
SPEED = 50.0
TOLERANCE = 0.01
POINTS_A_SERVO = 3
CURRENTS_A = (0.0, 2.0, 0.0)
TRIANGLE_FUNDAMENTAL = 8.0 / math.pi**2


@dataclass(frozen=True)
class Result:
    """One motion: errors of true amplitude and mean (relative), corrections, programs, and how it ended."""

    servo: int
    point: TestPoint
    amplitude_error: float
    mean_error: float
    steps: int
    programs: int
    cannot: str
    could: bool


class Machine:
    """A servo whose own position sensor shows `(x - offset) / gain` where the LVDT shows x."""

    def __init__(self, seed: int) -> None:
        random = np.random.default_rng((seed, 5))
        options = RigOptions()
        servo = replace(
            options.servo, bandwidth_Hz=math.exp(random.uniform(math.log(6.0), math.log(40.0))),
            damping=random.uniform(0.4, 1.0), rated_speed_m_s=random.uniform(0.3, 1.5),
            stiffness_N_m=math.exp(random.uniform(math.log(5e6), math.log(100e6))),
        )
        self.gain, self.offset_m = random.uniform(0.9, 1.1), random.uniform(-3e-3, 3e-3)
        self.rig = RecordedRig(replace(options, servo=servo), speed=SPEED, seed=seed)
        self.rate_Hz = options.lvdt.rate_Hz

    def run(self, program: TestPoint) -> tuple[MeasuredMotion, Truth]:
        """Run a program: what the campaign sees of it, and the truth.

        Raises:
            RuntimeError: not a full cycle was seen.
        """
        ordered: dict[str, Any] = {
            **vars(program), "amplitude_m": self.gain * program.amplitude_m,
            "centre_m": self.gain * program.centre_m + self.offset_m,
        }
        records, truth = self.rig.run_program(ordered)
        sight = MotionMeasurement(RequestedMotion(program.waveform, program.frequency_Hz, self.rate_Hz))
        sight.add(RecordBlock(records))
        seen = sight.motion()
        if seen is None:
            raise RuntimeError(f"no full cycle of {program}")
        return seen, truth

    def could(self, point: TestPoint, ceiling: Ceiling) -> bool:
        """Whether the largest command allowed about the centre that the point needs reaches its amplitude."""
        shift_m = (point.centre_m - self.offset_m) / self.gain - point.centre_m
        largest_m, moved_m, _ = ceiling.allowed(point, 1.0, shift_m)
        if abs(moved_m - shift_m) > TOLERANCE * point.amplitude_m:
            return False
        strongest = replace(point, amplitude_m=largest_m, centre_m=point.centre_m + moved_m)
        return true_motion(self.run(strongest)[1], point)[0] >= (1.0 - TOLERANCE) * point.amplitude_m


def true_motion(truth: Truth, point: TestPoint) -> tuple[float, float]:
    """True amplitude and mean (m) of the full cycles, from the plant's own position."""
    t, u = truth.controller_s, truth.displacement_m
    middle_m = 0.5 * (float(np.max(u)) + float(np.min(u)))
    large = t[np.abs(u - middle_m) > 0.9 * (float(np.max(u)) - middle_m)]
    middle_s, period_s = 0.5 * float(large[0] + large[-1]), 1.0 / point.frequency_Hz
    # Two whole periods in the middle of the program, where neither ramp has any part.
    inside = np.abs(t - middle_s) < period_s
    part = u[inside]
    mean_m = float(np.mean(part))
    if point.waveform == "triangle":
        turn = np.exp(-2j * math.pi * point.frequency_Hz * t[inside])
        return 2.0 * abs(complex(np.mean((part - mean_m) * turn))) / TRIANGLE_FUNDAMENTAL, mean_m
    return 0.5 * float(np.ptp(part)), mean_m


def drawn_point(random: np.random.Generator, number: int, bench: Bench) -> tuple[TestPoint, Ceiling]:
    """A random motion that the plan accepts, and what may be commanded for it."""
    while True:
        matrix = Matrix.model_validate({
            "format": 1, "specimen": {"serial_number": "S", "stroke": "170 mm"},
            "matrix": {
                "waveform": (str(random.choice(["sine", "triangle"])),),
                "amplitude": (f"{math.exp(random.uniform(0.0, math.log(80.0))):.1f} mm",),
                "frequency": (f"{math.exp(random.uniform(math.log(0.2), math.log(6.0))):.2f} Hz",),
                "current": (f"{random.uniform(0.0, 2.0):.2f} A",), "cycles": 6,
            },
        })
        if plan(matrix, bench).feasible:
            (point,) = matrix.points()
            return replace(point, id=f"p{number:03d}"), conditions_of(matrix, bench).ceilings[point.id]


def adapted(machine_under_test: Machine, point: TestPoint, ceiling: Ceiling, known: Drives) -> tuple[Drive, Truth, int]:
    """Run a point as the sequencer does; returns its drive, the truth of the recorded program, how many programs."""
    programs = 0
    while True:
        drive, tried = drive_for(point, known, ceiling), wants_trial(point, known, TOLERANCE)
        seen, truth = machine_under_test.run(trial(point, drive) if tried else commanded(point, drive))
        programs += 1
        drive = learned(drive, point, seen, TOLERANCE, ceiling)
        known = remembered(known, drive)
        if drive.settled and not tried:
            return drive, truth, programs


def results_of(seed: int, bench: Bench) -> list[Result]:
    """Three motions on one servo, each at two currents, in turn."""
    random, servo = np.random.default_rng((seed, 6)), Machine(seed)
    known: Drives = ()
    results = []
    drawn = [drawn_point(random, number, bench) for number in range(1, POINTS_A_SERVO + 1)]
    turns = [(replace(point, current_A=current_A), ceiling) for point, ceiling in drawn for current_A in CURRENTS_A]
    for point, ceiling in turns:
        drive, truth, programs = adapted(servo, point, ceiling, known)
        known = remembered(known, drive)
        amplitude_m, mean_m = true_motion(truth, point)
        results.append(Result(
            seed, point, amplitude_m / point.amplitude_m - 1.0, (mean_m - point.centre_m) / point.amplitude_m,
            drive.steps, programs, drive.cannot, not drive.cannot or servo.could(point, ceiling),
        ))
    return results


def main() -> int:
    """Print the table; 1 when a motion that the machine can make is not within the tolerance."""
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--servos", type=int, default=100)
    given = arguments.parse_args()
    bench = Bench.load(BENCH)
    results = [result for seed in range(given.servos) for result in results_of(seed, bench)]
    made = [result for result in results if not result.cannot]
    errors = np.array([max(abs(result.amplitude_error), abs(result.mean_error)) for result in made])
    print(f"{utc_now().date()}, {machine()}; {given.servos} servos, {len(results)} motions")
    print("| corrections | motions | error, median | largest |")
    print("|---|---|---|---|")
    for steps in range(MOST_STEPS + 1):
        own = errors[[result.steps == steps for result in made]]
        if own.size:
            print(f"| {steps} | {own.size} | {100 * np.median(own):.2f} % | {100 * np.max(own):.2f} % |")
    refused = [result for result in results if result.cannot]
    wrongly = [result for result in refused if result.could]
    outside = [result for result in made if max(abs(result.amplitude_error), abs(result.mean_error)) > TOLERANCE]
    print(f"machine cannot: {len(refused)}, of which it could: {len(wrongly)}; called good, but beyond: {len(outside)}")
    for result in (*wrongly, *outside):
        point = result.point
        print(
            f"servo {result.servo}, {point.waveform} {1e3 * point.amplitude_m:g} mm {point.frequency_Hz:g} Hz: "
            f"amplitude {100 * result.amplitude_error:+.2f} %, mean {100 * result.mean_error:+.2f} %, "
            f"{result.steps} corrections; {result.cannot or 'called good'}"
        )
    return 1 if wrongly or outside else 0


if __name__ == "__main__":
    sys.exit(main())

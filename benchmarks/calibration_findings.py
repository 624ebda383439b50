"""What campaigns on a right and on a wrong bench are told of their instruments: false alarms, and what is found.

    python benchmarks/calibration_findings.py                     100 clean campaigns, 10 with each error
    python benchmarks/calibration_findings.py --clean 300 --wrong 0

Every campaign is recorded in this process by the simulated rig's own plant, sensors, clocks and controller inputs
(`recorded_rig`), judged point by point and then all together, as `rig run` does. Clean campaigns draw seed, speed,
sensors' noise within their class and a matrix: strong and mixed ones, slow, weak and small points, triangles, 0 A only,
one point alone. The zero check before the first motion is not part of this.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from campaign_process import machine
from recorded_rig import RecordedRig

from rig.clock import utc_now
from rig.recording.quality.cross_checks import campaign_verdicts
from rig.recording.quality.instrument_checks import SLUGS
from rig.recording.quality.verdict import Reason, Verdict
from rig.recording.recorded_point import RecordedPoint
from simulators.bench import poll_ms
from simulators.options import RigOptions

SPEEDS = (1.0, 5.0, 20.0, 50.0)
FAMILIES = ("mixed", "strong", "weak", "slow", "small", "triangles", "0 A only", "one point")
ERRORS: dict[str, tuple[str, dict[str, Any], frozenset[str]]] = {
    "load cell x 1.05": ("load_cell", {"gain": 1.05}, frozenset({"load-cell-gain"})),
    "LVDT x 1.03": ("lvdt", {"gain": 1.03}, frozenset({"lvdt-gain"})),
    "LVDT x 1.08": ("lvdt", {"gain": 1.08}, frozenset({"lvdt-gain"})),
    "load cell zero +150 N": ("load_cell", {"offset": 150.0}, frozenset({"load-cell-zero"})),
    "load cell zero drift 2 N/s": (
        "load_cell", {"drift_per_s": 2.0}, frozenset({"zero-drift", "zero-change", "load-cell-zero"}),
    ),
    "crosstalk 30 N/A": (
        "load_cell", {"crosstalk_per_A": 30.0}, frozenset({"crosstalk", "zero-change", "load-cell-zero"}),
    ),
    "force input 2 ms late": ("force_input", {"delay_s": 2e-3}, frozenset({"force-input-lag"})),
    "position input 2 ms late": ("position_input", {"delay_s": 2e-3}, frozenset({"position-input-lag"})),
    "force input x 0.95": ("force_input", {"gain": 0.95}, frozenset({"load-cell-gain"})),
}


@dataclass(frozen=True)
class Findings:
    """One campaign: its points after all were judged together, and how each ended."""

    points: int
    verdicts: tuple[Verdict, ...]

    @property
    def reasons(self) -> tuple[Reason, ...]:
        """Every doubt about an instrument, of every point."""
        return tuple(reason for verdict in self.verdicts for reason in verdict.entries if reason.slug in SLUGS)


def matrix(random: np.random.Generator, family: str) -> list[dict[str, Any]]:
    """A few points of one kind."""
    amplitudes_m, frequencies_Hz, currents_A = {
        "mixed": ((0.005, 0.05), (0.3, 2.0), (0.0, 0.5, 1.0, 1.5, 2.0)),
        "strong": ((0.03, 0.05), (1.0, 2.0), (0.5, 1.0, 2.0)),
        "weak": ((0.002, 0.01), (0.2, 1.0), (0.0, 0.2)),
        "slow": ((0.005, 0.03), (0.1, 0.3), (0.0, 1.0)),
        "small": ((0.001, 0.003), (1.0, 5.0), (0.0, 1.0, 2.0)),
        "triangles": ((0.01, 0.04), (0.3, 2.0), (0.0, 1.0, 2.0)),
        "0 A only": ((0.005, 0.05), (0.3, 2.0), (0.0,)),
        "one point": ((0.005, 0.05), (0.3, 2.0), (0.0, 1.0)),
    }[family]
    count = 1 if family == "one point" else int(random.integers(2, 8))
    return [
        {
            "id": f"p{number:03d}",
            "waveform": "triangle" if family == "triangles" and number % 2 == 0 else "sine",
            "amplitude_m": float(np.exp(random.uniform(*np.log(amplitudes_m)))),
            "frequency_Hz": float(np.exp(random.uniform(*np.log(frequencies_Hz)))),
            "current_A": float(random.choice(currents_A)), "cycles": int(random.integers(4, 8)),
            "ramp_in_cycles": 1.0, "ramp_out_cycles": 1.0, "centre_m": float(random.uniform(-0.01, 0.01)), "repeat": 1,
            "rest_s": 0.0,
        }
        for number in range(1, count + 1)
    ]


def campaign(seed: int, options: RigOptions, family: str, folder: Path) -> Findings:
    """Record one campaign and judge it."""
    random = np.random.default_rng((seed, 41))
    speed = float(random.choice(SPEEDS))
    rig = RecordedRig(options, speed=speed, seed=seed, poll_s=1e-3 * poll_ms(rtu=False, speed=speed))
    points: list[RecordedPoint] = [rig.run_point(point, folder)[0] for point in matrix(random, family)]
    together = campaign_verdicts(points)
    return Findings(len(points), tuple(together.get(point.id, point.quality.verdict) for point in points))


def clean(seed: int) -> RigOptions:
    """A right rig, its noise anywhere within its class."""
    random = np.random.default_rng((seed, 42))
    options = RigOptions()
    return replace(
        options,
        load_cell=replace(options.load_cell, noise=random.uniform(1.0, 10.0)),
        lvdt=replace(options.lvdt, noise=random.uniform(0.002, 0.01)),
        damper=replace(options.damper, gas_force_N=random.choice([0.0, -150.0])),
    )


def with_error(options: RigOptions, name: str) -> RigOptions:
    """The rig with one of `ERRORS`."""
    part, change, _ = ERRORS[name]
    return replace(options, **{part: replace(getattr(options, part), **change)})


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--clean", type=int, default=100)
    arguments.add_argument("--wrong", type=int, default=10, help="campaigns with each error")
    arguments.add_argument("--error", choices=ERRORS, action="append")
    arguments.add_argument("--family", choices=FAMILIES, action="append", help="of the clean campaigns")
    arguments.add_argument("--first", type=int, default=0, help="seed of the first clean campaign")
    given = arguments.parse_args()
    print(f"{utc_now().date()}, {machine()}")
    good = True
    with tempfile.TemporaryDirectory() as folder:
        began = time.perf_counter()
        alarms: list[str] = []
        verdicts: Counter[str] = Counter()
        families = given.family or FAMILIES
        for seed in range(given.first, given.first + given.clean):
            family = families[seed % len(families)]
            findings = campaign(seed, clean(seed), family, Path(folder))
            verdicts.update(verdict.verdict for verdict in findings.verdicts)
            alarms += [f"seed {seed} ({family}): {each}" for each in findings.reasons[:1]]
        print(f"clean: {given.clean} campaigns, {sum(verdicts.values())} points {dict(verdicts)}; "
              f"{len(alarms)} doubted falsely ({time.perf_counter() - began:.0f} s)", flush=True)
        for alarm in alarms:
            print(f"  {alarm}")
        good = not alarms
        print("| error | named | points valid without a word | what is said |\n|---|---|---|---|")
        for name in given.error or ERRORS if given.wrong else ():
            found, silent, points, text = 0, 0, 0, ""
            for seed in range(given.wrong):
                options = with_error(clean(1000 + seed), name)
                findings = campaign(1000 + seed, options, ("mixed", "strong", "triangles")[seed % 3], Path(folder))
                right = [each for each in findings.reasons if each.slug in ERRORS[name][2]]
                found += bool(right)
                silent += sum(verdict.verdict == "valid" for verdict in findings.verdicts)
                points += findings.points
                text = str(right[0]) if right and not text else text
            good = good and found == given.wrong and silent == 0
            print(f"| {name} | {found} of {given.wrong} | {silent} of {points} | {text} |", flush=True)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())

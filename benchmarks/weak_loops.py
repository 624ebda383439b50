"""How honest the stated skew is where the force hardly tells it: many random points in one process, on the rig's clock.

    python benchmarks/weak_loops.py                      1,000 settings, seed 0
    python benchmarks/weak_loops.py --settings 200 --seed 7 --delay 2

Each setting draws a waveform (sine, triangle, the slow triangle of a friction test), 0.1 to 2 Hz, 1 to 30 mm, 0 to 2 A
(0 A in two of three), 4 to 10 cycles, speed 1 to 20 (the controller's record is polled every 10 ms of wall time), noise
and resolution of both sensors and of the controller's inputs, filters 5 % off their data sheet, and a delay of the load
cell that is not declared: none in half of the settings, else 0.3, 2 or 10 ms. Half of the benches declare the delay of
the controller's inputs; where they do not, the inputs are late by what such inputs usually are.

Deviation: error of the point's skew over its stated standard deviation. Interval: the stated 95 % interval of the skew
by the signals alone, where there is one. Lag: that of the force against the controller's input, by its own 95 %
interval.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from campaign_process import machine
from recorded_rig import RecordedRig

from rig.clock import utc_now
from rig.recording.alignment.alignment import align
from rig.signals.delay_estimation.delay_model import UNSTATED_INPUT, UNSTATED_SHARED
from simulators.conditioner import group_delay_s
from simulators.options import RigOptions

DELAYS_S = (0.0, 0.3e-3, 2e-3, 10e-3)
SHARES = (0.5, 0.17, 0.17, 0.16)
CONFIDENT = 1.959964
FRICTION_SHARE = 0.1


@dataclass(frozen=True)
class Setting:
    """One rig and the point it runs; `skew_s` is the true lag of force behind displacement beyond what is declared."""

    seed: int
    options: RigOptions
    point: dict[str, Any]
    speed: float
    declares_input: bool
    declared_s: tuple[float, float]
    delay_s: float
    skew_s: float
    input_skew_s: float


@dataclass(frozen=True)
class Result:
    """What the point says of its skew (s); `interval_s` None where the signals say nothing."""

    setting: Setting
    skew_s: float
    std_s: float
    interval_s: tuple[float, float] | None
    lag_s: float
    lag_std_s: float
    polls: int

    @property
    def error_s(self) -> float:
        """Of the skew that was taken out."""
        return self.skew_s - self.setting.skew_s


def drawn(seed: int, delay_s: float | None) -> Setting:
    """A random setting; `delay_s` None: that is drawn too."""
    random = np.random.default_rng((seed, 41))
    friction = random.random() < FRICTION_SHARE
    frequency_Hz = math.exp(random.uniform(math.log(0.1), math.log(0.2 if friction else 2.0)))
    point = {
        "id": "p001", "waveform": "triangle" if friction or random.random() < 0.3 else "sine",
        "kind": "friction" if friction else "loop",
        "amplitude_m": math.exp(random.uniform(math.log(1e-3), math.log(30e-3))), "frequency_Hz": frequency_Hz,
        "current_A": 0.0 if random.random() < 0.67 else random.uniform(0.0, 2.0), "cycles": int(random.integers(4, 11)),
        "ramp_in_cycles": 1.0, "ramp_out_cycles": 1.0, "centre_m": 0.0, "repeat": 1, "rest_s": 0.0,
    }
    base, declares = RigOptions(), bool(random.random() < 0.5)
    declared = (group_delay_s(base.load_cell.bandwidth_Hz), group_delay_s(base.lvdt.bandwidth_Hz))
    forgotten_s = float(random.choice(DELAYS_S, p=SHARES)) if delay_s is None else delay_s
    cell = replace(
        base.load_cell, noise=random.uniform(1.0, 10.0), resolution=float(random.choice([0.05, 1.0, 5.0])),
        bandwidth_Hz=base.load_cell.bandwidth_Hz * random.uniform(0.95, 1.05), skew_s=forgotten_s,
    )
    lvdt = replace(
        base.lvdt, noise=random.uniform(0.001, 0.01), resolution=float(random.choice([0.001, 0.005])),
        bandwidth_Hz=base.lvdt.bandwidth_Hz * random.uniform(0.95, 1.05),
    )
    late_s = np.zeros(2)
    if not declares:
        shared_s = abs(random.normal(*UNSTATED_SHARED))
        late_s = shared_s + np.maximum(random.normal(*UNSTATED_INPUT, size=2), 0.0)
    force_input = replace(
        base.force_input, noise=random.uniform(3.0, 20.0), resolution=float(random.choice([0.0, 1.0, 5.0])),
        delay_s=float(late_s[0]),
    )
    position_input = replace(
        base.position_input, noise=random.uniform(3e-6, 20e-6), resolution=float(random.choice([0.0, 5e-6])),
        delay_s=float(late_s[1]),
    )
    true_s = (group_delay_s(cell.bandwidth_Hz), group_delay_s(lvdt.bandwidth_Hz))
    skew_s = forgotten_s + (true_s[0] - declared[0]) - (true_s[1] - declared[1])
    options = replace(base, load_cell=cell, lvdt=lvdt, force_input=force_input, position_input=position_input)
    speed = math.exp(random.uniform(0.0, math.log(20.0)))
    return Setting(seed, options, point, speed, declares, declared, forgotten_s, skew_s, float(late_s[0] - late_s[1]))


def recorded(setting: Setting) -> Result:
    """Record the point and align it."""
    rig = RecordedRig(
        setting.options, speed=setting.speed, seed=setting.seed, declares_input_delay=setting.declares_input,
        declared_delays_s=setting.declared_s,
    )
    records, _ = rig.run_program(setting.point)
    found = align(records, rig.context(setting.point))
    match = found.timed["force"].sensor.match
    return Result(
        setting, found.skew_s, found.skew_std_s, found.delays.interval_s,
        math.nan if match is None else match.lag_s, math.nan if match is None else match.lag_std_s,
        0 if match is None else match.samples,
    )


def row(name: str, results: list[Result]) -> str:
    """One line of the table."""
    deviations = np.array([abs(each.error_s) / each.std_s for each in results])
    errors_s = np.array([abs(each.error_s) for each in results])
    held = [each.interval_s[0] < each.setting.skew_s < each.interval_s[1] for each in results if each.interval_s]
    cells = [
        name, str(len(results)), f"{100 * np.mean(deviations <= 3.0):.1f} %", str(int(np.sum(deviations > 5.0))),
        f"{deviations.max():.1f}", f"{1e3 * np.median(errors_s):.3f}", f"{1e3 * errors_s.max():.2f}",
        f"{1e3 * np.median([each.std_s for each in results]):.2f}",
        f"{100 * np.mean(held):.1f} % of {len(held)}" if held else "-", lag_coverage(results),
    ]
    return "| " + " | ".join(cells) + " |"


def lag_coverage(results: list[Result]) -> str:
    """How often the force's lag lies in its own interval, where the inputs are not late themselves."""
    known = [each for each in results if each.setting.declares_input and math.isfinite(each.lag_s)]
    if not known:
        return "-"
    true_s = [each.setting.delay_s for each in known]
    inside = [abs(each.lag_s - true) < CONFIDENT * each.lag_std_s for each, true in zip(known, true_s, strict=True)]
    return f"{100 * np.mean(inside):.1f} % of {len(known)}"


def main() -> int:
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("--settings", type=int, default=1000)
    arguments.add_argument("--seed", type=int, default=0, help="of the first setting; each takes the next")
    arguments.add_argument("--delay", type=float, help="undeclared delay of the load cell in every setting, ms")
    given = arguments.parse_args()
    print(f"{utc_now().date()}, {machine()}; {given.settings} settings from seed {given.seed}")
    delay_s = None if given.delay is None else 1e-3 * given.delay
    results = [recorded(drawn(given.seed + number, delay_s)) for number in range(given.settings)]
    head = (
        "settings", "count", "within 3 sd", "beyond 5 sd", "largest deviation", "error ms, median", "largest ms",
        "stated sd ms, median", "95 % interval covers", "95 % interval of the lag covers",
    )
    print("| " + " | ".join(head) + " |\n|" + len(head) * "---|")
    for query_s in sorted({each.setting.delay_s for each in results}):
        for declares in (True, False):
            chosen = [
                each for each in results
                if each.setting.delay_s == query_s and each.setting.declares_input == declares
            ]
            name = f"{1e3 * query_s:g} ms, input delay {'declared' if declares else 'not declared'}"
            if chosen:
                print(row(name, chosen))
    print(row("all", results))
    print("\nworst deviations:")
    for each in sorted(results, key=lambda result: -abs(result.error_s) / result.std_s)[:8]:
        point = each.setting.point
        print(
            f"  seed {each.setting.seed}: {point['kind']} {point['waveform']} {point['frequency_Hz']:.2f} Hz "
            f"{1e3 * point['amplitude_m']:.1f} mm {point['current_A']:.2f} A, {point['cycles']} cycles, speed "
            f"{each.setting.speed:.1f}, {each.polls} polls, input "
            f"{'declared' if each.setting.declares_input else 'not declared'}: true {1e3 * each.setting.skew_s:.3f}, "
            f"taken out {1e3 * each.skew_s:.3f} +- {1e3 * each.std_s:.3f} ms; lag {1e3 * each.lag_s:.3f} +- "
            f"{1e3 * each.lag_std_s:.3f} ms"
        )
    good = np.mean([abs(each.error_s) <= 3.0 * each.std_s for each in results]) >= 0.99
    good = good and all(abs(each.error_s) <= 5.0 * each.std_s for each in results)
    good = good and all(abs(each.error_s) < 1e-3 for each in results if each.setting.delay_s == 0.0)
    held = [each.interval_s[0] < each.setting.skew_s < each.interval_s[1] for each in results if each.interval_s]
    return 0 if good and 0.93 <= np.mean(held) <= 0.97 else 1


if __name__ == "__main__":
    sys.exit(main())

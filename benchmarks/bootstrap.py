"""Bootstrap of the default model: time of 1,000 fits, and whether intervals of a wrong model hold for other tests.

`python benchmarks/bootstrap.py` fits 1,000 draws of the Table 1 problem (asymmetric model, 20 tests, 41,665 samples) on
two processes. `python benchmarks/bootstrap.py --split-half 20` splits the tests of a damper that is another model into
halves, fits each, and counts how many parameters of one half lie where the other's interval says (both intervals
together), for the bootstrap and for the fit's own. With RIG_MEASURED_DATA=DIR of the UTFSM tests (`measured_damper.py`)
it splits those instead, which no model fits.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from measured_damper import measured as recorded

from rig.dampers import model, parameter_set
from rig.identification import Measurement, bootstrap, identify

CURRENTS_A, FREQUENCIES_HZ, RATE_HZ, CYCLES = (0.0, 0.5, 1.0, 1.5, 2.0), (0.5, 1.0, 1.5, 2.0), 250.0, 8
PLANTS = ("normalized_bouc_wen", "lost_motion", "modified_bouc_wen")


def measured(name: str, values: dict[str, float], seed: int, amplitude_m: float = 0.05) -> list[Measurement]:
    """Table 1 of a damper, 5 N of noise."""
    rng, damper, tests = np.random.default_rng(seed), model(name), []
    for current_A in CURRENTS_A:
        for frequency_Hz in FREQUENCIES_HZ:
            omega = 2.0 * math.pi * frequency_Hz
            t = np.arange(round((CYCLES + 1) / frequency_Hz * RATE_HZ)) / RATE_HZ
            u, v = amplitude_m * np.sin(omega * t), amplitude_m * omega * np.cos(omega * t)
            a, amps = -(omega**2) * u, np.full(t.size, current_A)
            force = damper.force(values, u, v, a, amps, 1.0 / RATE_HZ) + rng.normal(0.0, 5.0, t.size)
            kept = slice(round(RATE_HZ / frequency_Hz), None)
            arrays = (part[kept] for part in (u, v, a, force, amps))
            tests.append(Measurement(
                f"{current_A:g}A{frequency_Hz:g}Hz", *arrays, 1.0 / RATE_HZ, amplitude_m=amplitude_m, noise_N=5.0,
                frequency_Hz=frequency_Hz, nominal_current_A=current_A, samples_per_cycle=round(RATE_HZ / frequency_Hz),
            ))  # fmt: skip
    return tests


def timed(count: int, processes: int) -> dict[str, float]:
    """Wall time of the draws, workers started and loaded before as a second bootstrap finds them."""
    tests = measured("asymmetric", dict(parameter_set("demo").values), 0)
    fit = identify(tests)
    with ProcessPoolExecutor(processes) as executor:
        bootstrap(fit, tests, count=40, executor=executor, chunks=processes)
        started = time.perf_counter()
        drawn = bootstrap(fit, tests, count=count, executor=executor, chunks=processes)
        wall_s = time.perf_counter() - started
    own_s = time.process_time()
    bootstrap(fit, tests, count=count // 10)
    alone_s = (time.process_time() - own_s) * 10.0
    return {"draws": drawn.draws.shape[0], "wall_s": wall_s, "cpu_s_one_process": alone_s}


def halves(tests: Sequence[Measurement], seed: int) -> dict[str, list[bool]]:
    """Whether each parameter of two halves agrees within both 95 % intervals, by the bootstrap and by the fit."""
    order = np.random.default_rng([seed, 1]).permutation(len(tests))
    parts = [[tests[k] for k in order[: len(tests) // 2]], [tests[k] for k in order[len(tests) // 2 :]]]
    fits = [identify(part) for part in parts]
    tables = [bootstrap(fit, part, count=200, seed=seed).to_pandas() for fit, part in zip(fits, parts, strict=True)]
    agree: dict[str, list[bool]] = {"bootstrap": [], "fit": []}
    for one in set(fits[0].identifiable) & set(fits[1].identifiable) & set(tables[0].index) & set(tables[1].index):
        first, second = (fit.parameters[one] for fit in fits)
        gap = abs(first.value - second.value)
        own = math.hypot(*(0.5 * (entry.high - entry.low) for entry in (first, second)))
        drawn = math.hypot(*(0.5 * float(table.loc[one, "high"] - table.loc[one, "low"]) for table in tables))
        agree["fit"].append(gap <= own)
        agree["bootstrap"].append(gap <= drawn)
    return agree


def main() -> None:
    """Print the numbers as JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--split-half", type=int, default=0, metavar="SEEDS")
    options = parser.parse_args()
    if not options.split_half:
        print(json.dumps(timed(options.count, options.processes)))
        return
    real = os.environ.get("RIG_MEASURED_DATA")
    known = recorded(Path(real)) if real else []
    for name in ["UTFSM"] if real else PLANTS:
        counted: dict[str, list[bool]] = {"bootstrap": [], "fit": []}
        for seed in range(options.split_half):
            tests = known or measured(name, dict(model(name).demonstration), seed)
            for kind, agree in halves(tests, seed).items():
                counted[kind] += agree
        shares = {kind: round(float(np.mean(agree)), 3) for kind, agree in counted.items()}
        print(json.dumps({"plant": name, "parameters": len(counted["fit"]), **shares}), flush=True)


if __name__ == "__main__":
    main()

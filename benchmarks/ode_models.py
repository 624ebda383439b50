"""Models with internal states: fits against trf, populations, and how well they use two cores.

    python benchmarks/ode_models.py [--quick] [--only fits,population,parallel]

fits: Bouc-Wen, one settled test of 4,001 samples, 5 N noise; truths log-uniform within a factor 2 of a nominal set.
`separable` needs no start; trf starts from the logarithmic middle of the box, the nominal set, on the same compiled
objective. Success: at most 1.01 x the sum of squares at the truth. population: cost of one candidate of fifty.
parallel: the same search on one core and on two, threads and processes, median of alternating rounds.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context

import numpy as np
from scipy.optimize import least_squares

from rig.dampers import model, parameter_set
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.problem import FixedParameters, Problem
from rig.identification.models.projection import Weighting
from rig.identification.models.separable import motion_scale, solve_loop
from rig.optimisers import minimise
from rig.study.recordings import BOUC_WEN_TRUTH
from rig.study.workbench import CURRENT_FIXED

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
SUCCESS = 1.01
HELD = frozenset({"kv_b", "kw_b"})  # one current tells no affine terms


def motion(current_A: float, samples: int = 4001, rate_Hz: float = 1000.0, frequency_Hz: float = 1.0) -> Measurement:
    """A settled sine of 20 mm without force."""
    phase = 2.0 * np.pi * frequency_Hz * np.arange(samples) / rate_Hz
    return Measurement(
        id=f"{current_A:g} A", u_m=0.02 * np.sin(phase), v_m_s=0.04 * np.pi * frequency_Hz * np.cos(phase),
        a_m_s2=-0.02 * (2.0 * np.pi * frequency_Hz) ** 2 * np.sin(phase), force_N=np.zeros(samples),
        current_A=np.full(samples, current_A), dt_s=1.0 / rate_Hz, samples_per_cycle=round(rate_Hz / frequency_Hz),
    )  # fmt: skip


def recorded(name: str, values: dict[str, float], current_A: float, seed: int) -> Measurement:
    """The same with the model's settled force and 5 N of noise."""
    still = motion(current_A)
    noise_N = np.random.default_rng(seed).normal(0.0, 5.0, still.u_m.size)
    return replace(still, force_N=modelled_force(model(name), values, still) + noise_N)


def random_truth(seed: int) -> dict[str, float]:
    rng = np.random.default_rng(seed)
    truth = {name: value * 2.0 ** rng.uniform(-1.0, 1.0) for name, value in BOUC_WEN_TRUTH.items()}
    return truth | {"c0_b": 0.0, "alpha_b": 0.0, "n": rng.uniform(1.2, 3.0), "A": BOUC_WEN_TRUTH["A"]}


def timed(call: Callable[[], float]) -> tuple[float, float]:
    started = time.perf_counter()
    value = call()
    return value, time.perf_counter() - started


def separable(test: Measurement) -> float:
    damper = model("bouc_wen")
    form = damper.separation(motion_scale([test]))
    assert form is not None
    return solve_loop([test], form, Weighting("1"), HELD).objective


def rival(objective: FixedParameters) -> float:
    problem, start = objective.problem, np.array([BOUC_WEN_TRUTH[name] for name in objective.names])
    return 2.0 * float(
        least_squares(lambda p: problem.residuals(objective.whole(p[None, :])[0]), start, x_scale="jac").cost
    )


def bench_fits(quick: bool) -> Iterator[str]:
    """Bouc-Wen fits: success and wall time over random truths."""
    rows: dict[str, list[tuple[bool, float]]] = {"separable": [], "trf": []}
    for seed in range(3 if quick else 100):
        truth = random_truth(seed)
        test = recorded("bouc_wen", truth, 0.0, seed)
        objective = FixedParameters(Problem([test], "bouc_wen", "1"), CURRENT_FIXED["bouc_wen"])
        at_truth = float(objective.batch(np.array([[truth[name] for name in objective.names]]))[0])
        if seed == 0:
            separable(test)
        for name, run in (("separable", partial(separable, test)), ("trf", partial(rival, objective))):
            value, seconds = timed(run)
            rows[name].append((value <= SUCCESS * at_truth, seconds))
    medians = {name: float(np.median([seconds for _, seconds in results])) for name, results in rows.items()}
    for name, results in rows.items():
        good = sum(success for success, _ in results)
        yield f"{name:10} success {good}/{len(results)}, median {1e3 * medians[name]:.1f} ms"
    yield f"ratio {medians['trf'] / medians['separable']:.1f}"


def bench_population(quick: bool) -> Iterator[str]:
    """One candidate of a population of 50, 4,001 samples beside one cycle of warm-up."""
    for name in ("demo-bouc-wen", "demo-modified-bouc-wen", "demo-viscoelastic-plastic"):
        chosen = parameter_set(name)
        problem = Problem([recorded(chosen.model, dict(chosen.values), 1.0, 0)], chosen.model, "1")
        around = np.random.default_rng(0).uniform(0.8, 1.2, (50, problem.n_parameters))
        population = problem.vector(chosen.values) * around
        problem.batch(population)
        evaluate = partial(_first_value, problem, population)
        seconds = min(timed(evaluate)[1] for _ in range(3 if quick else 10))
        yield f"{chosen.model:22} {1e3 * seconds / 50:.3f} ms a candidate"


def _first_value(problem: Problem, population: np.ndarray) -> float:
    return float(problem.batch(population)[0])


def _search_s(problem: Problem, box: np.ndarray, budget: int, executor: Executor | None) -> float:
    """Seconds of one search; two chunks a generation on an executor."""
    return minimise(
        problem, method="de", bounds=box, population=100, budget=budget, executor=executor, chunks=2
    ).seconds


def bench_parallel(quick: bool) -> Iterator[str]:
    """A DE search of 100 candidates a generation over four tests, on one core and on two."""
    pools: dict[str, Callable[[], Executor]] = {
        "threads": partial(ThreadPoolExecutor, 2),
        "processes": partial(ProcessPoolExecutor, 2, mp_context=get_context("spawn")),
    }
    for name in ("demo-bouc-wen", "demo-modified-bouc-wen"):
        chosen = parameter_set(name)
        tests = [recorded(chosen.model, dict(chosen.values), amps, k) for k, amps in enumerate((0.0, 0.5, 1.0, 1.5))]
        problem = Problem(tests, chosen.model, "1")
        at = problem.vector(chosen.values)
        box = np.sort(np.column_stack((0.8 * at - 1e-9, 1.2 * at + 1e-9)), axis=1)
        budget = 300 if quick else (20_000 if problem.model.states == 1 else 2_000)
        search = partial(_search_s, problem, box, budget)
        for kind, pool in pools.items():
            with pool() as executor:
                search(None), search(executor)
                rounds = [(search(None), search(executor)) for _ in range(1 if quick else 3)]
            one, two = np.median(np.array(rounds), axis=0)
            yield f"{chosen.model:18} {kind:10} 1 core {one:.2f} s, 2 cores {two:.2f} s, efficiency {one / two / 2:.2f}"


SECTIONS = {"fits": bench_fits, "population": bench_population, "parallel": bench_parallel}


def main() -> None:
    parser = argparse.ArgumentParser(description="Models with internal states: fits, populations, two cores.")
    parser.add_argument("--quick", action="store_true", help="few truths, to see that it runs")
    parser.add_argument("--only", default=",".join(SECTIONS), help=f"of {', '.join(SECTIONS)}")
    arguments = parser.parse_args()
    if any(os.environ.get(name) != "1" for name in THREADS):  # they count only before numpy is loaded
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | dict.fromkeys(THREADS, "1"))
    warnings.simplefilter("ignore")
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    for name in arguments.only.split(","):
        section = SECTIONS[name]
        print(f"\n{name}: {(section.__doc__ or '').strip().splitlines()[0]}, load {os.getloadavg()[0]:.1f}", flush=True)
        for line in section(arguments.quick):
            print(f"  {line}", flush=True)


if __name__ == "__main__":
    main()

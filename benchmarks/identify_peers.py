"""Identification against its peers: success and time on one problem, one objective, one thread, in one run.

    python benchmarks/identify_peers.py            everything (about half an hour on two cores)
    python benchmarks/identify_peers.py --quick    a few truths and seeds, to see that it runs
    python benchmarks/identify_peers.py --only fresh,evaluation
    python benchmarks/identify_peers.py --only peers,peers_wide --methods pymoo,pygmo

Problem: Table 1, 41,665 samples, 5 N noise, weight v, truths log-uniform within a factor 4 of `demo`, start all ones.
Two boxes: +-1e4 on everything, and a sane one, +-10 |demo| (beta and delta from 0 to 20 x demo): truth inside, about
twenty times its size wide. Success: f <= 1.001 x the minimum that trf reaches from the truth. Peers: SciPy, pymoo,
pygmo, nevergrad (the `peers` extra); mealpy does not run on numpy 2 (it calls ndarray.ptp).
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import tracemalloc
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from identify_case import SUCCESS, Case, cpu_timed, random_case, sane_box, timed, wide_box
from scipy.optimize import differential_evolution, least_squares

from rig.dampers import model
from rig.identification.models.projection import Weighting
from rig.identification.models.separable import solve_separable
from rig.optimisers import minimise

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
BUDGET = 16_000


def separable(case: Case) -> float:
    return solve_separable(case.tests, model("asymmetric"), Weighting("v")).objective  # type: ignore[arg-type]  # algebraic


def rival(case: Case, box: np.ndarray | None = None, *, fast: bool = True) -> float:
    bounds = (-np.inf, np.inf) if box is None else (box[:, 0], box[:, 1])
    start = np.ones(12) if box is None else np.clip(np.ones(12), box[:, 0] + 1e-9, box[:, 1] - 1e-9)
    residual = case.residual if fast else case.numpy_residual
    return 2.0 * float(least_squares(residual, start, bounds=bounds, x_scale="jac", method="trf").cost)


def ours(method: str, **settings: object) -> Callable[[Case, np.ndarray, int], float]:
    def run(case: Case, box: np.ndarray, seed: int) -> float:
        return minimise(case.problem, method=method, bounds=box, budget=BUDGET, seed=seed, **settings).value  # type: ignore[arg-type]  # plain settings

    return run


def scipy_de(case: Case, box: np.ndarray, seed: int) -> float:
    size = 60
    return float(
        differential_evolution(
            lambda x: case.problem.batch(np.ascontiguousarray(x.T)), box, vectorized=True, updating="deferred",
            rng=seed, popsize=size // 12, maxiter=BUDGET // size - 1, polish=False, tol=0.0,
        ).fun
    )  # fmt: skip


def pymoo(name: str) -> Callable[[Case, np.ndarray, int], float]:
    def run(case: Case, box: np.ndarray, seed: int) -> float:
        from importlib import import_module

        from pymoo.core.problem import Problem as PymooProblem
        from pymoo.optimize import minimize

        class Wrapped(PymooProblem):  # type: ignore[misc]  # pymoo has no annotations
            def __init__(self) -> None:
                super().__init__(n_var=12, n_obj=1, xl=box[:, 0], xu=box[:, 1])

            def _evaluate(self, x: np.ndarray, out: dict[str, np.ndarray], *_: object, **__: object) -> None:
                out["F"] = case.problem.batch(x)

        algorithm = getattr(import_module(f"pymoo.algorithms.soo.nonconvex.{name.lower()}"), name)(pop_size=50)
        return float(minimize(Wrapped(), algorithm, ("n_eval", BUDGET), seed=seed).F[0])

    return run


def pygmo(name: str, per_generation: int = 1) -> Callable[[Case, np.ndarray, int], float]:
    def run(case: Case, box: np.ndarray, seed: int) -> float:
        import pygmo as pg

        class Wrapped:
            def fitness(self, x: np.ndarray) -> list[float]:
                return [case.problem.objective(x)]

            def get_bounds(self) -> tuple[list[float], list[float]]:
                return box[:, 0].tolist(), box[:, 1].tolist()

        population = pg.population(pg.problem(Wrapped()), size=50, seed=seed)
        generations = (BUDGET - 50) // (50 * per_generation)
        return float(pg.algorithm(getattr(pg, name)(gen=generations, seed=seed)).evolve(population).champion_f[0])

    return run


def nevergrad(name: str) -> Callable[[Case, np.ndarray, int], float]:
    def run(case: Case, box: np.ndarray, seed: int) -> float:
        import nevergrad as ng

        space = ng.p.Array(shape=(len(box),), lower=box[:, 0], upper=box[:, 1])
        space.random_state.seed(seed)
        optimiser = ng.optimizers.registry[name](parametrization=space, budget=BUDGET)
        return case.problem.objective(optimiser.minimize(case.problem.objective).value)

    return run


POPULATION_METHODS: dict[str, Callable[[Case, np.ndarray, int], float]] = {
    "c_foa (intended)": ours("c_foa"), "c_foa (printed)": ours("c_foa", variant="printed"), "foa": ours("foa"),
    "ga": ours("ga"), "de": ours("de"), "pso": ours("pso"), "i_abc": ours("i_abc"), "ga_standard": ours("ga_standard"),
    "ga_kwok": ours("ga_kwok"), "ga_novel": ours("ga_novel"), "SciPy DE": scipy_de, "pymoo PSO": pymoo("PSO"),
    "pymoo GA": pymoo("GA"), "pymoo DE": pymoo("DE"), "pymoo CMAES": pymoo("CMAES"), "pygmo sade": pygmo("sade"),
    "pygmo de1220": pygmo("de1220"), "pygmo bee_colony": pygmo("bee_colony", 2), "nevergrad NGOpt": nevergrad("NGOpt"),
    "nevergrad TwoPointsDE": nevergrad("TwoPointsDE"),
}  # fmt: skip


def bench_truths(quick: bool) -> Iterator[str]:
    """`separable` against trf: success and processor time over random truths (least of 5 and of 2 calls)."""
    count = 5 if quick else 1000
    rival_count = min(count, 5 if quick else 50)
    rows: dict[str, list[tuple[bool, float]]] = {}
    for seed in range(count):
        case = random_case(seed)
        if seed == 0:
            separable(case)
        runs: dict[str, Callable[[], float]] = {"separable": partial(separable, case)}
        if seed < rival_count:
            runs["trf, fast residual"] = partial(rival, case)
            runs["trf, numpy residual"] = partial(rival, case, fast=False)
            runs["trf in the sane box"] = partial(rival, case, sane_box(case.problem.names))
            runs["trf in +-1e4"] = partial(rival, case, wide_box(case.problem.names))
        for name, run in runs.items():
            value, seconds = cpu_timed(run, 5 if name == "separable" else 2)
            rows.setdefault(name, []).append((case.success(value), seconds))
    reference = float(np.median([seconds for _, seconds in rows["separable"]]))
    for name, results in rows.items():
        median = float(np.median([seconds for _, seconds in results]))
        share = f"{sum(good for good, _ in results)}/{len(results)}"
        yield f"{name:22} success {share:>9}  median {1e3 * median:8.1f} ms  ratio {median / reference:6.1f}"


def bench_tenfold(quick: bool) -> Iterator[str]:
    """`separable` against trf at ten times the samples: processor time (least of 5 calls and of 1)."""
    ours_s, theirs_s = [], []
    for seed in range(2 if quick else 10):
        case = random_case(seed, cycles=10)
        if seed == 0:
            separable(case)
        value, seconds = cpu_timed(partial(separable, case), 5)
        rival_value, rival_seconds = cpu_timed(partial(rival, case))
        ours_s.append(seconds)
        theirs_s.append(rival_seconds)
        if not case.success(value):
            yield f"seed {seed}: separable stopped at {value / case.minimum:.4g} x the minimum"
        if not case.success(rival_value):
            yield f"seed {seed}: trf stopped at {rival_value / case.minimum:.4g} x the minimum"
    ratio = np.median(theirs_s) / np.median(ours_s)
    yield (f"{case.n} samples, {len(ours_s)} truths: separable {1e3 * np.median(ours_s):.1f} ms, "
           f"trf {1e3 * np.median(theirs_s):.0f} ms, ratio {ratio:.1f}")  # fmt: skip


def bench_peers(quick: bool, chosen: tuple[str, ...] = ()) -> Iterator[str]:
    """Population methods at 16,000 evaluations in the sane box."""
    return _peers(quick, chosen, sane_box)


def bench_peers_wide(quick: bool, chosen: tuple[str, ...] = ()) -> Iterator[str]:
    """Population methods at 16,000 evaluations in +-1e4."""
    return _peers(quick, chosen, wide_box)


def _peers(quick: bool, chosen: tuple[str, ...], box_of: Callable[[tuple[str, ...]], np.ndarray]) -> Iterator[str]:
    seeds = 2 if quick else 10
    cases = [random_case(seed) for seed in range(seeds)]
    for name, run in POPULATION_METHODS.items():
        if chosen and not any(part in name for part in chosen):
            continue
        values, times = [], []
        try:
            for seed, case in enumerate(cases):
                value, seconds = timed(partial(run, case, box_of(case.problem.names), seed))
                values.append(value / case.minimum)
                times.append(seconds)
        except ImportError as missing:
            yield f"{name:22} not run: {missing}"
            continue
        share = f"{sum(value <= SUCCESS for value in values)}/{seeds}"
        yield (f"{name:22} success {share:>6}  f/minimum best {min(values):9.4g} median {np.median(values):9.4g} "
               f"worst {max(values):9.4g}  {np.median(times):6.2f} s")  # fmt: skip


FRESH_SEPARABLE = """
import sys, numpy as np
from rig.dampers import model
from rig.identification import Measurement, Weighting, solve_separable
u, v, a, i, f = np.load(sys.argv[1])
test = Measurement(id='all', u_m=u, v_m_s=v, a_m_s2=a, current_A=i, force_N=f, dt_s=1/250, samples_per_cycle=250)
print(solve_separable([test], model('asymmetric'), Weighting('v')).objective)
"""
FRESH_IDENTIFY = """
import sys, numpy as np
from rig.identification import Measurement, Method, identify
u, v, a, i, f = np.load(sys.argv[1])
test = Measurement(id='all', u_m=u, v_m_s=v, a_m_s2=a, current_A=i, force_N=f, dt_s=1/250, samples_per_cycle=250)
print(identify([test], method=Method(weight='v')).objective)
"""
FRESH_TRF = """
import sys, numpy as np
from scipy.optimize import least_squares
u, v, a, i, f = np.load(sys.argv[1])
s = np.sign(u)
def residual(p):
    C = np.where(v >= 0, p[6] + p[8] * i, p[7] + p[9] * i)
    return (f - p[0]*a - p[1] - (p[4] + p[5]*i) * np.tanh(p[2]*v + p[3]*s) - C*v - (p[10] + p[11]*i)*u) * v
print(2 * least_squares(residual, np.ones(12), x_scale='jac').cost)
"""


def bench_fresh(quick: bool) -> Iterator[str]:
    """A fresh process, from `python -c` to the finished fit of arrays in a file; modules compiled to bytecode before.

    `solve_separable` gives what trf gives, `identify` intervals and findings too.
    """
    case, results = random_case(0), {}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "channels.npy"
        np.save(file, np.array([case.u, case.v, case.a, case.current, case.force]))
        codes = {"solve_separable": FRESH_SEPARABLE, "identify": FRESH_IDENTIFY, "trf": FRESH_TRF}
        for name, code in codes.items():
            command = [sys.executable, "-c", code, str(file)]
            _number_printed_by(command)
            runs = [timed(partial(_number_printed_by, command)) for _ in range(3 if quick else 10)]
            results[name] = float(np.median([seconds for _, seconds in runs]))
            yield f"{name:16} {results[name]:.3f} s  f/minimum {runs[0][0] / case.minimum:.6f}"
    for name in ("solve_separable", "identify"):
        yield f"trf / {name}: {results['trf'] / results[name]:.1f}"


def _number_printed_by(command: list[str]) -> float:
    installed = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return float(subprocess.check_output(command, env=installed))


def bench_evaluation(quick: bool) -> Iterator[str]:
    """Cost of one objective evaluation, per sample."""
    case = random_case(0)
    population = np.tile(case.truth, (50, 1)) * np.random.default_rng(0).uniform(0.9, 1.1, (50, 12))
    case.problem.batch(population)
    repeats = 3 if quick else 20
    batch = min(timed(lambda: float(case.problem.batch(population)[0]))[1] / 50 for _ in range(repeats))
    single = min(timed(lambda: case.problem.objective(case.truth))[1] for _ in range(repeats))
    plain = min(timed(lambda: float(np.sum(case.numpy_residual(case.truth) ** 2)))[1] for _ in range(repeats))
    for name, seconds in (("population of 50", batch), ("one candidate", single), ("plain numpy", plain)):
        yield f"{name:18} {1e9 * seconds / case.n:6.2f} ns a sample"


def bench_linear(quick: bool) -> Iterator[str]:
    """Cost and memory of `separable` against the number of samples."""
    for cycles in (1, 10) if quick else (1, 10, 100, 240):
        case = random_case(0, cycles)
        seconds = min(timed(partial(separable, case))[1] for _ in range(3))
        tracemalloc.start()
        separable(case)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        rate = 1e9 * seconds / case.n
        yield f"{case.n:>10} samples {seconds:8.3f} s  {rate:7.1f} ns a sample  peak {peak / 1e6:8.1f} MB"


SECTIONS = {
    "evaluation": bench_evaluation, "fresh": bench_fresh, "truths": bench_truths, "tenfold": bench_tenfold,
    "linear": bench_linear,
}
PEER_SECTIONS = {"peers": bench_peers, "peers_wide": bench_peers_wide}  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description="Identification against its peers.")
    parser.add_argument("--quick", action="store_true", help="few truths and seeds")
    known = (*SECTIONS, *PEER_SECTIONS)
    parser.add_argument("--only", default=",".join(known), help=f"of {', '.join(known)}")
    parser.add_argument("--methods", default="", help="peers: only those whose name has one of these parts")
    arguments = parser.parse_args()
    if any(os.environ.get(name) != "1" for name in THREADS):  # they count only before numpy is loaded
        os.execve(sys.executable, [sys.executable, *sys.argv], os.environ | dict.fromkeys(THREADS, "1"))
    warnings.simplefilter("ignore")
    versions = f"Python {platform.python_version()}, numpy {np.__version__}"
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, {versions}")
    chosen = tuple(part for part in arguments.methods.split(",") if part)
    for name in arguments.only.split(","):
        peers = PEER_SECTIONS.get(name)
        section = SECTIONS[name] if peers is None else partial(peers, chosen=chosen)
        text = (section if peers is None else peers).__doc__ or ""
        print(f"\n{name}: {text.strip().splitlines()[0]}, load {os.getloadavg()[0]:.1f}", flush=True)
        for line in section(arguments.quick):
            print(f"  {line}", flush=True)


if __name__ == "__main__":
    main()

"""Our algorithms beside independent implementations of the same family: same objective, same box, same budget.

Objective: a damper loop of five parameters, sum of squares, in a box about twenty times its size. "Within the spread"
means that over eight seeds our median lies between the best and the worst that the independent implementations find.

    python tests/rig/optimisers/test_independent_references.py      all of them side by side
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import differential_evolution, least_squares

from rig.optimisers import minimise

SEEDS = range(8)
BUDGET = 3000
POPULATION = 30
TRUTH = np.array([238.0, 20.0, 900.0, -270.0, 1.0])
BOX = np.array([(-2000.0, 2000.0), (0.0, 200.0), (-9000.0, 9000.0), (-2700.0, 2700.0), (-10.0, 10.0)])


class Loop:
    """F = Fy tanh(beta v + delta sgn u) + C v + F0 along one cycle, compared at 400 samples."""

    n_parameters = 5

    def __init__(self) -> None:
        phase = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
        self.v, self.side = 0.3 * np.cos(phase), np.sign(np.sin(phase))
        noise = np.random.default_rng(1).normal(0.0, 5.0, phase.size)
        self.measured = self.force(TRUTH[None, :])[0] + noise

    def force(self, population: np.ndarray) -> np.ndarray:
        Fy, beta, C, F0, delta = (population[:, k : k + 1] for k in range(5))
        return Fy * np.tanh(beta * self.v + delta * self.side) + C * self.v + F0

    def batch(self, population: np.ndarray) -> np.ndarray:
        return np.sum((self.force(population) - self.measured) ** 2, axis=1)

    def one(self, vector: np.ndarray) -> float:
        return float(self.batch(np.asarray(vector)[None, :])[0])


def ours(method: str, **settings: object) -> list[float]:
    loop = Loop()
    return [
        minimise(loop, method=method, bounds=BOX, population=POPULATION, budget=BUDGET, seed=seed, **settings).value
        for seed in SEEDS
    ]


def scipy_de(seed: int) -> float:
    generations = BUDGET // POPULATION - 1
    start = BOX[:, 0] + (BOX[:, 1] - BOX[:, 0]) * np.random.default_rng(seed).random((POPULATION, 5))
    return float(
        differential_evolution(
            Loop().one, BOX, strategy="rand1bin", mutation=(0.85, 1.0), recombination=1.0, init=start, rng=seed,
            maxiter=generations, polish=False, tol=0.0, updating="deferred",
        ).fun
    )  # fmt: skip


def pymoo_of(name: str, **settings: object) -> Callable[[int], float]:
    def run(seed: int) -> float:
        pytest.importorskip("pymoo", reason="the peers extra is not installed")
        from pymoo.algorithms.soo.nonconvex.de import DE
        from pymoo.algorithms.soo.nonconvex.ga import GA
        from pymoo.algorithms.soo.nonconvex.pso import PSO
        from pymoo.core.problem import Problem
        from pymoo.optimize import minimize

        loop = Loop()

        class Wrapped(Problem):  # type: ignore[misc]  # pymoo has no annotations
            def __init__(self) -> None:
                super().__init__(n_var=5, n_obj=1, xl=BOX[:, 0], xu=BOX[:, 1])

            def _evaluate(self, x: np.ndarray, out: dict[str, np.ndarray], *_: object, **__: object) -> None:
                out["F"] = loop.batch(x)

        algorithm = {"DE": DE, "GA": GA, "PSO": PSO}[name](pop_size=POPULATION, **settings)
        return float(minimize(Wrapped(), algorithm, ("n_eval", BUDGET), seed=seed).F[0])

    return run


def pygmo_of(name: str, evaluations: int = POPULATION, **settings: object) -> Callable[[int], float]:
    """`evaluations` a generation."""

    def run(seed: int) -> float:
        pygmo = pytest.importorskip("pygmo", reason="the peers extra is not installed")
        loop = Loop()

        class Wrapped:
            def fitness(self, vector: np.ndarray) -> list[float]:
                return [loop.one(vector)]

            def get_bounds(self) -> tuple[list[float], list[float]]:
                return BOX[:, 0].tolist(), BOX[:, 1].tolist()

        population = pygmo.population(pygmo.problem(Wrapped()), size=POPULATION, seed=seed)
        generations = (BUDGET - POPULATION) // evaluations
        algorithm = pygmo.algorithm(getattr(pygmo, name)(gen=generations, seed=seed, **settings))
        return float(algorithm.evolve(population).champion_f[0])

    return run


def mealpy_of(module: str, name: str, evaluations: int = POPULATION, **settings: object) -> Callable[[int], float]:
    """`evaluations` a generation."""

    def run(seed: int) -> float:
        mealpy = pytest.importorskip("mealpy", reason="mealpy is not installed")
        algorithm = getattr(getattr(mealpy, module), name)
        problem = {
            "obj_func": Loop().one, "bounds": mealpy.FloatVar(lb=BOX[:, 0], ub=BOX[:, 1]), "minmax": "min",
            "log_to": None,
        }  # fmt: skip
        search = algorithm(epoch=(BUDGET - POPULATION) // evaluations, pop_size=POPULATION, **settings)
        return float(search.solve(problem, seed=seed).target.fitness)

    return run


PEERS: dict[str, dict[str, Callable[[int], float]]] = {
    "de": {
        "SciPy": scipy_de,
        "pymoo": pymoo_of("DE", variant="DE/rand/1/bin", CR=1.0, dither="vector"),
        "pygmo": pygmo_of("de", F=0.92, CR=1.0, variant=7, ftol=0.0, xtol=0.0),
        "mealpy": mealpy_of("DE", "OriginalDE", wf=0.92, cr=0.99, strategy=0),
    },
    "pso": {
        "pymoo": pymoo_of("PSO"),
        "pygmo": pygmo_of("pso"),
        "mealpy": mealpy_of("PSO", "OriginalPSO"),
    },
    "ga": {
        "pymoo": pymoo_of("GA"),
        "pygmo": pygmo_of("sga"),
        "mealpy": mealpy_of("GA", "BaseGA"),
    },
    "i_abc": {
        "pygmo": pygmo_of("bee_colony", 2 * POPULATION, limit=150),
        "mealpy": mealpy_of("ABC", "OriginalABC", 2 * POPULATION, n_limits=150),
    },
}
ALONE = {
    "FOA (Pan; nothing negative can be reached)": ("foa", {}),
    "c-FOA as printed (signs of the start are never left)": ("c_foa", {"variant": "printed"}),
    "c-FOA as intended (signs are settled before magnitudes)": ("c_foa", {}),
}


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore")  # the peers' own deprecations are not ours
@pytest.mark.parametrize(
    ("method", "settings"),
    [
        ("de", {}),
        ("de", {"strategy": 5}),
        ("pso", {}),
        ("ga", {}),
        ("ga", {"mutation": "feasible direction"}),
        ("i_abc", {}),
    ],
)
def test_an_algorithm_is_within_the_spread_of_independent_implementations(
    method: str, settings: dict[str, object]
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = np.log10([[peer(seed) for seed in SEEDS] for peer in PEERS[method].values()])
    mine = np.log10(ours(method, **settings))
    assert theirs.min() <= np.median(mine) <= theirs.max(), (mine, theirs)


def side_by_side() -> str:
    """A line for each implementation: best, median, worst over the seeds, in multiples of the least squares minimum."""
    loop = Loop()
    floor = 2.0 * float(least_squares(lambda p: loop.force(p[None, :])[0] - loop.measured, TRUTH, x_scale="jac").cost)
    what = f"of the minimum, {BUDGET} evaluations, N = {POPULATION}"
    lines = [f"{what:60}{'best':>11}{'median':>11}{'worst':>11}"]

    def line(name: str, values: list[float]) -> None:
        shown = "".join(f"{value / floor:11.4g}" for value in (min(values), float(np.median(values)), max(values)))
        lines.append(f"{name:60}{shown}")

    for method, peers in PEERS.items():
        line(f"{method}: ours", ours(method))
        for name, peer in peers.items():
            line(f"{method}: {name}", [peer(seed) for seed in SEEDS])
    for name, (method, settings) in ALONE.items():
        line(name, ours(method, **settings))
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    sys.stdout.write(side_by_side())

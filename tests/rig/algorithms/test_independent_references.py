"""Our algorithms beside independent implementations of the same family: same objective, same box, same budget.

Objective: a damper loop of five parameters, sum of squares, in a box about twenty times its size. "Within the spread"
means that over eight seeds the values overlap and their medians differ by less than a decade, of five the box spans.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import numpy as np
import pytest
from scipy.optimize import differential_evolution

from rig.identification.algorithms import minimise

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


def pymoo_pso(seed: int) -> float:
    pytest.importorskip("pymoo", reason="the peers extra is not installed")
    from pymoo.algorithms.soo.nonconvex.pso import PSO

    return pymoo_search(PSO(pop_size=POPULATION), seed)


def pymoo_ga(seed: int) -> float:
    pytest.importorskip("pymoo", reason="the peers extra is not installed")
    from pymoo.algorithms.soo.nonconvex.ga import GA

    return pymoo_search(GA(pop_size=POPULATION), seed)


def pymoo_search(algorithm: object, seed: int) -> float:
    from pymoo.core.problem import Problem
    from pymoo.optimize import minimize

    loop = Loop()

    class Wrapped(Problem):  # type: ignore[misc]  # pymoo has no annotations
        def __init__(self) -> None:
            super().__init__(n_var=5, n_obj=1, xl=BOX[:, 0], xu=BOX[:, 1])

        def _evaluate(self, x: np.ndarray, out: dict[str, np.ndarray], *_: object, **__: object) -> None:
            out["F"] = loop.batch(x)

    return float(minimize(Wrapped(), algorithm, ("n_eval", BUDGET), seed=seed).F[0])


def pygmo_bees(seed: int) -> float:
    pygmo = pytest.importorskip("pygmo", reason="the peers extra is not installed")
    loop = Loop()

    class Wrapped:
        def fitness(self, vector: np.ndarray) -> list[float]:
            return [loop.one(vector)]

        def get_bounds(self) -> tuple[list[float], list[float]]:
            return BOX[:, 0].tolist(), BOX[:, 1].tolist()

    population = pygmo.population(pygmo.problem(Wrapped()), size=POPULATION, seed=seed)
    generations = (BUDGET - POPULATION) // (2 * POPULATION)
    bees = pygmo.algorithm(pygmo.bee_colony(gen=generations, limit=150, seed=seed))
    return float(bees.evolve(population).champion_f[0])


@pytest.mark.filterwarnings("ignore")  # the peers' own deprecations are not ours
@pytest.mark.parametrize(
    ("method", "settings", "peer"),
    [
        ("de", {}, scipy_de),
        ("de", {"strategy": 5}, scipy_de),
        ("pso", {}, pymoo_pso),
        ("ga", {}, pymoo_ga),
        ("i_abc", {}, pygmo_bees),
    ],
)
def test_the_same_family_reaches_the_same_values(
    method: str, settings: dict[str, object], peer: Callable[[int], float]
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        theirs = np.log10([peer(seed) for seed in SEEDS])
    mine = np.log10(ours(method, **settings))
    assert abs(np.median(mine) - np.median(theirs)) < 1.0, (mine, theirs)
    assert mine.min() <= theirs.max(), (mine, theirs)
    assert theirs.min() <= mine.max(), (mine, theirs)

"""Hybrid, and evaluation on threads and processes."""

from __future__ import annotations

import threading
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from typing import TYPE_CHECKING

import numpy as np
import pytest

from rig.optimisers import SearchError, minimise
from rig.optimisers.evaluation import Evaluation

if TYPE_CHECKING:
    from conftest import Bowl


class Recording:
    """An objective that carries a recording of a megabyte and counts how often it is pickled."""

    n_parameters = 3
    pickled = 0

    def __init__(self) -> None:
        self.time = np.linspace(0.0, 1.0, 125_000)
        self.force = 2.0 * np.sin(7.0 * self.time) - 1.0

    def __getstate__(self) -> dict[str, np.ndarray]:
        Recording.pickled += 1
        return {"time": self.time, "force": self.force}

    def batch(self, population: np.ndarray) -> np.ndarray:
        model_force = population[:, :1] * np.sin(population[:, 1:2] * self.time) + population[:, 2:]
        return np.mean((model_force - self.force) ** 2, axis=1)


def test_hybrid_reaches_the_bottom_its_swarm_does_not(bowl: Bowl) -> None:
    swarm = minimise(bowl, method="c_foa", budget=4000, seed=1)
    both = minimise(bowl, method="hybrid", budget=4000, seed=1)
    assert both.stopped_by == "converged"
    assert both.value < 1e-20 < swarm.value
    assert both.evaluations < 4000


def test_hybrid_leads_any_other_algorithm_with_its_settings(bowl: Bowl) -> None:
    found = minimise(bowl, method="hybrid", first="de", settings={"strategy": 5}, share=0.5, budget=1000, seed=1)
    assert found.value < 1e-20


def test_hybrid_names_what_an_objective_without_residuals_does_not_have() -> None:
    with pytest.raises(SearchError, match=r"hybrid: Recording has no residuals\(vector\)\. Fix: use 'c_foa'"):
        minimise(Recording(), method="hybrid", budget=100)


def searched(executor: Executor | None) -> np.ndarray:
    found = minimise(
        Recording(),
        method="de",
        bounds=[(0.0, 10.0)] * 3,
        population=12,
        budget=240,
        seed=4,
        executor=executor,
        chunks=3,
    )
    return found.history


def test_threads_and_processes_find_exactly_what_one_thread_finds() -> None:
    alone = searched(None)
    with ThreadPoolExecutor(2) as threads:
        assert np.array_equal(searched(threads), alone)
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        assert np.array_equal(searched(processes), alone)


@pytest.mark.nightly
def test_the_recording_travels_to_a_worker_once_and_not_with_every_task() -> None:
    objective, rng = Recording(), np.random.default_rng(1)
    Recording.pickled = 0
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as processes:
        evaluation = Evaluation(processes, chunks=2)
        for _ in range(30):
            points = rng.random((10, 3))
            assert np.allclose(evaluation.values(objective, points), objective.batch(points))
    assert Recording.pickled == 1
    assert 1 <= evaluation.shipped <= 4


def test_a_population_is_cut_into_few_large_chunks() -> None:
    sizes, lock = [], threading.Lock()

    class Watched(Recording):
        def batch(self, population: np.ndarray) -> np.ndarray:
            with lock:
                sizes.append(len(population))
            return super().batch(population)

    with ThreadPoolExecutor(2) as threads:
        Evaluation(threads, chunks=2).values(Watched(), np.random.default_rng(1).random((51, 3)))
    assert sorted(sizes) == [25, 26]

"""Requirements for an identification method (`rig.optimisers.methods.Algorithm`)."""

from __future__ import annotations

import dataclasses

import numpy as np
import numpy.typing as npt
import pytest

from rig.optimisers import METHODS, Progress, minimise

TARGET = np.array([1.0, -2.0, 3.0, 0.5])
BOX = [(-10.0, 10.0)] * 4
Points = npt.NDArray[np.float64]


class Bowl:
    """Sum of squares about `TARGET`; remembers every point it was asked at.

    Attributes:
        holes: where the first coordinate is above 4 the value is infinite.
    """

    n_parameters = 4

    def __init__(self, *, holes: bool = False) -> None:
        self.requests: list[Points] = []
        self.holes = holes

    def residuals(self, vector: Points) -> Points:
        """The terms, for methods that want them."""
        self.requests.append(vector[None, :].copy())
        return np.asarray(vector - TARGET)

    def batch(self, points: Points) -> Points:
        """Values (N,) of points (N, 4)."""
        self.requests.append(points.copy())
        values = np.sum((points - TARGET) ** 2, axis=1)
        return np.where(self.holes & (points[:, 0] > 4.0), np.inf, values)

    @property
    def points(self) -> Points:
        """Every point that was asked for, shape (n, 4)."""
        return np.concatenate(self.requests)


def test_its_settings_have_defaults_and_are_a_dataclass(method_name: str) -> None:
    made = METHODS[method_name]()
    assert dataclasses.is_dataclass(made)


def test_no_candidate_leaves_the_bounds(method_name: str) -> None:
    bowl = Bowl()
    minimise(bowl, method=method_name, bounds=BOX, budget=2000, seed=1)
    assert bowl.points.min() >= -10.0
    assert bowl.points.max() <= 10.0


@pytest.mark.parametrize("budget", [1, 49, 50, 51, 777])
def test_the_budget_is_never_exceeded(method_name: str, budget: int) -> None:
    bowl = Bowl()
    result = minimise(bowl, method=method_name, bounds=BOX, budget=budget, seed=3)
    assert result.evaluations <= budget
    assert len(bowl.points) <= budget


def test_the_same_seed_gives_the_same_result_and_another_seed_another(method_name: str) -> None:
    first, again, other = (
        minimise(Bowl(), method=method_name, bounds=BOX, budget=600, seed=seed) for seed in (5, 5, 6)
    )
    assert np.array_equal(first.best, again.best)
    assert np.array_equal(first.history, again.history)
    assert not np.array_equal(first.history, other.history), "the method must use the random generator of the search"


def test_the_best_point_it_ever_requested_is_the_result_and_history_never_rises(method_name: str) -> None:
    bowl = Bowl()
    result = minimise(bowl, method=method_name, bounds=BOX, budget=1000, seed=2)
    values = np.sum((bowl.points - TARGET) ** 2, axis=1)
    assert result.value == pytest.approx(values.min(), rel=1e-12)
    assert np.all(np.diff(result.history[:, 1]) <= 0.0)


def test_it_improves_on_a_bowl_whose_bottom_is_known(method_name: str) -> None:
    result = minimise(Bowl(), method=method_name, bounds=BOX, budget=5000, seed=4)
    drawn = np.random.default_rng(0).uniform(-10.0, 10.0, (5000, 4))
    by_chance = float(np.min(np.sum((drawn - TARGET) ** 2, axis=1)))
    assert result.value < 0.5 * by_chance, "the result must be better than that of a random search"


def test_values_that_are_not_finite_do_no_harm(method_name: str) -> None:
    result = minimise(Bowl(holes=True), method=method_name, bounds=BOX, budget=2000, seed=7)
    assert np.isfinite(result.value)
    assert np.all(np.isfinite(result.best))


def test_it_ends_on_request(method_name: str) -> None:
    seen: list[Progress] = []

    def enough(progress: Progress) -> bool:
        seen.append(progress)
        return len(seen) >= 3

    result = minimise(Bowl(), method=method_name, bounds=BOX, budget=100_000, seed=1, callback=enough)
    assert result.stopped_by == "callback"
    assert result.evaluations < 100_000

"""What every algorithm promises, whichever it is."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from rig.optimisers import METHODS, Progress, SearchError, minimise
from rig.optimisers.methods import STEERED_BY_BUDGET

if TYPE_CHECKING:
    from conftest import Bowl

BOX = [(-10.0, 10.0)] * 4
POPULATION_METHODS = [method for method in METHODS if method != "hybrid"]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("budget", [1, 49, 50, 51, 777])
def test_the_budget_is_never_exceeded(bowl: Bowl, method: str, budget: int) -> None:
    found = minimise(bowl, method=method, budget=budget, seed=3)
    spent_in_batches = len(bowl.points)
    assert found.evaluations <= budget
    assert spent_in_batches <= budget


@pytest.mark.parametrize("method", POPULATION_METHODS)
def test_a_budget_that_ends_the_search_is_spent_to_the_last_evaluation(bowl: Bowl, method: str) -> None:
    found = minimise(bowl, method=method, budget=333, seed=3)
    assert found.stopped_by == "budget"
    assert found.evaluations == 333 == len(bowl.points)


@pytest.mark.parametrize("method", METHODS)
def test_the_same_seed_gives_the_same_result_and_another_seed_another(bowl: Bowl, method: str) -> None:
    first, again, other = (minimise(bowl, method=method, budget=600, seed=seed) for seed in (5, 5, 6))
    assert np.array_equal(first.best, again.best)
    assert first.value == again.value
    assert np.array_equal(first.history, again.history)
    assert not np.array_equal(first.history, other.history)


@pytest.mark.parametrize("method", METHODS)
def test_history_counts_up_and_never_rises(bowl: Bowl, method: str) -> None:
    found = minimise(bowl, method=method, budget=900, seed=1)
    assert np.all(np.diff(found.history[:, 0]) > 0)
    assert np.all(np.diff(found.history[:, 1]) <= 0)
    assert found.history[-1, 0] == found.evaluations
    assert found.history[-1, 1] == found.value


@pytest.mark.parametrize("method", POPULATION_METHODS)
def test_the_best_point_ever_evaluated_is_archived(bowl: Bowl, method: str) -> None:
    found = minimise(bowl, method=method, budget=1000, seed=2)
    values = [float(np.sum((point - bowl.target) ** 2)) for point in bowl.points]
    assert found.value == min(values)
    assert np.sum((found.best - bowl.target) ** 2) == found.value


@pytest.mark.parametrize("method", [method for method in METHODS if method not in STEERED_BY_BUDGET])
def test_a_mark_holds_to_the_bit_what_a_search_of_that_budget_finds(bowl: Bowl, method: str) -> None:
    whole = minimise(bowl, method=method, budget=900, seed=7, marks=[10, 120, 375, 900])
    for budget, (best, value) in whole.marks.items():
        alone = minimise(bowl, method=method, budget=budget, seed=7)
        assert value == alone.value
        assert np.array_equal(best, alone.best)
    assert whole.marks[10][1] > whole.marks[900][1]


def test_a_mark_beyond_the_end_of_a_search_holds_its_end(bowl: Bowl) -> None:
    whole = minimise(bowl, method="ga_novel", bounds=BOX, budget=100_000, seed=1, marks=[90_000])
    assert whole.evaluations < 90_000
    assert whole.marks[90_000] == (pytest.approx(whole.best), whole.value)


@pytest.mark.parametrize("method", POPULATION_METHODS)
def test_no_point_outside_the_bounds_is_ever_evaluated(method: str, positive_bowl: Bowl) -> None:
    bounds = [(0.25, 2.0)] * 4
    minimise(positive_bowl, method=method, bounds=bounds, start=np.ones(4), budget=1500, seed=4)
    points = np.array(positive_bowl.points)
    assert points.min() >= 0.25
    assert points.max() <= 2.0


@pytest.mark.parametrize("method", [method for method in POPULATION_METHODS if method != "foa"])
def test_a_bowl_in_a_box_is_found_to_a_thousandth_of_its_height(bowl: Bowl, method: str) -> None:
    worst = 4 * 12.0**2
    found = minimise(bowl, method=method, bounds=BOX, budget=20_000, seed=1)
    assert found.value < worst / 1000


@pytest.mark.parametrize("method", METHODS)
def test_a_callback_that_says_stop_ends_the_search(bowl: Bowl, method: str) -> None:
    seen = []

    def stop_after_three(progress: Progress) -> bool:
        seen.append(progress.value)
        return len(seen) == 3

    found = minimise(bowl, method=method, budget=5000, seed=1, callback=stop_after_three)
    assert found.stopped_by == "callback"
    assert len(seen) == 3
    assert found.value == seen[-1]


def test_values_that_are_not_numbers_count_as_worst() -> None:
    class Holed:
        n_parameters = 2

        def batch(self, population: np.ndarray) -> np.ndarray:
            return np.where(population[:, 0] < 0.0, np.nan, np.sum(population**2, axis=1))

    found = minimise(Holed(), method="de", bounds=[(-1.0, 1.0)] * 2, budget=2000, seed=1)
    assert np.isfinite(found.value)
    assert found.best[0] >= 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        ({"method": "psso"}, r"method: got 'psso' \(did you mean 'pso'\?\)"),
        ({"method": "c_foa", "kapa": 3}, r"c_foa: got setting 'kapa' \(did you mean 'kappa'\?\)"),
        ({"method": "c_foa", "M": 1.5}, r"c_foa: M: got 1.5, expected"),
        ({"method": "de", "strategy": 3}, r"de: strategy: got 3, expected 4 .* or 5"),
        ({"method": "pso", "bounds": [(0.0, 1.0)]}, r"bounds: got shape \(1, 2\), expected \(4, 2\)"),
        ({"method": "pso", "bounds": [(1.0, 0.0)] + [(0.0, 1.0)] * 3}, r"bounds\[0\]: got \(1, 0\)"),
        ({"method": "pso", "start": [1.0]}, r"start: got shape \(1,\), expected \(4,\)"),
        ({"method": "pso", "bounds": BOX, "start": [0.0, 11.0, 0.0, 0.0]}, r"start\[1\]: got 11, expected -10 to 10"),
        ({"method": "ga", "population": 2}, r"population: got 2, expected 4"),
        ({"method": "ga", "budget": 0}, r"budget: got 0, expected 1"),
        ({"method": "hybrid", "first": "hybrid"}, r"hybrid: first: got 'hybrid'"),
    ],
)
def test_a_wrong_search_is_refused_by_name_before_anything_is_evaluated(
    bowl: Bowl, call: dict[str, Any], message: str
) -> None:
    with pytest.raises(SearchError, match=message):
        minimise(bowl, **call)
    assert bowl.points == []

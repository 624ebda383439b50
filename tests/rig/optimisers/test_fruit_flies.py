"""c-FOA (13)-(19) and FOA, step by step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import pytest

from rig.optimisers import fruit_fly, minimise

if TYPE_CHECKING:
    from conftest import Bowl


def test_equation_13_places_flies_between_the_radius_and_its_discrete_steps() -> None:
    attraction = np.array([[2.0, -4.0], [1.0, 10.0]])
    draws = np.array([[[1, 2]], [[3, 4]]])
    flies = fruit_fly.swarm(attraction, 0.5, draws, resolution=4)
    # factor 1 + 0.5 (2 r/4 - 1) for r = 1, 2, 3, 4: 0.75, 1, 1.25, 1.5
    assert np.allclose(flies, [[[1.5, -4.0]], [[1.25, 15.0]]])


def test_equations_14_and_15_turn_a_position_into_a_signed_inverse_distance() -> None:
    position = np.array([[3.0, -0.6, -0.3, 0.0], [4.0, 0.8, -0.4, 2.0]])
    assert np.allclose(fruit_fly.parameters(position), [0.2, -1.0, 2.0, 0.0])


def test_coordinates_invert_the_equations() -> None:
    point = np.array([-270.0, 3.83, 1e-6])
    assert np.allclose(fruit_fly.parameters(fruit_fly.coordinates(point)), point, rtol=1e-14)


@pytest.mark.parametrize(
    ("value", "back", "decision"), [(1.0, 2.0, "surge"), (2.0, 2.0, "contrast"), (3.0, 2.0, "cast")]
)
def test_the_swarm_surges_when_better_looks_for_contrast_when_equal_and_casts_when_worse(
    value: float, back: float, decision: str
) -> None:
    assert fruit_fly.decide(value, back) == decision


class Recorder:
    """Lowest values from a list, one a generation, rising with the magnitude; remembers every generation."""

    n_parameters = 1

    def __init__(self, generations: Sequence[float]) -> None:
        self.generations = iter(generations)
        self.populations = []

    def batch(self, population: np.ndarray) -> np.ndarray:
        self.populations.append(population.copy())
        lowest = next(self.generations)
        rank = np.argsort(np.argsort(np.abs(population[:, 0])))
        return lowest + rank.astype(float)


def spread(population: np.ndarray) -> float:
    """Largest over smallest magnitude: ((1 + M) / (1 - M + 2 M / N_res)) for a full swarm."""
    magnitude = np.abs(population[:, 0])
    return magnitude.max() / magnitude.min()


def test_as_intended_the_radius_contracts_after_kappa_generations_of_improvement() -> None:
    values = [1000.0, *np.arange(900.0, 0.0, -100.0)]
    objective = Recorder(values)
    minimise(objective, method="c_foa", population=4000, budget=1 + 4 * 4000, kappa=2, M=0.9, c=0.1, resolution=10)
    wide, still_wide, narrow, still_narrow = (spread(population) for population in objective.populations[1:5])
    assert wide == pytest.approx(still_wide, rel=0.05)
    assert narrow < 1.3 < wide
    assert still_narrow == pytest.approx(narrow, rel=0.05)


def test_as_intended_a_contrast_jump_goes_to_the_worst_fly_and_is_undone_when_it_does_not_pay() -> None:
    values = [10.0, 20.0, 20.0, 100.0, 100.0, 100.0]
    objective = Recorder(values)
    minimise(objective, method="c_foa", population=50, budget=1 + 5 * 50, kappa=2, M=0.5, resolution=1000)
    start, first, second, third, fourth, fifth = (population[:, 0] for population in objective.populations)
    worst_of_second = second[np.argmax(np.abs(second))]
    for population in (first, second, fifth):
        assert np.median(np.abs(population)) == pytest.approx(start[0], rel=0.2)
    for population in (third, fourth):
        assert np.median(population) == pytest.approx(worst_of_second, rel=0.2)
    assert abs(worst_of_second) > 1.3


def test_as_printed_the_swarm_decides_when_its_time_exceeds_kappa_and_by_the_value_kappa_steps_back() -> None:
    # kappa = 2: t = 3 at the third swarm. Its best, 700, is below Sm0[k - kappa] = Sm0[1] = 1000: surge, M = 0.09 then
    objective = Recorder([1000.0, 900.0, 800.0, 700.0, 600.0])
    settings = {"kappa": 2, "M": 0.9, "c": 0.1, "resolution": 10, "variant": "printed"}
    minimise(objective, method="c_foa", population=4000, budget=1 + 4 * 4000, **settings)
    first, second, third, fourth = (spread(population) for population in objective.populations[1:5])
    assert first == pytest.approx(third, rel=0.05)
    assert second == pytest.approx(third, rel=0.05)
    assert fourth < 1.3 < third


def test_as_printed_casting_returns_to_where_the_swarm_already_is() -> None:
    # every swarm is worse than the start: the attraction point never left it, so returning changes nothing
    objective = Recorder([10.0, 20.0, 21.0, 22.0, 23.0, 24.0])
    settings = {"kappa": 2, "M": 0.5, "resolution": 1000, "variant": "printed"}
    minimise(objective, method="c_foa", population=50, budget=1 + 5 * 50, **settings)
    start, *swarms = (population[:, 0] for population in objective.populations)
    for swarm in swarms:
        assert np.median(swarm) == pytest.approx(start[0], rel=0.2)


def test_foa_moves_to_its_best_fly_and_only_to_a_better_one() -> None:
    objective = Recorder([10.0, 5.0, 7.0, 6.0])  # generations two, three and four start from the best of generation two
    minimise(objective, method="foa", population=200, budget=800, seed=2)
    distances = [1.0 / population[:, 0] for population in objective.populations]
    best_of_second = distances[1][np.argmin(np.abs(objective.populations[1][:, 0]))]
    for swarm in distances[2:]:
        assert np.all(np.abs(swarm - best_of_second) <= np.sqrt(2.0))  # each coordinate moves one either way


def test_as_printed_the_signs_of_the_start_are_never_left(bowl: Bowl) -> None:
    minimise(bowl, method="c_foa", variant="printed", budget=5000, seed=1, start=[1.0, 1.0, 1.0, -1.0])
    points = np.array(bowl.points)
    assert np.all(points[:, :3] > 0.0)
    assert np.all(points[:, 3] < 0.0)


def test_as_intended_a_negative_optimum_is_reached_from_all_ones(bowl: Bowl) -> None:
    found = minimise(bowl, method="c_foa", budget=16_000, seed=3)
    assert found.best[1] < 0.0


def test_zero_absorbs_so_a_zero_of_the_start_is_taken_as_one(bowl: Bowl) -> None:
    minimise(bowl, method="c_foa", start=[1.0, -1.0, 0.0, 1.0], budget=1)
    assert bowl.points[0] == pytest.approx([1.0, -1.0, 1.0, 1.0])


def test_foa_places_flies_one_either_side_and_takes_the_inverse_distance() -> None:
    centre = np.array([[3.0], [4.0]])
    flies = fruit_fly.original_swarm(centre, np.array([[[0.5], [1.0]], [[0.5], [0.0]]]))
    assert np.allclose(flies[:, :, 0], [[3.0, 4.0], [4.0, 3.0]])
    assert np.allclose(fruit_fly.original_parameters(flies), [[0.2], [0.2]])


def test_foa_never_evaluates_a_negative_parameter(bowl: Bowl) -> None:
    found = minimise(bowl, method="foa", budget=10_000, seed=1)
    assert np.array(bowl.points).min() > 0.0
    assert found.value > 4.0  # the optimum's second parameter is -2


def test_foa_starts_where_it_can_and_draws_what_it_cannot_represent(bowl: Bowl) -> None:
    minimise(bowl, method="foa", start=[5e-3, -2.0, 4e-3, 0.0], budget=4, population=4, seed=1)
    points = np.array(bowl.points)
    assert np.all(np.abs(1.0 / points[:, 0] - 200.0) < 2.0)  # steps of one in the coordinates
    assert np.all(np.abs(1.0 / points[:, 2] - 250.0) < 2.0)
    assert np.all(points > 0.0)

"""Both papers' genetic algorithms, step by step."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import pytest

from rig.optimisers import genetic, minimise, statistical_genetic
from rig.optimisers.search import make_search
from rig.optimisers.statistical_genetic import StatisticalStop, blend, pick, rank_weights, roulette

if TYPE_CHECKING:
    from conftest import Bowl


class Line:
    """The distance from 0 of one number."""

    n_parameters = 1

    def batch(self, population: np.ndarray) -> np.ndarray:
        return np.abs(population[:, 0])


def test_matlab_expectation_falls_with_the_square_root_of_rank() -> None:
    shares = genetic.expectation(4)
    assert shares.sum() == pytest.approx(1.0)
    assert shares[3] / shares[0] == pytest.approx(0.5)
    assert shares[1] / shares[0] == pytest.approx(1.0 / math.sqrt(2.0))


def test_stochastic_uniform_walks_the_wheel_in_equal_steps_from_one_offset() -> None:
    shares = np.array([0.5, 0.3, 0.2])
    assert genetic.stochastic_uniform(shares, 4, 0.0).tolist() == [0, 0, 1, 1]  # at 0, 0.25, 0.5, 0.75
    assert genetic.stochastic_uniform(shares, 4, 0.5).tolist() == [0, 0, 1, 2]  # at 0.125, 0.375, 0.625, 0.875


def test_a_child_is_a_weighted_average_of_its_parents() -> None:
    child = genetic.weighted_average(np.array([[0.0, 10.0]]), np.array([[4.0, 20.0]]), np.array([[0.25, 0.5]]))
    assert child.tolist() == [[1.0, 15.0]]


def test_a_generation_holds_the_elite_four_fifths_children_and_mutants_for_the_rest(bowl: Bowl) -> None:
    found = minimise(bowl, method="ga", population=50, budget=50 + 3 * 47, seed=1)
    assert found.generations == 3  # the elite, ceil(0.05 N) = 3, is not evaluated again
    assert found.evaluations == 50 + 3 * 47


def test_gaussian_mutation_has_shrunk_to_nothing_at_the_last_generation(bowl: Bowl) -> None:
    minimise(bowl, method="ga", population=50, budget=50 + 100 * 47, seed=1, stall_generations=0)
    points = np.array(bowl.points)
    mutants_first, mutants_last = points[50 + 38 : 50 + 47], points[-9:]
    assert np.std(mutants_first) > 5.0
    assert np.std(mutants_last - mutants_last.mean(axis=0)) < 0.5


def test_ga_stalls_when_nothing_changes_for_so_many_generations() -> None:
    assert not genetic.stalled([5.0, 5.0], 2, 1e-6)
    assert genetic.stalled([5.0, 5.0, 5.0], 2, 1e-6)
    assert not genetic.stalled([6.0, 5.5, 5.0], 2, 1e-6)
    assert not genetic.stalled([5.0] * 100, 0, 1e-6)


def test_rank_weights_of_the_novel_ga_fall_linearly() -> None:
    assert np.allclose(rank_weights(4), [0.4, 0.3, 0.2, 0.1])


def test_the_parent_is_the_first_whose_cumulative_probability_reaches_the_draw() -> None:
    assert pick(rank_weights(4), np.array([0.0, 0.39, 0.41, 0.71, 0.95])).tolist() == [0, 0, 1, 2, 3]


def test_two_children_blend_their_parents_and_keep_the_sum() -> None:
    first, second = blend(np.array([[10.0, 0.0]]), np.array([[2.0, 4.0]]), np.array([[0.25]]))
    assert first.tolist() == [[8.0, 1.0]]
    assert second.tolist() == [[4.0, 3.0]]


def test_a_father_is_never_his_childs_mother() -> None:
    mothers = np.zeros(500, dtype=np.int64)
    fathers = statistical_genetic.other_parents(rank_weights(3), mothers, np.random.default_rng(1))
    assert np.all(fathers != mothers)
    share = np.mean(fathers == 1)
    assert share == pytest.approx(2.0 / 3.0, abs=0.08)  # weights 2 : 1 remain of 3 : 2 : 1


def test_mutation_replaces_single_variables_inside_the_bounds_and_spares_the_elite() -> None:
    members = np.full((10, 4), 100.0)
    rows = statistical_genetic.mutate(members, np.zeros(4), np.full(4, 2.0), 7, np.random.default_rng(2))
    changed = members != 100.0
    assert changed.sum() == 7
    assert not changed[0].any()
    assert np.flatnonzero(changed.any(axis=1)).tolist() == rows.tolist()
    assert np.all((members[changed] >= 0.0) & (members[changed] <= 2.0))


def test_the_novel_ga_evaluates_children_before_it_mutates_them(bowl: Bowl) -> None:
    bounds = [(-10.0, 10.0)] * 4
    minimise(bowl, method="ga_novel", bounds=bounds, population=8, budget=12, seed=3, mutation_rate=0.5)
    first, children = np.array(bowl.points[:8]), np.array(bowl.points[8:12])
    order = np.argsort(np.sum((first - bowl.target) ** 2, axis=1))
    parents = first[order[:4]]
    sums = [parents[i] + parents[j] for i in range(4) for j in range(4) if i != j]
    for couple in range(2):
        total = children[couple] + children[couple + 2]
        assert min(np.abs(each - total).max() for each in sums) < 1e-12


def test_the_statistical_stop_follows_the_exponential_distribution() -> None:
    stop = StatisticalStop(q_min=3, p=0.05)
    assert [stop.add(error) for error in (150.0, 1.0, 1.0)] == [False, False, False]
    # mean 152/3, e_max 150
    assert stop.chance() == pytest.approx(math.exp(-0.2 * 150.0 / (152.0 / 3.0)))
    stopped_after = next(q for q in range(4, 1000) if stop.add(1.0))
    # exp(-0.2 e_max / mean) <= 0.05 needs mean <= 150 * 0.2 / ln 20 = 10.01: (149 + q) / q <= 10.01
    assert stopped_after == math.ceil(149.0 / (30.0 / math.log(20.0) - 1.0))


def test_the_statistical_stop_waits_for_enough_generations_and_p_0_disables_it() -> None:
    patient, never = StatisticalStop(q_min=50, p=0.05), StatisticalStop(q_min=1, p=0.0)
    assert not any(patient.add(error) for error in [1e9] + [1e-9] * 48)
    assert patient.add(1e-9)
    assert not any(never.add(error) for error in [1e3] + [1.0] * 500)


@pytest.mark.parametrize("method", ["ga_standard", "ga_kwok", "ga_novel"])
def test_paper_2s_algorithms_stop_by_statistics_before_the_budget(bowl: Bowl, method: str) -> None:
    found = minimise(bowl, method=method, bounds=[(-10.0, 10.0)] * 4, budget=100_000, seed=1)
    assert found.stopped_by == "statistics"
    assert found.generations >= 50
    assert found.evaluations < 100_000


def test_a_roulette_share_is_proportional_to_the_inverse_error() -> None:
    assert np.allclose(roulette(np.array([1.0, 2.0, 4.0])), np.array([4.0, 2.0, 1.0]) / 7.0)
    assert np.allclose(roulette(np.array([1.0, np.inf])), [1.0, 0.0])
    assert np.allclose(roulette(np.array([np.inf, np.inf])), [0.5, 0.5])


def test_every_generation_of_the_novel_ga_mutates_mu_of_the_variables_outside_the_elite(bowl: Bowl) -> None:
    # N = 8, four variables, mu = 0.25: round(0.25 * 7 * 4) = 7 of the 28 variables outside the elite
    settings = {"bounds": [(-10.0, 10.0)] * 4, "population": 8, "mutation_rate": 0.25}
    found = minimise(bowl, method="ga_novel", budget=8 + 4 + 7, seed=4, **settings)
    first, born = np.array(bowl.points[:8]), np.array(bowl.points[8:12])
    order = np.argsort(np.sum((first - bowl.target) ** 2, axis=1))
    before = np.concatenate([first[order[:4]], born])
    mutated = np.array(bowl.points[12 : int(found.history[2, 0])])
    changed = [min(int(np.sum(row != parent)) for parent in before) for row in mutated]
    assert sum(changed) == 7


def test_the_best_of_a_generation_goes_into_the_next_unchanged(bowl: Bowl) -> None:
    for method in ("ga_standard", "ga_novel"):
        found = minimise(bowl, method=method, bounds=[(-10.0, 10.0)] * 4, budget=2000, seed=2, mutation_rate=1.0, p=0.0)
        assert np.all(np.diff(found.history[:, 1]) <= 0.0)


def test_the_standard_ga_evaluates_its_children_only_after_mutation(bowl: Bowl) -> None:
    settings = {"bounds": [(-10.0, 10.0)] * 4, "population": 8, "mutation_rate": 1.0, "crossover": 1.0}
    minimise(bowl, method="ga_standard", budget=8 + 7, seed=3, **settings)
    first, second = np.array(bowl.points[:8]), np.array(bowl.points[8:15])
    # everything but the elite was mutated in every variable: no value of the first generation is left
    assert len(second) == 7
    assert not np.isin(second, first).any()


def test_kwoks_mutation_perturbs_a_chromosome_as_a_whole_and_selects_nobody(bowl: Bowl) -> None:
    settings = {"bounds": [(-10.0, 10.0)] * 4, "crossover": 0.0, "mutation": 1.0, "width": 1e-3}
    minimise(bowl, method="ga_kwok", population=10, budget=20, seed=5, **settings)
    first, second = np.array(bowl.points[:10]), np.array(bowl.points[10:20])
    moved = second - first  # in place: no chromosome was dropped or chosen
    assert np.all(moved != 0.0)
    assert np.std(moved) == pytest.approx(1e-3 * 20.0, rel=0.5)


def test_kwoks_child_is_a_linear_blend_and_takes_its_first_parents_place(bowl: Bowl) -> None:
    settings = {"bounds": [(-10.0, 10.0)] * 4, "crossover": 1.0, "mutation": 0.0}
    minimise(bowl, method="ga_kwok", population=6, budget=12, seed=5, **settings)
    first, second = np.array(bowl.points[:6]), np.array(bowl.points[6:12])
    for place, child in enumerate(second):
        shares = [
            (child - first[place]) / (other - first[place]) for index, other in enumerate(first) if index != place
        ]
        assert any(np.ptp(share) < 1e-9 and 0.0 <= share[0] < 1.0 for share in shares)


def test_feasible_directions_are_turned_round_at_a_bound_and_halved_where_neither_side_fits() -> None:
    low, high = np.array([-1.0]), np.array([1.0])
    search = make_search(
        Line(), start=None, bounds=np.column_stack([low, high]), population=4, budget=10, seed=1, callback=None,
        executor=None, chunks=None,
    )  # fmt: skip
    members = np.full((50, 1), 1.0)  # magnitude 1: a step of 1.5 leaves upwards, and turned round it stays inside
    turned = genetic.feasible_directions(search, members, np.arange(50), 1.5)
    assert np.allclose(turned, -0.5)
    halved = genetic.feasible_directions(search, members, np.arange(50), 6.0)  # 6 and 3 leave on both sides, 1.5 fits
    assert np.allclose(halved, -0.5)


def test_kwoks_ga_replaces_its_worst_by_the_best(bowl: Bowl) -> None:
    settings = {"crossover": 0.0, "mutation": 1.0, "width": 1e-9, "replaced": 0.5}
    minimise(bowl, method="ga_kwok", bounds=[(-10.0, 10.0)] * 4, budget=150, seed=2, **settings)
    best = min(bowl.points[:100], key=lambda point: float(np.sum((point - bowl.target) ** 2)))
    third = np.array(bowl.points[100:150])
    copies = np.sum(np.all(np.abs(third - best) < 1e-6, axis=1))
    assert copies >= 25

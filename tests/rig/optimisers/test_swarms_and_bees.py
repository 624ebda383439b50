"""PSO (20)-(22), DE rand/1 with dither and I-ABC, step by step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from rig.optimisers import bee_colony, differential_evolution, minimise
from rig.optimisers.particle_swarm import ParticleSwarm, SwarmState, leaders_of, stopped_at_bounds

if TYPE_CHECKING:
    from conftest import Bowl


def test_equation_20_adds_inertia_own_and_neighbours_pull() -> None:
    speed, place, own, leader = (np.array([[value]]) for value in (2.0, 1.0, 3.0, -1.0))
    draws = np.array([[[0.5]], [[0.25]]])
    swarm = ParticleSwarm(self_weight=1.49, social_weight=1.49)
    assert swarm.accelerated(speed, place, own, leader, draws, 0.8)[0, 0] == pytest.approx(1.6 + 1.49 - 0.745)


@pytest.mark.parametrize(
    ("stalls", "better", "stalls_after", "neighbours_after", "inertia_after"),
    [
        (0, True, 0, 12, 1.0),  # c = max(0, -1) < 2: w doubled
        (2, True, 1, 12, 1.0),
        (3, True, 2, 12, 0.5),  # between: w kept
        (7, True, 6, 12, 0.25),  # c > 5: w halved
        (5, False, 6, 24, 0.25),
        (0, False, 1, 24, 1.0),
    ],
)
def test_equations_21_and_22_follow_the_stall_counter(
    stalls: int, better: bool, stalls_after: int, neighbours_after: int, inertia_after: float
) -> None:
    after = SwarmState(inertia=0.5, neighbours=12, stalls=stalls, smallest=12, particles=50).after(better=better)
    assert (after.stalls, after.neighbours, after.inertia) == (stalls_after, neighbours_after, inertia_after)


def test_inertia_and_neighbourhood_stay_inside_their_limits() -> None:
    swarm = SwarmState(inertia=1.1, neighbours=48, stalls=0, smallest=12, particles=50)
    assert swarm.after(better=True).inertia == 1.1
    assert swarm.after(better=False).neighbours == 50
    assert SwarmState(0.15, 12, 9, 12, 50).after(better=False).inertia == 0.1


def test_as_matlabs_page_words_it_inertia_waits_for_an_improvement() -> None:
    swarm = SwarmState(inertia=1.0, neighbours=12, stalls=9, smallest=12, particles=50)
    assert swarm.after(better=False, always=False).inertia == 1.0
    assert swarm.after(better=True, always=False).inertia == 0.5


def test_a_leader_is_the_best_of_the_particle_itself_and_the_neighbours_drawn() -> None:
    own_values = np.array([4.0, 3.0, 2.0, 1.0])
    draws = np.array([[0.0, 0.1, 0.9, 0.8], [0.2, 0.0, 0.1, 0.9], [0.1, 0.2, 0.0, 0.9], [0.1, 0.2, 0.3, 0.0]])
    assert leaders_of(own_values, draws, 2).tolist() == [1, 2, 2, 3]
    assert leaders_of(own_values, draws, 4).tolist() == [3, 3, 3, 3]


def test_a_particle_at_a_bound_loses_that_speed() -> None:
    places, speeds = stopped_at_bounds(np.array([[5.0, 0.5]]), np.array([[2.0, 1.0]]), np.zeros(2), np.full(2, 3.0))
    assert places.tolist() == [[3.0, 0.5]]
    assert speeds.tolist() == [[0.0, 1.0]]


def test_the_papers_inertia_rule_converges_where_the_pages_flies_apart(bowl: Bowl) -> None:
    paper = minimise(bowl, method="pso", budget=8000, seed=1)
    page = minimise(bowl, method="pso", budget=8000, seed=1, inertia_rule="when better")
    assert paper.value < 1e-6 < page.value


@pytest.mark.parametrize("members", [4, 5, 20])
def test_de_partners_are_mutually_different_for_every_member(members: int) -> None:
    rng = np.random.default_rng(1)
    for _ in range(50):
        base, plus, minus = differential_evolution.partners(
            rng.permutation(members), differential_evolution.turns(rng, members)
        )
        assert np.all(base != plus)
        assert np.all(base != minus)
        assert np.all(plus != minus)
        assert sorted(base.tolist()) == list(range(members))


def test_de_mutants_are_rand_1() -> None:
    members = np.array([[0.0], [1.0], [4.0]])
    index = [np.array([0]), np.array([2]), np.array([1])]
    assert differential_evolution.mutants(members, *index, np.array([[0.9]]))[0, 0] == pytest.approx(2.7)


@pytest.mark.parametrize(("strategy", "distinct"), [(4, True), (5, False)])
def test_de_dithers_per_vector_or_per_generation(strategy: int, distinct: bool) -> None:
    class Line:
        n_parameters = 1

        def __init__(self) -> None:
            self.populations = []

        def batch(self, population: np.ndarray) -> np.ndarray:
            self.populations.append(population[:, 0].copy())
            return np.full(len(population), 1.0 + len(self.populations))

    line = Line()
    minimise(line, method="de", strategy=strategy, population=6, budget=12, seed=2)
    first, trials = line.populations
    factors = set()
    for trial in trials:
        fits = [
            (trial - base) / (plus - minus)
            for base in first for plus in first for minus in first
            if len({base, plus, minus}) == 3 and 0.85 <= (trial - base) / (plus - minus) <= 1.0
        ]  # fmt: skip
        assert fits
        factors.add(tuple(np.round(fits, 9)))
    shared = set.intersection(*(set(each) for each in factors))
    assert (len(shared) == 0) is distinct


def test_de_trials_come_back_between_bound_and_base() -> None:
    trials = differential_evolution.bounced(
        np.array([[-3.0, 9.0]]), np.array([[1.0, 2.0]]), np.zeros(2), np.full(2, 4.0), np.full((1, 2), 0.5)
    )
    assert trials.tolist() == [[0.5, 3.0]]


def test_a_de_trial_replaces_its_target_when_it_is_not_worse() -> None:
    class Plateau:
        n_parameters = 1

        def __init__(self) -> None:
            self.populations = []

        def batch(self, population: np.ndarray) -> np.ndarray:
            self.populations.append(population[:, 0].copy())
            return np.where(np.arange(len(population)) % 2, 1.0, 1.0 + len(self.populations))

    plateau = Plateau()  # odd members: trials as good as their target; even ones: worse every generation
    minimise(plateau, method="de", population=4, budget=12, seed=6)
    first, second, third = plateau.populations
    kept = np.where(np.arange(4) % 2, second, first)
    reachable = [
        base + np.array([0.85, 1.0]) * (plus - minus)
        for base in kept for plus in kept for minus in kept if len({base, plus, minus}) == 3
    ]  # fmt: skip
    for trial in third:
        assert any(min(ends) - 1e-9 <= trial <= max(ends) + 1e-9 for ends in reachable)


def test_i_abc_inertia_is_a_half_for_the_unfit_and_grows_with_fitness() -> None:
    weight = bee_colony.inertia(np.array([0.0, 0.5, 1.0]), 0.5)
    assert weight == pytest.approx([0.5, 1.0 / (1.0 + np.exp(-1.0)), 1.0 / (1.0 + np.exp(-2.0))])


def test_i_abc_abandons_a_source_that_failed_too_often(bowl: Bowl) -> None:
    # from the second generation on every bee fails: after limit N p = 1 * 4 * 4 failures a scout is drawn anew
    class Deaf:
        n_parameters = 4

        def __init__(self) -> None:
            self.sizes = []

        def batch(self, population: np.ndarray) -> np.ndarray:
            self.sizes.append(len(population))
            return np.full(len(population), 1.0 if len(self.sizes) == 1 else 2.0)

    deaf = Deaf()
    minimise(deaf, method="i_abc", population=4, budget=400, seed=1)
    first_scout = deaf.sizes.index(1)
    # 4 employed and on average 4 onlookers a generation: 17 failures of one source need 5 to 12 generations
    assert 2 * 5 <= first_scout <= 2 * 12


def test_i_abc_moves_one_component_as_its_equation_says() -> None:
    sources = np.array([[2.0, 7.0], [5.0, 1.0]])
    draws = bee_colony.Draws(np.array([0]), np.array([1]), np.array([0.75]), np.array([0.5]))
    tried = bee_colony.neighbours(sources, np.array([0]), np.array([1.0, 0.0]), np.array([0.8]), np.array([1.0]), draws)
    assert tried.tolist() == [[pytest.approx(1.6 - 1.2 - 0.5), 7.0]]
    assert sources.tolist() == [[2.0, 7.0], [5.0, 1.0]]


def test_i_abc_fitness_is_the_bees() -> None:
    assert bee_colony.fitness(np.array([0.0, 3.0, -2.0, np.inf])).tolist() == [1.0, 0.25, 3.0, 0.0]


def test_bees_go_on_where_no_source_has_a_finite_value_yet() -> None:
    class Cliff:
        """Infinite but in a corner that a first colony of eight may well miss."""

        n_parameters = 2

        def batch(self, population: np.ndarray) -> np.ndarray:
            values = np.sum(population**2, axis=1)
            return np.where(np.all(population > 0.8, axis=1), values, np.inf)

    found = minimise(Cliff(), method="i_abc", bounds=[(-1.0, 1.0)] * 2, population=8, budget=4000, seed=2)
    assert found.history[0, 1] == np.inf
    assert found.value < 1.6

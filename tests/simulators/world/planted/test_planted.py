"""Bugs put in on purpose are found in worlds: by the invariant that is named, and only with the bug."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace

import planted_search
import pytest
from edits import Edit, NoLongerThere
from planted_cases import CASES, PLANTED, Case, with_the_bug, without
from planted_patching import in_force

from rig.station import supervisor
from simulators.world.asked import Asked
from simulators.world.runs import Ended as World
from simulators.world.runs import begin_worker

Ended = tuple[dict[str, str], str]


def world_of(case: Case) -> Case:
    """What several bugs may share."""
    return replace(case, invariant="")


@pytest.fixture(scope="module")
def ended() -> dict[str | Case, Ended]:
    """Every case with its bug by name, and each of their worlds without; in two processes."""
    worlds: dict[str | Case, Ended] = {}
    names, cases = list(CASES), list(dict.fromkeys(map(world_of, CASES.values())))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context, initializer=begin_worker) as pool:
        worlds.update(zip(names, pool.map(with_the_bug, names), strict=True))
        worlds.update(zip(cases, pool.map(without, cases), strict=True))
    return worlds


def test_every_bug_has_its_world() -> None:
    assert set(CASES) == set(PLANTED)


@pytest.mark.parametrize("name", PLANTED)
def test_the_text_of_every_edit_stands_in_a_function_exactly_once(name: str) -> None:
    with in_force(PLANTED[name]):
        pass


@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", CASES)
def test_a_bug_is_found_in_its_world_and_nothing_without_it(name: str, ended: dict[str | Case, Ended]) -> None:
    case = CASES[name]
    assert ended[world_of(case)][0] == {}
    assert case.invariant in ended[name][0], f"held: {ended[name][0]}"


def test_a_bug_is_the_same_in_another_process(ended: dict[str | Case, Ended]) -> None:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        assert pool.submit(with_the_bug, "stop-sent").result() == ended["stop-sent"]


def test_a_search_names_the_first_seed_that_fails_its_replay_and_the_smallest_world(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def one(seed: int, asked: Asked) -> World:
        failed = (("sent", "no stop", 1.0),) if asked.plan(seed).seed >= 5 else ()
        return World(seed, failed, str(seed), 1.0, 1.0, (0,))

    monkeypatch.setattr(planted_search, "one", one)
    monkeypatch.setattr(planted_search, "smallest", lambda name, seed: f"{name} in {seed}")
    monkeypatch.setattr(planted_search.worlds, "SESSION_S", 0.0)
    with ThreadPoolExecutor(1) as pool:
        cells = list(planted_search.looked_for("stop-sent", planted_search.seeds_of("3:9"), pool, 2))
    assert cells == ["5", "sent", "the same", "stop-sent in 5"]


def test_an_edit_is_in_force_only_for_a_while() -> None:
    before = supervisor.Supervisor._carry_out.__code__
    with in_force(PLANTED["stop-sent"]):
        assert supervisor.Supervisor._carry_out.__code__ is not before
    assert supervisor.Supervisor._carry_out.__code__ is before


@pytest.mark.parametrize("old", ["no such text", "TICK_S = 0.005", "self"])
def test_an_edit_that_cannot_be_made_says_so(old: str) -> None:
    with pytest.raises(NoLongerThere), in_force((Edit("rig/station/supervisor.py", old, "TICK_S = 0.006"),)):
        pass

"""Bugs put in on purpose are found in worlds: by the invariant that is named, and only with the bug."""

from __future__ import annotations

import multiprocessing
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace

import planted_search
import pytest
from edits import Edit, NoLongerThere
from planted_cases import (
    CASES,
    PLANTED,
    PULLED,
    Case,
    checked_by_case,
    lived,
    scenario_of,
    with_the_bug,
    without,
)
from planted_patching import in_force
from planted_reach import watched
from planted_search import Unbugged

from rig.station import supervisor
from simulators.scenarios.plan import ScenarioPlan, drawn
from simulators.scenarios.runs import Ended as Scenario
from simulators.scenarios.runs import begin_worker

Ended = tuple[dict[str, str], str]
Without = tuple[dict[str, str], set[str]]


@pytest.fixture(scope="module")
def ended() -> tuple[dict[str, Ended], dict[Case, Without]]:
    """Cases with their bugs by name, and each of their worlds without; in two processes."""
    names, cases = list(CASES), list(dict.fromkeys(map(scenario_of, CASES.values())))
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context, initializer=begin_worker) as pool:
        bugs, healthy = pool.map(with_the_bug, names), pool.map(without, cases)
        return dict(zip(names, bugs, strict=True)), dict(zip(cases, healthy, strict=True))


def test_every_bug_has_its_scenario() -> None:
    assert set(CASES) == set(PLANTED)


@pytest.mark.parametrize("name", PLANTED)
def test_the_text_of_every_edit_stands_in_a_function_exactly_once(name: str) -> None:
    with in_force(PLANTED[name]):
        pass


@pytest.mark.nightly
@pytest.mark.timeout(1500)
@pytest.mark.parametrize("name", CASES)
def test_a_bug_is_found_in_its_scenario_and_nothing_without_it(
    name: str, ended: tuple[dict[str, Ended], dict[Case, Without]]
) -> None:
    assert checked_by_case(name, ended[0][name][0], ended[1][scenario_of(CASES[name])]) == ""


def test_a_rod_that_is_thrown_after_a_gap_in_its_set_points_is_found() -> None:
    """To the end of the machine, after a stop was latched: no check was made of that once."""
    failed = with_the_bug("setpoints-by-clock")[0]
    assert {"travel", "speed", "stopping-distance", "setpoints", "slows-down"} <= set(failed)


@pytest.mark.parametrize("name", ["e-stop-bit", "pressure-off-after-s1"])
def test_an_emergency_stop_and_a_pressure_taken_away_too_late_excuse_nothing(name: str) -> None:
    """The emergency stop itself hid the way by which it is heard; the pressure was gone from the slice's begin on."""
    assert CASES[name].invariant in with_the_bug(name)[0]


def test_an_application_that_was_at_rest_long_before_explains_no_stop() -> None:
    case = replace(CASES["controller-boots"], events=("application-stalled@0.9+0.3", "actuator-reboot@0.5"))
    assert "cause" in lived(case, PLANTED["controller-boots"])[0]
    assert lived(case, ())[0] == {}


@pytest.mark.nightly
def test_a_bug_is_the_same_in_another_process(ended: tuple[dict[str, Ended], dict[Case, Without]]) -> None:
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        assert pool.submit(with_the_bug, "stop-sent").result() == ended[0]["stop-sent"]


@pytest.mark.nightly
def test_a_scenario_that_does_not_come_by_a_bug_is_the_same_with_it() -> None:
    """As it is one that tells what it comes by."""
    pulled = Case("", PULLED)
    with watched(PLANTED) as marks:
        healthy = lived(pulled, ())
    assert ("echo", 0) not in marks
    assert lived(pulled, PLANTED["echo"]) == healthy
    assert lived(pulled, PLANTED["sensor-silent"]) != healthy


def test_of_a_rare_line_only_the_scenarios_that_come_by_it_are_tried() -> None:
    comes_by = {3: {("lease", 1)}, 4: {("lease", 0), ("lease", 1)}, 5: {("lease", 1)}, 6: {("echo", 0)}}
    scenarios = [Unbugged(seed, frozenset(marks), fails=False) for seed, marks in comes_by.items()]
    assert planted_search.worth_trying("lease", scenarios) == [4]
    assert planted_search.worth_trying("echo", scenarios) == [6]
    first, *more = planted_search.likely("echo", range(200))
    assert "modbus-write-lost" in {event.what for event in drawn(first).events}
    assert more == sorted(set(more))
    assert planted_search.worth_trying("lease", scenarios[:1]) == []
    assert planted_search.worth_trying("lease", [replace(scenario, fails=True) for scenario in scenarios]) == []


def test_a_search_names_the_first_seed_that_fails_and_its_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    def first_session(plan: ScenarioPlan) -> Scenario:
        failed = (("sent", "no stop", 1.0),) if plan.seed >= 5 else ()
        return Scenario(plan.seed, failed, str(plan.seed), 1.0, 1.0, (0,), scheduled=("estop@1",))

    monkeypatch.setattr(planted_search, "first_session", first_session)
    monkeypatch.setattr(planted_search, "smallest", lambda name, seed: f"{name} in {seed}")
    with ThreadPoolExecutor(1) as pool:
        count, scenario = planted_search.looked_for("stop-sent", range(3, 9), pool, 2)
        assert scenario is not None
        row = planted_search.row("stop-sent", count, scenario, pool, shrinks=False)
        assert row == "| stop-sent | 5 | 3 | sent | the same | estop@1 |"
        assert planted_search.row("stop-sent", count, scenario, pool, shrinks=True).endswith("| stop-sent in 5 |")
        assert planted_search.looked_for("stop-sent", range(3, 5), pool, 2) == (2, None)


def test_an_edit_is_in_force_only_for_a_while() -> None:
    before = supervisor.Supervisor._carry_out.__code__
    with in_force(PLANTED["stop-sent"]):
        assert supervisor.Supervisor._carry_out.__code__ is not before
    assert supervisor.Supervisor._carry_out.__code__ is before


@pytest.mark.parametrize("old", ["no such text", "TICK_S = 0.005", "self"])
def test_an_edit_that_cannot_be_made_says_so(old: str) -> None:
    with pytest.raises(NoLongerThere), in_force((Edit("rig/station/supervisor.py", old, "TICK_S = 0.006"),)):
        pass

"""Whole campaigns in virtual time: the same again for a seed, and what must hold in them is really looked at."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest

from rig.campaign import results
from rig.station import supervisor
from rig.station.safe_stop import StopAction
from simulators.world.plan import AROUND, Happening, WorldPlan, drawn
from simulators.world.runs import live
from simulators.world.shrink import shrunk
from simulators.world.stage import load_everything

MATRIX = """format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
waveform = ["sine"]
amplitude = ["6 mm"]
frequency = ["4 Hz"]
current = ["0 A", "0.5 A"]
cycles = 6
[identify]
enabled = false
"""


@pytest.fixture(scope="module", autouse=True)
def loaded() -> None:
    load_everything()


def plan(*happenings: str, seed: int = 1) -> WorldPlan:
    return WorldPlan(seed, MATRIX, tuple(map(Happening.parse, happenings)))


def test_an_undisturbed_world_is_one_valid_campaign(tmp_path: Path) -> None:
    world, ended = live(plan(), tmp_path)
    assert ended.failed == ()
    assert ended.sessions == (0,)
    assert [point.verdict for point in world.sessions[0].answer.points] == ["valid", "valid"]
    rows = world.sessions[0].truth.arrays
    assert 0.1 < rows[:, 1].max() < 0.2, "6 mm at 4 Hz"
    assert 0.45 < rows[:, 2].max() < 0.55


def test_a_seed_is_a_world_bit_by_bit_wherever_it_lives(tmp_path: Path) -> None:
    """In another process, another folder and with other hashes too."""
    script = (
        "import sys; from pathlib import Path; from simulators.world.runs import live\n"
        "from simulators.world.plan import WorldPlan; from simulators.world.stage import load_everything\n"
        "load_everything()\n"
        "print(live(WorldPlan.from_json(sys.argv[1]), Path(sys.argv[2]))[1].digest)"
    )
    given = plan("sensor-spike@0.4+0.3", "application-killed@3.5", seed=7)
    digests = set()
    for number in ("1", "2"):
        folder = tmp_path / ("other" * int(number))
        folder.mkdir()
        done = subprocess.run(
            [sys.executable, "-c", script, given.to_json(), str(folder)], capture_output=True, text=True, check=True,
            env=os.environ | {"PYTHONHASHSEED": number}, timeout=120,
        )
        digests.add(done.stdout.strip())
    here = tmp_path / "here"
    here.mkdir()
    assert digests == {live(given, here)[1].digest}


def test_another_seed_is_another_world(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    (tmp_path / "b").mkdir()
    assert live(plan(seed=1), tmp_path / "a")[1].digest != live(plan(seed=2), tmp_path / "b")[1].digest


@pytest.mark.parametrize("death", ["application-killed", "station-killed", "power-cut"])
def test_after_any_death_the_campaign_is_completed(death: str, tmp_path: Path) -> None:
    world, ended = live(plan(f"{death}@3.6"), tmp_path)
    assert ended.failed == ()
    assert ended.sessions[-1] == 0
    assert len(ended.sessions) > 1
    assert [point.verdict for point in world.sessions[-1].answer.points] == ["valid", "valid"]


@pytest.mark.parametrize(("fault", "slug"), [("estop@0.5", "estop"), ("ecu-silent@0.5", "ecu-silent")])
def test_a_fault_stops_the_rig_under_its_name(fault: str, slug: str, tmp_path: Path) -> None:
    world, ended = live(plan(fault), tmp_path)
    assert ended.failed == ()
    assert ended.sessions == (4, 0)
    assert world.sessions[0].answer.stopped_by == slug


def test_a_station_that_does_not_stop_the_motion_is_found_and_shrunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    carry_out = supervisor.Supervisor._carry_out

    def forgetful(self: supervisor.Supervisor, action: StopAction) -> None:
        if action not in {StopAction.FADE, StopAction.HYDRAULICS_LOW, StopAction.HYDRAULICS_OFF}:
            carry_out(self, action)

    monkeypatch.setattr(supervisor.Supervisor, "_carry_out", forgetful)
    given = plan("sample-gap@0.2+0.1", "loadcell-pulled@0.6", "clock-step@1.0+0.5")
    given = replace(given, matrix=MATRIX.replace("cycles = 6", "cycles = 40"))
    _, ended = live(given, tmp_path)
    assert "proved" in {invariant for invariant, _, _ in ended.failed}
    told: list[str] = []
    smallest, _ = shrunk(given, ended, told.append)
    assert [happening.what for happening in smallest.happenings] == ["loadcell-pulled"]
    assert smallest.matrix.count("0.5 A") == 0, "one point is enough"


def test_an_answer_that_lies_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results.PointResults, "valid", property(lambda self: len(self.points) + 1))
    _, ended = live(plan(), tmp_path)
    assert "answer" in {invariant for invariant, _, _ in ended.failed}


def test_plans_are_drawn_and_kept_as_text() -> None:
    plans = [drawn(seed) for seed in range(300)]
    assert plans == [drawn(seed) for seed in range(300)]
    assert all(WorldPlan.from_json(given.to_json()) == given for given in plans)
    happened = {happening.what for given in plans for happening in given.happenings}
    assert set(AROUND) <= happened
    assert {len(given.happenings) for given in plans} >= set(range(6))
    assert {given.held_up for given in plans} == {0.01, 0.3}
    names = [given.seed for given in plans if 'id = "loop"' in given.matrix]
    assert 20 < len(names) < 80, "matrices of points whose names begin alike"
    pairs = [(one, other) for given in plans for one, other in pairwise(given.happenings) if one.at_s and other.at_s]
    assert sum(other.at_s - one.at_s < 0.02 for one, other in pairs) > 20, "two causes within milliseconds"
    assert {given.actuator for given in plans} == {"tcp", "rtu"}
    shorter = replace(plans[0], happenings=(Happening("estop", 1.0), Happening("pause", 2.0, 1.0)))
    assert [str(kept) for kept in shorter.without(shorter.happenings[0]).happenings] == ["pause@2+1"]


def worlds(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "simulators.world", *arguments], capture_output=True, text=True, timeout=170, check=False
    )


def test_the_command_tells_what_it_did(tmp_path: Path) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    done = worlds("--seeds", "3:5", "--matrix", str(matrix), "--happening", "sigint@3", "--jobs", "1", "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["worlds"], answer["failed"]) == (2, [])
    assert answer["rig_hours"] > 0.001
    assert answer["wall_s"] > 0.0
    assert len(set(answer["digests"].values())) == 2
    assert "2/2 worlds, 0 failed" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--seeds", "5:5"], "expected FIRST:END"),
        (["--seeds", "a:b"], "expected FIRST:END"),
        (["--seeds", "-3:1"], "expected FIRST:END"),
        (["--seeds", "1", "--happening", "e-stop@3"], "is no row of the fault matrix"),
        (["--seeds", "1", "--happening", "power-cut@soon"], "write power-cut@SECONDS"),
        (["--seeds", "1", "--matrix", "nowhere.toml"], "nowhere.toml"),
    ],
)
def test_what_no_world_can_begin_with_is_refused(arguments: list[str], says: str) -> None:
    done = worlds(*arguments, "--json")
    assert done.returncode == 2
    assert says in json.loads(done.stdout)["error"]
    assert "Traceback" not in done.stderr


def test_a_matrix_that_the_rig_cannot_do_is_refused(tmp_path: Path) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX.replace("6 mm", "80 mm"), encoding="utf-8")
    done = worlds("--matrix", str(matrix), "--json")
    assert done.returncode == 2
    assert "does not fit the simulated rig" in json.loads(done.stdout)["error"]

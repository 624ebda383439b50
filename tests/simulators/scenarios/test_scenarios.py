"""Whole campaigns in virtual time: the same again for a seed, and what must hold in them is really looked at."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matrices import matrix_text

from rig.campaign import campaign, resume
from rig.cli.main import answered
from rig.matrix.model import load_matrix
from rig.recording.alignment import alignment
from rig.station import supervisor
from rig.station.safe_stop import StopAction
from simulators.scenarios import invariants, runs, shrink, stop_invariants
from simulators.scenarios import scenario as course
from simulators.scenarios.__main__ import command
from simulators.scenarios.drawn_rig import KINDS
from simulators.scenarios.invariants import violations
from simulators.scenarios.plan import AROUND, GAPS, FaultEvent, Given, ScenarioPlan, drawn
from simulators.scenarios.request import Files, ScenarioRequest, request_for
from simulators.scenarios.runs import Ended, live
from simulators.scenarios.scenario import Scenario
from simulators.scenarios.shrink import shrunk

MATRIX = matrix_text("0 A", "0.5 A", amplitude="6 mm", frequency="4 Hz")
REST_S = 12.0
"""What has not come to rest by then never does (virtual s): the stop's own limits are shorter."""


def plan(*events: str, seed: int = 1) -> ScenarioPlan:
    return ScenarioPlan(seed, MATRIX, tuple(map(FaultEvent.parse, events)))


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Scenario, Ended]:
    """The world of seed 1 in which nothing happens."""
    return live(plan(seed=1), tmp_path_factory.mktemp("undisturbed"))


def test_an_undisturbed_scenario_is_one_valid_campaign(undisturbed: tuple[Scenario, Ended]) -> None:
    scenario, ended = undisturbed
    assert ended.failed == ()
    assert ended.sessions == (0,)
    assert [point.verdict for point in scenario.sessions[0].answer.points] == ["valid", "valid"]
    rows = scenario.sessions[0].truth.arrays
    assert 0.1 < rows[:, 1].max() < 0.2, "6 mm at 4 Hz"
    assert 0.45 < rows[:, 2].max() < 0.55


@pytest.mark.parametrize(
    ("invariant", "event", "key", "other"),
    [("points", "result", "verdict", "suspect"), ("wanted-current", "judged", "current_A", 0.2)],
)
def test_a_journal_that_tells_otherwise_is_found(
    invariant: str, event: str, key: str, other: object, undisturbed: tuple[Scenario, Ended],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A verdict that is not the file's, a current that was not the coil's."""
    scenario = undisturbed[0]
    journal = scenario.journal
    line = next(line for line in journal if line.get("event") == event)
    (line["points"][0] if event == "result" else line)[key] = other
    monkeypatch.setattr(Scenario, "journal", property(lambda _: journal))
    assert invariant in {failed for failed, _, _ in violations(scenario)}


def test_an_attempt_without_a_file_is_found_though_another_one_has_it(
    undisturbed: tuple[Scenario, Ended], monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = undisturbed[0]
    journal = scenario.journal
    line = next(line for line in journal if line.get("event") == "judged")
    journal.append({**line, "file": None, "verdict": "invalid", "reasons": ["not-written: its journal is gone"]})
    monkeypatch.setattr(Scenario, "journal", property(lambda _: journal))
    assert "written" in {failed for failed, _, _ in violations(scenario)}


def test_a_program_that_outlasts_its_length_and_a_current_at_the_end_are_found(
    undisturbed: tuple[Scenario, Ended], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As if half of the motion had been ordered, and less than no current counted as 0 A."""
    ordered = load_matrix(undisturbed[0].root / "matrix.toml").points()
    halves = [replace(point, cycles=0.4 * point.cycles) for point in ordered]
    monkeypatch.setattr(stop_invariants, "points_of", lambda _: halves)
    monkeypatch.setattr(invariants, "ZERO_A", -1.0)
    assert {"overrun", "current-told"} <= {failed for failed, _, _ in violations(undisturbed[0])}


@pytest.mark.nightly
@pytest.mark.parametrize("death", ["application-killed", "station-killed", "power-cut"])
def test_after_any_death_the_campaign_is_completed(death: str, tmp_path: Path) -> None:
    scenario, ended = live(plan(f"{death}@3.6"), tmp_path)
    assert ended.failed == ()
    assert ended.sessions[-1] == 0
    assert len(ended.sessions) > 1
    assert [point.verdict for point in scenario.sessions[-1].answer.points] == ["valid", "valid"]


@pytest.mark.nightly
@pytest.mark.parametrize(("fault", "slug"), [("estop@0.5", "estop"), ("ecu-silent@0.5", "ecu-silent")])
def test_a_fault_stops_the_rig_under_its_name(fault: str, slug: str, tmp_path: Path) -> None:
    scenario, ended = live(plan(fault), tmp_path)
    assert ended.failed == ()
    assert ended.sessions == (4, 0)
    assert scenario.sessions[0].answer.stopped_by == slug


@pytest.mark.nightly
def test_a_station_that_does_not_stop_the_motion_is_found_and_shrunk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    carry_out = supervisor.Supervisor._carry_out

    def forgetful(self: supervisor.Supervisor, action: StopAction) -> None:
        if action not in {StopAction.FADE, StopAction.HYDRAULICS_LOW, StopAction.HYDRAULICS_OFF}:
            carry_out(self, action)

    monkeypatch.setattr(supervisor.Supervisor, "_carry_out", forgetful)
    monkeypatch.setattr(course, "REST_S", REST_S)
    given = plan("sample-gap@0.2+0.1", "loadcell-pulled@0.6", "clock-step@1.0+0.5")
    given = replace(given, matrix=MATRIX.replace("cycles = 6", "cycles = 10"))
    _, ended = live(given, tmp_path)
    assert "proved" in {invariant for invariant, _, _ in ended.failed}
    lines: list[str] = []
    smallest, _ = shrunk(given, ended, lines.append)
    assert [event.what for event in smallest.events] == ["loadcell-pulled"]
    assert smallest.matrix.count("0.5 A") == 0, "one point is enough"
    assert "cycles = 5" in smallest.matrix.splitlines()


def test_an_answer_that_lies_is_found(
    undisturbed: tuple[Scenario, Ended], monkeypatch: pytest.MonkeyPatch
) -> None:
    (session,) = undisturbed[0].sessions
    monkeypatch.setattr(session, "answer", replace(session.answer, valid=len(session.answer.points) + 1))
    assert "answer" in {failed for failed, _, _ in violations(undisturbed[0])}


def test_plans_are_drawn_and_kept_as_text() -> None:
    plans = [drawn(seed) for seed in range(300)]
    assert plans == [drawn(seed) for seed in range(300)]
    assert all(FaultEvent.parse(str(event)) == event for given in plans for event in given.events)
    happened = {event.what for given in plans for event in given.events}
    assert set(AROUND) <= happened
    assert {len(given.events) for given in plans} >= set(range(6))
    assert {given.held_up for given in plans} == {0.01, 0.3}
    garbage = [given for given in plans if given.events and given.events[0].what == "serial-garbage"]
    assert [given for given in garbage if given.events[0].lasts_s is None], "it stays where it is a seed's turn"
    assert {given.kind for given in plans} == set(KINDS), "each kind of rig"
    assert min(Counter(given.kind for given in plans).values()) > 25, "in equal parts"
    streamed = [given for given in plans if "STREAMED" in given.bench.upper() or "float-drive" in given.bench]
    assert sum('"cia402-drive"' in given.bench for given in plans) > 5
    on_can = [given.bench for given in plans if "i32" in given.bench and "0.0001" in given.bench]
    assert len(on_can) > 5, "sensors on CAN"
    assert 0 < sum("remote" in bench for bench in on_can) < len(on_can), "some are polled"
    gaps = [one.lasts_s for given in streamed for one in given.events if one.what in GAPS and one.lasts_s]
    assert len(gaps) > 30
    assert min(gaps) < 0.05 < 0.5 < max(gaps), "gaps of some milliseconds, and of a second"
    names = [given.seed for given in plans if 'id = "loop"' in given.matrix]
    assert len(names) >= 3, "matrices of points whose names begin alike"
    pairs = [(one, other) for given in plans for one, other in pairwise(given.events) if one.at_s and other.at_s]
    assert sum(other.at_s - one.at_s < 0.02 for one, other in pairs) > 20, "two causes within milliseconds"
    assert {given.actuator for given in plans} == {"tcp", "rtu"}
    shorter = replace(plans[0], events=(FaultEvent("estop", 1.0), FaultEvent("pause", 2.0, 1.0)))
    assert [str(kept) for kept in shorter.without(shorter.events[0]).events] == ["pause@2+1"]


def run_scenarios(*arguments: str, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-P", "-m", "rig.cli.main", "scenarios", *arguments], capture_output=True, text=True,
        timeout=170, check=False, cwd=cwd,
    )  # fmt: skip


def test_the_command_tells_what_it_did(tmp_path: Path) -> None:
    """In a folder where something else has the name of one of our packages."""
    (tmp_path / "simulators.py").write_text("raise SystemExit(99)", encoding="utf-8")
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX.replace('"0 A", ', ""), encoding="utf-8")
    done = run_scenarios(
        "--seeds", "3:5", "--matrix", "matrix.toml", "--event", "sigint@3", "--event", "estop@99",
        "--jobs", "1", "--json", cwd=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["worlds"], answer["failed"]) == (2, [])
    assert answer["rig_hours"] > 0.001
    assert answer["wall_s"] > 0.0
    assert len(set(answer["digests"].values())) == 2
    assert "2/2 scenarios, none failed" in done.stderr
    assert "all checks passed" in done.stderr
    assert [(one["seed"], one["event"]) for one in answer["not_happened"]] == [(3, "estop@99"), (4, "estop@99")]
    assert "seed 4: the campaign ended before estop@99" in done.stderr
    assert "2 ended before all events had occurred" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--seeds", "5:5"], "the range is empty because END is excluded. Fix: write 5:6"),
        (["--seeds", "9:3"], "FIRST is greater than END. Fix: write 3:9"),
        (["--seeds", "a:b"], "expected FIRST:END"),
        (["--seeds", "-3:1"], "expected FIRST:END"),
        (["--seeds", "1_0:20"], "expected FIRST:END"),
        (["--seeds", "1", "--event", "e-stop@3"], "is neither a row of the fault matrix"),
        (["--seeds", "1", "--event", "power-cut@soon"], "write power-cut@SECONDS"),
        (["--seeds", "1", "--event", "power-cut@nan"], "times must be from 0 to"),
        (["--seeds", "1", "--event", "usb-renumber@1"], "named ports do not exist in a scenario"),
        (["--seeds", "1", "--event", "rtu-crc@1", "--event", "modbus-reset@1"], "connected over tcp"),
        (["--seeds", "1", "--event", "loadcell-pulled:auxiliary@1"], "requires an auxiliary channel"),
        (["--seeds", "1", "--event", "station-stalled@3"], "a duration is required, such as station-stalled@3+0.5"),
        (["--seeds", "1", "--event", "pause@3+0"], "a duration is required"),
        (["--seeds", "1", "--event", "disk-full@3+2"], "has no duration. Fix: write disk-full@3"),
        (["--seeds", "1", "--event", "rtu-crc@1", "--actuator", "tcp"], "this bench is connected over tcp"),
        (["--seeds", "1", "--until", "nan"], "expected a number of seconds above 0"),
        (["--seeds", "0:2", "--trace", "steps"], "--trace accepts only one"),
        (["--seeds", "1", "--shrink", "--until", "3"], "--shrink requires"),
        (["--matrix", "nowhere.toml"], "nowhere.toml: there is no such file"),
        (["--bench", "nowhere.toml"], "nowhere.toml: there is no such file"),
    ],
)
def test_what_no_scenario_can_begin_with_is_refused(
    arguments: list[str], says: str, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert answered(command, [*arguments, "--json"], "rig scenarios") == 2
    out, err = capfd.readouterr()
    assert says in json.loads(out)["error"]
    assert says in err
    assert list(tmp_path.iterdir()) == []


def test_a_matrix_that_the_rig_cannot_do_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX.replace("6 mm", "80 mm"), encoding="utf-8")
    assert answered(command, ["--matrix", str(matrix), "--json"], "rig scenarios") == 3
    answer = json.loads(capfd.readouterr().out)
    assert (answer["slug"], answer["exit_code"]) == ("matrix-infeasible", 3)
    assert "above the bench's limit, 0.8 m/s" in answer["error"]
    assert "31.43 mm" in answer["error"], "the amplitude that fits"


def test_a_scenario_that_fails_is_reported_with_the_command_that_runs_it_again(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    ended = Ended(17, (("points", "p001: told to be finished, and gone", 12.5),), "ab", 36.0, 7.0, (0,))
    monkeypatch.setattr(runs, "every", lambda *_: iter([replace(ended, seed=16, failed=()), ended]))
    assert answered(command, ["--seeds", "16:18", "--event", "power-cut@9", "--json"], "rig scenarios") == 5
    out, err = capfd.readouterr()
    answer = json.loads(out)
    again = "rig scenarios --seeds 17 --event power-cut@9"
    assert [(entry["seed"], entry["invariant"], entry["at_s"]) for entry in answer["failed"]] == [(17, "points", 12.5)]
    assert answer["failed"][0]["again"] == again
    assert answer["rig_hours"] == 0.02
    assert err.rstrip().endswith(f"1 failed (points 1). To reduce the first failing scenario: {again} --shrink")


def test_a_scenario_that_breaks_the_simulation_is_a_failure_of_its_own(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runs, "live", lambda *_: 1 // 0)
    (failure,) = runs.one(3, ScenarioRequest()).failed
    assert failure[0] == "world"
    assert "ZeroDivisionError" in failure[1]


def test_a_trace_is_never_written_over_a_file_that_is_read(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    matrix = tmp_path / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    (tmp_path / "link").symlink_to(matrix)
    arguments = ["--seeds", "1", "--until", "0.1", "--matrix", str(matrix), "--trace", str(tmp_path / "link"), "--json"]
    assert answered(command, arguments, "rig scenarios") == 2
    assert "specify another file" in json.loads(capfd.readouterr().out)["error"]
    assert matrix.read_text(encoding="utf-8") == MATRIX


@pytest.mark.nightly
def test_a_traced_scenario_is_answered_as_any_other(tmp_path: Path) -> None:
    done = run_scenarios("--seeds", "3", "--until", "1.5", "--trace", "steps", "--json", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["worlds"] == 1
    assert json.loads(done.stdout)["judged"] is False
    assert "connecting" in done.stderr
    assert "no checks were performed" in done.stderr
    assert (tmp_path / "steps").read_text(encoding="utf-8").count("application") > 10


def test_a_smallest_scenario_is_reported_with_the_command_that_runs_it(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where nothing has to happen in it."""
    ended = Ended(17, (("points", "gone", 12.5),), "ab", 36.0, 7.0, (0,))
    monkeypatch.setattr(shrink, "alone", lambda _: ended)
    monkeypatch.setattr(shrink, "shrunk", lambda given, *_: (replace(given, events=(), matrix=MATRIX), ended))
    bench = Path("a bench.toml")
    shrink.show_smallest(17, ScenarioRequest(Given(bench="", usual=True), Files(bench=bench)))
    err = capfd.readouterr().err
    again = "rig scenarios --seeds 17 --bench 'a bench.toml' --matrix smallest-17.toml --event nothing --actuator tcp"
    assert again in err
    assert err.rstrip().endswith(MATRIX.rstrip())
    assert request_for(Files(), ["nothing"], None).plan(17).events == ()
    assert drawn(17).events
    assert {request_for(Files(), ["modbus-reset@1"], None).plan(seed).actuator for seed in range(9)} == {"tcp"}
    request = request_for(Files(), ["estop@1"], None, "rtu")
    assert [request.plan(seed) for seed in range(9)] == [
        replace(drawn(seed, Given(actuator="rtu")), events=(FaultEvent("estop", 1.0),)) for seed in range(9)
    ]
    babble = request_for(Files(), ["can-babble@1"], None)
    assert {babble.plan(seed).kind for seed in range(30)} & {"supply", "output", "by-hand"} == set(), "no bus there"


def test_a_smallest_scenario_of_a_drawn_bench_is_reported_with_its_bench(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The files that are printed are those of the same world."""
    seed = next(seed for seed in range(99) if drawn(seed).kind == "signal" and drawn(seed).record)
    ended = Ended(seed, (("travel", "too far", 12.5),), "ab", 36.0, 7.0, (0,))
    monkeypatch.setattr(shrink, "alone", lambda _: ended)
    monkeypatch.setattr(shrink, "shrunk", lambda given, *_: (given, ended))
    shrink.show_smallest(seed, ScenarioRequest())
    command, *files = re.split(r"with (\S+):\n", capfd.readouterr().err)
    for name, text in zip(files[::2], files[1::2], strict=True):
        (tmp_path / name).write_text(text, encoding="utf-8")
    names = Files(tmp_path / f"smallest-{seed}.toml", tmp_path / f"smallest-{seed}-bench.toml")
    assert f"--bench smallest-{seed}-bench.toml --matrix smallest-{seed}.toml --event" in command
    plan = drawn(seed).fitted()
    again = request_for(names, tuple(map(str, plan.events)) or ("nothing",), None).plan(seed)
    assert again.bench.rstrip() == plan.bench.rstrip()
    for key in ("events", "actuator", "tick_s", "turn_s", "held_up"):
        assert getattr(again, key) == getattr(plan, key), key


@pytest.mark.nightly
@pytest.mark.parametrize("end", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
@pytest.mark.parametrize("traced", [False, True])
def test_scenarios_that_are_ended_leave_nothing(end: signal.Signals, traced: bool, tmp_path: Path) -> None:
    """To the whole group as a terminal does it, or to the parent alone."""
    arguments = ["--seeds", "2", "--trace", str(tmp_path / "steps")] if traced else ["--seeds", "0:99", "--jobs", "1"]
    with subprocess.Popen(
        [sys.executable, "-m", "simulators.scenarios", *arguments], start_new_session=True, stderr=subprocess.DEVNULL
    ) as process:
        within_s = time.monotonic() + 60.0
        while not (rooms := set().union(*map(folders_of, children(process.pid)))):
            assert process.poll() is None, "ended by itself"
            assert time.monotonic() < within_s, "no world begins"
            time.sleep(0.05)
        workers = children(process.pid)
        (os.killpg if end is signal.SIGINT else os.kill)(process.pid, end)
        assert process.wait(20) == (-9 if end is signal.SIGKILL else 4)
    while any(folder.exists() for folder in rooms) or any(map(folders_of, workers)):
        assert time.monotonic() < within_s + 10.0, rooms
        time.sleep(0.05)


def children(parent: int) -> list[int]:
    """Processes whose parent is this one."""
    tasks = Path(f"/proc/{parent}/task/{parent}/children")
    return [int(number) for number in tasks.read_text().split()] if tasks.exists() else []


def folders_of(process: int) -> set[Path]:
    """Folders of worlds in which a process has files open."""
    opened = set()
    with contextlib.suppress(OSError):
        for handle in Path(f"/proc/{process}/fd").iterdir():
            with contextlib.suppress(OSError):
                path = handle.readlink()
                opened |= {folder for folder in path.parents if folder.name.startswith("world-")}
    return opened


@pytest.mark.nightly
def test_interrupted_scenarios_show_what_they_did() -> None:
    process = subprocess.Popen(
        [sys.executable, "-m", "simulators.scenarios", "--seeds", "0:20", "--jobs", "1", "--json"],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True, text=True,
    )  # fmt: skip
    assert process.stderr is not None
    before = process.stderr.readline()
    assert before.startswith("1/20 scenarios")
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=20)
    assert process.returncode == 4, err
    assert json.loads(out)["error"] == "stopped by operator"
    assert "of 20, " in err
    assert "Traceback" not in err


@pytest.mark.nightly
def test_a_point_that_is_run_again_though_it_was_finished_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(resume, "INVALID", "valid")
    _, ended = live(plan("application-killed@5.5"), tmp_path)
    assert "run-again" in {invariant for invariant, _, _ in ended.failed}


@pytest.mark.nightly
def test_a_recorded_force_that_is_not_the_true_one_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    on_base = alignment._on_base

    def stronger(*given: object) -> tuple[object, ...]:
        values, *others = on_base(*given)
        return {**values, "force": 1.3 * np.asarray(values["force"])}, *others

    monkeypatch.setattr(alignment, "_on_base", stronger)
    _, ended = live(plan(), tmp_path)
    assert "true-record" in {invariant for invariant, _, _ in ended.failed}


@pytest.mark.nightly
def test_a_stop_under_a_name_that_the_station_never_reported_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result_of = campaign._result_of
    monkeypatch.setattr(
        campaign, "_result_of", lambda *given: replace(result_of(*given), stopped_by="estop", refused=False)
    )
    _, ended = live(plan("loadcell-pulled@0.5"), tmp_path)
    assert "first-cause" in {invariant for invariant, _, _ in ended.failed}

"""What an operator can do at the page of a bench: what is listed, planned, started, resumed and refused."""

from __future__ import annotations

import asyncio
import errno
import json
import os
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from drivers.prepared import Prepared
from rig.clock import utc_now
from rig.page import started_run
from rig.page.bench_control import MOST_WAITING, Bench, BenchControl, Phase, Requester, phase
from rig.page.history import History
from rig.page.matrices import READ_HERE_BYTES, Matrices
from rig.page.started_run import OUTPUT, StartedRun
from rig.station.live_folder import APPLICATION_SOCKET, DEVICES, bound, make_live_folder, received, replace_json

MATRIX = '[specimen]\nserial_number = "MR-001"\n[matrix]\n'
DIGEST = "a" * 64
ADA, BOB, GONE = Requester("Ada", lambda: True), Requester("Bob", lambda: True), Requester("Eve", lambda: False)
GRAVE = {"slug": "estop", "text": "estop", "resume": "n"}


@dataclass
class Started:
    """In place of processes: what would have been started."""

    arguments: list[tuple[str, ...]] = field(default_factory=list)
    lives: bool = True
    interrupted: bool = False

    def start(self, folder: Path, arguments: tuple[str, ...], **named: str) -> StartedRun:
        self.arguments.append(arguments)
        made, outer = StartedRun(folder, arguments, named["by"], named["title"], named["utc"]), self

        class Run(StartedRun):
            lives = property(lambda _: outer.lives)

            def interrupt(self) -> bool:
                outer.interrupted = True
                return outer.lives

        return Run(**{name: getattr(made, name) for name in ("folder", "arguments", "by", "title", "utc")})


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> Started:
    made = Started()
    monkeypatch.setattr(StartedRun, "start", made.start)
    return made


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    for name in ("lab", "logs", "state", "live"):
        (tmp_path / name).mkdir()
    (tmp_path / "lab" / "m.toml").write_text(MATRIX)
    return Bench(
        path=tmp_path / "lab" / "bench.toml", name="bench", devices=frozenset({"port:1"}), matrices=tmp_path / "lab",
        out=tmp_path / "logs", state=tmp_path / "state",
    )


class AnsweringControl(BenchControl):
    """A bench control with predefined answers from other modules."""

    reply: Mapping[str, Any] = {
        "planned": DIGEST, "feasible": True, "serial_number": "MR-001", "devices": ["port:1"], "blocks": [],
        "stops": [], "requalify": False, "left_out": [],
    }  # fmt: skip

    def __init__(self, bench: Bench, **settings: Any) -> None:  # noqa: ANN401 - as its base
        super().__init__(bench, **settings)
        self.requests: list[Mapping[str, Any]] = []

    async def _ask(self, request: Mapping[str, Any]) -> dict[str, Any]:
        await asyncio.sleep(0)
        self.requests.append(request)
        return dict(self.reply)


@pytest.fixture
def control(bench: Bench, tmp_path: Path) -> AnsweringControl:
    return AnsweringControl(bench, place=tmp_path / "live")


def asked(control: BenchControl, **message: object) -> dict[str, Any]:
    return asyncio.run(control.answer(message, ADA))


def planned(control: BenchControl, name: str = "m.toml") -> None:
    assert asked(control, do="plan", matrix=name)["planned"] == DIGEST


def run_in(control: BenchControl, name: str, *, simulated: bool = False) -> str:
    """A campaign that the operator stopped after one of two points."""
    folder = control.bench.out / name
    (folder / "points").mkdir(parents=True)
    (folder / "matrix.toml").write_text(MATRIX)
    description = {"points": ["p001", "p002"], "specimen": "MR-1", "simulated": {"speed": 1} if simulated else None}
    (folder / "campaign.json").write_text(json.dumps(description))
    points = [{"id": "p001", "verdict": "valid"}, {"id": "p002", "verdict": "not run"}]
    result = {"event": "result", "points": points, "stopped_by": "operator", "rig_state": "safe", "detail": "Stop"}
    (folder / "journal.jsonl").write_text(json.dumps(result) + "\n")
    control.history.look()
    return name


def test_what_was_planned_is_started_as_if_it_were_typed(control: AnsweringControl, started: Started) -> None:
    planned(control)
    message = {"do": "begin", "matrix": "m.toml", "planned": DIGEST, "serial_number": "MR-7", "note": "a\nb"}
    assert asked(control, **message) == {"do": "begin", "of": "m.toml", "ok": True}
    lab, logs = control.bench.matrices, control.bench.out
    assert started.arguments == [(
        str(lab / "m.toml"), f"--bench={lab / 'bench.toml'}", f"--planned={DIGEST}", "--serial-number=MR-7",
        f"--out={logs}", "--operated", "--json",
    )]  # fmt: skip
    assert control.started is not None
    assert (control.started.by, control.started.title) == ("Ada", "m.toml, specimen MR-7")


def test_the_production_view_loads_its_first_run_when_it_is_opened(
    control: AnsweringControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[bool] = []
    monkeypatch.setattr(Prepared, "prepare", lambda _prepared: loaded.append(True))
    assert asked(control, do="prepare") == {"do": "prepare", "of": "", "ok": True}
    monkeypatch.setattr(AnsweringControl, "idle", property(lambda _control: False))
    assert asked(control, do="prepare")["ok"]
    assert len(loaded) == 1, "nothing is loaded while a test runs"


def test_of_two_browsers_that_start_two_matrices_one_is_refused_in_words(
    control: AnsweringControl, started: Started
) -> None:
    (control.bench.matrices / "n.toml").write_text(MATRIX)
    planned(control, "m.toml")
    planned(control, "n.toml")

    async def both() -> list[dict[str, Any]]:
        return await asyncio.gather(*(
            control.answer({"do": "begin", "matrix": name, "planned": DIGEST, "serial_number": "A"}, requester)
            for name, requester in (("m.toml", ADA), ("n.toml", BOB))
        ))  # fmt: skip

    answers = asyncio.run(both())
    assert [answer.get("refused") for answer in answers] == [None, "already-running"]
    again = asked(control, do="begin", matrix="n.toml", planned=DIGEST, serial_number="A")
    assert again["refused"] == "already-running"
    assert asked(control, do="plan", matrix="n.toml")["text"] == "Ada is starting a run: m.toml, specimen A."
    assert len(started.arguments) == 1


def test_a_start_is_announced_until_its_campaign_is_there_and_an_end_only_after_it() -> None:
    """Live folder, end of motion, and process change in any order; what is shown goes forward alone."""
    begun, shown = False, []
    for live, ended, lives, settled in (
        (False, False, False, True), (False, False, True, False), (True, False, True, False), (True, True, True, False),
        (False, False, True, False), (False, False, False, False), (False, False, False, True),
    ):  # fmt: skip
        begun = begun or live
        shown.append(phase(live=live, ended=ended, begun=begun, lives=lives, settled=settled))
    evaluating = [Phase.EVALUATING] * 3
    assert shown == [Phase.IDLE, Phase.STARTING, Phase.RUNNING, *evaluating, Phase.IDLE]


def test_the_page_is_idle_again_once_the_history_is_read_and_no_earlier(
    control: AnsweringControl, started: Started, tmp_path: Path
) -> None:
    planned(control)
    begin = {"do": "begin", "matrix": "m.toml", "planned": DIGEST, "serial_number": "A"}
    assert (asked(control, **begin)["ok"], control.status()["phase"]) == (True, "starting")
    folder, lock = make_live_folder(tmp_path / "live")
    replace_json(folder / DEVICES, {"out": str(control.bench.out), "devices": ["port:1"]})
    seen = [asked(control, do="plan", matrix="m.toml")["refused"], control.status()["phase"]]
    replace_json(folder / "state.json", {"ended": {"valid": 1}})
    seen.append(control.status()["phase"])
    os.close(lock)
    seen.append(control.status()["phase"])
    assert asked(control, do="make-report", run="x")["refused"] == "still-analysing", "its process has not ended"
    started.lives = False
    seen.append(control.status()["phase"])
    assert seen == ["already-running", "running", "evaluating", "evaluating", "evaluating"]
    planned(control)
    assert control.look() is True, "what a request has noticed is still news to the server"
    control.settle()
    assert control.status()["phase"] == "idle"


def test_stop_ends_what_is_being_started(control: AnsweringControl, started: Started) -> None:
    assert control.cancel("Ada") is False

    async def stopped_while_it_waits() -> str:
        waiting = asyncio.create_task(control.answer(begin, ADA))
        await asyncio.sleep(0)
        control.cancel("viewer")
        return str((await waiting).get("refused"))

    run = run_in(control, "20260102T030405Z-MR-1-aaaaaa")
    begin = {"do": "resume", "run": run, "confirmed": []}
    assert (asyncio.run(stopped_while_it_waits()), started.arguments) == ("operator", [])
    assert asked(control, **begin)["ok"] is True
    assert (control.cancel("Eve"), started.interrupted) == (True, True)
    started.lives = False
    planned(control)
    control.settle()
    outcome = control.status()["outcome"]
    assert outcome["text"] == f"resumed {run}: stopped by Eve before the rig was connected."


@pytest.mark.parametrize(("change", "refused"), [
    ({"planned": "b" * 64}, "not-planned"), ({"planned": "--bench=/x"}, "not-planned"),
    ({"planned": None}, "not-planned"),
    ({"matrix": "../m.toml"}, "unknown-matrix"), ({"matrix": "/etc/passwd"}, "unknown-matrix"),
    ({"matrix": ["m.toml"]}, "unknown-matrix"), ({"matrix": "m.toml\0"}, "unknown-matrix"),
    ({"serial_number": ""}, "bad-serial-number"), ({"serial_number": "--out=/x"}, "bad-serial-number"),
    ({"serial_number": "a/../b"}, "bad-serial-number"), ({"serial_number": "A" * 33}, "bad-serial-number"),
    ({"serial_number": "MR-1\n"}, None), ({"serial_number": "MR\0"}, "bad-serial-number"),
])  # fmt: skip
def test_hostile_values_of_a_start_are_refused(
    control: AnsweringControl, started: Started, change: dict[str, Any], refused: str | None
) -> None:
    planned(control)
    message = {"do": "begin", "matrix": "m.toml", "planned": DIGEST, "serial_number": "MR-7", **change}
    assert asked(control, **message).get("refused") == refused
    assert len(started.arguments) == (refused is None)


def test_requests_are_answered_one_after_the_other_and_a_flood_is_refused(control: AnsweringControl) -> None:
    async def many() -> list[dict[str, Any]]:
        plans = (control.answer({"do": "plan", "matrix": "m.toml"}, ADA) for _ in range(MOST_WAITING + 3))
        return await asyncio.gather(*plans)

    answers = [answer.get("refused") for answer in asyncio.run(many())]
    assert (answers.count(None), answers.count("page-busy")) == (MOST_WAITING, 3)


def test_a_start_that_waited_until_control_was_lost_starts_nothing(control: AnsweringControl, started: Started) -> None:
    planned(control)
    message = {"do": "begin", "matrix": "m.toml", "planned": DIGEST, "serial_number": "A"}
    assert asyncio.run(control.answer(message, GONE))["refused"] == "no-lease"
    run = run_in(control, "20260102T030405Z-MR-1-aaaaaa")
    assert asyncio.run(control.answer({"do": "resume", "run": run, "confirmed": []}, GONE))["refused"] == "no-lease"
    assert started.arguments == []


def test_a_plan_outside_the_limits_is_not_started(control: AnsweringControl, started: Started) -> None:
    control.reply = {**control.reply, "feasible": False}
    planned(control)
    answer = asked(control, do="begin", matrix="m.toml", planned=DIGEST, serial_number="A")
    assert (answer["refused"], started.arguments) == ("matrix-infeasible", [])


def test_a_run_is_resumed_once_every_stop_is_confirmed_and_described(
    control: AnsweringControl, started: Started
) -> None:
    name = run_in(control, "20260102T030405Z-MR-1-aaaaaa")
    stops = [{"slug": "operator", "text": "", "resume": "c"}, GRAVE]
    control.reply = {**control.reply, "stops": stops, "requalify": True}
    assert asked(control, do="questions", run=name)["stops"] == stops
    half = {"do": "resume", "run": name, "confirmed": ["operator"], "requalified": "coil replaced"}
    assert asked(control, **half)["refused"] == "not-confirmed"
    whole = {**half, "confirmed": ["operator", "estop"]}
    assert asked(control, **{**whole, "requalified": "\n"})["refused"] == "requalify"
    assert started.arguments == []
    assert asked(control, **whole) == {"do": "resume", "of": name, "ok": True}
    assert started.arguments == [(
        f"--resume={control.bench.out / name}", "--confirmed=operator,estop", f"--bench={control.bench.path}",
        "--requalified=coil replaced", "--operated", "--json",
    )]  # fmt: skip


@pytest.mark.parametrize("run", ["../../etc", "", None, "no-such-run", "20260102T030405Z-MR-1-aaaaaa/."])
def test_only_a_listed_run_is_resumed(control: AnsweringControl, started: Started, run: object) -> None:
    run_in(control, "20260102T030405Z-MR-1-aaaaaa")
    assert asked(control, do="resume", run=run, confirmed=[])["refused"] == "unknown-run"
    assert asked(control, do="make-report", run=run)["refused"] == "unknown-run"
    assert started.arguments == []


def test_a_pdf_is_written_of_a_listed_run_only(control: AnsweringControl) -> None:
    name = run_in(control, "20260102T030405Z-MR-1-aaaaaa")
    (control.bench.out / name / "points" / "p001.h5").touch()
    control.history.look()
    assert asked(control, do="make-report", run=name, pdf=True)["pdf"] is True
    assert asked(control, do="make-report", run="no-such-run", pdf=True)["refused"] == "unknown-run"
    assert control.requests == [{"do": "report", "run": str(control.bench.out / name), "pdf": True}]


def test_a_simulated_run_is_not_resumed_on_hardware(control: AnsweringControl, started: Started) -> None:
    name = run_in(control, "20260102T030405Z-MR-1-bbbbbb", simulated=True)
    assert asked(control, do="resume", run=name, confirmed=["operator"])["refused"] == "another-rig"
    assert started.arguments == []


@pytest.fixture
def running(tmp_path: Path, bench: Bench) -> Iterator[Path]:
    """A campaign on the bench, started in a terminal."""
    folder, lock = make_live_folder(tmp_path / "live")
    replace_json(folder / DEVICES, {"out": str(bench.out), "devices": ["port:1", "port:2"]})
    replace_json(folder / "state.json", {"phase": "running", "campaign": str(bench.out / "the-run")})
    yield folder
    os.close(lock)


def test_a_run_from_a_terminal_is_found_and_nothing_is_started_beside_it(
    running: Path, control: AnsweringControl, started: Started
) -> None:
    assert control.look() is True
    assert (control.live_folder, control.status()["run"], control.status()["running"]) == (running, "the-run", True)
    answer = asked(control, do="plan", matrix="m.toml")
    assert (answer["refused"], "the-run" in answer["text"]) == ("already-running", True)
    replace_json(running / "state.json", {"campaign": str(control.bench.out / "the-run"), "ended": {"valid": 1}})
    assert asked(control, do="plan", matrix="m.toml")["refused"] == "still-analysing"
    assert asked(control, do="make-report", run="the-run", pdf=True)["refused"] == "still-analysing"
    assert (started.arguments, len(control.requests)) == ([], 0)


def test_the_specimen_of_a_start_is_not_recorded_in_a_run_from_a_terminal(
    running: Path, control: AnsweringControl, started: Started
) -> None:
    run = control.bench.out / "the-run"
    run.mkdir()
    with bound(running / APPLICATION_SOCKET) as inbox:
        for pid, words in ((4, None), (os.getpid(), {"do": "words", "by": "Ada", "specimen": "left damper"})):
            replace_json(run / "live.json", {"folder": str(running), "pid": pid})
            start = StartedRun.start(control.bench.state, (), by="Ada", title="t", utc="u", words={})
            control.started = replace(start, words={"specimen": "left damper"}, pid=os.getpid())
            assert asked(control, do="plan", matrix="m.toml")["refused"] == "already-running"
            assert received(inbox) == words


def test_a_run_on_other_devices_is_none_of_this_bench(running: Path, bench: Bench, tmp_path: Path) -> None:
    other = replace(bench, devices=frozenset({"port:9"}))
    assert BenchControl(other, place=tmp_path / "live").look() is False
    assert not replace(bench, simulate=True).owns(json.loads((running / DEVICES).read_text()))
    assert replace(bench, simulate=True).owns({"out": str(bench.out), "devices": []})
    assert not bench.owns({"out": str(bench.out), "devices": "port:1"})


def test_a_later_page_knows_what_was_started_and_how_it_ended(tmp_path: Path) -> None:
    """The process is real: `rig run` refuses its arguments."""
    run = StartedRun.start(tmp_path, ("--no-such-option", "--json"), by="Ada", title="t", utc="u", words={"note": "n"})
    later = StartedRun.last(tmp_path)
    assert later is not None
    assert (later.lives, later.words, later.arguments) == (True, {"note": "n"}, ("--no-such-option", "--json"))
    assert os.getsid(run.pid) == run.pid, "a session of its own: what ends the page does not reach it"
    while run.lives:
        os.sched_yield()
    assert not later.lives
    outcome = later.outcome()
    assert (outcome["exit_code"], outcome["refused"], "no-such-option" in outcome["text"]) == (2, "usage", True)
    assert (tmp_path / OUTPUT).stat().st_mode & 0o777 == 0o600


def test_a_start_that_no_later_page_would_know_of_is_not_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    full = OSError(errno.ENOSPC, "No space left on device")
    monkeypatch.setattr(started_run, "replace_json", Mock(side_effect=full))
    monkeypatch.setattr("rig.page.started_run.subprocess.Popen", Mock(side_effect=AssertionError("started")))
    with pytest.raises(OSError, match="No space left"):
        StartedRun.start(tmp_path, ("m.toml",), by="Ada", title="m.toml", utc="2026-01-02T03:04:05", words={})


def test_a_process_of_the_same_number_is_not_taken_for_the_run(tmp_path: Path) -> None:
    replace_json(tmp_path / "started.json", {
        "arguments": [], "by": "", "title": "", "utc": "", "words": {}, "pid": os.getpid(), "ticks": 1,
    })  # fmt: skip
    later = StartedRun.last(tmp_path)
    assert later is not None
    assert not later.lives
    assert later.outcome()["broken"] is True


def test_matrices_are_listed_by_name_and_hostile_ones_are_named_or_left_out(tmp_path: Path) -> None:
    files = {
        "good.toml": MATRIX, "bench.toml": "[limits]\n[actuator]\n", "broken.toml": "x = [", "--out=x.toml": MATRIX,
        "bad\nname.toml": MATRIX, ".hidden.toml": MATRIX, "deep.toml": "x = " + "[" * 5000, "note.txt": "",
        "number.toml": f"x = {'9' * 60_000}", "<b>.toml": MATRIX.replace("MR-001", "<script>"),
    }  # fmt: skip
    for name, text in files.items():
        (tmp_path / name).write_text(text)
    os.mkfifo(tmp_path / "pipe.toml")
    (tmp_path / "link.toml").symlink_to(tmp_path / "good.toml")
    matrices = Matrices(tmp_path)
    matrices.look()
    listed, note = matrices.listing
    (tmp_path / "good.toml").write_text(MATRIX + "#" * READ_HERE_BYTES)  # read by another process
    matrices.look()
    assert matrices.listing == (listed, note)
    by_name = {entry["name"]: entry for entry in listed}
    assert sorted(by_name) == [
        "--out=x.toml", "<b>.toml", "broken.toml", "deep.toml", "good.toml", "link.toml", "number.toml", "pipe.toml"
    ]
    assert (by_name["good.toml"]["serial_number"], by_name["good.toml"]["remark"]) == ("MR-001", "")
    assert all(by_name[name]["remark"] for name in ("broken.toml", "deep.toml", "number.toml", "pipe.toml"))
    assert by_name["link.toml"]["remark"].startswith("is a symbolic link")
    assert "2" in note, "two names with unusual characters"
    assert matrices.path("--out=x.toml") == tmp_path / "--out=x.toml", "a whole path: no option of a command"
    assert [matrices.path(name) for name in ("bench.toml", "../good.toml", "bad\nname.toml", "link.toml", 3, None)] == [
        None] * 6
    (tmp_path / "good.toml").unlink()
    assert matrices.path("good.toml") is None


def test_the_history_states_how_runs_ended_and_gives_out_reports_of_their_own_folder_alone(
    control: AnsweringControl, tmp_path: Path
) -> None:
    name = run_in(control, "20260102T030405Z-MR-1-aaaaaa")
    run_in(control, "20260103T030405Z-MR-1-bbbbbb")
    cut, odd = control.bench.out / "20260104T030405Z-MR-1-cccccc", control.bench.out / "20260105T030405Z-MR-1-dddddd"
    for folder, line in ((cut, '{"event": "connected"}'), (odd, '{"event": "refused", "slug": "unreachable"}')):
        (folder / "points").mkdir(parents=True)
        (folder / "journal.jsonl").write_text(line + "\n")
    (control.bench.out / "20260106T030405Z-link").symlink_to(control.bench.out / name)
    (control.bench.out / name / "report.html").write_text("<h1>report</h1>")
    (tmp_path / "secret").write_text("secret")
    (control.bench.out / "20260103T030405Z-MR-1-bbbbbb" / "report.html").symlink_to(tmp_path / "secret")
    keys = ("ended", "slug", "valid", "total", "resumable", "report")
    assert [tuple(run[key] for key in keys) for run in control.history.look()] == [
        ("refused", "unreachable", 0, 0, False, False), ("interrupted", "", 0, 0, False, False),
        ("stopped", "operator", 1, 2, True, False), ("stopped", "operator", 1, 2, True, True),
    ]  # fmt: skip
    assert control.history.report(name) == b"<h1>report</h1>"
    link = "20260106T030405Z-link"
    hostile = ("20260103T030405Z-MR-1-bbbbbb", "..", "../secret", f"{name}/../{name}", link, "", None)
    assert [control.history.report(one) for one in hostile] == [None] * len(hostile)
    assert History(tmp_path / "nowhere", simulated=False).look() == []


def test_points_that_a_stop_rule_withdrew_are_not_counted(control: AnsweringControl) -> None:
    run = control.bench.out / run_in(control, "20260102T030405Z-MR-1-aaaaaa")
    result = {"event": "result", "points": [{"id": "p001", "verdict": "valid"}], "valid": 1, "total": 1,
              "stopped_by": None, "rig_state": "safe", "detail": ""}  # fmt: skip
    (run / "journal.jsonl").write_text(json.dumps(result) + "\n")
    entry = control.history.look()[0]
    assert (entry["ended"], entry["valid"], entry["total"], entry["resumable"]) == ("finished", 1, 1, False)


def test_a_resumed_run_that_moves_has_neither_the_old_stop_nor_the_old_report(
    control: AnsweringControl, running: Path
) -> None:
    run = control.bench.out / run_in(control, "20260102T030405Z-MR-1-aaaaaa")
    (run / "report.html").write_text("old")
    with (run / "journal.jsonl").open("a") as journal:
        journal.write('{"event": "resumed"}\n')
    keys = ("ended", "text", "report", "resumable", "resumed")
    assert [control.history.look()[0][key] for key in keys] == ["stopped", "Stop.", True, True, 1]
    (run / "live.json").write_text(json.dumps({"folder": str(running)}))
    assert [control.history.look()[0][key] for key in keys] == ["running", "", False, False, 1]
    replace_json(running / "state.json", {"valid": 5, "suspect": 0, "invalid": 0})
    counted = [control.history.look()[0][key] for key in ("valid", "invalid")]
    assert counted == [5, 0], "of the session that runs, not of the one before"


def test_the_verdict_on_the_specimen_is_listed_before_the_report_is_written(
    control: AnsweringControl, running: Path
) -> None:
    verdict_in(control, "MR-101", "ok")  # of the session before
    name = str(control.history.runs[0]["name"])
    (control.bench.out / name / "live.json").write_text(json.dumps({"folder": str(running)}))
    ended = {"valid": 2, "total": 2, "rig_state": "safe", "stopped_by": None}
    seen: list[tuple[object, ...]] = []
    looked: list[bool] = []
    for verdict, stopped_by in (("", None), ("evaluating", None), ("not-ok", "operator"), ("not-ok", None)):
        found = {**ended, "stopped_by": stopped_by, "specimen": {"verdict": verdict, "reason": "p001"}}
        replace_json(running / "state.json", {"campaign": str(control.bench.out / name), "ended": found})
        control._looked_ns = 0
        looked.append(control.look())
        entry = control.history.look()[0]
        seen.append((entry["ended"], entry["specimen_verdict"], entry["specimen_reason"], entry["takt_s"] is None))
    assert seen == [*[("running", "", "", True)] * 3, ("running", "not-ok", "p001", False)]
    assert looked == [True, False, False, True], "the list is read again once the verdict is known"


def test_values_of_a_hostile_description_are_text_or_nothing(control: AnsweringControl) -> None:
    name = run_in(control, "20260102T030405Z-MR-1-aaaaaa")
    odd = {"points": 3, "specimen": ["x"] * 100, "started_utc": {"a": 1}, "simulated": "yes", "bench": "\x1b[31m"}
    (control.bench.out / name / "campaign.json").write_text(json.dumps(odd))
    (control.bench.out / name / "live.json").write_text(json.dumps({"folder": "\0"}))
    run = control.history.look()[0]
    assert (run["total"], run["bench"], run["ended"]) == (2, "[31m", "stopped")
    assert sys.getsizeof(json.dumps(run)) < 4000


LINE = {"serial": "MR-[0-9]{3}", "retest": "explicit"}


def verdict_in(control: BenchControl, serial_number: str, verdict: str, started: datetime | None = None) -> str:
    """A finished run with a verdict on its specimen."""
    name = f"{started or utc_now():%Y%m%dT%H%M%SZ}-{serial_number}-0a1b2c"
    folder = control.bench.out / name
    (folder / "points").mkdir(parents=True)
    (folder / "campaign.json").write_text(json.dumps({"specimen": serial_number, "points": []}))
    result = {"event": "result", "points": [], "stopped_by": None, "rig_state": "safe", "detail": ""}
    (folder / "journal.jsonl").write_text(json.dumps(result) + "\n")
    (folder / "acceptance.json").write_text(json.dumps({"specimen": verdict, "reason": "margin -41 N"}))
    control.history.look()
    return name


def scanned(control: AnsweringControl, serial_number: str, **more: object) -> tuple[str, str]:
    """Whether a scan in the production view starts a test, or the code and the text of the refusal."""
    message = {"do": "begin", "matrix": "m.toml", "planned": DIGEST, "serial_number": serial_number, "line": True}
    answer = asked(control, **message, **more)
    return ("ok", "") if "ok" in answer else (answer["refused"], answer["text"])


def test_the_production_view_starts_serial_numbers_of_its_line_alone(
    control: AnsweringControl, started: Started
) -> None:
    planned(control)
    assert scanned(control, "MR-101")[0] == "no-bands"
    control.reply = {**control.reply, "line": LINE}
    assert asked(control, do="plan", matrix="m.toml")["line"] == LINE
    code, text = scanned(control, "MX-1")
    assert (code, "MR-[0-9]{3}" in text) == ("bad-serial-number", True)
    assert scanned(control, "MR-101 ; rm")[0] == "bad-serial-number"
    assert started.arguments == []
    assert scanned(control, "MR-101") == ("ok", "")
    assert "--serial-number=MR-101" in started.arguments[0]
    assert scanned(control, "MR-102")[0] == "already-running", "a scan during a test is not kept"


def test_the_production_view_tests_a_specimen_again_only_on_request(
    control: AnsweringControl, started: Started
) -> None:
    control.reply = {**control.reply, "line": LINE}
    planned(control)
    verdict_in(control, "MR-101", "ok")
    verdict_in(control, "MR-102", "not-tested")
    code, text = scanned(control, "MR-101")
    assert (code, text.endswith("(OK). To test it again, press Retest.")) == ("tested-before", True)
    assert scanned(control, "MR-101", retest="yes")[0] == "tested-before"
    assert started.arguments == []
    assert scanned(control, "MR-101", retest=True) == ("ok", "")
    started.lives = False
    assert control.history.today == {
        "ok": 1, "not-ok": 0, "not-tested": 1, "takt_last_s": control.history.runs[1]["takt_s"],
        "takt_mean_s": control.history.runs[1]["takt_s"],
    }  # fmt: skip
    assert [run["specimen_verdict"] for run in control.history.runs] == ["not-tested", "ok"]


def test_a_specimen_tested_again_counts_once_today_with_its_last_verdict(control: AnsweringControl) -> None:
    for serial_number, verdict in (("MR-101", "not-ok"), ("MR-102", "ok"), ("MR-103", "not-tested")):
        verdict_in(control, serial_number, verdict)
    first = control.history.today
    assert (first["ok"], first["not-ok"], first["not-tested"]) == (1, 1, 1)
    verdict_in(control, "MR-101", "ok", utc_now() + timedelta(seconds=1))
    second = control.history.today
    assert (second["ok"], second["not-ok"], second["not-tested"]) == (2, 0, 1), "three dampers, four tests"


def test_after_a_stop_the_production_view_waits_for_the_operator(control: AnsweringControl, started: Started) -> None:
    control.reply = {**control.reply, "line": LINE}
    planned(control)
    stopped = run_in(control, "20260102T030405Z-MR-1-aaaaaa")
    code, text = scanned(control, "MR-101")
    assert (code, "press Continue" in text) == ("line-stopped", True)
    assert scanned(control, "MR-101", after="another run")[0] == "line-stopped"
    assert started.arguments == []
    assert scanned(control, "MR-101", after=stopped) == ("ok", "")

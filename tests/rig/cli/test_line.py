"""`rig line`: what is entered when, counters and takt, and the dampers that a simulated rig emulates."""

from __future__ import annotations

import io
import json
import os
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from rich.console import Console

from rig.campaign.results import CampaignResult, RigState
from rig.cli.job import JobResult
from rig.cli.line import _Line, large
from rig.cli.line_entries import Entries, WatchingDisplay
from rig.cli.line_session import Answer, LineResult, LineSession
from rig.cli.main import main
from rig.comparison.specimen import SpecimenResult
from rig.errors import EXIT_NOT_ACCEPTED, EXIT_REFUSED, EXIT_STOPPED, EXIT_UNKNOWN_STATE, EXIT_USAGE, FileProblem
from rig.matrix.line_table import LineTable
from rig.matrix.model import load_matrix
from rig.recording.tested_specimens import TITLES, SpecimenVerdict, TestedSpecimens
from simulators.options import RigOptions, with_option
from simulators.plant.plant import specimen_model
from simulators.specimens import as_specimen

ROOT = Path(__file__).parents[3]
LINE = ROOT / "examples" / "line.toml"
NOW = datetime(2026, 3, 4, 12, 0, tzinfo=UTC)


def run_of(folder: Path, serial_number: str, verdict: str, started: datetime = NOW - timedelta(hours=1)) -> Path:
    run = folder / f"{started:%Y%m%dT%H%M%SZ}-{serial_number}-0a1b2c"
    (run / "points").mkdir(parents=True)
    file = run / "acceptance.json"
    file.write_text(json.dumps({"specimen": verdict, "reason": "r"}))
    os.utime(file, (started.timestamp() + 12.5,) * 2)
    return run


@pytest.fixture
def session(tmp_path: Path) -> LineSession:
    return LineSession(load_matrix(LINE), TestedSpecimens(tmp_path))


def result(serial_number: str, verdict: str = "ok", code: int = 0, takt_s: float = 10.0) -> LineResult:
    return LineResult(serial_number, verdict, "why", code, None, takt_s)


def test_a_serial_number_of_the_line_starts_a_test(session: LineSession) -> None:
    assert session.entered(" MR-101 \r", NOW) == session.entered("MR-101", NOW)
    assert session.entered("MR-101", NOW).answer is Answer.TEST
    assert session.entered("MR-101", NOW).text == "MR-101"
    assert session.entered("", NOW).answer is Answer.NOTHING


@pytest.mark.parametrize("text", ["MR-1O1", "MR-1011", "4006381333931", "Müller", "MR-101\x02", "x" * 5000, "retest "])
def test_what_is_no_serial_number_of_the_line_is_refused(session: LineSession, text: str) -> None:
    entry = session.entered(text, NOW)
    assert (entry.answer, entry.slug) == (Answer.REFUSED, "bad-serial-number")
    assert "Fix:" in entry.text
    assert len(entry.text) < 400


def test_a_specimen_with_a_verdict_is_tested_again_only_on_request(session: LineSession, tmp_path: Path) -> None:
    run_of(tmp_path, "MR-101", "ok")
    run_of(tmp_path, "MR-102", "not-tested")
    entry = session.entered("MR-101", NOW)
    assert (entry.answer, entry.slug) == (Answer.REFUSED, "tested-before")
    assert entry.text.endswith("type `retest MR-101`")
    again = session.entered("retest MR-101", NOW)
    assert (again.answer, again.text) == (Answer.TEST, "MR-101")
    assert session.entered("MR-102", NOW).answer is Answer.TEST, "a specimen that was not tested has no verdict"


def test_the_matrix_can_allow_retests(tmp_path: Path) -> None:
    run_of(tmp_path, "MR-101", "not-ok", NOW - timedelta(days=2))
    run_of(tmp_path, "MR-102", "not-ok", NOW - timedelta(minutes=5))
    for rule, answers in (("next-day", (Answer.TEST, Answer.REFUSED)), ("free", (Answer.TEST, Answer.TEST))):
        matrix = load_matrix(LINE)
        assert matrix.line is not None
        changed = matrix.model_copy(update={"line": matrix.line.model_copy(update={"retest": rule})})
        line = LineSession(changed, TestedSpecimens(tmp_path))
        assert tuple(line.entered(name, NOW).answer for name in ("MR-101", "MR-102")) == answers


def test_what_arrives_during_a_test_is_refused_and_not_kept(session: LineSession) -> None:
    entry = session.during_test("MR-102", "MR-101")
    assert (entry.answer, entry.slug) == (Answer.REFUSED, "line-busy")
    assert session.to_json()["refused"] == [{"slug": "line-busy", "text": entry.text}]
    assert session.during_test(" \n", "MR-101").answer is Answer.NOTHING


def test_after_a_stop_the_line_waits_for_the_operator(session: LineSession) -> None:
    session.take(result("MR-101", "not-tested", EXIT_STOPPED))
    entry = session.entered("MR-102", NOW)
    assert (entry.answer, entry.slug) == (Answer.REFUSED, "line-stopped")
    assert session.entered("continue", NOW).answer is Answer.CONTINUED
    assert session.entered("MR-102", NOW).answer is Answer.TEST
    session.take(result("MR-102", "not-tested", EXIT_UNKNOWN_STATE))
    assert session.entered("MR-103", NOW).slug == "line-stopped"
    assert session.exit_code == EXIT_UNKNOWN_STATE
    assert session.entered("quit", NOW).answer is Answer.QUIT


def test_a_refused_campaign_leaves_the_specimen_untested(session: LineSession, tmp_path: Path) -> None:
    """An e-stop that is pressed, or a door that is open in an interlock chain: refused before motion."""
    campaign = CampaignResult(
        tmp_path, (), 0, 2, RigState.SAFE, "estop", "the e-stop is pressed", refused=True, wall_s=0.0, motion_s=0.0
    )
    made = LineResult.of("MR-101", JobResult(campaign), 3.0)
    assert (made.verdict, made.exit_code) == ("not-tested", EXIT_REFUSED)
    assert made.reason == "estop: the e-stop is pressed"
    assert made.remarks[-1] == "Once the cause has been eliminated, continue with: retest MR-101"
    session.take(made)
    assert session.counts == {"ok": 0, "not-ok": 0, "not-tested": 1}
    assert session.entered("MR-101", NOW).answer is Answer.TEST, "the same specimen may be scanned again"


def test_counters_takt_and_exit_code(session: LineSession, tmp_path: Path) -> None:
    session.take(result("MR-101", takt_s=10.0))
    session.take(result("MR-102", takt_s=12.0))
    assert session.exit_code == 0
    specimen = SpecimenResult("MR-103", SpecimenVerdict.NOT_OK, "rebound force ...: margin -41 N")
    campaign = CampaignResult(
        tmp_path, (), 2, 2, RigState.SAFE, None, "", refused=False, wall_s=7.0, motion_s=6.0
    )
    session.take(LineResult.of("MR-103", JobResult(campaign, specimen=specimen), 11.0))
    assert session.summary == "specimens: OK 2, NOT OK 1, NOT TESTED 0; takt 11.0 s, mean 11.0 s"
    assert session.exit_code == EXIT_NOT_ACCEPTED
    answer = session.to_json()
    assert answer["counts"] == {"ok": 2, "not-ok": 1, "not-tested": 0}
    assert answer["specimens"][2]["reason"] == "rebound force ...: margin -41 N"
    assert (answer["takt_last_s"], answer["takt_mean_s"]) == (11.0, 11.0)
    assert json.dumps(answer)


def test_a_specimen_that_is_tested_again_counts_once_with_its_last_verdict(session: LineSession) -> None:
    for serial_number, verdict in (("MR-101", "not-ok"), ("MR-102", "ok"), ("MR-103", "not-tested"), ("mr-101", "ok")):
        session.take(result(serial_number, verdict))
    assert session.counts == {"ok": 2, "not-ok": 0, "not-tested": 1}
    assert len(session.takts_s) == 3, "each test has its takt"


def test_a_specimen_that_could_not_be_tested_for_a_wrong_file_is_no_success(session: LineSession) -> None:
    session.take(result("MR-101"))
    session.take(result("MR-102", "not-tested", EXIT_USAGE))
    assert session.exit_code == EXIT_USAGE


def test_a_reader_that_is_lost_during_a_test_is_reported_after_it(tmp_path: Path) -> None:
    (tmp_path / "reader").write_text("")
    reading, writing = os.pipe()
    with os.fdopen(reading) as stream, os.fdopen(writing, "w") as keyboard:
        entries = Entries(str(tmp_path / "reader"), stdin=stream)
        deadline = time.monotonic() + 10.0
        while entries._lines.empty() and time.monotonic() < deadline:
            time.sleep(0.001)
        assert list(entries.arrived()) == [], "during the test"
        lost = entries.next()
        assert lost is not None
        assert (lost.text, lost.source) == (None, str(tmp_path / "reader"))
        keyboard.write("MR-102\n")
        keyboard.flush()
        typed = entries.next()
        assert typed is not None
        assert typed.text == "MR-102"


def test_a_list_on_standard_input_is_known_by_its_end_and_a_reader_by_its_silence() -> None:
    assert Entries(stdin=io.StringIO("MR-101\nMR-102\r\n")).list_at_once() == ["MR-101", "MR-102"]
    reading, writing = os.pipe()
    with os.fdopen(reading) as stream, os.fdopen(writing, "w") as wedge:
        entries = Entries(stdin=stream)
        wedge.write("MR-101\n")
        wedge.flush()
        assert entries.list_at_once() is None
        typed = entries.next()
        assert typed is not None
        assert typed.text == "MR-101"
        wedge.write("MR-102\n")
        wedge.flush()
        shown: list[str] = []
        display = WatchingDisplay(Silent(shown), entries, lambda text: f"{text}: ignored")
        deadline = time.monotonic() + 10.0
        while not shown and time.monotonic() < deadline:
            display.phase("running")
        assert shown == ["MR-102: ignored"]
        assert list(entries.arrived()) == [], "it is not kept"


class Silent:
    """A display that keeps messages."""

    def __init__(self, messages: list[str]) -> None:
        self.messages = messages

    def message(self, level: str, text: str) -> None:
        del level
        self.messages.append(text)

    def _ignore(self, *values: object) -> None:
        del values

    planned = phase = progress = point_done = _ignore


def test_the_lines_of_a_file_are_those_of_a_barcode_reader(tmp_path: Path) -> None:
    (tmp_path / "reader").write_text("MR-101\nMR-102\n")
    entries = Entries(str(tmp_path / "reader"), stdin=io.StringIO(""))
    found = [typed.text for typed in iter(entries.next, None) if typed.text is not None]
    assert found == ["MR-101", "MR-102"]
    with pytest.raises(FileProblem, match="barcode reader cannot be opened"):
        Entries(str(tmp_path / "none"), stdin=io.StringIO(""))


def test_a_barcode_reader_on_a_serial_port_ends_its_codes_as_it_likes_and_may_be_unplugged() -> None:
    reading, writing = os.pipe()
    main, side = os.openpty()
    with os.fdopen(reading) as keyboard, os.fdopen(writing, "w"):
        entries = Entries(os.ttyname(side), stdin=keyboard)
        os.close(side)
        os.write(main, b"MR-101\rMR-1")
        os.write(main, b"02\r\n\nMR-103\n\xff\x00MR\r")
        codes = [entries.next() for _ in range(4)]
        assert [None if code is None else code.text for code in codes] == [
            "MR-101", "MR-102", "MR-103", "\N{REPLACEMENT CHARACTER}\0MR",
        ]
        os.close(main)
        lost = entries.next()
        assert lost is not None
        assert lost.text is None, "the line says so, and goes on with the keyboard"


def test_runs_are_known_by_serial_number_day_and_verdict(tmp_path: Path) -> None:
    run_of(tmp_path, "MR-101", "ok", NOW - timedelta(days=1))
    run = run_of(tmp_path, "MR-102", "not-ok")
    run_of(tmp_path, "other-MR-102", "ok")
    known = TestedSpecimens(tmp_path)
    assert [(one.run, one.verdict, one.cycle_s) for one in known.of("mr-102")] == [(run.name, "not-ok", 12.5)]
    assert [one.serial_number for one in known.since(NOW - timedelta(hours=2))] == ["MR-102", "other-MR-102"]
    (run / "acceptance.json").write_text("damaged")
    assert known.of("MR-102") == []


def test_the_verdict_is_shown_in_large_letters_where_there_is_room() -> None:
    assert [len(large(title, 80)) for title in TITLES.values()] == [5, 5, 5]
    assert {len(row) for row in large("NOT OK", 80)} == {37}
    assert large("NOT TESTED", 40) == ["NOT TESTED"]


def test_a_matrix_without_bands_or_with_a_wrong_pattern_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = LINE.read_text()
    for old, new, problem in (
        ('bands = "line-bands.toml"', "", "acceptance.bands"),
        ('"MR-[0-9]{3}"', '"MR-["', "not a valid regular expression"),
        ("[acceptance]\nbands = \"line-bands.toml\"", "", "rig line` requires acceptance bands"),
    ):
        (tmp_path / "line.toml").write_text(text.replace(old, new))
        for name in ("line-bands.toml", "line-specimens.toml"):
            (tmp_path / name).write_bytes((LINE.parent / name).read_bytes())
        assert main(["line", str(tmp_path / "line.toml"), "--simulate"]) == EXIT_USAGE
        assert problem in capsys.readouterr().err
    with pytest.raises(FileProblem, match="does not match"):
        load_matrix(LINE).of_specimen("MX-101")
    slow = LineTable(serial="(A+)+")  # a backtracking engine would need 2**30 steps
    assert slow.problem_with("A" * 31 + "-")
    assert not slow.problem_with("A" * 32)


def test_a_simulated_rig_emulates_the_damper_of_its_serial_number(tmp_path: Path) -> None:
    file = LINE.parent / "line-specimens.toml"

    def values(serial: str) -> dict[str, float]:
        options = with_option(RigOptions(), f'specimen.serial_number="{serial}"')
        return specimen_model(as_specimen(options, file).damper)[1]

    demo = values("MR-101")
    assert values("MR-103")["Fyb"] == pytest.approx(0.8 * demo["Fyb"])
    assert {name for name, value in values("MR-102").items() if value != demo[name]} == {"Fyb", "Ca_plus"}
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('format = 1\n[[specimen]]\nserial = ".*"\nscale = { Fyz = 0.8 }\n')
    with pytest.raises(FileProblem, match=r"specimen\[1\]\.scale: unknown parameter Fyz; known: .*Fyb"):
        as_specimen(RigOptions(), wrong)
    wrong.write_text('format = 1\n[[specimen]]\nserial = "("\n')
    with pytest.raises(FileProblem, match=r"line 3.*not a valid regular expression"):
        as_specimen(RigOptions(), wrong)


@pytest.mark.parametrize(("code", "warned"), [(EXIT_UNKNOWN_STATE, "UNKNOWN"), (EXIT_STOPPED, "continue")])
def test_the_state_of_the_rig_is_stated_whatever_fails_afterwards(
    code: int, warned: str, session: LineSession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = io.StringIO()
    job = result("MR-101", "not-tested", code)
    monkeypatch.setattr(LineResult, "of", classmethod(lambda *_: job))
    monkeypatch.setattr(_Line, "_job", lambda *_: None)
    line = _Line.__new__(_Line)
    line._session, line._shown, line._entries = session, Console(file=shown, width=80), None

    def failing(wait_s: float = 0.0) -> None:
        raise OSError("the outbox cannot be written")

    monkeypatch.setattr(line, "delivered", failing)
    with pytest.raises(OSError, match="outbox"):
        line._test("MR-101")
    assert warned in shown.getvalue()

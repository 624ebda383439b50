"""JUnit XML: points, devices and scenarios as tests, valid at any time, and never a success if the command ended early.

The layout below is what both schemas in use require (JUnit.xsd of Apache Ant, junit-10.xsd of Jenkins); files of every
command were validated against both when it was written.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from xml.etree import ElementTree

import click
import pytest
from click.testing import CliRunner

from rig.campaign.results import CampaignResult, PointResult, RigState, StopReport
from rig.check.finding import CheckReport, DeviceReport, failed, warning
from rig.cli.junit import JUnitDisplay, junit_report, take_campaign, take_check, take_scenario
from rig.cli.main import cli
from rig.errors import FileProblem, Refused
from rig.test_point import TestPoint

ATTRIBUTES = {"id", "package", "name", "timestamp", "hostname", "tests", "failures", "errors", "skipped", "time"}


def read(path: Path) -> dict[str, tuple[str, str, str]]:
    """Test name to its outcome, type and message; the layout is checked."""
    root = ElementTree.parse(path).getroot()
    (suite,) = root
    assert root.tag == "testsuites"
    assert set(suite.attrib) == ATTRIBUTES
    kinds = [element.tag for element in suite]
    assert kinds == ["properties", *["testcase"] * (len(kinds) - 3), "system-out", "system-err"]
    tests, counts = {}, {"failure": 0, "error": 0, "skipped": 0}
    for case in suite.iter("testcase"):
        assert set(case.attrib) == {"classname", "name", "time"}
        assert float(case.attrib["time"]) >= 0.0
        assert len(case) <= 1
        outcome = case[0] if len(case) else None
        if outcome is not None:
            counts[outcome.tag] += 1
            assert set(outcome.attrib) == ({"message"} if outcome.tag == "skipped" else {"message", "type"})
        given, tag = ({}, "") if outcome is None else (outcome.attrib, outcome.tag)
        tests[case.attrib["name"]] = (tag, given.get("type", ""), given.get("message", ""))
    assert int(suite.attrib["tests"]) == len(tests)
    stated = {"failure": "failures", "error": "errors", "skipped": "skipped"}
    assert counts == {name: int(suite.attrib[attribute]) for name, attribute in stated.items()}
    return tests


def point(name: str, verdict: str, *reasons: str) -> PointResult:
    planned = TestPoint(id=name, waveform="sine", amplitude_m=0.05, frequency_Hz=1.0, current_A=0.5, cycles=5)
    return PointResult(planned, None, verdict, reasons)


STOP = StopReport("S1", "estop", True, True, True, True, "p003", "c", halted=True)
POINTS = (
    point("p001", "valid"), point("p002", "suspect", "lost-samples: 3 lost"), point("p003", "invalid"),
    point("p004", "not run"),
)  # fmt: skip
RESULT = CampaignResult(
    Path("logs/run"), POINTS, 1, 4, RigState.SAFE, "estop", "the e-stop chain is open", False, 9.0, 8.0, stop=STOP
)


def test_points_of_a_stopped_campaign_pass_fail_or_are_skipped_with_the_cause(tmp_path: Path) -> None:
    path = tmp_path / "run.xml"
    with junit_report(path, "run", matrix="a.toml", bench=None) as report:
        take_campaign(report, RESULT, (False, None))
        assert "unfinished" not in read(path)  # a page may stay open for hours from here on
    assert read(path) == {
        "p001 sine 50 mm 1 Hz 0.5 A": ("", "", ""),
        "p002 sine 50 mm 1 Hz 0.5 A": ("failure", "lost-samples", "suspect"),
        "p003 sine 50 mm 1 Hz 0.5 A": ("error", "estop", "the e-stop chain is open"),
        "p004 sine 50 mm 1 Hz 0.5 A": ("skipped", "", "not run: estop"),
        "campaign": ("error", "estop", "the e-stop chain is open"),
        "identification": ("skipped", "", "not run"),
    }


def test_a_complete_campaign_without_a_fit_fails_its_identification(tmp_path: Path) -> None:
    whole = replace(RESULT, points=RESULT.points[:1], total=1, stopped_by=None, detail="", stop=None)
    with junit_report(tmp_path / "run.xml", "run") as report:
        take_campaign(report, whole, (False, "no point is valid"))
    tests = read(tmp_path / "run.xml")
    assert tests["campaign"] == ("", "", "")
    assert tests["identification"] == ("failure", "identification", "no point is valid")


def test_a_command_that_is_killed_leaves_the_points_so_far_and_an_error(tmp_path: Path) -> None:
    path, calls = tmp_path / "run.xml", list[Any]()
    shown: Any = SimpleNamespace(phase=None, progress=None, message=None, planned=calls.append, point_done=calls.append)
    with junit_report(path, "run") as report:
        assert read(path)["unfinished"][:2] == ("error", "unfinished")
        display = JUnitDisplay(shown, report)
        report._written_s = -1.0
        points: Any = SimpleNamespace(points=[SimpleNamespace(point=one.point) for one in RESULT.points])
        display.planned(points)
        report._written_s = -1.0
        display.point_done(RESULT.points[0])
        outcomes = [outcome for outcome, _, _ in read(path).values()]
        assert outcomes == ["", "skipped", "skipped", "skipped", "error"]
    assert calls == [points, RESULT.points[0]]


@pytest.mark.parametrize(("error", "kind"), [
    (Refused("two-instances", "in use \x1b[31m\ud800"), "two-instances"), (KeyboardInterrupt(), "KeyboardInterrupt"),
    (click.UsageError("no bench"), "usage"), (ZeroDivisionError("x"), "ZeroDivisionError"),
])
def test_what_ends_a_command_early_is_an_error_and_goes_on(tmp_path: Path, error: BaseException, kind: str) -> None:
    with pytest.raises(type(error)), junit_report(tmp_path / "x.xml", "run"):
        raise error
    assert [test[:2] for test in read(tmp_path / "x.xml").values()] == [("error", kind)]


def test_a_file_that_cannot_be_written_is_refused_at_the_start_and_a_warning_at_the_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "stdout").symlink_to(tmp_path / "pipe")
    for path in (tmp_path / "none" / "x.xml", tmp_path / "pipe", tmp_path / "stdout", tmp_path, Path()):
        with pytest.raises(FileProblem, match="--junit"), junit_report(path, "run"):
            pytest.fail("the command began")
    assert ((tmp_path / "pipe").is_fifo(), (tmp_path / "stdout").is_symlink()) == (True, True), "neither is replaced"
    (tmp_path / "some").mkdir()
    with junit_report(tmp_path / "some" / "x.xml", "run"):
        (tmp_path / "some" / "x.xml").unlink()
        (tmp_path / "some").rmdir()
    assert "warning" in capsys.readouterr().err


def test_devices_fail_with_causes_and_fixes_and_pass_with_warnings(tmp_path: Path) -> None:
    findings = [warning("sample-rate", "slow", "w"), failed("unreachable", "refused", "plug in")]
    sensor = DeviceReport("load_cell", findings)
    check = CheckReport("my bench", (sensor, DeviceReport("lvdt", [warning("noisy", "noise", "shield")])), proved=False)
    with junit_report(tmp_path / "x.xml", "check") as report:
        take_check(report, check)
    tests = read(tmp_path / "x.xml")
    assert tests == {"load_cell": ("failure", "unreachable", "unreachable: refused"), "lvdt": ("", "", "")}
    assert "Fix: plug in" in (tmp_path / "x.xml").read_text()
    assert "lvdt: warning: noisy" in (tmp_path / "x.xml").read_text()


def test_scenarios_fail_with_their_checks(tmp_path: Path) -> None:
    with junit_report(tmp_path / "x.xml", "scenarios") as report:
        take_scenario(report, 7, [("travel", "too far", 1.5)], "rig scenarios --seeds 7", 0.5)
        take_scenario(report, 8, [], "rig scenarios --seeds 8", 0.5)
    assert read(tmp_path / "x.xml") == {
        "seed 7": ("failure", "travel", "1.500 s: travel: too far"), "seed 8": ("", "", ""),
    }


def test_a_plan_is_written_point_by_point(tmp_path: Path) -> None:
    examples, path = Path(__file__).parents[3] / "examples", tmp_path / "plan.xml"
    matrix = tmp_path / "m.toml"
    matrix.write_text((examples / "quick.toml").read_text().replace('amplitude = ["30 mm"]', 'amplitude = ["300 mm"]'))
    arguments = ["plan", str(matrix), "--bench", str(examples / "demo-bench.toml"), "--junit", str(path)]
    assert CliRunner().invoke(cli, arguments, standalone_mode=False).return_value == 3
    assert {outcome for outcome, _, _ in read(path).values()} == {"failure"}

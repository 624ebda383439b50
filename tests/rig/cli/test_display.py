"""What the operator reads while a campaign runs and when it has ended."""

from __future__ import annotations

import io
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from rig.bench.model import Bench
from rig.campaign.results import CampaignFinding, CampaignResult, PointResult, StopReport
from rig.characteristics.force_table import ForceCell, ForceRow, ForceTable
from rig.cli.display import LiveDisplay, PlainDisplay, display_for
from rig.cli.fit_tables import fit_tables
from rig.cli.force_tables import force_blocks
from rig.cli.job import JobResult
from rig.cli.output import show
from rig.cli.run import show_result
from rig.display import Display
from rig.fits.entries import ErrorSummary, Estimate, Evaluation, ModelScore, SolverReport, TestError
from rig.fits.fit_record import FitRecord
from rig.matrix.model import load_matrix
from rig.matrix.plan import plan
from rig.report.views import AS_MEASURED, MotionTerms
from rig.test_point import ENDURANCE, EnduranceStep, TestPoint

EXAMPLES = Path(__file__).parents[3] / "examples"
PLAN = plan(load_matrix(EXAMPLES / "quick.toml"), Bench.load(EXAMPLES / "demo-bench.toml"))
LIVE = {"position_m": 0.0123, "force_N": -512.4, "current_A": 0.998, "coil_temperature_degC": 31.25}


def terminal(*, is_terminal: bool) -> tuple[Console, io.StringIO]:
    text = io.StringIO()
    return Console(file=text, force_terminal=is_terminal, width=132, color_system=None), text


def result(verdict: str, *reasons: str) -> PointResult:
    return PointResult(TestPoint("p001", "sine", 0.03, 2.0, 0.5), Path("p001.h5"), verdict, reasons)


def campaign(
    *points: PointResult, rig_state: str = "safe", stopped_by: str | None = None, refused: bool = False
) -> CampaignResult:
    valid = sum(point.verdict == "valid" for point in points)
    detail = "" if stopped_by is None else f"{stopped_by} was seen"
    return CampaignResult(
        Path("run"), points, valid, len(points), rig_state, stopped_by, detail, refused, wall_s=1.0, motion_s=9.0
    )


def test_a_terminal_gets_the_live_display_and_a_file_the_plain_one() -> None:
    assert isinstance(display_for(terminal(is_terminal=True)[0]), LiveDisplay)
    assert not isinstance(display_for(terminal(is_terminal=False)[0]), LiveDisplay)


def test_the_live_display_shows_point_cycles_numbers_and_time_left() -> None:
    console, text = terminal(is_terminal=True)
    with LiveDisplay(console) as display:
        display.planned(PLAN)
        display.phase("running")
        display.progress("p002", 4, 83.0, LIVE)
    shown = text.getvalue()
    for expected in ("12.3 mm", "-512 N", "1.00 A", "31.2 degC", "3/7",
                     "sine 30 mm 2 Hz 1.5 A", "83 s left", "running"):
        assert expected in shown, expected


def test_the_plain_display_says_each_phase_once_and_each_point_with_verdict_reasons_and_time_left() -> None:
    console, text = terminal(is_terminal=False)
    with PlainDisplay(console) as display:
        display.planned(PLAN)
        for phase in ("settling the current", "running", "settling the current", "running"):
            display.phase(phase)
        display.progress("p001", 3, 200.0, LIVE)
        display.point_done(result("invalid", "lost samples: 12"))
        measured = {"peak_force_rebound_N": 812.3, "peak_force_compression_N": -790.0}
        display.shown = Display.of({"force": "lbf", "displacement": "in", "positive": "compression"})
        display.point_done(replace(result("valid"), quality=measured))
        display.message("warning", "station without real-time rights")
    shown = text.getvalue()
    assert shown.count("running") == 1
    assert re.search(r"✗ p001 +sine 30 mm 2 Hz 0.5 A +invalid; lost samples: 12 +1/2, 3 min 20 s left", shown)
    assert re.search(r"✓ p001  sine 1.181 in 2 Hz 0.5 A +comp. 177.6, reb. -182.6 lbf valid +2/2,", shown)
    assert "warning: station without real-time rights" in shown


def test_the_live_display_fits_eighty_columns_with_every_word_whole() -> None:
    text = io.StringIO()
    console = Console(file=text, force_terminal=True, width=80, color_system=None)
    with LiveDisplay(console) as display:
        display.planned(PLAN)
        display.phase("checking the sensors with a slow move")
        display.progress("p002", 4, 43_980.0, {**LIVE, "position_m": -0.1234, "force_N": -12345.0})
    lines = [re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", line) for line in re.split(r"[\r\n]+", text.getvalue())]
    assert max(map(len, lines)) <= 80
    assert "\N{HORIZONTAL ELLIPSIS}" not in text.getvalue()
    for expected in ("0/2 points, 12 h 13 min left", "3/7 cycles, sine 30 mm 2 Hz 1.5 A", "coil", "-123.4 mm"):
        assert any(expected in line for line in lines), expected


@pytest.mark.parametrize(
    ("ended", "error", "code"),
    [
        (campaign(result("valid")), None, 0),
        (campaign(result("valid")), "no model", 6),
        (campaign(result("valid"), result("invalid")), "no model", 5),
        (campaign(result("invalid"), stopped_by="sigint"), None, 4),
        (campaign(result("invalid"), stopped_by="unreachable", refused=True), None, 3),
        (campaign(result("invalid"), stopped_by="sigkill", rig_state="unknown"), "no model", 7),
    ],
)
def test_of_several_exit_codes_the_gravest_wins(ended: CampaignResult, error: str | None, code: int) -> None:
    assert JobResult(ended, None, None, error).exit_code == code


def test_an_unknown_rig_state_is_shouted() -> None:
    console, text = terminal(is_terminal=False)
    ended = campaign(result("invalid"), stopped_by="sigkill", rig_state="unknown")
    show_result(JobResult(ended, None, None, None), console)
    assert "Inspect the rig" in text.getvalue()
    assert "Stopped by sigkill" in text.getvalue()


STOPPED = StopReport(
    "S2", "sigint", proved=True, current_zero=True, pressure_off=True, moved=True, unfinished="p003", resume="c",
    halted=False, faded=True,
)


@pytest.mark.parametrize(
    ("change", "message"),
    [({"pressure_off": False}, "hydraulics off"), ({"proved": False, "current_zero": False}, "standstill and 0 A")],
)
def test_what_is_not_proved_is_named(change: dict[str, object], message: str) -> None:
    console, text = terminal(is_terminal=False)
    ended = campaign(result("invalid"), stopped_by="sigint", rig_state="unknown")
    show_result(JobResult(replace(ended, stop=replace(STOPPED, **change)), None, None, None), console)
    assert f"{message} could not be confirmed" in text.getvalue()


def ended(stop: StopReport, detail: str, *points: PointResult) -> str:
    console, text = terminal(is_terminal=False)
    stopped = replace(campaign(*points, stopped_by=stop.slug), detail=detail, stop=stop)
    show_result(JobResult(stopped, None, None, None), console)
    return text.getvalue()


def test_an_operators_stop_is_reported_as_one_with_the_way_to_go_on() -> None:
    assert (
        "Stopped by operator (Ctrl-C): motion ramped down, coil at 0 A, hydraulics off. p003 not finished. "
        "Continue with: rig run --resume run\n"
    ) in ended(STOPPED, "Ctrl-C", result("valid"))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"moved": False}, "no motion had started"),
        ({"halted": True}, "motion halted"),
        ({"faded": False}, "rod at rest, coil at 0 A"),
        ({"current_zero": False}, "coil current not confirmed"),
        ({"current_zero": False, "current_timeout_s": 1.0}, "not measured (the current source's time-out of 1 s"),
        ({"current_zero": False, "current_left_A": 1.5}, "COIL CURRENT STILL ON (1.5 A measured"),
        ({"moved": False, "current_left_A": 0.3}, "no motion had started, COIL CURRENT STILL ON (0.3 A"),
        ({"pressure_off": False}, "HYDRAULICS STILL ON"),
        ({"proved": False}, "standstill is not confirmed, coil at 0 A, hydraulics off"),
        ({"pressure_off": False, "pressure": "unknown"}, "HYDRAULICS NOT CONFIRMED OFF"),
        ({"pressure_off": False, "pressure": "none"}, "actuator holds its position (no hydraulics to switch off)"),
        ({"moved": False, "pressure_off": False, "pressure": "on"}, "no motion had started, HYDRAULICS STILL ON"),
        ({"unfinished": ""}, "All points were run"),
        ({"slug": "estop", "resume": "n"}, '--requalified "WHAT WAS CHECKED"'),
        ({"slug": "ecu-silent"}, "Stopped by ecu-silent (S2), no status: "),
    ],
)
def test_a_stop_says_only_what_was_proved_and_what_the_operator_has_to_do(
    change: dict[str, object], message: str
) -> None:
    assert message in ended(replace(STOPPED, **change), "no status", result("valid"))


def test_a_point_that_the_operator_stopped_is_nobodys_fault() -> None:
    console, text = terminal(is_terminal=False)
    with PlainDisplay(console) as display:
        display.point_done(result("invalid", "sigint: the point was stopped before it was complete", "amplitude: 3 % "
            "off"))
        display.point_done(result("invalid", "ecu-silent: the point was stopped before it was complete"))
    first, second = text.getvalue().splitlines()
    assert "not finished: stopped by the operator" in first
    assert "amplitude" not in first
    assert "ecu-silent" in second


def test_a_block_whose_cycles_were_run_is_not_offered_again() -> None:
    console, text = terminal(is_terminal=False)
    bad = result("invalid")
    step = EnduranceStep("wear", 0, 100, 1, 100, 10)
    bad = replace(bad, point=replace(bad.point, kind=ENDURANCE, endurance=step))
    done = replace(campaign(bad), endurance=({"id": "wear", "state": "complete"},))
    show_result(JobResult(done, None, None, None), console)
    assert "1 block of endurance tests is not valid" in text.getvalue()
    assert "--resume" not in text.getvalue()
    running = replace(done, endurance=({"id": "wear", "state": "running"},))
    show_result(JobResult(running, None, None, None), console)
    assert "--resume" in text.getvalue()


def test_points_that_are_not_valid_can_be_run_again_and_findings_are_shown() -> None:
    console, text = terminal(is_terminal=False)
    finding = CampaignFinding("zero-drift", "bench", "load cell and controller's force input drifted apart by +40 N")
    done = replace(campaign(result("valid"), result("invalid")), findings=(finding,))
    show_result(JobResult(done, None, None, None), console)
    assert "1 point is not valid. Run it again with: rig run --resume run" in text.getvalue()
    assert "zero-drift: load cell and controller's force input drifted apart by +40 N" in text.getvalue()


def test_force_tables_have_a_row_for_each_current_and_velocity_in_the_units_of_the_display() -> None:
    cell = ForceCell(("p001",), 444.82216, -889.64432, 1.0, 1.0, 450.0, math.nan)
    rows = (ForceRow(0.254, 0.0254, 1.5915, (cell, None)), ForceRow(0.508, 0.0508, 1.5915, (None, cell)))
    console, text = terminal(is_terminal=False)
    us = Display.of({"force": "lbf", "displacement": "in", "speed": "in/s", "positive": "compression"})
    strokes = MotionTerms(stroke=True)
    show(force_blocks([ForceTable("peak velocity", "sine", (0.0, 1.5), rows)], us, strokes), console)
    title, _head, *shown_rows = text.getvalue().splitlines()
    assert title == "Force at peak velocity (PVP), sine; compression positive"
    assert [row.split() for row in shown_rows] == [
        ["0", "10", "2", "200.0", "-100.0", "-", "-101.2"], ["1.5", "20", "4", "200.0", "-100.0", "-", "-101.2"],
    ]  # fmt: skip
    show(force_blocks([ForceTable("constant velocity", "triangle", (0.0, 1.5), rows[:1])], Display(), strokes), console)
    assert "Force at constant velocity, triangle, stroke 50.8 mm" in text.getvalue()
    show(force_blocks([ForceTable("peak velocity", "sine", (0.0, 1.5), rows[:1])], us, AS_MEASURED), console)
    assert "Force at peak velocity (PVP), sine, amplitude 1 in; " in text.getvalue()
    assert "-889.6" in text.getvalue()
    assert "mean of" not in text.getvalue()
    several = (replace(rows[0], cells=(replace(cell, points=("p001", "p002", "p003")), None)), rows[1])
    show(force_blocks([ForceTable("peak velocity", "sine", (0.0, 1.5), several)], us, strokes), console)
    shown_rows = text.getvalue().splitlines()[-2:]
    assert [row.split()[7:] for row in shown_rows] == [["mean", "of", "3"], ["1"]]


FITTED = ErrorSummary(5.0, 4.0, nrmse_percent_of_peak=1.0, per_test=(TestError("p001"),))
FIT = FitRecord(
    "asymmetric",
    {"m": Estimate(3.8, "kg", 3.7, 3.9, 3.6, 4.0), "eta": Estimate(None, "1/s", identifiable=False, reason="constant")},
    SolverReport("separable"),
    Evaluation(FITTED, ErrorSummary(6.0, nrmse_percent_of_peak=2.0, per_test=(TestError("p002"),)), adequate=False),
    warnings=("saturated",),
)  # fmt: skip


def shown(fit: FitRecord, truth: dict[str, float] | None = None) -> str:
    console, text = terminal(is_terminal=False)
    show(fit_tables(fit, truth), console)
    return text.getvalue()


def evaluated(**changes: Any) -> FitRecord:  # noqa: ANN401 - fields of an evaluation
    return replace(FIT, evaluation=replace(FIT.evaluation, **changes))


def test_a_fit_beside_the_truth_says_what_is_inside_what_cannot_be_found_and_what_does_not_fit() -> None:
    text = shown(FIT, {"m": 4.5, "eta": 25.0})
    for expected in ("95 % interval (each parameter", "3.7 to 3.9", "NO", "eta not identifiable: constant",
                     "validation", "exceeds the repeatability", "warning: saturated"):  # fmt: skip
        assert expected in text, expected


@pytest.mark.parametrize("tests", [1, 2])
def test_nothing_can_be_held_out_of_a_single_test(tests: int) -> None:
    error = replace(FITTED, per_test=FITTED.per_test * tests)
    assert ("--holdout" in shown(evaluated(error=error, holdout=None))) == (tests == 2)


def test_a_fit_shows_its_ranking_its_numbers_each_held_out_test_and_what_to_try() -> None:
    unknown = TestError("p007", rmse_N=61.5, nrmse_percent_of_peak=7.25)
    scores = (ModelScore("kwok", 3.5, 1.0, 11.0, 9), ModelScore("bingham"))
    two = replace(FITTED, per_test=FITTED.per_test * 2)
    fit = evaluated(error=two, holdout=ErrorSummary(61.5, per_test=(unknown,)), selection=scores)
    text = shown(replace(fit, form="F = c v", parameters={"c": Estimate(812.0, "N s/m", 811.0, 813.0)}))
    for expected in ("best first", "kwok", "3.5", "bingham", "c = 812 N s/m", "p007", "7.25", "61.5"):
        assert expected in text, expected
    assert "try:" not in text
    assert "nan" not in text
    text = shown(evaluated(error=two, holdout=None))
    assert "--model all" in text
    assert "--holdout" in text


def test_inside_is_evaluated_by_the_interval_that_is_shown_and_only_where_there_is_one() -> None:
    mass = FIT.parameters["m"]
    assert [mass.holds(true) for true in (3.85, 3.95, None)] == [True, False, None]
    assert FIT.parameters["eta"].holds(25.0) is None

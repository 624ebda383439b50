"""What the caller of a campaign gets: exit codes, keys, a display that cannot hurt, books that add up."""

from __future__ import annotations

import json
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from rig.campaign import CampaignResult, PointResult, live_display
from rig.campaign.operator_link import GuardedDisplay
from rig.campaign.point_results import PointResults
from rig.campaign.stop_cause import StopCause
from rig.matrix.plan import Plan
from rig.station.live_folder import STATE
from rig.test_point import TestPoint

RESULT = CampaignResult(Path("c"), (), 2, 2, "safe", None, "", refused=False, wall_s=1.0, motion_s=1.0)
POINTS = (TestPoint("p001", "sine", 0.02, 2.0, 0.5), TestPoint("p002", "sine", 0.02, 1.0, 0.5))


@pytest.mark.parametrize(
    ("result", "code"),
    [
        (RESULT, 0),
        (replace(RESULT, valid=1), 5),
        (replace(RESULT, valid=1, stopped_by="sigint"), 4),
        (replace(RESULT, valid=0, stopped_by="wrong-identity", refused=True), 3),
        (replace(RESULT, valid=1, stopped_by="ecu-silent", rig_state="unknown"), 7),
        (replace(RESULT, valid=0, stopped_by="task-dies", refused=True, rig_state="unknown"), 7),
    ],
    ids=["done", "not-all-valid", "stopped", "refused", "unknown-after-stop", "unknown-first"],
)
def test_the_exit_code_that_matters_most_wins(result: CampaignResult, code: int) -> None:
    assert result.exit_code == code


class Broken:
    """A display whose terminal went away."""

    calls = 0

    def planned(self, plan: Plan) -> None:
        raise BrokenPipeError

    def phase(self, text: str) -> None:
        self.calls += 1
        raise BrokenPipeError("no terminal")

    progress = point_done = message = planned


def test_a_broken_display_goes_dark_and_is_not_queried_again() -> None:
    broken = Broken()
    display = GuardedDisplay(broken)
    display.phase("running")
    display.phase("stopping")
    display.message("error", "anything")
    display.close(5.0)
    assert broken.calls == 1
    assert "no terminal" in display.failed


def test_centring_ends_the_stop_that_was_repeated(tmp_path: Path) -> None:
    shown = live_display.LiveDisplay(tmp_path, dict)
    cooling = "waiting at rest for the ECU to cool down"
    for phase, stopping in (("running", False), ("stopping", True), (cooling, True), ("centring", False)):
        shown.phase(phase)
        assert json.loads((tmp_path / STATE).read_text(encoding="utf-8"))["stopping"] is stopping


class Standing(Broken):
    """A terminal held by Ctrl-S."""

    def __init__(self) -> None:
        self.going_on = threading.Event()
        self.shown: list[str] = []

    def message(self, level: str, text: str) -> None:
        self.going_on.wait(10.0)
        self.shown.append(text)


def test_a_display_that_stalls_does_not_block_and_shows_everything_in_order_later() -> None:
    standing = Standing()
    display = GuardedDisplay(standing)
    for number in range(100):
        display.message("info", str(number))
    assert standing.shown == []
    standing.going_on.set()
    display.close(5.0)
    assert standing.shown == [str(number) for number in range(100)]
    display.message("info", "too late")
    assert len(standing.shown) == 100


def test_a_point_never_begun_is_in_the_books_as_not_run() -> None:
    results = PointResults(POINTS)
    results.record_verdict(POINTS[0], Path("p001.h5"), "valid", (), 0)
    assert [(result.id, result.verdict) for result in results.all_results()] == [("p001", "valid"), ("p002", "not run")]
    assert results.valid == 1
    assert results.all_results()[1].to_json()["file"] is None


def test_a_second_attempt_replaces_a_broken_first_and_never_a_valid_one() -> None:
    results = PointResults(POINTS)
    results.record_verdict(POINTS[0], Path("p001.h5"), "invalid", ("ecu-silent",), 3)
    results.record_verdict(POINTS[0], Path("p001-attempt2.h5"), "valid", (), 0)
    results.given_up(POINTS[0], StopCause("current-tracking", "never settled"))
    (first, _) = results.all_results()
    assert (first.verdict, first.file) == ("valid", Path("p001-attempt2.h5"))


def test_wall_time_runs_from_the_first_points_start_to_the_last_points_end() -> None:
    results = PointResults(POINTS)
    assert results.session(Path("c")).wall_s == 0.0
    results.began_ns, results.ended_ns = 1_000_000_000, 6_500_000_000
    assert results.session(Path("c")).wall_s == pytest.approx(5.5)


def test_a_points_json_has_an_absolute_file_and_plain_lists(tmp_path: Path) -> None:
    result = PointResult(POINTS[0], tmp_path / "p001.h5", "suspect", ("a", "b"), 4)
    answer = result.to_json()
    assert answer["file"] == str((tmp_path / "p001.h5").resolve())
    assert answer["reasons"] == ["a", "b"]

"""Rows of clocks, threads, processes and disks, put in by the seams or around the process."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from end_states import assert_stopped
from matrices import LONG_SECOND_POINT
from process_faults import fill_disk, seam_environment, switch_on

from rig.clock import monotonic_ns
from rig.recording.conversion.recovery import recover

if TYPE_CHECKING:
    from conftest import InMotion
    from watched_campaign import Ending



@pytest.fixture
def seam(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder in which files switch faults on in the campaign's processes."""
    folder = tmp_path / "seam"
    folder.mkdir()
    for name, value in seam_environment(folder).items():
        monkeypatch.setenv(name, value)
    return folder


def test_a_machine_that_slept_stops_and_never_continues(seam: Path, in_motion: InMotion) -> None:
    campaign = in_motion()
    assert_stopped(campaign.finish(switch_on(seam, "host-suspend", 3600.0)), "host-suspend")


@pytest.mark.parametrize("step_s", [-86400.0])
def test_a_step_of_the_wall_clock_is_logged_and_disturbs_nothing(
    seam: Path, in_motion: InMotion, step_s: float
) -> None:
    campaign = in_motion()
    stepped_ns = switch_on(seam, "clock-step", step_s)
    ending = campaign.finish()
    assert ending.exit_code == 0, ending.said
    said = [line for line in ending.log if line.get("slug") == "clock-step"]
    assert [line["stepped_s"] for line in said] == [pytest.approx(step_s, abs=0.5)]
    assert (said[0]["host_ns"] - stepped_ns) / 1e9 < 10.0
    assert set(ending.verdicts().values()) == {"valid"}


def test_a_thread_of_the_station_that_dies_stops_the_rig(
    seam: Path, in_motion: InMotion
) -> None:
    campaign = in_motion()
    assert_stopped(campaign.finish(switch_on(seam, "task-dies")), "task-dies")


def test_a_finaliser_that_dies_stops_the_rig_and_its_points_are_recovered(
    in_motion: InMotion
) -> None:
    campaign = in_motion(matrix=LONG_SECOND_POINT)
    while not (campaign.folder / "points" / "p001.h5").exists():
        campaign.run_on(0.2)
    finaliser, killed_ns = campaign.child("finaliser"), monotonic_ns()
    os.kill(finaliser, signal.SIGKILL)
    ending = campaign.finish(killed_ns)
    assert_stopped(ending, "task-dies", broken=None)
    assert (ending.folder / "points" / "p002.journal").exists()
    assert [(each.id, each.verdict) for each in recover(ending.folder)] == [("p002", "invalid")]
    assert ending.point("p002").reasons[0].startswith("task-dies")


def test_a_flush_that_failed_is_never_trusted(seam: Path, in_motion: InMotion) -> None:
    campaign = in_motion()
    ending = campaign.finish(switch_on(seam, "fsync-error"))
    assert_stopped(ending, "fsync-error", broken=None)
    assert_abandoned(ending, "fsync-error")


def test_a_disk_that_is_full_stops_the_rig_and_what_was_written_is_recovered(
    in_motion: InMotion
) -> None:
    campaign = in_motion(seconds=2.0)
    journal = campaign.folder / "points" / "p002.journal"
    ending = campaign.finish(fill_disk(campaign))
    assert_stopped(ending, "disk-full", broken=None)
    assert journal.exists()
    assert_abandoned(ending, "disk-full")


def assert_abandoned(ending: Ending, slug: str) -> None:
    """The running point is invalid and has no file; its journal recovers to an invalid one with samples."""
    answered = {each["id"]: each for each in ending.answer["points"]}["p002"]
    assert (answered["verdict"], answered["file"]) == ("invalid", None)
    assert answered["reasons"][0].startswith(slug)
    assert [(each.id, each.verdict, each.error) for each in recover(ending.folder)] == [("p002", "invalid", "")]
    assert np.ptp(ending.point("p002").displacement_m) > 0.03

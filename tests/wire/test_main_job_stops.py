"""The main job stopped by the operator, by a dying process, by a refusal: end state on the true physics and on disk.

In virtual time; an application killed for real and a rig started by hand on real processes and wires.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from matrices import matrix_text
from simulated_campaign import Ended, Session, session, simulated
from true_states import Truth

from drivers.roles import State
from rig.recording.recorded_point import RecordedPoint

if TYPE_CHECKING:
    from conftest import Campaign

Start = Callable[..., "Campaign"]

MATRIX = matrix_text("1.5 A", "1 A", amplitude="40 mm", frequency="1 Hz")
COIL_LAG_S = 0.25
FADE_S = 1.0 + 0.2


def assert_stopped(truth: Truth, at_s: float) -> None:
    """0 A within the coil's lag and standstill within one cycle of fade-out after `at_s`, and for good."""
    assert_no_current(truth, at_s)
    assert np.abs(truth.velocity_m_s[truth.since(at_s + FADE_S)]).max() < 2e-3


def assert_no_current(truth: Truth, at_s: float) -> None:
    """0 A within the coil's lag after `at_s`, and for good."""
    assert np.abs(truth.current_A[truth.since(at_s + COIL_LAG_S)]).max() < 0.05


def causes(ended: Ended) -> list[tuple[str, str]]:
    """Slug and stop of each latched first cause."""
    return [(line["slug"], line["stop"]) for line in ended.story if line.get("what") == "trip"]


@pytest.fixture
def job(tmp_path: Path) -> Iterator[Session]:
    """The job in virtual time, from its begin."""
    with session(tmp_path, MATRIX, speed=5.0, seed=1) as begun:
        yield begun


def in_motion(job: Session, seconds: float) -> None:
    """Let its first point run for so long on the rig's clock."""
    job.campaign.wait_for("START")
    job.campaign.run_on(seconds)


@pytest.mark.few(1)
@pytest.mark.parametrize("storm", [False, True], ids=["once", "storm"])
def test_ctrl_c_stops_at_once_keeps_the_point_as_invalid_and_further_ones_change_nothing(
    job: Session, storm: bool
) -> None:
    in_motion(job, 5.0)
    job.interrupt()
    if storm:
        job.until(lambda line: line.get("phase") == "stopping")
        for _ in range(5):
            job.interrupt()
        job.until(lambda line: line.get("phase") == "hydraulics off")
        job.interrupt()
    ended = job.end()
    assert ended.exit_code == 4
    truth = ended.truth
    assert_stopped(truth, truth.first("FADE_STOP").time_s)
    assert abs(truth.first("SET_CURRENT", text="0.000 A").time_s - truth.first("FADE_STOP").time_s) < 0.1
    assert causes(ended) == [("sigint", "S2")]
    point = RecordedPoint.open(ended.folder / "points" / "p001.h5")
    assert point.verdict == "invalid"
    assert "sigint" in point.reasons[0]
    assert np.ptp(point.displacement_m) > 0.07


def test_sigterm_also_takes_the_pressure_away(job: Session) -> None:
    in_motion(job, 2.0)
    job.campaign.send(signal.SIGTERM)
    ended = job.end()
    assert ended.exit_code == 4
    assert_stopped(ended.truth, ended.truth.first("FADE_STOP").time_s)
    assert ended.truth.state[-1] == State.OFF
    assert causes(ended) == [("sigterm", "S1")]


def test_ctrl_c_before_the_rig_is_armed_moves_nothing(job: Session) -> None:
    job.campaign.until(lambda: bool(job.campaign.stage.named("rig.station")), "the station's start")
    job.interrupt()
    ended = job.end()
    assert ended.exit_code == 4
    assert np.ptp(ended.truth.displacement_m) < 1e-6
    assert "START" not in [entry.code for entry in ended.truth.log]


def test_a_killed_station_leaves_the_rig_to_its_dead_men_and_exits_with_state_unknown(job: Session) -> None:
    in_motion(job, 2.0)
    job.campaign.send(signal.SIGKILL, "rig.station")
    ended = job.end()
    assert ended.exit_code == 7
    truth = ended.truth
    starved = [entry.time_s for entry in truth.all("TRIP", text="WATCHDOG")]
    assert len(starved) == 2, "once in the preflight, once now"
    assert_stopped(truth, starved[1])
    assert_no_current(truth, truth.first("ECU_FAULT", text="COMMAND_TIMEOUT").time_s)
    assert RecordedPoint.open(ended.folder / "points" / "p001.h5").verdict == "invalid"


@pytest.mark.nightly
def test_a_fault_of_the_coil_ends_the_campaign_by_name_with_the_finished_point_kept(tmp_path: Path) -> None:
    ended = simulated(tmp_path, MATRIX, "--fault", "coil-open-short@14", speed=5.0, seed=1)
    assert ended.exit_code == 4
    assert_stopped(ended.truth, ended.truth.first("FADE_STOP").time_s)
    assert causes(ended) == [("coil-open-short", "S2")]
    points = ended.folder / "points"
    assert RecordedPoint.open(points / "p001.h5").verdict == "valid"
    assert RecordedPoint.open(points / "p002.h5").verdict == "invalid"


@pytest.mark.parametrize(
    ("good", "bad", "named"),
    [
        ('serial_number = "SIM-ACT-1"', 'serial_number = "ANOTHER"', "ANOTHER"),
        ("serial_number = 1001", "serial_number = 1002", "1002"),
    ],
    ids=["actuator", "ecu"],
)
def test_another_device_than_the_benchs_is_refused_before_anything_moves(
    job: Session, good: str, bad: str, named: str
) -> None:
    bench = job.campaign.stage.root / "bench.toml"
    text = bench.read_text(encoding="utf-8")
    assert good in text
    bench.write_text(text.replace(good, bad), encoding="utf-8")
    ended = job.end()
    assert ended.exit_code == 3
    assert ended.answer["stopped_by"] == "wrong-identity"
    assert named in ended.answer["error"]
    assert {point["verdict"] for point in ended.answer["points"]} == {"not run"}
    described = json.loads((ended.folder / "campaign.json").read_text(encoding="utf-8"))
    assert described["simulated"] is None
    assert np.ptp(ended.truth.displacement_m) < 1e-6
    assert not ended.truth.log


@pytest.mark.wire
def test_a_killed_application_leaves_the_station_to_stop_the_rig_and_the_truth_is_completed(
    start_campaign: Start,
) -> None:
    campaign = start_campaign(MATRIX)
    campaign.wait_for("cycles 2")
    campaign.process.send_signal(signal.SIGKILL)
    assert campaign.finish() == -signal.SIGKILL
    truth = campaign.truth()
    assert_stopped(truth, truth.first("FADE_STOP").time_s)
    assert truth.state[-1] == State.OFF


def started_rig(folder: Path, *arguments: str) -> tuple[subprocess.Popen[str], Path]:
    process = subprocess.Popen(
        [sys.executable, "-m", "simulators", "--speed", "5", "--truth", str(folder / "hand.h5"), *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    return process, Path(process.stdout.readline().strip())


@pytest.mark.few(1)
@pytest.mark.parametrize("arguments", [("--actuator", "rtu"), ("--ports", "socket")], ids=["rtu", "sockets"])
@pytest.mark.wire
def test_a_rig_started_by_hand_on_other_wires_runs_the_same_job(
    start_campaign: Start, tmp_path: Path, arguments: tuple[str, ...]
) -> None:
    rig, bench = started_rig(tmp_path, *arguments)
    try:
        campaign = start_campaign(MATRIX.replace(', "1 A"', ""), bench=bench)
        assert campaign.finish() == 0
    finally:
        rig.terminate()
        rig.communicate(timeout=60)
    (point,) = map(RecordedPoint.open, (campaign.folder / "points").glob("*.h5"))
    assert point.verdict == "valid"
    assert len(Truth.load(tmp_path / "hand.h5").runs()) == 1

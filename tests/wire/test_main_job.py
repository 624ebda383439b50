"""The main job on real processes and wires: what is recorded is compared with what really happened."""

from __future__ import annotations

import json
import signal
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from true_states import Truth

from drivers.roles import State
from rig.campaign import CampaignOptions, CampaignResult, PointResult, run_campaign
from rig.campaign.sequencer.state import Phase
from rig.matrix.plan import Plan
from rig.recording.journal.campaign_log import read_log
from rig.recording.run import Run

pytestmark = pytest.mark.wire

MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
mid_stroke = "4 mm"
prior = "demo"
[matrix]
cycles = 6
rest = "2 s"
adapt_amplitude = false
[[point]]
waveform = "sine"
amplitude = "40 mm"
frequency = "1 Hz"
current = "0 A"
[[point]]
waveform = "triangle"
amplitude = "40 mm"
frequency = "1 Hz"
current = "1.5 A"
[campaign]
current_settled = "20 mA"
"""
SPEED = 5.0


@dataclass
class Seen:
    """Everything a display was shown."""

    phases: list[str] = field(default_factory=list)
    points: list[str] = field(default_factory=list)
    live: dict[str, float] = field(default_factory=dict)
    times_left_s: list[float] = field(default_factory=list)
    messages: list[str] = field(default_factory=list)

    def planned(self, plan: Plan) -> None:
        self.phases.append(f"planned {len(plan.points)}")

    def phase(self, text: str) -> None:
        self.phases.append(text)

    def progress(self, point_id: str, cycles_done: int, time_left_s: float, live: Mapping[str, float]) -> None:
        self.live.update(live)
        self.times_left_s.append(time_left_s)

    def point_done(self, result: PointResult) -> None:
        self.points.append(result.id)

    def message(self, level: str, text: str) -> None:
        self.messages.append(f"{level} {text}")


@dataclass(frozen=True)
class Job:
    result: CampaignResult
    seen: Seen
    truth: Truth
    run: Run


@pytest.fixture(scope="module")
def job(tmp_path_factory: pytest.TempPathFactory) -> Job:
    folder = tmp_path_factory.mktemp("main-job")
    matrix = folder / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    seen, before = Seen(), signal.getsignal(signal.SIGINT)
    result = run_campaign(CampaignOptions(matrix, folder / "out", simulate=True, speed=SPEED, seed=7), seen)
    assert signal.getsignal(signal.SIGINT) is before
    assert result.exit_code == 0, f"{result.stopped_by}: {result.detail}; {seen.messages}"
    return Job(result, seen, Truth.load(result.campaign / "truth.h5"), Run.open(result.campaign))


def test_every_point_is_valid_and_the_rig_is_safe(job: Job) -> None:
    verdicts = {point.id: (point.verdict, point.reasons) for point in job.result.points}
    assert verdicts == {"p001": ("valid", ()), "p002": ("valid", ())}
    assert (job.result.valid, job.result.total, job.result.exit_code) == (2, 2, 0)
    assert (job.result.rig_state, job.result.stopped_by) == ("safe", None)
    assert job.result.motion_s == pytest.approx(2 * 8.0)


def test_the_result_has_the_documented_keys(job: Job) -> None:
    keys = {
        "campaign", "points", "valid", "total", "rig_state", "stopped_by", "wall_s", "motion_s",
        "start_temperature_degC", "waits", "findings", "stop", "confirmed", "setpoints", "endurance",
    }  # fmt: skip
    answer = json.loads(json.dumps(job.result.to_json()))
    assert set(answer) == keys
    assert all(Path(point["file"]).is_absolute() and Path(point["file"]).is_file() for point in answer["points"])


def test_the_campaign_keeps_its_files_and_its_story(job: Job) -> None:
    folder = job.result.campaign
    assert (folder / "matrix.toml").read_text(encoding="utf-8") == MATRIX
    assert "[actuator]" in (folder / "bench.toml").read_text(encoding="utf-8")
    assert json.loads((folder / "campaign.json").read_text(encoding="utf-8"))["simulated"]["seed"] == 7
    story = read_log(folder)
    assert [line["point"] for line in story if line["event"] == "point"] == ["p001", "p002"]
    assert "actuator" in next(line for line in story if line["event"] == "connected")
    assert not list((folder / "points").glob("*.journal"))


def test_the_operator_sees_phases_live_numbers_and_a_shrinking_time_left(job: Job) -> None:
    proofs = [Phase.CHECKING_ZEROS, Phase.PROVING_WATCHDOG, Phase.PROVING_SENSORS, Phase.CHECKING_RETURN]
    assert [phase for phase in job.seen.phases if phase in proofs] == proofs
    assert job.seen.phases[-1] == "ended"
    assert set(job.seen.live) == {"position_m", "force_N", "current_A", "coil_temperature_degC"}
    assert job.seen.times_left_s[0] == pytest.approx(2 * (8.0 + 2.0) / SPEED)
    assert job.seen.times_left_s == sorted(job.seen.times_left_s, reverse=True)
    assert job.seen.points == ["p001", "p002"]


def test_recorded_motion_and_force_are_what_really_happened(job: Job) -> None:
    runs = job.truth.runs()
    assert len(runs) == len(job.run.points) == 2
    for point, run in zip(job.run.points, runs, strict=True):
        true_m, true_N = job.truth.displacement_m[run], job.truth.force_N[run]
        finite = np.isfinite(point.force_N)
        assert np.ptp(point.displacement_m) == pytest.approx(np.ptp(true_m), abs=1e-4)
        assert np.ptp(true_m) == pytest.approx(0.080, rel=0.03), "the servo droops less than 3 %"
        assert np.max(point.force_N[finite]) == pytest.approx(np.max(true_N), abs=40.0)
        assert np.min(point.force_N[finite]) == pytest.approx(np.min(true_N), abs=40.0)
        worked_J = np.trapezoid(point.force_N[finite], point.displacement_m[finite])
        assert worked_J == pytest.approx(np.trapezoid(true_N, true_m), rel=0.01), "a skew would open or close the loop"


def test_the_current_is_there_before_the_motion_and_gone_after_it(job: Job) -> None:
    truth = job.truth
    for point, run in zip(job.run.points, truth.runs(), strict=True):
        assert np.abs(truth.current_A[run] - point.current_A).max() < 0.025
    ends = [run.stop for run in truth.runs()]
    starts = [run.start for run in truth.runs()][1:]
    for end, start in zip(ends, starts, strict=False):
        assert np.abs(truth.current_A[end:start]).min() < 0.025


def test_the_rod_rests_at_mid_stroke_between_points_for_the_rest_requested(job: Job) -> None:
    truth, runs = job.truth, job.truth.runs()
    for earlier, later in pairwise(runs):
        assert truth.time_s[later.start] - truth.time_s[earlier.stop] >= 2.0
        resting = slice(earlier.stop + 300, later.start)
        assert np.abs(truth.displacement_m[resting] - 0.004).max() < 0.5e-3


def test_nothing_moves_before_watchdog_and_zeros_are_proved(job: Job) -> None:
    names = [each.code for each in job.truth.log]
    assert names.index("TRIP") < names.index("HYDRAULICS_LOW") < names.index("HYDRAULICS_ON") < names.index("MOVE_TO")
    before = slice(0, int(np.searchsorted(job.truth.time_s, job.truth.first("HYDRAULICS_LOW").time_s)))
    assert np.abs(job.truth.displacement_m[before] - job.truth.displacement_m[0]).max() < 1e-6


def test_the_rig_is_left_without_pressure_and_current(job: Job) -> None:
    assert job.truth.state[-1] == State.OFF
    assert abs(job.truth.current_A[-1]) < 0.01
    assert [each.code for each in job.truth.log][-2:] == ["HYDRAULICS_OFF", "RELEASE"]

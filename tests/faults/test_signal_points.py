"""Signals in a world: a wire pulled in the middle; killed, and resumed with the file of the record gone."""

from __future__ import annotations

import math
import signal
from pathlib import Path

import pytest
from end_states import assert_no_current, assert_still
from scenario_campaign import ScenarioCampaign, Setting, begin
from watched_campaign import Ending

from rig.identification import identify
from rig.recording.run import Run
from rig.report.document import write_report
from simulators.scenarios.stage import Stage

MATRIX = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
waveform = ["sine", "file"]
amplitude = ["10 mm"]
frequency = ["2 Hz"]
current = ["0.5 A"]
cycles = 4
[matrix.file]
file = ["drive.csv"]
ramp = "500 ms"
"""
SWEEP = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
waveform = ["sweep"]
current = ["0.5 A"]
[matrix.sweep]
first_frequency = "1 Hz"
last_frequency = "4 Hz"
first_amplitude = "10 mm"
last_amplitude = "5 mm"
duration = "5 s"
"""


def setting(matrix: str, *simulator: str) -> Setting:
    return Setting(("--actuator", "setpoints", *simulator), matrix, speed=1.0, real_time=True)


def drive(folder: Path) -> Path:
    """Two tones, 4 s, 100 rows a second."""
    path = folder / "drive.csv"
    lines = [
        f"{k / 100:.2f},{8 * math.sin(math.tau * k / 100) + 3 * math.sin(math.tau * 2.7 * k / 100 + 1):.4f}"
        for k in range(401)
    ]
    path.write_text("time_s,displacement_mm\n" + "\n".join(lines) + "\n", encoding="utf-8")
    return path


def killed_in_the_signal(campaign: ScenarioCampaign) -> None:
    journal = campaign.folder / "journal.jsonl"
    campaign.until(lambda: '"point": "p002"' in journal.read_text(encoding="utf-8"), "the second point")
    campaign.run_on(1.2)
    campaign.send(signal.SIGKILL)
    campaign.finish()


@pytest.mark.apart
def test_killed_in_the_middle_it_is_resumed_from_the_kept_record_and_fitted_beside_a_sine(tmp_path: Path) -> None:
    own = drive(tmp_path)
    with Stage(2, tmp_path) as stage:
        campaign = begin(stage, tmp_path, setting(MATRIX))
        killed_in_the_signal(campaign)
        own.unlink()
        code, answer = campaign.resumed(setting(MATRIX))
        folder = campaign.campaign_folder
    assert code == 0, answer
    run = Run.open(folder)
    assert [(point.id, point.verdict) for point in run.points] == [("p001", "valid"), ("p002", "valid")]
    played = run.points[1]
    quality = played.quality.signal
    assert quality is not None
    assert quality.nrms is not None
    assert quality.nrms < 0.02
    assert quality.delay_s is not None
    assert 0.002 < quality.delay_s < 0.02, "the servo of 30 Hz is 7.4 ms late; the time base leaves some open"
    assert (quality.judged_start_s, quality.judged_end_s) == pytest.approx(
        (quality.start_s + 0.5, quality.start_s + 3.5), abs=0.02
    )
    target = played.raw("signal_target")
    assert target is not None
    assert len(target["value"]) == pytest.approx(402, abs=3), "one each 10 ms"
    assert max(abs(target["value"])) == pytest.approx(played.amplitude_m, rel=0.01)
    fit = identify(run, model="asymmetric")
    assert {test.id for test in fit.error.per_test} == {"p001", "p002"}
    assert fit.error.nrmse_percent_of_peak < 6.0
    assert "file drive" in write_report(folder).read_text(encoding="utf-8")


@pytest.mark.nightly
def test_a_wire_pulled_in_the_middle_ends_as_its_row_says(tmp_path: Path) -> None:
    with Stage(1, tmp_path) as stage:
        ending: Ending = begin(stage, tmp_path, setting(SWEEP, "--fault", "loadcell-pulled@2.5")).finish()
    assert ending.exit_code == 4, ending.output
    assert ending.trips()[0] == ("loadcell-pulled", "S2")
    assert ending.answer["rig_state"] == "safe"
    assert ending.verdicts() == {"p001": "invalid"}
    fault = ending.truth.first("FAULT")
    assert_still(ending.truth, fault.time_s + 0.5)
    assert_no_current(ending.truth, fault.time_s)
    played = Run.open(ending.folder).points[0].raw("signal_time")
    assert played is not None
    assert 0.5 < played["value"][-1] < 4.0, "in the middle of the sweep"


ITERATED = """
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
waveform = ["file"]
current = ["2.5 A"]
[matrix.file]
file = ["drive.csv"]
ramp = "500 ms"
[matrix.iterate]
tolerance = "0.5 %"
noise_duration = "10 s"
[identify]
enabled = false
"""


@pytest.mark.nightly
def test_killed_in_an_iteration_it_is_resumed_from_the_stored_command(tmp_path: Path) -> None:
    slow = "--option", "servo.bandwidth_Hz=6"
    drive(tmp_path)
    with Stage(3, tmp_path) as stage:
        campaign = begin(stage, tmp_path, setting(ITERATED, *slow))
        journal = campaign.folder / "journal.jsonl"
        campaign.until(lambda: "iteration 0: RMS error" in journal.read_text(encoding="utf-8"), "the first trial")
        campaign.run_on(1.0)
        campaign.send(signal.SIGKILL)
        campaign.finish()
        stored = campaign.campaign_folder / "drives" / "p001.h5"
        assert stored.is_file()
        assert not list((campaign.campaign_folder / "points").iterdir()), "trials are not points"
        code, answer = campaign.resumed(setting(ITERATED, *slow))
        folder = campaign.campaign_folder
    lines = (folder / "journal.jsonl").read_text(encoding="utf-8")
    assert lines.count("identifying the response") == 1, "the stored response serves"
    assert "starts from a stored command" in lines
    (point,) = answer["points"]
    iteration, errors = point["iteration"], point["iteration"]["errors"]
    assert (iteration["start"], iteration["outcome"]) == ("kept", "converged"), (code, answer)
    assert errors[-1] <= 0.005
    recorded = Run.open(folder).points[0]
    assert recorded.quality.signal is not None
    assert recorded.quality.signal.nrms is not None
    assert recorded.quality.signal.nrms < 0.006
    assert recorded.commanded.tracking_tolerance == 0.005
    target, command = recorded.raw("signal_target"), recorded.raw("signal_command")
    assert target is not None
    assert command is not None
    assert len(target["value"]) == len(command["value"])
    assert max(abs(command["value"] - target["value"])) > 1e-4, "the command leads the target and is larger"

"""Campaigns of sines, signals and hybrid tests with a fit as the assumed damper: killed in each phase, and resumed."""

from __future__ import annotations

import json
import signal
from pathlib import Path

import pytest
from matrices import HYBRID
from scenario_campaign import ScenarioCampaign, Setting, begin

from rig import dampers
from rig.characteristics.hybrid_tests import hybrid_tests
from rig.recording.run import Run
from simulators.scenarios.stage import Stage

FOLLOWS = ("--actuator", "setpoints")
MIXED = HYBRID.replace('"model", "ats"', '"model"').replace('prior = "demo"', 'prior = "fit.json"') + """
[matrix]
waveform = ["sine", "sweep"]
amplitude = ["15 mm"]
frequency = ["2 Hz"]
current = ["0.5 A"]
cycles = 4
[matrix.sweep]
first_frequency = "1 Hz"
last_frequency = "3 Hz"
first_amplitude = "15 mm"
duration = "4 s"
[identify]
enabled = false
"""
"""A sine (p001), a sweep (p002), a hybrid test."""
ORDER = ["p001", "p002", "hybrid-model"]
RUNS = {"in the sine": "p001.journal", "in the signal": "p002.journal", "between": "p002.h5"}
"""What is there among the points then."""


def begun(stage: Stage, folder: Path) -> ScenarioCampaign:
    """The campaign, with its fit."""
    values = dampers.parameter_set("demo").values
    entries = {name: {"value": value} for name, value in values.items()}
    fit = {"model": "asymmetric", "hysteresis": "kwok", "parameters": entries}
    (folder / "fit.json").write_text(json.dumps(fit), encoding="utf-8")
    return begin(stage, folder, Setting(FOLLOWS, MIXED, speed=1.0, real_time=True))


def come_to(campaign: ScenarioCampaign, phase: str) -> None:
    if phase == "connecting":
        campaign.until((campaign.folder / "campaign.json").exists, "the description")
    elif phase == "on the road":
        campaign.on_the_road()
        campaign.run_on(0.5)
    else:
        campaign.until((campaign.folder / "points" / RUNS[phase]).exists, phase)
        campaign.run_on(1.5 if phase.startswith("in ") else 0.0)


@pytest.mark.apart
@pytest.mark.nightly
@pytest.mark.parametrize("phase", ["on the road", "connecting", "in the sine", "in the signal", "between"])
def test_a_killed_mixed_campaign_goes_on_without_its_fit_s_original(tmp_path: Path, phase: str) -> None:
    with Stage(1, tmp_path) as stage:
        campaign = begun(stage, tmp_path)
        come_to(campaign, phase)
        done = {path.name: path.read_bytes() for path in (campaign.folder / "points").glob("*.h5")}
        campaign.send(signal.SIGKILL)
        assert campaign.finish(campaign.now_ns).exit_code == -signal.SIGKILL
        (tmp_path / "fit.json").unlink()
        code, answer = campaign.resumed(campaign.setting)
        assert code in {0, 5}, answer
        assert [point["id"] for point in answer["points"]] == ORDER
        # Short motions under streamed set-points tie the clocks loosely: `suspect` (`skew`) in some phases.
        assert {reason.partition(":")[0] for point in answer["points"] for reason in point["reasons"]} <= {"skew"}
        points = campaign.campaign_folder / "points"
        assert {name: (points / name).read_bytes() for name in done} == done
        (test,) = hybrid_tests(Run.open(campaign.campaign_folder))
        assert test.to_json()["tracking_nrms"] < 0.05

"""A hybrid test in a world: to its end, and with the load cell pulled in the middle of it."""

from __future__ import annotations

from pathlib import Path

import pytest
from end_states import assert_no_current, assert_still
from matrices import HYBRID
from scenario_campaign import Setting, begin
from watched_campaign import Ending

from rig.characteristics.hybrid_tests import answer, hybrid_tests, write_hybrid
from rig.display import SI
from rig.document.html import fragment
from rig.recording.run import Run
from rig.report.hybrid import hybrid_section
from simulators.scenarios.stage import Stage

EXAMPLE = (Path(__file__).resolve().parents[2] / "examples" / "hybrid-quarter.toml").read_text(encoding="utf-8")
SHORT = EXAMPLE.replace('duration = "20 s"', 'duration = "4 s"').replace(
    "[hybrid]\n", '[hybrid]\nprobe_frequency = "6 Hz"\n'
)
FOLLOWS = ("--actuator", "setpoints")


def ended(folder: Path, matrix: str, *simulator: str) -> Ending:
    with Stage(1, folder) as stage:
        setting = Setting((*FOLLOWS, *simulator), matrix, speed=1.0, real_time=True)
        ending = begin(stage, folder, setting).finish()
        assert not stage.rig.plant.command["pressure"][0]
        return ending


@pytest.mark.apart
def test_the_rod_follows_and_the_body_answers_as_the_whole_car_does(tmp_path: Path) -> None:
    ending = ended(tmp_path, SHORT)
    assert ending.exit_code == 0, ending.output
    assert ending.verdicts() == {"hybrid-model": "valid", "hybrid-none": "valid"}
    run = Run.open(ending.folder)
    tests = hybrid_tests(run)
    led, plain = (test.to_json() for test in tests)
    assert led["tracking_nrms"] <= 0.05
    assert led["tracking_nrms"] <= 0.25 * plain["tracking_nrms"]
    assert led["reference_error"] <= 0.05
    assert 5.0 < led["delay_ms"] < 15.0
    assert led["late_steps"] == 0
    assert led["steps"] == pytest.approx(400, abs=2)
    assert led["criteria"]["J2"] == pytest.approx(100.0 * led["tracking_nrms"])
    assert answer(tests)["tracking_nrms"] == led["tracking_nrms"]
    write_hybrid(run, tests)
    rows = (ending.folder / "reference" / "hybrid-model.csv").read_text(encoding="utf-8").splitlines()
    assert rows[0].startswith("time_s,target_m,seen_m,body_m,wheel_m,reference_extension_m")
    assert len(rows) > 390
    assert "hybrid-none" in fragment(hybrid_section(tests, SI))


@pytest.mark.apart
def test_a_controller_that_takes_no_speed_is_no_later_than_the_others(tmp_path: Path) -> None:
    """It arrives at a set-point a period after it was told: 21 to 23 ms behind, had it been told that of the moment."""
    with Stage(1, tmp_path) as stage:
        matrix = HYBRID.replace('"model", "ats"', '"model"')
        setting = Setting(("--register-map", "delta-rmc"), matrix, speed=1.0, real_time=True)
        ending = begin(stage, tmp_path, setting).finish()
    assert ending.exit_code == 0, ending.output
    (test,) = hybrid_tests(Run.open(ending.folder))
    assert test.verdict == "valid"
    assert 5.0 < test.to_json()["delay_ms"] < 15.0


@pytest.mark.apart
def test_a_wire_pulled_in_the_middle_ends_as_its_row_says(tmp_path: Path) -> None:
    ending = ended(tmp_path, SHORT.replace('"model", "none"', '"model"'), "--fault", "loadcell-pulled@2.5")
    assert ending.exit_code == 4, ending.output
    assert ending.trips()[0] == ("loadcell-pulled", "S2")
    assert ending.answer["rig_state"] == "safe"
    assert ending.verdicts() == {"hybrid-model": "invalid"}
    fault = ending.truth.first("FAULT")
    assert_still(ending.truth, fault.time_s + 0.5)
    assert_no_current(ending.truth, fault.time_s)
    test = hybrid_tests(Run.open(ending.folder))[0]
    assert test.verdict == "invalid"
    assert 50 < test.reported["steps"] < 300, "in the middle of the road"


@pytest.mark.nightly
@pytest.mark.apart
def test_a_law_commands_the_coil_until_a_pulled_wire_takes_the_current_away(tmp_path: Path) -> None:
    text = SHORT.replace('"model", "none"', '"model"').replace(
        "[hybrid]\n", '[hybrid]\nlaw = ["skyhook"]\nmost_current = "0.8 A"\n'
    )
    ending = ended(tmp_path, text, "--fault", "loadcell-pulled@5.2")
    assert ending.exit_code == 4, ending.output
    assert ending.trips()[0] == ("loadcell-pulled", "S2")
    fault = ending.truth.first("FAULT")
    assert_no_current(ending.truth, fault.time_s + 0.2)
    point = ending.point("hybrid-model-skyhook")
    commands, measured = point.raw("commanded_current"), point.raw("coil_current")
    assert commands is not None
    assert measured is not None
    assert set(commands["value"].tolist()) == {0.0, 0.8}
    assert sum(abs(commands["value"][1:] - commands["value"][:-1]) > 0.1) > 10
    assert measured["value"].max() == pytest.approx(0.8, abs=0.02)
    assert (point.test["law"], point.test["current_A"]) == ("skyhook", 0.8)
    assert hybrid_tests(Run.open(ending.folder))[0].to_json()["law"] == "skyhook"

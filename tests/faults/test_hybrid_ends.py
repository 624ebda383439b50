"""How a hybrid test ends that does not go to its end: by the operator, a death, its own watch; and how it goes on.

What ends it by following late is the row `hybrid-unstable` of the fault matrix.
"""

from __future__ import annotations

import re
import signal
from pathlib import Path

import pytest
from end_states import assert_no_current, assert_still
from matrices import HYBRID
from scenario_campaign import ScenarioCampaign, Setting, begin

from rig.characteristics.hybrid_tests import hybrid_tests
from rig.recording.run import Run
from simulators.scenarios.request import Files, request_for
from simulators.scenarios.runs import live
from simulators.scenarios.stage import Stage

ALONE = HYBRID.replace('"model", "ats"', '"model"')
ROOT = Path(__file__).resolve().parents[2]
FOLLOWS = ("--actuator", "setpoints")


def begun(stage: Stage, folder: Path, matrix: str, *simulator: str) -> ScenarioCampaign:
    """A campaign whose first hybrid test is on its road."""
    campaign = begin(stage, folder, Setting((*FOLLOWS, *simulator), matrix, speed=1.0, real_time=True))
    campaign.on_the_road()
    return campaign


@pytest.mark.nightly
@pytest.mark.apart
def test_a_pause_waits_for_the_test_and_a_killed_one_is_repeated_by_resume(tmp_path: Path) -> None:
    """Ctrl-Z in the first test: it is finished. Again: the second begins; the application is killed on its road."""
    with Stage(1, tmp_path) as stage:
        campaign = begun(stage, tmp_path, HYBRID)
        campaign.send(signal.SIGTSTP)
        first = campaign.folder / "points" / "hybrid-model.h5"
        campaign.until(first.exists, "the first test's file")
        campaign.until(lambda: "paused" in campaign.folder.joinpath("journal.jsonl").read_text("utf-8"), "the pause")
        kept = first.read_bytes()
        campaign.send(signal.SIGTSTP)
        campaign.on_the_road(2)
        campaign.run_on(0.5)
        assert abs(stage.rig.plant.value("velocity_m_s")) > 0.01
        killed_ns = campaign.now_ns
        campaign.send(signal.SIGKILL)
        ending = campaign.finish(killed_ns)
        assert ending.exit_code == -signal.SIGKILL
        zero = ending.truth.all("SET_CURRENT", text="0.000")[-1]
        assert_no_current(ending.truth, zero.time_s)
        assert_still(ending.truth, zero.time_s + 0.5)
        assert not stage.rig.plant.command["pressure"][0]
        code, answer = campaign.resumed(campaign.setting)
        assert code == 0, answer
        assert {point["id"]: point["verdict"] for point in answer["points"]} == {
            "hybrid-model": "valid", "hybrid-ats": "valid",
        }  # fmt: skip
        assert first.read_bytes() == kept
        assert all(test.reported["late_steps"] == 0 for test in hybrid_tests(Run.open(ending.folder)))


@pytest.mark.apart
def test_ctrl_c_on_the_road_stops_the_rig_safely(tmp_path: Path) -> None:
    with Stage(1, tmp_path) as stage:
        campaign = begun(stage, tmp_path, ALONE)
        campaign.run_on(0.5)
        request_ns = campaign.now_ns
        campaign.send(signal.SIGINT)
        ending = campaign.finish(request_ns)
        assert (ending.exit_code, ending.answer["stopped_by"]) == (4, "sigint"), ending.output
        assert ending.answer["rig_state"] == "safe"
        zero = ending.truth.all("SET_CURRENT", text="0.000")[-1]
        assert (zero.host_ns - request_ns) / 1e9 < 0.2
        assert_no_current(ending.truth, zero.time_s)
        assert_still(ending.truth, zero.time_s + 0.5)
        assert not stage.rig.plant.command["pressure"][0]
        assert ending.verdicts() == {"hybrid-model": "invalid"}
        assert "Stopped by operator (Ctrl-C): motion halted, coil at 0 A, hydraulics off." in ending.output


@pytest.mark.apart
@pytest.mark.nightly
def test_an_actuator_later_than_allowed_ends_the_test_before_its_road(tmp_path: Path) -> None:
    with Stage(1, tmp_path) as stage:
        late = ALONE.replace('largest_delay = "20 ms"', 'largest_delay = "6 ms"')
        campaign = begin(stage, tmp_path, Setting(FOLLOWS, late, speed=1.0, real_time=True))
        ending = campaign.finish()
        assert ending.exit_code == 4, ending.output
        assert ending.trips() == [("hybrid-unstable", "S2")]
        (trip,) = (line for line in ending.log if line.get("what") == "trip")
        assert "ms; allowed: 0.2 to 6.0 ms" in trip["detail"]
        phases = [line["phase"] for line in ending.log if line.get("what") == "hybrid"]
        assert "test" not in phases
        assert ending.answer["rig_state"] == "safe"


@pytest.mark.apart
@pytest.mark.nightly
def test_three_late_set_points_in_a_row_end_a_hybrid_test(tmp_path: Path) -> None:
    with Stage(1, tmp_path) as stage:
        ending = begun(stage, tmp_path, ALONE, "--fault", "setpoints-late@2.5").finish()
        assert ending.exit_code == 4, ending.output
        assert ending.trips()[0] == ("setpoints-late", "S2")
        assert ending.answer["rig_state"] == "safe"
        assert ending.answer["setpoints"]["late"] >= 3
        fault = ending.truth.first("FAULT")
        assert_still(ending.truth, fault.time_s + 1.0)
        assert_no_current(ending.truth, fault.time_s + 0.5)


@pytest.mark.nightly
@pytest.mark.apart
def test_a_seed_is_one_scenario_bit_by_bit_with_a_hybrid_test_and_a_pulled_wire_in_it(tmp_path: Path) -> None:
    text = (ROOT / "examples" / "demo-bench.toml").read_text(encoding="utf-8")
    text = re.sub(r"(?m)^(register_map|poll) = .*\n", "", text)
    files = Files(tmp_path / "matrix.toml", tmp_path / "bench.toml")
    files.bench.write_text(text.replace("[actuator]\n", '[actuator]\nregister_map = "demo-streamed"\npoll = "10 ms"\n'))
    files.matrix.write_text(ALONE.replace("[hybrid]\n", '[hybrid]\nlaw = ["hybrid"]\n'))
    plan = request_for(files, ["loadcell-pulled@1.2"], None).plan(5)
    ended = []
    for name in ("one", "another"):
        (tmp_path / name).mkdir()
        ended.append(live(plan, tmp_path / name, most_sessions=1)[1])
    assert [scenario.failed for scenario in ended] == [(), ()]
    assert ended[0].sessions == (4,)
    assert ended[0].digest == ended[1].digest

"""A cold damper is warmed before it is measured, also when a campaign goes on; what the machine cannot do it says.

One campaign is stopped during its first point and resumed on a simulated rig that is cold again.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from simulated_campaign import options
from true_states import Truth

from rig.recording.journal.campaign_log import read_log

pytestmark = pytest.mark.wire

LOW_DEGC, HIGH_DEGC = 26.0, 40.0
ROOM_DEGC = 23.0
MATRIX = f"""
format = 1
[specimen]
serial_number = "MR-001"
stroke = "170 mm"
prior = "demo"
[matrix]
amplitude = ["20 mm"]
frequency = ["2 Hz"]
current = ["1 A", "1.5 A"]
cycles = 10
amplitude_tolerance = "1 %"
[[point]]
waveform = "sine"
amplitude = "10 mm"
frequency = "10 Hz"
current = "0.5 A"
cycles = 20
[temperature]
window = ["{LOW_DEGC} degC", "{HIGH_DEGC} degC"]
heat_capacity = "0.15 kJ/K"
[identify]
enabled = false
"""
OPTIONS = ("servo.bandwidth_Hz=7.1", "servo.damping=1.0", "damper.heat_capacity_J_K=150.0")


@dataclass(frozen=True)
class Ending:
    exit_code: int
    answer: dict[str, Any]
    story: list[dict[str, Any]]
    """What the campaign's journal says of this session."""

    def phases(self) -> list[str]:
        return [line["phase"] for line in self.story if line["event"] == "phase"]


@dataclass(frozen=True)
class TwoSessions:
    stopped: Ending
    resumed: Ending
    truth: Truth

    def point(self, point_id: str) -> dict[str, Any]:
        return next(point for point in self.resumed.answer["points"] if point["id"] == point_id)


def rig_run(*arguments: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "rig.cli.main", "run", "--json", *arguments],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> TwoSessions:
    folder = tmp_path_factory.mktemp("conditions")
    matrix = folder / "matrix.toml"
    matrix.write_text(MATRIX, encoding="utf-8")
    command = [str(matrix), "--simulate", "--speed", "20", "--seed", "5", "--out", str(folder)]
    first = rig_run(*command, "--", "--no-real-time", *options(*OPTIONS))
    with first:
        assert first.stderr is not None
        for line in first.stderr:
            if line.strip() == "running":
                first.send_signal(signal.SIGINT)
                break
        output, errors = first.communicate(timeout=60)
    stopped = json.loads(output)
    campaign = Path(stopped["campaign"])
    told = len(read_log(campaign))
    with rig_run("--resume", str(campaign)) as second:
        output, errors = second.communicate(timeout=100)
    assert output, errors[-3000:]
    story = read_log(campaign)
    return TwoSessions(
        Ending(first.returncode, stopped, story[:told]), Ending(second.returncode, json.loads(output), story[told:]),
        Truth.load(campaign / "truth.h5"),
    )  # fmt: skip


def test_a_cold_damper_is_warmed_before_the_first_point(sessions: TwoSessions) -> None:
    assert sessions.stopped.exit_code == 4
    phases = sessions.stopped.phases()
    assert phases.index("warming up") < phases.index("running")
    assert sessions.stopped.answer["start_temperature_degC"] == pytest.approx(ROOM_DEGC, abs=0.3)
    first = sessions.stopped.answer["waits"][0]
    assert (first["point"], first["phase"], first["to_degC"]) == ("p001", "warming up", LOW_DEGC)
    assert first["from_degC"] == pytest.approx(ROOM_DEGC, abs=0.3)


def test_a_resumed_campaign_warms_its_damper_again_before_it_measures(sessions: TwoSessions) -> None:
    phases = sessions.resumed.phases()
    assert phases.index("warming up") < phases.index("running")
    assert sessions.truth.temperature_degC[0] < LOW_DEGC
    programs = [wait for wait in sessions.resumed.answer["waits"] if wait["point"] == "p001"]
    assert 1 <= len(programs) < 12, "what the servo does not reach is learned, not crept up to"
    assert sessions.point("p001")["verdict"] == sessions.point("p002")["verdict"] == "valid"
    for point_id in ("p001", "p002"):
        quality = sessions.point(point_id)["quality"]
        assert quality["coil_temperature_low_degC"] >= LOW_DEGC - 0.2
        assert quality["coil_temperature_high_degC"] <= HIGH_DEGC + 0.2


def test_what_the_machine_cannot_do_is_said_with_the_reason_and_is_not_valid(sessions: TwoSessions) -> None:
    assert sessions.resumed.exit_code == 5
    beyond = sessions.point("p003")
    assert beyond["verdict"] != "valid"
    assert any(reason.startswith("machine-cannot: ") for reason in beyond["reasons"]), beyond["reasons"]

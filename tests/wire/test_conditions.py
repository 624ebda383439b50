"""A cold damper is warmed before it is measured, also when a campaign goes on; what the machine cannot do it says.

One campaign is stopped during its first point and resumed on a simulated rig that is cold again.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from matrices import matrix_text
from simulated_campaign import Ended, options, session, simulated

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
[temperature]
window = ["{LOW_DEGC} degC", "{HIGH_DEGC} degC"]
heat_capacity = "0.15 kJ/K"
[identify]
enabled = false
"""
BEYOND = matrix_text("0.5 A", amplitude="10 mm", frequency="10 Hz", cycles=20, more='amplitude_tolerance = "1 %"')
OPTIONS = ("servo.bandwidth_Hz=7.1", "servo.damping=1.0", "damper.heat_capacity_J_K=150.0")


@dataclass(frozen=True)
class TwoSessions:
    stopped: Ended
    resumed: Ended

    def point(self, point_id: str) -> dict[str, Any]:
        return next(point for point in self.resumed.answer["points"] if point["id"] == point_id)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> TwoSessions:
    with session(tmp_path_factory.mktemp("conditions"), MATRIX, *options(*OPTIONS)) as first:
        first.until(lambda line: line.get("phase") == "running")
        first.interrupt()
        stopped = first.end()
        return TwoSessions(stopped, first.resumed(stopped.folder).end())


@pytest.mark.nightly
def test_a_cold_damper_is_warmed_before_the_first_point(sessions: TwoSessions) -> None:
    assert (sessions.stopped.exit_code, sessions.resumed.exit_code) == (4, 0)
    phases = sessions.stopped.phases()
    assert phases.index("warming up") < phases.index("running")
    assert sessions.stopped.answer["start_temperature_degC"] == pytest.approx(ROOM_DEGC, abs=0.3)
    first = sessions.stopped.answer["waits"][0]
    assert (first["point"], first["phase"], first["to_degC"]) == ("p001", "warming up", LOW_DEGC)
    assert first["from_degC"] == pytest.approx(ROOM_DEGC, abs=0.3)


@pytest.mark.nightly
def test_a_resumed_campaign_warms_its_damper_again_before_it_measures(sessions: TwoSessions) -> None:
    phases = sessions.resumed.phases()
    assert phases.index("warming up") < phases.index("running")
    assert sessions.resumed.truth.temperature_degC[0] < LOW_DEGC
    programs = [wait for wait in sessions.resumed.answer["waits"] if wait["point"] == "p001"]
    assert 1 <= len(programs) < 12, "what the servo does not reach is learned, not crept up to"
    assert sessions.point("p001")["verdict"] == sessions.point("p002")["verdict"] == "valid"
    for point_id in ("p001", "p002"):
        quality = sessions.point(point_id)["quality"]
        assert quality["coil_temperature_low_degC"] >= LOW_DEGC - 0.2
        assert quality["coil_temperature_high_degC"] <= HIGH_DEGC + 0.2


def test_what_the_machine_cannot_do_is_reported_with_the_reason_and_is_not_valid(tmp_path: Path) -> None:
    ended = simulated(tmp_path, BEYOND, *options(*OPTIONS))
    assert ended.exit_code == 5
    (beyond,) = ended.answer["points"]
    assert beyond["verdict"] != "valid"
    assert any(reason.startswith("machine-cannot: ") for reason in beyond["reasons"]), beyond["reasons"]

"""Register maps that come with the program, each on a controller of its own document before the simulated plant."""

from __future__ import annotations

from pathlib import Path

import pytest
from end_states import assert_no_current
from other_controllers import Cia402Drive, DeltaRmc, DeltaRmcHighFirst, FloatDrive, OtherController
from preset_campaign import begun
from scenario_campaign import SEED
from watched_campaign import Ending

from simulators.scenarios.stage import Stage


def ended(folder: Path, name: str, controller: type[OtherController], *simulator: str) -> Ending:
    with Stage(SEED, folder) as stage:
        ending = begun(stage, folder, name, controller, *simulator).finish()
        assert not stage.rig.plant.command["pressure"][0]
        return ending


@pytest.mark.few(1)
@pytest.mark.apart
@pytest.mark.parametrize(
    ("name", "controller"), [("delta-rmc", DeltaRmc), ("float-drive", FloatDrive), ("cia402-drive", Cia402Drive)]
)
def test_a_matrix_runs_to_its_end(name: str, controller: type[OtherController], tmp_path: Path) -> None:
    ending = ended(tmp_path, name, controller)
    assert ending.exit_code == 0, ending.output
    assert ending.verdicts() == {"p001": "valid", "p002": "valid"}
    assert ending.answer["setpoints"]["skipped"] == 0
    for point in ("p001", "p002"):
        assert ending.point(point).quality.motion.amplitude_m == pytest.approx(0.02, rel=0.02)


@pytest.mark.few(1)
@pytest.mark.apart
@pytest.mark.parametrize(("name", "controller"), [("delta-rmc", DeltaRmc), ("float-drive", FloatDrive)])
def test_set_points_that_are_lost_halt_it(name: str, controller: type[OtherController], tmp_path: Path) -> None:
    ending = ended(tmp_path, name, controller, "--fault", "setpoints-lost@0.4")
    assert (ending.exit_code, ending.answer["rig_state"]) == (4, "safe"), ending.output
    assert ending.trips() == [("setpoints-lost", "SO")]
    halt = ending.truth.first("HALT", after=ending.truth.first("FAULT"))
    assert_no_current(ending.truth, halt.time_s)


@pytest.mark.apart
def test_the_wrong_word_order_is_refused_at_connect(tmp_path: Path) -> None:
    ending = ended(tmp_path, "delta-rmc", DeltaRmcHighFirst)
    assert (ending.exit_code, ending.answer["stopped_by"]) == (3, "register-layout"), ending.output

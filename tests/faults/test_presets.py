"""Register maps that come with the program, each on a controller of its own document before the simulated plant."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from end_states import assert_no_current
from matrices import matrix_text
from other_controllers import DeltaRmc, DeltaRmcHighFirst, FloatDrive, OtherController
from watched_campaign import Ending
from world_campaign import SEED, Handle, Setting, WorldCampaign, simulated_rig

from rig.campaign import CampaignOptions
from simulators.modbus_server import ModbusServer
from simulators.world.stage import Application, Stage
from simulators.world.world import Silent

MATRIX = matrix_text("0.5 A", "1.5 A", frequency="1 Hz", cycles=3, more='[campaign]\ncurrent_settled = "20 mA"')
"""Without a force input or edges the two sensors are tied together to 2 ms: enough at 1 Hz."""
WATCHED = ("--actuator", "setpoints", "--option", "controller.watchdog_ms=500")


def begun(stage: Stage, folder: Path, name: str, controller: type[OtherController], *simulator: str) -> WorldCampaign:
    """A campaign on the simulated rig whose controller is another one."""
    truth, setting = folder / "truth.h5", Setting((*WATCHED, *simulator), speed=1.0, real_time=True)
    simulated: Any = simulated_rig("--speed", "1", *setting.simulator, truth=truth)
    simulated.bank = controller(simulated)
    simulated.modbus = ModbusServer(simulated.bank, 1)
    bench = stage.serve(simulated, real_time=True)
    text = bench.read_text(encoding="utf-8").replace('register_map = "demo-streamed"', f'register_map = "{name}"')
    bench.write_text(re.sub(r'serial_number = "SIM-ACT-1"\n', "", text), encoding="utf-8")
    (folder / "matrix.toml").write_text(MATRIX, encoding="utf-8")
    (folder / "out").mkdir()
    application = Application(
        stage, CampaignOptions(folder / "matrix.toml", folder / "out", bench_path=bench), Silent()
    )
    process: Any = Handle(stage, application.process)
    return WorldCampaign(process, folder / "out", truth, stage, application, setting)


def ended(folder: Path, name: str, controller: type[OtherController], *simulator: str) -> Ending:
    with Stage(SEED, folder) as stage:
        ending = begun(stage, folder, name, controller, *simulator).finish()
        assert not stage.rig.plant.command["pressure"][0]
        return ending


@pytest.mark.few(1)
@pytest.mark.apart
@pytest.mark.parametrize(("name", "controller"), [("delta-rmc", DeltaRmc), ("float-drive", FloatDrive)])
def test_a_matrix_runs_to_its_end(name: str, controller: type[OtherController], tmp_path: Path) -> None:
    ending = ended(tmp_path, name, controller)
    assert ending.exit_code == 0, ending.said
    assert ending.verdicts() == {"p001": "valid", "p002": "valid"}
    assert ending.answer["setpoints"]["skipped"] == 0
    for point in ("p001", "p002"):
        assert ending.point(point).quality.motion.amplitude_m == pytest.approx(0.02, rel=0.02)


@pytest.mark.few(1)
@pytest.mark.apart
@pytest.mark.parametrize(("name", "controller"), [("delta-rmc", DeltaRmc), ("float-drive", FloatDrive)])
def test_set_points_that_are_lost_halt_it(name: str, controller: type[OtherController], tmp_path: Path) -> None:
    ending = ended(tmp_path, name, controller, "--fault", "setpoints-lost@0.4")
    assert (ending.exit_code, ending.answer["rig_state"]) == (4, "safe"), ending.said
    assert ending.trips() == [("setpoints-lost", "SO")]
    halt = ending.truth.first("HALT", after=ending.truth.first("FAULT"))
    assert_no_current(ending.truth, halt.time_s)


@pytest.mark.apart
def test_the_wrong_word_order_is_refused_at_connect(tmp_path: Path) -> None:
    ending = ended(tmp_path, "delta-rmc", DeltaRmcHighFirst)
    assert (ending.exit_code, ending.answer["stopped_by"]) == (3, "register-layout"), ending.said

"""A campaign on the simulated rig whose controller is that of a preset's own document."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from matrices import matrix_text
from other_controllers import OtherController
from scenario_campaign import Handle, ScenarioCampaign, Setting, simulated_rig

from rig.campaign import CampaignOptions
from simulators.modbus_server import ModbusServer
from simulators.scenarios.scenario import Silent
from simulators.scenarios.stage import Application, Stage

MATRIX = matrix_text("0.5 A", "1.5 A", frequency="1 Hz", cycles=3, more='[campaign]\ncurrent_settled = "20 mA"')
"""Without a force input or edges the two sensors are tied together to 2 ms: enough at 1 Hz."""
WATCHED = ("--actuator", "setpoints", "--option", "controller.watchdog_ms=500")


def begun(
    stage: Stage, folder: Path, name: str, controller: type[OtherController], *simulator: str
) -> ScenarioCampaign:
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
    return ScenarioCampaign(process, folder / "out", truth, stage, application, setting)

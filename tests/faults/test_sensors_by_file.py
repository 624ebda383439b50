"""The rows of a sensor on a rig whose sensors are signals on CAN, or registers behind one Modbus connection."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from end_states import assert_refused, assert_stopped
from matrices import ONE_POINT
from row_scenarios import FAULT_S, PERIOD_S

if TYPE_CHECKING:
    from conftest import Run

EXAMPLES = Path(__file__).parents[2] / "examples"
CAN = (
    f'dbc = "{EXAMPLES}/can-sensors.dbc"\nsignal = "LoadCell.Force"\n'
    'status = {signal = "State", overload_values = ["overload"], fault_values = ["broken"]}\n'
    'protection = {profile = "counter+crc", counter = "Cnt", crc = "Crc", polynomial = 0x1D, initial = 0xFF}\n',
    f'dbc = "{EXAMPLES}/can-sensors.dbc"\nsignal = "TravelSensor.Travel"\n',
)
MODBUS = 'base = "labjack-t"\n', 'base = "labjack-t"\naddress = 2\n'
WATCHDOG_S = 2.0 + 0.5
"""Of labjack-output.toml, and the coil's lag."""
OUTPUT = ("--supply", str(EXAMPLES / "labjack-output.toml"), "--option", "limits.current_A=2")


def simulator(folder: Path, formats: tuple[str, str], more: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Options of a simulated rig whose load cell and LVDT send these formats."""
    arguments: list[str] = []
    for option, text in zip(("force", "displacement"), formats, strict=True):
        path = folder / f"{option}.toml"
        path.write_text(text, encoding="utf-8")
        arguments += [f"--{option}-format", str(path)]
    return (*arguments, *more)


@pytest.mark.nightly
@pytest.mark.parametrize("fault", [
    "loadcell-pulled", "lvdt-pulled", "sensor-stuck", "sensor-saturated", "serial-garbage", "sensor-spike",
])  # fmt: skip
def test_a_row_of_a_sensor_ends_the_same_on_can(run: Run, tmp_path: Path, fault: str) -> None:
    ending = run(f"{fault}@{FAULT_S}", simulator=simulator(tmp_path, CAN), matrix=ONE_POINT, speed=1.0)
    assert_stopped(ending, fault, finished=(), broken="p001", speed=1.0, period_s=PERIOD_S)


@pytest.mark.nightly
@pytest.mark.parametrize("fault", ["sensor-stuck", "sensor-saturated"])
def test_a_row_of_a_sensor_ends_the_same_behind_a_shared_connection(run: Run, tmp_path: Path, fault: str) -> None:
    ending = run(
        f"{fault}@{FAULT_S}", simulator=simulator(tmp_path, MODBUS, OUTPUT), matrix=ONE_POINT, speed=1.0,
    )
    assert_stopped(ending, fault, finished=(), broken="p001", speed=1.0, period_s=PERIOD_S)


@pytest.mark.nightly
def test_a_lost_device_with_sensors_and_output_stops_the_rig_and_its_watchdog_takes_the_current(
    run: Run, tmp_path: Path
) -> None:
    ending = run(
        f"loadcell-pulled@{FAULT_S}", simulator=simulator(tmp_path, MODBUS, OUTPUT), matrix=ONE_POINT, speed=1.0,
    )
    assert ending.exit_code in {4, 7}
    assert ending.answer["stopped_by"] == "can-lost"  # whichever device notices it first
    assert "shared by load_cell, lvdt and ecu" in ending.output
    truth = ending.truth
    lost_s = truth.first("FAULT", text="loadcell-pulled").time_s
    still = truth.since(lost_s + WATCHDOG_S)
    assert np.abs(truth.current_A[still]).max() < 0.05


@pytest.mark.nightly
def test_a_bus_without_the_sensor_s_message_is_refused(run: Run, tmp_path: Path) -> None:
    assert_refused(run("serial-baud", simulator=simulator(tmp_path, CAN), speed=20.0), "no-answer")

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from rig.errors import FileProblem
from simulators.options import RigOptions
from simulators.settings import SETTINGS, with_settings

NOTHING: dict[str, Any] = {setting.name.replace("-", "_"): None for setting in SETTINGS}


def rig_with(**given: str) -> RigOptions:
    return with_settings(RigOptions(), {**NOTHING, **given})


@pytest.mark.parametrize(
    ("name", "given", "table", "field", "value"),
    [
        ("servo_stiffness", "20 kN/mm", "servo", "stiffness_N_m", 20e6),
        ("servo_stiffness", "35000", "servo", "stiffness_N_m", 35e6),
        ("load_train_stiffness", "10 kN/mm", "servo", "load_train_stiffness_N_m", 10e6),
        ("actuator_force_delay", "2 ms", "force_input", "delay_s", 2e-3),
        ("actuator_force_delay", "2", "force_input", "delay_s", 2e-3),
        ("actuator_position_delay", "500 us", "position_input", "delay_s", 0.5e-3),
        ("actuator_position_noise", "0.02", "position_input", "noise", 20e-6),
        ("load_cell_gain", "1.05", "load_cell", "gain", 1.05),
        ("load_cell_zero", "-150 N", "load_cell", "offset", -150.0),
        ("load_cell_zero_drift", "2 N/s", "load_cell", "drift_per_s", 2.0),
        ("lvdt_zero", "1.5 mm", "lvdt", "offset", 1.5),
        ("lvdt_zero", "150 um", "lvdt", "offset", 0.15),
        ("ecu_current_offset", "100 mA", "coil", "current_offset_A", 0.1),
        ("ecu_current_offset", "-0.1 A", "coil", "current_offset_A", -0.1),
        ("crosstalk", "30 N/A", "load_cell", "crosstalk_per_A", 30.0),
        ("coil_sensor_offset", "-12 K", "coil", "temperature_offset_K", -12.0),
        ("coil_sensor_offset", "-12", "coil", "temperature_offset_K", -12.0),
        ("hum", "40 N", "load_cell", "hum", 40.0),
    ],
)
def test_a_setting_takes_its_unit_or_a_bare_number_in_the_unit_of_its_help(
    name: str, given: str, table: str, field: str, value: float
) -> None:
    assert getattr(getattr(rig_with(**{name: given}), table), field) == pytest.approx(value)


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("servo_stiffness", "20 kN", "a force; a stiffness is written as"), ("hum", "-1", "allowed"),
        ("actuator_force_delay", "2 N", "a time is written as"), ("actuator_force_delay", "1 min", "0 to 100 ms"),
        ("load_cell_gain", "5 %", "a plain number"), ("load_cell_gain", "0", "allowed 0.1 to 10"),
        ("load_cell_gain", "nan", "a plain number"), ("hum", "1e999", "allowed"), ("hum", "", "not a number"),
        ("coil_sensor_offset", "-12 degC", "a temperature difference"), ("lvdt_zero", "1,5 mm", "must be a point"),
        ("ecu_current_offset", "3 A", "-2000 to 2000 mA"),
    ],
)
def test_a_setting_that_cannot_be_used_names_its_option_and_what_would_fit(
    name: str, given: str, message: str
) -> None:
    with pytest.raises(FileProblem, match=message) as caught:
        rig_with(**{name: given})
    assert f"--{name.replace('_', '-')}" in str(caught.value)


def test_every_setting_has_one_line_of_help_and_sets_a_constant_that_exists() -> None:
    for setting in SETTINGS:
        table, field = setting.key.split(".")
        assert isinstance(getattr(getattr(RigOptions(), table), field), float)
        assert len(setting.text) < 78
        assert setting.text.endswith(".")


def test_the_help_is_readable_at_80_columns() -> None:
    answer = subprocess.run(
        [sys.executable, "-m", "simulators", "--help"], capture_output=True, check=True, text=True,
        env={"COLUMNS": "80", "PATH": "", "LC_ALL": "C.UTF-8"},
    )
    assert max(map(len, answer.stdout.splitlines())) <= 80
    assert all(f"--{setting.name}" in answer.stdout for setting in SETTINGS)

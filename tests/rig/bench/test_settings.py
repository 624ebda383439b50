"""The station's configuration: written and read back unchanged; anything wrong is refused by name."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from datetime import date

import pytest

from rig.bench.sensor_settings import Auxiliary, Calibration, LoadCell, Lvdt
from rig.bench.settings import ActuatorConfig, EcuConfig, Limits, StationConfig
from rig.bench.settings_json import ConfigProblem, from_json

LINE = {"pattern": r"(?P<value>[-+0-9.]+) bar", "terminator": "\n", "overload_tokens": ("OL", "----")}

CONFIG = StationConfig(
    actuator=ActuatorConfig(url="modbus-tcp://127.0.0.1:1", serial_number="A-1"),
    ecu=EcuConfig(interface="slcan", channel="socket://127.0.0.1:2", serial_number=1001),
    load_cell=LoadCell(
        url="/dev/ttyX", rate_Hz=250.0, range_N=1e4, calibration=Calibration(serial_number="LC-1", due=date(2030, 1, 1))
    ),
    lvdt=Lvdt(
        url="/dev/ttyY", rate_Hz=250.0, range_m=0.1,
        calibration=Calibration(serial_number="LV-1", sensitivity=0.001, polarity="reversed", offset="1 mm"),
    ),
    limits=Limits(
        position_m=(-0.085, 0.085), speed_m_s=0.8, acceleration_m_s2=60.0, force_N=5000.0, current_A=3.0,
        coil_temperature_degC=120.0,
    ),
    ring_path="ring",
    auxiliary=(
        Auxiliary(
            name="pressure", unit="bar", range="250 bar", url="socket://x:1", rate_Hz=1000.0, format=LINE,
            calibration=Calibration(serial_number="P-1"),
        ),
    ),
)


def changed(path: str, value: object) -> str:
    data = json.loads(CONFIG.to_json())
    *parents, last = path.split(".")
    place = data
    for parent in parents:
        place = place[parent]
    place[last] = value
    return json.dumps(data)


def test_configuration_survives_its_file_unchanged() -> None:
    assert from_json(CONFIG.to_json()) == CONFIG


def test_defaults_may_be_left_out() -> None:
    data = json.loads(CONFIG.to_json())
    del data["margins"], data["ring_capacity"], data["actuator"]["poll_s"]
    assert from_json(json.dumps(data)) == CONFIG


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("limits.speed_m_s", -1.0),
        ("limits.force_N", 0.0),
        ("limits.position_m", [0.2, 0.1]),
        ("limits.position_m", [0.2]),
        ("limits.speed_m_s", 6.0),
        ("actuator.parity", "X"),
        ("actuator.device_id", 300),
        ("ecu.channel", "socket://nowhere"),
        ("limits.current_A", "3 A"),
        ("limits.current_A", True),
        ("limits.force_N", float("nan")),
        ("load_cell.rate_Hz", 0),
        ("ecu.serial_number", 1.5),
        ("actuator.timeout_s", None),
        ("device_rate", 0.0),
        ("ring_path", 5),
        ("auxiliary", {}),
        ("lvdt.speed", 3),
    ],
)
def test_wrong_entry_is_refused_by_its_name(path: str, value: object) -> None:
    with pytest.raises(ConfigProblem, match=path.split(".")[0]):
        from_json(changed(path, value))


def test_missing_entries_are_all_named() -> None:
    data = json.loads(CONFIG.to_json())
    del data["limits"]["force_N"], data["limits"]["current_A"]
    with pytest.raises(ConfigProblem, match=r"limits\.force_N: missing; limits\.current_A: missing"):
        from_json(json.dumps(data))


@pytest.mark.parametrize("text", ["", "{", "[]", "3", "null"])
def test_what_is_no_configuration_is_refused(text: str) -> None:
    with pytest.raises(ConfigProblem):
        from_json(text)


def test_more_than_seven_auxiliary_channels_are_refused() -> None:
    many = replace(CONFIG, auxiliary=CONFIG.auxiliary * 8)
    with pytest.raises(ConfigProblem, match="at most 7"):
        from_json(many.to_json())


def test_the_stations_process_loads_no_validator_and_no_numeric_package() -> None:
    code = (
        "import sys; from rig.bench.settings_json import from_json; import rig.station.process; "
        "from_json(sys.stdin.read()); "
        "sys.exit(str({'pydantic', 'pydantic_core', 'numpy', 'pandas', 'h5py'} & sys.modules.keys() or ''))"
    )
    ended = subprocess.run([sys.executable, "-c", code], input=CONFIG.to_json(), text=True, capture_output=True)
    assert ended.stderr.strip() == ""

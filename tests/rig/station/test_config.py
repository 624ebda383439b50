"""The station's configuration: written and read back unchanged; anything wrong is refused by name."""

from __future__ import annotations

import json
from dataclasses import replace

import pytest

from rig.station.config import ActuatorConfig, EcuConfig, Limits, SensorConfig, StationConfig, from_json
from rig.station.errors import ConfigProblem

CONFIG = StationConfig(
    actuator=ActuatorConfig("modbus-tcp://127.0.0.1:1", serial_number="A-1"),
    ecu=EcuConfig("slcan", "socket://127.0.0.1:2", serial_number=1001),
    load_cell=SensorConfig("load_cell", "/dev/ttyX", 250.0, 1e4, 0.02),
    lvdt=SensorConfig("lvdt", "/dev/ttyY", 250.0, 0.1, 0.02, sensitivity=0.001, spike_jump=0.01),
    limits=Limits(-0.085, 0.085, 0.8, 60.0, 5000.0, 3.0, 120.0),
    ring_path="ring",
    auxiliary=(SensorConfig("pressure", "socket://x:1", 1000, 250e5, 0.02, format={"terminator": "\n"}),),
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
        ("limits.position_min_m", 0.2),
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

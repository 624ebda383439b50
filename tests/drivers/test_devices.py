"""Devices as data: the shipped descriptions, and names that nobody knows."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import pytest

from drivers import roles
from drivers.capabilities import Capabilities, WatchdogKind
from drivers.catalogue import (
    SensorConnection,
    actuator_names,
    current_source_names,
    make_actuator,
    make_current_source,
    make_sensor,
    register_actuator,
    register_sensor,
    sensor_format_names,
)
from drivers.connection import ActuatorAddress, ActuatorConnection, CanAddress, LinkKind
from drivers.current_source import SourceFault, SourceState
from drivers.devices import source as sources
from drivers.devices.source import current_source
from drivers.errors import UnknownDevice
from drivers.plugins import PlugIn
from drivers.register_maps.map_file import FOLDER, controller
from drivers.ring import Channel
from drivers.sample_stream import SampleScale
from protocols.errors import LocalProtocolError

CONTROLLER = tomllib.loads((FOLDER / "demo_controller.toml").read_text(encoding="utf-8"))


def slugs(codes: type) -> dict[str, int]:
    return {str(member.name).lower().replace("_", "-"): int(member) for member in codes}  # type: ignore[attr-defined]


def test_the_demo_devices_have_the_rigs_own_codes() -> None:
    assert slugs(roles.State) == CONTROLLER["state"]
    assert slugs(roles.Command) == CONTROLLER["command_codes"]
    written = {name: recipe["write"]["command"] for name, recipe in CONTROLLER["commands"].items()}
    assert written | {"none": 0} == CONTROLLER["command_codes"]
    assert slugs(roles.Result) == CONTROLLER["results"]
    assert slugs(roles.Waveform) == CONTROLLER["waveforms"]
    assert slugs(roles.ProgramPhase) == CONTROLLER["phase"]
    assert slugs(roles.WatchdogAction) == CONTROLLER["watchdog_actions"]
    assert slugs(roles.FaultBit) == {name: 1 << bit for name, bit in CONTROLLER["faults"].items()}
    assert slugs(roles.Input) == {name: 1 << bit for name, bit in CONTROLLER["inputs"].items()}
    ecu = tomllib.loads((FOLDER / "demo_ecu.toml").read_text(encoding="utf-8"))
    described = current_source("demo")
    assert slugs(SourceState) == {str(word.name).lower(): code for code, word in described.states.items()}
    assert slugs(SourceFault) == {name: 1 << bit for name, bit in ecu["faults"].items() if name != "signal"}


def test_a_name_that_is_unknown_is_refused_with_those_that_are_known() -> None:
    with pytest.raises(UnknownDevice, match=r"unknown \w+ 'mine'; known: .*demo"):
        make_actuator("mine", ActuatorConnection("tcp://127.0.0.1:1"))
    with pytest.raises(UnknownDevice, match=r"unknown \w+ 'mine'; known: .*demo"):
        make_current_source("mine", None, CanAddress("virtual", "x"))
    with pytest.raises(LocalProtocolError, match="known: cia402-drive, delta-rmc, demo"):
        controller("mine")
    with pytest.raises(LocalProtocolError, match="known: demo"):
        sources.current_source("mine")
    assert current_source_names() == ("demo",)


def test_an_actuator_with_a_driver_of_its_own_comes_through_the_same_door(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.catalogue._REGISTERED", {})
    made = make_actuator("demo", ActuatorConnection("modbus-tcp://127.0.0.1:1"))
    register_actuator("mine", lambda connection: made)
    assert actuator_names() == ("cia402-drive", "delta-rmc", "demo", "demo-streamed", "float-drive", "mine")
    assert make_actuator("mine", ActuatorConnection("tcp://127.0.0.1:1")) is made
    assert make_current_source("demo", None, CanAddress("virtual", "x")).commanded_A == 0.0


def test_a_sensor_with_a_driver_of_its_own_comes_through_the_same_door(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.catalogue._SENSORS", {})
    requested = SensorConnection("/dev/null", 9600, "load_cell", Channel.FORCE, "polled", SampleScale())
    with pytest.raises(LocalProtocolError, match="unknown line format 'polled'"):
        make_sensor(requested)
    made = make_sensor(replace(requested, format="frame16"))
    register_sensor("polled", lambda connection: made)
    assert "polled" in sensor_format_names()
    assert make_sensor(requested) is made


def test_an_ascii_sensor_is_a_description_in_the_bench_file() -> None:
    described = {"name": "mine", "pattern": r"(?P<value>\d+)"}
    given = SensorConnection("/dev/null", 9600, "load_cell", Channel.FORCE, described, SampleScale())
    assert make_sensor(given).bad_frames == 0


def test_what_a_device_cannot_do_is_reported_and_one_that_nothing_stops_is_known() -> None:
    assert controller("demo").capabilities.lacking() == ()
    little = Capabilities(watchdog=WatchdogKind.NONE, hydraulics=True)
    assert {"watchdog", "lease", "generator"} <= {name for name, _ in little.lacking()}
    assert "echo" not in dict(little.lacking()), "there is no watchdog whose counter could come back"
    assert little.can_be_stopped
    assert Capabilities(watchdog=WatchdogKind.TIMEOUT, hydraulics=False).can_be_stopped
    assert not Capabilities(watchdog=WatchdogKind.NONE, hydraulics=False).can_be_stopped


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("modbus-tcp://h:502", (LinkKind.MODBUS_TCP, "h", 502, "")),
        ("modbus-rtu:/dev/ttyUSB0", (LinkKind.MODBUS_RTU, None, None, "/dev/ttyUSB0")),
        ("modbus-rtu:socket://h:1", (LinkKind.MODBUS_RTU, None, None, "socket://h:1")),
        ("tcp://h:1", (LinkKind.TCP, "h", 1, "")),
        ("http://h:1", (LinkKind.UNKNOWN, "h", 1, "")),
        ("modbus-tcp://h:99999", (LinkKind.MODBUS_TCP, None, None, "")),
        ("busybox", (LinkKind.UNKNOWN, None, None, "")),
    ],
)
def test_an_address_is_parsed_once(text: str, address: tuple[LinkKind, str | None, int | None, str]) -> None:
    parsed = ActuatorAddress.parse(text)
    assert (parsed.kind, parsed.host, parsed.port, parsed.line) == address


def test_a_plug_in_for_the_current_gets_the_tables_that_it_asks_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Makers that take interface, channel and bitrate alone are called as ever."""
    made = make_current_source("demo", None, CanAddress("virtual", "x"))
    seen: list[tuple[object, ...]] = []

    def plain(interface: str, channel: str, bitrate: int) -> object:
        seen.append((interface, channel, bitrate))
        return made

    def asking(interface: str, channel: str, bitrate: int, roles: object, options: object) -> object:
        seen.append((interface, channel, bitrate, roles, options))
        return made

    monkeypatch.setattr("drivers.plugins.plug_in_of", lambda group, name: PlugIn(group, name, "lab", "1", "lab:make"))
    monkeypatch.setattr("drivers.plugins.load", lambda plug_in: {"plain": plain, "asking": asking}[plug_in.name])
    bus = CanAddress("virtual", "x", 250_000, {"app_name": "rig"})
    for name in ("plain", "asking"):
        assert make_current_source(name, {"scale": 2.0}, bus) is made
    assert seen == [("virtual", "x", 250_000), ("virtual", "x", 250_000, {"scale": 2.0}, {"app_name": "rig"})]

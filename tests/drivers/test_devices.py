"""Devices as data: the shipped descriptions, codes of another vendor, and names that nobody knows."""

from __future__ import annotations

import copy
import math
import tomllib
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from modbus_device import ModbusDevice

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
from drivers.devices import controller as controllers
from drivers.devices import source as sources
from drivers.devices.controller import FOLDER, ControllerDescription, controller
from drivers.devices.source import current_source
from drivers.errors import UnknownDevice
from drivers.modbus_actuator import ModbusActuator
from drivers.ring import Channel
from drivers.roles import UNNAMED, Command, FaultBit, Input, Move, Result, State
from drivers.sample_stream import SampleScale
from protocols.errors import LocalProtocolError
from simulators import controller_firmware, ecu_firmware

CONTROLLER = tomllib.loads((FOLDER / "demo_controller.toml").read_text(encoding="utf-8"))


def slugs(codes: type) -> dict[str, int]:
    return {str(member.name).lower().replace("_", "-"): int(member) for member in codes}  # type: ignore[attr-defined]


def test_the_firmware_of_the_simulated_devices_and_their_descriptions_agree() -> None:
    codes, bits = CONTROLLER["codes"], CONTROLLER["bits"]
    assert slugs(controller_firmware.State) == codes["state"]
    assert slugs(controller_firmware.Command) == codes["command"] | {"zero-time": 11}
    assert slugs(controller_firmware.Result) == codes["result"]
    assert slugs(controller_firmware.Waveform) == codes["waveform"]
    assert slugs(controller_firmware.ProgramPhase) == codes["phase"]
    assert slugs(controller_firmware.WatchdogAction) == codes["watchdog_action"]
    assert slugs(controller_firmware.FaultBit) == {name: 1 << bit for name, bit in bits["fault"].items()}
    assert slugs(controller_firmware.Input) == {name: 1 << bit for name, bit in bits["input"].items()}
    described, firmware = controller("demo"), controller_firmware
    assert described.expected_identity == {
        "signature_u32": firmware.SIGNATURE_U32, "signature_f32": firmware.SIGNATURE_F32,
        "layout_version": firmware.LAYOUT_VERSION,
    }
    assert described.table_values == firmware.TABLE_VALUES
    ecu = tomllib.loads((FOLDER / "demo_ecu.toml").read_text(encoding="utf-8"))
    described = current_source("demo")
    assert slugs(ecu_firmware.EcuState) == {str(word.name).lower(): code for code, word in described.states.items()}
    bits = {name: 1 << bit for name, bit in ecu["faults"].items() if name != "signal"}
    assert slugs(ecu_firmware.EcuFault) == bits
    assert described.tick_us == ecu_firmware.DEVICE_TIME_TICK_US
    assert described.clock_modulus == ecu_firmware.DEVICE_TIME_MODULUS
    assert described.layout == ecu_firmware.LAYOUT


def another_vendor() -> ControllerDescription:
    """The demo controller's registers moved, swapped and renumbered, with fewer talents."""
    data: dict[str, Any] = copy.deepcopy(CONTROLLER)
    data["capabilities"] |= {
        "lease": False, "watchdog": "timeout", "hydraulics": False, "phase": False, "table": False,
    }
    data["codes"]["state"] = {"off": 10, "hold": 0, "running": 7, "tripped": 2}
    data["codes"]["watchdog_action"] = {"none": 7, "fade-and-hold": 0}
    data["codes"]["command"] = {"start": 100, "halt": 101, "fade-stop": 102, "move-to": 103, "reset": 104}
    data["bits"]["fault"] = {"watchdog": 3, "e-stop": 0}
    data["bits"]["input"] = {"e-stop-closed": 2}
    for block in data["block"]:
        block["word_order"] = "little"
        for register in block["registers"]:
            register["address"] += 1000
    return ControllerDescription("other", data)


def test_another_vendors_controller_is_another_file_and_speaks_the_same_words() -> None:
    other = another_vendor()
    assert other.map.block("status").address == 1100
    assert (other.capabilities.watchdog, other.capabilities.lease) == (WatchdogKind.TIMEOUT, False)
    words = other.map.block("status").encode({
        "state": 7, "fault_bits": 0b1001, "inputs": 4, "acked_command": 101, "result": 1, "position": 0.05,
    })
    status = other.decode_status(words, 5)
    assert (status.state, status.position_m) == (State.RUNNING, pytest.approx(0.05))
    assert status.fault_bits == FaultBit.WATCHDOG | FaultBit.E_STOP
    assert (status.inputs, status.acked_command, status.result) == (Input.E_STOP_CLOSED, Command.HALT, Result.DONE)
    words = other.encode_command(Command.MOVE_TO, 3, 0, Move(0.05, 0.1))
    assert words[:2] == [103, 3]
    assert words[4:6] == [0xCCCD, 0x3D4C], "low word first"


def test_what_a_controller_does_not_show_is_nothing_or_the_hosts_time() -> None:
    data: dict[str, Any] = copy.deepcopy(CONTROLLER)
    data["capabilities"] = {"watchdog": "timeout", "hydraulics": False, "acknowledge": True, "generator": True}
    del data["identity"]
    shown = {
        "state", "fault_bits", "position", "velocity", "cycles_done", "acked_sequence", "result", "acked_command",
        "serial_number",
    }
    blocks = [block for block in data["block"] if block["name"] in {"identity", "status", "command"}]
    for block in blocks[:2]:
        block["registers"] = [register for register in block["registers"] if register["name"] in shown]
    little = ControllerDescription("little", data | {"block": blocks})
    words = little.map.block("status").encode({"state": 2, "position": 0.01})
    status = little.decode_status(words, 12_345_678_900)
    assert (status.state, status.owner, status.watchdog_echo, status.pulse_count) == (State.HOLD, 0, 0, 0)
    assert (status.heartbeat, status.clock_us) == (1234, 12_345_678)
    assert not status.e_stop_open, "it has no such input, and says so in its capabilities"
    assert math.isnan(status.force_N)
    identity = little.decode_identity(little.map.block("identity").encode({"serial_number": "S-7"}))
    assert (identity.serial_number, identity.boot_count, identity.vendor) == ("S-7", 0, "")
    device = ModbusDevice()
    try:
        actuator = ModbusActuator(ActuatorConnection(device.url, timeout_s=1.0, owner_id=7), little)
        actuator.open()
        assert actuator.exchange(5).state == State.OFF
        assert device.requests[-1][0] == 3, "any request feeds it"
        actuator.close()
    finally:
        device.close()


def test_a_code_without_a_name_is_shown_and_never_taken_for_a_named_one() -> None:
    block = another_vendor().map.block("status")
    status = another_vendor().decode_status(block.encode({"state": 3, "fault_bits": 0b10, "inputs": 0b100001}), 5)
    assert status.state == UNNAMED + State.MOVING
    assert not status.fault_bits & sum(FaultBit)
    assert status.fault_bits
    assert status.inputs & sum(Input) == 0
    assert controller("demo").decode_status([0, 99, *[0] * 32], 5).state == 99


@given(st.integers(0, 65535))
def test_what_a_controller_holds_is_written_back_as_it_was(action: int) -> None:
    for described in (controller("demo"), another_vendor()):
        words = described.map.block("config").encode({"watchdog_action": action})
        assert described.encode_limits(described.decode_limits(words)) == words


def test_a_command_that_the_controller_does_not_know_is_our_own_error() -> None:
    with pytest.raises(LocalProtocolError, match="hydraulics-on is nothing this controller knows"):
        another_vendor().encode_command(Command.HYDRAULICS_ON, 1, 0)


@pytest.mark.parametrize(
    ("where", "entry"), [("codes", {"state": {"asleep": 1}}), ("bits", {"fault": {"boredom": 1}})]
)
def test_a_description_with_a_word_nobody_knows_is_refused(where: str, entry: dict[str, Any]) -> None:
    data = copy.deepcopy(CONTROLLER)
    data[where] |= entry
    with pytest.raises(LocalProtocolError, match="is not one of"):
        ControllerDescription("other", data)


def test_a_name_that_nobody_knows_is_refused_with_those_that_are_known() -> None:
    with pytest.raises(UnknownDevice, match=r"'mine' is not known; known: demo"):
        make_actuator("mine", ActuatorConnection("tcp://127.0.0.1:1"))
    with pytest.raises(UnknownDevice, match=r"'mine' is not known; known: demo"):
        make_current_source("mine", None, CanAddress("virtual", "x"))
    with pytest.raises(LocalProtocolError, match="known: demo"):
        controllers.controller("mine")
    with pytest.raises(LocalProtocolError, match="known: demo"):
        sources.current_source("mine")
    assert current_source_names() == ("demo",)


def test_an_actuator_with_a_driver_of_its_own_comes_through_the_same_door(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.catalogue._REGISTERED", {})
    made = make_actuator("demo", ActuatorConnection("modbus-tcp://127.0.0.1:1"))
    register_actuator("mine", lambda connection: made)
    assert actuator_names() == ("demo", "demo-streamed", "mine")
    assert make_actuator("mine", ActuatorConnection("tcp://127.0.0.1:1")) is made
    assert make_current_source("demo", None, CanAddress("virtual", "x")).commanded_A == 0.0


def test_a_sensor_with_a_driver_of_its_own_comes_through_the_same_door(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.catalogue._SENSORS", {})
    asked = SensorConnection("/dev/null", 9600, "load_cell", Channel.FORCE, "polled", SampleScale())
    with pytest.raises(LocalProtocolError, match="no line format 'polled'"):
        make_sensor(asked)
    made = make_sensor(replace(asked, format="frame16"))
    register_sensor("polled", lambda connection: made)
    assert "polled" in sensor_format_names()
    assert make_sensor(asked) is made


def test_an_ascii_sensor_is_a_description_in_the_bench_file() -> None:
    described = {"name": "mine", "pattern": r"(?P<value>\d+)"}
    given = SensorConnection("/dev/null", 9600, "load_cell", Channel.FORCE, described, SampleScale())
    assert make_sensor(given).bad_frames == 0


def test_what_a_device_cannot_do_is_said_and_one_that_nothing_stops_is_known() -> None:
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

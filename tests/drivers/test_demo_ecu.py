"""The demo ECU on the wire: golden bytes, the same to driver, simulated ECU and the independent reference; damage."""

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import demo_ecu
import pytest
from demo_ecu import CoilCommand, CoilStatus, CoilTemperature, EcuIdentity
from hypothesis import given
from hypothesis import strategies as st

from drivers.current_source import SourceCounters
from drivers.devices.source import current_source
from drivers.frame_checks import FrameChecks
from protocols.errors import RemoteProtocolError
from simulators.ecu_wire import Command, Shown
from simulators.emulated_ecu import DEMO_ECU

GOLDEN = tomllib.loads((Path(__file__).parents[1] / "golden" / "ecu.toml").read_text())
KINDS = {"command": CoilCommand, "status": CoilStatus, "temperature": CoilTemperature, "identity": EcuIdentity}
CASES = [(kind, dict(case)) for kind in KINDS for case in GOLDEN[kind]]
DRIVER = current_source("demo")
(COMMAND,) = DRIVER.sent
STATUS = DRIVER.heard[DRIVER.status]


def contents_of(kind: str, case: dict[str, Any]) -> Any:  # noqa: ANN401 - one of `KINDS`
    return KINDS[kind](**{key: value for key, value in case.items() if key not in {"name", "bytes"}})


@pytest.mark.parametrize(("kind", "case"), CASES, ids=lambda item: item["name"] if isinstance(item, dict) else item)
def test_golden_frames_are_those_of_the_reference(kind: str, case: dict[str, Any]) -> None:
    wire, contents = bytes.fromhex(case["bytes"]), contents_of(kind, case)
    assert demo_ecu.encode(contents) == wire
    assert demo_ecu.decode(KINDS[kind], wire) == contents


@pytest.mark.parametrize("case", GOLDEN["command"], ids=lambda case: case["name"])
def test_the_driver_sends_the_golden_command_and_the_simulated_ecu_understands_it(case: dict[str, Any]) -> None:
    wire, contents = bytes.fromhex(case["bytes"]), contents_of("command", case)
    on, clear, ecu = int(contents.enable), int(contents.clear_faults), DEMO_ECU.load()
    data = COMMAND.writer.write({"command": contents.setpoint_A, "enable": on, "clear_faults": clear})
    COMMAND.protection.seal(data, contents.counter)
    assert bytes(data) == wire
    assert ecu.command(demo_ecu.COMMAND_ID, wire) == Command(*contents)
    assert ecu.commands(Command(*contents)) == [(demo_ecu.COMMAND_ID, wire)]


@pytest.mark.parametrize(("kind", "case"), CASES, ids=lambda item: item["name"] if isinstance(item, dict) else item)
def test_the_simulated_ecu_sends_the_golden_frames_and_the_driver_reads_them(kind: str, case: dict[str, Any]) -> None:
    if kind == "command":
        return
    wire, contents, ecu = bytes.fromhex(case["bytes"]), contents_of(kind, case), DEMO_ECU.load()
    values = contents._asdict()
    shown = Shown(
        values.get("state", 0), values.get("current_A", 0.0), values.get("faults", 0),
        100 * values.get("device_time_ticks", 0), values.get("coil_degC", 0.0), values.get("ecu_degC", 0.0),
        values.get("supply_V", 0.0), values.get("boot_count", 0), values.get("serial_number", 0),
    )
    for _ in range(values.get("counter", 0)):
        ecu.frame("CoilStatus", shown)
    sent = ecu.frame(KINDS[kind].__name__, shown)[1]
    read = {identifier: message.reader.read(wire) for identifier, message in DRIVER.heard.items()}
    if kind == "status":
        # The duty cycle has no role, so the simulated ECU leaves it at 0; the checksum follows.
        assert sent == demo_ecu.encode(contents._replace(duty_percent=0.0))
        assert read[demo_ecu.STATUS_ID] == {
            "measured_current": contents.current_A, "state": contents.state, "faults": contents.faults,
            "clock": contents.device_time_ticks,
        }
        assert STATUS.protection.count(wire) == contents.counter
    elif kind == "temperature":
        assert sent == wire
        names = ("coil_temperature", "ecu_temperature", "supply_voltage", "boot_count")
        assert read[demo_ecu.TEMPERATURE_ID] == pytest.approx(dict(zip(names, contents, strict=True)))
    else:
        assert sent[:4] + sent[6:] == wire[:4] + wire[6:], "all but the firmware, which is the simulated one's own"
        assert read[demo_ecu.IDENTITY_ID] == contents._asdict()


@given(
    st.integers(0, 14), st.integers(0, 15), st.integers(-0x8000, 0x7FFF), st.integers(0, 255), st.integers(0, 255),
    st.integers(0, 65535),
)
def test_status_means_the_same_to_driver_and_reference(
    counter: int, state: int, milliamps: int, faults: int, half_percent: int, ticks: int
) -> None:
    wire = demo_ecu.encode(CoilStatus(counter, state, milliamps / 1000, faults, half_percent / 2, ticks))
    assert STATUS.protection.difference(wire) == 0
    assert STATUS.protection.count(wire) == counter
    assert STATUS.reader.read(wire) == {
        "measured_current": milliamps / 1000, "state": state, "faults": faults, "clock": ticks,
    }


@given(st.integers(0, 14), st.booleans(), st.booleans(), st.integers(-0x8000, 0x7FFF))
def test_command_means_the_same_to_driver_simulated_ecu_and_reference(
    counter: int, enable: bool, clear: bool, milliamps: int
) -> None:
    wire = demo_ecu.encode(CoilCommand(counter, enable, clear, milliamps / 1000))
    data = COMMAND.writer.write({"command": milliamps / 1000, "enable": int(enable), "clear_faults": int(clear)})
    COMMAND.protection.seal(data, counter)
    assert bytes(data) == wire
    assert ECU.command(demo_ecu.COMMAND_ID, wire) == Command(counter, enable, clear, milliamps / 1000)


ECU = DEMO_ECU.load()


def accepted_by_driver(data: bytes) -> bool:
    return FrameChecks(DRIVER, SourceCounters()).step(DRIVER.status, STATUS, data) is not None


def accepted_by_ecu(data: bytes) -> bool:
    try:
        return ECU.command(demo_ecu.COMMAND_ID, data) is not None
    except RemoteProtocolError:
        return False


SIDES = [
    (accepted_by_driver, demo_ecu.encode(CoilStatus(7, 2, 0.25, 0, 50.5, 1234))),
    (accepted_by_ecu, demo_ecu.encode(CoilCommand(7, enable=True, clear_faults=False, setpoint_A=1.0))),
]


@pytest.mark.parametrize(("accepted", "good"), SIDES, ids=["driver", "ecu"])
def test_every_flipped_bit_and_the_other_frame_are_refused(
    accepted: Callable[[bytes], bool], good: bytes
) -> None:
    assert accepted(good)
    for bit in range(64):
        wire = bytearray(good)
        wire[bit // 8] ^= 1 << bit % 8
        assert not accepted(bytes(wire)), f"bit {bit}"
    (other,) = (frame for _, frame in SIDES if frame != good)
    assert not accepted(other), "another data id"


@pytest.mark.parametrize(("accepted", "number"), [(accepted_by_driver, "21 01"), (accepted_by_ecu, "20 01")])
def test_counter_15_is_refused_even_with_a_right_crc(accepted: Callable[[bytes], bool], number: str) -> None:
    # CRC-8, polynomial 0x1D, over the data id, 0F 00 00 00 00 00 00.
    register = 0
    for byte in bytes.fromhex(number + " 0F 00 00 00 00 00 00"):
        register ^= byte
        for _ in range(8):
            register = (register << 1 ^ 0x1D) & 0xFF if register & 0x80 else register << 1
    assert not accepted(bytes([register, 0x0F, 0, 0, 0, 0, 0, 0]))


@given(st.binary(max_size=12))
def test_any_bytes_are_understood_or_refused_by_the_ecu(data: bytes) -> None:
    assert not accepted_by_ecu(data) or len(data) == 8


def test_the_dbc_states_the_periods() -> None:
    assert [message.cycle_time for message in demo_ecu.DBC.messages] == [10, 10, 100, 1000]

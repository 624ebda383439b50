"""The ECU's frames: golden bytes, the DBC as independent reference, protection, fuzz."""

import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cantools
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.devices.source import FOLDER
from protocols.errors import LocalProtocolError, RemoteProtocolError
from simulators import ecu_firmware as ecu
from simulators.ecu_firmware import CoilCommand, CoilStatus, CoilTemperature, EcuIdentity

GOLDEN = tomllib.loads((Path(__file__).parents[1] / "golden" / "ecu.toml").read_text())
KINDS = {
    "command": (CoilCommand, ecu.encode_command, ecu.decode_command),
    "status": (CoilStatus, ecu.encode_status, ecu.decode_status),
    "temperature": (CoilTemperature, ecu.encode_temperature, ecu.decode_temperature),
    "identity": (EcuIdentity, ecu.encode_identity, ecu.decode_identity),
}
CASES = [(kind, dict(case)) for kind in KINDS for case in GOLDEN[kind]]
DBC = cantools.database.load_file(FOLDER / "demo_ecu.dbc")


@pytest.mark.parametrize(("kind", "case"), CASES, ids=lambda item: item["name"] if isinstance(item, dict) else item)
def test_golden_frames_encode_and_decode(kind: str, case: dict[str, Any]) -> None:
    wire = bytes.fromhex(case.pop("bytes"))
    case.pop("name")
    value_type, encode, decode = KINDS[kind]
    assert encode(value_type(**case)) == wire
    assert decode(wire) == value_type(**case)


@given(
    st.integers(0, 14), st.integers(0, 15), st.integers(-0x8000, 0x7FFF), st.integers(0, 255), st.integers(0, 255),
    st.integers(0, 65535),
)
def test_status_means_the_same_to_the_dbc(
    counter: int, state: int, milliamps: int, faults: int, half_percent: int, ticks: int
) -> None:
    wire = ecu.encode_status(CoilStatus(counter, state, milliamps / 1000, faults, half_percent / 2, ticks))
    signals = DBC.decode_message(ecu.STATUS_ID, wire, decode_choices=False)
    assert signals.pop("CRC") == wire[0]
    assert signals == {
        "Counter": counter, "State": state, "Current": pytest.approx(milliamps / 1000), "Faults": faults,
        "DutyCycle": half_percent / 2, "DeviceTime": pytest.approx(ticks / 10000),
    }


@given(st.integers(0, 14), st.booleans(), st.booleans(), st.integers(-0x8000, 0x7FFF))
def test_command_means_the_same_to_the_dbc(counter: int, enable: bool, clear: bool, milliamps: int) -> None:
    wire = ecu.encode_command(CoilCommand(counter, enable, clear, milliamps / 1000))
    signals = DBC.decode_message(ecu.COMMAND_ID, wire)
    assert signals.pop("CRC") == wire[0]
    assert signals == {
        "Counter": counter, "Enable": enable, "ClearFaults": clear, "CurrentSetpoint": pytest.approx(milliamps / 1000),
    }


def test_temperature_and_identity_mean_the_same_to_the_dbc() -> None:
    signals = DBC.decode_message(0x122, bytes.fromhex("55 03 83 FF 67 09 03 00"))
    assert signals == {
        "CoilTemperature": pytest.approx(85.3), "EcuTemperature": pytest.approx(-12.5), "Supply": pytest.approx(24.07),
        "BootCount": 3,
    }
    signals = DBC.decode_message(0x123, bytes.fromhex("E9 03 00 00 02 01 01 00"))
    assert signals == {"SerialNumber": 1001, "Firmware": 0x0102, "Layout": 1}


def test_the_dbc_states_the_periods() -> None:
    assert [message.cycle_time for message in DBC.messages] == [10, 10, 100, 1000]


@pytest.mark.parametrize("bit", range(64))
def test_any_flipped_bit_of_a_protected_frame_is_seen(bit: int) -> None:
    wire = bytearray(ecu.encode_status(CoilStatus(7, 2, 0.25, 0, 50.5, 1234)))
    wire[bit // 8] ^= 1 << bit % 8
    with pytest.raises(RemoteProtocolError, match="0x121"):
        ecu.decode_status(bytes(wire))


def test_a_command_frame_does_not_pass_as_a_status_frame() -> None:
    with pytest.raises(RemoteProtocolError, match="wrong CRC"):
        ecu.decode_status(ecu.encode_command(CoilCommand(0, enable=True, clear_faults=False, setpoint_A=1.0)))


def test_counter_15_is_refused_even_with_a_right_crc() -> None:
    # CRC-8, polynomial 0x1D, over 21 01 0F 00 00 00 00 00 00.
    register = 0
    for byte in bytes.fromhex("21 01 0F 00 00 00 00 00 00"):
        register ^= byte
        for _ in range(8):
            register = (register << 1 ^ 0x1D) & 0xFF if register & 0x80 else register << 1
    with pytest.raises(RemoteProtocolError, match="counter 15"):
        ecu.decode_status(bytes([register, 0x0F, 0, 0, 0, 0, 0, 0]))


@pytest.mark.parametrize("decode", [decode for _, _, decode in KINDS.values()])
@pytest.mark.parametrize("length", [0, 7, 9])
def test_a_frame_of_another_length_is_refused(decode: Callable[..., object], length: int) -> None:
    with pytest.raises(RemoteProtocolError, match=f"expected 8 data bytes, got {length}"):
        decode(bytes(length))


@given(st.binary(max_size=12))
def test_any_bytes_decode_to_themselves_or_are_refused(data: bytes) -> None:
    for _, encode, decode in KINDS.values():
        try:
            value = decode(data)
        except RemoteProtocolError:
            continue
        assert decode(encode(value)) == value


@pytest.mark.parametrize(("previous", "present", "delta"), [(0, 1, 1), (14, 0, 1), (3, 3, 0), (13, 1, 3), (1, 0, 14)])
def test_counter_delta_counts_modulo_15(previous: int, present: int, delta: int) -> None:
    assert ecu.counter_delta(previous, present) == delta


@pytest.mark.parametrize("setpoint_A", [32.77, -32.77, math.nan, math.inf])
def test_a_setpoint_beyond_the_frame_is_our_own_error(setpoint_A: float) -> None:
    with pytest.raises(LocalProtocolError, match="CurrentSetpoint"):
        ecu.encode_command(CoilCommand(0, enable=True, clear_faults=False, setpoint_A=setpoint_A))


@pytest.mark.parametrize("counter", [-1, 15])
def test_a_counter_outside_the_profile_is_our_own_error(counter: int) -> None:
    with pytest.raises(LocalProtocolError, match=r"outside 0\.\.14"):
        ecu.encode_command(CoilCommand(counter, enable=False, clear_faults=False, setpoint_A=0.0))


def test_a_state_beyond_four_bits_is_our_own_error() -> None:
    with pytest.raises(LocalProtocolError, match="State 16"):
        ecu.encode_status(CoilStatus(0, 16, 0.0, 0, 0.0, 0))

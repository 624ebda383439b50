"""The current ECU's frames: CAN at 500 kbit/s, standard identifiers, 8 data bytes, little-endian signals.

    0x120 CoilCommand, 10 ms, host -> ECU     0x121 CoilStatus, 10 ms, ECU -> host
    byte 0   CRC                              byte 0   CRC
    byte 1   0..3 Counter  4 Enable           byte 1   0..3 Counter  4..7 State
             5 ClearFaults                    byte 2-3 Current          i16  0.001 A
    byte 2-3 CurrentSetpoint i16 0.001 A      byte 4   Faults           u8
    byte 4-7 0                                byte 5   DutyCycle        u8   0.5 %
                                              byte 6-7 DeviceTime       u16  0.0001 s, wraps
    0x122 CoilTemperature, 100 ms             0x123 EcuIdentity, 1 s
    byte 0-1 CoilTemperature i16 0.1 degC     byte 0-3 SerialNumber     u32
    byte 2-3 EcuTemperature  i16 0.1 degC     byte 4-5 Firmware         u16  BCD
    byte 4-5 Supply          u16 0.01 V       byte 6-7 Layout           u16  1
    byte 6   BootCount       u8

CoilCommand and CoilStatus are protected by AUTOSAR E2E profile 1 (data id = 0x0120, 0x0121, mode BOTH): CRC-8 in
byte 0, a counter 0..14 in the low nibble of byte 1. `ecu.dbc` says the same for other tools.
"""

from __future__ import annotations

import struct
from enum import IntEnum, IntFlag
from typing import NamedTuple

from e2e.p01 import e2e_p01_check, e2e_p01_protect

from protocols.errors import LocalProtocolError, RemoteProtocolError

COMMAND_ID = 0x120
STATUS_ID = 0x121
TEMPERATURE_ID = 0x122
IDENTITY_ID = 0x123
FRAME_LENGTH = 8
COUNTER_MODULUS = 15
"""The counter runs 0..14; 15 is invalid in profile 1."""
LAYOUT = 1
DEVICE_TIME_MODULUS = 1 << 16
DEVICE_TIME_TICK_US = 100

_COMMAND = struct.Struct("<BBhI")
_STATUS = struct.Struct("<BBhBBH")
_TEMPERATURE = struct.Struct("<hhHBx")
_IDENTITY = struct.Struct("<IHH")


class EcuState(IntEnum):
    """What the ECU's output stage is doing."""

    INIT = 0
    OFF = 1
    ENABLED = 2
    FAULT = 3


class EcuFault(IntFlag):
    """Bits of `Faults`; on any of them the ECU drives 0 A by itself."""

    OVER_TEMPERATURE = 1 << 0
    UNDERVOLTAGE = 1 << 1
    OPEN = 1 << 2
    SHORT = 1 << 3
    COMMAND_TIMEOUT = 1 << 4
    COMMAND_CHECK = 1 << 5
    RESTARTED = 1 << 6


class CoilCommand(NamedTuple):
    """Contents of 0x120: `setpoint_A` in A (0.001 A on the wire), `counter` 0..14."""

    counter: int
    enable: bool
    clear_faults: bool
    setpoint_A: float


class CoilStatus(NamedTuple):
    """Contents of 0x121: `current_A` in A, `duty_percent` in %, `device_time_ticks` in 0.1 ms modulo 65536."""

    counter: int
    state: int
    current_A: float
    faults: int
    duty_percent: float
    device_time_ticks: int


class CoilTemperature(NamedTuple):
    """Contents of 0x122: temperatures in degC, supply in V."""

    coil_degC: float
    ecu_degC: float
    supply_V: float
    boot_count: int


class EcuIdentity(NamedTuple):
    """Contents of 0x123; `firmware` is binary coded decimal (0x0102 is 1.02)."""

    serial_number: int
    firmware: int
    layout: int


def encode_command(command: CoilCommand) -> bytes:
    """CoilCommand frame with its counter and CRC.

    Raises:
        LocalProtocolError: the counter is not 0..14 or the set-point not within -32.768..32.767 A.
    """
    flags = (bool(command.enable) << 4) | (bool(command.clear_faults) << 5)
    return _protect(
        _COMMAND, COMMAND_ID, command.counter, flags,
        _steps(command.setpoint_A, 0.001, -0x8000, 0x7FFF, "CurrentSetpoint", "A"), 0,
    )


def encode_status(status: CoilStatus) -> bytes:
    """CoilStatus frame with its counter and CRC.

    Raises:
        LocalProtocolError: a value does not fit its signal.
    """
    if not 0 <= status.state <= 15:
        raise LocalProtocolError(f"State {status.state} is outside 0..15")
    return _protect(
        _STATUS, STATUS_ID, status.counter, status.state << 4,
        _steps(status.current_A, 0.001, -0x8000, 0x7FFF, "Current", "A"),
        _steps(status.faults, 1, 0, 0xFF, "Faults", ""),
        _steps(status.duty_percent, 0.5, 0, 0xFF, "DutyCycle", "%"),
        _steps(status.device_time_ticks, 1, 0, 0xFFFF, "DeviceTime", "x 0.1 ms"),
    )


def encode_temperature(temperature: CoilTemperature) -> bytes:
    """CoilTemperature frame.

    Raises:
        LocalProtocolError: a value does not fit its signal.
    """
    return _TEMPERATURE.pack(
        _steps(temperature.coil_degC, 0.1, -0x8000, 0x7FFF, "CoilTemperature", "degC"),
        _steps(temperature.ecu_degC, 0.1, -0x8000, 0x7FFF, "EcuTemperature", "degC"),
        _steps(temperature.supply_V, 0.01, 0, 0xFFFF, "Supply", "V"),
        _steps(temperature.boot_count, 1, 0, 0xFF, "BootCount", ""),
    )


def encode_identity(identity: EcuIdentity) -> bytes:
    """EcuIdentity frame.

    Raises:
        LocalProtocolError: a value does not fit its signal.
    """
    return _IDENTITY.pack(
        _steps(identity.serial_number, 1, 0, 0xFFFFFFFF, "SerialNumber", ""),
        _steps(identity.firmware, 1, 0, 0xFFFF, "Firmware", ""),
        _steps(identity.layout, 1, 0, 0xFFFF, "Layout", ""),
    )


def decode_command(data: bytes) -> CoilCommand:
    """Contents of a CoilCommand frame.

    Raises:
        RemoteProtocolError: wrong length, CRC or counter.
    """
    _check(data, COMMAND_ID)
    _, flags, setpoint, _ = _COMMAND.unpack(data)
    return CoilCommand(flags & 0x0F, bool(flags & 0x10), bool(flags & 0x20), setpoint / 1000)


def decode_status(data: bytes) -> CoilStatus:
    """Contents of a CoilStatus frame.

    Raises:
        RemoteProtocolError: wrong length, CRC or counter.
    """
    _check(data, STATUS_ID)
    _, flags, current, faults, duty, ticks = _STATUS.unpack(data)
    return CoilStatus(flags & 0x0F, flags >> 4, current / 1000, faults, duty / 2, ticks)


def decode_temperature(data: bytes) -> CoilTemperature:
    """Contents of a CoilTemperature frame.

    Raises:
        RemoteProtocolError: wrong length.
    """
    _check_length(data, TEMPERATURE_ID)
    coil, ecu, supply, boots = _TEMPERATURE.unpack(data)
    return CoilTemperature(coil / 10, ecu / 10, supply / 100, boots)


def decode_identity(data: bytes) -> EcuIdentity:
    """Contents of an EcuIdentity frame.

    Raises:
        RemoteProtocolError: wrong length.
    """
    _check_length(data, IDENTITY_ID)
    return EcuIdentity(*_IDENTITY.unpack(data))


def counter_delta(previous: int, present: int) -> int:
    """Frames sent since `previous`, modulo 15: 1 is right, 0 a repetition, n > 1 means n - 1 frames are missing."""
    return (present - previous) % COUNTER_MODULUS


def _protect(layout: struct.Struct, frame_id: int, counter: int, flags: int, *values: int) -> bytes:
    """Pack a frame and put counter and CRC in.

    Raises:
        LocalProtocolError: the counter is not 0..14.
    """
    if not 0 <= counter < COUNTER_MODULUS:
        raise LocalProtocolError(f"frame 0x{frame_id:03X}: counter {counter} is outside 0..14")
    data = bytearray(layout.pack(0, flags | counter, *values))
    e2e_p01_protect(data, frame_id, increment_counter=False)
    return bytes(data)


def _check_length(data: bytes, frame_id: int) -> None:
    """Refuse a frame of any length but 8.

    Raises:
        RemoteProtocolError: another length.
    """
    if len(data) != FRAME_LENGTH:
        raise RemoteProtocolError(f"frame 0x{frame_id:03X}: expected 8 data bytes, got {len(data)}")


def _check(data: bytes, frame_id: int) -> None:
    """Refuse a protected frame with a wrong length, counter or CRC.

    Raises:
        RemoteProtocolError: with the reason.
    """
    _check_length(data, frame_id)
    if data[1] & 0x0F >= COUNTER_MODULUS:
        raise RemoteProtocolError(f"frame 0x{frame_id:03X}: counter 15 is not valid")
    if not e2e_p01_check(bytearray(data), frame_id):
        raise RemoteProtocolError(f"frame 0x{frame_id:03X}: wrong CRC in {data.hex(' ')}")


def _steps(value: float, step: float, low: int, high: int, name: str, unit: str) -> int:
    """Value in wire steps, rounded to the nearest.

    Raises:
        LocalProtocolError: not finite, or outside low..high.
    """
    scaled = value / step
    if not low - 0.5 <= scaled <= high + 0.5:
        raise LocalProtocolError(f"{name} {value} {unit} is outside {low * step:g}..{high * step:g} {unit}".rstrip())
    return min(max(round(scaled), low), high)

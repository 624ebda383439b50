"""The demo current ECU from its inside: the codes its firmware knows, and its frames.

Codes and layout stand here a second time, beside `drivers/devices/demo_ecu.toml` and its DBC, because a device does not
read its host's files; that they agree is tested.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum, IntFlag

from simulators.ecu_frames import (
    COUNTER_MODULUS,
    CoilCommand,
    CoilStatus,
    CoilTemperature,
    CurrentFrames,
    EcuIdentity,
    Message,
    Signal,
    counter_delta,
)
from simulators.ecu_wire import Command, Frame, Shown

LAYOUT = 1
FIRMWARE = 0x0100
DEVICE_TIME_MODULUS = 1 << 16
DEVICE_TIME_TICK_US = 100

FRAMES = CurrentFrames(
    command=Message(0x120, 8, {
        "counter": Signal("Counter", 8, 4), "enable": Signal("Enable", 12, 1),
        "clear_faults": Signal("ClearFaults", 13, 1),
        "setpoint_A": Signal("CurrentSetpoint", 16, 16, signed=True, scale=0.001, unit="A"),
    }, data_id=0x0120),
    status=Message(0x121, 8, {
        "counter": Signal("Counter", 8, 4), "state": Signal("State", 12, 4),
        "current_A": Signal("Current", 16, 16, signed=True, scale=0.001, unit="A"),
        "faults": Signal("Faults", 32, 8), "duty_percent": Signal("DutyCycle", 40, 8, scale=0.5, unit="%"),
        "device_time_ticks": Signal("DeviceTime", 48, 16),
    }, data_id=0x0121),
    temperature=Message(0x122, 8, {
        "coil_degC": Signal("CoilTemperature", 0, 16, signed=True, scale=0.1, unit="degC"),
        "ecu_degC": Signal("EcuTemperature", 16, 16, signed=True, scale=0.1, unit="degC"),
        "supply_V": Signal("Supply", 32, 16, scale=0.01, unit="V"), "boot_count": Signal("BootCount", 48, 8),
    }),
    identity=Message(0x123, 8, {
        "serial_number": Signal("SerialNumber", 0, 32), "firmware": Signal("Firmware", 32, 16),
        "layout": Signal("Layout", 48, 16),
    }),
    tick_us=DEVICE_TIME_TICK_US,
)  # fmt: skip
COMMAND_ID, STATUS_ID = FRAMES.command_id, FRAMES.status_id
TEMPERATURE_ID, IDENTITY_ID = FRAMES.temperature_id, FRAMES.identity_id

encode_command, decode_command = FRAMES.encode_command, FRAMES.decode_command
encode_status, decode_status = FRAMES.encode_status, FRAMES.decode_status
encode_temperature, decode_temperature = FRAMES.encode_temperature, FRAMES.decode_temperature
encode_identity, decode_identity = FRAMES.encode_identity, FRAMES.decode_identity

__all__ = [
    "COMMAND_ID", "COUNTER_MODULUS", "DEVICE_TIME_MODULUS", "DEVICE_TIME_TICK_US", "FRAMES", "IDENTITY_ID", "LAYOUT",
    "STATUS_ID", "TEMPERATURE_ID", "CoilCommand", "CoilStatus", "CoilTemperature", "DemoWire", "EcuFault",
    "EcuIdentity", "EcuState",
    "counter_delta", "decode_command", "decode_identity", "decode_status", "decode_temperature", "encode_command",
    "encode_identity", "encode_status", "encode_temperature",
]


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


class DemoWire:
    """The demo ECU's frames (`simulators.ecu_wire.EcuWire`)."""

    periods_us: Mapping[str, int] = {"status": 10_000, "temperature": 100_000, "identity": 1_000_000}
    temperatures = frozenset({"temperature"})
    counter_modulus = COUNTER_MODULUS

    def __init__(self) -> None:
        self._counter = 0

    def reset(self) -> None:
        """The status counter starts over."""
        self._counter = 0

    def timeout_s(self, usual_s: float) -> float:
        """As its options say."""
        return usual_s

    def is_command(self, identifier: int) -> bool:
        """Whether it is CoilCommand."""
        return identifier == COMMAND_ID

    def command(self, identifier: int, data: bytes) -> Command:
        """What CoilCommand asks for.

        Raises:
            RemoteProtocolError: wrong length, CRC or counter.
        """
        del identifier
        return Command(*decode_command(data))

    def commands(self, command: Command) -> list[Frame]:
        """CoilCommand as a host sends it."""
        return [(COMMAND_ID, encode_command(CoilCommand(*command)))]

    def frame(self, name: str, shown: Shown) -> Frame:
        """The next status, temperature or identity."""
        if name == "status":
            ticks = shown.device_us // DEVICE_TIME_TICK_US % DEVICE_TIME_MODULUS
            status = CoilStatus(
                self._counter, shown.state, shown.current_A, shown.faults, shown.duty_percent, ticks
            )
            self._counter = (self._counter + 1) % COUNTER_MODULUS
            return STATUS_ID, encode_status(status)
        if name == "temperature":
            boots = shown.boot_count & 0xFF
            return TEMPERATURE_ID, encode_temperature(
                CoilTemperature(shown.coil_degC, shown.ecu_degC, shown.supply_V, boots)
            )
        return IDENTITY_ID, encode_identity(EcuIdentity(shown.serial_number, FIRMWARE, LAYOUT))

    def damaged(self, frame: Frame) -> Frame:
        """Its first byte, the CRC's in protected frames, with bits turned over, not the same ones every time."""
        identifier, data = frame
        return identifier, bytes([data[0] ^ 0x30 ^ data[1] & 0x0F]) + data[1:]

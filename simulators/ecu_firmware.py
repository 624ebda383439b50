"""The demo current ECU from its inside: the codes its firmware knows, and its frames.

The codes stand here a second time, beside `drivers/devices/demo_ecu.toml`, because a device does not read its host's
files; that the two agree is tested. How the frames are packed is taken from that file and its DBC.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

from drivers.devices.source import current_source
from protocols.current_frames import (
    COUNTER_MODULUS,
    CoilCommand,
    CoilStatus,
    CoilTemperature,
    EcuIdentity,
    counter_delta,
)

FRAMES = current_source("demo").frames
COMMAND_ID, STATUS_ID = FRAMES.command_id, FRAMES.status_id
TEMPERATURE_ID, IDENTITY_ID = FRAMES.temperature_id, FRAMES.identity_id
LAYOUT = 1
DEVICE_TIME_MODULUS = 1 << 16
DEVICE_TIME_TICK_US = 100

encode_command, decode_command = FRAMES.encode_command, FRAMES.decode_command
encode_status, decode_status = FRAMES.encode_status, FRAMES.decode_status
encode_temperature, decode_temperature = FRAMES.encode_temperature, FRAMES.decode_temperature
encode_identity, decode_identity = FRAMES.encode_identity, FRAMES.decode_identity

__all__ = [
    "COMMAND_ID", "COUNTER_MODULUS", "DEVICE_TIME_MODULUS", "DEVICE_TIME_TICK_US", "FRAMES", "IDENTITY_ID", "LAYOUT",
    "STATUS_ID", "TEMPERATURE_ID", "CoilCommand", "CoilStatus", "CoilTemperature", "EcuFault", "EcuIdentity",
    "EcuState",
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

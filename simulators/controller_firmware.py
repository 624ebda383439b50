"""The demo controller from its inside: the codes its firmware knows, and its registers.

The codes stand here a second time, beside `drivers/devices/demo_controller.toml`, because a device does not read its
host's files; that the two agree is tested. Where the registers lie is taken from that file.
"""

from __future__ import annotations

from enum import IntEnum, IntFlag

from drivers.devices.controller import controller
from protocols.register_map import RegisterMap

DESCRIPTION = controller("demo")
MAP = DESCRIPTION.map
IDENTITY, STATUS, CONFIG, COMMAND, WATCHDOG, TABLE = (
    MAP.block(name) for name in ("identity", "status", "config", "command", "watchdog", "table")
)
SETPOINT = controller("demo-streamed").map.block("setpoint")
MAP_WITHOUT_GENERATOR = RegisterMap("demo-streamed", (*MAP.blocks.values(), SETPOINT))
SIGNATURE_U32 = 0x01020304
SIGNATURE_F32 = 1234.5
LAYOUT_VERSION = 1
TABLE_VALUES = 60
"""Values of a table waveform that fit one write of the table block."""

decode_identity = DESCRIPTION.decode_identity
decode_status = DESCRIPTION.decode_status
decode_limits = DESCRIPTION.decode_limits
encode_limits = DESCRIPTION.encode_limits


class Command(IntEnum):
    """What the command register may ask for."""

    NONE = 0
    ACQUIRE = 1
    RELEASE = 2
    HYDRAULICS_LOW = 3
    HYDRAULICS_ON = 4
    HYDRAULICS_OFF = 5
    MOVE_TO = 6
    START = 7
    FADE_STOP = 8
    HALT = 9
    RESET = 10
    ZERO_TIME = 11


class State(IntEnum):
    """What the controller is doing."""

    OFF = 0
    LOW = 1
    HOLD = 2
    MOVING = 3
    RUNNING = 4
    FADING = 5
    HALTING = 6
    TRIPPED = 7


class Result(IntEnum):
    """The controller's answer to the last command."""

    IDLE = 0
    DONE = 1
    REFUSED_STATE = 2
    REFUSED_LIMIT = 3
    REFUSED_OWNER = 4
    REFUSED_VALUE = 5
    BUSY = 6


class Waveform(IntEnum):
    """Shapes of the function generator."""

    SINE = 0
    TRIANGLE = 1
    TABLE = 2


class ProgramPhase(IntEnum):
    """Where in its envelope the running program is."""

    IDLE = 0
    RAMP_IN = 1
    FULL_AMPLITUDE = 2
    RAMP_OUT = 3


class WatchdogAction(IntEnum):
    """What the controller does when its watchdog is not fed."""

    NONE = 0
    FADE_AND_HOLD = 1
    FREEZE = 2


class FaultBit(IntFlag):
    """Bits of `fault_bits`; each latches TRIPPED until RESET."""

    WATCHDOG = 1 << 0
    POSITION_LIMIT = 1 << 1
    SPEED_LIMIT = 1 << 2
    FORCE_LIMIT = 1 << 3
    FOLLOWING_ERROR = 1 << 4
    SENSOR = 1 << 5
    E_STOP = 1 << 6
    SUPPLY_PRESSURE = 1 << 7
    INTERNAL = 1 << 8
    ACCELERATION_LIMIT = 1 << 9


class Input(IntFlag):
    """Bits of `inputs`: the hard-wired chain as the controller sees it."""

    E_STOP_CLOSED = 1 << 0
    HYDRAULICS_LOW = 1 << 1
    HYDRAULICS_ON = 1 << 2
    VALVE_SATURATED = 1 << 3

"""The demo controller from its inside: the codes its firmware knows, and its registers.

Codes and registers stand here a second time, beside `drivers/devices/demo_controller.toml`, because a device does not
read its host's files; that the two agree is tested.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping, Sequence
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any

from drivers.roles import ActuatorIdentity, ActuatorLimits, ActuatorStatus
from simulators.register_blocks import Block, Register, RegisterMap

SIGNATURE_U32 = 0x01020304
SIGNATURE_F32 = 1234.5
LAYOUT_VERSION = 1
TABLE_VALUES = 60
"""Values of a table waveform that fit one write of the table block."""


def _registers(given: Mapping[str, Any], *, writable: bool) -> list[Register]:
    """One register; an entry with `repeat` stands for so many in a row, numbered from 0."""
    one = dict(given)
    repeat = int(one.pop("repeat", 0))
    if not repeat:
        return [Register(**one, writable=writable)]
    first = Register(**one, writable=writable)
    places = ((f"{first.name}{i}", first.address + i * first.length) for i in range(repeat))
    return [Register(**(one | {"name": name, "address": at}), writable=writable) for name, at in places]


def _map() -> RegisterMap:
    data = tomllib.loads(Path(__file__).with_name("demo_registers.toml").read_text(encoding="utf-8"))
    blocks = []
    for entry in data["block"]:
        writable = bool(entry.get("writable", False))
        registers = [one for given in entry["registers"] for one in _registers(given, writable=writable)]
        blocks.append(Block(entry["name"], tuple(registers)))
    return RegisterMap("demo-streamed", blocks)


MAP_WITHOUT_GENERATOR = _map()
IDENTITY, STATUS, CONFIG, COMMAND, WATCHDOG, TABLE, SETPOINT = (
    MAP_WITHOUT_GENERATOR.block(name)
    for name in ("identity", "status", "config", "command", "watchdog", "table", "setpoint")
)
MAP = RegisterMap("demo", (IDENTITY, STATUS, CONFIG, COMMAND, WATCHDOG, TABLE))
LIMITS = tuple(register.name for register in CONFIG.registers)
"""In the order of `ActuatorLimits`."""


def encode_limits(limits: ActuatorLimits) -> list[int]:
    """Words of the config block.

    Raises:
        LocalProtocolError: a limit does not fit its register.
    """
    values = [getattr(limits, name) for name in ActuatorLimits.__dataclass_fields__]
    return CONFIG.encode(dict(zip(LIMITS, values, strict=True)))


def decode_limits(words: Sequence[int]) -> ActuatorLimits:
    """Limits from the words of the config block.

    Raises:
        RemoteProtocolError: the words do not make up the block.
    """
    values: Any = CONFIG.decode(words)
    return ActuatorLimits(*[values[name] for name in LIMITS])


def decode_status(words: Sequence[int], received_ns: int) -> ActuatorStatus:
    """The status block as whoever watches the registers reads it; the firmware's codes are the rig's.

    Raises:
        RemoteProtocolError: the words do not make up the block.
    """
    values: Any = STATUS.decode(words)
    return ActuatorStatus(received_ns, *[values[register.name] for register in STATUS.registers])


def decode_identity(words: Sequence[int]) -> ActuatorIdentity:
    """The identity block as whoever watches the registers reads it.

    Raises:
        RemoteProtocolError: the words do not make up the block.
    """
    values: Any = IDENTITY.decode(words)
    return ActuatorIdentity(**values)


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

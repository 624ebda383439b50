"""The actuator controller's default register map ("demo"), its commands, states and answers.

Holding registers, big-endian words, function codes 3, 6, 16 and 23. The blocks:

    0..37     identity   read once at connect; the two signature registers prove word order and scale
    100..133  status     one read, polled every 10 ms
    200..215  config     limits and watchdog; written, then read back
    300..323  command    one write: the command executes once for every new value of `sequence`
    350       watchdog   a changed value feeds the watchdog
    400..521  table      samples of a table waveform, 60 at a time

Addresses are data (`MAP`); a user's own map needs the same names, wherever they lie.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import NamedTuple

from protocols.register_map import Block, Register, RegisterMap, Value

SIGNATURE_U32 = 0x01020304
SIGNATURE_F32 = 1234.5
LAYOUT_VERSION = 1
TABLE_VALUES = 60
"""Values of a table waveform that fit one write of the table block."""


class Command(IntEnum):
    """What `command` may ask for."""

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


IDENTITY = Block("identity", (
    Register(0, "signature_u32", "u32", meaning="0x01020304: proves the word order"),
    Register(2, "signature_f32", "f32", meaning="1234.5: proves order and float format"),
    Register(4, "layout_version", "u16", meaning="1"),
    Register(6, "boot_count", "u32", meaning="starts since manufacture"),
    Register(8, "config_hash", "u32", meaning="CRC-32 of registers 200..215 as big-endian bytes"),
    Register(10, "vendor", "string", length=8),
    Register(18, "model", "string", length=8),
    Register(26, "serial_number", "string", length=8),
    Register(34, "firmware", "string", length=4),
))

STATUS = Block("status", (
    Register(100, "heartbeat", "u16", meaning="+1 every 10 ms of device clock"),
    Register(101, "state", "u16", meaning="State"),
    Register(102, "fault_bits", "u32", meaning="FaultBit"),
    Register(104, "clock_us", "u32", "us", "device clock, wraps"),
    Register(106, "position", "f32", "m", "controller's own transducer"),
    Register(108, "velocity", "f32", "m/s"),
    Register(110, "setpoint", "f32", "m"),
    Register(112, "cycles_done", "u32", meaning="whole cycles of the running program, ramps included"),
    Register(114, "pulse_count", "u16", meaning="cycle pulses since boot"),
    Register(115, "phase", "u16", meaning="ProgramPhase"),
    Register(116, "pulse_clock_us", "u32", "us", "device clock at the last pulse"),
    Register(118, "acked_sequence", "u16", meaning="sequence of the last command seen"),
    Register(119, "result", "u16", meaning="Result of that command"),
    Register(120, "acked_command", "u16", meaning="Command of that sequence"),
    Register(121, "owner", "u16", meaning="lease holder, 0 none"),
    Register(122, "watchdog_echo", "u16", meaning="last watchdog counter received"),
    Register(123, "inputs", "u16", meaning="Input"),
    Register(124, "supply_pressure", "f32", "Pa"),
    Register(126, "accumulator_pressure", "f32", "Pa"),
    Register(128, "program_id", "u16", meaning="sequence number of the START that runs"),
    Register(130, "servo_error", "f32", "m"),
    Register(132, "force", "f32", "N", "controller's own coarse force input"),
))

CONFIG = Block("config", (
    Register(200, "position_min", "f32", "m", writable=True),
    Register(202, "position_max", "f32", "m", writable=True),
    Register(204, "speed_max", "f32", "m/s", writable=True),
    Register(206, "acceleration_max", "f32", "m/s^2", writable=True),
    Register(208, "force_max", "f32", "N", writable=True),
    Register(210, "fade_out_cycles", "f32", meaning="cycles of the fade-out, >= 1", writable=True),
    Register(212, "halt_deceleration", "f32", "m/s^2", writable=True),
    Register(214, "watchdog_ms", "u16", "ms", "0 = disabled", writable=True),
    Register(215, "watchdog_action", "u16", meaning="WatchdogAction", writable=True),
))

COMMAND = Block("command", (
    Register(300, "command", "u16", meaning="Command", writable=True),
    Register(301, "sequence", "u16", meaning="a new value executes the command once; never 0", writable=True),
    Register(302, "owner_id", "u16", meaning="must hold the lease", writable=True),
    Register(303, "waveform", "u16", meaning="Waveform", writable=True),
    Register(304, "target_position", "f32", "m", writable=True),
    Register(306, "speed", "f32", "m/s", writable=True),
    Register(308, "amplitude", "f32", "m", writable=True),
    Register(310, "frequency", "f32", "Hz", writable=True),
    Register(312, "centre", "f32", "m", writable=True),
    Register(314, "cycles", "f32", meaning="full-amplitude cycles", writable=True),
    Register(316, "ramp_in_cycles", "f32", writable=True),
    Register(318, "ramp_out_cycles", "f32", writable=True),
    Register(320, "table_length", "u16", writable=True),
    Register(322, "table_interval", "f32", "s", writable=True),
))

WATCHDOG = Block("watchdog", (Register(350, "watchdog_counter", "u16", writable=True),))

TABLE = Block("table", (
    Register(400, "table_index", "u16", meaning="index of the first value that follows", writable=True),
    Register(401, "table_count", "u16", meaning="values that follow", writable=True),
    *(Register(402 + 2 * i, f"table_value_{i}", "f32", "m", writable=True) for i in range(TABLE_VALUES)),
))

MAP = RegisterMap("demo", (IDENTITY, STATUS, CONFIG, COMMAND, WATCHDOG, TABLE))


@dataclass(frozen=True, slots=True)
class ActuatorIdentity:
    """Who the controller says it is (identity block)."""

    signature_u32: int
    signature_f32: float
    layout_version: int
    boot_count: int
    config_hash: int
    vendor: str
    model: str
    serial_number: str
    firmware: str


@dataclass(frozen=True, slots=True)
class ActuatorLimits:
    """The controller's own limits and its watchdog (config block).

    Attributes:
        position_min_m, position_max_m: allowed travel, m.
        speed_max_m_s: m/s.
        acceleration_max_m_s2: m/s^2.
        force_max_N: N, on the controller's coarse force input.
        fade_out_cycles: cycles of the fade-out, >= 1.
        halt_deceleration_m_s2: m/s^2.
        watchdog_ms: ms without a changed counter until the controller trips; 0 disables it.
        watchdog_action: what it does then.
    """

    position_min_m: float
    position_max_m: float
    speed_max_m_s: float
    acceleration_max_m_s2: float
    force_max_N: float
    fade_out_cycles: float
    halt_deceleration_m_s2: float
    watchdog_ms: int
    watchdog_action: int = WatchdogAction.FADE_AND_HOLD


class ActuatorStatus(NamedTuple):
    """One answer to a status poll; fields as in the status block, `received_ns` on the host's monotonic clock.

    `state`, `result`, `phase` and `acked_command` are plain integers, so a code of a newer controller is shown, not
    hidden; compare them with `State`, `Result`, `ProgramPhase` and `Command`.
    """

    received_ns: int
    heartbeat: int
    state: int
    fault_bits: int
    clock_us: int
    position_m: float
    velocity_m_s: float
    setpoint_m: float
    cycles_done: int
    pulse_count: int
    phase: int
    pulse_clock_us: int
    acked_sequence: int
    result: int
    acked_command: int
    owner: int
    watchdog_echo: int
    inputs: int
    supply_pressure_Pa: float
    accumulator_pressure_Pa: float
    program_id: int
    servo_error_m: float
    force_N: float

    def age_ns(self, now_ns: int) -> int:
        """Nanoseconds since this answer arrived.

        Args:
            now_ns: the host's monotonic clock.
        """
        return now_ns - self.received_ns

    def acknowledges(self, command: int, sequence: int) -> bool:
        """Whether this answers that command: the same number may have carried another master's command.

        Args:
            command: what was sent, a `Command`.
            sequence: its sequence number.
        """
        return (self.acked_sequence, self.acked_command) == (sequence, command)


def _bare(field: str) -> str:
    """Register name of a field: the unit suffix dropped."""
    for suffix in ("_m_s2", "_m_s", "_Pa", "_m", "_N"):
        if field.endswith(suffix):
            return field.removesuffix(suffix)
    return field


IDENTITY_NAMES = tuple(ActuatorIdentity.__dataclass_fields__)
LIMIT_NAMES = {field: _bare(field) for field in ActuatorLimits.__dataclass_fields__}
STATUS_NAMES = tuple(_bare(field) for field in ActuatorStatus._fields[1:])


def decode_identity(words: Sequence[int], block: Block = IDENTITY) -> ActuatorIdentity:
    """Identity from the words of its block.

    Raises:
        RemoteProtocolError: the words do not make up the block.
    """
    values = block.decode(words)
    return ActuatorIdentity(**{name: values[name] for name in IDENTITY_NAMES})  # type: ignore[arg-type]  # types follow the map


def decode_status(words: Sequence[int], received_ns: int, block: Block = STATUS) -> ActuatorStatus:
    """Status from the words of its block.

    Args:
        words: `block.count` register values.
        received_ns: when the answer arrived, host's monotonic clock.
        block: where the map has the status registers.

    Raises:
        RemoteProtocolError: the words do not make up the block.
    """
    values = block.decode(words)
    return ActuatorStatus(received_ns, *[values[name] for name in STATUS_NAMES])  # type: ignore[arg-type]  # types follow the map


def decode_limits(words: Sequence[int], block: Block = CONFIG) -> ActuatorLimits:
    """Limits from the words of the config block.

    Raises:
        RemoteProtocolError: the words do not make up the block.
    """
    values = block.decode(words)
    return ActuatorLimits(**{field: values[name] for field, name in LIMIT_NAMES.items()})  # type: ignore[arg-type]  # types follow the map


def encode_limits(limits: ActuatorLimits, block: Block = CONFIG) -> list[int]:
    """Words of the config block.

    Raises:
        LocalProtocolError: a limit does not fit its register.
    """
    values: dict[str, Value] = {name: getattr(limits, field) for field, name in LIMIT_NAMES.items()}
    return block.encode(values)

"""What the rig needs from its devices, independent of their manufacturer: an actuator and sensors.

Everything above `drivers` speaks these words and no device's own. A driver maps the device's registers, frames and
codes to them, by the device's description (`drivers.devices`). The numbers of `State`, `ProgramPhase`, `FaultBit` and
`Input` are those of recorded files. A code that a description does not name is shown as it is, moved out of the way
(`UNNAMED`) where it would be taken for a named one.

What an actuator can do is declared (`drivers.capabilities`), never tried out. The coil's current source has its role in
`drivers.current_source`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import NamedTuple, Protocol

from drivers.capabilities import Capabilities
from drivers.connection import LinkKind
from drivers.sample_stream import Batch

UNNAMED = 1 << 16
"""Added to a device's code that has no name here and whose number has another meaning here."""


class State(IntEnum):
    """What the actuator is doing."""

    OFF = 0
    LOW = 1
    """Low pressure: it can creep, not move."""
    HOLD = 2
    MOVING = 3
    RUNNING = 4
    """A program of the function generator runs."""
    FADING = 5
    HALTING = 6
    TRIPPED = 7


class ProgramPhase(IntEnum):
    """Where in its envelope the running program is."""

    IDLE = 0
    RAMP_IN = 1
    FULL_AMPLITUDE = 2
    RAMP_OUT = 3


class FaultBit(IntFlag):
    """Causes for which an actuator trips by itself."""

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
    """The hard-wired chain as the actuator sees it; one without an e-stop input says "closed"."""

    E_STOP_CLOSED = 1 << 0
    HYDRAULICS_LOW = 1 << 1
    HYDRAULICS_ON = 1 << 2
    VALVE_SATURATED = 1 << 3


class Pressure(IntEnum):
    """What an actuator shows of its pressure (or power), separately from what it does and from its trip."""

    UNSTATED = 0
    """It has no meaning of its own for it: it follows from inputs and state."""
    OFF = 1
    LOW = 2
    ON = 3
    UNKNOWN = 4
    """It shows neither: no proof of anything."""


class Command(IntEnum):
    """What an actuator may be asked to do."""

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


class Result(IntEnum):
    """The actuator's answer to the last command."""

    IDLE = 0
    DONE = 1
    REFUSED_STATE = 2
    REFUSED_LIMIT = 3
    REFUSED_OWNER = 4
    REFUSED_VALUE = 5
    BUSY = 6


class Waveform(IntEnum):
    """Shapes of a motion program."""

    SINE = 0
    TRIANGLE = 1
    TABLE = 2


class WatchdogAction(IntEnum):
    """What the actuator does when its watchdog is not fed."""

    NONE = 0
    FADE_AND_HOLD = 1
    FREEZE = 2


@dataclass(frozen=True, slots=True)
class ActuatorIdentity:
    """Who the actuator says it is; what it does not know is 0 or empty.

    Attributes:
        boot_count: starts since manufacture.
        config_hash: changes with its limits and settings.
    """

    signature_u32: int = 0
    signature_f32: float = 0.0
    layout_version: int = 0
    boot_count: int = 0
    config_hash: int = 0
    vendor: str = ""
    model: str = ""
    serial_number: str = ""
    firmware: str = ""

    @property
    def settings(self) -> tuple[int, int]:
        """What a reboot or settings by another client would change."""
        return self.boot_count, self.config_hash


@dataclass(frozen=True, slots=True)
class ActuatorLimits:
    """The actuator's own limits and its watchdog.

    Attributes:
        position_min_m, position_max_m: allowed travel, m.
        speed_max_m_s: m/s.
        acceleration_max_m_s2: m/s^2.
        force_max_N: N, on the actuator's coarse force input.
        fade_out_cycles: cycles of the fade-out, >= 1.
        halt_deceleration_m_s2: m/s^2.
        watchdog_ms: ms without being fed until the actuator trips; 0 disables it.
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
    """One answer to a status poll; `received_ns` on the host's monotonic clock.

    `state`, `result`, `phase` and `acked_command` are plain integers, so that a code without a name is shown, not
    hidden; compare them with `State`, `Result`, `ProgramPhase` and `Command`. What a device does not measure is NaN;
    what it does not have (lease, acknowledgement, echo, pulses) is 0.

    Attributes:
        heartbeat: changes while the device runs; the arrival's time where the device has none.
        clock_us: device clock modulo 2^32, us; the host's where the device has none.
        cycles_done: whole cycles of the running program, ramps included.
        pulse_count: cycle pulses so far.
        pulse_clock_us: device clock at the last pulse.
        program_id: number of the START that runs, 0 for none.
        stated_pressure: a `Pressure`, where the device shows its pressure by a meaning of its own.
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
    stated_pressure: int = Pressure.UNSTATED

    def acknowledges(self, command: int, sequence: int) -> bool:
        """Whether this answers that command: the same number may have carried another master's command.

        Args:
            command: what was sent, a `Command`.
            sequence: its sequence number.
        """
        return (self.acked_sequence, self.acked_command) == (sequence, command)

    @property
    def pressure(self) -> Pressure:
        """The pressure (or power), whatever the state: a latched trip says nothing of it.

        An input that shows pressure counts more than a state of that name that denies it.
        """
        if self.stated_pressure != Pressure.UNSTATED:
            return Pressure(self.stated_pressure)
        if self.inputs & Input.HYDRAULICS_ON:
            return Pressure.ON
        return Pressure.LOW if self.inputs & Input.HYDRAULICS_LOW else Pressure.OFF

    @property
    def hydraulics_off(self) -> bool:
        """The absence of pressure is shown."""
        return self.pressure is Pressure.OFF

    @property
    def hydraulics_low(self) -> bool:
        """The absence of full pressure is shown."""
        return self.pressure in {Pressure.OFF, Pressure.LOW}

    @property
    def tripped(self) -> bool:
        """A trip of its own is latched, or a fault is shown."""
        return self.state == State.TRIPPED or bool(self.fault_bits)

    @property
    def watchdog_tripped(self) -> bool:
        """Its watchdog has tripped."""
        return bool(self.fault_bits & FaultBit.WATCHDOG)

    @property
    def e_stop_open(self) -> bool:
        """The hard-wired chain is open."""
        return not self.inputs & Input.E_STOP_CLOSED


@dataclass(frozen=True, slots=True)
class Move:
    """The order of `MOVE_TO`: a position (m) and the speed on the way there (m/s)."""

    target_m: float
    speed_m_s: float


@dataclass(frozen=True, slots=True)
class Program:
    """The order of `START`: a waveform about `centre_m`, its full cycles and the ramps beside them.

    A table is loaded before (`write_table`); it plays once a cycle, in metres, and `amplitude_m` is not used.
    """

    waveform: Waveform
    amplitude_m: float
    frequency_Hz: float
    centre_m: float = 0.0
    cycles: float = 0.0
    ramp_in_cycles: float = 0.0
    ramp_out_cycles: float = 0.0
    table_length: int = 0

    @property
    def all_cycles(self) -> float:
        """Cycles with both ramps."""
        return self.cycles + self.ramp_in_cycles + self.ramp_out_cycles


def state_name(state: int) -> str:
    """An actuator's state by name; a code without a name as its number."""
    return State(state).name if state in set(State) else str(state)


class CountingLink(Protocol):
    """A driver's connection, and what was overcome on it."""

    @property
    def link_kind(self) -> LinkKind:
        """What the connection is made of."""

    @property
    def is_open(self) -> bool:
        """The connection stands, as far as is known."""

    @property
    def stale(self) -> int:
        """Answers to other requests that were recognised and thrown away."""

    @property
    def busy(self) -> int:
        """"Busy" answers that were asked again."""


class Actuator(CountingLink, Protocol):
    """An actuator controller, as its driver shows it; used by one thread."""

    @property
    def capabilities(self) -> Capabilities:
        """What it can do; known before it is opened."""

    @property
    def sent(self) -> Sequence[tuple[int, int]]:
        """Sequence and command of the last commands written, oldest first."""

    def open(self) -> None:
        """Open the connection."""

    def close(self) -> None:
        """Close the connection; the actuator goes on with what it does."""

    def read_identity(self) -> ActuatorIdentity:
        """Who it is; refused where it is not the described device."""

    def read_status(self) -> ActuatorStatus:
        """Its status, without feeding the watchdog."""

    def exchange(self, watchdog_counter: int) -> ActuatorStatus:
        """Feed the watchdog and read the status, in one trip."""

    def write_limits(self, limits: ActuatorLimits) -> None:
        """Write limits and watchdog; proved where they can be read back."""

    def read_limits(self) -> ActuatorLimits:
        """The limits it holds; only with `limits_read_back`."""

    def write_table(self, values_m: list[float]) -> None:
        """Load the samples of a table waveform (m about the centre)."""

    def send(self, command: Command, order: Move | Program | None = None) -> int:
        """Send a command; its sequence number."""


class Sensor(Protocol):
    """A sensor that sends readings by itself, as its driver shows it."""

    @property
    def bad_frames(self) -> int:
        """Frames or lines that came damaged."""

    @property
    def skipped_bytes(self) -> int:
        """Bytes that belonged to no reading."""

    @property
    def moved(self) -> bool:
        """The port's name leads to another port than the one that was opened."""

    def open(self) -> None:
        """Open the port."""

    def close(self) -> None:
        """Close the port."""

    def discard_input(self) -> None:
        """Throw away what has arrived."""

    def read_batch(self, timeout_s: float) -> Batch:
        """Wait up to `timeout_s` for samples and return those that came."""

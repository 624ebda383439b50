"""What the rig needs from the coil's current source, independent of its manufacturer.

As in `drivers.roles`: the numbers of `SourceState` and `SourceFault` are those of recorded files, and a code without a
name is shown as it is, moved out of the way (`drivers.roles.UNNAMED`) where it would be taken for a named one.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum, IntFlag
from typing import NamedTuple, Protocol

from drivers.errors import DriverError
from drivers.ring import Channel, Record


class SourceState(IntEnum):
    """What the current source's output stage is doing."""

    INIT = 0
    OFF = 1
    ENABLED = 2
    FAULT = 3


class SourceFault(IntFlag):
    """What a current source reports; on any of them it drives 0 A by itself."""

    OVER_TEMPERATURE = 1 << 0
    UNDERVOLTAGE = 1 << 1
    OPEN = 1 << 2
    SHORT = 1 << 3
    COMMAND_TIMEOUT = 1 << 4
    COMMAND_CHECK = 1 << 5
    RESTARTED = 1 << 6


UNKNOWN_STATE = -1
"""Of a current source that does not tell its state."""


class SourceStatus(NamedTuple):
    """One status of the current source: `state` a `SourceState`, `faults` of `SourceFault`, measured current in A."""

    state: int
    current_A: float
    faults: int


class SourceTiming(NamedTuple):
    """How often a current source tells what (s of its clock); 0 for what it never tells."""

    status_s: float = 0.010
    temperature_s: float = 0.100
    identity_s: float = 1.0


class SourceTraits(NamedTuple):
    """What the rig has to know of a current source beside its statuses.

    Attributes:
        own_timeout_s: after so long without commands it goes to 0 A by itself (wall s); None: it keeps its current.
        measures: it measures its current; else a status repeats what was asked for.
        settling_s: a new set-point's current is there after so long (s of its clock).
        lowest_A: the most negative current it drives (A); None: as negative as positive.
        tells_bad_commands: it reports commands that it throws away; else a small current proves that it takes them.
        by_hand: a person sets it: commands are what that person said, and no stop takes it away.
    """

    own_timeout_s: float | None = 0.1
    measures: bool = True
    settling_s: float = 0.15
    lowest_A: float | None = None
    by_hand: bool = False
    tells_bad_commands: bool = True


class SourceTemperature(NamedTuple):
    """Temperatures in degC, supply in V, and how often the source has started; NaN for what it does not measure."""

    coil_degC: float
    source_degC: float
    supply_V: float
    boot_count: int


class SourceIdentity(NamedTuple):
    """Who the current source is; 0 for what it does not tell."""

    serial_number: int | str
    firmware: int | str
    layout: int


@dataclass(slots=True)
class SourceCounters:
    """Totals since construction; only those in a row and `lateness` ever decrease.

    Attributes:
        bad_in_a_row: status frames dropped since the last good one; `malformed_in_a_row` of them for length or kind,
            `unmeasured_in_a_row` because an answer held no measured number.
        gaps_in_a_row: good status frames one after the other whose counter has left some out.
        lateness: grows by 2 with a repeated status frame, falls by 1 with a fresh one: duplicates that keep coming.
        not_numbers: values of a channel that were no finite number in a frame that is right otherwise.
        stamps_ns: uncertainty of the interface's time stamps, by which frames are timed; 0 while it is their arrival.
        other_bits: bits on the bus of frames that are not the source's, without stuffing.
    """

    statuses: int = 0
    lost: int = 0
    duplicates: int = 0
    bad_checks: int = 0
    bad_in_a_row: int = 0
    malformed: int = 0
    malformed_in_a_row: int = 0
    unmeasured_in_a_row: int = 0
    gaps_in_a_row: int = 0
    lateness: int = 0
    other_bits: int = 0
    foreign_commands: int = 0
    other_frames: int = 0
    sent: int = 0
    late_sends: int = 0
    stamps_ns: int = 0
    not_numbers: dict[Channel, int] = field(default_factory=dict)


class SourceBatch(NamedTuple):
    """What one read of the current source gave.

    Attributes:
        records: ring records in SI and degC, in the order of the wire; the set-points sent meanwhile among them.
        statuses: statuses that passed every check.
        temperatures: temperatures.
        lost: statuses that the counter says are missing.
        bad: statuses dropped for CRC, counter, length or kind.
        arrival_ns: monotonic time at which they were there, ns.
    """

    records: list[Record]
    statuses: list[SourceStatus]
    temperatures: list[SourceTemperature]
    lost: int
    bad: int
    arrival_ns: int


class CurrentSource(Protocol):
    """The coil's current source, as its driver shows it.

    Read by one owner thread; commands may come from any thread. Until `command` is called it asks for 0 A, disabled.
    """

    counters: SourceCounters
    status: SourceStatus | None
    temperature: SourceTemperature | None
    identity: SourceIdentity | None
    send_error: DriverError | None

    @property
    def timing(self) -> SourceTiming:
        """How often it tells what."""

    @property
    def traits(self) -> SourceTraits:
        """What else the rig has to know of it."""

    @property
    def lacking(self) -> tuple[tuple[str, str], ...]:
        """What it cannot do or does not tell: a name, and what is left without it."""

    @property
    def refusal(self) -> tuple[str, str]:
        """Slug and words of why what is heard cannot be believed; two empty texts while nothing speaks against it."""

    @property
    def identity_problem(self) -> str:
        """Why its identity is not that of the described device; empty while it is, or none has come."""

    @property
    def commanded_A(self) -> float:
        """Set-point of the commands, A; 0 while they ask for the output stage to be off."""

    @property
    def bus_errors(self) -> int:
        """Errors the interface reported."""

    @property
    def malformed(self) -> int:
        """What came in and cannot be the source's."""

    def open(self) -> None:
        """Join the bus; sends nothing yet."""

    def close(self) -> None:
        """Leave it at 0 A with its output off, end the commands and leave the bus."""

    def start(self, period_s: float) -> None:
        """Send the command from now on, every `period_s` wall seconds."""

    def command(self, current_A: float, *, enable: bool = True, clear_faults: bool = False) -> None:
        """Set what the next command asks for."""

    def send_now(self) -> None:
        """Send the command at once, beside the cycle."""

    def read_batch(self, timeout_s: float) -> SourceBatch:
        """Whatever has arrived, waiting up to `timeout_s` for the first."""

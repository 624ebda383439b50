"""What the generic CAN driver knows of one current source: which frames it sends and hears, and what is in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

from drivers.current_source import SourceFault, SourceState, SourceTiming
from drivers.roles import UNNAMED
from protocols.can_frame import EXTENDED
from protocols.can_signals import FrameReader, FrameWriter, Signal
from protocols.e2e import Protection
from protocols.j1939 import parameter_group

UNNAMED_BITS = 32
"""So far up a bit is moved that has no name and whose number has another meaning here."""
_TAKEN = sum(SourceFault)

COMMAND, ENABLE, CLEAR = "command", "enable", "clear_faults"
CURRENT, STATE, FAULTS, CLOCK = "measured_current", "state", "faults", "clock"
COIL, ECU, SUPPLY, BOOTS = "coil_temperature", "ecu_temperature", "supply_voltage", "boot_count"
SERIAL, FIRMWARE, LAYOUT = "serial_number", "firmware", "layout"


@dataclass(frozen=True)
class SentFrame:
    """One frame that is sent in every cycle: a message, or a page of it.

    Attributes:
        name: of its message.
        identifier: without the mark of an extended one.
        extended, fd: its kind.
        writer: packs `command`, `enable` and `clear_faults`, as far as they are in it.
        protection: counter and checksum.
        j1939: whether frames of its parameter group from another address have the same meaning.
    """

    name: str
    identifier: int
    extended: bool
    fd: bool
    writer: FrameWriter
    protection: Protection
    j1939: bool = False


@dataclass(frozen=True)
class HeardMessage:
    """A message that is read; `period_s` is 0 if its period is unknown.

    One with pages shows each of them once in `pages` frames. One `by_group` is known by its J1939 parameter group.
    `request` is the frame that requests it in every period (`protocols.can_frame`); empty for one that the ECU sends
    without requests.
    """

    name: str
    size: int
    reader: FrameReader
    protection: Protection
    period_s: float
    roles: frozenset[str]
    pages: int = 1
    fd: bool = False
    by_group: bool = False
    request: bytes = b""


@dataclass(frozen=True)
class FaultSignal:
    """A fault that is told by a signal of its own: it is there at these numbers, or at any but 0."""

    field: str
    numbers: frozenset[int]
    fault: int

    def holds(self, number: float) -> bool:
        """Whether the signal tells the fault."""
        return int(number) in self.numbers if self.numbers else number != 0


@dataclass(frozen=True)
class EcuDescription:
    """One kind of current source.

    Attributes:
        name: as in the bench file.
        sent: what is sent in every cycle, in this order.
        heard: what is read, by identifier (`EXTENDED` set where it is extended).
        status: key of the message with the measured current.
        on_off: numbers of `enable` and `clear_faults` for on and off.
        states: the neutral state by the device's code.
        fault_bits: the neutral fault by the bit's mask in the word `faults`.
        fault_signals: faults with signals of their own.
        tick_us: length of a step of `clock` (us); `clock_modulus` steps after which it starts again.
        layout: what the identity's `layout` must show; None where nothing is to be proved.
        cyclic: commands go out every period, else when they change.
        command_timeout_s: after so long without a command the source is at 0 A by itself; None: not stated.
        timing: how often it tells what.
        low_A, high_A: what the set-point can hold.
        lacking: what is not there: name, and what is left without it.
        signals: message and signal (scaled to A, degC, V, us) of every role.
        pages: of a heard message with pages, the multiplexers' numbers of each that has a role.
        source_address: from which messages `by_group` must come; None: from the first address that is heard.
    """

    name: str
    sent: tuple[SentFrame, ...]
    heard: Mapping[int, HeardMessage]
    status: int
    on_off: Mapping[str, tuple[int, int]]
    timing: SourceTiming
    low_A: float
    high_A: float
    states: Mapping[int, SourceState] = field(default_factory=dict)
    fault_bits: Mapping[int, SourceFault] = field(default_factory=dict)
    fault_signals: tuple[FaultSignal, ...] = ()
    tick_us: float = 0.0
    clock_modulus: int = 0
    layout: int | None = None
    cyclic: bool = True
    command_timeout_s: float | None = None
    lacking: tuple[tuple[str, str], ...] = ()
    signals: Mapping[str, tuple[str, Signal]] = field(default_factory=dict)
    pages: Mapping[str, list[dict[str, int]]] = field(default_factory=dict)
    source_address: int | None = None

    @property
    def roles(self) -> frozenset[str]:
        """Everything that is read."""
        return frozenset(role for message in self.heard.values() for role in message.roles)

    @cached_property
    def reported_faults(self) -> int:
        """The neutral faults that it can tell."""
        bits = 0
        for fault in (*self.fault_bits.values(), *(signal.fault for signal in self.fault_signals)):
            bits |= fault
        return bits

    @cached_property
    def heard_groups(self) -> frozenset[int]:
        """J1939 parameter groups that are accepted from any address."""
        return frozenset(parameter_group(key) for key, message in self.heard.items() if message.by_group)

    def hears(self, identifier: int, extended: bool) -> bool:
        """Whether a frame belongs to a message that is read."""
        if extended and parameter_group(identifier) in self.heard_groups:
            return True
        return (identifier | EXTENDED if extended else identifier) in self.heard

    @property
    def fd(self) -> bool:
        """CAN FD frames are among those that are sent or heard."""
        return any(frame.fd for frame in self.sent) or any(message.fd for message in self.heard.values())

    def state(self, code: int) -> int:
        """The neutral state of a device's code; one without a name is shown as it is, out of the way."""
        if code in self.states:
            return self.states[code]
        return code + UNNAMED if code in set(SourceState) else code

    def faults(self, values: Mapping[str, float]) -> int:
        """The neutral fault bits of what was read; one without a name is shown, out of the way of the named ones."""
        word = int(values.get(FAULTS, 0))
        rest = word
        faults = 0
        for bit, meaning in self.fault_bits.items():
            rest &= ~bit
            if word & bit:
                faults |= meaning
        for signal in self.fault_signals:
            if signal.field in values and signal.holds(values[signal.field]):
                faults |= signal.fault
                if signal.field == FAULTS:
                    rest = 0
        return faults | rest & ~_TAKEN | (rest & _TAKEN) << UNNAMED_BITS

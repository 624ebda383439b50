"""A programmable supply as data: which commands it knows, how its lines look, what it can give.

A preset and a user's file have the same form; `supply_file` reads both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from drivers.current_source import SourceIdentity
from drivers.devices.output import AnalogueOutput, output_missing
from protocols.patterns import Pattern
from protocols.scpi import Command

Commands = tuple[Command, ...]

TERMINATORS = ("\n", "\r", "\r\n")
PARITIES = ("N", "E", "O")


@dataclass(frozen=True)
class SupplyLink:
    """How lines go over the wire; what belongs to a serial line counts for nothing on a network.

    Attributes:
        terminator: what ends a command.
        echo: every command comes back before its answer.
        acknowledge: what every command that is no query is answered with, None: with nothing.
        gap_s: least time between two commands (s).
    """

    terminator: str = "\n"
    echo: bool = False
    acknowledge: Pattern | None = None
    gap_s: float = 0.0
    baudrate: int = 9600
    bytesize: int = 8
    parity: str = "N"
    stopbits: float = 1


@dataclass(frozen=True)
class SupplyCommands:
    """What is sent for what; an empty tuple: the supply has no such command."""

    connect: Commands = ()
    identify: Commands = ()
    remote: Commands = ()
    local: Commands = ()
    prepare: Commands = ()
    clear: Commands = ()
    set_current: Commands = ()
    set_voltage_limit: Commands = ()
    output_on: Commands = ()
    output_off: Commands = ()
    measure_current: Commands = ()
    measure_voltage: Commands = ()
    read_output: Commands = ()
    error_queue: Commands = ()
    read_faults: Commands = ()


@dataclass(frozen=True)
class SupplyWatchdog:
    """The supply's own time-out: it switches its output off when it hears nothing for `time_s` (s).

    `start` sets it up, `stop` ends it, `feed` keeps it quiet; without a `feed` every command does.
    """

    time_s: float
    start: Commands
    stop: Commands = ()
    feed: Commands = ()


NO_ERROR = Pattern(r"^\s*[+-]?0+\b")
"""What an empty error queue answers by IEEE 488.2 and SCPI: error number 0."""


@dataclass(frozen=True)
class SupplyDescription:
    """One kind of supply.

    Attributes:
        name: of the preset, or of the user's file.
        maker, model, tried: for people; `tried` is empty or `unverified` (only the examples of
            the manual were tried).
        link, commands, watchdog: how it is spoken to; None: it has no time-out of its own.
        current_A, voltage_V: lowest and highest set-point; of the voltage None where it cannot be set.
        settling_s: time after which the current is that of a new set-point, the coil in it.
        identity: what its identity must look like, None: any.
        no_error: what an empty error queue answers.
        current, voltage: where the number stands in an answer; None: it is the answer.
        on: answers that say that the output is on.
        faults: bits of the answer to `read_faults`, and what each means (of `SourceFault`).
        output: an analogue output on Modbus, in place of commands; None: lines of text.
    """

    name: str
    link: SupplyLink
    commands: SupplyCommands
    current_A: tuple[float, float]
    voltage_V: tuple[float, float] | None = None
    watchdog: SupplyWatchdog | None = None
    maker: str = ""
    model: str = ""
    tried: str = ""
    settling_s: float = 0.3
    identity: Pattern | None = None
    no_error: Pattern = NO_ERROR
    current: Pattern | None = None
    voltage: Pattern | None = None
    on: tuple[str, ...] = ("1", "ON")
    faults: tuple[tuple[int, int], ...] = ()
    output: AnalogueOutput | None = None

    @property
    def measures(self) -> bool:
        """It tells what flows."""
        return self.output is None or self.output.measures

    @property
    def drives_zero(self) -> bool:
        """0 A is a set-point; else the output is switched off for it."""
        return self.current_A[0] <= 0.0 <= self.current_A[1]


@dataclass(frozen=True)
class SupplyConnection:
    """How to reach a supply.

    Attributes:
        url: a serial port, `socket://host:port` or `tcp://host:port`; of a module `modbus-tcp://`, `modbus-rtu:`.
        description: its language.
        poll_s: period of the questions for the current (s).
        timeout_s: longest wait for an answer (s).
        voltage_limit_V: of the output (V); None where it cannot be set.
        baudrate: Bd of a serial line; None: as described.
        identity: text that its identity must hold; empty: any.
        device_id: Modbus unit number.
    """

    url: str
    description: SupplyDescription
    poll_s: float = 0.1
    timeout_s: float = 0.5
    voltage_limit_V: float | None = None
    baudrate: int | None = None
    identity: str = ""
    device_id: int = 1


def current_range(given: Sequence[float]) -> tuple[float, float]:
    """Lowest and highest set-point of a list of two."""
    low, high = given
    return float(low), float(high)


def identity_of(answer: str) -> SourceIdentity:
    """Serial number and firmware of an answer to `*IDN?`: maker, model, serial number, firmware (IEEE 488.2)."""
    parts = [part.strip() for part in answer.split(",")]
    serial_number, firmware = (*parts[2:4], "", "")[:2] if len(parts) > 2 else (answer, "")
    return SourceIdentity(serial_number, firmware, 0)


def supply_missing(described: SupplyDescription) -> tuple[tuple[str, str], ...]:
    """What a supply cannot do, and what is left without it: a name, and words for people."""
    untried = (
        f"the supply's description is {described.tried}: it was written from the manufacturer's manual and has "
        "not been tested on a supply"
    )
    if described.output is not None:
        own = (*output_missing(described.output), ("trial", not described.tried, untried))
        return tuple((name, text) for name, has, text in own if not has)
    without = {
        "timeout": (
            described.watchdog is not None,
            "the supply has no communication time-out: if this host or the link fails, the supply maintains its "
            "current until it is switched off manually; the actuator's own watchdog still stops the motion",
        ),
        "coil-temperature": (
            False, "the coil's temperature is not measured: its limit is not monitored, and temperature windows are "
                "rejected"
        ),
        "voltage-limit": (
            described.voltage_V is not None,
            "the supply's voltage limit cannot be set from this host: set the limit manually; an open coil is detected "
            "only by the absence of current",
        ),
        "error-queue": (bool(described.commands.error_queue), "the supply does not report rejected commands"),
        "faults": (bool(described.faults), "a trip of the supply's own protection (overheating, mains failure) is "
            "detected only by its output state or its current"),
        "output-state": (
            bool(described.commands.read_output or not described.commands.output_on),
            "if the supply switches its output off itself, this is detected only by the absence of current",
        ),
        "trial": (not described.tried, untried),
    }
    return tuple((name, text) for name, (has, text) in without.items() if not has)

"""A supply's file: a programmable supply with text commands, or an analogue output on Modbus."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field

from drivers.current_source import SourceFault
from drivers.devices.output_file import is_output
from drivers.devices.supply import PARITIES, TERMINATORS
from drivers.devices.supply_file import COMMANDS, FAULTS
from drivers.register_maps.meanings import word
from protocols.patterns import Pattern, PatternError
from rig.files.quantity import Check
from rig.files.registers import BitsOrCondition, Modbus, QuantityEntry, Value, Values
from rig.files.section import DescriptionTable, OneOrMore, table_of_words

LARGEST_A, LARGEST_V = 1000.0, 1000.0
LONGEST_MS = 10_000.0
HIGHEST_BIT = 31
STOP_BITS = (1, 1.5, 2)


def _pattern(text: str) -> str:
    try:
        Pattern(text)
    except PatternError as error:
        raise ValueError(f"is not a valid regular expression: {error}") from error
    return text


def _value_pattern(text: str) -> str:
    if text and "value" not in Pattern(_pattern(text)).groups:
        raise ValueError("must capture the number in a group named value, such as '(?P<value>[-+0-9.]+)A'")
    return text


def _stop_bits(value: float) -> float:
    if value not in STOP_BITS:
        raise ValueError(f"must be one of {', '.join(map(str, STOP_BITS))}")
    return value


def _ordered(value: tuple[float, float]) -> tuple[float, float]:
    if not value[0] < value[1]:
        raise ValueError("the first value must be less than the second")
    return value


Regex = Annotated[str, Check(_pattern), Field(json_schema_extra={"format": "regex"})]
ValueRegex = Annotated[str, Check(_value_pattern), Field(json_schema_extra={"format": "regex"})]
Ampere = Annotated[float, Field(ge=-LARGEST_A, le=LARGEST_A)]
Volt = Annotated[float, Field(ge=-LARGEST_V, le=LARGEST_V)]
Currents = Annotated[tuple[Ampere, Ampere], Check(_ordered)]
Sent = Annotated[tuple[str, ...], Field(min_length=1), OneOrMore()]
Baudrate = Annotated[int, Field(ge=300, le=12_000_000)]
Parity = Literal[PARITIES]  # type: ignore[valid-type]  # the driver's own list serves schema and message
Timeout = Annotated[float, Field(ge=0.1, le=60.0)]
Bit = Annotated[int, Field(ge=0, le=HIGHEST_BIT)]


class _Supply(DescriptionTable):
    """Entries of both kinds."""

    format: Literal[1] | None = None
    maker: str | None = None
    model: str | None = None
    tried: str | None = Field(None, description="test status, such as \"unverified\"; shown on connection")
    settling_ms: float | None = Field(
        None, ge=1.0, le=LONGEST_MS,
        description="settling time of the current after a new set-point, with the coil connected (default 300)",
    )


class Link(DescriptionTable):
    """How lines go over the wire."""

    terminator: Literal[TERMINATORS] | None = None  # type: ignore[valid-type]  # the driver's own list
    echo: bool | None = Field(None, description="the supply echoes every command before its answer")
    acknowledge: Regex | None = Field(None, description="answer to commands that are not queries")
    gap_ms: float | None = Field(None, ge=0.0, le=1000.0, description="minimum time between two commands")
    baudrate: Baudrate | None = None
    bytesize: Literal[7, 8] | None = None
    parity: Parity | None = None
    stopbits: Annotated[float, Check(_stop_bits)] | None = Field(None, json_schema_extra={"enum": list(STOP_BITS)})


class Ranges(DescriptionTable):
    """What it gives."""

    current_A: Currents = Field(description="lowest and highest set-point (A)", examples=[[0, 5]])
    voltage_V: Annotated[tuple[Volt, Volt], Check(_ordered)] | None = Field(
        None, description="lowest and highest set-point (V)"
    )


Commands = table_of_words(
    "Commands", "Text sent for each command.",
    [name for name in COMMANDS if name not in {"set_current", "measure_current"}],
    Sent,
    set_current=(Sent, Field(examples=["CURR {current_A:.3f}"])),
    measure_current=(Sent, Field(
        examples=["MEAS:CURR?"], description="without a measured current, 0 A cannot be confirmed"
    )),
)  # fmt: skip


class Answers(DescriptionTable):
    """What its answers look like, where they are not plain."""

    identity: Regex | None = Field(None, description="required form of the answer to `identify`")
    no_error: Regex | None = Field(None, description="answer to `error_queue` if there is no error")
    current: ValueRegex | None = Field(None, description="regular expression that captures the current in the group "
        "`value`, such as (?P<value>[-+0-9.]+)")
    voltage: ValueRegex | None = Field(None, description="regular expression that captures the voltage in the "
        "group `value`")
    on: Sent | None = Field(None, description="answers to `read_output` if the output is on")


Faults = table_of_words("Faults", "Bits in the answer to `read_faults`.", FAULTS, Bit)


class Watchdog(DescriptionTable):
    """Its own time-out: it switches its output off when it hears nothing."""

    time_s: Timeout = Field(examples=[2.0])
    start: Sent = Field(examples=["SYST:WATC 2"])
    stop: Sent | None = None
    feed: Sent | None = None


class SupplyFile(_Supply):
    """A programmable supply that drives the coil."""

    link: Link | None = None
    range: Ranges
    commands: Commands  # type: ignore[valid-type]  # a class made of the program's words
    answers: Answers | None = None
    faults: Faults | None = None  # type: ignore[valid-type]  # the same
    watchdog: Watchdog | None = None


class OutputRange(DescriptionTable):
    """What it gives."""

    current_A: Currents = Field(description="lowest and highest current (A)", examples=[[0, 2]])


class OutputLink(DescriptionTable):
    """Its serial line."""

    baudrate: Baudrate | None = None
    parity: Parity | None = None


class OutputTimeout(DescriptionTable):
    """Its own time-out: its output goes to 0 A when it hears nothing."""

    time_s: Timeout = Field(examples=[1.0])
    start: Values | None = None
    feed: Values | None = None
    stop: Values | None = None


OutputFaults = table_of_words("OutputFaults", "Bits of fault_bits.", map(word, SourceFault), BitsOrCondition)


class OutputFile(_Supply):
    """An analogue output on Modbus that commands the coil's current."""

    range: OutputRange
    link: OutputLink | None = None
    modbus: Modbus | None = None
    quantities: dict[str, QuantityEntry] = Field(json_schema_extra={"required": ["current"]})
    identity: dict[str, Value] | None = None
    prepare: Values | None = None
    faults: OutputFaults | None = None  # type: ignore[valid-type]  # a class made of the program's words
    watchdog: OutputTimeout | None = None


def model_of(table: Mapping[str, Any]) -> type[SupplyFile] | type[OutputFile]:
    """What a table must fit."""
    return OutputFile if is_output(table) else SupplyFile

"""A register map's file: location of a controller's values, meaning of its codes, writes of each command."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import ConfigDict, Discriminator, Field, Tag
from pydantic.config import JsonDict

from drivers.capabilities import PRESSURE_LEVELS
from drivers.register_maps.meanings import word
from drivers.register_maps.read_recipes import COMMANDS, KINDS, STEPS
from drivers.roles import Command, FaultBit, Input, Pressure, ProgramPhase, Result, State, WatchdogAction, Waveform
from rig.files.registers import (
    Address,
    BitsOrCondition,
    Codes,
    CodesOrCondition,
    Conditions,
    Modbus,
    QuantityEntry,
    StateEntry,
    Time,
    Value,
    Values,
    Written,
)
from rig.files.section import DescriptionTable, OneOrMore, table_of_words

if TYPE_CHECKING:
    from enum import Enum


class WriteStep(Written):
    """Write these values, in one request where they are neighbours."""

    description: str | None = None


class WaitStep(DescriptionTable):
    """Wait until the device shows something, at most so long."""

    wait: Conditions
    within: Time = Field(examples=["1 s"])
    description: str | None = None


class PauseStep(DescriptionTable):
    """Do nothing for so long."""

    pause: Time
    description: str | None = None


class RecipeStep(DescriptionTable):
    """The steps of one of [recipes]."""

    recipe: str
    description: str | None = None


def _step(value: object) -> str | None:
    given = [key for key in STEPS if isinstance(value, Mapping) and key in value]
    return f"[{given[0].capitalize()}Step]" if len(given) == 1 else None


Step = Annotated[
    Annotated[WriteStep, Tag("[WriteStep]")] | Annotated[WaitStep, Tag("[WaitStep]")]
    | Annotated[PauseStep, Tag("[PauseStep]")] | Annotated[RecipeStep, Tag("[RecipeStep]")],
    Discriminator(
        _step, custom_error_type="no_step",
        custom_error_message="must be a step such as {write = {command = 3}}, or a list of steps; each step "
            f"contains one of {', '.join(STEPS)}",
    ),
]
Recipe = Annotated[tuple[Step, ...], Field(min_length=1), OneOrMore()]


class Watchdog(DescriptionTable):
    """What the controller's watchdog wants to hear, and after how long it trips."""

    kind: Literal[KINDS] | None = None  # type: ignore[valid-type]  # the driver's own list
    time: Time | None = None
    write: Values | None = None
    span: tuple[str, str] | None = None
    tested: Literal[PRESSURE_LEVELS] | None = Field(  # type: ignore[valid-type]  # the driver's own list
        None, description="pressure (or power) at which the watchdog works and is tested; default off"
    )


class Setpoint(DescriptionTable):
    """Writes for each streamed set-point: values in one write, or steps with a handshake."""

    write: Values | None = None
    span: tuple[str, str] | None = Field(None, description="first and last quantity; all registers from the first "
        "to the last are written")
    steps: Recipe | None = None
    while_off: bool | None = Field(None, description="whether set-points may be sent while the pressure or power is "
        "off; default true")


class Indirect(DescriptionTable):
    """Registers that show what others hold, so that the status is one contiguous read."""

    pointers: Address = Field(examples=[100])
    data: Address = Field(examples=[200])
    quantities: tuple[str, ...] = Field(min_length=1, examples=[["state", "position"]])
    function: Literal["holding", "input"] | None = None
    pointer_for: Literal["register", "value"] | None = None
    pointer_registers: Literal[1, 2] | None = None
    pointer_offset: int | None = Field(None, ge=-0xFFFF, le=0xFF_FFFF)


def _words(meaning: tuple[Enum, ...]) -> list[str]:
    return [word(member) for member in meaning]  # type: ignore[arg-type]  # members of IntEnum and IntFlag


States = table_of_words("States", "Conditions for each state.", _words(tuple(State)), StateEntry)
Pressures = table_of_words(
    "Pressures", "Conditions for the pressure states.", _words((Pressure.OFF, Pressure.LOW, Pressure.ON)),
    CodesOrCondition,
)
Faults = table_of_words("Faults", "Bits of fault_bits.", _words(tuple(FaultBit)), BitsOrCondition)
Inputs = table_of_words("Inputs", "Bits of inputs.", _words(tuple(Input)), BitsOrCondition)
Phases = table_of_words("Phases", "Codes of phase.", _words(tuple(ProgramPhase)), Codes)
Results = table_of_words("Results", "Codes of result.", _words(tuple(Result)), Codes)
CommandCodes = table_of_words("CommandCodes", "Codes for commands.", _words(tuple(Command)), Codes)
Waveforms = table_of_words("Waveforms", "Codes for waveforms.", _words(tuple(Waveform)), Codes)
Actions = table_of_words("Actions", "Codes for watchdog actions.", _words(tuple(WatchdogAction)), Codes)
Commands = table_of_words("Commands", "Register writes for each command.", COMMANDS, Recipe)


NEEDED: JsonDict = {
    "required": ["quantities", "state"],
    "properties": {
        "quantities": {"required": ["position"]}, "state": {"required": ["hold"]}, "pressure": {"required": ["off"]},
    },
}
"""What a map has that is not based on another one; `drivers.register_maps.needs` checks it of both."""


class RegisterMapFile(DescriptionTable):
    """A whole register map; with a `base` only what differs from it."""

    model_config = ConfigDict(json_schema_extra={"anyOf": [{"required": ["base"]}, NEEDED]})

    format: Literal[1] | None = None
    name: str | None = None
    description: str | None = None
    unverified: bool | None = None
    base: str | None = Field(None, description="name of a built-in register map")
    without: tuple[str, ...] | None = Field(
        None, description="entries in the base map that this device does "
            "not support", examples=[["commands.start", "table"]]
    )
    modbus: Modbus | None = None
    quantities: dict[str, QuantityEntry] | None = None
    identity: dict[str, Value] | None = None
    state: States | None = None  # type: ignore[valid-type]  # a class made of the program's words
    pressure: Pressures | None = None  # type: ignore[valid-type]  # the same
    faults: Faults | None = None  # type: ignore[valid-type]  # the same
    inputs: Inputs | None = None  # type: ignore[valid-type]  # the same
    phase: Phases | None = None  # type: ignore[valid-type]  # the same
    results: Results | None = None  # type: ignore[valid-type]  # the same
    command_codes: CommandCodes | None = None  # type: ignore[valid-type]  # the same
    waveforms: Waveforms | None = None  # type: ignore[valid-type]  # the same
    watchdog_actions: Actions | None = None  # type: ignore[valid-type]  # the same
    commands: Commands | None = None  # type: ignore[valid-type]  # the same
    recipes: dict[str, Recipe] | None = None
    setpoint: Setpoint | None = None
    watchdog: Watchdog | None = None
    table: Written | None = None
    indirect: Indirect | None = None

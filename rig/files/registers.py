"""Tables that register maps and analogue outputs share: [modbus], [quantities], codes, bits, conditions, values."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag

from drivers.register_maps.quantity import SPACES, TYPES
from drivers.register_maps.read_meanings import LARGEST_CODE
from drivers.register_maps.read_quantities import ACCESS, ORDERS
from protocols.near_miss import meant
from protocols.wire_units import ALIASES, UNITS
from rig.files.quantity import Check, Quantity
from rig.files.section import DescriptionTable, OneOrMore

LARGEST = 65_535 + 499_999
"""An address with the largest `first_address`."""
LARGEST_NUMBER = 1e300

Address = Annotated[int, Field(ge=0, le=LARGEST)]
Addresses = Annotated[tuple[Address, ...], Field(min_length=1, max_length=4), OneOrMore()]
Start = Annotated[int, Field(ge=0, le=499_999)]
Order = Literal[ORDERS]  # type: ignore[valid-type]  # the driver's own list serves schema and message
Space = Literal[SPACES]  # type: ignore[valid-type]  # the same
Time = Annotated[float, Quantity("time", "0 s", "600 s", above=True)]


_UNITS = tuple(name for name, unit in UNITS.items() if unit.dimension != "temperature")


def _unit(name: str) -> str:
    if ALIASES.get(name, name) not in _UNITS:
        raise ValueError(f"unknown unit; {meant(name, filter(None, _UNITS))}")
    return name


def _value(value: object) -> object:
    if isinstance(value, (bool, str)) or (isinstance(value, (int, float)) and abs(value) <= LARGEST_NUMBER):
        return value
    raise ValueError('must be a number, true, false or a name such as "$target"')


def _range(value: tuple[int, int]) -> tuple[int, int]:
    if value[0] > value[1]:
        raise ValueError("must be a range [first, last], such as [50, 59]")
    return value


def _starts(value: object) -> str:
    return "[FirstAddresses]" if isinstance(value, Mapping) else "[one]"


def _is_condition(value: object) -> bool:
    """A table, or a list that holds one."""
    return isinstance(value, Mapping) or (isinstance(value, tuple) and any(isinstance(one, Mapping) for one in value))


def _codes_or_condition(value: object) -> str:
    return "[all]" if value is True else "[Condition]" if _is_condition(value) else "[numbers]"


Unit = Annotated[str, Check(_unit), Field(json_schema_extra={"enum": [*_UNITS, *ALIASES]})]
Value = Annotated[bool | int | float | str, Check(_value, alone=True)]
Values = Annotated[dict[str, Value], Field(min_length=1)]
Range = Annotated[tuple[int, int], Check(_range)]
Number = Annotated[float, Field(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]


class FirstAddresses(DescriptionTable):
    """What the file calls the first register or coil of each space."""

    holding: Start | None = None
    input: Start | None = None
    coil: Start | None = None
    discrete: Start | None = None


class Modbus(DescriptionTable):
    """What holds for all quantities that do not state otherwise."""

    word_order: Order | None = None
    byte_order: Order | None = None
    function: Space | None = None
    first_address: Annotated[
        Annotated[Start, Tag("[one]")] | Annotated[FirstAddresses, Tag("[FirstAddresses]")], Discriminator(_starts)
    ] | None = None
    write_function: Literal[6, 16] | None = None
    coil_function: Literal[5, 15] | None = None
    largest_gap: int | None = Field(None, ge=0, le=124)
    largest_read: int | None = Field(None, ge=1, le=125)
    unreadable: tuple[Range, ...] | None = Field(None, examples=[[[50, 59], [80, 99]]])
    read_while_writing: bool | None = None


class QuantityEntry(DescriptionTable):
    """One value in a device's registers or coils."""

    address: Addresses = Field(examples=[100])
    function: Space | None = None
    type: Literal[tuple(TYPES)] | None = None  # type: ignore[valid-type]  # the driver's own list
    scale: Number | None = None
    offset: Number | None = None
    unit: Unit | None = None
    word_order: Order | None = None
    byte_order: Order | None = None
    access: Literal[ACCESS] | None = None  # type: ignore[valid-type]  # the driver's own list
    write_function: Literal[5, 6, 15, 16, 22] | None = None
    length: int | None = Field(None, ge=1, le=120)
    bit: int | None = Field(None, ge=0, le=15)
    count: int | None = Field(None, ge=1, le=120)
    description: str | None = None


class Condition(DescriptionTable):
    """One comparison of a quantity."""

    quantity: str = Field(examples=["ready"])
    bit: int | None = Field(None, ge=0, le=63)
    equals: Value | None = None
    not_equals: Value | None = None
    at_least: Value | None = None
    at_most: Value | None = None
    one_of: Annotated[tuple[Value, ...], Field(min_length=1), OneOrMore()] | None = None


Conditions = Annotated[tuple[Condition, ...], Field(min_length=1), OneOrMore()]
Code = Annotated[int, Field(ge=0, le=LARGEST_CODE)]
Codes = Annotated[tuple[Code, ...], Field(min_length=1), OneOrMore()]
Bits = Annotated[tuple[Annotated[int, Field(ge=0, le=63)], ...], Field(min_length=1), OneOrMore()]
CodesOrCondition = Annotated[
    Annotated[Codes, Tag("[numbers]")] | Annotated[Conditions, Tag("[Condition]")],
    Discriminator(lambda value: "[Condition]" if _is_condition(value) else "[numbers]"),
]
StateEntry = Annotated[
    Annotated[Codes, Tag("[numbers]")] | Annotated[Conditions, Tag("[Condition]")]
    | Annotated[Literal[True], Tag("[all]")],
    Discriminator(_codes_or_condition),
]
BitsOrCondition = Annotated[
    Annotated[Bits, Tag("[numbers]")] | Annotated[Conditions, Tag("[Condition]")],
    Discriminator(lambda value: "[Condition]" if _is_condition(value) else "[numbers]"),
]


class Written(DescriptionTable):
    """Values that are written together."""

    write: Values
    span: tuple[str, str] | None = Field(None, description="first and last quantity; all registers from the first "
        "to the last are written")

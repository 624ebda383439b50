"""A roles file: the meaning of a DBC file's signals, and the protection of its messages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag

from drivers.devices.ecu_roles import FAULT_NAMES, ROLE_KEYS, SENDING, STATES
from drivers.devices.role_protection import KEYS, MODES, PROFILES
from drivers.devices.role_reading import SCALING, units_of
from protocols.j1939 import HIGHEST_ADDRESS
from rig.files.quantity import Check, Quantity
from rig.files.section import DescriptionTable, OneOrMore, table_of_words

LARGEST_SCALE = 1e9
LARGEST = 1.7e308
"""Largest number of a constant."""


def _signal(name: str) -> str:
    if name.count(".") != 1:
        raise ValueError('must be a string of the form "Message.signal", with names from the DBC file')
    return name


def _number(value: object) -> object:
    if isinstance(value, (bool, int, str)):
        return value
    raise ValueError("must be a raw integer, true, false, or the name of a value in quotes")


def _constant(value: object) -> object:
    if isinstance(value, float) and abs(value) <= LARGEST:
        return value
    return _number(value)


def _scale(value: object) -> object:
    if value == 0.0:
        raise ValueError("must not be 0, because every value would be the same")
    return value


def _table(value: object) -> str:
    return "[Table]" if isinstance(value, Mapping) else "[plain]"


def _fault(value: object) -> str:
    if isinstance(value, Mapping):
        return "[FaultSignal]"
    return "[bit]" if isinstance(value, int) and not isinstance(value, bool) else "[name]"


Name = Annotated[str, Check(_signal), Field(json_schema_extra={"pattern": r"^\w+\.\w+$"})]
Number = Annotated[bool | int | str, Check(_number, alone=True)]
Numbers = Annotated[tuple[Number, ...], OneOrMore()]
Constant = Annotated[bool | int | float | str, Check(_constant, alone=True)]
Duration = Annotated[float, Quantity("time", "0 s", "60 s", above=True)]
FullScale = Annotated[float, Quantity("current", "0 A", "100000 A", above=True)]
Offset = Annotated[float, Field(ge=-LARGEST_SCALE, le=LARGEST_SCALE)]
Scale = Annotated[float, Field(ge=-LARGEST_SCALE, le=LARGEST_SCALE), Check(_scale, alone=True)]
Byte = Annotated[int, Field(ge=0, le=0xFF)]
Whole = Annotated[int, Field(ge=0)]
Address = Annotated[int, Field(ge=0, le=HIGHEST_ADDRESS)]


class FaultSignal(DescriptionTable):
    """A fault with a signal of its own."""

    signal: Name
    value: Numbers | None = None


Fault = Annotated[
    Annotated[FaultSignal, Tag("[FaultSignal]")] | Annotated[int, Field(ge=0, le=63), Tag("[bit]")]
    | Annotated[str, Tag("[name]")],
    Discriminator(_fault),
]

ABOUT: Mapping[str, str] = {
    "command": "set-point of the coil current",
    "enable": "switches the output stage on and off",
    "clear_faults": "command that clears the ECU's latched faults",
    "measured_current": "the current measured by the ECU",
    "state": "state of the output stage: raw numbers or value names of the DBC file for off, enabled, ...",
    "faults": "signal with the fault word; each fault is a bit or a named value of this word, or a separate signal",
    "coil_temperature": "temperature of the coil",
    "ecu_temperature": "temperature of the ECU",
    "supply_voltage": "supply voltage of the output stage",
    "clock": "the ECU's own clock, a free-running counter",
    "serial_number": "serial number",
    "firmware": "firmware version",
    "layout": "version of the frame layout; value: the version of this DBC file, checked on connection",
    "boot_count": "number of times the ECU has started",
}


def _entry(role: str, key: str) -> Any:  # noqa: ANN401 - a type
    if key == "unit":
        return Annotated[str, Field(json_schema_extra={"enum": list(units_of(role))})]
    if key == "full_scale":
        return FullScale
    if key in SCALING:
        return Scale if key == "scale" else Offset
    return Numbers if key in STATES else Fault if key in FAULT_NAMES else Number


def _role(role: str) -> Any:  # noqa: ANN401 - a type
    """What a role's entry may be: the name of its signal, or a table."""
    fields: dict[str, Any] = {
        key.replace("-", "_"): (_entry(role, key) | None, Field(None, alias=key if "-" in key else None))
        for key in ROLE_KEYS[role][1:]
    }
    fields["signal"] = (Name | None, None) if role == "faults" else (Name, Field(examples=["Message.signal"]))
    table = table_of_words("Table", ABOUT[role], (), str, **fields)
    return Annotated[Annotated[Name, Tag("[plain]")] | Annotated[table, Tag("[Table]")], Discriminator(_table)]


_SHAPES: Mapping[str, Any] = {
    "data_ids": Annotated[tuple[Byte, ...], Field(min_length=16, max_length=16)],
    "counter": str, "crc": str, "nibble": str, "reflected": bool, "data_id_first": bool,
}  # fmt: skip
_NEEDED: Mapping[str, tuple[str, ...]] = {
    "counter": ("counter",), "counter+crc": ("counter", "crc", "polynomial"), "e2e-1": ("data_id",),
    "e2e-2": ("data_ids",), "e2e-5": ("data_id",), "e2e-11": ("data_id",),
}  # fmt: skip


def _protection(profile: str) -> type[DescriptionTable]:
    """The table of one profile."""
    fields: dict[str, Any] = {"profile": (Literal[profile], ...)}
    for key in KEYS[profile][1:]:
        shape = _SHAPES.get(key, Whole)
        if key == "data_id_mode":
            shape = Literal[MODES] if profile == "e2e-1" else Literal["both", "nibble"]
        needed = key in _NEEDED.get(profile, ())
        fields[key] = (shape, Field(examples=[] if shape is str else [1])) if needed else (shape | None, None)
    return table_of_words(f"Protection {profile}", f"Protection by {profile}.", (), str, **fields)


def _profile(value: object) -> str | None:
    profile = value.get("profile") if isinstance(value, Mapping) else None
    return f"[Protection {profile}]" if profile in PROFILES else None


_PROTECTIONS: Any = None
for _name in PROFILES:
    _one: Any = Annotated[_protection(_name), Tag(f"[Protection {_name}]")]
    _PROTECTIONS = _one if _PROTECTIONS is None else _PROTECTIONS | _one
_NO_PROFILE: Any = {"problems": [(("profile",), f"must be one of {', '.join(PROFILES)}")]}
Protected = Annotated[
    _PROTECTIONS,
    Discriminator(
        _profile, custom_error_type="no_profile", custom_error_message="unknown profile",
        custom_error_context=_NO_PROFILE,
    ),
]
Constants = Annotated[
    Annotated[Constant, Tag("[plain]")] | Annotated[dict[str, Constant], Tag("[Table]")], Discriminator(_table)
]

Identifier = Annotated[int, Field(ge=0, le=0x1FFF_FFFF)]


class CanRequest(DescriptionTable):
    """A data frame that requests a message."""

    id: Identifier = Field(examples=[0x080], description="identifier of the request")
    extended: bool | None = Field(None, description="29-bit identifier (default: if the identifier exceeds 0x7FF)")
    data: tuple[Byte, ...] | None = Field(None, max_length=8, description="data bytes (default none)")


Request = Literal["remote"] | CanRequest

Roles = table_of_words("Roles", "Roles of the signals.", (), str, **{
    role: (_role(role), Field(description=ABOUT[role], examples=["Message.signal"]))
    if role in {"command", "measured_current"} else (_role(role) | None, Field(None, description=ABOUT[role]))
    for role in ROLE_KEYS
})  # fmt: skip


class RolesFile(Roles):  # type: ignore[valid-type,misc]  # a class made of the program's words
    """What the signals of a DBC file mean: docs/how-to/connect-an-ecu-by-dbc.md."""

    constants: dict[str, Constants] | None = Field(
        None, description='"Message.signal" = number or name: constant signals in the transmitted messages'
    )
    protection: dict[str, Protected] | None = Field(None, description="counter and checksum of each message")
    periods: dict[str, Duration] | None = Field(
        None, description="period of a message, if the DBC file does not state it"
    )
    requests: dict[str, Request] | None = Field(
        None, description='messages that the ECU sends only on request: "remote" (a remote frame) or the data frame '
            "that requests the message; the request is sent in every period of the message"
    )
    source_address: Address | None = Field(
        None, description="J1939: address of the ECU (default: the first address from which its messages arrive, if "
            "the address in the DBC file is the placeholder 0xFE or 0xFF)"
    )
    own_address: Address | None = Field(
        None, description="J1939: source address of the transmitted messages (default: the address in the DBC file)"
    )
    sending: Literal[SENDING] | None = Field(  # type: ignore[valid-type]  # the driver's own list
        None, description="transmission mode of the commands (default cyclic)"
    )
    command_timeout: Duration | None = Field(
        None, description="time without commands after which the ECU sets 0 A; omit this entry if the ECU has "
            "no such time-out"
    )

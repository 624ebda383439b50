"""A current source as data: a DBC file with its signals, a TOML file that says what they mean."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any

from drivers.can_library import import_can
from drivers.current_source import SourceFault, SourceState
from drivers.devices.description_file import all_of, distinct, only, read_description, read_text, table, text, whole
from drivers.roles import UNNAMED
from protocols.current_frames import (
    CoilCommand,
    CoilStatus,
    CoilTemperature,
    CurrentFrames,
    EcuIdentity,
    Message,
    Signal,
)
from protocols.errors import LocalProtocolError

FOLDER = Path(__file__).parent
PROFILE = "autosar-e2e-1"
DRIVER = "can"
DBC_ENCODING = "cp1252"
"""What most tools write a DBC in."""
LONGEST = 8
"""Bytes of a classic CAN frame."""
UNNAMED_BITS = 32
"""So far up a bit is moved that has no name and whose number has another meaning here."""

_ROLES = {
    "command": CoilCommand._fields, "status": CoilStatus._fields, "temperature": CoilTemperature._fields,
    "identity": EcuIdentity._fields,
}
_TABLES = ("driver", "dbc", "layout", "device_time_tick_us", "protection", *_ROLES, "codes", "bits")
_TAKEN = sum(SourceFault)
COUNTER_START, COUNTER_BITS = 8, 4
"""Where E2E profile 1 has its counter: low nibble of byte 1, behind the CRC in byte 0."""

_UNITS = {
    "setpoint_A": ("A",), "current_A": ("A",), "duty_percent": ("%",), "coil_degC": ("degC", "°C", "C"),
    "ecu_degC": ("degC", "°C", "C"), "supply_V": ("V",),
}
_TIME_UNITS = {"s": 1e6, "ms": 1e3, "us": 1.0, "µs": 1.0}


class SourceDescription:
    """What the generic driver needs to know of one kind of current source.

    Args:
        name: as in the bench file.
        data: contents of its TOML file.
        signals: its DBC's messages, by name.

    Attributes:
        frames: packs and unpacks its messages.
        layout: what its identity must show.

    Raises:
        LocalProtocolError: the description contradicts itself or the DBC.
    """

    def __init__(self, name: str, data: Mapping[str, Any], signals: Mapping[str, Any]) -> None:
        self.name = name
        only(data, _TABLES, "description")
        if data.get("driver", DRIVER) != DRIVER:
            raise LocalProtocolError(f'driver = {data["driver"]!r:.40}: a current source is driven by "{DRIVER}"')
        self.layout = whole(data.get("layout"), 0, 0xFFFFFFFF, "layout")
        tick_us = whole(data.get("device_time_tick_us"), 1, 1_000_000, "device_time_tick_us")
        roles = {role: _fields(data, role, signals) for role in _ROLES}
        ids = _data_ids(table(data, "protection", "protection"), roles)
        messages = {role: _message(roles[role], signals, ids) for role in _ROLES}
        _check_scales(messages)
        self.frames = CurrentFrames(**messages, tick_us=tick_us)
        _check_messages(messages, tick_us)
        status = messages["status"].signals
        states = _codes(data, "codes", "state", status["state"].high)
        faults = _codes(data, "bits", "fault", status["faults"].length - 1)
        self._states = {code: int(_member(SourceState, name)) for name, code in states.items()}
        all_of(states, ("off", "enabled"), "[codes.state]", "every current source")
        self._faults = [(1 << bit, int(_member(SourceFault, name))) for name, bit in faults.items()]
        self._named = sum(bit for bit, _ in self._faults)

    def state(self, code: int) -> int:
        """The neutral state of a device's code; one without a name is shown as it is, out of the way."""
        if code in self._states:
            return self._states[code]
        return code + UNNAMED if code in set(SourceState) else code

    def faults(self, word: int) -> int:
        """The neutral fault bits of a device's word; one without a name is shown, out of the way of the named ones."""
        rest = word & ~self._named
        shown = rest & ~_TAKEN | (rest & _TAKEN) << UNNAMED_BITS
        return sum(meaning for bit, meaning in self._faults if word & bit) | shown


@functools.cache
def current_source(name: str) -> SourceDescription:
    """The description of that name.

    Raises:
        LocalProtocolError: there is none, or it contradicts itself.
    """
    if name not in current_source_names():
        raise LocalProtocolError(f"no current source {name!r}; known: {', '.join(current_source_names())}")
    path = FOLDER / f"{name}_ecu.toml"
    data = read_description(path)
    try:
        dbc = FOLDER / text(data.get("dbc"), "dbc")
        return SourceDescription(name, data, _messages(dbc))
    except LocalProtocolError as error:
        raise LocalProtocolError(f"{path}: {error}") from error


def current_source_names() -> tuple[str, ...]:
    """Names of the current sources described here."""
    return tuple(sorted(path.stem.removesuffix("_ecu") for path in FOLDER.glob("*_ecu.toml")))


def _messages(path: Path) -> dict[str, Any]:
    """The messages of a DBC file.

    Raises:
        LocalProtocolError: it cannot be read, or is no DBC.
    """
    content = read_text(path, DBC_ENCODING)
    # python-can first: it must not load its MF4 reader, and cantools would have it do so.
    import_can()
    from cantools.database.can import Database

    database = Database()
    try:
        database.add_dbc_string(content)
    except Exception as error:  # the library raises its parser's errors, its own, and plain ones of many kinds
        raise LocalProtocolError(f"{path}: not a DBC file that can be read: {error}") from error
    return {message.name: message for message in database.messages}


def _fields(data: Mapping[str, Any], role: str, messages: Mapping[str, Any]) -> dict[str, str]:
    """Which signal gives which field of a message.

    Raises:
        LocalProtocolError: the table is missing, names a field nobody knows, or a message that the DBC has not.
    """
    given = table(data, role, role)
    only(given, ("message", *_ROLES[role]), f"[{role}]")
    if "message" not in given:
        raise LocalProtocolError(f"[{role}] message is missing; it names a message of the DBC")
    fields = {field: text(name, f"[{role}] {field}") for field, name in given.items()}
    if (name := fields["message"]) not in messages:
        raise LocalProtocolError(f"[{role}]: the DBC has no message {name!r}; it has {', '.join(messages)}")
    return fields


def _data_ids(protection: Mapping[str, Any], roles: Mapping[str, Mapping[str, str]]) -> dict[str, int]:
    """The data ids of the protected messages; command and status are always protected.

    Raises:
        LocalProtocolError: another profile, no id for one of the two, or an id for a message that is not used.
    """
    if (profile := protection.get("profile")) != PROFILE:
        raise LocalProtocolError(f"[protection] profile: protection {profile!r:.40} is not {PROFILE!r}")
    ids = table(protection, "data_ids", "protection.data_ids")
    used = [fields["message"] for fields in roles.values()]
    only(ids, used, "[protection] data_ids")
    all_of(ids, used[:2], "[protection] data_ids", "the checksum of command and status")
    return {name: whole(value, 0, 0xFFFF, f"[protection] data_ids.{name}") for name, value in ids.items()}


def _message(
    fields: Mapping[str, str], messages: Mapping[str, Any], data_ids: Mapping[str, int]
) -> Message:
    """One message: the fields the TOML file names, where the DBC has them.

    Raises:
        LocalProtocolError: the DBC has no such signal, or one that this driver cannot read.
    """
    name = fields["message"]
    given = messages[name]
    if given.is_extended_frame or given.length > LONGEST:
        raise LocalProtocolError(f"message {name!r}: only standard identifiers and at most {LONGEST} bytes are read")
    by_name = {item.name: item for item in given.signals}
    signals: dict[str, Signal] = {}
    for field, wanted in fields.items():
        if field == "message":
            continue
        signal = by_name.get(wanted)
        if signal is None:
            raise LocalProtocolError(f"message {name!r} has no signal {wanted!r}; it has {', '.join(by_name)}")
        if signal.byte_order != "little_endian" or signal.offset != 0 or signal.is_float:
            raise LocalProtocolError(f"signal {wanted!r}: only little-endian integers without an offset can be read")
        if signal.multiplexer_ids:
            raise LocalProtocolError(f"signal {wanted!r} is multiplexed: it is not in every frame, and cannot be read")
        signals[field] = Signal(
            signal.name, signal.start, signal.length, signal.is_signed, float(signal.scale), signal.unit or ""
        )
    return Message(given.frame_id, given.length, signals, data_ids.get(name))


def _codes(data: Mapping[str, Any], kind: str, name: str, high: int) -> dict[str, int]:
    """A table of codes or bits, each a whole number up to `high` and given once.

    Raises:
        LocalProtocolError: it is not so.
    """
    place = f"{kind}.{name}"
    given = table(table(data, kind, kind), name, place)
    codes = {str(key): whole(value, 0, high, f"[{place}] {key}") for key, value in given.items()}
    distinct(codes, f"[{place}]")
    return codes


def _member(meaning: type[IntEnum | IntFlag], name: str) -> IntEnum | IntFlag:
    """The neutral term of that slug.

    Raises:
        LocalProtocolError: there is none.
    """
    for member in meaning:
        if str(member.name).lower().replace("_", "-") == name:
            return member
    known = ", ".join(str(member.name).lower().replace("_", "-") for member in meaning)
    raise LocalProtocolError(f"{name!r} is not one of {known}")


def _check_messages(messages: Mapping[str, Message], tick_us: int) -> None:
    """Hold the four messages, each of whose fields has its signal, against what the driver reads from them.

    Raises:
        LocalProtocolError: an identifier or bits used twice, a counter that the protection does not see, or another
            tick of the device's clock than the DBC states.
    """
    identifiers: dict[int, str] = {}
    for role, message in messages.items():
        if message.identifier in identifiers:
            raise LocalProtocolError(
                f"[{role}] and [{identifiers[message.identifier]}] are both frame 0x{message.identifier:03X}"
            )
        identifiers[message.identifier] = role
        _check_places(role, message)
    _check_clock(messages["status"].signals["device_time_ticks"], tick_us)


def _check_scales(messages: Mapping[str, Message]) -> None:
    """Hold every signal's scale and unit against its field.

    Raises:
        LocalProtocolError: a scale that is none, or a value in another unit.
    """
    for message in messages.values():
        for field, signal in message.signals.items():
            _check_scale(field, signal)


def _check_places(role: str, message: Message) -> None:
    taken: dict[int, str] = {}
    if message.data_id is not None:
        counter = message.signals.get("counter")
        if counter is None or (counter.start, counter.length) != (COUNTER_START, COUNTER_BITS):
            raise LocalProtocolError(
                f"[{role}] counter: E2E profile 1 has it behind the CRC, in the {COUNTER_BITS} bits from bit "
                f"{COUNTER_START} on; the DBC has it elsewhere, where the protection would not see it"
            )
        taken = dict.fromkeys(range(COUNTER_START), "the CRC")
    for field, signal in message.signals.items():
        for bit in range(signal.start, signal.start + signal.length):
            if bit >= 8 * message.length:
                raise LocalProtocolError(f"[{role}] {field}: {signal.name!r} ends beyond the message's last byte")
            if bit in taken:
                raise LocalProtocolError(f"[{role}] {field}: {signal.name!r} and {taken[bit]} both use bit {bit}")
            taken[bit] = repr(signal.name)


def _check_scale(field: str, signal: Signal) -> None:
    if not math.isfinite(signal.scale) or signal.scale <= 0.0:
        raise LocalProtocolError(f"{field}: scale {signal.scale:g} of {signal.name!r} must be more than 0")
    units = _UNITS.get(field)
    if units is not None and signal.unit not in {"", *units}:
        raise LocalProtocolError(
            f"{field}: {signal.name!r} is in {signal.unit!r}; must be in {units[0]}: give scale and unit so in the DBC"
        )


def _check_clock(ticks: Signal, tick_us: int) -> None:
    """The tick that the TOML file states against the DBC's own scale, where that says which unit it has.

    Raises:
        LocalProtocolError: they differ.
    """
    unit_us = _TIME_UNITS.get(ticks.unit)
    if unit_us is not None and not math.isclose(ticks.scale * unit_us, tick_us, rel_tol=1e-6):
        raise LocalProtocolError(
            f"device_time_tick_us = {tick_us}: the DBC's {ticks.name!r} counts in steps of {ticks.scale * unit_us:g} us"
        )

"""A current source as data: a DBC file with its signals, a TOML file that says what they mean."""

from __future__ import annotations

import functools
import tomllib
from collections.abc import Mapping
from enum import IntEnum, IntFlag
from pathlib import Path
from typing import Any

from drivers.can_library import import_can
from drivers.current_source import SourceFault, SourceState
from drivers.roles import UNNAMED
from protocols.current_frames import CurrentFrames, Message, Signal
from protocols.errors import LocalProtocolError

FOLDER = Path(__file__).parent
PROFILE = "autosar-e2e-1"


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
        self.layout = int(data["layout"])
        protection = data["protection"]
        if protection["profile"] != PROFILE:
            raise LocalProtocolError(
                f"current source {name!r}: protection {protection['profile']!r} is not {PROFILE!r}"
            )
        ids = protection["data_ids"]
        command, status, temperature, identity = (
            _message(data[role], signals, ids) for role in ("command", "status", "temperature", "identity")
        )
        self.frames = CurrentFrames(command, status, temperature, identity, tick_us=int(data["device_time_tick_us"]))
        self._states = _states(data["codes"]["state"])
        self._faults = _faults(data["bits"]["fault"])

    def state(self, code: int) -> int:
        """The neutral state of a device's code; one without a name is shown as it is, out of the way."""
        if code in self._states:
            return self._states[code]
        return code + UNNAMED if code in set(SourceState) else code

    def faults(self, word: int) -> int:
        """The neutral fault bits of a device's word; bits without a name stay what they are."""
        named = sum(bit for bit, _ in self._faults)
        return sum(int(meaning) for bit, meaning in self._faults if word & bit) | word & ~named


@functools.cache
def current_source(name: str) -> SourceDescription:
    """The description of that name.

    Raises:
        LocalProtocolError: there is none, or it contradicts itself.
    """
    path = FOLDER / f"{name}_ecu.toml"
    if not path.exists():
        raise LocalProtocolError(f"no current source {name!r}; known: {', '.join(current_source_names())}")
    data = tomllib.loads(path.read_text(encoding="utf-8"))
    # python-can first: it must not load its MF4 reader, and cantools would have it do so.
    import_can()
    from cantools.database.can import Database

    database = Database()
    database.add_dbc_file(FOLDER / data["dbc"])
    return SourceDescription(name, data, {message.name: message for message in database.messages})


def current_source_names() -> tuple[str, ...]:
    """Names of the current sources described here."""
    return tuple(sorted(path.stem.removesuffix("_ecu") for path in FOLDER.glob("*_ecu.toml")))


def _message(fields: Mapping[str, str], messages: Mapping[str, Any], data_ids: Mapping[str, int]) -> Message:
    """One message: the fields the TOML file names, where the DBC has them.

    Raises:
        LocalProtocolError: the DBC has no such message or signal, or one that this driver cannot read.
    """
    name = fields["message"]
    if name not in messages:
        raise LocalProtocolError(f"the DBC has no message {name!r}; it has {', '.join(messages)}")
    given = messages[name]
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
        signals[field] = Signal(
            signal.name, signal.start, signal.length, signal.is_signed, float(signal.scale), signal.unit or ""
        )
    return Message(given.frame_id, given.length, signals, data_ids.get(name))


def _states(codes: Mapping[str, int]) -> dict[int, int]:
    return {code: int(_member(SourceState, name)) for name, code in codes.items()}


def _faults(bits: Mapping[str, int]) -> list[tuple[int, int]]:
    return [(1 << bit, int(_member(SourceFault, name))) for name, bit in bits.items()]


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

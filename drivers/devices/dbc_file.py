"""A DBC, KCD, SYM or ARXML file as plain data: messages and signals, of a DBC with their lines. Read by cantools.

The library is asked not to judge: what it would refuse (signals that overlap, that do not fit) matters only in the
messages that are used, and is said there, with all that is wrong beside.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import PurePath
from typing import Any

from drivers.can_library import import_can
from protocols.can_signals import Condition, Signal
from protocols.errors import LocalProtocolError
from protocols.j1939 import PLACEHOLDERS, source_address

DBC_ENCODING = "cp1252"
"""What most tools write a DBC in."""

FORMATS = {".dbc": "dbc", ".kcd": "kcd", ".sym": "sym", ".arxml": "arxml"}
"""Ending of a network description's name and its format; other files are taken as DBC files."""
ENDINGS = tuple(FORMATS)
J1939 = "j1939"

_MESSAGE = re.compile(r"^\s*BO_\s+(\d+)\s+(\w+)\s*:")
_SIZE = re.compile(r"^\s*BO_\s+\d+\s+\w+\s*:\s*(\d+)")
_BITS = re.compile(r"^\s*SG_[^:]*:\s*(\d+)\s*\|\s*(\d+)")
LONGEST_MESSAGE = 1785
"""Bytes: the longest of J1939's transport protocol, which a DBC may describe; a CAN FD frame has 64."""
MOST_BITS = 8 * LONGEST_MESSAGE
_SIGNAL = re.compile(r"^\s*SG_\s+(\w+)\s")
_OTHER_SIZE = re.compile(
    r"""(?:\b(?:length|offset)\s*=\s*["']?|<(?:[\w-]*LENGTH|START-POSITION)[^>]*>\s*)(\d{6,})""", re.IGNORECASE
)
"""A size in a KCD, SYM or ARXML file that no message has; checked before the library reads it."""
_ENTITY = re.compile(r"<!(?:DOCTYPE|ENTITY)", re.IGNORECASE)


@dataclass(frozen=True)
class DbcText:
    """A DBC file as it was read: its name, and its text."""

    name: str
    text: str

    @property
    def stem(self) -> str:
        """Its name without the ending."""
        return self.name.rpartition(".")[0] or self.name

    @property
    def format(self) -> str:
        """Its format, by the ending of its name: "dbc", "kcd", "sym" or "arxml"."""
        return FORMATS.get(PurePath(self.name).suffix.lower(), "dbc")


@dataclass(frozen=True)
class DbcSignal:
    """A signal of a message.

    Attributes:
        signal: where it lies, and what a step of it is worth.
        line: in the file (from 1); 0 where it was not named.
        names: names of its numbers (VAL_).
        start_number: what is sent by default (GenSigStartValue), as on the wire.
        minimum, maximum: the range that the file states, in the signal's unit; None where it states none.
        pages: the multiplexers that must have one of these numbers for it to be in a frame.
        is_multiplexer: its number says which page a frame is.
    """

    signal: Signal
    line: int = 0
    names: Mapping[int, str] = field(default_factory=dict)
    start_number: float = 0
    minimum: float | None = None
    maximum: float | None = None
    pages: tuple[Condition, ...] = ()
    is_multiplexer: bool = False


@dataclass(frozen=True)
class DbcMessage:
    """A message; `period_s` is its cycle time (GenMsgCycleTime), 0 where the file states none.

    `j1939`: its identifier consists of priority, parameter group and addresses.
    """

    name: str
    identifier: int
    extended: bool
    fd: bool
    size: int
    signals: Mapping[str, DbcSignal]
    period_s: float
    line: int
    j1939: bool = False

    @property
    def any_address(self) -> bool:
        """A J1939 message whose source address is a placeholder: it is identified by its parameter group."""
        return self.j1939 and source_address(self.identifier) in PLACEHOLDERS


def can_database(text: str, kind: str = "dbc") -> Any:  # noqa: ANN401 - cantools has no types
    """The messages of a network description as the library has them: a `cantools.database.can.Database`.

    Args:
        text: of the file.
        kind: its format, a value of `FORMATS`.

    Raises:
        LocalProtocolError: the text is not of that format, or a size in it is implausible.
    """
    _check_sizes(text, kind)
    # python-can first: it must not load its MF4 reader, and cantools would have it do so.
    import_can()
    from cantools.database import load_string
    from cantools.database.can import Database

    try:
        database = load_string(text, database_format=kind, strict=False)
    except Exception as error:  # the library raises its parser's errors, its own, and plain ones of many kinds
        reason = (str(error).splitlines() or [type(error).__name__])[0].removeprefix(f"{kind.upper()}: ").strip('"')
        raise LocalProtocolError(f"not a readable {kind.upper()} file: {reason}") from error
    if not isinstance(database, Database):
        raise LocalProtocolError(f"this {kind.upper()} file describes no CAN bus")
    return database


def parse_dbc(text: str, kind: str = "dbc") -> dict[str, DbcMessage]:
    """The messages of a DBC file or another network description, by name.

    Args:
        text: of the file.
        kind: its format, a value of `FORMATS`.

    Raises:
        LocalProtocolError: the text is not of that format, or has no message.
    """
    database = can_database(text, kind)
    if not database.messages:
        raise LocalProtocolError("this file contains no messages" + " (BO_)" * (kind == "dbc"))
    lines = _lines(text) if kind == "dbc" else {}
    try:
        return {message.name: _message(message, lines) for message in database.messages}
    except (OverflowError, TypeError, ValueError) as error:
        raise LocalProtocolError(f"a number in this {kind.upper()} file cannot be used: {error}") from error


def _check_sizes(text: str, kind: str) -> None:
    """Refuse sizes that no message has: the library's time and memory grow with them, used or not.

    Raises:
        LocalProtocolError: a message of too many bytes, or a signal that begins or ends beyond every message.
    """
    if kind != "dbc":
        if (match := _OTHER_SIZE.search(text)) is not None:
            message = f"a signal must lie within the first {MOST_BITS} bits of its message"
            raise LocalProtocolError(f"line {text.count(chr(10), 0, match.start()) + 1}: {match[0]!r:.80}: {message}")
        if _ENTITY.search(text) is not None:
            raise LocalProtocolError("a document type (<!DOCTYPE, <!ENTITY) is not allowed in a network description")
        return
    for number, line in enumerate(text.splitlines(), start=1):
        if (match := _SIZE.match(line)) is not None and _beyond(match[1], LONGEST_MESSAGE):
            message = f"a message has at most {LONGEST_MESSAGE} bytes"
        elif (match := _BITS.match(line)) is not None and any(_beyond(one, MOST_BITS) for one in match.groups()):
            message = f"a signal must lie within the first {MOST_BITS} bits of its message"
        else:
            continue
        raise LocalProtocolError(f"line {number}: {line.strip()!r:.80}: {message}")


def _beyond(digits: str, largest: int) -> bool:
    return len(digits.lstrip("0")) > len(str(largest)) or int(digits) > largest


def _lines(text: str) -> dict[tuple[str, ...], int]:
    """The line of every message, and of every signal below its message."""
    named: dict[tuple[str, ...], int] = {}
    message = ""
    for number, line in enumerate(text.splitlines(), start=1):
        if (match := _MESSAGE.match(line)) is not None:
            message = match[2]
            named.setdefault((message,), number)
        elif (match := _SIGNAL.match(line)) is not None:
            named.setdefault((message, match[1]), number)
    return named


def _message(given: Any, lines: Mapping[tuple[str, ...], int]) -> DbcMessage:  # noqa: ANN401 - cantools has no types
    plain = {item.name: _signal(item) for item in given.signals}
    signals = {
        item.name: DbcSignal(
            plain[item.name], lines.get((given.name, item.name), 0),
            {int(number): str(name) for number, name in (item.choices or {}).items()},
            _number(item.raw_initial), _limit(item.minimum), _limit(item.maximum), _pages(item, given, plain),
            bool(item.is_multiplexer),
        )
        for item in given.signals
    }
    return DbcMessage(
        given.name, given.frame_id, bool(given.is_extended_frame), bool(given.is_fd) or given.length > 8, given.length,
        signals, (given.cycle_time or 0) / 1e3, lines.get((given.name,), 0),
        given.protocol == J1939 and bool(given.is_extended_frame),
    )


def _signal(given: Any) -> Signal:  # noqa: ANN401 - cantools has no types
    return Signal(
        given.name, given.start, given.length, given.byte_order == "big_endian", bool(given.is_signed),
        bool(given.is_float), float(given.scale), float(given.offset), (given.unit or "").strip(),
    )


def _limit(given: Any) -> float | None:  # noqa: ANN401 - cantools has no types
    return None if given is None else float(given)


def _number(given: object) -> float:
    return given if isinstance(given, int | float) else 0


def _pages(given: Any, message: Any, signals: Mapping[str, Signal]) -> tuple[Condition, ...]:  # noqa: ANN401 - cantools has no types
    """Its multiplexer's condition, and that one's own, and so on."""
    by_name = {item.name: item for item in message.signals}
    first = [item.name for item in message.signals if item.is_multiplexer and not item.multiplexer_ids]
    conditions: list[Condition] = []
    while given.multiplexer_ids and len(conditions) < len(by_name):
        # An m-number without a line of its own belongs to the message's one free multiplexer.
        above = given.multiplexer_signal or (first[0] if len(first) == 1 else "")
        if above not in by_name:
            break
        conditions.append((signals[above], frozenset(given.multiplexer_ids)))
        given = by_name[above]
    return tuple(conditions)

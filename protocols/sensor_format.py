"""Sensor formats from their descriptions, or every reason why a description cannot be used.

A description is a table of `LINE_KEYS` or `FRAME_KEYS`, or the name of a preset; `base = "preset"` takes another one's
entries where the table has none of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from protocols.binary_format import LETTERS, ORDERS, SIZES, STUFFINGS, BinaryFormat, Field
from protocols.checksums import FRAME_CHECKSUMS, LINE_CHECKSUMS
from protocols.errors import LocalProtocolError
from protocols.exchange import Exchange
from protocols.format_checks import frame_problems, line_problems, pattern_of
from protocols.format_keys import FormatProblems, Key, Problem, Table, read, schema_of
from protocols.line_format import LONGEST_LINE, NUMBERS, SIGNS, LineFormat
from protocols.sensor_presets import TABLES

SensorFormat = LineFormat | BinaryFormat

_COMMON = {
    "name": Key("text", "name for messages and recordings"),
    "base": Key("text", "name of a preset whose entries hold where this table has none"),
    "kind": Key("text", "lines of text, or frames of bytes; told by the other keys where it is not stated",
                choices=("lines", "frames")),
    "description": Key("text", "what the format is of: maker, device, document; only for people"),
    "unit": Key("text", "unit of the value"),
    "nominal_rate_Hz": Key("number", "readings a second where the bench file does not say it", 1e-3, 1e6),
    "start_command": Key("bytes", "sent when the port is opened, to start the device's own sending"),
    "stop_command": Key("bytes", "sent before the port is closed"),
    "request": Key("bytes", "sent for each reading, at the bench file's rate; {address} in a text becomes `address`"),
    "answer_timeout_ms": Key("number", "longest wait for the answer to a request (default 100)", 1, 5000),
    "address": Key("text", "what {address} stands for in request, commands and pattern"),
}  # fmt: skip
LINE_KEYS: Mapping[str, Key] = {
    **_COMMON,
    "start": Key("bytes", "bytes a line begins with, such as STX; not part of pattern and columns"),
    "terminator": Key("bytes", "bytes a line ends with (default CR LF)"),
    "pattern": Key("text", "regular expression of the whole line with a group (?P<value>...)"),
    "columns": Key("places", "in place of a pattern: [first, last] character of value, unit, status, sign, checksum, "
                             "counted from 1; with a separator the number of the column", 1, LONGEST_LINE),
    "separator": Key("text", "character between columns of any width"),
    "length": Key("whole", "characters of every line, start and terminator not counted", 1, LONGEST_LINE),
    "maximum_length": Key("whole", "longest line, start and terminator not counted (default 64)", 1, LONGEST_LINE),
    "number": Key("text", "how the number is written (default decimal)", choices=tuple(NUMBERS)),
    "decimal_mark": Key("text", "point or comma (default point)", choices=(".", ",")),
    "sign": Key("text", "where the sign stands (default leading); separate: in group or column `sign`", choices=SIGNS),
    "negative_tokens": Key("texts", 'texts of a separate sign that mean a negative number (default ["-"])'),
    "decimals": Key("whole", "implied decimal places of a number without a mark", 0, 9),
    "scale": Key("number", "value = number * scale + offset (default 1)"),
    "offset": Key("number", "see scale (default 0)"),
    "units": Key("factors", "units the line may show, each with its factor to `unit`"),
    "status": Key("words", "texts of group or column `status`, each ok, overload or fault",
                  choices=("ok", "overload", "fault")),
    "overload_tokens": Key("texts", "texts in place of the number: input out of range"),
    "fault_tokens": Key("texts", "texts in place of the number: sensor broken or not connected"),
    "checksum": Key("text", "sum written in group or column `checksum` (default none)", choices=LINE_CHECKSUMS),
    "checksum_from": Key("text", "character before the first one covered (default: all from the line's beginning)"),
    "checksum_to": Key("text", "character behind the last one covered (default: all up to the checksum)"),
    "checksum_over": Key("span", "[first, last] character covered, counted from 1, in place of both", 1, LONGEST_LINE),
    "template": Key("text", "how a simulated sensor writes it, such as \"ST,{value:+08.3f}\"; made from the pattern "
                            "where it is not stated"),
}  # fmt: skip
FRAME_KEYS: Mapping[str, Key] = {
    **_COMMON,
    "sync": Key("bytes", "bytes a frame begins with"),
    "length": Key("whole", "bytes of a whole frame with sync, checksum and end, stuffing not counted", 1, 256),
    "end": Key("bytes", "bytes a frame ends with"),
    "order": Key("text", "order of bytes in numbers (default little)", choices=ORDERS),
    "fields": Key("table", "tables value, and where there are such status, sequence and time"),
    "packed": Key("texts", "bits of each byte, highest first, of a stream without sync bytes: 0 and 1 as they must be, "
                           f"{', '.join(f'{letter} {name}' for letter, name in LETTERS.items())}, x any"),
    "stuffing": Key("text", "how a sync inside of a frame is hidden (default none)", choices=STUFFINGS),
    "escape": Key("whole", "byte put before a hidden one (default 0x10)", 0, 255),
    "escape_xor": Key("whole", "by what a hidden byte is changed (default 0; HDLC 0x20)", 0, 255),
    "checksum": Key("text", "kind of sum (default none)", choices=FRAME_CHECKSUMS),
    "checksum_at": Key("whole", "its first byte, counted from 0 (default: right before the end)", 0, 255),
    "checksum_over": Key("span", "[first, last] byte covered, counted from 0 (default: all before it)", 0, 255),
    "checksum_order": Key("text", "order of its bytes (default: the frame's)", choices=ORDERS),
}  # fmt: skip
FIELD_KEYS: Mapping[str, Key] = {
    "at": Key("whole", "its first byte, counted from 0, sync counted", 0, 255),
    "type": Key("text", "u unsigned, i signed, f float, with its bits", choices=tuple(SIZES)),
    "order": Key("text", "order of its bytes (default: the frame's)", choices=ORDERS),
    "bits": Key("span", "[lowest, highest] bit that belong to it, counted from 0", 0, 63),
    "signed": Key("flag", "two's complement, where a type does not say it (bits, packed)"),
    "scale": Key("number", "value = number * scale + offset (default 1); of the time: microseconds a tick"),
    "offset": Key("number", "see scale (default 0)"),
    "valid": Key("limits", "[lowest, highest] number that is a reading; beyond is an overload"),
    "overload_values": Key("wholes", "numbers that mean: input out of range"),
    "fault_values": Key("wholes", "numbers that mean: sensor broken or not connected"),
    "overload_bits": Key("whole", "mask of status bits that mean: input out of range", 0, 2**64 - 1),
    "fault_bits": Key("whole", "mask of status bits that mean: sensor broken", 0, 2**64 - 1),
}


def json_schema() -> dict[str, Any]:
    """JSON schema of a sensor format's file."""
    frames = schema_of(FRAME_KEYS)
    field = schema_of(FIELD_KEYS)
    frames["properties"]["fields"] = {
        "type": "object", "additionalProperties": False, "required": ["value"],
        "properties": dict.fromkeys(LETTERS.values(), field),
    }  # fmt: skip
    return {"anyOf": [schema_of(LINE_KEYS), frames]}


def from_description(table: Table) -> SensorFormat:
    r"""A format that a user described.

    Args:
        table: keys as in `LINE_KEYS` or `FRAME_KEYS`.

    Raises:
        FormatProblems: it cannot be read or contradicts itself, with every problem and its place.
    """
    problems: list[Problem] = []
    name = table.get("name", "custom")
    whole = _with_base(table, problems)
    if _kind(whole) == "frames":
        made: SensorFormat | None = _frames(whole, problems)
    else:
        made = _lines(whole, problems)
    if problems or made is None:
        raise FormatProblems(str(name), problems)
    return made


def _with_base(table: Table, problems: list[Problem]) -> Table:
    """The table over its base's entries."""
    base = table.get("base")
    if base is None:
        return table
    if not isinstance(base, str) or base not in TABLES:
        problems.append((("base",), f"no format {base!r}; there are {', '.join(TABLES)}"))
        return table
    return {**TABLES[base], **table}


def _kind(table: Table) -> str:
    """What the table describes: stated, or told by keys that only one of the two has."""
    stated = table.get("kind")
    if isinstance(stated, str) and stated in {"lines", "frames"}:
        return stated
    return "frames" if table.keys() & {"fields", "packed", "sync"} and "pattern" not in table else "lines"


def _exchange(values: dict[str, Any]) -> Exchange:
    address = str(values.get("address", "")).encode()
    sent = {
        key: values.get(key, b"").replace(b"{address}", address) for key in ("start_command", "stop_command", "request")
    }
    return Exchange(**sent, answer_timeout_s=1e-3 * values.get("answer_timeout_ms", 100.0))


def _lines(table: Table, problems: list[Problem]) -> LineFormat | None:
    """A line format; None, with its problems added, where there are any."""
    values = read(table, LINE_KEYS, (), problems)
    pattern = pattern_of(values, table, problems)
    if problems or pattern is None:
        return None
    longest = values.get("length", values.get("maximum_length", 64))
    same = ("start", "terminator", "number", "decimal_mark", "sign", "negative_tokens", "decimals", "scale", "offset",
            "unit", "units", "status", "overload_tokens", "fault_tokens", "checksum", "checksum_from", "checksum_to",
            "checksum_over", "nominal_rate_Hz", "template")  # fmt: skip
    made = LineFormat(
        name=values.get("name", "custom"), pattern=pattern, maximum_length=longest, exchange=_exchange(values),
        **{key: values[key] for key in same if key in values},
    )
    problems += line_problems(made, values)
    return None if problems else made


def _frames(table: Table, problems: list[Problem]) -> BinaryFormat | None:
    """A binary format; None, with its problems added, where there are any."""
    values = read(table, FRAME_KEYS, (), problems)
    fields = _fields(values, problems)
    if problems:
        return None
    length = len(values["packed"]) if "packed" in values else values.get("length", 0)
    checksum = values.get("checksum", "none")
    size = 0 if checksum == "none" else _checksum_size(checksum)
    at = values.get("checksum_at", length - len(values.get("end", b"")) - size)
    same = ("sync", "end", "stuffing", "escape", "escape_xor", "packed", "unit", "nominal_rate_Hz")
    made = BinaryFormat(
        name=values.get("name", "custom"), length=length, fields=fields, exchange=_exchange(values),
        packed_order=values.get("order", "big"), checksum=checksum, checksum_at=at,
        checksum_over=values.get("checksum_over", (0, at - 1)),
        checksum_order=values.get("checksum_order", values.get("order", "little")),
        **{key: values[key] for key in same if key in values},
    )
    problems += frame_problems(made, values)
    return None if problems else made


def _checksum_size(name: str) -> int:
    from protocols.checksums import CHECKSUMS

    return CHECKSUMS[name].size


def _fields(values: dict[str, Any], problems: list[Problem]) -> dict[str, Field]:
    """The fields of a frame."""
    fields: dict[str, Field] = {}
    given = values.get("fields", {"value": {}} if "packed" in values else {})
    known = tuple(LETTERS.values())
    for name, table in given.items():
        if name not in known or not isinstance(table, Mapping):
            said = "expected a table" if name in known else f"unknown field {name!r}; known are {', '.join(known)}"
            problems.append((("fields", name), said))
            continue
        entries = read(table, FIELD_KEYS, ("fields", name), problems)
        entries.setdefault("order", values.get("order", "little"))
        if entries.get("type", "").startswith("i"):
            entries["signed"] = True
        fields[name] = Field(**entries)
    return fields


@cache
def preset(name: str) -> SensorFormat:
    """The shipped format of that name.

    Raises:
        LocalProtocolError: there is none.
    """
    if name not in TABLES:
        raise LocalProtocolError(f"no line format {name!r}; there are {', '.join(TABLES)}")
    return from_description({"name": name, **TABLES[name]})

"""Sensor formats from their descriptions, or every reason why a description is invalid.

A description is a table of plain values as in a user's file, or the name of a preset; `base = "preset"` takes the
entries that the table does not have from a preset.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from protocols.binary_format import BinaryFormat, Field
from protocols.checksums import CHECKSUMS
from protocols.descriptions import DescriptionProblems, Problem
from protocols.errors import LocalProtocolError
from protocols.exchange import Exchange
from protocols.format_checks import frame_problems, line_problems, pattern_of
from protocols.line_format import LineFormat
from protocols.modbus_format import FRAMINGS, modbus_format
from protocols.sensor_presets import TABLES

SensorFormat = LineFormat | BinaryFormat
KINDS = ("lines", "frames", "modbus", "can")

_BYTES = frozenset({"start", "terminator", "start_command", "stop_command", "request", "sync", "end"})
"""Keys of byte strings, which are written as ASCII text or as a list of numbers."""

Table = Mapping[str, Any]


def from_description(table: Table) -> SensorFormat:
    r"""A format that a user described.

    Args:
        table: plain values by the keys of a format's file (`rig.files.sensor_format`), each of its type and range.

    Raises:
        DescriptionProblems: entries contradict each other, with every problem and its place.
    """
    problems: list[Problem] = []
    name = table.get("name", "custom")
    whole = _with_base(table, problems)
    kind, of_base = kind_of(whole), kind_of(TABLES.get(str(table.get("base")), whole))
    if kind != of_base and {kind, of_base} & {"modbus", "can"}:
        problems.append((("base",), f"{table['base']!r} describes {of_base}, but this table describes {kind}"))
    values = {key: _plain(key, value) for key, value in whole.items()}
    made: SensorFormat | None = None
    if not problems:
        made = {"frames": _frames, "lines": _lines, "modbus": modbus_format}[kind](values, problems)
    if problems or made is None:
        raise DescriptionProblems(f"sensor format {str(name)!r}", problems)
    return made


def _with_base(table: Table, problems: list[Problem]) -> Table:
    """The table over its base's entries."""
    base = table.get("base")
    if base is None:
        return table
    if not isinstance(base, str) or base not in TABLES:
        problems.append((("base",), f"unknown format {base!r}; known: {', '.join(TABLES)}"))
        return table
    return {**TABLES[base], **table}


def kind_of(table: Table) -> str:
    """Kind of format of a table ("frames", "lines", "modbus" or "can"): as stated, or inferred from its keys."""
    table = _with_base(table, [])
    stated = table.get("kind")
    if isinstance(stated, str) and stated in KINDS:
        return stated
    if isinstance(table.get("address"), int):
        return "modbus"
    if table.keys() & {"dbc", "id"}:
        return "can"
    return "frames" if table.keys() & {"fields", "packed", "sync"} and "pattern" not in table else "lines"


def modbus_framing(given: str | Table) -> str:
    """Framing of a format that reads Modbus registers, "tcp" or "rtu"; empty for any other.

    Args:
        given: the name of a format, or a table.
    """
    table = _with_base(TABLES.get(given, {}) if isinstance(given, str) else given, [])
    return str(table.get("framing", FRAMINGS[0])) if kind_of(table) == "modbus" else ""


def modbus_request(given: str | Table) -> bytes:
    """What is sent for each reading of a format that reads Modbus registers; b"" for any other.

    Args:
        given: the name of a format, or a valid table.

    Raises:
        DescriptionProblems: the table contradicts itself.
    """
    if not modbus_framing(given):
        return b""
    return (preset(given) if isinstance(given, str) else from_description(given)).exchange.request


def _plain(key: str, value: Any) -> Any:  # noqa: ANN401 - whatever the key holds
    """A value of a table as formats hold it: byte strings as such, lists as tuples."""
    if key in _BYTES:
        return value.encode("ascii") if isinstance(value, str) else bytes(value)
    if isinstance(value, Mapping):
        return {name: _plain("", inner) for name, inner in value.items()}
    return tuple(value) if isinstance(value, list) else value


def _exchange(values: dict[str, Any]) -> Exchange:
    address = str(values.get("address", "")).encode()
    sent = {
        key: values.get(key, b"").replace(b"{address}", address) for key in ("start_command", "stop_command", "request")
    }
    return Exchange(**sent, answer_timeout_s=1e-3 * values.get("answer_timeout_ms", 100.0))


def _lines(values: dict[str, Any], problems: list[Problem]) -> LineFormat | None:
    """A line format; None, with its problems added, where there are any."""
    pattern = pattern_of(values, problems)
    if problems or pattern is None:
        return None
    longest = values.get("length", values.get("maximum_length", 64))
    same = ("start", "terminator", "number", "decimal_mark", "sign", "negative_tokens", "decimals", "scale", "offset",
            "unit", "units", "status", "overload_tokens", "fault_tokens", "checksum", "checksum_from", "checksum_to",
            "checksum_over", "nominal_rate_Hz", "template", "encoding")  # fmt: skip
    made = LineFormat(
        name=values.get("name", "custom"), pattern=pattern, maximum_length=longest, exchange=_exchange(values),
        **{key: values[key] for key in same if key in values},
    )
    problems += line_problems(made, values)
    return None if problems else made


def _frames(values: dict[str, Any], problems: list[Problem]) -> BinaryFormat | None:
    """A binary format; None, with its problems added, where there are any."""
    fields = _fields(values)
    length = len(values["packed"]) if "packed" in values else values.get("length", 0)
    checksum = values.get("checksum", "none")
    size = 0 if checksum == "none" else CHECKSUMS[checksum].size
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


def _fields(values: dict[str, Any]) -> dict[str, Field]:
    """The fields of a frame."""
    fields: dict[str, Field] = {}
    for name, given in values.get("fields", {"value": {}} if "packed" in values else {}).items():
        entries = {"order": values.get("order", "little"), **given}
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
        raise LocalProtocolError(f"unknown line format {name!r}; known: {', '.join(TABLES)}")
    return from_description({"name": name, **TABLES[name]})

r"""The keys of a sensor format's table: what each may hold, read with every problem at once, and as a JSON schema.

A table is what TOML gives: texts, numbers, lists, tables. Byte strings are written as text of ASCII characters
("\r\n", in double quotes), or as a list of numbers ([0x10, 0x7E]).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from protocols.errors import LocalProtocolError

LARGEST = 1.7e308
"""Largest number of an entry."""

Place = tuple[str | int, ...]
Problem = tuple[Place, str]
"""Where in the table, and what is wrong there with what would be right."""
Table = Mapping[str, Any]


class FormatProblems(LocalProtocolError):
    """A format that contradicts itself or cannot be read: `problems` has every reason with its place."""

    def __init__(self, name: str, problems: Sequence[Problem]) -> None:
        self.problems = list(problems)
        told = "; ".join(f"{'.'.join(map(str, place))}: {text}" if place else text for place, text in problems)
        super().__init__(f"sensor format {name!r}: {told}")


@dataclass(frozen=True)
class Key:
    """One key of a table.

    Attributes:
        kind: a key of `KINDS`.
        text: what it means, one sentence for schema and reference.
        low, high: range of a number, or of the numbers in a list.
        choices: the texts allowed; empty for any.
    """

    kind: str
    text: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()


def _text(key: Key, value: object) -> str:
    if not isinstance(value, str):
        raise ValueError("expected text")
    if key.choices and value not in key.choices:
        meant = difflib.get_close_matches(value, key.choices, n=1, cutoff=0.6)
        said = f"; did you mean {meant[0]!r}?" if meant else ""
        # A mark by itself is lost among commas.
        known = [choice if choice[:1].isalnum() else f'"{choice}"' for choice in key.choices]
        raise ValueError(f"must be one of {', '.join(known)}{said}")
    return value


def _bytes(key: Key, value: object) -> bytes:
    if isinstance(value, str):
        if not value.isascii():
            raise ValueError("expected ASCII text, or a list of bytes such as [0x02, 0xA5]")
        if any(written in value for written in ("\\r", "\\n", "\\x", "\\0", "\\u")):
            raise ValueError('a backslash is itself in single quotes; write "\\r\\n" in double quotes, or [0x0D, 0x0A]')
        return value.encode("ascii")
    if isinstance(value, (list, tuple)) and all(type(item) is int and 0 <= item <= 0xFF for item in value):
        return bytes(value)
    raise ValueError("expected ASCII text, or a list of bytes from 0 to 0xFF")


def _number(key: Key, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError("expected a number")
    return _ranged(key, value)


def _whole(key: Key, value: object) -> int:
    if type(value) is not int:
        raise ValueError("expected a whole number")
    return int(_ranged(key, value))


def _ranged(key: Key, value: float) -> float:
    # TOML's whole numbers have any size; one beyond every float is not finite here.
    if not -LARGEST <= value <= LARGEST or not key.low <= value <= key.high:
        if key.low == -math.inf:
            raise ValueError("must be a finite number")
        words = f"{_shown(key.low)}..{_shown(key.high)}" if key.high < math.inf else f"at least {_shown(key.low)}"
        raise ValueError(f"must be {words}")
    return value


def _shown(number: float) -> str:
    return f"{number:.0f}" if number == int(number) else f"{number:g}"


def _flag(key: Key, value: object) -> bool:
    if not isinstance(value, bool):
        raise ValueError("expected true or false")
    return value


def _listed(key: Key, value: object, what: str, item_of: Callable[[Key, object], Any]) -> tuple[Any, ...]:
    if not isinstance(value, (list, tuple)):
        raise ValueError(f"expected a list of {what}")
    try:
        return tuple(item_of(key, item) for item in value)
    except ValueError as problem:
        raise ValueError(f"expected a list of {what}: {problem}") from None


def _span(key: Key, value: object) -> tuple[int, int]:
    numbers = _listed(key, value, "two whole numbers [first, last]", _whole)
    if len(numbers) != 2 or numbers[0] > numbers[1]:
        raise ValueError("expected two whole numbers [first, last], the first not behind the last")
    return numbers[0], numbers[1]


def _limits(key: Key, value: object) -> tuple[float, float]:
    numbers = _listed(key, value, "two numbers [lowest, highest]", _number)
    if len(numbers) != 2 or not numbers[0] < numbers[1]:
        raise ValueError("expected two numbers [lowest, highest]")
    return numbers[0], numbers[1]


def _table_of(key: Key, value: object, what: str, item_of: Callable[[Key, object], Any]) -> dict[str, Any]:
    if not isinstance(value, Mapping) or not value:
        raise ValueError(f"expected a table of {what}")
    try:
        return {str(name): item_of(key, item) for name, item in value.items()}
    except ValueError as problem:
        raise ValueError(f"expected a table of {what}: {problem}") from None


def _place(key: Key, value: object) -> tuple[int, int] | int:
    return _whole(key, value) if type(value) is int else _span(key, value)


def _table(key: Key, value: object) -> Mapping[str, Any]:
    if not isinstance(value, Mapping) or not value:
        raise ValueError("expected a table")
    return value


_NUMBER_SCHEMA = {"type": "number"}
_BYTES_SCHEMA = {
    "anyOf": [
        {"type": "string"}, {"type": "array", "items": {"type": "integer", "minimum": 0, "maximum": 255}},
    ]
}  # fmt: skip
_PAIR_SCHEMA = {"type": "array", "items": {"type": "integer"}, "minItems": 2, "maxItems": 2}


def _array(items: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


def _object(values: Mapping[str, Any]) -> dict[str, Any]:
    return {"type": "object", "additionalProperties": values}


KINDS: Mapping[str, tuple[Callable[[Key, object], Any], Mapping[str, Any]]] = {
    "text": (_text, {"type": "string"}),
    "bytes": (_bytes, _BYTES_SCHEMA),
    "number": (_number, _NUMBER_SCHEMA),
    "whole": (_whole, {"type": "integer"}),
    "flag": (_flag, {"type": "boolean"}),
    "texts": (lambda key, value: _listed(key, value, "texts", _text), _array({"type": "string"})),
    "wholes": (lambda key, value: _listed(key, value, "whole numbers", _whole), _array({"type": "integer"})),
    "span": (_span, _PAIR_SCHEMA),
    "limits": (_limits, {**_PAIR_SCHEMA, "items": _NUMBER_SCHEMA}),
    "words": (lambda key, value: _table_of(key, value, "texts", _text), _object({"type": "string"})),
    "factors": (lambda key, value: _table_of(key, value, "numbers", _number), _object(_NUMBER_SCHEMA)),
    "places": (
        lambda key, value: _table_of(key, value, "places", _place),
        _object({"anyOf": [{"type": "integer"}, _PAIR_SCHEMA]}),
    ),
    "table": (_table, {"type": "object"}),
}  # fmt: skip
"""How a value is read, and its JSON schema."""


def read(table: Table, keys: Mapping[str, Key], place: Place, problems: list[Problem]) -> dict[str, Any]:
    """The entries of a table that can be used, as their kinds want them.

    Args:
        table: as TOML gives it.
        keys: what it may hold.
        place: where it stands itself.
        problems: every unknown key and unusable value is added.
    """
    values: dict[str, Any] = {}
    for name, value in table.items():
        if name not in keys:
            meant = difflib.get_close_matches(str(name), list(keys), n=1, cutoff=0.6)
            said = f"did you mean {meant[0]}? " if meant else ""
            problems.append(((*place, name), f"unknown key {name!r}; {said}known are {', '.join(keys)}"))
            continue
        try:
            values[name] = KINDS[keys[name].kind][0](keys[name], value)
        except ValueError as problem:
            problems.append(((*place, name), str(problem)))
    return values


def schema_of(keys: Mapping[str, Key]) -> dict[str, Any]:
    """JSON schema of a table with these keys."""
    properties = {name: _schema(key) for name, key in keys.items()}
    return {"type": "object", "additionalProperties": False, "properties": properties}


def _schema(key: Key) -> dict[str, Any]:
    schema = {**KINDS[key.kind][1], "description": key.text}
    if key.choices and key.kind == "text":
        schema["enum"] = list(key.choices)
    if key.kind in {"number", "whole"}:
        schema |= {name: edge for name, edge in (("minimum", key.low), ("maximum", key.high)) if math.isfinite(edge)}
    return schema

"""Values as plain JSON types and back, by the types that the fields of their dataclasses declare.

A field with a default may be missing or null (what is not known); one without must be there. What is there has the
declared type, and every number is finite; every entry that is not so is a problem with its key, all reported together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, ClassVar, Protocol, TypeVar, Union, get_args, get_origin, get_type_hints

APART = {"plain": False}
"""Metadata of a field that belongs to no file."""
LONGEST = 90
"""Characters of a key and its wrong value that a message shows."""
EITHER = {Union, UnionType}


class _Dataclass(Protocol):
    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


Value = TypeVar("Value", bound=_Dataclass)
Ends = tuple[float, float]


def plain(value: object) -> Any:  # noqa: ANN401 - JSON
    """A value of JSON: dataclasses and mappings as objects, tuples as lists, null in place of what is not finite."""
    if is_dataclass(value) and not isinstance(value, type):
        return {one.name: plain(getattr(value, one.name)) for one in fields(value) if one.metadata != APART}
    if isinstance(value, Mapping):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(one) for one in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value


class PlainReader:
    """Reads values from JSON types; what is wrong is collected.

    Attributes:
        problems: one line for each wrong entry: its key, the value, the expected type.
    """

    def __init__(self) -> None:
        self.problems: list[str] = []

    def read(
        self, kind: type[Value], entry: object, at: str = "", keys: Mapping[str, str] | None = None, **known: object
    ) -> Value | None:
        """A dataclass from an object of JSON; None where an entry is wrong or missing.

        Args:
            kind: the dataclass.
            entry: the object.
            at: its key, such as `error.per_test[3]`; empty for the whole object.
            keys: field to key, where the names differ.
            known: fields that are not read.
        """
        if not isinstance(entry, Mapping):
            self._wrong(at, entry, "an object")
            return None
        before, hints, values = len(self.problems), _hints(kind), dict(known)
        for one in fields(kind):
            key = (keys or {}).get(one.name, one.name)
            where = f"{at}.{key}" if at else key
            if one.name in known or one.metadata == APART:
                continue
            needed = one.default is MISSING and one.default_factory is MISSING
            if entry.get(key) is not None or (key in entry and (needed or get_origin(hints[one.name]) in EITHER)):
                values[one.name] = self.value(hints[one.name], entry[key], where)
            elif needed:
                self.problems.append(f"{where}: is missing")
        return kind(**values) if len(self.problems) == before else None

    def value(self, kind: Any, entry: object, at: str) -> Any:  # noqa: ANN401 - a type and a value of it
        """A value of a declared type: a dataclass, mapping, tuple, number, text or truth value, or None besides."""
        origin, arguments = get_origin(kind), get_args(kind)
        if origin in EITHER:
            (inner,) = (one for one in arguments if one is not NoneType)
            return None if entry is None else self.value(inner, entry, at)
        if origin is tuple:
            return self._ends(entry, at) if kind == Ends else self._tuple(arguments[0], entry, at)
        if origin is not None:  # a mapping
            if not isinstance(entry, Mapping):
                self._wrong(at, entry, "an object")
                return {}
            return {str(key): self._inner(arguments[1], one, f"{at}.{key}") for key, one in entry.items()}
        if isinstance(kind, type) and is_dataclass(kind):
            return self.read(kind, entry, at)
        return self._single(kind, entry, at)

    def _single(self, kind: type, entry: Any, at: str) -> Any:  # noqa: ANN401 - a value of that type
        if kind in {float, int}:
            if isinstance(entry, bool) or not isinstance(entry, (int, float)):
                self._wrong(at, entry, "a number")
            elif not _is_finite(entry):
                self._wrong(at, entry, "a finite number or null")
            else:
                return kind(entry)
        elif not isinstance(entry, kind):
            self._wrong(at, entry, {bool: "true or false", str: "a string"}.get(kind, kind.__name__))
        return entry

    def _inner(self, kind: Any, entry: object, at: str) -> Any:  # noqa: ANN401 - as `value`
        """A value in a mapping; a number that is not known is NaN."""
        return math.nan if kind is float and entry is None else self.value(kind, entry, at)

    def _tuple(self, kind: Any, entry: object, at: str) -> tuple[Any, ...]:  # noqa: ANN401 - a type
        if not isinstance(entry, list):
            self._wrong(at, entry, "a list")
            return ()
        if kind is float and all(type(one) is float and math.isfinite(one) for one in entry):
            return tuple(entry)
        return tuple(self.value(kind, one, f"{at}[{place}]") for place, one in enumerate(entry))

    def _ends(self, entry: object, at: str) -> Ends | None:
        if not isinstance(entry, list) or len(entry) != 2:
            self._wrong(at, entry, "a list of 2")
            return None
        before = len(self.problems)
        low, high = (self._single(float, one, f"{at}[{place}]") for place, one in enumerate(entry))
        if len(self.problems) == before and not low <= high:
            self._wrong(at, entry, "the lowest and the highest value")
        return low, high

    def _wrong(self, at: str, entry: object, expected: str) -> None:
        kind = f"{type(entry).__name__} " if isinstance(entry, (dict, list)) else ""
        self.problems.append(f"{at or 'the file'}: got {kind}{entry!r}"[:LONGEST] + f", expected {expected}")


def _is_finite(entry: float) -> bool:
    try:
        return math.isfinite(entry)
    except OverflowError:  # a whole number that no float holds
        return False


@cache
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)

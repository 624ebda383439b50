"""The entries of a roles file held against a DBC: each that cannot be used is noted with its place, none raises."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from drivers.devices.dbc_file import DbcMessage, DbcSignal
from protocols.can_signals import Placed, Signal
from protocols.errors import LocalProtocolError

Place = tuple[str, ...]
_DURATION = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?)\s*(us|ms|s)\s*", re.ASCII)
_FULL_SCALE = re.compile(r"\s*([0-9]+(?:\.[0-9]*)?|\.[0-9]+)\s*(m?)A\s*", re.ASCII)
_SECONDS = {"us": 1e-6, "ms": 1e-3, "s": 1.0}

UNITS: Mapping[str, Mapping[str, tuple[float, float]]] = {
    "current": {"A": (1.0, 0.0), "mA": (1e-3, 0.0), "uA": (1e-6, 0.0), "µA": (1e-6, 0.0), "kA": (1e3, 0.0)},
    "temperature": {
        "degC": (1.0, 0.0), "°C": (1.0, 0.0), "C": (1.0, 0.0), "deg C": (1.0, 0.0), "K": (1.0, -273.15),
        "degF": (5.0 / 9.0, -160.0 / 9.0), "°F": (5.0 / 9.0, -160.0 / 9.0),
    },
    "voltage": {"V": (1.0, 0.0), "mV": (1e-3, 0.0)},
    "time": {"s": (1e6, 0.0), "ms": (1e3, 0.0), "us": (1.0, 0.0), "µs": (1.0, 0.0), "ns": (1e-3, 0.0)},
}
"""Factor and offset from a DBC's unit to A, degC, V and us."""
SHARES = ("%", "percent")
"""Units of a current that is a share of `full_scale`."""


class RoleProblem(NamedTuple):
    """One thing wrong: where in the roles file (empty: in the DBC, at `line`), and what would be right."""

    place: Place
    text: str
    line: int = 0


class RoleProblems(LocalProtocolError):
    """A roles file and a DBC that cannot be used together: every reason."""

    def __init__(self, problems: Collection[RoleProblem]) -> None:
        self.problems = tuple(problems)
        super().__init__("; ".join(f"{'.'.join(item.place) or 'DBC'}: {item.text}" for item in self.problems))


@dataclass(frozen=True)
class Found:
    """A signal that an entry names, in its message."""

    message: DbcMessage
    given: DbcSignal

    @property
    def signal(self) -> Signal:
        """Where it lies."""
        return self.given.signal

    def placed(self, *, plain: bool = False) -> Placed:
        """It, on the pages on which it is."""
        return Placed(self.signal, plain, self.given.pages)


@dataclass
class Reading:
    """The DBC's messages, and what was named wrong so far."""

    messages: Mapping[str, DbcMessage]
    problems: list[RoleProblem] = field(default_factory=list)

    def wrong(self, place: Place, text: str, line: int = 0) -> None:
        """Note a problem."""
        self.problems.append(RoleProblem(place, text, line))

    def only(self, given: Collection[str], known: Collection[str], place: Place) -> None:
        """Note the keys that mean nothing here."""
        for key in given:
            if key not in known:
                near = difflib.get_close_matches(key, known, n=1)
                hint = f"did you mean {near[0]}?" if near else f"known here: {', '.join(known)}"
                self.wrong((*place, key), f"unknown key; {hint}")

    def table(self, value: object, place: Place) -> Mapping[str, Any]:
        """A table, else an empty one and a problem; nothing where it is not given."""
        if value is None:
            return {}
        if isinstance(value, Mapping):
            return value
        self.wrong(place, f"must be a table, with the heading [{'.'.join(place)}]")
        return {}

    def find(self, name: object, place: Place) -> Found | None:
        """The signal of a "Message.signal"."""
        if not isinstance(name, str) or name.count(".") != 1:
            self.wrong(place, 'must be a text of the form "Message.signal", with the names of the DBC')
            return None
        first, _, second = name.partition(".")
        message = self.messages.get(first)
        if message is None:
            near = difflib.get_close_matches(first, self.messages, n=3, cutoff=0.5)
            having = [item.name for item in self.messages.values() if second in item.signals]
            nearest = list(dict.fromkeys([*having, *near])) or list(self.messages)[:8]
            self.wrong(place, f"the DBC has no message {first!r}; nearest: {', '.join(nearest)}")
            return None
        return self.signal(message, second, place)

    def signal(self, message: DbcMessage, name: str, place: Place) -> Found | None:
        """A signal of a message, if it can be used at all."""
        given = message.signals.get(name)
        if given is None:
            near = difflib.get_close_matches(name, message.signals, n=3, cutoff=0.4) or list(message.signals)[:8]
            elsewhere = [item.name for item in self.messages.values() if name in item.signals]
            hint = f"; {', '.join(elsewhere)} has one of that name" if elsewhere else ""
            at = f" (line {message.line} of the DBC)" if message.line else ""
            self.wrong(place, f"message {message.name!r}{at} has no signal {name!r}; nearest: {', '.join(near)}{hint}")
            return None
        problem = _unusable(given, message)
        if problem:
            self.wrong(place, f"signal {name!r} (line {given.line} of the DBC): {problem}")
            return None
        return Found(message, given)

    def number(self, value: object, named: Found, place: Place) -> int | None:
        """A number of a signal on the wire, given as such or by its name in the DBC (VAL_)."""
        signal, names = named.signal, named.given.names
        if isinstance(value, bool):
            value = int(value)
        if isinstance(value, str):
            matching = [number for number, name in names.items() if name.casefold() == value.casefold()]
            if matching:
                return matching[0]
            near = difflib.get_close_matches(value, names.values(), n=2, cutoff=0.5) or list(names.values())[:8]
            known = f"nearest: {', '.join(near)}" if names else "the DBC names none of its values; give the number"
            self.wrong(place, f"{signal.name} has no value named {value!r}; {known}")
            return None
        if not isinstance(value, int):
            said = f"must be a whole number as on the wire, or the name of a value of {signal.name} in quotes"
            self.wrong(place, said)
            return None
        if not signal.low <= value <= signal.high:
            self.wrong(place, f"{signal.name} holds {signal.low:g} to {signal.high:g} on the wire")
            return None
        return value

    def numbers(self, value: object, named: Found, place: Place) -> frozenset[int]:
        """One or several numbers of a signal."""
        items = value if isinstance(value, list | tuple) else [value]
        found_numbers = (self.number(item, named, place) for item in items)
        return frozenset(number for number in found_numbers if number is not None)

    def whole(self, value: object, low: int, high: int, place: Place, default: int | None = None) -> int | None:
        """A whole number of a range."""
        if value is None and default is not None:
            return default
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            missing = "is missing; write" if value is None else "must be"
            self.wrong(place, f"{missing} a whole number of {low} to {high} (0x{high:X})")
            return None
        return value

    def seconds(self, value: object, place: Place) -> float | None:
        """A duration such as "10 ms"."""
        match = _DURATION.fullmatch(value) if isinstance(value, str) else None
        if match is None or not 0.0 < float(match[1]) * _SECONDS[match[2]] <= 60.0:
            self.wrong(place, 'must be a duration with its unit, such as "10 ms"; allowed: more than 0 s to 60 s')
            return None
        return float(match[1]) * _SECONDS[match[2]]

    def choice(self, value: object, known: Collection[str], place: Place) -> str:
        """One of some words; the first where it is wrong."""
        if isinstance(value, str) and value in known:
            return value
        self.wrong(place, f"must be one of {', '.join(known)}")
        return next(iter(known))

    def in_unit(self, named: Found, dimension: str, table: Mapping[str, Any], place: Place) -> Found | None:
        """The signal in A, degC, V or us, whatever unit the DBC has for it."""
        signal, units = named.signal, UNITS[dimension]
        unit = table.get("unit", signal.unit)
        if not isinstance(unit, str):
            self.wrong((*place, "unit"), f"{unit!r:.40} must be a text, such as \"mA\"")
            return None
        if dimension == "current" and unit in SHARES:
            full = table.get("full_scale")
            match = _FULL_SCALE.fullmatch(full) if isinstance(full, str) else None
            if match is None or not 0.0 < float(match[1]) < math.inf:
                self.wrong((*place, "full_scale"), 'is a share in %: write the current of 100 %, full_scale = "3 A"')
                return None
            factor, offset = float(match[1]) * (1e-3 if match[2] else 1.0) / 100.0, 0.0
        elif unit in units:
            factor, offset = units[unit]
        elif unit == "" and dimension in {"temperature", "voltage"}:
            factor, offset = 1.0, 0.0
        else:
            said = f"is in {unit!r}" if unit else "has no unit in the DBC"
            known = ", ".join((*units, *(SHARES[:1] if dimension == "current" else ())))
            self.wrong(place, f'{signal.name} {said}; allowed: {known}. Write {{signal = "...", unit = "..."}}')
            return None
        base = {"current": "A", "temperature": "degC", "voltage": "V", "time": "us"}[dimension]
        converted = replace(signal, scale=signal.scale * factor, offset=signal.offset * factor + offset, unit=base)
        given = replace(
            named.given, signal=converted,
            minimum=None if named.given.minimum is None else named.given.minimum * factor + offset,
            maximum=None if named.given.maximum is None else named.given.maximum * factor + offset,
        )
        return Found(named.message, given)


def _unusable(given: DbcSignal, message: DbcMessage) -> str:
    """What is wrong with a signal by itself; empty where nothing is."""
    signal = given.signal
    if not math.isfinite(signal.scale) or signal.scale == 0.0:
        return f"its scale is {signal.scale:g}; a scale is any number but 0"
    if not math.isfinite(signal.offset):
        return f"its offset is {signal.offset:g}"
    if signal.is_float and signal.length not in {16, 32, 64}:
        return f"a float has 16, 32 or 64 bits, this one {signal.length}"
    if not 1 <= signal.length <= 64:
        return f"it has {signal.length} bits; allowed: 1 to 64"
    bits = signal.bits(message.size)
    if min(bits) < 0 or max(bits) >= 8 * message.size:
        return f"it ends beyond the {message.size} bytes of {message.name}"
    return ""

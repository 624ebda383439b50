"""The entries of a roles file against a DBC: each that cannot be used is noted with its place, none raises."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

from drivers.devices.dbc_file import DbcMessage, DbcSignal
from drivers.register_maps.entries import listed
from protocols.can_signals import Placed, Signal
from protocols.errors import LocalProtocolError
from protocols.near_miss import meant, near_names
from protocols.wire_units import ALIASES, UNITS, quantity

Place = tuple[str, ...]
_UNITS: Mapping[str, tuple[str, ...]] = {
    "current": ("A", "mA", "uA", "µA", "kA"), "voltage": ("V", "mV"), "time": ("s", "ms", "us", "µs", "ns"),
    "temperature": ("degC", "°C", "C", "deg C", "K", "degF", "°F"),
}  # fmt: skip
"""Units that a DBC may have for a quantity."""
_SPELLINGS = {"°C": "degC", "C": "degC", "deg C": "degC", "°F": "degF"}
_MEASURES = {
    "command": "current", "measured_current": "current", "coil_temperature": "temperature",
    "ecu_temperature": "temperature", "supply_voltage": "voltage", "clock": "time",
}  # fmt: skip
_BASE = {"current": ("A", 1.0), "temperature": ("degC", 1.0), "voltage": ("V", 1.0), "time": ("us", 1e6)}
"""Unit in which the driver has a quantity, and how many of it are one SI unit."""
SCALING = ("scale", "offset")
"""Keys of a role that rescales its signal: value = scale * value according to the DBC file + offset."""
SHARES = ("%", "percent")
"""Units of a current that is a share of `full_scale`."""


def units_of(role: str) -> tuple[str, ...]:
    """Units that the signal of a role may have; none where it is a plain number."""
    dimension = _MEASURES.get(role, "")
    return _UNITS.get(dimension, ()) + (SHARES[:1] if dimension == "current" else ())


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

    def of_messages(self, given: Collection[str], place: Place) -> None:
        """Note the keys that are not messages of the DBC."""
        for key in given:
            if key not in self.messages:
                self.wrong((*place, key), f"the DBC file has no such message; {meant(key, self.messages)}")

    def find(self, name: str, place: Place) -> Found | None:
        """The signal of a "Message.signal"."""
        if name.count(".") != 1:
            self.wrong(place, 'must be a string of the form "Message.signal", with the names in the DBC file')
            return None
        first, _, second = name.partition(".")
        message = self.messages.get(first)
        if message is None:
            near = near_names(first, self.messages, 3, 0.5)
            having = [item.name for item in self.messages.values() if second in item.signals]
            nearest = list(dict.fromkeys([*having, *near])) or list(self.messages)[:8]
            self.wrong(place, f"the DBC file has no message {first!r}; nearest: {', '.join(nearest)}")
            return None
        return self.signal(message, second, place)

    def signal(self, message: DbcMessage, name: str, place: Place) -> Found | None:
        """A signal of a message, if it can be used at all."""
        given = message.signals.get(name)
        if given is None:
            near = near_names(name, message.signals, 3, 0.4) or list(message.signals)[:8]
            elsewhere = [item.name for item in self.messages.values() if name in item.signals]
            hint = f"; a signal of that name exists in {', '.join(elsewhere)}" if elsewhere else ""
            at = f" (line {message.line} of the DBC file)" if message.line else ""
            self.wrong(place, f"message {message.name!r}{at} has no signal {name!r}; nearest: {', '.join(near)}{hint}")
            return None
        problem = _unusable(given, message)
        if problem:
            at = f" (line {given.line} of the DBC file)" if given.line else ""
            self.wrong(place, f"signal {name!r}{at}: {problem}")
            return None
        return Found(message, given)

    def number(self, value: bool | float | str, named: Found, place: Place) -> int | None:
        """A number of a signal on the wire, given as such or by its name in the DBC (VAL_)."""
        signal, names = named.signal, named.given.names
        if isinstance(value, bool):
            value = int(value)
        if isinstance(value, str):
            matching = [number for number, name in names.items() if name.casefold() == value.casefold()]
            if matching:
                return matching[0]
            near = near_names(value, names.values(), 2, 0.5) or list(names.values())[:8]
            known = f"nearest: {', '.join(near)}" if names else (
                "the DBC file defines no value names for this signal. Fix: enter the number"
            )
            self.wrong(place, f"{signal.name} has no value named {value!r}; {known}")
            return None
        if not isinstance(value, int):
            text = f"must be a raw integer, or the name of a value of {signal.name} in quotes"
            self.wrong(place, text)
            return None
        if not signal.low <= value <= signal.high:
            self.wrong(place, f"the raw range of {signal.name} is {signal.low:g} to {signal.high:g}")
            return None
        return value

    def numbers(self, value: Any, named: Found, place: Place) -> frozenset[int]:  # noqa: ANN401 - one or several
        """One or several numbers of a signal."""
        found_numbers = (self.number(item, named, place) for item in listed(value))
        return frozenset(number for number in found_numbers if number is not None)

    def whole(self, value: int, low: int, high: int, place: Place) -> int | None:
        """A whole number of a range."""
        if low <= value <= high:
            return value
        self.wrong(place, f"must be a whole number from {low} to {high} (0x{high:X})")
        return None

    def in_unit(self, named: Found, dimension: str, table: Mapping[str, Any], place: Place) -> Found | None:
        """The signal converted to A, degC, V or us from the unit and scale in the DBC file."""
        named = _scaled(named, table.get("scale", 1.0), table.get("offset", 0.0))
        signal, units = named.signal, _UNITS[dimension]
        unit = table.get("unit", signal.unit)
        base, per_si = _BASE[dimension]
        if dimension == "current" and unit in SHARES:
            if "full_scale" not in table:
                self.wrong((*place, "full_scale"), 'is missing; the unit of the signal is %. Fix: write the '
                    'current at 100 %, such as full_scale = "3 A"')
                return None
            factor, offset = quantity(table["full_scale"])[0] / 100.0, 0.0
        elif unit in units:
            known = UNITS[ALIASES.get(unit, _SPELLINGS.get(unit, unit))]
            factor, offset = known.scale * per_si, known.offset * per_si
        elif unit == "" and dimension in {"temperature", "voltage"}:
            factor, offset = 1.0, 0.0
        else:
            if table.keys() & set(SCALING) and "unit" not in table:
                self.wrong(place, f"this role scales {signal.name}, so the unit after scaling must be specified. Fix: "
                    f"unit = \"{units[0]}\"")
                return None
            text = f"is in {unit!r}" if unit else "has no unit in the DBC file"
            known_units = ", ".join((*units, *(SHARES[:1] if dimension == "current" else ())))
            self.wrong(place, f'{signal.name} {text}; allowed: {known_units}. Fix: write {{signal = "...", unit = '
                f'"..."}}')
            return None
        in_base = _scaled(named, factor, offset)
        return Found(in_base.message, replace(in_base.given, signal=replace(in_base.signal, unit=base)))


def _scaled(named: Found, factor: float, offset: float) -> Found:
    """The signal with its value and limits rescaled: `factor` times the value in the DBC file plus `offset`."""
    signal, given = named.signal, named.given
    ends = [None if end is None else end * factor + offset for end in (given.minimum, given.maximum)]
    if factor < 0.0:
        ends.reverse()
    scaled = replace(signal, scale=signal.scale * factor, offset=signal.offset * factor + offset)
    return Found(named.message, replace(given, signal=scaled, minimum=ends[0], maximum=ends[1]))


def _unusable(given: DbcSignal, message: DbcMessage) -> str:
    """What is wrong with a signal by itself; empty where nothing is."""
    signal = given.signal
    if not math.isfinite(signal.scale) or signal.scale == 0.0:
        return f"its scale is {signal.scale:g}; the scale must be finite and not 0"
    if not math.isfinite(signal.offset):
        return f"its offset is {signal.offset:g}; the offset must be finite"
    if signal.is_float and signal.length not in {16, 32, 64}:
        return f"a float has 16, 32 or 64 bits, but this signal has {signal.length}"
    if not 1 <= signal.length <= 64:
        return f"the signal has {signal.length} bits; allowed: 1 to 64"
    bits = signal.bits(message.size)
    if min(bits) < 0 or max(bits) >= 8 * message.size:
        return f"the signal extends beyond the {message.size} bytes of {message.name}"
    return ""

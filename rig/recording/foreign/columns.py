"""Which column of a foreign file is which quantity, and in what unit."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from rig.errors import FileProblem
from rig.recording.foreign.foreign_file import ForeignColumn
from rig.units import ALIASES, UNITS, Unit, key_suffixes, units_of

DIMENSION = {"time": "time", "displacement": "length", "force": "force", "current": "current",
             "commanded_current": "current", "voltage": "voltage", "temperature": "temperature"}
REQUIRED = ("displacement", "force")
MOST_SHOWN = 40
FOREIGN = {
    "in": Unit("length", 0.0254), "lbf": Unit("force", 4.4482216152605), "kip": Unit("force", 4448.2216152605),
    "kgf": Unit("force", 9.80665),
}
"""Units that only other programs' files have."""
WORDS = {
    "s": "s", "sec": "s", "secs": "s", "second": "s", "seconds": "s", "sek": "s", "msec": "ms", "millisecond": "ms",
    "milliseconds": "ms", "usec": "us", "metre": "m", "meter": "m", "metres": "m", "meters": "m", "millimetre": "mm",
    "millimeter": "mm", "millimetres": "mm", "millimeters": "mm", "inch": "in", "inches": "in", "newton": "N",
    "newtons": "N", "kilonewton": "kN", "kilonewtons": "kN", "kips": "kip", "lb": "lbf", "lbs": "lbf", "kp": "kgf",
    "amp": "A", "amps": "A", "ampere": "A", "amperes": "A", "milliampere": "mA", "milliamperes": "mA",
    "celsius": "degC", "kelvin": "K",
}  # fmt: skip
"""Units as programs write them out, in small letters."""
BRACKETED = re.compile(r"(?P<name>.*?\S)\s*[\[(](?P<unit>[^\[\]()]{1,20})[\])]")
AFTER_WORD = re.compile(r"(?P<name>.*?\S)(?:\s*/\s*|,\s*|\s+in\s+)(?P<unit>[^\s/,]{1,12})")
LIKELY = {
    "time": ("t", "time", "zeit", "temps", "tiempo"),
    "displacement": ("x", "u", "displacement", "disp", "stroke", "position", "weg", "hub", "desplazamiento"),
    "force": ("f", "force", "load", "kraft", "fuerza"),
    "current": ("i", "current", "strom", "corriente"),
    "voltage": ("voltage", "volt", "spannung", "voltaje"),
    "temperature": ("temp", "temperature", "temperatura"),
}  # fmt: skip
"""Names to suggest a column by; nothing is taken for a quantity because of its name."""


@dataclass(frozen=True)
class ColumnChoice:
    """A column that was found: SI value = number x scale + offset of `unit`; None: time stamps, in s already.

    Attributes:
        text: as the user wrote it.
        column: the file's name of it.
        place: which of the file's columns, from 0.
        unit: of its numbers.
        unit_from: who says so, for people; empty for time stamps.
    """

    text: str
    column: str
    place: int
    unit: Unit | None
    unit_name: str
    unit_from: str

    @property
    def told(self) -> str:
        """For people: name, unit, and who says so."""
        return f"{self.column} ({f'{self.unit_name}, {self.unit_from}' if self.unit else 'time stamps'})"


def check_wanted(columns: Mapping[str, str]) -> None:
    """Look at `{"displacement": "x_mm", "force": "F:kN", ...}` before any file is opened.

    Raises:
        FileProblem: one line for each quantity that is unknown or missing.
    """
    problems = [
        f"{quantity}={text}: unknown quantity; known: {', '.join(DIMENSION)}"
        for quantity, text in columns.items() if quantity not in DIMENSION
    ]  # fmt: skip
    problems += [f"{name}: no column named; write --column {name}=NAME" for name in REQUIRED if name not in columns]
    if problems:
        raise FileProblem("--column", problems)


def known_unit(text: str) -> str:
    """The name in our table of a unit as a file writes it; empty where it is not known."""
    bare = text.strip().strip("[]()").strip()
    name = ALIASES.get(bare, bare)
    if name in UNITS or name in FOREIGN:
        return name
    return WORDS.get(bare.casefold(), {"kn": "kN", "mm": "mm", "sec.": "s"}.get(bare.casefold(), ""))


def split_heading(text: str) -> tuple[str, str]:
    """A CSV column's heading as its name and the unit in it: `F [kN]`, `F (kN)`, `F / kN`, `F, kN`, `F in kN`."""
    for pattern in (BRACKETED, AFTER_WORD):
        match = pattern.fullmatch(text)
        if match and known_unit(match["unit"]):
            return match["name"], match["unit"]
    return text, ""


def choose(
    columns: Sequence[ForeignColumn], wanted: Mapping[str, str], stamps: Callable[[int], bool]
) -> dict[str, ColumnChoice]:
    """Find the wanted columns in a file.

    Args:
        columns: the file's.
        wanted: quantity -> NAME, NAME:UNIT, or #3 (#3:mm) for the third column.
        stamps: whether the column at a place holds time stamps.

    Raises:
        FileProblem: (without the file's name) one line for each that is not there, is there twice, or whose unit is
            not known or not one of its quantity.
    """
    chosen, problems = {}, []
    for quantity, text in wanted.items():
        try:
            place, given = _found(columns, text)
            if quantity == "time" and not given and stamps(place):
                chosen[quantity] = ColumnChoice(text, columns[place].name, place, None, "", "")
                continue
            name, source = _unit(columns[place], given, DIMENSION[quantity])
            unit = UNITS.get(name) or FOREIGN[name]
            chosen[quantity] = ColumnChoice(text, columns[place].name, place, unit, name, source)
        except ValueError as error:
            problems.append(f"{quantity}={text}: {error}")
    if problems:
        raise FileProblem("", problems)
    return chosen


def _found(columns: Sequence[ForeignColumn], text: str) -> tuple[int, str]:
    """Place of a column and the unit that the user gave it.

    Raises:
        ValueError: there is none of that name, or more than one.
    """
    name, colon, unit = text.rpartition(":")
    for wanted, given in ((text, ""), (name, unit)) if colon else ((text, ""),):
        places = _places(columns, wanted)
        if len(places) == 1:
            return places[0], given
        if places:
            full = [columns[place].full for place in places]
            apart = all(full) and len({*full}) == len(full)
            others = ", ".join(full if apart else [f"#{place + 1}" for place in places])
            raise ValueError(f"{len(places)} columns are called {wanted!r}; name one of them by {others}")
    shown = ", ".join(column.name for column in columns[:MOST_SHOWN])
    more = f" and {len(columns) - MOST_SHOWN} more" if len(columns) > MOST_SHOWN else ""
    raise ValueError(f"no column {(name if colon else text)!r}; columns: {shown}{more}")


def _places(columns: Sequence[ForeignColumn], wanted: str) -> list[int]:
    if re.fullmatch(r"#[0-9]{1,6}", wanted) and 1 <= int(wanted[1:]) <= len(columns):
        return [int(wanted[1:]) - 1]
    for attribute in ("full", "name"):
        places = [k for k, column in enumerate(columns) if wanted and getattr(column, attribute) == wanted]
        if places:
            return places
    return []


def _unit(column: ForeignColumn, given: str, dimension: str) -> tuple[str, str]:
    """The unit of a column: what the user says, else what file and name say, who must not contradict each other.

    Raises:
        ValueError: unknown, or not of the dimension.
    """
    units = f"units: {', '.join((*units_of(dimension), *(n for n, u in FOREIGN.items() if u.dimension == dimension)))}"
    if given:
        return _of(given, dimension, f"{given!r} is no unit of {dimension}; {units}"), "as given"
    suffixes = key_suffixes(dimension)
    named = [suffix for suffix in suffixes if column.name.endswith(f"_{suffix}")]
    by_name = suffixes[max(named, key=len)] if named else ""
    if not column.unit:
        if not by_name:
            raise ValueError("its unit is not known: end the name with it (x_mm) or write it after a colon "
                             f"({column.name}:{units_of(dimension)[0]})")  # fmt: skip
        return by_name, "by its name"
    problem = f"the file says {column.unit!r}, which is no unit of {dimension} ({units}); one after a colon counts more"
    by_file = _of(column.unit, dimension, problem)
    if by_name and by_name != by_file:
        raise ValueError(f"its name says {by_name} and the file {by_file}: write after a colon which it is")
    return by_file, "the file says"


def _of(text: str, dimension: str, problem: str) -> str:
    name = known_unit(text)
    unit = UNITS.get(name) or FOREIGN.get(name)
    if unit is None or unit.dimension != dimension:
        raise ValueError(problem)
    return name


def suggestions(columns: Sequence[ForeignColumn], quantities: Sequence[str]) -> Iterator[str]:
    """Options that may be meant, by the columns' names, for the quantities that are not named yet."""
    for quantity in quantities:
        for column in columns:
            last = re.split(r"[/.\s]", column.name)[-1].casefold()
            if last.split("_")[0] in LIKELY.get(quantity, ()):
                unit = "" if column.unit or "_" in last else f":{units_of(DIMENSION[quantity])[0]}"
                yield f"--column {quantity}={column.name}{unit}"
                break

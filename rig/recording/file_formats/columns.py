"""Assignment of a file's columns to quantities and units."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from rig.errors import FileProblem, some
from rig.recording.file_formats.file_units import (
    COUNTS,
    DIMENSION,
    MASS_FOR_FORCE,
    TEMPERATURES,
    Scaling,
    known_unit,
    named_unit,
    scaling_of,
    units_for,
)
from rig.recording.file_formats.table_file import TableColumn
from rig.units import DIMENSIONS, Unit, key_suffixes, units_of

REQUIRED = ("displacement", "force")
MOST_SHOWN = 40
BRACKETED = re.compile(r"(?P<name>.*?\S)\s*[\[(](?P<unit>[^\[\]()]{1,20})[\])]")
AFTER_WORD = re.compile(r"(?P<name>.*?\S)(?:\s*/\s*|,\s*|\s+in\s+)(?P<unit>[^\s/,]{1,12})")
LONGEST_HEADING = 400
"""Characters; the two above take time quadratic in a row of blanks."""
LIKELY = {
    "time": ("t", "time", "zeit", "temps", "tiempo"),
    "displacement": ("x", "u", "displacement", "disp", "stroke", "position", "weg", "hub", "desplazamiento"),
    "force": ("f", "force", "load", "kraft", "fuerza"),
    "current": ("i", "current", "strom", "corriente"),
    "voltage": ("voltage", "volt", "spannung", "voltaje"),
    "temperature": ("temp", "temperature", "temperatura"),
}  # fmt: skip
"""Names to suggest a column by; nothing is taken for a quantity because of its name."""
NOT_MEASURED = frozenset((
    "cmd", "command", "commanded", "set", "setpoint", "soll", "sollwert", "ref", "reference", "target", "demand", "min",
    "max", "peak", "mean", "avg", "rate", "error", "limit", "count", "counter", "number", "index",
))  # fmt: skip
"""Words in the names of columns that hold something else than the measured quantity."""
FROM_NAME, FROM_FILE = "from the column name", "from the file"
CERTAIN = 2
"""A column that looks less like a quantity is not suggested."""


@dataclass(frozen=True)
class ColumnChoice:
    """A column that was found: SI value = number x scale + offset of `unit`; None: time stamps, in s already.

    Attributes:
        text: as the user wrote it.
        column: the file's name of it.
        place: which of the file's columns, from 0.
        unit: of its numbers.
        unit_from: who says so, for people; empty for time stamps.
        applied: factor or conversion of the file's format that the numbers already contain.
    """

    text: str
    column: str
    place: int
    unit: Unit | None
    unit_name: str
    unit_from: str
    applied: str = ""

    @property
    def description(self) -> str:
        """For people: name, unit, who says so, and what the file's format has applied."""
        applied = f", {self.applied} applied" * bool(self.applied)
        return f"{self.column} ({f'{self.unit_name}, {self.unit_from}{applied}' if self.unit else 'time stamps'})"


def check_choices(columns: Mapping[str, str], scales: Mapping[str, str | float]) -> None:
    """Check `{"displacement": "x_mm", "force": "F:kN", ...}` and the scales before any file is opened.

    Raises:
        FileProblem: one line for each quantity that is unknown or missing.
    """
    problems = [
        f"{quantity}={text}: unknown quantity; known: {', '.join(DIMENSION)}"
        for quantity, text in columns.items() if quantity not in DIMENSION
    ]  # fmt: skip
    problems += [no_column(name) for name in REQUIRED if name not in columns]
    for quantity, text in scales.items():
        if quantity not in columns:
            problems.append(f"--scale {quantity}={text}: no {quantity} column is specified")
            continue
        try:
            scaling_of(quantity, text)
        except (ValueError, KeyError) as error:
            problems.append(f"--scale {quantity}: {error}")
    if problems:
        raise FileProblem("--column", problems)


def no_column(quantity: str) -> str:
    """The problem that a quantity has no column."""
    return f"{quantity}: no column given. Fix: write --column {quantity}=NAME"


def split_heading(text: str) -> tuple[str, str]:
    """A CSV column's heading as its name and the unit in it: `F [kN]`, `F (kN)`, `F / kN`, `F, kN`, `F in kN`."""
    for pattern in (BRACKETED, AFTER_WORD):
        match = pattern.fullmatch(text) if len(text) <= LONGEST_HEADING else None
        if match and known_unit(match["unit"]):
            return match["name"], match["unit"]
    return text, ""


def choose(
    columns: Sequence[TableColumn], requested: Mapping[str, str], stamps: Callable[[int], bool],
    scales: Mapping[str, str | float] | None = None,
) -> dict[str, ColumnChoice]:
    """Find the wanted columns in a file.

    Args:
        columns: the file's.
        requested: quantity -> NAME, NAME:UNIT, or #3 (#3:mm) for the third column.
        stamps: whether the column at a place holds time stamps.
        scales: quantity -> factor or sensitivity of its numbers, as `scaling_of` reads it.

    Raises:
        FileProblem: (without the file's name) one line for each that is not there, is there twice, or whose unit is
            not known or not one of its quantity.
    """
    chosen, problems = {}, []
    for quantity, text in requested.items():
        try:
            chosen[quantity] = _chosen(columns, quantity, text, stamps, scales or {})
        except ValueError as error:
            problems.append(f"{quantity}={text}: {error}")
    if problems:
        raise FileProblem("", problems)
    return chosen


def _chosen(
    columns: Sequence[TableColumn], quantity: str, text: str, stamps: Callable[[int], bool],
    scales: Mapping[str, str | float],
) -> ColumnChoice:
    """The column of a quantity.

    Raises:
        ValueError: it is not there or there twice, or its unit or scale does not fit.
    """
    place, given = _found(columns, text)
    column = columns[place]
    named_alike = [one for one in columns if one.name == column.name]
    name = column.full if len(named_alike) > 1 and column.full else column.name
    scaling = scaling_of(quantity, scales[quantity]) if quantity in scales else None
    if scaling is None and column.unapplied:
        raise ValueError(
            f"the column contains integers, and its property {column.unapplied} (possibly a factor) is not applied. "
            f"Fix: use --scale {quantity}=FACTOR with this factor (1 if the numbers are already in their unit)"
        )
    if quantity == "time" and not given and stamps(place):
        if scaling is not None:
            raise ValueError("a factor cannot be applied to time stamps. Fix: remove --scale time")
        return ColumnChoice(text, name, place, None, "", "")
    try:
        unit = _scaled_unit(column, given, DIMENSION[quantity], scaling)
        return ColumnChoice(text, name, place, *unit, column.applied)
    except ValueError as error:
        if quantity != "time":
            raise
        raise ValueError(
            f"{error}. If the column contains time stamps, their format is unknown. Fix: write them as 2026-12-31 "
            "23:59:59.123 or as seconds, or, for samples at a constant rate, use --rate instead of the column"
        ) from error


def _scaled_unit(
    column: TableColumn, given: str, dimension: str, scaling: Scaling | None
) -> tuple[Unit, str, str]:
    """The unit of a column with the user's factor or sensitivity in it, its name, and who states it.

    Raises:
        ValueError: unknown, or not of the dimension.
    """
    if scaling is None or scaling.per is None:
        name, source = _unit(column, given, dimension)
        unit = units_for(dimension)[name]
        if scaling is None:
            return unit, name, source
        return Unit(dimension, unit.scale * scaling.factor, unit.offset), name, f"{source}, times {scaling.text}"
    stated = given or column.unit or _suffix_unit(column.name, dimension)
    if not scaling.per:
        if stated and stated.casefold() not in COUNTS:
            raise ValueError(f"the unit of the column is {stated!r}, but --scale {scaling.text!r} requires counts")
        return Unit(dimension, scaling.factor), "counts", f"{scaling.text} as given"
    suffix = column.name.rpartition("_")[2] if "_" in column.name else ""
    own = named_unit(stated, scaling.per) if stated else named_unit(suffix or scaling.per_unit, scaling.per)
    if stated and own is None:
        raise ValueError(
            f"the unit of the column is {stated!r}, but --scale {scaling.text!r} requires {scaling.per_unit}"
        )
    name, unit = own or (scaling.per_unit, units_for(scaling.per)[scaling.per_unit])
    return Unit(dimension, unit.scale * scaling.factor), name, f"{scaling.text} as given"


def _found(columns: Sequence[TableColumn], text: str) -> tuple[int, str]:
    """Place of a column and the unit that the user gave it.

    Raises:
        ValueError: there is none of that name, or more than one.
    """
    name, colon, unit = text.rpartition(":")
    for label, given in ((text, ""), (name, unit)) if colon else ((text, ""),):
        places = _places(columns, label)
        if len(places) == 1:
            return places[0], given
        if places:
            full = [columns[place].full for place in places]
            apart = all(full) and len({*full}) == len(full)
            others = ", ".join(full if apart else [f"#{place + 1}" for place in places])
            raise ValueError(
                f"{len(places)} columns have the name {label!r}. Fix: select one of them with {others}"
            )
    shown = some([column.name for column in columns], most=MOST_SHOWN)
    raise ValueError(f"no column {(name if colon else text)!r}; columns: {shown}")


def _places(columns: Sequence[TableColumn], requested: str) -> list[int]:
    if re.fullmatch(r"#[0-9]{1,6}", requested) and 1 <= int(requested[1:]) <= len(columns):
        return [int(requested[1:]) - 1]
    for attribute in ("full", "name", "also"):
        places = [k for k, column in enumerate(columns) if requested and getattr(column, attribute) == requested]
        if places:
            return places
    return []


def _unit(column: TableColumn, given: str, dimension: str) -> tuple[str, str]:
    """The unit of a column: what the user says, else what file and name say, who must not contradict each other.

    Raises:
        ValueError: unknown, or not of the dimension.
    """
    units = f"known units: {', '.join(units_for(dimension))}"
    if given:
        return _of(given, dimension, f"{given!r} is not a unit of {dimension}; {units}"), "as given"
    by_name = _suffix_unit(column.name, dimension) or _bracketed_temperature(column.name, dimension)
    if not column.unit:
        if not by_name:
            raise ValueError("unknown unit. Fix: append the unit to the column name (x_mm), write it after a colon "
                f"({column.name}:{units_of(dimension)[0]}), or specify a sensitivity with --scale")  # fmt: skip
        return by_name, FROM_NAME
    problem = (f"the file states the unit {column.unit!r}, which is not a unit of {dimension} ({units}). Fix: "
        "write the unit after a colon, or specify a sensitivity with --scale")  # fmt: skip
    by_file = _of(column.unit, dimension, problem)
    if by_name and by_name != by_file:
        raise ValueError(f"the column name states {by_name}, but the file states {by_file}. Fix: write the correct "
            "unit after a colon")
    return by_file, FROM_FILE


def unit_stated(column: TableColumn) -> str:
    """The unit of a column for people, as the file or the column's name states it; empty where neither does."""
    if column.unit:
        return column.unit
    suffixes = {end: unit for dimension in DIMENSIONS for end, unit in key_suffixes(dimension).items()}
    unit = _at_end(column.name, suffixes)
    return f"{unit}, {FROM_NAME}" if unit else ""


def _suffix_unit(name: str, dimension: str) -> str:
    """The unit at the end of a column's name, after an underscore; empty where there is none of this dimension."""
    return _at_end(name, {**{unit: unit for unit in units_for(dimension)}, **key_suffixes(dimension)})


def _bracketed_temperature(name: str, dimension: str) -> str:
    """The unit of a column named, for example, `Temp (F)`; `split_heading` does not know what the column contains."""
    match = BRACKETED.fullmatch(name) if dimension == "temperature" else None
    return "" if match is None else TEMPERATURES.get(match["unit"].strip(), "")


def _at_end(name: str, suffixes: Mapping[str, str]) -> str:
    """The unit of the longest suffix at the end of a name, after an underscore; empty if there is none."""
    named = max((suffix for suffix in suffixes if name.endswith(f"_{suffix}")), key=len, default="")
    return suffixes[named] if named else ""


def _of(text: str, dimension: str, problem: str) -> str:
    unit = named_unit(text, dimension)
    if unit is None:
        mass = MASS_FOR_FORCE.get(text.strip("[]() ").casefold(), "") if dimension == "force" else ""
        raise ValueError(problem + (f"; a force displayed in {text} has the unit {mass}" if mass else ""))
    return unit[0]


def suggestions(columns: Sequence[TableColumn], quantities: Sequence[str]) -> dict[str, str]:
    """Quantity -> option that may be meant, quoted for a shell, for the quantities that are not named yet.

    By the columns' names and units; a column is suggested once, and none whose unit is of another dimension.
    """
    left, options = list(range(len(columns))), dict[str, str]()
    for quantity in quantities:
        scores = {place: _likeness(columns[place], quantity) for place in left}
        best = max(scores, key=lambda place: scores[place], default=None)
        if best is None or scores[best] < CERTAIN:
            continue
        left.remove(best)
        column, dimension = columns[best], DIMENSION[quantity]
        names = [one.name for one in columns]
        name = column.name if names.count(column.name) == 1 else column.full or f"#{best + 1}"
        unit = "" if column.unit or _suffix_unit(column.name, dimension) else f":{units_of(dimension)[0]}"
        options[quantity] = f"--column {shlex.quote(f'{quantity}={name}{unit}')}"
    return options


def _likeness(column: TableColumn, quantity: str) -> int:
    """How much a column looks like a quantity: by the last word of its name, any word, and its unit."""
    dimension = DIMENSION[quantity]
    words = [word for word in re.split(r"[^a-z0-9]+", column.name.casefold()) if word]
    if _suffix_unit(column.name, dimension) and len(words) > 1:
        words.pop()
        fits = True
    else:
        fits = named_unit(column.unit, dimension) is not None
    if (column.unit and not fits) or not words:
        return 0
    named = [word in LIKELY.get(quantity, ()) for word in words]
    return (3 * named[-1] or 1 * any(named)) + 2 * fits - 4 * any(word in NOT_MEASURED for word in words)

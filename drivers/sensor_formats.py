"""Sensor formats by name, file or table: where a driver, a check or a simulated sensor gets a format from."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers.ring import Channel
from protocols.binary_format import BinaryFormat
from protocols.errors import LocalProtocolError
from protocols.format_keys import FormatProblems, Problem
from protocols.line_format import LineFormat
from protocols.sensor_format import SensorFormat, from_description, preset
from protocols.sensor_presets import TABLES
from protocols.toml_lines import Place, scan_lines, structure_problem

FRAME16 = "frame16"
"""The project's own frame, which has a decoder of its own."""
FILE_ENDING = ".toml"
LARGEST_FILE_BYTES = 65_536
WIRE_UNITS = {Channel.FORCE: "N", Channel.DISPLACEMENT: "mm"}
NUMBER = "number"
OWN_UNIT = "signed-decimal"
"""The preset that writes the unit of its channel behind the number."""

Given = str | Mapping[str, Any]
"""As a bench file says it: a preset's name, a file's name, or a table."""


def is_file(given: object) -> bool:
    """Whether a format is given by a file's name."""
    return isinstance(given, str) and given.casefold().endswith(FILE_ENDING)


def described_format(given: Given, channel: Channel | None = None) -> SensorFormat:
    """A format that is not `frame16`.

    Args:
        given: a preset's name, the path of a file, or a table.
        channel: whose it is; the project's own line carries the unit of its channel.

    Raises:
        FormatProblems: a table or file that cannot be read or contradicts itself; each problem with its place, and for
            a file with its line.
        LocalProtocolError: no preset of that name.
    """
    if is_file(given):
        return _from_file(Path(str(given)))
    if not isinstance(given, str):
        return from_description(given)
    shipped = preset(given)
    if given == OWN_UNIT and channel is not None and isinstance(shipped, LineFormat):
        return replace(shipped, unit=WIRE_UNITS.get(channel, shipped.unit))
    return shipped


def table_of(given: Given) -> Mapping[str, Any]:
    """The entries of a format as a user would write them.

    Raises:
        FormatProblems: the file cannot be read.
        LocalProtocolError: no preset of that name.
    """
    if is_file(given):
        return _read(Path(str(given)))[0]
    if not isinstance(given, str):
        return given
    if given not in TABLES:
        raise LocalProtocolError(f"no format {given!r}; there are {', '.join(TABLES)}")
    return {"base": given}


def stated_unit(given: Given) -> str:
    """The unit that a file or table states; empty where it states none, or for a preset."""
    if isinstance(given, str) and not is_file(given):
        return ""
    return str(table_of(given).get("unit", ""))


def wire_text(given: Given) -> str:
    """A format in one line: its name, and how it makes a reading of the number on the wire where that is not all of it.

    Args:
        given: a preset's name, the path of a file, a table, or the name of a plug-in's format.
    """
    name = given if isinstance(given, str) else "described in the bench file"
    if isinstance(given, str) and given not in TABLES and not is_file(given):
        return name
    made = described_format(given)
    reading = _line_reading(made) if isinstance(made, LineFormat) else _frame_reading(made)
    return name if reading == NUMBER else f"{name}, read as {reading}"


def _line_reading(made: LineFormat) -> str:
    number = NUMBER
    if made.decimals:
        bare = "" if made.number.startswith("hexadecimal") else " where it has no decimal mark"
        number = f"({NUMBER} / {10**made.decimals}{bare})"
    reading = _scaled(made.scale, number, made.offset)
    if not made.units:
        return reading
    factors = ", ".join(f"{unit} {factor:.9g}" for unit, factor in {made.unit: 1.0, **made.units}.items())
    return f"({reading}) * factor of the unit behind it ({factors})"


def _frame_reading(made: BinaryFormat) -> str:
    value = made.fields["value"]
    return _scaled(value.scale, NUMBER, value.offset)


def _scaled(scale: float, number: str, offset: float) -> str:
    return f"{scale:.9g} * " * (scale != 1.0) + number + f" {offset:+.9g}" * (offset != 0.0)


def _from_file(path: Path) -> SensorFormat:
    table, lines = _read(path)
    try:
        return from_description({"name": path.stem, **table})
    except FormatProblems as error:
        placed: list[Problem] = []
        for place, text in error.problems:
            line = _line(lines, place)
            key = ".".join(map(str, place))
            placed.append(((), f"{path.name}{f' line {line}' if line else ''}: {f'{key}: ' if key else ''}{text}"))
        raise FormatProblems(path.stem, placed) from error


def _read(path: Path) -> tuple[dict[str, Any], Mapping[Place, int]]:
    """A file's table, and the line of each of its entries.

    Raises:
        FormatProblems: it cannot be read, or is not TOML.
    """
    try:
        if path.exists() and not path.is_file():
            raise FormatProblems(path.stem, [((), f"{path.name}: is no file")])
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE_BYTES + 1)
        text = data.decode("utf-8-sig")
        problem = "is larger than a format ever is" if len(data) > LARGEST_FILE_BYTES else structure_problem(text)
        if problem is None:
            return tomllib.loads(text), scan_lines(text)
    except OSError as error:
        problem = f"cannot be read: {error.strerror}; the path counts from the bench file's folder"
    except UnicodeDecodeError:
        problem = "is not a text in UTF-8"
    except ValueError as error:  # also a number of too many digits, which is no TOMLDecodeError
        problem = f"not valid TOML: {error}"
    raise FormatProblems(path.stem, [((), f"{path.name}: {problem}")])


def _line(lines: Mapping[Place, int], place: Place) -> int | None:
    """Line of the nearest entry that encloses a place."""
    return next((lines[place[:count]] for count in range(len(place), 0, -1) if place[:count] in lines), None)

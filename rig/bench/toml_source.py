"""A TOML file with the line of every key: the standard parser gives the values, a scan gives the places."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.errors import FileProblem

SIZE_LIMIT_BYTES = 262_144

Place = tuple[str | int, ...]


@dataclass(frozen=True)
class TomlSource:
    """Values of a file (lists as tuples) and the line of every table and key."""

    path: Path
    text: str
    data: dict[str, Any]
    lines: dict[Place, int]

    def line(self, place: Place) -> int | None:
        """Line (from 1) of the nearest known enclosing entry; None for the file itself."""
        for length in range(len(place), 0, -1):
            if place[:length] in self.lines:
                return self.lines[place[:length]]
        return None


def read_toml(path: Path) -> TomlSource:
    """Read a user's file.

    Raises:
        FileProblem: missing, not a file, too large, not UTF-8, or not TOML; with the line where there is one.
    """
    text = _read_text(path)
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FileProblem(str(path), [f"not valid TOML: {error}"]) from error
    except (ValueError, RecursionError) as error:
        raise FileProblem(str(path), ["not valid TOML: a number or a nesting beyond any sense"]) from error
    return TomlSource(path, text, {key: _frozen(value) for key, value in data.items()}, scan_lines(text))


def _read_text(path: Path) -> str:
    try:
        with path.open("rb") as file:
            raw = file.read(SIZE_LIMIT_BYTES + 1)
    except FileNotFoundError as error:
        raise FileProblem(str(path), ["there is no such file"]) from error
    except OSError as error:
        raise FileProblem(str(path), [f"cannot be read: {error.strerror}"]) from error
    if len(raw) > SIZE_LIMIT_BYTES:
        raise FileProblem(str(path), [f"larger than {SIZE_LIMIT_BYTES // 1024} KiB: not a file written for the rig"])
    try:
        return raw.decode("utf-8-sig").replace("\r\n", "\n")
    except UnicodeDecodeError as error:
        raise FileProblem(str(path), [f"not UTF-8 text (byte {error.start})"]) from error


def _frozen(value: object) -> object:
    if isinstance(value, list):
        return tuple(_frozen(item) for item in value)
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return value


def scan_lines(text: str) -> dict[Place, int]:
    """Find the line of every table header and key of a valid TOML text.

    Keys of inline tables and items of arrays are not found: they share the line of the key that holds them.
    """
    lines: dict[Place, int] = {}
    arrays: dict[Place, int] = {}
    table: Place = ()
    position, number = 0, 1
    while position < len(text):
        end = text.find("\n", position)
        end = len(text) if end < 0 else end
        line = text[position:end].strip()
        if line.startswith("["):
            table = _table_place(line, arrays)
            lines.setdefault(table, number)
        elif line and not line.startswith("#"):
            key, equals = _split_key(text, position)
            lines.setdefault((*table, *key), number)
            end = _value_end(text, equals + 1)
        number += text.count("\n", position, end + 1)
        position = end + 1
    return lines


def _table_place(line: str, arrays: dict[Place, int]) -> Place:
    is_array = line.startswith("[[")
    names, _ = _dotted(line, 2 if is_array else 1, "]")
    place: Place = ()
    for index, name in enumerate(names):
        place = (*place, name)
        if is_array and index == len(names) - 1:
            arrays[place] = arrays.get(place, -1) + 1
        if place in arrays:
            place = (*place, arrays[place])
    return place


def _split_key(text: str, start: int) -> tuple[list[str], int]:
    return _dotted(text, start, "=")


def _dotted(text: str, start: int, stop: str) -> tuple[list[str], int]:
    """Read a dotted, possibly quoted key up to `stop`; return its parts and where `stop` is."""
    parts, current, quote = [], "", ""
    position = start
    while position < len(text):
        character = text[position]
        if quote:
            if character == quote:
                quote = ""
            else:
                current += character
        elif character in "\"'":
            quote = character
        elif character == stop:
            break
        elif character == ".":
            parts.append(current)
            current = ""
        elif not character.isspace():
            current += character
        position += 1
    return [*parts, current], position


def _value_end(text: str, position: int) -> int:
    """Position of the line end that closes the value which starts here (strings and brackets respected)."""
    depth = 0
    while position < len(text):
        character = text[position]
        if character in "\"'":
            position = _string_end(text, position)
            continue
        if character == "#":
            position = text.find("\n", position)
            if position < 0:
                return len(text)
            continue
        if character in "[{":
            depth += 1
        elif character in "]}":
            depth -= 1
        elif character == "\n" and depth <= 0:
            return position
        position += 1
    return len(text)


def _string_end(text: str, position: int) -> int:
    quote = text[position]
    triple = text.startswith(quote * 3, position)
    closing = quote * 3 if triple else quote
    position += len(closing)
    while position < len(text) and not text.startswith(closing, position):
        position += 2 if quote == '"' and text[position] == "\\" else 1
    position += len(closing)
    while triple and position < len(text) and text[position] == quote:
        position += 1
    return position

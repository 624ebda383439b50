"""A TOML file with the line of every key: the standard parser gives the values, a scan gives the places."""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.errors import FileProblem
from rig.text_file import read_text

SIZE_LIMIT_BYTES = 262_144
MOST_PARTS = 12
"""Parts of a dotted key, and levels of nesting; files for the rig have three."""
MOST_ENTRIES = 30_000

_STRUCTURE = re.compile(r"""["'#\[\]{}=.,\n]""")
_AT = re.compile(r"\(at line (\d+), column \d+\)")
_QUOTES = 'texts and quantities stand in quotes, as in speed = "0.8 m/s"; dates are like 2030-01-31'
_HINTS = (
    ("Cannot overwrite a value", "this key is given twice; keep one"),
    ("Cannot declare", "this table is given twice; put all its keys under one heading"),
    ("Expected newline or end of document", f"more follows the value; {_QUOTES}"),
    ("Invalid value", f"this is no value; {_QUOTES}; true and false in lower case"),
    ("Unclosed array", "a list is not closed by ]"),
    ("Illegal character '\\n'", "a quote is missing at the end"),
    ("Found invalid character '\\n'", "a quote is missing at the end"),
    ("Found invalid character '\\r'", "lines end with CR alone; save the file with LF or CR LF"),
    ("Found invalid character", "there is a control character; delete it"),
    ("Illegal character", "there is a control character; delete it"),
    ("Unescaped", "a backslash in double quotes is written twice; or use single quotes"),
    ("Invalid statement", "neither key = value nor [table] nor # comment"),
    ("Unterminated string", "a quote is missing at the end"),
    ("Expected '=' after a key", "a key and its value are written key = value, a heading [name]"),
)

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
        FileProblem: missing, not a file, too large, not UTF-8, nested beyond sense, or not TOML; with the line.
    """
    text = read_text(path, SIZE_LIMIT_BYTES)
    problem = structure_problem(text)
    if problem is not None:
        raise FileProblem(str(path), [problem])
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FileProblem(str(path), [_not_toml(str(error), text)]) from error
    except ValueError as error:
        raise FileProblem(str(path), [f"not valid TOML: {error}"]) from error
    source = TomlSource(path, text, {key: _frozen(value) for key, value in data.items()}, scan_lines(text))
    if (place := _huge_number(source.data)) is not None:
        line = source.line(place)
        raise FileProblem(str(path), [f"{f'line {line}: ' if line else ''}a whole number of more than 64 bits"])
    return source


def structure_problem(text: str) -> str | None:
    """What makes a text too large to be parsed: the parser's time and memory grow with the square of a key's parts.

    One pass over the text, before it is parsed. Returns None when all is well.
    """
    entries = depth = dots = position = 0
    while (match := _STRUCTURE.search(text, position)) is not None:
        position, character = match.end(), match[0]
        if character in "\"'":
            position = _string_end(text, match.start())
            continue
        if character == "#":
            position = text.find("\n", position)
            if position < 0:
                return None
            continue
        dots = dots + 1 if character == "." else 0
        entries += character in "=,["
        depth += (character in "[{") - (character in "]}")
        if dots >= MOST_PARTS or depth > MOST_PARTS:
            what = "a key has" if dots >= MOST_PARTS else "lists and tables are nested to"
            line = text.count("\n", 0, match.start()) + 1
            return f"line {line}: {what} more than {MOST_PARTS} {'parts' if dots >= MOST_PARTS else 'levels'}"
        if entries > MOST_ENTRIES:
            return f"more than {MOST_ENTRIES} entries: not a file written for the rig"
    return None


def printable(text: str, longest: int = 40) -> str:
    """Text from a file as it may be shown on a terminal: in short, and nothing in it commands the terminal."""
    short = text if len(text) <= longest else text[: longest - 4] + " ..."
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in short)


def _not_toml(told: str, text: str) -> str:
    """The parser's complaint with its line first, the line itself, and what would be right."""
    hint = next((words for start, words in _HINTS if told.startswith(start)), "")
    place = _AT.search(told)
    if place is None:
        return f"not valid TOML: {told}{hint and f'; {hint}'}"
    number = int(place[1])
    line = text.split("\n")[number - 1].strip()
    why = hint or told[: place.start()].strip()
    return f"line {number}: not valid TOML: {printable(line, 60) or 'empty line'}: {why}"


def _frozen(value: object) -> object:
    if isinstance(value, list):
        return tuple(_frozen(item) for item in value)
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return value


def _huge_number(value: object, place: Place = ()) -> Place | None:
    """Where the first whole number stands that TOML does not promise to hold; such numbers cannot even be printed."""
    if isinstance(value, int):
        return place if abs(value) >= 1 << 63 else None
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, tuple) else ()
    for key, item in items:
        if (huge := _huge_number(item, (*place, key))) is not None:
            return huge
    return None


def scan_lines(text: str) -> dict[Place, int]:
    """Find the line of every table header and key of a valid TOML text.

    Keys of inline tables and items of arrays are not found: they share the line of the key that holds them.
    """
    lines: dict[Place, int] = {}
    implied: dict[Place, int] = {}
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
            _enclosing(table, number, implied)
        elif line and not line.startswith("#"):
            key, equals = _split_key(text, position)
            lines.setdefault((*table, *key), number)
            _enclosing((*table, *key), number, implied)
            end = _value_end(text, equals + 1)
        number += text.count("\n", position, end + 1)
        position = end + 1
    return {**implied, **lines}


def _enclosing(place: Place, number: int, implied: dict[Place, int]) -> None:
    """Tables without a heading of their own begin at the first key or heading inside them."""
    for length in range(1, len(place)):
        implied.setdefault(place[:length], number)


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

"""A TOML file with the line of every key: the standard parser gives the values, a scan gives the lines."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from protocols.descriptions import Place
from rig.errors import FileProblem
from rig.files.toml_lines import open_brackets, scan_lines, structure_problem
from rig.text_file import read_text

SIZE_LIMIT_BYTES = 262_144
_AT = re.compile(r"\(at line (\d+), column (\d+)\)")
_NEXT_ENTRY = re.compile(r"""\s*([\w.\-"' ]+=|\[\[?[\w.\-"' ]+\]\]?\s*(#.*)?$)""")
"""A line that begins a key or a table: inside of a list, the list was not closed."""
_CLOSING = {"[": "] of this list", "{": "} of this table"}
_QUOTES = 'strings and quantities must be in quotes, as in speed = "0.8 m/s"; dates must have the form 2030-01-31'
_HINTS = (
    ("Cannot overwrite a value", "this key is specified twice; keep one of them"),
    ("Cannot declare", "this table is specified twice; put all its keys under one heading"),
    ("Expected newline or end of document", f"unexpected text after the value; {_QUOTES}"),
    ("Invalid value", f"this is not a valid value; {_QUOTES}; true and false must be lower case"),
    ("Unclosed array", "a comma or the closing ] of a list is missing; strings and quantities must be in quotes"),
    ("Unclosed inline table", "a comma or the closing } of the table is missing, or the table "
     "continues on another line"),
    ("Illegal character '\\n'", "the closing quote is missing"),
    ("Found invalid character '\\n'", "the closing quote is missing"),
    ("Found invalid character '\\r'", "the lines end with CR alone. Fix: save the file with LF or CR LF"),
    ("Found invalid character", "control character. Fix: delete it"),
    ("Illegal character", "control character. Fix: delete it"),
    ("Unescaped", "unescaped backslash. Fix: double each backslash in a string in double quotes, or use single quotes"),
    ("Invalid statement", "expected key = value, [table] or # comment"),
    ("Unterminated string", "the closing quote is missing"),
    ("Expected '=' after a key", "expected key = value, or a heading [name]"),
)


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
    return parse_toml(path, read_text(path, SIZE_LIMIT_BYTES))


def parse_toml(path: Path, text: str) -> TomlSource:
    """The values and lines of a file's text.

    Raises:
        FileProblem: nested beyond sense, or not TOML; with the line.
    """
    problem = structure_problem(text)
    if problem is not None:
        raise FileProblem(str(path), [problem])
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise FileProblem(str(path), [_not_toml(str(error), text)]) from error
    except (ValueError, RecursionError) as error:
        raise FileProblem(str(path), [f"not valid TOML: {error}"]) from error
    source = TomlSource(path, text, frozen(data), scan_lines(text))
    if (place := _huge_number(source.data)) is not None:
        line = source.line(place)
        raise FileProblem(str(path), [f"{f'line {line}: ' if line else ''}the integer has more than 64 bits"])
    return source


def printable(text: str, longest: int = 40) -> str:
    """Text from a file as it may be shown on a terminal: in short, and nothing in it commands the terminal."""
    short = text if len(text) <= longest else text[: longest - 4] + " ..."
    return "".join(letter if letter.isprintable() else repr(letter)[1:-1] for letter in short)


def _not_toml(message: str, text: str) -> str:
    """The parser's complaint with its line first, the line itself, and what would be right."""
    hint = next((words for start, words in _HINTS if message.startswith(start)), "")
    place, rows = _AT.search(message), text.split("\n")
    number = len(rows) + 1 if place is None else int(place[1])
    at = len(text) if place is None else len("\n".join(rows[: number - 1])) + int(place[2])
    before = [(line, sign) for line, sign in open_brackets(text, at) if line < number]
    if before and (place is None or message.startswith("Unclosed") or _NEXT_ENTRY.match(rows[number - 1])):
        number, sign = before[-1]
        hint = f"the closing {_CLOSING[sign]} is missing"
    elif place is None:
        return f"not valid TOML: {message}{hint and f'; {hint}'}"
    line = rows[number - 1].strip()
    why = hint or message.partition(" (at ")[0].strip()
    return f"line {number}: not valid TOML: {printable(line, 60) or 'empty line'}: {why}"


def frozen(value: Any) -> Any:  # noqa: ANN401 - whatever TOML holds
    """A value with its lists as tuples."""
    if isinstance(value, (list, tuple)):
        return tuple(frozen(item) for item in value)
    if isinstance(value, Mapping):
        return {key: frozen(item) for key, item in value.items()}
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

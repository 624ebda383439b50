"""The line of every table and key of a TOML text, and limits of a text that may be parsed."""

from __future__ import annotations

import re

from protocols.descriptions import Place

MOST_PARTS = 12
"""Parts of a dotted key, and levels of nesting; files for the rig have three."""
MOST_ENTRIES = 30_000

_STRUCTURE = re.compile(r"""["'#\[\]{}=.,\n]""")


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
            parts = f"a key has more than {MOST_PARTS} parts"
            levels = f"lists and tables are nested more than {MOST_PARTS} levels deep"
            line = text.count("\n", 0, match.start()) + 1
            return f"line {line}: {parts if dots >= MOST_PARTS else levels}"
        if entries > MOST_ENTRIES:
            return f"the file has too many entries; allowed: at most {MOST_ENTRIES}"
    return None


def open_brackets(text: str, end: int) -> list[tuple[int, str]]:
    """Line (from 1) and sign of each bracket of a value that is still open at a position, the outermost first."""
    brackets: list[tuple[int, str]] = []
    position = 0
    while (match := _STRUCTURE.search(text, position, end)) is not None:
        position, sign = match.end(), match[0]
        if sign in "\"'":
            position = _string_end(text, match.start())
        elif sign == "#":
            position = text.find("\n", position)
            if position < 0:
                break
        elif sign in "[{" and (brackets or text[text.rfind("\n", 0, match.start()) + 1 : match.start()].strip()):
            brackets.append((text.count("\n", 0, match.start()) + 1, sign))  # not that of a heading
        elif sign in "]}" and brackets:
            brackets.pop()
    return brackets


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

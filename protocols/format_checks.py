"""Checks of a sensor format beyond the form of its entries.

Contradictory entries, formats that can never match, frames whose start cannot be detected.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from itertools import accumulate
from string import Formatter
from typing import Any

from protocols.binary_format import LETTERS, LONGEST_FRAME, BinaryFormat, Field
from protocols.checksums import CHECKSUMS
from protocols.descriptions import Place, Problem
from protocols.errors import LocalProtocolError
from protocols.line_example import HOLES, checksum_digits, fitting, parts, widths
from protocols.line_format import ENCODINGS, LineFormat
from protocols.patterns import Pattern, PatternError

_MARK = "{address}"
_ANY = r"[^\x00-\x1f\x7f]"
"""A printable character in any encoding."""
_FORM = re.compile(r"[<>=^]?[-+ ]?0?\d{0,2}(?:\.\d{1,2})?[a-zA-Z]?")
"""Of a number in a template: a wider one would take any amount of memory."""
LONGEST_TICK_US = 1e9
MOST_NESTED = 50
"""Groups within groups of a pattern: the standard library's parser calls itself for each."""
WIDEST_FIELD = 64
"""Bits of a field."""
TRIED = (0.0, 1.0, -1.0)
"""Numbers of which one at least must fit into a line."""


def pattern_of(values: Mapping[str, Any], problems: list[Problem]) -> str | None:
    """The pattern of a line format, as it is stated or made from its columns; None where there is none.

    Args:
        values: the format's entries.
        problems: what is wrong is added.
    """
    address = re.escape(str(values.get("address", "")))
    if "columns" in values:
        if "pattern" in values:
            problems.append((("columns",), "cannot be combined with a pattern. Fix: keep only one of the two"))
        made = _of_columns(values, problems)
        return None if made is None else _compiled(made, problems)
    if "separator" in values:
        problems.append((("separator",), "requires columns, such as columns = { value = 2, unit = 3 }"))
    if "pattern" not in values:
        problems.append(((), "key 'pattern' is missing (or columns; a binary format requires fields or packed)"))
        return None
    pattern = str(values["pattern"]).replace(_MARK, address)
    if (depth := max(accumulate((letter == "(") - (letter == ")") for letter in pattern), default=0)) > MOST_NESTED:
        problems.append((("pattern",), f"groups are nested {depth} levels deep; allowed: at most {MOST_NESTED}"))
        return None
    try:
        groups = Pattern(pattern).groups
        parts(pattern)  # an example line is made from the standard library's reading of it
    except (PatternError, re.error, LocalProtocolError) as error:
        problems.append((("pattern",), f"not a valid regular expression: {error}"))
        return None
    if "value" not in groups:
        problems.append((("pattern",), _missing("value", "pattern")))
        return None
    return pattern


def _compiled(made: str, problems: list[Problem]) -> str | None:
    """The pattern of columns, where they are not too many."""
    try:
        Pattern(made)
    except PatternError as error:
        problems.append((("columns",), f"too many columns: the resulting pattern has {error}"))
        return None
    return made


def _of_columns(values: Mapping[str, Any], problems: list[Problem]) -> str | None:
    columns, separator = values["columns"], values.get("separator")
    for name, place in columns.items():
        if name not in HOLES:
            problems.append((("columns", name), f"unknown column; known: {', '.join(HOLES)}"))
        elif isinstance(place, int) is (separator is None):
            expected = "the column number, because a separator is specified"
            expected = "[first, last] character" if separator is None else expected
            problems.append((("columns", name), f"must be {expected}"))
    if "value" not in columns:
        problems.append((("columns",), "requires a column for the value"))
    if separator is not None and not (len(separator) == 1 and separator.isascii()):
        problems.append((("separator",), "must be one ASCII character"))
    if problems:
        return None
    return _fixed(columns, values, problems) if separator is None else _separated(columns, separator, problems)


def _fixed(columns: Mapping[str, tuple[int, int]], values: Mapping[str, Any], problems: list[Problem]) -> str:
    pattern, at = "", 1
    for name, (first, last) in sorted(columns.items(), key=lambda item: item[1]):
        if first < at:
            problems.append((("columns", name), "overlaps the previous column"))
        pattern += f"{_ANY}{{{first - at}}}" if first > at else ""
        pattern += f"(?P<{name}>{_ANY}{{{last - first + 1}}})"
        at = last + 1
    rest = values.get("length", at - 1) - at + 1
    if rest < 0:
        problems.append((("length",), f"is shorter than the columns, which end at character {at - 1}"))
    return pattern + (f"{_ANY}{{{rest}}}" if rest > 0 else "")


def _separated(columns: Mapping[str, int], separator: str, problems: list[Problem]) -> str:
    cell, between = f"[^{re.escape(separator)}]*", re.escape(separator)
    by_number = {number: name for name, number in columns.items()}
    if len(by_number) < len(columns):
        problems.append((("columns",), "two entries refer to the same column"))
    cells = [f"(?P<{by_number[at]}>{cell})" if at in by_number else cell for at in range(1, max(by_number) + 1)]
    return between.join(cells) + f"(?:{between}{cell})*"


def line_problems(made: LineFormat, values: Mapping[str, Any]) -> list[Problem]:
    """Everything about a line format that contradicts itself, or can never match.

    Args:
        made: the format.
        values: its entries as they were given.
    """
    problems = [*_exchange_problems(values), *_group_problems(made, values)]
    if not made.terminator:
        problems.append((("terminator",), "terminator must not be empty"))
    if made.scale == 0.0:
        problems.append((("scale",), "must not be 0: every reading would have the same value"))
    shortest, longest = widths(made.pattern)
    if shortest > made.maximum_length:
        key = "length" if "length" in values else "maximum_length"
        problems.append(((key,), f"can never match: the pattern's shortest line has {shortest} characters"))
    if "length" in values and longest < values["length"]:
        problems.append((("length",), f"can never match: the pattern's longest line has {longest} characters"))
    if made.checksum_over is not None and made.checksum_over[1] > longest:
        problems.append((("checksum_over",), f"can never match: the longest line has {longest} characters"))
    if not problems:
        problems += _unmatched(made)
    return problems


def _missing(group: str, column: str) -> str:
    """What a line's description lacks; `column` is the entry that describes the line: "columns" or "pattern"."""
    return f"requires a column {group}" if column == "columns" else f"pattern requires a group (?P<{group}>...)"


def _group_problems(made: LineFormat, values: Mapping[str, Any]) -> Iterator[Problem]:
    groups = made.groups
    column = "columns" if "columns" in values else "pattern"
    for group, key, given in (
        ("checksum", "checksum", made.checksum != "none"), ("sign", "sign", made.sign == "separate"),
        ("status", "status", bool(made.status)),
    ):  # fmt: skip
        if given and group not in groups:
            yield (key,), _missing(group, column)
        elif group in groups and not given:
            what = {"checksum": "a checksum, such as checksum = \"xor-hex\"", "sign": 'sign = "separate"',
                    "status": 'status, such as status = { ST = "ok", OL = "overload" }'}[group]  # fmt: skip
            yield (column,), f"has a group {group}, which requires {what}"
    if made.units and "unit" not in groups:
        yield ("units",), _missing("unit", column)
    if made.checksum_over is not None and (made.checksum_from or made.checksum_to):
        yield ("checksum_over",), (
            "cannot be combined with checksum_from or checksum_to. Fix: use either checksum_over or the other entries"
        )
    if made.checksum == "none":
        for key in ("checksum_from", "checksum_to", "checksum_over"):
            if key in values:
                yield (key,), 'no checksum is specified. Fix: specify the checksum, such as checksum = "xor-hex"'
    if made.number.startswith("hexadecimal") and made.sign == "trailing":
        yield ("sign",), "a hexadecimal number cannot have a trailing sign"
    if made.number == "hexadecimal-signed" and made.sign == "separate":
        yield ("sign",), (
            'the digits of a hexadecimal-signed number already contain the sign. Fix: '
            'if the sign is sent as a separate character, set number = "hexadecimal"'
        )
    if made.sign == "separate" and not made.negative_tokens:
        yield ("negative_tokens",), "must not be empty"


def _template_problem(made: LineFormat) -> str:
    """Why no line can be written with a template; empty where it can."""
    try:
        for _, name, form, conversion in Formatter().parse(made.template):
            if name is not None and (name not in {"value", "unit", "checksum"} or conversion):
                return f"{{{name}}} is not a field; allowed: {{value}}, {{unit}} and {{checksum}}"
            if form and not _FORM.fullmatch(form):
                return (
                    f"{{{name}:{form}}}: expected a form such as {{value:+010.1f}} (width and decimals: at most 99)"
                )
        lines = [_templated(made, number) for number in TRIED]
    except (KeyError, IndexError, ValueError) as error:
        return f"{error}; allowed fields: {{value}}, {{unit}} and {{checksum}}"
    if not any(_encodes(line, made.encoding) and made.match(line) for line in lines):
        return f"produces {lines[0]!r:.200}, which does not match the pattern"
    return ""


def _encodes(text: str, encoding: str) -> bool:
    """Whether all characters exist in an encoding."""
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return False
    return True


def _templated(made: LineFormat, number: float) -> str:
    """A line by the template, its checksum zeros."""
    shown = number * 10**made.decimals
    return made.template.format(value=shown, unit=made.unit, checksum="0" * checksum_digits(made))


def _unmatched(made: LineFormat) -> Iterator[Problem]:
    """Reasons why no line of numbers can match."""
    if made.template and (problem := _template_problem(made)):
        yield ("template",), f"template {made.template!r:.200}: {problem}"
        return
    fixed = "".join(part for part in parts(made.pattern) if not part.startswith("\0"))
    for key, text in (("pattern", fixed), ("unit", made.unit if "unit" in made.groups else "")):
        if (other := next((letter for letter in text if not _encodes(letter, made.encoding)), "")):
            yield (key,), f"can never match: {other!r} is not a character of {made.encoding.upper()}. Fix: write " \
                f"encoding = one of {', '.join(ENCODINGS)}, or use a binary format"
            return
    if not any(fitting(made, [number]) for number in TRIED):
        written = "".join(part if not part.startswith("\0") else f"<{part[1:].partition(':')[0]}>" for part in
                          parts(made.pattern))  # fmt: skip
        with_unit = f" with the unit {made.unit!r}" if "unit" in made.groups else ""
        digits = f" and a checksum of {checksum_digits(made)} digits" if made.checksum != "none" else ""
        message = f"no {made.number} number{with_unit}{digits} fits into a line such as {written!r}"
        yield ("pattern",), f"can never match: {message}"
    elif made.terminator.decode("latin-1") in fixed:
        yield ("pattern",), "can never match: the pattern contains the terminator, which ends the line"


def _exchange_problems(values: Mapping[str, Any]) -> Iterator[Problem]:
    marked = [key for key in ("request", "start_command", "stop_command") if b"{address}" in values.get(key, b"")]
    if "request" in values and not values["request"]:
        yield ("request",), "must not be empty. Fix: remove this entry if the device transmits continuously"
    if marked and "address" not in values:
        yield (marked[0],), 'contains {address}, which requires address = "..."'
    if "address" in values and not marked and _MARK not in str(values.get("pattern", "")):
        yield ("address",), "is not used. Fix: write {address} in request"
    if "answer_timeout_ms" in values and "request" not in values:
        yield ("answer_timeout_ms",), "requires a request"


def frame_problems(made: BinaryFormat, values: Mapping[str, Any]) -> list[Problem]:
    """Everything about a binary format that contradicts itself, or by which no frame could be told.

    Args:
        made: the format.
        values: its entries as they were given.
    """
    problems = list(_exchange_problems(values))
    if "value" not in made.fields:
        problems.append((("fields",), "the field for the value is missing: write a table [fields.value] with at "
            "and type"))
    problems += _packed_problems(made, values) if made.packed else _framing_problems(made, values)
    for name, item in made.fields.items():
        problems += ((("fields", name, *place), text) for place, text in field_problems(name, item, made))
    return problems


def message_problems(made: BinaryFormat, values: Mapping[str, Any]) -> list[Problem]:
    """All contradictions in the layout of a CAN message.

    Args:
        made: the format.
        values: its entries as specified, including all fields.
    """
    if "value" not in made.fields:
        text = "the field for the value is missing: write a table [fields.value] with the keys `at` and `type`"
        return [(("fields",), text)]
    problems = list(_framing_problems(made, values))
    for name, item in made.fields.items():
        problems += ((("fields", name, *place), text) for place, text in field_problems(name, item, made))
    return problems


def _framing_problems(made: BinaryFormat, values: Mapping[str, Any]) -> Iterator[Problem]:
    if "length" not in values:
        yield (), "key 'length' is missing; it states the total number of bytes in a frame"
        return
    if made.can is None and not made.sync and made.checksum == "none" and made.stuffing != "slip":
        yield (), "the start of a frame cannot be detected: sync bytes or a checksum are required"
    yield from _stuffing_problems(made, values)
    taken = [-1] * made.length
    size = 0 if made.checksum == "none" else CHECKSUMS[made.checksum].size
    first, last = made.checksum_over
    if size and not 0 <= made.checksum_at <= made.length - size:
        yield ("checksum_at",), f"lies outside the frame of {made.length} bytes"
    elif size and not 0 <= first <= last < made.length:
        yield ("checksum_over",), f"lies outside the frame of {made.length} bytes"
    elif size and first <= made.checksum_at + size - 1 and made.checksum_at <= last:
        yield ("checksum_over",), "can never match: this range covers the checksum itself"
    kept = [("sync", 0, len(made.sync)), ("end", made.length - len(made.end), made.length)]
    kept += [("checksum", made.checksum_at, made.checksum_at + size)] if size else []
    if len(made.sync) + len(made.end) + size >= made.length:
        yield ("length",), "leaves no room for a value in addition to sync, checksum and end"
        return
    owners: dict[int, str] = {byte: name for name, begin, stop in kept for byte in range(begin, stop)}
    for name, item in made.fields.items():
        place: Place = ("fields", name)
        if not item.type or "at" not in values["fields"][name]:
            yield place, "requires the entries at (the first byte, counted from 0) and type"
            continue
        if item.at + item.size > len(taken):
            yield (*place, "at"), f"extends beyond the frame of {made.length} bytes"
            continue
        for byte in range(item.at, item.at + item.size):
            if byte in owners and (item.bits is None or owners[byte] in {"sync", "end", "checksum"}):
                yield (*place, "at"), f"byte {byte} already belongs to {owners[byte]}"
                break
            owners.setdefault(byte, name)


def _stuffing_problems(made: BinaryFormat, values: Mapping[str, Any]) -> Iterator[Problem]:
    if made.stuffing == "escape" and not (len(made.sync) == len(made.end) == 1):
        yield ("stuffing",), "escape requires exactly one sync byte and one end byte"
    elif made.stuffing == "dle" and not (
        len(made.sync) == len(made.end) == 2 and made.sync[0] == made.end[0] == 0x10 and made.sync[1] != made.end[1]
    ):
        yield ("stuffing",), (
            "dle requires sync = [0x10, ...] and end = [0x10, ...], each two bytes long, with different second bytes"
        )
    elif made.stuffing == "slip" and (made.end != b"\xc0" or made.sync not in {b"", b"\xc0"}):
        yield ("stuffing",), "slip requires end = [0xC0], and either sync = [0xC0] or no sync"
    if made.stuffing == "escape" and made.escape in {*made.sync, *made.end}:
        yield ("escape",), "must not occur in sync or end"
    for key in ("escape", "escape_xor"):
        if key in values and made.stuffing != "escape":
            yield (key,), 'requires stuffing = "escape"'
    if made.length > LONGEST_FRAME:
        yield ("length",), f"must be 1..{LONGEST_FRAME}"


def _packed_problems(made: BinaryFormat, values: Mapping[str, Any]) -> Iterator[Problem]:
    for key in ("sync", "end", "checksum", "checksum_at", "checksum_over", "stuffing", "length"):
        if key in values:
            yield (key,), "cannot be combined with packed, whose fixed bits mark the start of a frame"
    if len(made.packed) > LONGEST_FRAME:
        yield ("packed",), f"has {len(made.packed)} bytes; allowed: at most {LONGEST_FRAME}"
        return
    for number, byte in enumerate(made.packed):
        if len(byte) != 8 or set(byte) - set("01x") - set(LETTERS):
            yield ("packed", number), f"{byte!r}: expected eight characters from 0, 1, x, {', '.join(LETTERS)}"
            return
    marks, count = made.marks, len(made.packed)
    for shift in range(1, count):
        pairs = [(marks[at], marks[(at + shift) % count]) for at in range(count)]
        if not any((one[1] ^ other[1]) & one[0] & other[0] for one, other in pairs):
            message = f"the fixed bits also match a frame shifted by {shift} byte{'s' * (shift > 1)}"
            yield ("packed",), f"the start of a frame cannot be detected: {message}"
            return
    if count == 1:
        yield ("packed",), "requires at least two bytes"
    yield from _packed_fields(made, values)


def _packed_fields(made: BinaryFormat, values: Mapping[str, Any]) -> Iterator[Problem]:
    for letter, name in LETTERS.items():
        bits = sum(byte.count(letter) for byte in made.packed)
        there = bits > 0
        if bits > WIDEST_FIELD:
            yield ("packed",), f"has {bits} bits marked {letter}; a field can have at most {WIDEST_FIELD}"
        if there and name not in made.fields:
            yield ("fields",), f"packed has bits marked {letter}, which require a table [fields.{name}]"
        elif not there and name in made.fields:
            yield ("fields", name), f"packed has no bits marked {letter}"
    for name, table in values.get("fields", {}).items():
        for key in sorted({"at", "type", "bits"} & set(table)):
            yield ("fields", name, key), "cannot be combined with packed, which already defines the bits"


def field_problems(name: str, item: Field, made: BinaryFormat) -> Iterator[Problem]:
    """What is wrong with a field: numbers that it cannot hold, entries that do not belong to its type."""
    counts = name in {"sequence", "time"}
    if item.type.startswith("f"):
        if counts or name in {"status", "decimals"}:
            yield ("type",), "must be a whole number (u or i)"
        for key, given in (("bits", item.bits), ("overload_bits", item.overload_bits), ("fault_bits", item.fault_bits)):
            if given:
                yield (key,), f"can be used only for whole numbers, not for {item.type}"
    elif item.type and item.bits is not None and item.bits[1] >= 8 * item.size:
        yield ("bits",), f"extends beyond the {8 * item.size} bits of {item.type}"
    if name == "time" and item.scale > LONGEST_TICK_US:
        yield ("scale",), f"must be at most {LONGEST_TICK_US:g} microseconds per tick"
    if item.scale == 0.0 or (counts and item.scale < 0.0):
        yield ("scale",), "must not be 0" if name == "value" else "must be more than 0"
    if name == "status" and not item.judges:
        yield (), (
            "has no entries. Fix: specify overload_bits, fault_bits, overload_values or fault_values, or "
            "remove the table"
        )
    if not item.type.startswith("f") and (_in_packed(name, made) if made.packed else item.type):
        yield from _never(name, item, made)


def _in_packed(name: str, made: BinaryFormat) -> bool:
    """A packed stream has bits for the field."""
    return any(letter in byte for letter, field in LETTERS.items() if field == name for byte in made.packed)


def _never(name: str, item: Field, made: BinaryFormat) -> Iterator[Problem]:
    """Numbers that the field cannot hold."""
    if item.bits is not None and item.bits[1] >= 8 * item.size:
        return
    count = made.modulus(name)
    low, high = (-(count // 2), count // 2 - 1) if item.signed else (0, count - 1)
    for key, listed in (("overload_values", item.overload_values), ("fault_values", item.fault_values)):
        if beyond := [number for number in listed if not low <= number <= high]:
            yield (key,), f"{beyond[0]} is outside the range of the field, {low} to {high}"
    if item.valid is not None and (item.valid[1] < low or item.valid[0] > high):
        yield ("valid",), f"can never match: the range of the field is {low} to {high}"
    for key, mask in (("overload_bits", item.overload_bits), ("fault_bits", item.fault_bits)):
        if mask >= count:
            yield (key,), f"contains bits outside the field, {count - 1:#x}"

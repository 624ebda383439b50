"""From captured bytes to the description of a line format: line endings, and the part of a line that is the reading."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Any

from protocols.checksums import CHECKSUMS, HEX

TERMINATORS = (b"\r\n", b"\n\r", b"\n", b"\r", b"\x03", b";")
FEWEST = 4
"""Lines below which nothing is guessed."""
_NUMBER = re.compile(r"[+-]? *\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?")
_UNITS = ("kN", "N", "mm", "um", "mV/V", "kg", "g", "t", "lbf", "V", "m", "d")
_START = b"\x02"


def text_share(data: bytes) -> float:
    """Share of the bytes that lines of text have: printable characters, line ends, STX, ETX and tab."""
    return sum(32 <= byte < 127 or byte in b"\r\n\x02\x03\t" for byte in data) / max(1, len(data))


def described_lines(data: bytes) -> Iterator[dict[str, Any]]:
    """Descriptions that may fit captured bytes, the likeliest first; none where these are no lines.

    Args:
        data: as received; may begin and end inside of a line.
    """
    if text_share(data) < 0.9:
        return
    for terminator in TERMINATORS:
        lines = data.split(terminator)[1:-1]
        if len(lines) < FEWEST or max(map(len, lines)) > 200:
            continue
        start = _START if sum(line.startswith(_START) for line in lines) > 0.9 * len(lines) else b""
        texts = [line.removeprefix(start).decode("ascii", "replace") for line in lines]
        shape, usual = Counter(map(_shape, texts)).most_common(1)[0]
        if usual < 0.5 * len(texts):
            continue
        table = _described([text for text in texts if _shape(text) == shape], shape)
        if table is not None:
            table["terminator"] = terminator.decode()
            if start:
                table["start"] = start.decode()
            yield table
            return


def _shape(text: str) -> int:
    """How many numbers a line has; lines of one format have the same number of them."""
    return len(_NUMBER.findall(text))


def _described(texts: Sequence[str], numbers: int) -> dict[str, Any] | None:
    """The format of lines with so many numbers each."""
    table = _with_checksum(texts)
    if not numbers and table is None:
        return None
    if table is None:
        table = {}
    bodies = [text[: table["_body"]] for text in texts] if "_body" in table else texts
    literals, values = [_NUMBER.split(text) for text in bodies], [_NUMBER.findall(text) for text in bodies]
    count = len(values[0])
    if not count or any(len(row) != count for row in values):
        return None
    chosen = _reading(list(zip(*values, strict=True)))
    pattern = ""
    for at, between in enumerate(zip(*literals, strict=True)):
        pattern += _literal(between, table, behind_value=at == chosen + 1)
        if at < count:
            column = [row[at] for row in values]
            body = _digits(column)
            pattern += f"(?P<value>{body})" if at == chosen else body
    if any("," in row[chosen] for row in values):
        table["decimal_mark"] = ","
    if any("e" in row[chosen].lower() for row in values):
        table["number"] = "scientific"
    table["pattern"] = pattern + table.pop("_tail", "")
    table.pop("_body", None)
    longest = max(map(len, texts))
    if longest > 64:
        table["maximum_length"] = longest
    return table


def _reading(columns: Sequence[Sequence[str]]) -> int:
    """Which of the numbers is the reading: the one that changes, is no counter, and has decimals or a sign."""

    def likely(column: Sequence[str]) -> tuple[bool, bool, int]:
        numbers = [float(text.replace(" ", "").replace(",", ".")) for text in column]
        steps = Counter(round(after - before, 9) for before, after in pairwise(numbers))
        step, often = steps.most_common(1)[0] if steps else (0.0, 0)
        counts = step != 0.0 and often >= 0.9 * (len(numbers) - 1)
        written = any(mark in text for text in column for mark in "+-.,")
        return not counts and len(set(column)) > 1, written, len(set(column))

    return max(range(len(columns)), key=lambda at: likely(columns[at]))


def _literal(between: Sequence[str], table: dict[str, Any], *, behind_value: bool) -> str:
    """A pattern for what stands between two numbers."""
    texts = set(between)
    if len(texts) == 1:
        (text,) = texts
        unit = text.strip()
        if behind_value and unit in _UNITS:
            table["unit"] = unit
            return re.escape(text).replace(re.escape(unit), f"(?P<unit>{re.escape(unit)})").replace("\\ ", " ")
        return re.escape(text).replace("\\ ", " ").replace("\\,", ",")
    lengths = {len(text) for text in texts}
    most = max(lengths)
    # Never a digit or sign: those are the number's.
    kind = " " if not "".join(texts).strip() else "[^0-9+.,-]"
    return f"{kind}{{{most}}}" if len(lengths) == 1 else f"{kind}{{{min(lengths)},{most}}}"


def _digits(column: Sequence[str]) -> str:
    """A pattern for numbers written as these are."""
    widths = {len(text) for text in column}
    signed = {text[:1] for text in column} <= {"+", "-"}
    spaced = any(" " in text for text in column)
    exponent = any("e" in text.lower() for text in column)
    marks = {mark for text in column for mark in ".," if mark in text}
    decimals = {len(re.split("[.,]", text)[1]) if re.search("[.,]", text) else 0 for text in column}
    if exponent or len(marks) > 1 or len(decimals) > 1:
        return r"[+-]? *\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?"
    (places,) = decimals
    mark = re.escape(next(iter(marks), ""))
    tail = rf"{mark}\d{{{places}}}" if places else ""
    if len(widths) == 1 and not spaced:
        (width,) = widths
        whole = width - (places + 1 if places else 0)
        if signed:
            return rf"[+-]\d{{{whole - 1}}}{tail}"
        return rf"[-\d]\d{{{whole - 1}}}{tail}" if whole > 1 else rf"\d{tail}"
    sign = "[+-]" if signed else "[+-]?"
    return rf"{sign}{' *' if spaced else ''}\d+{tail}"


def _with_checksum(texts: Sequence[str]) -> dict[str, Any] | None:
    """Hexadecimal digits at the end that are a sum of what stands before them, as entries of a description."""
    if len({len(text) for text in texts}) != 1 or len(set(texts)) < 3:
        return None
    length = len(texts[0])
    for name, kind in CHECKSUMS.items():
        digits = 2 * kind.size
        if length <= digits + 2 or any(re.fullmatch("[0-9A-Fa-f]+", text[-digits:]) is None for text in texts):
            continue
        for begin in (0, 1):
            for end in (length - digits, length - digits - 1):
                if all(
                    kind.of(text[begin:end].encode("ascii", "replace")) == int(text[-digits:], 16) for text in texts
                ):
                    return {
                        "checksum": name + HEX, "checksum_over": [begin + 1, end], "_body": length - digits,
                        "_tail": f"(?P<checksum>[0-9A-Fa-f]{{{digits}}})",
                    }  # fmt: skip
    return None

"""From captured bytes to the description of a line format: line endings, and the part of a line that is the reading."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Collection, Iterator, Sequence
from itertools import pairwise
from typing import Any

from protocols.checksums import CHECKSUMS, HEX

TERMINATORS = (b"\r\n", b"\n\r", b"\n", b"\r", b"\x03", b";")
FEWEST = 4
"""Lines below which nothing is guessed."""
_NUMBER = re.compile(r"[+-]? *\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?")
_UNITS = (
    "kN", "N", "mN", "daN", "kgf", "mm", "um", "cm", "in", "mV/V", "kg", "g", "t", "lbf", "lb", "V", "mV", "m", "d",
)  # fmt: skip
_UNIT = re.compile(r"( *)([A-Za-z]+(?:/[A-Za-z]+)?)(?![A-Za-z/])(.*)", re.DOTALL)
"""Text that begins with a word that may be a unit."""
_TOKEN = r"(?P<value>[^0-9]+)"
_OVERLOADS = frozenset({
    "O", "OL", "O.L", "O.L.", "O/L", "O-L", "OVL", "OVR", "OVER", "OVERLOAD", "OF", "OVF", "HH", "LL", "UL", "UNDER",
})  # fmt: skip
_FAULTS = frozenset({"E", "ERR", "ERROR", "FAIL", "FAULT", "OPEN", "NC", "BREAK"})
_OVERLOAD_MARKS = frozenset("^_=*<>-")
"""Characters that displays show instead of a missing number."""
MOST_STATUSES, LONGEST_STATUS = 6, 8
"""Maximum number and length of the texts of a status."""
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
        usual_texts = [text for text in texts if _shape(text) == shape]
        others = [text for text in texts if _shape(text) != shape]
        table = _described(usual_texts, shape)
        if table is None:
            continue
        tables = [table]
        if "status" in table:
            # The varying words may not be a status; they then remain a wildcard.
            tables += filter(None, [_described(usual_texts, shape, statuses=False)])
        for table in tables:
            _add_tokens(table, others)
            table["terminator"] = terminator.decode()
            if start:
                table["start"] = start.decode()
            yield table
        return


def _shape(text: str) -> int:
    """How many numbers a line has; lines of one format have the same number of them."""
    return len(_NUMBER.findall(text))


def _described(texts: Sequence[str], numbers: int, *, statuses: bool = True) -> dict[str, Any] | None:
    """Format of lines with a given count of numbers; `statuses`: varying words may be the status of the line."""
    table = _with_checksum(texts)
    if not numbers and table is None:
        return None
    table = table or {}
    if not statuses:
        table["status"] = {}  # a line has one status, so no other is looked for
    bodies = [text[: table["_body"]] for text in texts] if "_body" in table else texts
    literals, values = [_NUMBER.split(text) for text in bodies], [_NUMBER.findall(text) for text in bodies]
    count = len(values[0])
    if not count or any(len(row) != count for row in values):
        return None
    chosen = _reading(list(zip(*values, strict=True)))
    columns = list(zip(*literals, strict=True))
    # Text after the reading is interpreted as its unit and status first.
    behind = _behind(columns[chosen + 1], table)
    pattern = ""
    for at, between in enumerate(columns):
        pattern += behind if at == chosen + 1 else _literal(between, table)
        if at < count:
            column = [row[at] for row in values]
            body = _digits(column)
            pattern += f"(?P<value>{body})" if at == chosen else body
    if any("," in row[chosen] for row in values):
        table["decimal_mark"] = ","
    if any("e" in row[chosen].lower() for row in values):
        table["number"] = "scientific"
    if not statuses:
        del table["status"]
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


def _behind(between: Sequence[str], table: dict[str, Any]) -> str:
    """Pattern for the text after the reading: its unit, if all lines have the same unit, and the rest."""
    parts = [_UNIT.fullmatch(text) for text in between]
    units = {part[2] for part in parts if part is not None}
    if None in parts or len(units) != 1 or not units <= set(_UNITS):
        return _literal(between, table)
    (unit,) = units
    blanks = {part[1] for part in parts if part is not None}
    before = blanks.pop() if len(blanks) == 1 else " *"
    table["unit"] = unit
    rest = _literal([part[3] for part in parts if part is not None], table)
    return f"{before}(?P<unit>{_escaped(unit)}){rest}"


def _escaped(text: str) -> str:
    return re.escape(text).replace("\\ ", " ").replace("\\,", ",")


def _literal(between: Sequence[str], table: dict[str, Any]) -> str:
    """Pattern for the text between two numbers; varying words become the status of the line.

    A line with a status that was not received before, such as an overload, is then damaged and not a reading.
    """
    texts = set(between)
    if len(texts) == 1:
        return _escaped(texts.pop())
    words = {text.strip() for text in texts}
    few = len(words) <= MOST_STATUSES and max(map(len, texts)) <= LONGEST_STATUS
    if few and len(words) > 1 and "status" not in table:
        table["status"] = {word: _status(word) for word in sorted(words)}
        return _statuses(texts)
    if len(words) == 1 and "" not in words:
        return f" *{_escaped(words.pop())} *"
    lengths = {len(text) for text in texts}
    most = max(lengths)
    # Never a digit or sign: those are the number's.
    kind = " " if not "".join(texts).strip() else "[^0-9+.,-]"
    return f"{kind}{{{most}}}" if len(lengths) == 1 else f"{kind}{{{min(lengths)},{most}}}"


def _statuses(texts: Collection[str]) -> str:
    """Group for a status; blanks common to all its texts are outside the group."""
    before = min(len(text) - len(text.lstrip(" ")) for text in texts)
    inner = [text[before:] for text in texts]
    after = min(len(text) - len(text.rstrip(" ")) for text in inner)
    inner = sorted((text[: len(text) - after] for text in inner), key=lambda text: (-len(text), text))
    return f"{' ' * before}(?P<status>{'|'.join(map(_escaped, inner))}){' ' * after}"


def _status(word: str) -> str:
    """Most likely meaning of a status; an unknown word means "ok", as on most lines."""
    return _meaning(word) or "ok"


def _meaning(word: str) -> str:
    bare = word.strip(" +-,;").upper()
    if bare in _FAULTS:
        return "fault"
    marks = word.replace(" ", "")
    return "overload" if bare in _OVERLOADS or (len(marks) > 1 and set(marks) <= _OVERLOAD_MARKS) else ""


def _add_tokens(table: dict[str, Any], others: Sequence[str]) -> None:
    """Texts that replace the number on otherwise matching lines: overload or fault."""
    pattern: str = table["pattern"]
    begin = pattern.index("(?P<value>")
    end = _end_of_group(pattern, begin)
    regex = re.compile(pattern[:begin] + _TOKEN + pattern[end:])
    raw = {match["value"] for text in others if (match := regex.fullmatch(text)) is not None and match["value"].strip()}
    if not raw or len(raw) > MOST_STATUSES:
        return
    for text in sorted(raw):
        kind = "fault_tokens" if _meaning(text) == "fault" else "overload_tokens"
        table[kind] = sorted({*table.get(kind, ()), text.strip()})
    tokens = "|".join(map(_escaped, sorted(raw, key=len, reverse=True)))
    table["pattern"] = f"{pattern[: end - 1]}|{tokens}{pattern[end - 1 :]}"


def _end_of_group(pattern: str, begin: int) -> int:
    """Position after the parenthesis that closes the one at `begin`.

    Raises:
        ValueError: there is no closing parenthesis.
    """
    depth = 0
    for at in range(begin, len(pattern)):
        escaped = pattern[at - 1 : at] == "\\"
        depth += (pattern[at] == "(") - (pattern[at] == ")") if not escaped else 0
        if depth == 0:
            return at + 1
    raise ValueError(pattern)


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

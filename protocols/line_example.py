"""A line that a format accepts, derived from its pattern.

It detects formats that can never match, and lets lines be written if a format has no template. The pattern is walked
part by part for its shortest text; several ways of writing the number are tried until one fits for every requested
number.
"""

from __future__ import annotations

import importlib
import re
import string
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

from protocols.checksums import CHECKSUMS, HEX
from protocols.errors import LocalProtocolError
from protocols.line_format import LineFormat

_parser: Any = importlib.import_module("re._parser")  # the standard library's own reading of a pattern, not annotated
_PREFERRED = "0 " + string.digits + string.ascii_uppercase + string.ascii_lowercase + "".join(map(chr, range(33, 127)))
_CATEGORIES: Mapping[str, Callable[[str], bool]] = {
    "CATEGORY_DIGIT": lambda letter: letter.isdigit(), "CATEGORY_NOT_DIGIT": lambda letter: not letter.isdigit(),
    "CATEGORY_SPACE": lambda letter: letter.isspace(), "CATEGORY_NOT_SPACE": lambda letter: not letter.isspace(),
    "CATEGORY_WORD": lambda letter: letter.isalnum() or letter == "_",
    "CATEGORY_NOT_WORD": lambda letter: not (letter.isalnum() or letter == "_"),
}  # fmt: skip
HOLES = ("value", "sign", "unit", "status", "decimals", "checksum")
WIDEST = 16
MOST_DECIMALS = 7


def _tree(pattern: str) -> Any:  # noqa: ANN401 - the parser's own tree
    with warnings.catch_warnings():
        # `[[:digit:]]` is a class to RE2 and a doubtful set to this parser, which warns of it on standard error.
        warnings.simplefilter("ignore", FutureWarning)
        return _parser.parse(pattern, re.ASCII)


def widths(pattern: str) -> tuple[int, int]:
    """Shortest and longest text that a pattern matches."""
    low, high = _tree(pattern).getwidth()
    return int(low), int(high)


def parts(pattern: str) -> list[str]:
    """The shortest text of a pattern, cut at its groups of `HOLES`, which are NUL, name, `:` and least width.

    Raises:
        LocalProtocolError: the pattern needs a NUL character.
    """
    tree = _tree(pattern)
    names = {number: name for name, number in tree.state.groupdict.items() if name in HOLES}
    pieces: list[str] = []
    _walk(tree, names, pieces)
    joined: list[str] = []
    for text in pieces:
        if joined and not text.startswith("\0") and not joined[-1].startswith("\0"):
            joined[-1] += text
        else:
            joined.append(text)
    return joined


def _walk(tree: Any, names: dict[int, str], pieces: list[str]) -> None:  # noqa: ANN401 - the parser's own tree
    for operation, argument in tree:
        kind = str(operation)
        if kind == "LITERAL":
            if argument == 0:
                raise LocalProtocolError("a line of text cannot contain a NUL character; use a binary format")
            pieces.append(chr(argument))
        elif kind in {"NOT_LITERAL", "ANY", "IN"}:
            pieces.append(_letter(kind, argument))
        elif kind in {"MAX_REPEAT", "MIN_REPEAT", "POSSESSIVE_REPEAT"}:
            least, _, inner = argument
            for _ in range(least or int(_holds(inner, names))):
                _walk(inner, names, pieces)
        elif kind == "SUBPATTERN":
            number, _, _, inner = argument
            if number in names:
                pieces.append(f"\0{names[number]}:{inner.getwidth()[0]}")
            else:
                _walk(inner, names, pieces)
        elif kind == "BRANCH":
            branches = argument[1]
            _walk(next((one for one in branches if _holds(one, names)), branches[0]), names, pieces)
        elif kind == "ATOMIC_GROUP":
            _walk(argument, names, pieces)


def _holds(tree: Any, names: dict[int, str]) -> bool:  # noqa: ANN401 - as above
    """Whether a part of a pattern holds one of the groups."""
    for operation, argument in tree:
        kind = str(operation)
        if kind == "SUBPATTERN" and (argument[0] in names or _holds(argument[3], names)):
            return True
        if kind == "BRANCH" and any(_holds(one, names) for one in argument[1]):
            return True
        if kind.endswith("REPEAT") and _holds(argument[2], names):
            return True
    return False


def _letter(kind: str, argument: Any) -> str:  # noqa: ANN401 - as above
    """A character that a part of one character accepts; a blank where none can be typed."""
    if kind == "ANY":
        return "0"
    if kind == "NOT_LITERAL":
        return next(letter for letter in _PREFERRED if ord(letter) != argument)
    return next((letter for letter in _PREFERRED if _accepts(argument, letter)), " ")


def _accepts(items: Sequence[tuple[Any, Any]], letter: str) -> bool:
    """Whether a set of characters holds a letter."""
    negated, inside = False, False
    for operation, argument in items:
        kind = str(operation)
        negated |= kind == "NEGATE"
        inside |= kind == "LITERAL" and argument == ord(letter)
        inside |= kind == "RANGE" and argument[0] <= ord(letter) <= argument[1]
        inside |= kind == "CATEGORY" and bool(_CATEGORIES[str(argument)](letter))
    return inside is not negated


@dataclass(frozen=True)
class Style:
    """One way to write numbers.

    Attributes:
        write: the text of a number; longer than the others where the number does not fit.
        step: the smallest difference it shows.
        width: characters; 0 where that depends on the number.
        plus: a positive number's sign.
    """

    write: Callable[[float], str]
    step: float
    width: int
    plus: str = ""


def styles(line_format: LineFormat) -> Iterator[Style]:
    """Ways to write numbers in a format, those with more decimals and a fixed width first."""
    if line_format.number.startswith("hexadecimal"):
        for width in range(1, WIDEST + 1):
            yield _hexadecimal(line_format, width)
        return
    shift = 10**line_format.decimals
    marked: list[tuple[int, float]] = [(places, 1.0) for places in range(MOST_DECIMALS, 0, -1)]
    plain = (0, float(shift))
    for places, factor in [plain, *marked] if shift > 1 else [*marked, plain]:
        for width in [*range(places + 2 if places else 1, WIDEST + 1), 0]:
            for fill in ("", "0", " ") if width else ("",):
                for plus in ("+", "", " "):
                    yield _decimal(line_format, plus, f"{'0' if fill == '0' else ''}{width or ''}.{places}f", factor)
                    if width and fill == " " and plus == "+" and line_format.sign == "leading":
                        yield _decimal(line_format, "=+", f"{width}.{places}f", factor)
    if line_format.number == "scientific":
        for places, plus in product(range(MOST_DECIMALS, 0, -1), ("+", "")):
            yield _decimal(line_format, plus, f".{places}E", 1.0)


def _decimal(line_format: LineFormat, plus: str, spec: str, factor: float) -> Style:
    """One way of writing; `plus` is what a positive number's sign is, `spec` the rest of a format specification."""
    width, _, places = spec[:-1].partition(".")
    mark, sign = line_format.decimal_mark, line_format.sign

    def write(number: float) -> str:
        if sign == "leading":
            return format(number * factor, plus + spec).replace(".", mark)
        tail = ("-" if number < 0 else plus) if sign == "trailing" else ""
        return (format(abs(number) * factor, spec) + tail).replace(".", mark)

    return Style(write, 10.0 ** -int(places) / factor, int(width or 0), plus)


def _hexadecimal(line_format: LineFormat, width: int) -> Style:
    signed = line_format.number == "hexadecimal-signed"
    largest = (1 << 4 * width - 1) - 1 if signed else (1 << 4 * width) - 1
    shift = 10**line_format.decimals

    def write(number: float) -> str:
        raw = round(number * shift)
        if not (-largest - 1 if signed else 0) <= raw <= largest:
            return "?" * (width + 1)
        return f"{raw & (1 << 4 * width) - 1:0{width}X}"

    return Style(write, 1.0 / shift, width)


def fitting(line_format: LineFormat, numbers: Sequence[float]) -> Style | None:
    """The first way to write all of these numbers (before scale and offset) in a format; None where none fits."""
    text = parts(line_format.pattern)
    for style in styles(line_format):
        if all(_fits(line_format, text, style, number) for number in numbers):
            return style
    return None


def _fits(line_format: LineFormat, text: Sequence[str], style: Style, number: float) -> bool:
    written = style.write(number)
    if style.width and len(written) > style.width + 1:
        return False
    line = filled(line_format, text, written, line_format.negative_tokens[0] if number < 0 else style.plus)
    match = line_format.match(line)
    same = match is not None and (match["value"] or "").strip() == written.strip()
    return same and len(line) <= line_format.maximum_length


def filled(line_format: LineFormat, text: Sequence[str], number: str, sign: str) -> str:
    """A line from the parts of its pattern, its checksum still zeros; `sign` is for a group of that name."""
    normal = next((token for token, meaning in line_format.status.items() if meaning == "ok"), "")
    digits = "0" * checksum_digits(line_format)
    content = {
        "value": number, "unit": line_format.unit, "status": normal, "checksum": digits, "sign": sign,
        "decimals": str(line_format.decimals),
    }  # fmt: skip
    line = ""
    for part in text:
        name, _, width = part[1:].partition(":")
        line += content[name].ljust(int(width)) if part.startswith("\0") else part
    return line


def checksum_digits(line_format: LineFormat) -> int:
    """Hexadecimal digits of the checksum; 0 without one."""
    return 0 if line_format.checksum == "none" else 2 * CHECKSUMS[line_format.checksum.removesuffix(HEX)].size

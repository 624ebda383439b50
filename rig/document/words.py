"""Text of a document: plain strings and spans with a meaning (strong, code, label, shade); writers escape it."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from enum import StrEnum

from rig.document.numbers import MINUS, PLUS_MINUS


class Severity(StrEnum):
    """How good or bad a statement is; each writer has a colour for it, and the words state it as well."""

    GOOD = "good"
    FAIR = "fair"
    POOR = "poor"
    PLAIN = "plain"


GOOD, FAIR, POOR, PLAIN = Severity.GOOD, Severity.FAIR, Severity.POOR, Severity.PLAIN
OF_VERDICT = {"valid": GOOD, "suspect": FAIR, "invalid": POOR}


@dataclass(frozen=True)
class Span:
    """A part of a text; on its own as plain text."""

    text: str

    def __str__(self) -> str:
        return self.text


class Strong(Span):
    """Emphasised text."""


class Code(Span):
    """Text as typed into a file or a terminal."""


@dataclass(frozen=True)
class Label(Span):
    """A short verdict on a coloured background."""

    severity: Severity = PLAIN


@dataclass(frozen=True)
class Shade(Span):
    """A number on a background of its strength: `share` from -1 (blue) through 0 (white) to 1 (orange)."""

    share: float = 0.0


@dataclass(frozen=True)
class Key(Span):
    """A sample of a figure's line, and what it shows."""

    colour: str = "#000000"
    dashed: bool = False


Words = str | Span | tuple[str | Span, ...]
"""A text; a line feed in it begins a new line."""


def parts(words: Words) -> tuple[str | Span, ...]:
    """A text as its parts, in order."""
    return words if isinstance(words, tuple) else (words,)


SIGN = re.compile(r"`[^`]*`|(?<![^\s(\[])(?P<sign>\+?-)(?= ?\.?\d)")
"""The sign of a number as typed in ASCII; what is between backquotes is typed into a terminal and stays."""


def printed(words: Words) -> tuple[str | Span, ...]:
    """The parts of a text for page and paper: typographic signs before numbers, as `rig.document.numbers` writes them.

    Text that is copied into a terminal (`Code`, backquotes) stays as it is.
    """
    return tuple(
        _typographic(part) if isinstance(part, str) else replace(part, text=_typographic(part.text))
        if isinstance(part, Strong) else part for part in parts(words)
    )  # fmt: skip


def _typographic(text: str) -> str:
    return SIGN.sub(lambda sign: {"-": MINUS, "+-": PLUS_MINUS, None: sign[0]}[sign["sign"]], text)


def plain(words: Words) -> str:
    """A text without its looks."""
    return "".join(str(part) for part in parts(words))


def typed(words: Words) -> str:
    """A text for a terminal: as `plain`, with the minus sign of a keyboard, so that numbers can be copied."""
    return plain(words).replace(MINUS, "-")


def joined(words: list[Words], separator: str) -> Words:
    """Several texts as one, with a separator between them."""
    together: list[str | Span] = []
    for one in words:
        together += [*([separator] if together else []), *parts(one)]
    return tuple(together)


def capitalised(text: str) -> str:
    """A text with a capital first letter; the others stay as they are."""
    return text[:1].upper() + text[1:]


def all_of(count: int, noun: str) -> str:
    """"all 6 points", or "1 point"."""
    return f"1 {noun}" if count == 1 else f"all {count} {noun}s"


def verdict(name: str) -> Label:
    """A point's verdict as a label."""
    return Label(name, OF_VERDICT.get(name, PLAIN))

"""Text of a document: plain strings and spans with a meaning (strong, code, label, shade); writers escape it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


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


def plain(words: Words) -> str:
    """A text without its looks."""
    return "".join(str(part) for part in parts(words))


def joined(words: list[Words], separator: str) -> Words:
    """Several texts as one, with a separator between them."""
    together: list[str | Span] = []
    for one in words:
        together += [*([separator] if together else []), *parts(one)]
    return tuple(together)


def capitalised(text: str) -> str:
    """A text with a capital first letter; the others stay as they are."""
    return text[:1].upper() + text[1:]


def verdict(name: str) -> Label:
    """A point's verdict as a label."""
    return Label(name, OF_VERDICT.get(name, PLAIN))

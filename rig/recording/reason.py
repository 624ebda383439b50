"""Why a point is not valid, as a value: a slug, a kind, who is to blame, the numbers it was judged by, and its text.

Decisions are taken by the value. A file holds the line `slug: text`, and beside the lines their kinds; `Reason.stored`
turns both back into values.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum

from rig.errors import told

BLAMED: dict[str, str] = {
    "free-play": "bench",
    "force-scatter": "specimen",
    "force-change": "specimen",
    "temperature-drift": "test",
    "temperature-window": "test",
    "too-few-cycles": "test",
    "bandwidth": "test",
    "amplitude": "bench",
    "amplitude-scatter": "bench",
    "frequency": "bench",
    "INTERRUPTED": "test",
    "interrupted": "test",
    "operator": "test",
    "sigint": "test",
    "sigterm": "test",
    "wrong-damper": "specimen",
    "load-train": "bench",
    "host-late": "test",
    "ecu-overtemp": "test",
}
"""Slug of a reason -> who is at fault; every other slug is the bench's."""


class Kind(IntEnum):
    """How bad a reason is; the order is the verdict's."""

    SUSPECT = 1
    INVALID = 2

    @property
    def word(self) -> str:
        """The verdict that follows from it."""
        return self.name.lower()


WORDS = {kind.word: kind for kind in Kind}


@dataclass(frozen=True)
class Reason:
    """One reason.

    Attributes:
        slug: its name.
        kind: the verdict it leads to.
        text: what was measured and what is allowed, in words.
        numbers: what it was judged by, by name with unit.
    """

    slug: str
    kind: Kind
    text: str
    numbers: Mapping[str, float] = field(default_factory=dict, compare=False)

    def __str__(self) -> str:
        """The line a file, the journal and the operator get."""
        return f"{self.slug}: {self.text}"

    @property
    def blamed(self) -> str:
        """Who has to do something about it: `specimen`, `bench` or `test`."""
        return BLAMED.get(self.slug, "bench")

    @classmethod
    def stored(cls, line: str, kind: Kind) -> Reason:
        """The reason of a line in a file."""
        slug, _, text = line.partition(": ")
        return cls(slug, kind, text)


def suspect(slug: str, text: str, **numbers: float) -> Reason:
    """A reason that leaves a point suspect."""
    return Reason(slug, Kind.SUSPECT, told(text), numbers)


def invalid(slug: str, text: str, **numbers: float) -> Reason:
    """A reason that makes a point invalid."""
    return Reason(slug, Kind.INVALID, told(text), numbers)


def stored_reasons(verdict: str, lines: Sequence[str], kinds: Sequence[str] = ()) -> tuple[Reason, ...]:
    """The reasons a file tells of.

    Args:
        verdict: the file's verdict.
        lines: its `reasons`, worst first.
        kinds: its `reason_kinds`; a file without them keeps the verdict it has: each reason counts as its verdict does.
    """
    if verdict in WORDS and not lines:
        return (Reason("unknown", WORDS[verdict], "the file gives no reason"),)
    if len(kinds) != len(lines) or not set(kinds) <= WORDS.keys():
        kinds = [verdict if verdict in WORDS else Kind.SUSPECT.word] * len(lines)
    return tuple(Reason.stored(line, WORDS[kind]) for line, kind in zip(lines, kinds, strict=True))


def blamed(line: str) -> str:
    """Whether a reason's line lies in the `specimen`, the `bench` or the `test`."""
    return Reason.stored(line, Kind.SUSPECT).blamed

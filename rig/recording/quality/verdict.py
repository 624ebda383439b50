"""Valid, suspect or invalid, and why: a reason has a slug, a kind, somebody to blame, the numbers it was judged by.

Decisions are taken by these values. A file holds the line `slug: text` of each reason, and beside the lines their
kinds; `Verdict.stored` turns both back into values.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

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


@dataclass(frozen=True)
class Verdict:
    """What a point's reasons, worst first, make of it."""

    entries: tuple[Reason, ...] = ()

    @classmethod
    def of(cls, reasons: Iterable[Reason]) -> Verdict:
        """The verdict by these reasons, which keep their order among equals."""
        return cls(tuple(sorted(reasons, key=lambda reason: -reason.kind)))

    @classmethod
    def stored(cls, quality: Mapping[str, Any]) -> Verdict:
        """The verdict that the attributes of a file's `/entry/quality` tell of."""
        verdict, lines = str(quality.get("verdict", "valid")), tuple(quality.get("reasons", ()))
        return cls.of(stored_reasons(verdict, lines, tuple(quality.get("reason_kinds", ()))))

    @property
    def attributes(self) -> dict[str, str | tuple[str, ...]]:
        """What `/entry/quality` holds of it; lists without an entry are to be left out."""
        return {
            "verdict": self.verdict, "reasons": self.reasons, "reason_kinds": self.kinds, "blamed": self.blamed,
        }

    @property
    def verdict(self) -> str:
        """`valid`, `suspect` or `invalid`: one bad finding is enough."""
        return self.entries[0].kind.word if self.entries else "valid"

    @property
    def reasons(self) -> tuple[str, ...]:
        """One line each."""
        return tuple(str(reason) for reason in self.entries)

    @property
    def kinds(self) -> tuple[str, ...]:
        """What each reason alone would make of the point: `suspect` or `invalid`."""
        return tuple(reason.kind.word for reason in self.entries)

    @property
    def blamed(self) -> tuple[str, ...]:
        """Who is at fault, for each reason: `specimen`, `bench` or `test`."""
        return tuple(reason.blamed for reason in self.entries)

    def replaced(self, slugs: Collection[str], by: Iterable[Reason]) -> Verdict:
        """The same verdict with all reasons of these slugs judged anew; nothing else is touched."""
        return Verdict.of((*(reason for reason in self.entries if reason.slug not in slugs), *by))

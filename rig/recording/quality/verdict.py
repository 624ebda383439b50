"""Values in a file's attributes: a section is a dataclass whose fields name its attributes.

`Section.read` and `Section.attributes` iterate over the fields, so a new number of a point is one field. A field is
None if nothing was measured; then the file has no such attribute.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import Enum, IntEnum
from typing import Any, Self

from rig.errors import clean_text
from rig.recording.layout import Attribute
from rig.signals.estimate import Estimate

Attributes = Mapping[str, Any]


class Stored(Enum):
    """How a value stands in an attribute: a number, a whole number, yes or no, text, or one number a cycle as text."""

    NUMBER = float
    COUNT = int
    FLAG = bool
    TEXT = str
    PER_CYCLE = tuple

    def read(self, value: object) -> object:
        """The value of an attribute; None for one of another type."""
        if self is Stored.TEXT:
            return value if isinstance(value, str) else None
        if self is Stored.PER_CYCLE:
            return tuple(map(_cycle_value, value.split())) if isinstance(value, str) else None
        return self.value(value) if isinstance(value, (int, float)) and math.isfinite(value) else None

    def written(self, value: Any) -> Attribute:  # noqa: ANN401 - a value of this kind
        """The attribute of a value."""
        if self is not Stored.PER_CYCLE or value is None:
            return value  # type: ignore[no-any-return] # of the kind's own type
        return " ".join(f"{number:.6g}" if math.isfinite(number) else "-" for number in value)


def _cycle_value(word: str) -> float:
    try:
        return float(word)
    except ValueError:
        return math.nan


def stored(attribute: str, kind: Stored = Stored.NUMBER, default: object = None) -> Any:  # noqa: ANN401 - a field
    """A field that stands in the file as `attribute`; `{sensor}` and `{unit}` in it are those of the section."""
    return field(default=default, metadata={"attribute": attribute, "kind": kind})


def section(kind: type[Section], *, optional: bool = False, **names: str) -> dict[str, Any]:
    """Metadata of a field that is a section; an optional one is None where the file has none of its attributes."""
    return {"section": kind, "names": names, "optional": optional}


@dataclass(frozen=True)
class Section:
    """Fields that are read from attributes and written to them by their metadata."""

    @classmethod
    def read(cls, attributes: Attributes, **names: str) -> Self:
        """The section as the attributes tell it; what they lack is as in a new section."""
        values: dict[str, object] = {}
        for entry in fields(cls):
            value = None
            if "section" in entry.metadata:
                inner, inner_names = entry.metadata["section"], entry.metadata["names"]
                if not entry.metadata["optional"] or inner.named(inner_names) & attributes.keys():
                    value = inner.read(attributes, **inner_names)
            elif "attribute" in entry.metadata:
                value = entry.metadata["kind"].read(attributes.get(entry.metadata["attribute"].format(**names)))
            if value is not None:
                values[entry.name] = value
        return cls(**values)

    @classmethod
    def named(cls, names: Mapping[str, str]) -> set[str]:
        """Names of the section's own attributes."""
        return {entry.metadata["attribute"].format(**names) for entry in fields(cls) if "attribute" in entry.metadata}

    def items(self, **names: str) -> Iterator[tuple[str, Attribute]]:
        """Name and value of each attribute in the order of the fields, None where there is none."""
        for entry in fields(self):
            value = getattr(self, entry.name)
            if "section" in entry.metadata and value is not None:
                yield from value.items(**entry.metadata["names"])
            elif "attribute" in entry.metadata:
                yield entry.metadata["attribute"].format(**names), entry.metadata["kind"].written(value)

    @property
    def attributes(self) -> dict[str, Attribute]:
        """What the file holds of it, by name."""
        return {name: value for name, value in self.items() if value is not None}

    @property
    def numbers(self) -> dict[str, float]:
        """The numbers among the attributes, by name."""
        return {
            name: float(value) for name, value in self.attributes.items() if isinstance(value, (int, float))
        }


def estimate(value: float | None, std: float | None) -> Estimate | None:
    """A value with its standard deviation; None where either was not recorded."""
    return None if value is None or std is None else Estimate(value, std)


BLAMED: dict[str, str] = {
    "free-play": "bench",
    "force-scatter": "specimen",
    "force-change": "specimen",
    "temperature-drift": "test",
    "temperature-window": "test",
    "too-few-cycles": "test",
    "unsteady-motion": "test",
    "signal-incomplete": "test",
    "response-steps": "test",
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
    return Reason(slug, Kind.SUSPECT, clean_text(text), numbers)


def invalid(slug: str, text: str, **numbers: float) -> Reason:
    """A reason that makes a point invalid."""
    return Reason(slug, Kind.INVALID, clean_text(text), numbers)


def stored_reasons(verdict: str, lines: Sequence[str], kinds: Sequence[str] = ()) -> tuple[Reason, ...]:
    """The reasons a file tells of.

    Args:
        verdict: the file's verdict.
        lines: its `reasons`, worst first.
        kinds: its `reason_kinds`; a file without them keeps the verdict it has: each reason counts as its verdict does.
    """
    if verdict in WORDS and not lines:
        return (Reason("unknown", WORDS[verdict], "the file does not state a reason"),)
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

"""Values that stand in a file's attributes: a section is a dataclass whose fields name their attributes.

`Section.read` and `Section.attributes` go through the fields, so a new number of a point is one field. A field is None
where nothing was measured; then the file has no such attribute.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from enum import Enum
from typing import Any, Self

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

"""A table of a description on the way to what a driver is made of: entries by key, problems with their places.

The entries are of their types and ranges (`rig.files` has checked them); what is noted here is what they contradict.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from protocols.descriptions import Place, Problem
from protocols.near_miss import meant
from protocols.wire_units import seconds


class Kept:
    """The problems of a description, each once."""

    def __init__(self) -> None:
        self.problems: list[Problem] = []

    def add(self, place: Place, message: str) -> None:
        """Keep a problem of an entry."""
        if (place, message) not in self.problems:
            self.problems.append((place, message))


class Table:
    """A table with its place."""

    def __init__(self, source: Kept, place: Place, given: Mapping[str, Any]) -> None:
        self.source = source
        self.place = place
        self.given = given

    def __contains__(self, key: str) -> bool:
        return key in self.given

    def __iter__(self) -> Iterator[str]:
        return iter(self.given)

    def add(self, key: str | None, message: str) -> None:
        """Keep a problem of an entry, or of the table."""
        self.source.add(self.place if key is None else (*self.place, key), message)

    def get(self, key: str, default: Any = None) -> Any:  # noqa: ANN401 - whatever the entry holds
        """An entry."""
        return self.given.get(key, default)

    def table(self, key: str) -> Table:
        """A table below; an empty one where there is none."""
        return Table(self.source, (*self.place, key), self.given.get(key, {}))

    def time_s(self, key: str, default_s: float = 0.0) -> float:
        """A time with its unit, such as "500 ms" (s)."""
        return seconds(self.given[key]) if key in self.given else default_s

    def named(self, names: Mapping[str, Any], what: str) -> None:
        """Note keys that are not among names of the file."""
        for key in self.given:
            if key not in names:
                self.add(key, f"is not in [{what}]; {meant(key, names)}")


def listed(given: Any) -> list[Any]:  # noqa: ANN401 - one or several
    """One entry or several as a list."""
    return list(given) if isinstance(given, (list, tuple)) else [given]

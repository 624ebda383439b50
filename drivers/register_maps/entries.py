"""A user's file being read: every entry is judged, every problem is kept with its line, and all are told at once."""

from __future__ import annotations

import difflib
import re
import tomllib
from collections.abc import Collection, Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol

from drivers.devices.description_file import read_text
from protocols.errors import LocalProtocolError
from protocols.toml_lines import Place, scan_lines, structure_problem
from protocols.wire_units import unit_of

_TIME = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(us|ms|s|min)\s*", re.ASCII)
LONGEST_S = 600.0
LARGEST = 1e300
"""Largest number of an entry."""


class MapProblem(LocalProtocolError):
    """A file that cannot be used.

    Attributes:
        path: the file.
        problems: everything that is wrong, one line each, with the line in the file where that is known.
    """

    def __init__(self, path: Path, problems: Collection[str]) -> None:
        self.path = path
        self.problems = tuple(problems)
        super().__init__(f"{path}:" + "".join(f"\n  {problem}" for problem in self.problems))


class Source:
    """The file: its values, the lines of its keys, and what was found wrong so far."""

    def __init__(self, path: Path, text: str) -> None:
        self.path = path
        self.problems: list[str] = []
        if (problem := structure_problem(text)) is not None:
            raise MapProblem(path, [problem])
        try:
            self.data: dict[str, Any] = tomllib.loads(text)
        except (ValueError, RecursionError) as error:
            raise MapProblem(path, [f"not TOML: {error}"]) from error
        self._lines = scan_lines(text)

    @classmethod
    def read(cls, path: Path) -> Source:
        """Read a file.

        Raises:
            LocalProtocolError: it cannot be read, is too large, or is not TOML.
        """
        return cls(path, read_text(path))

    def add(self, place: Place, message: str) -> None:
        """Keep a problem of an entry, once."""
        line = next((self._lines[place[:n]] for n in range(len(place), 0, -1) if place[:n] in self._lines), None)
        entry = "".join(f"[{part + 1}]" if isinstance(part, int) else f".{part}" for part in place).lstrip(".")
        shown = f"{f'line {line}: ' if line else ''}{f'{entry}: ' if entry else ''}{message}"
        if shown not in self.problems:
            self.problems.append(shown)

    def finish(self) -> None:
        """End reading.

        Raises:
            MapProblem: something was wrong.
        """
        if self.problems:
            raise MapProblem(self.path, sorted(self.problems, key=_line_of))


def _line_of(problem: str) -> tuple[int, str]:
    match = re.match(r"line (\d+):", problem)
    return (int(match[1]) if match else 0, problem)


def nearest(name: str, known: Collection[str]) -> str:
    """What a name was meant to be, or which there are."""
    match = difflib.get_close_matches(name, known, n=1)
    return f"did you mean {match[0]}?" if match else f"known: {', '.join(known) or 'none'}"


class Keeper(Protocol):
    """Who keeps the problems of a file or a table."""

    def add(self, place: Place, message: str) -> None:
        """Keep a problem of an entry."""


class Table:
    """A table of the file; reading an entry that is wrong gives the default, and keeps the problem."""

    def __init__(self, source: Keeper, place: Place, given: Mapping[str, Any]) -> None:
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

    def only(self, known: Collection[str]) -> None:
        """Every key is one of these."""
        for key in self.given:
            if key not in known:
                self.add(key, f"unknown key; {nearest(key, known)}")

    def table(self, key: str, *, needed: str = "") -> Table:
        """A table below; an empty one where there is none."""
        value = self.given.get(key)
        if value is None and needed:
            self.add(None, f"[{key}] is missing; {needed}")
        elif value is not None and not isinstance(value, Mapping):
            self.add(key, f"must be a table, with the heading [{key}]")
        return Table(self.source, (*self.place, key), value if isinstance(value, Mapping) else {})

    def text(self, key: str, default: str = "", among: Collection[str] = ()) -> str:
        """A text, where `among` is given one of these."""
        value = self.given.get(key, default)
        if not isinstance(value, str):
            self.add(key, f"{value!r:.40} must be a text in quotes")
            return default
        if among and value not in among:
            self.add(key, f"{value!r:.40} is not one of {', '.join(among)}")
            return default
        return value

    def whole(self, key: str, default: int | None, low: int, high: int) -> int | None:
        """A whole number of a range; without a default it is needed."""
        value = self.given.get(key, default)
        if value is None:
            self.add(None, f"{key} is missing; write {key} = a whole number of {low} to {high}")
        elif isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            self.add(key, f"{value!r:.40} must be a whole number of {low} to {high}")
            return default
        return None if value is None else int(value)

    def number(self, key: str, default: float) -> float:
        """A finite number."""
        value = self.given.get(key, default)
        # A whole number of TOML has any size: compared, not converted.
        if isinstance(value, bool) or not isinstance(value, int | float) or not -LARGEST <= value <= LARGEST:
            self.add(key, f"{value!r:.40} must be a finite number")
            return default
        return float(value)

    def truth(self, key: str, *, default: bool) -> bool:
        """True or false."""
        value = self.given.get(key, default)
        if not isinstance(value, bool):
            self.add(key, f"{value!r:.40} must be true or false")
            return default
        return value

    def time_s(self, key: str, default_s: float | None) -> float:
        """A time with its unit, such as "500 ms" (s); without a default it is needed."""
        value = self.given.get(key)
        if value is None:
            if default_s is None:
                self.add(None, f'{key} is missing; write {key} = a time such as "500 ms"')
            return default_s or 0.0
        match = _TIME.fullmatch(value) if isinstance(value, str) else None
        unit = None if match is None else unit_of(match[2])
        if match is None or unit is None or not 0.0 < float(match[1]) * unit[1] <= LONGEST_S:
            self.add(key, f'{value!r:.40} must be a time such as "500 ms", more than 0 and at most {LONGEST_S:g} s')
            return default_s or 0.0
        return float(match[1]) * unit[1]

    def pairs(self, key: str) -> tuple[tuple[int, int], ...]:
        """A list of ranges [first, last]."""
        value = self.given.get(key, [])
        fine = isinstance(value, list) and all(
            isinstance(pair, list) and len(pair) == 2 and all(type(end) is int for end in pair) and pair[0] <= pair[1]
            for pair in value
        )
        if not fine:
            self.add(key, "must be a list of ranges [first, last], such as [[50, 59], [80, 99]]")
            return ()
        return tuple((pair[0], pair[1]) for pair in value)

"""What a file looked like when it was imported, and how another file differs from it."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass

from rig.errors import some
from rig.recording.file_formats.columns import FROM_FILE, FROM_NAME, ColumnChoice
from rig.recording.file_formats.file_units import known_unit
from rig.recording.file_formats.table_file import TableColumn

MOST_NAMES = 200
"""Of a file with more columns, only the columns that were used are kept."""
MOST_SHOWN = 8
RATE_SHARE = 0.01
COUNTED = re.compile(r", \d+ [^,]*|\d+")
"""Of the text on format and dialect: counts and line numbers, which change from file to file."""


EARLIER_WORDS = {"the file says": FROM_FILE, "by its name": FROM_NAME}
"""Of earlier versions in `unit_from`, and what this version states in their place."""


@dataclass(frozen=True)
class ColumnLayout:
    """A column that was used.

    Attributes:
        text: as the user wrote it.
        name: in the file.
        place: in the file, from 1.
        unit: of its numbers; empty for time stamps.
        unit_from: who states the unit, with the user's factor.
        file_unit: as the file states it; empty: not stated.
        unapplied: a property of the file that may be the factor of its integers.
    """

    text: str
    name: str
    place: int
    unit: str
    unit_from: str
    file_unit: str = ""
    unapplied: str = ""

    def __post_init__(self) -> None:
        for earlier, now in EARLIER_WORDS.items():
            if earlier in self.unit_from:
                object.__setattr__(self, "unit_from", self.unit_from.replace(earlier, now))


@dataclass(frozen=True)
class FileLayout:
    """A file as it was read.

    Attributes:
        read_as: format and dialect.
        columns: quantity -> column that was used.
        names: of all columns; empty if there are very many.
        rate_Hz: median sample rate.
    """

    read_as: str
    columns: Mapping[str, ColumnLayout]
    names: tuple[str, ...]
    rate_Hz: float

    @classmethod
    def of(
        cls, read_as: str, columns: Sequence[TableColumn], choices: Mapping[str, ColumnChoice], rate_Hz: float
    ) -> FileLayout:
        """The layout of a file that is being read."""
        used = {
            quantity: ColumnLayout(
                choice.text, choice.column, choice.place + 1, choice.unit_name, choice.unit_from,
                columns[choice.place].unit, columns[choice.place].unapplied,
            ) for quantity, choice in choices.items()
        }  # fmt: skip
        names = tuple(one.full or one.name for one in columns) if len(columns) <= MOST_NAMES else ()
        return cls(read_as, used, names, rate_Hz)

    def contradictions(self, now: FileLayout, replaced: Collection[str]) -> Iterator[str]:
        """Differences for which the options of the earlier import would give wrong numbers.

        Args:
            now: layout of the other file, read with these options.
            replaced: quantities whose column the user states anew.
        """
        for quantity, column in now.columns.items():
            before = self.columns.get(quantity)
            if before is None or quantity in replaced:
                continue
            stated = column.file_unit and _unit(column.file_unit) != _unit(before.file_unit)
            factor = "as given" in column.unit_from or re.search(r"times (?!-?1(\.0*)?$)", column.unit_from)
            if stated and factor:
                yield (
                    f"{quantity}: the file states the unit {column.file_unit!r} for {column.name!r} (earlier import: "
                    f"{before.file_unit or 'none'}), but the earlier options read the numbers as {column.unit} "
                    f"({column.unit_from}). Fix: specify --column {quantity}=NAME:UNIT, and --scale if required"
                )
            if before.text.startswith("#") and column.name != before.name:
                yield (
                    f"{quantity}: column {before.text} is {column.name!r}; in the earlier import it was "
                    f"{before.name!r}. Fix: specify --column {quantity}=NAME"
                )
            if column.unapplied != before.unapplied:
                yield (
                    f"{quantity}: the file contains {column.unapplied or 'no factor'} for {column.name!r}; in the "
                    f"earlier import it was {before.unapplied or 'none'}. Fix: specify --scale {quantity}=FACTOR"
                )

    def differences(self, now: FileLayout, replaced: Collection[str]) -> Iterator[str]:
        """Differences that are read rightly, but may be unexpected; see `contradictions`."""
        for quantity, column in now.columns.items():
            before = self.columns.get(quantity)
            if before is None or quantity in replaced:
                continue
            if (column.unit, column.unit_from) != (before.unit, before.unit_from):
                yield f"{quantity} in {_stated(column)} instead of {_stated(before)}"
            if column.place != before.place and column.name == before.name:
                yield f"{quantity} in column {column.place} instead of {before.place}"
        if COUNTED.sub("", now.read_as) != COUNTED.sub("", self.read_as):
            yield f"read as {now.read_as} instead of {self.read_as}"
        if now.names and self.names:
            for text, names in (("new", [name for name in now.names if name not in self.names]),
                                ("missing", [name for name in self.names if name not in now.names])):  # fmt: skip
                if names:
                    yield f"{text} column(s): {some(names, most=MOST_SHOWN)}"
        if abs(now.rate_Hz - self.rate_Hz) > RATE_SHARE * self.rate_Hz:
            yield f"{now.rate_Hz:.4g} samples per second instead of {self.rate_Hz:.4g}"


def _unit(text: str) -> str:
    return known_unit(text) or text.strip().casefold()


def _stated(column: ColumnLayout) -> str:
    return f"{column.unit or 'time stamps'}{f' ({column.unit_from})' * bool(column.unit_from)}"

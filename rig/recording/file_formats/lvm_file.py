"""LVM files: LabVIEW's text measurement files, in segments with a header each.

Source: NI, "Specification for the LabVIEW Measurement File (.lvm)": keys of the file's and of each segment's header.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TypeVar

import numpy as np

from rig.errors import FileProblem
from rig.recording.file_formats.csv_dialect import cells_of
from rig.recording.file_formats.csv_file import CsvFile
from rig.recording.file_formats.table_file import Dialect, TableColumn
from rig.signals.arrays import FloatArray

SIGNATURE = b"LabVIEW Measurement"
END = "***End_of_Header***"
X_VALUE, COMMENT = "X_Value", "Comment"
T = TypeVar("T")
SEPARATORS = {"tab": "\t", "comma": ","}


@dataclass(frozen=True)
class Segment:
    """Header of a segment: line of its names (from 1), and what it states of each channel, in their order.

    Attributes:
        line: of the names.
        units: empty where a channel has none.
        is_time: whether its x axis is the time.
        first_s: x of the first sample (s).
        step_s: step of x (s); NaN where the header states none.
        begun: date and time from which x counts.
    """

    line: int
    units: tuple[str, ...]
    is_time: bool
    first_s: tuple[float, ...]
    step_s: tuple[float, ...]
    begun: tuple[str, ...]

    def times_of(self, channels: Sequence[int]) -> set[tuple[float, float, str]]:
        """First x, step and beginning of channels; one element if they were sampled together."""
        return {(_at(self.first_s, k, 0.0), _at(self.step_s, k, np.nan), _at(self.begun, k, "")) for k in channels}


class LvmFile(CsvFile):
    """An LVM file; see `rig.recording.file_formats.table_file.TableFile`. Units and times are those of its headers."""

    def __init__(self, file: Path, data: bytes, stated: Dialect) -> None:
        """Read its headers.

        Raises:
            FileProblem: it holds no rows of numbers, or its segments have different units.
        """
        head = data[:4096].decode("latin-1").replace("\r", "\n").split("\n")
        keys = dict(line.replace(",", "\t").split("\t", 2)[:2] for line in head if "\t" in line or "," in line)
        separator = SEPARATORS.get(keys.get("Separator", "").strip().casefold())
        decimal = keys.get("Decimal_Separator", "").strip()
        stated = replace(
            stated, separator=stated.separator or separator,
            decimal=stated.decimal or (decimal if decimal in {".", ","} else "." if separator == "," else None),
        )
        super().__init__(file, data, stated)
        self._segments = list(self._headers())
        if len({_ended(one.units) for one in self._segments}) > 1:
            other = next(one for one in self._segments if _ended(one.units) != _ended(self._segments[0].units))
            raise FileProblem(str(file), [
                f"line {other.line}: this segment has the units {', '.join(other.units)}; the first segment has "
                f"{', '.join(self._segments[0].units)}. Fix: save each segment as a separate file",
            ])  # fmt: skip

    @property
    def columns(self) -> list[TableColumn]:
        """See `TableFile.columns`."""
        columns = super().columns
        if not self._segments:
            return columns
        return [self._with_unit(column, place) for place, column in enumerate(columns)]

    def _with_unit(self, column: TableColumn, place: int) -> TableColumn:
        if column.name == X_VALUE:
            return replace(column, unit="s" if self._segments[0].is_time else column.unit)
        unit = column.unit or _at(self._segments[0].units, self._channel(place), "")
        return column if column.name == COMMENT else replace(column, unit=unit)

    def _channel(self, place: int) -> int:
        """Which channel, from 0, a column is."""
        return sum(name not in {X_VALUE, COMMENT} for name in self.layout.names[:place])

    @property
    def read_as(self) -> str:
        """See `TableFile.read_as`."""
        count = len(self._segments)
        return super().read_as.replace("CSV", f"LVM, {count} segment{'s' * (count != 1)}", 1)

    def own_time(self, places: Sequence[int]) -> FloatArray | None:  # type: ignore[override]  # text has none
        """See `TableFile.own_time`: the column X_Value, or the start and step of each segment's header.

        Raises:
            FileProblem: its numbers are no numbers, or the columns have different steps.
        """
        if not self._segments or not all(one.is_time for one in self._segments):
            return None
        names = [column.name for column in self.columns]
        channels = [self._channel(place) for place in places]
        for segment in self._segments:
            if len(segment.times_of(channels)) > 1:
                raise FileProblem(str(self._file), [f"line {segment.line}: the channels were not sampled together: " + (
                    "; ".join(f"{names[place]}: X0 {_at(segment.first_s, channel, 0.0):g} s, Delta_X "
                              f"{_at(segment.step_s, channel, np.nan):g} s, {_at(segment.begun, channel, '')}"
                              for place, channel in zip(places, channels, strict=True))
                )])  # fmt: skip
        first = self._segments[0].times_of(channels) == self._segments[0].times_of([0])
        if X_VALUE in names and self.layout.sample[names.index(X_VALUE)] and (names.count(X_VALUE) > 1 or first):
            return self._x_values(places, names)
        edges = [0, *(one.row for one in self.breaks() if one.heading), len(self.values(places)[0])]
        parts, begun = [], []
        for count, segment in zip(np.diff(edges), self._segments, strict=False):
            first_s, step_s, at = segment.times_of(channels).pop()
            if not (np.isfinite(step_s) and step_s > 0.0):
                raise FileProblem(str(self._file), [f"line {segment.line}: the header of the segment states no "
                    "Delta_X. Fix: specify a time column or --rate"])
            begun.append(_instant(at))
            known = begun[-1] is not None and begun[0] is not None
            after_s = (begun[-1] - begun[0]).total_seconds() if known else 0.0  # type: ignore[operator]  # both known
            parts.append(after_s + first_s + step_s * np.arange(count))
        return np.concatenate(parts)

    def _x_values(self, places: Sequence[int], names: Sequence[str]) -> FloatArray:
        """The column X_Value before the first of the columns; each of the columns must have the same one.

        Raises:
            FileProblem: they have not.
        """
        mine = sorted({max(k for k in range(place + 1) if names[k] == X_VALUE) for place in places})
        columns = self.values([*places, *mine])[len(places) :]
        if any(not np.array_equal(columns[0], one, equal_nan=True) for one in columns):
            raise FileProblem(str(self._file), [
                "the channels have different X_Value columns: they were not sampled together. Fix: select channels "
                "that share an X_Value column",
            ])
        return columns[0]

    def _headers(self) -> Iterator[Segment]:
        """The header of each segment. With an x column for each channel, every second cell of a line is a channel's."""
        separator, lines = self.layout.separator, self._text.split("\n")
        every, keys = 1, dict[str, list[str]]()
        for number, line in enumerate(lines):
            key, _, rest = line.partition(separator)
            if not key[:1].isalpha() and not key.startswith("***"):
                continue
            cells = cells_of(rest, separator)
            if key.strip() == "X_Columns":
                every = 2 if cells[:1] == ["Multi"] else 1
            if key.strip() != END:
                keys[key.strip()] = cells
                continue
            if "Delta_X" in keys or "Y_Unit_Label" in keys or "Channels" in keys:
                stated = {name: held[::every] for name, held in keys.items()}
                begun = zip(stated.get("Date", []), stated.get("Time", []), strict=False)
                yield Segment(
                    number + 2, tuple(stated.get("Y_Unit_Label", [])),
                    all(name.casefold() == "time" for name in stated.get("X_Dimension", ["Time"]) if name),
                    tuple(map(_number, stated.get("X0", []))), tuple(map(_number, stated.get("Delta_X", []))),
                    tuple(" ".join(one) for one in begun),
                )  # fmt: skip
            keys = {}


def _ended(units: Sequence[str]) -> tuple[str, ...]:
    """Units without empty ones at the end."""
    return tuple("\t".join(units).rstrip("\t").split("\t"))


def _at(values: Sequence[T], place: int, missing: T) -> T:
    return values[place] if place < len(values) else missing


def _number(text: str) -> float:
    try:
        return float(text.replace(",", "."))
    except ValueError:
        return float("nan")


def _instant(text: str) -> datetime | None:
    """Date and time of a segment, of which LabVIEW writes up to 21 decimals."""
    whole, _, decimals = text.replace(",", ".").partition(".")
    try:
        return datetime.strptime(f"{whole}.{decimals[:6] or 0}", "%Y/%m/%d %H:%M:%S.%f")  # noqa: DTZ007 - differences
    except ValueError:
        return None

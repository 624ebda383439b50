"""LVM files: LabVIEW's text measurement files, in segments with a header each.

Source: NI, "Specification for the LabVIEW Measurement File (.lvm)": keys of the file's and of each segment's header.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np

from rig.errors import FileProblem
from rig.recording.file_formats.csv_dialect import cells_of
from rig.recording.file_formats.csv_file import CsvFile
from rig.recording.file_formats.table_file import Dialect, TableColumn
from rig.signals.arrays import FloatArray

SIGNATURE = b"LabVIEW Measurement"
END = "***End_of_Header***"
X_VALUE, COMMENT = "X_Value", "Comment"
SEPARATORS = {"tab": "\t", "comma": ","}


@dataclass(frozen=True)
class Segment:
    """Header of a segment: line of its names (from 1), units, and the time of its samples (s) where it states one."""

    line: int
    units: tuple[str, ...]
    is_time: bool
    first_s: tuple[float, ...]
    step_s: tuple[float, ...]
    begun: str


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
        if len({one.units for one in self._segments}) > 1:
            other = next(one for one in self._segments if one.units != self._segments[0].units)
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
        channels = iter(self._segments[0].units)
        return [self._with_unit(column, channels) for column in columns]

    def _with_unit(self, column: TableColumn, channels: Iterator[str]) -> TableColumn:
        if column.name == X_VALUE:
            return replace(column, unit="s" if self._segments[0].is_time else column.unit)
        return replace(column, unit=column.unit or next(channels, "")) if column.name != COMMENT else column

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
        if X_VALUE in names and self.layout.sample[names.index(X_VALUE)]:
            return self._x_values(places, names)
        edges = [0, *(one.row for one in self.breaks() if one.heading), len(self.values(places)[0])]
        begun = [_instant(one.begun) for one in self._segments]
        parts = []
        for count, segment, at in zip(np.diff(edges), self._segments, begun, strict=False):
            if len({*segment.step_s, *segment.first_s[1:]} - {segment.step_s[0], segment.first_s[0]}) or not (
                np.isfinite(segment.step_s[0]) and segment.step_s[0] > 0.0
            ):
                raise FileProblem(str(self._file), [
                    f"line {segment.line}: the channels were not sampled together: X0 {segment.first_s}, Delta_X "
                    f"{segment.step_s} s. Fix: specify a time column"
                ])  # fmt: skip
            after_s = (at - begun[0]).total_seconds() if at is not None and begun[0] is not None else 0.0
            parts.append(after_s + segment.first_s[0] + segment.step_s[0] * np.arange(count))
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
        """The header of each segment."""
        separator, lines = self.layout.separator, self._text.split("\n")
        keys: dict[str, list[str]] = {}
        for number, line in enumerate(lines):
            key, _, rest = line.partition(separator)
            if not key[:1].isalpha() and not key.startswith("***"):
                continue
            if key.strip() != END:
                keys[key.strip()] = [cell for cell in cells_of(rest, separator) if cell]
                continue
            if "Delta_X" in keys or "Y_Unit_Label" in keys or "Channels" in keys:
                yield Segment(
                    number + 2, tuple(keys.get("Y_Unit_Label", [])),
                    all(name.casefold() == "time" for name in keys.get("X_Dimension", ["Time"])),
                    tuple(map(_number, keys.get("X0", []))) or (0.0,),
                    tuple(map(_number, keys.get("Delta_X", []))) or (float("nan"),),
                    " ".join(next(iter(keys.get(name, [])), "") for name in ("Date", "Time")),
                )  # fmt: skip
            keys = {}


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

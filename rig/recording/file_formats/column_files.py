"""Files of whole columns with units: Parquet, and NetCDF 3; our own exports are such files, too."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rig.errors import FileProblem
from rig.extras import how_to_install
from rig.recording.file_formats.table_file import (
    NoLines,
    TableColumn,
    check_equal_lengths,
    check_size,
    stream,
    unreadable,
)
from rig.recording.file_formats.text_cells import seconds_of_dates
from rig.signals.arrays import FloatArray

PARQUET = b"PAR1"
NETCDF = (b"CDF\x01", b"CDF\x02")
UNIT_KEYS = (b"unit", b"units")
DESCRIBED = ("id", "waveform", "current_A", "verdict", "skew_std_s", "current_source")
"""What our own exports state of a test."""
UDUNITS = {"degree_Celsius": "degC", "m s-1": "m/s"}
"""Units of our own exports, as our tables call them."""


class ColumnFile(NoLines):
    """A file of columns; see `TableFile`.

    Attributes:
        described: what the file states of the test as a whole, as texts.
    """

    def __init__(
        self, file: Path, read_as: str, columns: Mapping[str, tuple[str, FloatArray]], described: Mapping[str, str]
    ) -> None:
        """Take the columns of numbers, each with its unit; of one length are those that a test is made of.

        Raises:
            FileProblem: there is none.
        """
        if not columns:
            raise FileProblem(str(file), ["the file contains no column of numbers"])
        self._file, self._values = file, [values for _, values in columns.values()]
        self.columns: Sequence[TableColumn] = [TableColumn(name, unit) for name, (unit, _) in columns.items()]
        self.read_as, self.described = read_as, described

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `TableFile.values`."""
        columns = [self._values[place] for place in places]
        check_equal_lengths(self._file, [self.columns[place].name for place in places], [len(one) for one in columns])
        return columns

    def own_time(self, places: Sequence[int]) -> None:
        """See `TableFile.own_time`: a time is a column here."""
        del places


def parquet_file(file: Path, data: bytes) -> ColumnFile:
    """A Parquet file; the unit of a column is the entry `unit` or `units` of its metadata.

    Raises:
        FileProblem: pyarrow is not installed, or the file is damaged or holds no numbers.
    """
    try:
        import pyarrow.parquet
    except ImportError as error:
        raise FileProblem(str(file), [f"Parquet: pyarrow is not installed. Fix: {how_to_install('files')}"]) from error
    try:
        source = pyarrow.parquet.ParquetFile(stream(data))
        schema = source.schema_arrow
        numeric = [one for one in schema if str(one.type).startswith(("float", "double", "int", "uint", "timestamp"))]
        check_size(file, source.metadata.num_rows * max(1, len(numeric)))
        table = source.read([one.name for one in numeric])
        columns = {
            one.name: (_unit(one.metadata or {}), _numbers(table.column(place).to_numpy()))
            for place, one in enumerate(numeric)
        }
        stated = schema.metadata or {}
        described = {name: stated[name.encode()].decode() for name in DESCRIBED if name.encode() in stated}
    except FileProblem:
        raise
    except Exception as error:
        raise FileProblem(str(file), unreadable("Parquet", error)) from error
    return ColumnFile(file, "Parquet", columns, described)


def netcdf_file(file: Path, data: bytes) -> ColumnFile:
    """A NetCDF 3 file; the unit of a variable is its attribute `units`.

    Raises:
        FileProblem: the file is damaged or holds no vector of numbers.
    """
    from scipy.io import netcdf_file as opened  # half a second that other formats need not wait

    try:
        with opened(stream(data), "r", mmap=False, maskandscale=True) as held:
            columns = {}
            for name, variable in held.variables.items():
                if len(variable.shape) == 1 and variable.data.dtype.kind in "iuf":
                    unit = _text(getattr(variable, "units", ""))
                    values = np.ma.filled(np.ma.asarray(variable[:], np.float64), np.nan)
                    columns[name] = (UDUNITS.get(unit, unit), _numbers(values))
            described = {name: _text(getattr(held, name)) for name in DESCRIBED if hasattr(held, name)}
        check_size(file, sum(len(values) for _, values in columns.values()))
    except FileProblem:
        raise
    except Exception as error:
        raise FileProblem(str(file), unreadable("NetCDF 3", error)) from error
    return ColumnFile(file, "NetCDF 3", columns, described)


def _unit(metadata: Mapping[bytes, bytes]) -> str:
    unit = next((metadata[key].decode("utf-8", "replace") for key in UNIT_KEYS if key in metadata), "")
    return UDUNITS.get(unit, unit)


def _numbers(values: Any) -> FloatArray:  # noqa: ANN401 - an array of any type
    """Numbers (n,); of time stamps seconds from the first one."""
    if values.dtype.kind == "M":
        return seconds_of_dates(values)
    return np.ascontiguousarray(values, np.float64)


def _text(value: object) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)

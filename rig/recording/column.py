"""Columns too long to hold: made, read and written a part at a time, and used like arrays otherwise."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rig.recording.layout import PART_SAMPLES, RECORD_DTYPE, parts

Part = Callable[[int, int], NDArray[Any]]


class Column:
    """A column (n,) that is computed for one range of rows at a time; the last range is kept.

    Args:
        length: n.
        dtype: type of the values.
        part: `part(start, stop)` gives the rows from start up to, not including, stop.
    """

    ndim = 1

    def __init__(self, length: int, dtype: DTypeLike, part: Part) -> None:
        self.dtype: np.dtype[Any] = np.dtype(dtype)
        self.shape = (length,)
        self._part = part
        self._kept: tuple[int, int, NDArray[Any]] | None = None

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, key: slice | int) -> Any:  # noqa: ANN401 - one value or an array, as numpy does
        if isinstance(key, slice):
            start, stop, step = key.indices(len(self))
            return self._rows(start, max(start, stop))[::step]
        index = key if key >= 0 else len(self) + key
        return self._part(index, index + 1)[0]

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> NDArray[Any]:
        whole = np.empty(len(self), self.dtype)
        for rows in parts(len(self)):
            whole[rows] = self[rows]
        return whole if dtype is None else whole.astype(dtype)

    def _rows(self, start: int, stop: int) -> NDArray[Any]:
        if self._kept is not None and self._kept[:2] == (start, stop):
            return self._kept[2]
        values = self._part(start, stop)
        if len(values) > 1:
            self._kept = (start, stop, values)
        return values


class StoredRecords:
    """Ring records of one channel in a temporary file without a name: appended once, then read a part at a time.

    `records[a:b]` is an array of `RECORD_DTYPE`, `records["value"]` one field as a `Column`.

    Args:
        folder: where the file lies; it vanishes when closed, or with the process.

    Raises:
        OSError: the file cannot be made.
    """

    ndim = 1
    dtype = RECORD_DTYPE

    def __init__(self, folder: Path) -> None:
        self._file: IO[bytes] = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - lives as long as this object
        self._count = 0

    def append(self, records: NDArray[Any]) -> None:
        """Add records (n,).

        Raises:
            OSError: the disk refuses them.
        """
        self._file.write(records.tobytes())
        self._count += len(records)

    def finish(self) -> None:
        """Nothing more is appended.

        Raises:
            OSError: the disk refuses what was appended last.
        """
        self._file.flush()

    def close(self) -> None:
        """Give the room back."""
        self._file.close()

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, key: slice | str) -> Any:  # noqa: ANN401 - an array or a column, as a record array does
        if isinstance(key, str):
            return Column(len(self), RECORD_DTYPE[key], lambda start, stop: self[start:stop][key])
        start, stop, step = key.indices(len(self))
        size = RECORD_DTYPE.itemsize
        data = os.pread(self._file.fileno(), max(0, stop - start) * size, start * size)
        return np.frombuffer(data, RECORD_DTYPE)[::step]


Records = NDArray[Any] | StoredRecords
Values = NDArray[Any] | Column


def mapped(values: Values, change: Callable[[NDArray[Any]], NDArray[Any]], dtype: DTypeLike) -> Values:
    """`change` of a column, row by row; an array is changed at once."""
    if isinstance(values, Column):
        return Column(len(values), dtype, lambda start, stop: change(values[start:stop]).astype(dtype))
    return change(values).astype(dtype)


def thinned(values: Values, most: int) -> NDArray[Any]:
    """Every k-th value, at most `most` of them and a part more."""
    every = max(1, -(-len(values) // most))
    return np.concatenate([values[rows][(-rows.start) % every :: every] for rows in parts(len(values))])


def first_after(values: Values, limit: float) -> int:
    """Index of the first value above `limit` in an ascending column; its length when there is none."""
    if not isinstance(values, Column):
        return int(np.searchsorted(values, limit, side="right"))
    low, high = 0, len(values)
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if values[middle] > limit else (middle + 1, high)
    return low


def overlapping(length: int) -> Iterator[slice]:
    """Ranges that cover a column, each beginning with the last row of the one before."""
    for rows in parts(length):
        yield slice(max(0, rows.start - 1), rows.stop)


__all__ = [
    "PART_SAMPLES", "Column", "Records", "StoredRecords", "Values", "first_after", "mapped", "overlapping", "thinned",
]

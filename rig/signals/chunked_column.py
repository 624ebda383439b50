"""Columns too long to hold: made, read and written a part at a time, and used like arrays otherwise."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

PART_SAMPLES = 16 * 16384
"""So many rows of a column are in memory at a time."""

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


Values = NDArray[Any] | Column


def parts(length: int) -> Iterator[slice]:
    """Ranges of at most `PART_SAMPLES` rows that cover a column end to end; one empty range for an empty column."""
    for start in range(0, max(length, 1), PART_SAMPLES):
        yield slice(start, min(start + PART_SAMPLES, length))


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

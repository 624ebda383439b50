"""HDF5 files: data sets by their path, such as `run1/force`; also NetCDF 4, which is HDF5.

Only the content of the file itself is read: links to other locations or files are not followed.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig.errors import FileProblem
from rig.recording.file_formats.table_file import (
    DEEPEST,
    FEWEST_ROWS,
    MOST_COLUMNS,
    NoLines,
    TableColumn,
    check_equal_lengths,
    check_size,
    stream,
    unapplied_factor,
    unreadable,
)
from rig.signals.arrays import FloatArray

SIGNATURE = b"\x89HDF\r\n\x1a\n"
UNITS = ("units", "unit", "Units", "Unit", "UNITS", "UNIT")
"""Attributes in which programs write a unit."""
CONVENTION = frozenset(("scale_factor", "add_offset"))
"""Attributes of the NetCDF convention (CF, section 8.1): value = number x scale_factor + add_offset."""
MISSING = ("_FillValue", "missing_value")
MOST_DATASETS = 20_000


def is_hdf5(data: bytes) -> bool:
    """Whether a file has HDF5's signature, also after a user block."""
    return any(data[place : place + 8] == SIGNATURE for place in (0, 512, 1024, 2048))


class Hdf5File(NoLines):
    """An HDF5 file; see `rig.recording.file_formats.table_file.TableFile`.

    A data set is a column of its path, a field of a table `path/field`, the third column of a matrix `path(3)`.
    """

    def __init__(self, file: Path, data: bytes) -> None:
        """Read which data sets there are.

        Raises:
            FileProblem: it is damaged.
        """
        self._file, self._notes = file, ""
        try:
            self._held = h5py.File(stream(data), "r")
            self._series: list[tuple[h5py.Dataset, str, int | None]] = []
            names: list[str] = []
            for path, one in datasets(self._held, "/"):
                for name, field, column in _columns(path, one):
                    names.append(name)
                    self._series.append((one, field, column))
                check_size(file, 0 if len(names) < MOST_DATASETS else len(names) << 20)
            self.columns: Sequence[TableColumn] = [
                TableColumn(name, unit_of(one), f"/{name}", _unapplied(one))
                for name, (one, _field, _column) in zip(names, self._series, strict=True)
            ]
        except FileProblem:
            raise
        except Exception as error:
            raise FileProblem(str(file), unreadable("HDF5", error)) from error

    @property
    def read_as(self) -> str:
        """See `TableFile.read_as`."""
        return f"HDF5{self._notes}"

    def own_time(self, places: Sequence[int]) -> None:
        """See `TableFile.own_time`; none."""

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `TableFile.values`.

        Raises:
            FileProblem: they cannot be read, or are too many.
        """
        chosen = [self._series[place] for place in places]
        check_size(self._file, sum({one.name: int(one.size or 0) for one, _field, _column in chosen}.values()))
        try:
            series = [self._numbers(*one) for one in chosen]
        except Exception as error:
            raise FileProblem(str(self._file), unreadable("HDF5", error)) from error
        check_equal_lengths(self._file, [self.columns[place].name for place in places], list(map(len, series)))
        return series

    def _numbers(self, one: h5py.Dataset, field: str, column: int | None) -> FloatArray:
        raw = np.asarray(one[field] if field else one[()])
        if column is not None:
            raw = raw[:, column] if raw.shape[0] >= raw.shape[1] else raw[column]
        raw = raw.reshape(-1)
        values = raw.astype(np.float64)
        for name in MISSING:
            if name in one.attrs:
                values[np.isin(raw, np.asarray(one.attrs[name]))] = np.nan
        factors = {name: float(np.asarray(one.attrs[name]).reshape(-1)[0]) for name in CONVENTION if name in one.attrs}
        if factors:
            factors_text = ", ".join(f"{name} {number:g}" for name, number in sorted(factors.items()))
            note = f", {one.name.lstrip('/')}: {factors_text} applied"
            self._notes += note if note not in self._notes else ""
        return np.asarray(values * factors.get("scale_factor", 1.0) + factors.get("add_offset", 0.0), np.float64)


def datasets(group: h5py.Group, separator: str) -> Iterator[tuple[str, h5py.Dataset]]:
    """Arrays of numbers and tables below a group, by their path; every group once."""
    yield from _below(group, "", separator, set(), 0)


def _below(group: h5py.Group, prefix: str, separator: str, seen: set[int], depth: int) -> Iterator[
    tuple[str, h5py.Dataset]
]:  # fmt: skip
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        one = group[name]
        if isinstance(one, h5py.Group):
            address = h5py.h5o.get_info(one.id).addr
            if depth < DEEPEST and address not in seen:
                seen.add(address)
                yield from _below(one, f"{prefix}{name}{separator}", separator, seen, depth + 1)
        elif isinstance(one, h5py.Dataset) and one.ndim <= 2 and not one.external and not one.is_virtual:
            yield f"{prefix}{name}", one


def _columns(path: str, one: h5py.Dataset) -> Iterator[tuple[str, str, int | None]]:
    """Name, field and column of each series in a data set; the longer side of a matrix is the time."""
    if one.dtype.names is not None and one.ndim == 1 and one.size >= FEWEST_ROWS:
        yield from ((f"{path}/{field}", field, None) for field in one.dtype.names
                    if one.dtype[field].kind in "fiu" and not one.dtype[field].shape)  # fmt: skip
    if one.dtype.kind not in "fiu" or int(one.size or 0) < FEWEST_ROWS:
        return
    if one.ndim == 1 or 1 in one.shape:
        yield path, "", None
    elif min(one.shape) <= MOST_COLUMNS:
        yield from ((f"{path}({k + 1})", "", k) for k in range(min(one.shape)))


def unit_of(one: Any) -> str:  # noqa: ANN401 - of a library without annotations
    """The unit in the attributes of a data set; empty where they have none."""
    for name in UNITS:
        value = one.attrs.get(name)
        if value is not None and np.size(value) == 1:
            text = np.asarray(value).reshape(-1)[0]
            return text.decode("utf-8", "replace").strip() if isinstance(text, bytes) else str(text).strip()
    return ""


def _unapplied(one: h5py.Dataset) -> str:
    if one.dtype.kind not in "iu":
        return ""
    return unapplied_factor({
        name: np.asarray(value).reshape(-1)[0] for name, value in one.attrs.items()
        if name not in CONVENTION and np.size(value) == 1
    })

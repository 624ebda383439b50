"""HDF5 files: data sets by their path, such as `run1/force`; also NetCDF 4, which is HDF5.

Only the content of the file itself is read: links to other locations or files are not followed.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
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
COLUMN_NAMES = ("columns", "column_names", "names", "labels", "channels", "channel_names", "Columns", "Channels")
"""Attributes in which programs name the columns of a matrix."""
RATES = frozenset((
    "samplerate", "samplingrate", "sampleratehz", "samplingratehz", "samplefrequency", "samplingfrequency",
    "samplingfrequencyhz", "fs", "fshz", "ratehz", "samplespersecond",
))  # fmt: skip
STEPS = frozenset((
    "dt", "dts", "deltat", "deltats", "wfincrement", "timestep", "timesteps", "sampleinterval", "samplinginterval",
    "sampleperiod", "samplingperiod", "sampleperiods", "samplingperiods",
))  # fmt: skip
"""Letters of the attributes in which programs write a rate in Hz, or a period in s (`dt`, `dt_s`)."""
SINCE = re.compile(r" since .*", re.DOTALL)
"""Of a time in the CF convention (`seconds since 2026-01-01`)."""


def is_hdf5(data: bytes) -> bool:
    """Whether a file has HDF5's signature, also after a user block."""
    return any(data[place : place + 8] == SIGNATURE for place in (0, 512, 1024, 2048))


@dataclass(frozen=True)
class Series:
    """A series of numbers in a data set: a field of a table, or a column of a matrix, or all of it.

    Attributes:
        name: by which it is called.
        dataset: that holds it.
        fields: names of fields within each other.
        column: of the matrix; None: it has one.
        also: the column by its number, where the matrix names its columns.
        unit: as the file states it.
    """

    name: str
    dataset: h5py.Dataset
    fields: tuple[str, ...] = ()
    column: int | None = None
    also: str = ""
    unit: str = ""


class Hdf5File(NoLines):
    """An HDF5 file; see `rig.recording.file_formats.table_file.TableFile`.

    A data set is a column of its path, a field of a table `path/field`, the third column of a matrix `path(3)`, or
    `path/name` where an attribute of the matrix names its columns.
    """

    def __init__(self, file: Path, data: bytes) -> None:
        """Read which data sets there are.

        Raises:
            FileProblem: it is damaged.
        """
        self._file, self._notes = file, ""
        try:
            self._held = h5py.File(stream(data), "r")
            self._series: list[Series] = []
            for path, one in datasets(self._held, "/"):
                self._series += _series(path, one)
                check_size(file, 0 if len(self._series) < MOST_DATASETS else len(self._series) << 20)
            self.columns: Sequence[TableColumn] = [
                TableColumn(one.name, one.unit, f"/{one.name}", _unapplied(one.dataset), one.also)
                for one in self._series
            ]
        except FileProblem:
            raise
        except Exception as error:
            raise FileProblem(str(file), unreadable("HDF5", error)) from error

    @property
    def read_as(self) -> str:
        """See `TableFile.read_as`."""
        return f"HDF5{self._notes}"

    def own_time(self, places: Sequence[int]) -> FloatArray | None:
        """See `TableFile.own_time`: of a rate or step in the attributes of the data sets or the groups they are in.

        Raises:
            FileProblem: they have different ones.
        """
        try:
            steps = [_stated_step(self._held, self._series[place].dataset) for place in places]
        except Exception as error:
            raise FileProblem(str(self._file), unreadable("HDF5", error)) from error
        stated = {self.columns[place].name: step for place, step in zip(places, steps, strict=True) if step is not None}
        if not stated:
            return None
        if len({step_s for step_s, _attribute in stated.values()}) > 1:
            raise FileProblem(str(self._file), ["the data sets were not sampled at the same times: " + ", ".join(
                f"{name}: {attribute}" for name, (_step_s, attribute) in stated.items()
            )])
        step_s, attribute = next(iter(stated.values()))
        self._note(f"time from the attribute {attribute}")
        return np.asarray(step_s * np.arange(len(self.values(places[:1])[0])), np.float64)

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `TableFile.values`.

        Raises:
            FileProblem: they cannot be read, or are too many.
        """
        chosen = [self._series[place] for place in places]
        check_size(self._file, sum({one.dataset.name: _numbers_in(one.dataset) for one in chosen}.values()))
        try:
            columns = [self._numbers(one) for one in chosen]
        except Exception as error:
            raise FileProblem(str(self._file), unreadable("HDF5", error)) from error
        check_equal_lengths(self._file, [self.columns[place].name for place in places], list(map(len, columns)))
        return columns

    def _numbers(self, series: Series) -> FloatArray:
        one = series.dataset
        raw = np.asarray(one[series.fields[0]] if series.fields else one[()])
        for name in series.fields[1:]:
            raw = raw[name]
        if series.column is not None:
            raw = raw[:, series.column] if raw.shape[0] >= raw.shape[1] or series.fields else raw[series.column]
        raw = raw.reshape(-1)
        values = raw.astype(np.float64)
        for name in MISSING:
            if name in one.attrs:
                values[np.isin(raw, np.asarray(one.attrs[name]))] = np.nan
        factors = {name: float(np.asarray(one.attrs[name]).reshape(-1)[0]) for name in CONVENTION if name in one.attrs}
        if factors:
            factors_text = ", ".join(f"{name} {number:g}" for name, number in sorted(factors.items()))
            self._note(f"{one.name.lstrip('/')}: {factors_text} applied")
        return np.asarray(values * factors.get("scale_factor", 1.0) + factors.get("add_offset", 0.0), np.float64)

    def _note(self, text: str) -> None:
        self._notes += f", {text}" if text not in self._notes else ""


def _numbers_in(one: h5py.Dataset) -> int:
    return int(one.size or 0) * max(1, int(one.dtype.itemsize) // 8)


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


def _series(path: str, one: h5py.Dataset) -> Iterator[Series]:
    """The series in a data set; the longer side of a matrix is the time."""
    if one.dtype.names is not None and one.ndim == 1 and one.size >= FEWEST_ROWS:
        leaves = list(_leaves(one.dtype, ()))
        for k, (fields, width) in enumerate(leaves):
            name, unit = "/".join((path, *fields)), _unit_of_part(one, fields[-1], k, len(leaves))
            if not width:
                yield Series(name, one, fields, unit=unit)
            for column in range(width):
                yield Series(f"{name}({column + 1})", one, fields, column, unit=unit)
    if one.dtype.kind not in "fiu" or int(one.size or 0) < FEWEST_ROWS:
        return
    if one.ndim == 1 or 1 in one.shape:
        yield Series(path, one, unit=unit_of(one))
    elif min(one.shape) <= MOST_COLUMNS:
        count = min(one.shape)
        names, parent = _column_names(path, one, count)
        for k in range(count):
            unit, numbered = _unit_of_part(one, names[k] if names else "", k, count), f"{path}({k + 1})"
            if names and names[k]:
                yield Series(f"{parent}{names[k]}", one, (), k, numbered, unit)
            else:
                yield Series(numbered, one, (), k, unit=unit)


def _leaves(kind: np.dtype[Any], fields: tuple[str, ...]) -> Iterator[tuple[tuple[str, ...], int]]:
    """Fields of numbers in a compound type, also in fields within each other; the width of those that are vectors."""
    for name in kind.names or ():
        field = kind[name]
        if field.names is not None and len(fields) < DEEPEST:
            yield from _leaves(field, (*fields, name))
        elif field.base.kind in "fiu" and len(field.shape) <= 1 and (not field.shape or field.shape[0] <= MOST_COLUMNS):
            yield (*fields, name), field.shape[0] if field.shape else 0


def _column_names(path: str, one: h5py.Dataset, count: int) -> tuple[list[str], str]:
    """Names of a matrix's columns and the path before them; of tables that pandas wrote, those in a data set beside."""
    for attribute in COLUMN_NAMES:
        names = _texts(one.attrs.get(attribute), count)
        if names:
            return names, f"{path}/"
    parent, _, name = path.rpartition("/")
    pandas = re.fullmatch(r"(block\d+)_values", name)
    items = one.parent.get(f"{pandas[1]}_items") if pandas else None
    names = _texts(items[()], count) if isinstance(items, h5py.Dataset) and items.size == count else []
    return names, f"{parent}/" if parent else ""


def _texts(value: object, count: int) -> list[str]:
    """So many texts in an attribute: an array, or one text with commas; empty: it has another number of them."""
    if value is None:
        return []
    texts = [_plain_text(one) for one in np.asarray(value).reshape(-1)[: MOST_COLUMNS + 1]]
    if len(texts) == 1 and count > 1:
        texts = [text.strip() for text in re.split(r"[,;]", texts[0])]
    return texts if len(texts) == count else []


def _plain_text(value: object) -> str:
    return value.decode("utf-8", "replace").strip() if isinstance(value, bytes) else str(value).strip()


def unit_of(one: Any) -> str:  # noqa: ANN401 - of a library without annotations
    """The unit in the attributes of a data set; empty where they have none."""
    for name in UNITS:
        value = one.attrs.get(name)
        if value is not None and np.size(value) == 1:
            return SINCE.sub("", _plain_text(np.asarray(value).reshape(-1)[0]))
    return ""


def _unit_of_part(one: h5py.Dataset, name: str, place: int, count: int) -> str:
    """The unit of one of the fields or columns of a data set: of its own attribute, or of a list of units."""
    for attribute in (f"{name}_units", f"{name}_unit", f"FIELD_{place}_UNITS", f"FIELD_{place}_UNIT"):
        if name and np.size(value := one.attrs.get(attribute, ())) == 1:
            return _plain_text(np.asarray(value).reshape(-1)[0])
    for attribute in UNITS:
        listed = _texts(one.attrs.get(attribute), count)
        if listed:
            return listed[place]
    return unit_of(one)


def _stated_step(held: h5py.File, one: h5py.Dataset) -> tuple[float, str] | None:
    """The sample period (s) in the attributes of a data set or of the groups it is in, and the attribute; else None."""
    path = one.name
    while path:
        holder = held[path]
        for attribute, value in holder.attrs.items():
            bare = re.sub(r"[^a-z]", "", attribute.casefold())
            if (bare not in RATES and bare not in STEPS) or np.size(value) != 1:
                continue
            try:
                number = float(_plain_text(np.asarray(value).reshape(-1)[0]))
            except ValueError:
                continue
            if number > 0.0 and np.isfinite(number):
                step_s = 1.0 / number if bare in RATES else number
                return step_s, f"{attribute!r} = {number:g} ({'Hz' if bare in RATES else 's'})"
        path = "" if path == "/" else path.rpartition("/")[0] or "/"
    return None


def _unapplied(one: h5py.Dataset) -> str:
    if one.dtype.kind not in "iu":
        return ""
    return unapplied_factor({
        name: np.asarray(value).reshape(-1)[0] for name, value in one.attrs.items()
        if name not in CONVENTION and np.size(value) == 1
    })

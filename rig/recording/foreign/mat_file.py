"""MATLAB files, version 5 and 7.3: vectors, columns of matrices, fields of structs."""

from __future__ import annotations

import struct
import warnings
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from rig.errors import FileProblem
from rig.recording.foreign.foreign_file import ForeignColumn, check_size, stream, unreadable
from rig.signals.arrays import FloatArray

FEWEST_ROWS = 2
MOST_COLUMNS = 4096
DEEPEST = 6
COMPRESSED = 15
"""Data type of a compressed element in a file of version 5."""


class MatFile:
    """A MATLAB file; see `rig.recording.foreign.foreign_file.ForeignFile`.

    A vector is a column of its variable's name, a struct's field `s.f`, the third column of a matrix `M(3)`.
    """

    def __init__(self, file: Path, data: bytes) -> None:
        """Read all numbers.

        Raises:
            FileProblem: it is damaged, or claims to hold too much.
        """
        self._file = file
        hdf5 = data[:4] != b"MATL" or b"MATLAB 7.3" in data[:20] or data[512:516] == b"\x89HDF"
        self.read_as = "MATLAB 7.3" if hdf5 else "MATLAB 5"
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of scipy, on what it leaves out
                held = _hdf5(file, data) if hdf5 else _version_5(file, data)
                self._held = dict(columns_in(held))
        except FileProblem:
            raise
        except Exception as error:
            raise FileProblem(str(file), unreadable(self.read_as, error)) from error
        self.first_line = 0
        self.columns: Sequence[ForeignColumn] = [ForeignColumn(name) for name in self._held]

    def is_stamps(self, place: int) -> bool:
        """See `ForeignFile.is_stamps`; dates are numbers in such files."""
        del place
        return False

    def own_time(self, places: Sequence[int]) -> None:
        """See `ForeignFile.own_time`; none."""

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `ForeignFile.values`."""
        names = [self.columns[place].name for place in places]
        series = [np.asarray(self._held[name], np.float64) for name in names]
        check_alike(self._file, names, [len(values) for values in series])
        return series


def check_alike(file: Path, names: Sequence[str], rows: Sequence[int]) -> None:
    """Refuse columns of different lengths.

    Raises:
        FileProblem: they are.
    """
    if len(set(rows)) > 1:
        told = ", ".join(f"{name} {count}" for name, count in zip(names, rows, strict=True))
        raise FileProblem(str(file), [f"its columns have different numbers of rows: {told}; one time base is needed"])


def _version_5(file: Path, data: bytes) -> Mapping[str, Any]:
    from scipy.io import loadmat

    if data[124:126] in (b"\x00\x01", b"\x01\x00") and len(data) >= 128:
        check_size(file, _inflated_bytes(data) // 8)
    loaded = loadmat(stream(data), simplify_cells=True)  # type: ignore[arg-type]  # stub: paths only
    return {name: value for name, value in loaded.items() if not name.startswith("__")}


def _inflated_bytes(data: bytes) -> int:
    """Bytes of a version 5 file's elements once they are decompressed; counted without keeping them."""
    order = "<" if data[126:128] == b"IM" else ">"
    place, total = 128, 0
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind == COMPRESSED:
            inflate, rest = zlib.decompressobj(), data[place + 8 : place + 8 + size]
            while rest and total < 1 << 33:
                part = inflate.decompress(rest, 1 << 20)
                rest = inflate.unconsumed_tail
                total += len(part)
        else:
            total += size
        place += 8 + size
    return total


def _hdf5(file: Path, data: bytes) -> Mapping[str, Any]:
    with h5py.File(stream(data), "r") as held:
        numbers = _numbers_below(held, 0)
        check_size(file, numbers)
        return _group(held, 0)


def _numbers_below(group: h5py.Group, depth: int) -> int:
    total = 0
    for name in group:
        one = group[name] if group.get(name, getlink=True).__class__ is h5py.HardLink else None
        if isinstance(one, h5py.Dataset):
            total += int(one.size or 0)
        elif isinstance(one, h5py.Group) and depth < DEEPEST:
            total += _numbers_below(one, depth + 1)
    return total


def _group(group: h5py.Group, depth: int) -> dict[str, Any]:
    """Numbers of a group by name, as MATLAB has them (HDF5 holds them transposed); links are not followed."""
    held: dict[str, Any] = {}
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        one = group[name]
        if isinstance(one, h5py.Group):
            if depth < DEEPEST:
                held[name] = _group(one, depth + 1)
        elif one.dtype.kind in "fiu" and "MATLAB_empty" not in one.attrs and one.ndim <= 2:
            held[name] = np.asarray(one[()]).T
    return held


def columns_in(held: Mapping[str, Any], prefix: str = "", depth: int = 0) -> Iterator[tuple[str, FloatArray]]:
    """Every vector, matrix column and field by its name; what is no series of real numbers is left out."""
    for name, value in held.items():
        if isinstance(value, Mapping) and depth < DEEPEST:
            yield from columns_in(value, f"{prefix}{name}.", depth + 1)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.size >= FEWEST_ROWS:
            if value.ndim == 1 or (value.ndim == 2 and 1 in value.shape):
                yield f"{prefix}{name}", value.reshape(-1)
            elif value.ndim == 2 and value.shape[1] <= MOST_COLUMNS:
                yield from ((f"{prefix}{name}({k + 1})", value[:, k]) for k in range(value.shape[1]))

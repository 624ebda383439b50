"""MATLAB files, version 5 and 7.3: vectors, columns of matrices, fields of structs.

Elements of version 5 are counted before they are read: how much they hold, and how deep they may nest. Source:
MathWorks, MAT-File Format, "Level 5 MAT-File Format": data element tags, array flags, compressed elements.
"""

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
from rig.recording.foreign.foreign_file import MOST_NUMBERS, ForeignColumn, NoLines, check_size, stream, unreadable
from rig.signals.arrays import FloatArray

FEWEST_ROWS = 2
MOST_COLUMNS = 4096
DEEPEST = 6
SIGNATURE = b"\x89HDF"
"""Of HDF5, which version 7.3 is."""
HEAD_BYTES = 128
ARRAY, COMPRESSED = 14, 15
HOLDERS = frozenset((1, 2, 3, 16, 17))
"""Classes of arrays that hold others: cell, struct, object, function, opaque."""
MOST_HOLDERS = 1000
"""More could be nested deeper than the stack of the reader is."""
MOST_ELEMENTS = 100_000


class MatFile(NoLines):
    """A MATLAB file; see `rig.recording.foreign.foreign_file.ForeignFile`.

    A vector is a column of its variable's name, a struct's field `s.f`, the third column of a matrix `M(3)`.
    """

    def __init__(self, file: Path, data: bytes) -> None:
        """Read all numbers.

        Raises:
            FileProblem: it is damaged, or claims to hold too much.
        """
        self._file = file
        hdf5 = data[:4] != b"MATL" or b"MATLAB 7.3" in data[:20] or data[512:516] == SIGNATURE
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
        self.columns: Sequence[ForeignColumn] = [ForeignColumn(name) for name in self._held]

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
        _check_elements(file, data)
    loaded = loadmat(stream(data), simplify_cells=True)  # type: ignore[arg-type]  # stub: paths only
    return {name: value for name, value in loaded.items() if not name.startswith("__")}


def _check_elements(file: Path, data: bytes) -> None:
    """Refuse what claims to hold more than can be read.

    Raises:
        FileProblem: more numbers than 1 GiB, more than 1000 cells, structs and objects, or 100000 elements.
    """
    order = "<" if data[126:128] == b"IM" else ">"
    numbers = holders = elements = 0
    for part in _plain(data, order):
        numbers += len(part) // 8
        check_size(file, numbers)
        for holds in _elements(part, order):
            elements, holders = elements + 1, holders + holds
            if holders > MOST_HOLDERS or elements > MOST_ELEMENTS:
                raise FileProblem(str(file), [
                    f"holds more than {MOST_HOLDERS} cells, structs or objects, or {MOST_ELEMENTS} elements: save the "
                    "columns alone"
                ])  # fmt: skip


def _plain(data: bytes, order: str) -> Iterator[bytes]:
    """The file's elements, those that are compressed inflated as far as they may go, the others together."""
    place = first = HEAD_BYTES
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind == COMPRESSED:
            yield data[first:place]
            yield zlib.decompressobj().decompress(data[place + 8 : place + 8 + size], 8 * MOST_NUMBERS + 8)
            first = place + 8 + size
        place += 8 + size
    yield data[first:]


def _elements(data: bytes, order: str) -> Iterator[bool]:
    """For each element, in the order in which a reader comes to them, whether it is an array that holds others.

    Sizes of arrays are not believed.
    """
    place = 0
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind == ARRAY:
            flags = struct.unpack_from(f"{order}I", data, place + 16)[0] if place + 20 <= len(data) else 0
            place += 8
            yield flags & 0xFF in HOLDERS
        else:
            place += 8 if kind >> 16 else 8 + size + -size % 8
            yield False


def _hdf5(file: Path, data: bytes) -> Mapping[str, Any]:
    if all(data[place : place + 4] != SIGNATURE for place in (0, 512, 1024, 2048)):
        raise FileProblem(str(file), ["is no MATLAB file of version 5 or 7.3: save it with -v7 or -v7.3"])
    with h5py.File(stream(data), "r") as held:
        arrays = dict(_datasets(held, "", set(), 0))
        check_size(file, sum(int(one.size or 0) for one in arrays.values()))
        return {name: np.asarray(one[()]).T for name, one in arrays.items()}


def _datasets(group: h5py.Group, prefix: str, seen: set[int], depth: int) -> Iterator[tuple[str, h5py.Dataset]]:
    """Arrays of numbers below a group, by name; every group once, and no link to anywhere else is followed.

    MATLAB's are transposed in HDF5.
    """
    for name in group:
        if name.startswith("#") or not isinstance(group.get(name, getlink=True), h5py.HardLink):
            continue
        one = group[name]
        if isinstance(one, h5py.Group):
            address = h5py.h5o.get_info(one.id).addr
            if depth < DEEPEST and address not in seen:
                seen.add(address)
                yield from _datasets(one, f"{prefix}{name}.", seen, depth + 1)
        elif (
            isinstance(one, h5py.Dataset) and one.dtype.kind in "fiu" and "MATLAB_empty" not in one.attrs
            and one.ndim <= 2 and not one.external and not one.is_virtual
        ):  # fmt: skip
            yield f"{prefix}{name}", one


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

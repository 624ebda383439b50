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
from rig.extras import how_to_install
from rig.recording.file_formats.hdf5_file import SIGNATURE, datasets, is_hdf5
from rig.recording.file_formats.mat_tables import tables
from rig.recording.file_formats.table_file import (
    DEEPEST,
    FEWEST_ROWS,
    MOST_COLUMNS,
    NoLines,
    TableColumn,
    check_equal_lengths,
    check_size,
    stream,
    unreadable,
)
from rig.signals.arrays import FloatArray

SMALL_BYTES, LARGEST_RATIO = 64_000_000, 100
"""Sizes up to the first are unpacked from however few bytes; recordings compress to a tenth, zeros to a thousandth."""
HEAD_BYTES = 128
WORKSPACE = "__function_workspace__"
"""What scipy calls the part of a file that holds MATLAB's objects."""
ARRAY, COMPRESSED = 14, 15
NUMBERS, TEXTS = frozenset((1, 2, 3, 4, 5, 6, 7, 9, 12, 13)), frozenset((16, 17, 18))
"""Data types; scipy looks the numbers of an array up in a table that has no other ones, which ends the process."""
CELL, STRUCT, OBJECT, CHARACTERS, SPARSE, FUNCTION, OPAQUE = 1, 2, 3, 4, 5, 16, 17
COMPLEX = 0x800
BEFORE_ARRAYS = {CELL: 0, STRUCT: 2, OBJECT: 3, FUNCTION: 0, OPAQUE: 2}
"""Elements of each class that holds arrays between its name and these: names of fields, of a class."""
DEEPEST_ARRAYS = 200
HOLDERS = frozenset((1, 2, 3, 16, 17))
"""Classes of arrays that hold others: cell, struct, object, function, opaque."""
MOST_HOLDERS = 1000
"""More could be nested deeper than the stack of the reader is."""
MOST_ELEMENTS = 100_000


class MatFile(NoLines):
    """A MATLAB file; see `rig.recording.file_formats.table_file.TableFile`.

    A vector is a column of its variable's name, a struct's field `s.f`, the third column of a matrix `M(3)`.
    """

    def __init__(self, file: Path, data: bytes) -> None:
        """Read all numbers.

        Raises:
            FileProblem: it is damaged, or claims to hold too much.
        """
        self._file = file
        hdf5 = data[:4] != b"MATL" or b"MATLAB 7.3" in data[:20] or data[512:520] == SIGNATURE
        self.read_as = "MATLAB 7.3" if hdf5 else "MATLAB 5"
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # of scipy, on what it leaves out
                held = _hdf5(file, data) if hdf5 else _version_5(file, data)
                opaque = _opaque_in_hdf5(file, data) if hdf5 else _opaque(file, held)
                units = self._add_tables(held) if opaque else {}
                self._held = dict(columns_in(held))
        except FileProblem:
            raise
        except Exception as error:
            raise FileProblem(str(file), unreadable(self.read_as, error)) from error
        if not self._held:
            nothing = f"{self.read_as}: the file contains no vector or matrix of real numbers"
            raise FileProblem(str(file), [opaque or nothing])
        self.columns: Sequence[TableColumn] = [TableColumn(name, units.get(name, "")) for name in self._held]

    def _add_tables(self, held: dict[str, Any]) -> dict[str, str]:
        """Add the columns of tables and timetables to what the file holds; their units by the columns' names."""
        units: dict[str, str] = {}
        try:
            for name, columns, stated in tables(self._file):
                held[name] = columns
                units |= {f"{name}.{column}": unit for column, unit in stated.items()}
        except ImportError:
            return {}
        except Exception:
            if not any(True for _ in columns_in(held)):
                raise
            self.read_as += ", one table in the file cannot be read"
        return units

    def own_time(self, places: Sequence[int]) -> None:
        """See `TableFile.own_time`; none."""

    def values(self, places: Sequence[int]) -> list[FloatArray]:
        """See `TableFile.values`."""
        names = [self.columns[place].name for place in places]
        series = [np.asarray(self._held[name], np.float64) for name in names]
        check_equal_lengths(self._file, names, [len(values) for values in series])
        return series


def _version_5(file: Path, data: bytes) -> dict[str, Any]:
    from scipy.io import loadmat

    if len(data) >= HEAD_BYTES:
        _check_elements(file, data)
    loaded = loadmat(stream(data), simplify_cells=True)  # type: ignore[arg-type]  # stub: paths only
    return {name: value for name, value in loaded.items() if not name.startswith("__") or name == WORKSPACE}


def _check_elements(file: Path, data: bytes) -> None:
    """Refuse what claims to hold more than can be read.

    Raises:
        FileProblem: more numbers than 1 GiB, more than 1000 cells, structs and objects, or 100000 elements.
    """
    order = "<" if data[126:128] == b"IM" else ">"
    unpacked = sum(_declared_bytes(packed, order) for packed in _compressed(data, order))
    check_size(file, unpacked // 8)
    if unpacked > max(SMALL_BYTES, LARGEST_RATIO * len(data)):
        raise FileProblem(str(file), [
            f"expands from {len(data) / 1e6:.3g} MB to {unpacked / 1e6:.4g} MB when unpacked, by a factor of more than "
            f"{LARGEST_RATIO}. Fix: save only the columns of the test"
        ])
    holders = elements = 0
    for part in _plain(data, order):
        for holds in _elements(part, order):
            elements, holders = elements + 1, holders + holds
            if holders > MOST_HOLDERS or elements > MOST_ELEMENTS:
                raise FileProblem(str(file), [
                    f"contains more than {MOST_HOLDERS} cells, structs or objects, or {MOST_ELEMENTS} elements. Fix: "
                    "save only the columns of the test"
                ])  # fmt: skip
        place = 0
        while place + 8 <= len(part):
            place = _check_array(part, order, place, len(part))


def _compressed(data: bytes, order: str) -> Iterator[bytes]:
    """The file's compressed elements, as they are."""
    place = HEAD_BYTES
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind == COMPRESSED:
            yield data[place + 8 : place + 8 + size]
        place += 8 + size


def _declared_bytes(packed: bytes, order: str) -> int:
    """Size of a compressed element by its own tag, its first 8 bytes; no reader unpacks more of it."""
    tag = zlib.decompressobj().decompress(packed, 8)
    return int(struct.unpack(f"{order}II", tag)[1]) if len(tag) == 8 else 0


def _plain(data: bytes, order: str) -> Iterator[bytes]:
    """The file's elements, those that are compressed inflated as far as they may go, the others together."""
    place = first = HEAD_BYTES
    while place + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind == COMPRESSED:
            yield data[first:place]
            packed = data[place + 8 : place + 8 + size]
            yield zlib.decompressobj().decompress(packed, _declared_bytes(packed, order) + 8)
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


def _check_array(data: bytes, order: str, place: int, end: int, depth: int = 0) -> int:
    """Check that an array has the elements of its class, those of numbers with a type of numbers; its end.

    Raises:
        ValueError: it has not, or they are not within it.
    """
    kind, start, stop, after = _element(data, order, place, end)
    if kind != ARRAY or depth > DEEPEST_ARRAYS:
        raise ValueError(f"no array at byte {place}, or arrays nested too deeply")
    if start == stop:
        return after
    if start + 16 > stop:
        raise ValueError(f"the array at byte {place} is too short")
    flags = struct.unpack_from(f"{order}I", data, start + 8)[0]
    of_class, place = flags & 0xFF, start + 16
    for _ in range((1 if of_class == OPAQUE else 2) + BEFORE_ARRAYS.get(of_class, 0)):
        place = _element(data, order, place, stop)[3]
    if of_class in BEFORE_ARRAYS:
        while place + 8 <= stop:
            place = _check_array(data, order, place, stop, depth + 1)
    else:
        for _ in range((3 if of_class == SPARSE else 1) + bool(flags & COMPLEX)):
            kind, _start, _stop, place = _element(data, order, place, stop)
            if kind not in NUMBERS and not (of_class == CHARACTERS and kind in TEXTS):
                raise ValueError(f"unknown number type {kind} before byte {place}")
    if depth and place != stop:
        raise ValueError(f"{stop - place} extra bytes in the array before byte {stop}")
    return after


def _element(data: bytes, order: str, place: int, end: int) -> tuple[int, int, int, int]:
    """Type of an element, where its content begins and ends, and where the next element begins.

    Raises:
        ValueError: it goes on beyond the end of what holds it.
    """
    if place + 8 <= end:
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind >> 16:
            return kind & 0xFFFF, place + 4, place + 4 + (kind >> 16), place + 8
        stop = place + 8 + size
        if stop <= end:
            return kind, place + 8, stop, stop if kind == ARRAY else min(stop + -size % 8, end)
    raise ValueError(f"the element at byte {place} extends beyond the end of its array")


def _hdf5(file: Path, data: bytes) -> dict[str, Any]:
    if not is_hdf5(data):
        raise FileProblem(str(file), ["is not a MATLAB file of version 5 or 7.3. Fix: save the file with -v7 or -v7.3"])
    with h5py.File(stream(data), "r") as held:
        arrays = dict(_arrays(held))
        check_size(file, sum(int(one.size or 0) for one in arrays.values()))
        return {name: np.asarray(one[()]).T for name, one in arrays.items()}


def _arrays(held: h5py.File) -> Iterator[tuple[str, h5py.Dataset]]:
    """Arrays of numbers by MATLAB's names, which are transposed in HDF5; elements of struct and cell arrays too."""
    for name, one in datasets(held, "."):
        if "MATLAB_empty" in one.attrs:
            continue
        if one.dtype.kind in "fiu":
            yield name, one
        elif h5py.check_ref_dtype(one.dtype) == h5py.Reference and int(one.size or 0) <= MOST_HOLDERS:
            struct, _, field = name.rpartition(".")
            cells = one.attrs.get("MATLAB_class", b"") == b"cell" or not struct
            for k, reference in enumerate(np.asarray(one[()]).reshape(-1)):
                target = held[reference] if reference else None
                if isinstance(target, h5py.Dataset) and target.dtype.kind in "fiu" and not target.external:
                    yield f"{name}{{{k + 1}}}" if cells else f"{struct}({k + 1}).{field}", target


def _opaque(file: Path, held: dict[str, Any]) -> str:
    """The first table or object of a version 5 file, with the way out; empty where it has none.

    Raises:
        FileProblem: what the file holds of its objects is too much, or nested too deeply.
    """
    stored = held.pop(WORKSPACE, None)
    for value in held.values():
        if getattr(getattr(value, "dtype", None), "names", None) == ("s0", "s1", "s2", "arr"):
            if isinstance(stored, np.ndarray):
                content = stored.tobytes()
                _check_elements(file, b"\0" * (HEAD_BYTES - 4) + content[:4] + content[8:])
            name, kind = (value[key].reshape(-1)[0].decode("latin-1") for key in ("s0", "s2"))
            return _way_out(name or "T", kind)
    return ""


def _opaque_in_hdf5(file: Path, data: bytes) -> str:
    """The same of a version 7.3 file.

    Raises:
        FileProblem: it holds too much.
    """
    sizes: list[int] = []
    first = ""
    with h5py.File(stream(data), "r") as held:
        for name in held:
            if name.startswith("#") or not isinstance(held.get(name, getlink=True), h5py.HardLink):
                continue
            kind = held[name].attrs.get("MATLAB_class", b"")
            kind = kind.decode("latin-1") if isinstance(kind, bytes) else str(kind)
            if "MATLAB_object_decode" in held[name].attrs and kind and not first:
                first = _way_out(name, kind)
        if first:
            held.visititems(lambda _name, one: sizes.append(int(getattr(one, "size", 0) or 0)))
            check_size(file, sum(sizes))
    return first


def _way_out(name: str, kind: str) -> str:
    name = name if name.isidentifier() else "T"
    table = f"timetable2table({name})" if kind == "timetable" else name
    if kind not in {"table", "timetable"}:
        return f"variable {name!r} is a MATLAB object of class {kind!r}. Fix: save its numbers as vectors"
    return (
        f"variable {name!r} is a MATLAB {kind}, which requires mat-io: {how_to_install('files')}. Or, in MATLAB: "
        f"s = table2struct({table}, "
        f"'ToScalar', true); save('a.mat', '-struct', 's'), or writetable({table}, 'a.csv')"
    )


def columns_in(held: Mapping[str, Any], prefix: str = "", depth: int = 0) -> Iterator[tuple[str, FloatArray]]:
    """Every vector, matrix column and field by its name; what is no series of real numbers is left out."""
    for name, value in held.items():
        if depth > DEEPEST:
            return
        if isinstance(value, Mapping):
            yield from columns_in(value, f"{prefix}{name}.", depth + 1)
        elif isinstance(value, list) or (isinstance(value, np.ndarray) and value.dtype.kind == "O"):
            elements = list(value) if isinstance(value, list) else list(value.reshape(-1))
            structs = any(isinstance(one, Mapping) for one in elements)
            left, right = "()" if structs else "{}"
            numbered = {f"{name}{left}{k + 1}{right}": one for k, one in enumerate(elements[:MOST_HOLDERS])}
            yield from columns_in(numbered, prefix, depth + 1)
        elif isinstance(value, np.ndarray) and value.dtype.kind in "fiu" and value.size >= FEWEST_ROWS:
            if value.ndim == 1 or (value.ndim == 2 and 1 in value.shape):
                yield f"{prefix}{name}", value.reshape(-1)
            elif value.ndim == 2 and value.shape[1] <= MOST_COLUMNS:
                yield from ((f"{prefix}{name}({k + 1})", value[:, k]) for k in range(value.shape[1]))

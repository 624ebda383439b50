"""Attributes and datasets by h5py's low-level interface, whose calls are HDF5's own.

A short point's file has 500 attributes and 70 datasets. h5py's high-level interface opens a new handle for each access,
and takes three times as long to write a file and to read it back.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import h5py

    from rig.recording.layout import Attribute

@dataclass(frozen=True)
class StoredValues:
    """A dataset as it was to be written: number and type of its values, and their CRC-32 before HDF5 had them."""

    length: int
    kind: np.dtype[Any]
    check: int


Checks = Mapping[str, StoredValues]
"""By the dataset's place in the file, such as `entry/data/force`."""
LONGEST_TEXT_BYTES = 32_000
"""HDF5 has 64 kB for an attribute, its name and type included."""


def set_attributes(place: h5py.h5g.GroupID | h5py.h5d.DatasetID, attributes: Mapping[str, Attribute]) -> None:
    """Plain attributes: numbers, fixed-length UTF-8 text, one-dimensional arrays of text; None is left out.

    A text too long for an attribute is cut, which is said at its end; a whole number beyond 64 bits becomes text.

    Args:
        place: the object's handle, `id` of an `h5py.Group` or `h5py.Dataset`.
        attributes: by name; one that is there already is replaced.
    """
    for name, value in attributes.items():
        if value is None:
            continue
        if isinstance(value, bool):
            set_number(place, name, np.int8(value))
        elif isinstance(value, float):
            set_number(place, name, np.float64(value))
        elif isinstance(value, int) and -(1 << 63) <= value < 1 << 63:
            set_number(place, name, np.int64(value))
        elif isinstance(value, (str, int)):
            text = encoded(_cut(str(value), LONGEST_TEXT_BYTES))
            _set(place, name, np.array(text), _text_type(len(text)))
        elif value:
            texts = [encoded(_cut(text, LONGEST_TEXT_BYTES)) for text in value]
            _set(place, name, np.array(texts), _text_type(max(map(len, texts))))


def set_number(place: h5py.h5g.GroupID | h5py.h5d.DatasetID, name: str, value: np.number[Any]) -> None:
    """One number as an attribute of its own type."""
    array = np.asarray(value)
    _set(place, name, array, number_type(array.dtype))


def _set(place: Any, name: str, array: NDArray[Any], kind: h5py.h5t.TypeID) -> None:  # noqa: ANN401 - h5py has no types
    import h5py

    key = name.encode()
    if h5py.h5a.exists(place, key):
        h5py.h5a.delete(place, key)
    h5py.h5a.create(place, key, kind, _space(array.shape)).write(array, mtype=kind)


@cache
def number_type(kind: np.dtype[Any]) -> h5py.h5t.TypeID:
    """HDF5's type for numbers like these."""
    import h5py

    return h5py.h5t.py_create(kind, logical=True)


@cache
def _text_type(length: int) -> h5py.h5t.TypeID:
    """Fixed-length UTF-8 text of so many bytes."""
    import h5py

    return h5py.h5t.py_create(h5py.string_dtype("utf-8", length), logical=True)


@cache
def _space(shape: tuple[int, ...]) -> h5py.h5s.SpaceID:
    import h5py

    return h5py.h5s.create_simple(shape)


@cache
def _own_types() -> Mapping[int, tuple[h5py.h5t.TypeID, ...]]:
    """The number types of recordings, by their bytes."""
    kinds: dict[int, tuple[h5py.h5t.TypeID, ...]] = {}
    for name in ("i1", "u4", "f4", "i8", "f8"):
        kind = np.dtype(f"<{name}")
        kinds[kind.itemsize] = (*kinds.get(kind.itemsize, ()), number_type(kind))
    return kinds


def own_dtype(kind: h5py.h5t.TypeID) -> np.dtype[Any] | None:
    """What numpy has for a type that recordings are made of: numbers, text of fixed length; None for any other type."""
    import h5py

    size = kind.get_size()
    if kind.get_class() == h5py.h5t.STRING:
        return None if kind.is_variable_str() else np.dtype(f"S{size}")
    known = next((own for own in _own_types().get(size, ()) if own == kind), None)
    return None if known is None else known.dtype


def attribute_names(place: h5py.h5g.GroupID | h5py.h5d.DatasetID) -> list[bytes]:
    """Names of an object's attributes; HDF5 opens one by its name in half the time that it takes by its number."""
    import h5py

    names: list[bytes] = []
    h5py.h5a.iterate(place, names.append)
    return names


def attributes_of(place: h5py.Group | h5py.Dataset) -> Iterator[tuple[str, Any]]:
    """Names and values of an object's attributes, as `attrs.items()` gives them."""
    import h5py

    for key in attribute_names(place.id):
        item = h5py.h5a.open(place.id, key)
        name, space = key.decode("utf-8", "surrogateescape"), item.get_space()
        stored = item.get_type()
        kind = own_dtype(stored)
        if kind is None or space.get_simple_extent_type() == h5py.h5s.NULL:
            yield name, place.attrs[name]
            continue
        values = np.zeros(space.shape, kind)
        item.read(values, mtype=stored)
        yield name, values if values.ndim else values[()]


def write_values(dataset: h5py.h5d.DatasetID, start: int, values: NDArray[Any]) -> None:
    """Write values (n,) into a dataset from row `start` on."""
    import h5py

    rows = dataset.get_space()
    rows.select_hyperslab((start,), values.shape)
    dataset.write(h5py.h5s.create_simple(values.shape), rows, values)


def rows_of(dataset: h5py.h5d.DatasetID, rows: slice) -> NDArray[Any]:
    """Some rows of a dataset (m,), without a step.

    Raises:
        OSError: they cannot be read.
    """
    import h5py

    values = np.empty(rows.stop - rows.start, dataset.dtype)
    if values.size:
        stored = dataset.get_space()
        stored.select_hyperslab((rows.start,), values.shape)
        dataset.read(h5py.h5s.create_simple(values.shape), stored, values)
    return values


def encoded(text: str) -> bytes:
    """UTF-8; what cannot be (half a surrogate pair, a zero byte) becomes a question mark, an empty text one blank."""
    return text.encode("utf-8", "replace").replace(b"\0", b"?") or b" "


def _cut(text: str, most_bytes: int) -> str:
    whole = encoded(text)
    if len(whole) <= most_bytes:
        return text
    return f"{whole[:most_bytes].decode(errors='ignore')} [cut: {len(whole)} bytes]"


def texts_of(values: Sequence[str]) -> NDArray[np.bytes_]:
    """Text as a dataset (n,): Octave reads only what is declared ASCII; UTF-8 beyond it stays as its bytes."""
    whole = [encoded(value) for value in values] or [b" "]
    return np.array(whole, f"S{max(map(len, whole))}")[: len(values)]

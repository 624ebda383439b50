"""Check of HDF5 files from outside: anything that a recording never contains is refused before a value is read.

Refused: external and soft links, external storage, virtual datasets, filters other than this program's or applied
twice, chunks, elements, attributes and declared sizes beyond what a point can have or what the file can contain,
nesting deeper than the layout, more objects, links or attributes than the layout, references, other types.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.errors import FileProblem
from rig.recording.hdf5.hdf5_objects import attribute_names, own_dtype

if TYPE_CHECKING:
    import h5py

LARGEST_SAMPLES = 100_000_000
LARGEST_OBJECTS = 2_000
LARGEST_RATIO = 1_200.0
"""Of declared bytes to the file's; deflate reaches 1,032."""
SMALL_BYTES = 1 << 20
LARGEST_CHUNK_BYTES = 1 << 23
"""Memory that one value costs: HDF5 inflates a chunk whole. The recorder's chunks have 131 kB."""
MOST_CHUNKS = 100_000
LARGEST_NUMBER_BYTES, LARGEST_TEXT_BYTES = 8, 1 << 16
MOST_ATTRIBUTES = 2_000
LARGEST_ATTRIBUTE_BYTES = 1 << 22
DEEPEST = 6
MOST_REMEMBERED = 10_000
ALLOWED_FILTERS = {1: "deflate", 2: "shuffle", 3: "fletcher32"}
ALLOWED_KINDS = "iufS"
DAMAGE = (OSError, RuntimeError, KeyError, ValueError, TypeError)
"""What h5py raises for a file that holds something else than its structure says."""
SCALE_ATTRIBUTES = frozenset({"DIMENSION_LIST", "REFERENCE_LIST"})
"""Of dimension scales: references, which nothing here reads."""

HDF5_SUFFIXES = frozenset({".h5", ".hdf5", ".tmp"})

_checked: set[tuple[int, int, int, int]] = set()
"""Files already walked: device, inode, size and time of change."""


def check_file(path: Path, groups: Iterable[str] | None = None, tree: str = "") -> h5py.File:
    """Open a point's file for reading after walking all of it, once for as long as it does not change.

    Args:
        path: the file.
        groups: check only that these are groups of the file itself; for a reader of nothing but their attributes.
        tree: with `groups`, one of them of which everything is checked.

    Returns:
        The open `h5py.File`; the caller closes it.

    Raises:
        FileProblem: it cannot be opened as HDF5, or one line for each thing refused in it.
    """
    import h5py

    if not path.is_file():
        there = path.exists()
        raise FileProblem(str(path), ["is a folder, a pipe or a device; expected a file" if there else "no such file"])
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        other = f"; for a file from another program, use rig import {path.name}"
        way_out = "" if path.suffix in HDF5_SUFFIXES else other
        raise FileProblem(str(path), [f"cannot be read as HDF5: {error}{way_out}"]) from error
    status = path.stat()
    identity = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)
    if identity in _checked:
        return file
    if groups is not None:
        _check_groups(file, path, groups)
        if not tree:
            return file
    walk = _Walk(status.st_size)
    try:
        walk.group(file[tree or "/"].id, tree and f"/{tree}")
    except DAMAGE as error:
        walk.problems.append(f"damaged: {error}")
    problems = walk.problems + walk.bomb()
    if problems:
        file.close()
        raise FileProblem(str(path), problems)
    if not tree:
        if len(_checked) >= MOST_REMEMBERED:
            _checked.clear()
        _checked.add(identity)
    return file


def _check_groups(file: h5py.File, path: Path, groups: Iterable[str]) -> None:
    """Close the file and refuse it when one of the groups is a link elsewhere, none, or has attributes beyond measure.

    Raises:
        FileProblem: one line for each of them.
    """
    import h5py

    problems = []
    try:
        problems += _attribute_problems(file["/"].id)
        for name in groups:
            parts = name.split("/")
            for depth in range(1, len(parts) + 1):
                place = "/".join(parts[:depth])
                link = file.get(place, getlink=True)
                if not isinstance(link, h5py.HardLink) or not isinstance(file[place], h5py.Group):
                    problems.append(f"/{place}: missing, or not a group within the file")
                    break
            else:
                problems += [f"/{name}: {text}" for text in _attribute_problems(file[name].id)]
    except DAMAGE as error:
        problems.append(f"damaged: {error}")
    if problems:
        file.close()
        raise FileProblem(str(path), problems)


class _Walk:
    """All objects of a file, looked at without reading a value."""

    def __init__(self, file_bytes: int) -> None:
        self.problems: list[str] = []
        self._file_bytes = file_bytes
        self._seen = self._declared = 0
        self._walked: set[int] = set()

    def group(self, group: h5py.h5g.GroupID, place: str) -> None:
        import h5py

        self.problems += [f"{place or '/'}: {text}" for text in _attribute_problems(group)]
        if place.count("/") >= DEEPEST:
            self.problems.append(f"{place}: nested deeper than {DEEPEST} groups")
            return
        self._seen += group.get_num_objs()  # before any name is read: there may be millions
        if self._seen > LARGEST_OBJECTS:
            self.problems.append(f"{place}: more than {LARGEST_OBJECTS} objects")
            return
        for key in group:
            name = key.decode("utf-8", "surrogateescape")
            where, info = f"{place}/{_printable(name)}", group.links.get_info(key)
            if info.type != h5py.h5l.TYPE_HARD:
                kind = type(h5py.Group(group).get(name, getlink=True)).__name__
                self.problems.append(f"{where}: links of type {kind} are not allowed; a file must contain its data")
                continue
            if info.u in self._walked:
                continue  # stamps that channels share are one dataset with many names
            item = h5py.h5o.open(group, key)
            if isinstance(item, h5py.h5d.DatasetID):
                self._walked.add(info.u)
                self._dataset(item, where)
            elif isinstance(item, h5py.h5g.GroupID):
                self.group(item, where)
            else:
                self.problems.append(f"{where}: neither a group nor a dataset")

    def bomb(self) -> list[str]:
        """One line when all datasets together declare more than the file can hold compressed."""
        if self._declared <= max(64 * SMALL_BYTES, LARGEST_RATIO * self._file_bytes):
            return []
        return [
            f"declares {self._declared} bytes in a file of {self._file_bytes} bytes; rejected as a decompression bomb"
        ]

    def _dataset(self, item: h5py.h5d.DatasetID, where: str) -> None:
        shape, kind, storage = item.shape, item.dtype, item.get_create_plist()
        texts = _attribute_problems(item) + _storage_problems(storage, kind, len(shape))
        chunks = _chunks(storage)
        size = math.prod(shape)
        declared = size * kind.itemsize
        self._declared += declared
        held = LARGEST_RATIO * self._file_bytes if chunks else self._file_bytes
        if chunks:
            texts += _chunk_problems(size, math.prod(chunks), kind.itemsize)
        if size > LARGEST_SAMPLES:
            texts.append(f"declares {size} values; at most {LARGEST_SAMPLES} are allowed")
        elif declared > SMALL_BYTES and declared > held:
            texts.append(
                f"declares {declared} bytes in a file of {self._file_bytes} bytes; rejected as a decompression bomb"
            )
        self.problems += [f"{where}: {text}" for text in texts]


def _chunks(storage: h5py.h5p.PropDCID) -> tuple[int, ...]:
    """The chunks' shape; empty where a dataset has none."""
    import h5py

    return tuple(storage.get_chunk()) if storage.get_layout() == h5py.h5d.CHUNKED else ()


def _storage_problems(storage: h5py.h5p.PropDCID, kind: np.dtype[Any], dimensions: int) -> list[str]:
    import h5py

    texts = []
    if storage.get_layout() == h5py.h5d.VIRTUAL:
        texts.append("virtual dataset refused")
    if storage.get_external_count():
        texts.append("external storage refused")
    texts += _type_problems(kind)
    if dimensions > 1:
        texts.append(f"{dimensions} dimensions; expected 1")
    filters = [storage.get_filter(number) for number in range(storage.get_nfilters())]
    codes = [code for code, *_ in filters]
    texts += [f"filter {code} ({text!r}) refused; allowed: {', '.join(ALLOWED_FILTERS.values())}"
              for code, _, _, text in filters if code not in ALLOWED_FILTERS]
    if len(set(codes)) < len(codes):
        texts.append(f"duplicate filter refused: {codes}")
    return texts


def _chunk_problems(size: int, chunk_size: int, value_bytes: int) -> list[str]:
    texts = []
    if chunk_size * value_bytes > LARGEST_CHUNK_BYTES:
        texts.append(f"chunks of {chunk_size * value_bytes} bytes; allowed: at most {LARGEST_CHUNK_BYTES}")
    if size // max(1, chunk_size) > MOST_CHUNKS:
        texts.append(f"{size // max(1, chunk_size)} chunks; at most {MOST_CHUNKS} are allowed")
    return texts


def _type_problems(kind: np.dtype[Any]) -> list[str]:
    if kind.kind not in ALLOWED_KINDS:
        return [f"type {kind} is not allowed; expected numbers or fixed-length text"]
    largest = LARGEST_TEXT_BYTES if kind.kind == "S" else LARGEST_NUMBER_BYTES
    return [f"elements of {kind.itemsize} bytes; allowed: at most {largest}"] if kind.itemsize > largest else []


def _attribute_problems(place: h5py.h5g.GroupID | h5py.h5d.DatasetID) -> list[str]:
    """What is wrong with an object's attributes; none of them is read."""
    import h5py

    count = h5py.h5a.get_num_attrs(place)
    if count > MOST_ATTRIBUTES:
        return [f"{count} attributes; at most {MOST_ATTRIBUTES}"]
    texts = []
    for key in attribute_names(place):
        name = key.decode("utf-8", "replace")
        if name not in SCALE_ATTRIBUTES:
            problems = _problems_of(h5py.h5a.open(place, key))
            texts += [f"attribute {_printable(name)}: {text}" for text in problems]
    return texts


def _problems_of(attribute: h5py.h5a.AttrID) -> list[str]:
    import h5py

    size, shape = attribute.get_storage_size(), attribute.shape
    if size > LARGEST_ATTRIBUTE_BYTES:
        return [f"{size} bytes; at most {LARGEST_ATTRIBUTE_BYTES} are allowed"]
    if len(shape) > 1:
        return [f"{len(shape)} dimensions; expected at most 1"]
    own = own_dtype(attribute.get_type())
    kind = attribute.dtype if own is None else own
    # One text of free length, as h5py writes it, is no longer than the file; many of them may be the same one.
    return _type_problems(kind) if shape or h5py.check_string_dtype(kind) is None else []


def _printable(name: str) -> str:
    """A name from the file as it may stand on a terminal."""
    return name if name.isprintable() and len(name) <= 80 else f"{name[:80]!r}"

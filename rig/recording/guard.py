"""HDF5 from outside is hostile: what a recording never contains is refused before a single value is read.

Refused: external and soft links, external storage, virtual datasets, filters other than our own, declared sizes beyond
what a point can have or beyond what the file can hold compressed, nesting deeper than the layout, object references.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rig.errors import FileProblem

if TYPE_CHECKING:
    import h5py

LARGEST_SAMPLES = 100_000_000
LARGEST_OBJECTS = 2_000
LARGEST_RATIO = 2_000.0
SMALL_BYTES = 1 << 20
DEEPEST = 6
MOST_REMEMBERED = 10_000
ALLOWED_FILTERS = {1: "deflate", 2: "shuffle", 3: "fletcher32"}
ALLOWED_KINDS = "iufS"

_checked: set[tuple[int, int, int, int]] = set()
"""Files already walked: device, inode, size and time of change."""


def check_file(path: Path, groups: Iterable[str] | None = None) -> h5py.File:
    """Open a point's file for reading after walking all of it, once for as long as it does not change.

    Args:
        path: the file.
        groups: check only that these are groups of the file itself; for a reader of nothing but their attributes.

    Returns:
        The open `h5py.File`; the caller closes it.

    Raises:
        FileProblem: it cannot be opened as HDF5, or one line for each thing refused in it.
    """
    import h5py

    if not path.is_file():
        raise FileProblem(str(path), ["no such file"])
    try:
        file = h5py.File(path, "r")
    except OSError as error:
        raise FileProblem(str(path), [f"cannot be read as HDF5: {error}"]) from error
    status = path.stat()
    identity = (status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns)
    if identity in _checked:
        return file
    if groups is not None:
        _check_groups(file, path, groups)
        return file
    problems: list[str] = []
    try:
        _walk(file, "", status.st_size, problems, [0])
    except (OSError, RuntimeError, KeyError, ValueError) as error:
        problems.append(f"damaged: {error}")
    if problems:
        file.close()
        raise FileProblem(str(path), problems)
    if len(_checked) >= MOST_REMEMBERED:
        _checked.clear()
    _checked.add(identity)
    return file


def _check_groups(file: h5py.File, path: Path, groups: Iterable[str]) -> None:
    """Close the file and refuse it when one of the groups is a link elsewhere, or none.

    Raises:
        FileProblem: one line for each of them.
    """
    import h5py

    problems = []
    for name in groups:
        parts = name.split("/")
        for depth in range(1, len(parts) + 1):
            place = "/".join(parts[:depth])
            if not isinstance(file.get(place, getlink=True), h5py.HardLink) or not isinstance(file[place], h5py.Group):
                problems.append(f"/{place}: missing, or not a group of the file itself")
                break
    if problems:
        file.close()
        raise FileProblem(str(path), problems)


def _walk(group: h5py.Group, place: str, file_bytes: int, problems: list[str], seen: list[int]) -> None:
    import h5py

    if place.count("/") >= DEEPEST:
        problems.append(f"{place}: nested deeper than {DEEPEST} groups")
        return
    for name in group:
        seen[0] += 1
        if seen[0] > LARGEST_OBJECTS:
            problems.append(f"{place}: more than {LARGEST_OBJECTS} objects")
            return
        where = f"{place}/{name}"
        link = group.get(name, getlink=True)
        if not isinstance(link, h5py.HardLink):
            problems.append(f"{where}: {type(link).__name__} refused; a recording holds its data itself")
            continue
        item = group[name]
        if isinstance(item, h5py.Dataset):
            problems += [f"{where}: {text}" for text in _dataset_problems(item, file_bytes)]
        elif isinstance(item, h5py.Group):
            _walk(item, where, file_bytes, problems, seen)
        else:
            problems.append(f"{where}: neither group nor dataset")


def _dataset_problems(item: h5py.Dataset, file_bytes: int) -> list[str]:
    found = []
    if item.is_virtual:
        found.append("virtual dataset refused")
    if item.external:
        found.append("external storage refused")
    if item.dtype.kind not in ALLOWED_KINDS:
        found.append(f"type {item.dtype} refused; expected numbers or fixed-length text")
    if item.ndim > 1:
        found.append(f"{item.ndim} dimensions; expected 1")
    plist = item.id.get_create_plist()
    filters = [plist.get_filter(n) for n in range(plist.get_nfilters())]
    found += [f"filter {code} ({text!r}) refused; allowed: {', '.join(ALLOWED_FILTERS.values())}"
              for code, _, _, text in filters if code not in ALLOWED_FILTERS]
    size = int(np.prod(item.shape, dtype=object)) if item.shape else 1
    declared = size * item.dtype.itemsize
    if size > LARGEST_SAMPLES:
        found.append(f"declares {size} values; at most {LARGEST_SAMPLES}")
    elif declared > SMALL_BYTES and declared > LARGEST_RATIO * file_bytes:
        found.append(f"declares {declared} bytes in a file of {file_bytes}; refused as a decompression bomb")
    return found

"""Elements of MATLAB files of version 5, counted before they are read: how much they hold, and how deep they may nest.

Source: MathWorks, MAT-File Format, "Level 5 MAT-File Format": data element tags, array flags, compressed elements.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

from rig.errors import FileProblem
from rig.recording.foreign.foreign_file import MOST_NUMBERS, check_size

HEAD_BYTES = 128
ARRAY, COMPRESSED = 14, 15
HOLDERS = frozenset((1, 2, 3, 16, 17))
"""Classes of arrays that hold others: cell, struct, object, function, opaque."""
MOST_HOLDERS = 1000
"""More could be nested deeper than the stack of the reader is."""
MOST_ELEMENTS = 100_000


def check_elements(file: Path, data: bytes) -> None:
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

"""Verification of a finished file, before its journal is deleted: read back and compared with what was to be written.

What was received, which nothing can replace, is compared value by value with the journal's records. What was computed
from it is compared by the checks that were taken before HDF5 had the values (`docs/maintainers/decisions/
proof-of-a-finished-file.md`).
"""

from __future__ import annotations

import zlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.recording.hdf5.hdf5_objects import Checks, StoredValues, rows_of
from rig.signals.chunked_column import parts

if TYPE_CHECKING:
    import h5py

    from rig.recording.layout import PointFile, RawChannel

RECEIVED = ("value", "sequence", "device_us", "host_ns", "flags")


class ReadBackDiffers(OSError):
    """The finished file does not hold what was written: the disk or the library failed; the journal is kept."""


def prove(path: Path, point: PointFile, checks: Checks) -> None:
    """Read a file back and compare every value with what was to be written.

    Args:
        path: the file.
        point: what it was made from; of a long point, only its records are read again.
        checks: as `hdf5_image.write_image` returns them, for every dataset.

    Raises:
        ReadBackDiffers: naming the first dataset that differs.
    """
    import h5py

    with h5py.File(path, "r") as file:
        read_back = _ReadBack(path, file)
        received = {f"entry/raw/{channel.name}" for channel in point.raw}
        for channel in point.raw:
            read_back.compare_received(channel)
        for place, expected in checks.items():
            group, _, name = place.rpartition("/")
            if group not in received or name not in RECEIVED:
                read_back.compare(place, expected)


class _ReadBack:
    """What is read of one file: a dataset under several names is read once, and compared under each of them."""

    def __init__(self, path: Path, file: h5py.File) -> None:
        self._path, self._file = path, file
        self._read: dict[int, NDArray[Any]] = {}

    def compare_received(self, channel: RawChannel) -> None:
        """Compare a channel's records with what was received.

        Raises:
            ReadBackDiffers: a dataset is missing, or differs.
        """
        records, places = channel.records, {name: f"entry/raw/{channel.name}/{name}" for name in RECEIVED}
        datasets = {name: self._opened(place, len(records)) for name, place in places.items()}
        for rows in parts(len(records)):
            expected = records[rows]
            for name, dataset in datasets.items():
                wanted = expected[name].astype(np.int8) if name == "flags" else expected[name]  # as they are stored
                if not np.array_equal(self._rows(dataset, rows), wanted, equal_nan=wanted.dtype.kind == "f"):
                    raise self._differs(places[name])

    def compare(self, place: str, expected: StoredValues) -> None:
        """Compare one dataset with the check of what was to be written.

        Raises:
            ReadBackDiffers: it is missing, or differs.
        """
        dataset = self._opened(place, expected.length)
        check = 0
        for rows in parts(expected.length):
            check = zlib.crc32(self._rows(dataset, rows).data, check)
        if dataset.dtype != expected.kind or check != expected.check:
            raise self._differs(place)

    def _opened(self, place: str, length: int) -> h5py.h5d.DatasetID:
        import h5py

        try:
            dataset = h5py.h5d.open(self._file.id, place.encode())
        except KeyError:
            raise self._differs(place) from None
        if dataset.shape != (length,):
            raise self._differs(place)
        return dataset

    def _rows(self, dataset: h5py.h5d.DatasetID, rows: slice) -> NDArray[Any]:
        import h5py

        if dataset.shape != (rows.stop - rows.start,):
            return rows_of(dataset, rows)
        about = h5py.h5o.get_info(dataset)
        values = self._read.get(about.addr)
        if values is None:
            values = rows_of(dataset, rows)
            if about.rc > 1:
                self._read[about.addr] = values
        return values

    def _differs(self, place: str) -> ReadBackDiffers:
        return ReadBackDiffers(f"{self._path}: the data read back from /{place} differ from the recorded data")

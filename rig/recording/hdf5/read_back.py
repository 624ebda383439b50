"""Verification of a finished file: read back and compared with the written data, before its journal is deleted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.recording.hdf5.hdf5_objects import values_of
from rig.signals.chunked_column import Values, mapped, parts

if TYPE_CHECKING:
    import h5py

    from rig.recording.layout import PointFile

STAMPS = ("sequence", "device_us", "host_ns")


class ReadBackDiffers(OSError):
    """The finished file does not hold what was written: the disk or the library failed; the journal is kept."""


def prove(path: Path, point: PointFile) -> None:
    """Read a file back and compare every value with what was to be written.

    Raises:
        ReadBackDiffers: naming the first dataset that differs.
    """
    import h5py

    with h5py.File(path, "r") as file:
        read_back, data = _ReadBack(path), "entry/data"
        read_back.compare(file, f"{data}/time", point.time_s)
        for channel in point.channels:
            read_back.compare(file, f"{data}/{channel.name}", mapped(channel.values, lambda values: values, np.float32))
        if point.flags is not None:
            read_back.compare(file, f"{data}/flags", point.flags)
        for received in point.raw:
            place = f"entry/raw/{received.name}"
            for name in ("value", *STAMPS):
                read_back.compare(file, f"{place}/{name}", received.records[name])
            flags = mapped(received.records["flags"], lambda values: values, np.int8)  # as they are stored
            read_back.compare(file, f"{place}/flags", flags)
            if received.time_s is not None:
                read_back.compare(file, f"{place}/time", received.time_s)


class _ReadBack:
    """What was read of one file: a dataset under several names is read once, and compared under each of them."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._read: dict[int, NDArray[Any]] = {}

    def compare(self, file: h5py.File, place: str, expected: Values) -> None:
        """Compare one dataset with what was to be written.

        Raises:
            ReadBackDiffers: it is missing, or differs.
        """
        import h5py

        try:
            dataset = h5py.h5d.open(file.id, place.encode())
        except KeyError:
            same = False
        else:
            same = dataset.shape == (len(expected),) and self._holds(dataset, expected)
        if not same:
            raise ReadBackDiffers(f"{self._path}: the data read back from /{place} differ from the recorded data")

    def _holds(self, dataset: h5py.h5d.DatasetID, expected: Values) -> bool:
        import h5py

        ranges = list(parts(len(expected)))
        if len(ranges) > 1:
            whole = h5py.Dataset(dataset)
            return all(_equal(whole[rows], expected[rows]) for rows in ranges)
        about = h5py.h5o.get_info(dataset)
        values = self._read.get(about.addr)
        if values is None:
            values = values_of(dataset)
            if about.rc > 1:
                self._read[about.addr] = values
        return _equal(values, expected[:])


def _equal(values: NDArray[Any], expected: NDArray[Any]) -> bool:
    return bool(np.array_equal(values, expected, equal_nan=expected.dtype.kind == "f"))

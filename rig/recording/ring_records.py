"""Records of the ring as arrays: the same in the ring, in a journal, and as received in a point's file."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from protocols.quality import NO_VALUE
from rig.signals.arrays import FloatArray

#: One record of the ring and of the journal (32 bytes, `drivers.ring.RECORD`).
RECORD_DTYPE = np.dtype([
    ("host_ns", "<i8"), ("device_us", "<i8"), ("value", "<f8"), ("sequence", "<u4"), ("channel", "<u2"),
    ("flags", "<u2"),
])


class Records(Protocol):
    """Ring records (n,) of `RECORD_DTYPE`: an array, or a file read in parts (`point_journal`)."""

    def __len__(self) -> int: ...

    def __getitem__(self, key: Any, /) -> Any: ...  # noqa: ANN401 - an array, or one field of it


def good_values(records: NDArray[Any]) -> FloatArray:
    """Values (n,) in SI, NaN where the flags say that the value is not the physical quantity."""
    bad = (records["flags"] & np.uint16(NO_VALUE)) != 0
    return np.where(bad, np.nan, records["value"])

"""The layout of a recorded point (`docs/architecture.md`, "A recorded point"); HDF5 is made by `hdf5_image`."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from rig.recording.durable import write_whole

if TYPE_CHECKING:
    from rig.recording.column import Records, Values

FORMAT_VERSION = 1
CHUNK_SAMPLES = 16384
PART_SAMPLES = 16 * CHUNK_SAMPLES
"""So many rows of a dataset are in memory at a time."""

#: One record of the ring and of the journal (32 bytes, `drivers.ring.RECORD`).
RECORD_DTYPE = np.dtype([
    ("host_ns", "<i8"), ("device_us", "<i8"), ("value", "<f8"), ("sequence", "<u4"), ("channel", "<u2"),
    ("flags", "<u2"),
])

FloatArray = NDArray[np.float64]
Attribute = str | int | float | bool | Sequence[str] | None


@dataclass(frozen=True)
class AlignedChannel:
    """One channel on the common time base: `values` (n,), NaN where nothing was measured, in `unit`.

    `attributes` are written beside the units: calibration, serial number, method.
    """

    name: str
    values: Values
    unit: str
    long_name: str
    sensor: str = ""
    attributes: Mapping[str, Attribute] = field(default_factory=dict)


@dataclass(frozen=True)
class RawChannel:
    """One channel as received: `records` (m,) of `RECORD_DTYPE`; `time_s` (m,) the same samples on the common clock.

    `time_s` is None when the channel has no clock model; delays declared in the bench file are removed from it.
    `value_attributes` say what was on the wire and how the values were made from it.
    """

    name: str
    records: Records
    unit: str
    long_name: str
    time_s: Values | None = None
    attributes: Mapping[str, Attribute] = field(default_factory=dict)
    value_attributes: Mapping[str, Attribute] = field(default_factory=dict)


@dataclass(frozen=True)
class Event:
    """Something that happened: time on the file's time base (ns), a slug, one line for people.

    In a journal `time_ns` is the host's monotonic clock; a file keeps that too, as `host_ns` (-1: not known).
    """

    time_ns: int
    code: str
    text: str
    host_ns: int = -1


@dataclass(frozen=True)
class PointFile:
    """Everything one file holds. `time_s` (n,) in seconds; `flags` (n,) as `protocols.quality.Quality`, None: all 0."""

    time_s: Values
    sample_rate_hz: float
    channels: Sequence[AlignedChannel]
    flags: Values | None = None
    signal: str = "force"
    raw: Sequence[RawChannel] = ()
    events: Sequence[Event] = ()
    test: Mapping[str, Attribute] = field(default_factory=dict)
    quality: Mapping[str, Attribute] = field(default_factory=dict)
    provenance: Mapping[str, Attribute] = field(default_factory=dict)
    title: str = ""


def write_file(path: Path, content: PointFile, *, before_naming: Callable[[Path], None] | None = None) -> None:
    """Write a complete file or none: temporary name, flush to disk, rename, flush the directory.

    Args:
        path: the final name; a file of that name is replaced only once the new one is complete on disk.
        content: what to write.
        before_naming: is given the temporary name when all is on the disk; what it raises prevents the naming.

    Raises:
        ValueError: a channel's length differs from the time's.
        OSError: the disk is full or the place cannot be written; nothing is left under `path`.
    """
    from rig.recording.hdf5_image import write_image

    write_whole(path, lambda file: write_image(file, content), before_naming=before_naming)


def parts(length: int) -> Iterator[slice]:
    """Ranges of at most `PART_SAMPLES` rows that cover a column end to end; one empty range for an empty column."""
    for start in range(0, max(length, 1), PART_SAMPLES):
        yield slice(start, min(start + PART_SAMPLES, length))


def check_of(values: NDArray[Any]) -> int:
    """CRC-32 of a dataset's values: HDF5 checks its chunks, but not the index that finds them."""
    return zlib.crc32(np.ascontiguousarray(values).tobytes())

"""The layout of a recorded point in HDF5, and the one writer of it (`docs/architecture.md`, "A recorded point").

Plain types only, so that xarray, pandas, MATLAB, Octave, HDFView and h5dump read it without us: float64 time as an
attached dimension scale, float32 channels, parallel one-dimensional arrays for events, fixed-length text, int8 flags.
"""

from __future__ import annotations

import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from rig.recording.durable import replace_durably

if TYPE_CHECKING:
    import h5py

    from rig.recording.column import Records, Values

FORMAT_VERSION = 1
CHUNK_SAMPLES = 16384
PART_SAMPLES = 16 * CHUNK_SAMPLES
"""So many rows of a dataset are in memory at a time."""
FILTERS: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True, "fletcher32": True}

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
    """

    name: str
    records: Records
    unit: str
    long_name: str
    time_s: Values | None = None
    attributes: Mapping[str, Attribute] = field(default_factory=dict)


@dataclass(frozen=True)
class Event:
    """Something that happened: time on the file's time base (ns), a slug, one line for people."""

    time_ns: int
    code: str
    text: str


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


def write_file(path: Path, content: PointFile) -> None:
    """Write a complete file or none: temporary name, flush to disk, rename, flush the directory.

    Args:
        path: the final name; a file of that name is replaced only once the new one is complete on disk.
        content: what to write.

    Raises:
        ValueError: a channel's length differs from the time's.
        OSError: the disk is full or the place cannot be written; nothing is left under `path`.
    """
    partial = path.with_name(path.name + ".tmp")
    write_partial(partial, content)
    replace_durably(partial, path)


def write_partial(path: Path, content: PointFile) -> None:
    """Write the content under this very name, without the durable rename of `write_file`.

    Raises:
        ValueError: a channel's length differs from the time's.
    """
    import h5py

    check_lengths(content)
    with h5py.File(path, "w", libver=("v108", "v110")) as file:
        fill(file, content)


def check_lengths(content: PointFile) -> None:
    """Refuse a content whose channels are not all as long as its time.

    Raises:
        ValueError: naming the channel, its length and the expected one.
    """
    expected = len(content.time_s)
    lengths = {channel.name: len(channel.values) for channel in content.channels}
    if content.flags is not None:
        lengths["flags"] = len(content.flags)
    wrong = [f"channel {name} has {length} samples" for name, length in lengths.items() if length != expected]
    if wrong:
        raise ValueError(f"time has {expected} samples, but " + ", ".join(wrong))


def fill(file: h5py.File, content: PointFile) -> None:
    """Put the content into an open, empty HDF5 file."""
    file.attrs["format_version"] = FORMAT_VERSION
    set_attributes(file, {"default": "entry"})
    entry = file.create_group("entry")
    set_attributes(entry, {"NX_class": "NXentry", "default": "data", "title": content.title})
    _fill_data(entry.create_group("data"), content)
    raw = entry.create_group("raw")
    for channel in content.raw:
        _fill_raw(raw.create_group(channel.name), channel)
    _fill_events(entry.create_group("events"), content.events)
    for name in ("test", "quality", "provenance"):
        set_attributes(entry.create_group(name), getattr(content, name))


def _fill_data(group: h5py.Group, content: PointFile) -> None:
    set_attributes(group, {
        "NX_class": "NXdata", "signal": content.signal, "axes": "time", "sample_rate_hz": content.sample_rate_hz,
    })
    time = _dataset(group, "time", content.time_s, np.float64)
    set_attributes(time, {"units": "s", "long_name": "Time"})
    time.make_scale("time")
    flags = np.zeros(len(content.time_s), np.int8) if content.flags is None else content.flags
    quality = AlignedChannel("flags", flags, "1", "Quality: 1 overload, 2 fault, 4 gap, 8 NaN, 16 spike, 32 stale")
    for channel in (*content.channels, quality):
        flagged = channel is quality or channel.values.dtype == np.int8
        dataset = _dataset(group, channel.name, channel.values, np.int8 if flagged else np.float32)
        set_attributes(dataset, {
            "units": channel.unit, "long_name": channel.long_name, "sensor": channel.sensor, **channel.attributes,
        })
        dataset.dims[0].attach_scale(time)


def _fill_raw(group: h5py.Group, channel: RawChannel) -> None:
    units = {"value": channel.unit, "sequence": "1", "device_us": "us", "host_ns": "ns", "flags": "1"}
    for name, unit in units.items():
        kind = np.int8 if name == "flags" else RECORD_DTYPE[name]
        set_attributes(_dataset(group, name, channel.records[name], kind), {"units": unit})
    if channel.time_s is not None:
        set_attributes(_dataset(group, "time", channel.time_s, np.float64), {"units": "s"})
    set_attributes(group, {"long_name": channel.long_name, **channel.attributes})


def _fill_events(group: h5py.Group, events: Sequence[Event]) -> None:
    times = np.array([event.time_ns for event in events], np.int64)
    set_attributes(_dataset(group, "time_ns", times, np.int64), {"units": "ns"})
    for name in ("code", "text"):
        texts, kind = _texts([getattr(event, name) for event in events] or [" "])
        group.create_dataset(name, data=texts[:len(events)], dtype=kind)


def parts(length: int) -> Iterator[slice]:
    """Ranges of at most `PART_SAMPLES` rows that cover a column end to end; one empty range for an empty column."""
    for start in range(0, max(length, 1), PART_SAMPLES):
        yield slice(start, min(start + PART_SAMPLES, length))


def _dataset(group: h5py.Group, name: str, values: Values, kind: DTypeLike) -> h5py.Dataset:
    """A dataset of type `kind`, written a part at a time, with the check of its values."""
    if len(values) == 0:
        return group.create_dataset(name, data=np.zeros(0, kind))
    chunk = min(len(values), CHUNK_SAMPLES)
    dataset = group.create_dataset(name, (len(values),), kind, chunks=(chunk,), **FILTERS)
    check = 0
    for rows in parts(len(values)):
        part = np.ascontiguousarray(np.asarray(values[rows]).astype(kind))
        dataset[rows] = part
        check = zlib.crc32(part.tobytes(), check)
    dataset.attrs["crc32"] = check
    return dataset


def check_of(values: NDArray[Any]) -> int:
    """CRC-32 of a dataset's values: HDF5 checks its chunks, but not the index that finds them."""
    return zlib.crc32(np.ascontiguousarray(values).tobytes())


def set_attributes(place: h5py.Group | h5py.Dataset, attributes: Mapping[str, Attribute]) -> None:
    """Plain attributes: numbers, fixed-length UTF-8 text, one-dimensional arrays of text; None is left out."""
    for name, value in attributes.items():
        if value is None:
            continue
        if isinstance(value, str):
            text, kind = _texts([value])
            place.attrs.create(name, text[0], dtype=kind)
        elif isinstance(value, bool):
            place.attrs[name] = np.int8(value)
        elif isinstance(value, (int, float)):
            place.attrs[name] = value
        elif value:
            texts, kind = _texts(value)
            place.attrs.create(name, texts, dtype=kind)


def _texts(values: Sequence[str]) -> tuple[NDArray[Any], Any]:
    """Fixed-length UTF-8 text as HDF5 keeps it; an empty text becomes one blank."""
    import h5py

    encoded = [value.encode() or b" " for value in values]
    kind = h5py.string_dtype("utf-8", max(map(len, encoded)))
    return np.array(encoded, kind), kind

"""A point's content as HDF5, written into an open file (`rig.recording.atomic_write`), compact and portable.

Plain types only, so that xarray, pandas, MATLAB, Octave, HDFView and h5dump can read it: float64 time as an attached
dimension scale, float32 channels, parallel one-dimensional arrays for events, fixed-length text, int8 flags. Time
stamps that several channels share (channels of one poll, of one frame) are stored once and linked.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import DTypeLike

from rig.recording.atomic_write import ReservedFile, write_whole
from rig.recording.hdf5.hdf5_objects import (
    Checks,
    StoredValues,
    number_type,
    rows_of,
    set_attributes,
    set_number,
    texts_of,
    write_values,
)
from rig.recording.layout import CHUNK_SAMPLES, FORMAT_VERSION, AlignedChannel
from rig.recording.ring_records import RECORD_DTYPE
from rig.signals.chunked_column import parts

if TYPE_CHECKING:
    import h5py

    from rig.recording.layout import Attribute, CycleTable, Event, PointFile, RawChannel
    from rig.signals.chunked_column import Values

    Column = tuple[Values, DTypeLike]
    """Values (n,) and the type in which they are stored."""

COMPRESSION = 1
"""Level of gzip; shuffled before, with a check of every chunk behind. Level 4 takes 1.6 times as long and saves 2 %: a
measured value's last bits are noise, and a column of time stamps is small at any level.
"""
UNFILTERED_BYTES = 1024
"""A dataset up to this size is stored as it is: filters and an index of chunks would be longer than what they save."""
MOST_ATTRIBUTES = 1000
"""Attributes that stay in their object's header, where they take least room."""
QUALITY = "Quality: 1 overload, 2 fault, 4 gap, 8 NaN, 16 spike, 32 stale, 64 clock went backwards"
EMPTY_FILE = bytes.fromhex(
    "894844460d0a1a0a0208080000000000000000003000000000000000e4000000000000006100000000000000cc3f68d5"
    "4f4844520220977e026b977e026b977e026b977e026b1613070005000200100004000007000000000000000000c33b6c"
    "ab4f484452020078021200000000ffffffffffffffffffffffffffffffff0a02000100000058"
) + bytes(90) + bytes.fromhex("c5b9c8ac")
"""An HDF5 file without content (superblock 2, libver 1.8) whose indices of chunks hold 4 entries a node, not 64.

h5py cannot ask for that (`H5Pset_istore_k`); with HDF5's own choice the empty places of these indices are 2 kB a
dataset, 330 of the 480 kB of a short point.
"""


def write_file(path: Path, content: PointFile, *, before_naming: Callable[[Path, Checks], None] | None = None) -> None:
    """Write a complete file or none: temporary name, flush to disk, rename, flush the directory.

    Args:
        path: the final name; a file of that name is replaced only once the new one is complete on disk.
        content: what to write.
        before_naming: is given the temporary name and the checks of what was written when all is on the disk; what it
            raises prevents the naming.

    Raises:
        ValueError: a channel's length differs from the time's.
        OSError: the disk is full or the place cannot be written; nothing is left under `path`.
    """
    checks: dict[str, StoredValues] = {}

    def finished(partial: Path) -> None:
        if before_naming is not None:
            before_naming(partial, checks)

    write_whole(path, lambda file: checks.update(write_image(file, content)), before_naming=finished)


def write_image(file: ReservedFile, content: PointFile) -> Checks:
    """Put the content into an empty file.

    Returns:
        The check of every dataset, by its place.

    Raises:
        ValueError: a channel's length differs from the time's.
        OSError: the disk refuses.
    """
    import h5py

    check_lengths(content)
    file.write(EMPTY_FILE)
    with h5py.File(file, "r+", libver=("v108", "v110")) as opened:
        image = _Image(opened, file.check)
        image.fill(content)
    file.check()
    return image.checks


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


class _Image:
    """Fills an open, empty HDF5 file; `check` raises what the disk has refused and is asked after every part.

    Attributes:
        checks: of what was written, by place.
    """

    def __init__(self, file: h5py.File, check: Callable[[], None]) -> None:
        self.checks: dict[str, StoredValues] = {}
        self._file = file
        self._check = check
        self._stored: dict[tuple[str, int, int], h5py.h5d.DatasetID] = {}

    def fill(self, content: PointFile) -> None:
        root = self._file["/"].id
        set_attributes(root, {"format_version": FORMAT_VERSION, "NX_class": "NXroot", "default": "entry"})
        self._group("entry", "NXentry", {"default": "data", "title": content.title})
        self._fill_data(content)
        self._group("entry/raw", "NXcollection")
        for channel in content.raw:
            self._fill_raw(channel)
        self._fill_events(content.events)
        if content.cycles is not None:
            self._fill_cycles(content.cycles)
        for name in ("test", "quality", "provenance"):
            self._group(f"entry/{name}", "NXcollection", getattr(content, name))

    def _group(self, place: str, kind: str, attributes: Mapping[str, Attribute] | None = None) -> h5py.h5g.GroupID:
        group = self._bare_group(place)
        set_attributes(group, {"NX_class": kind, **(attributes or {})})
        return group

    def _bare_group(self, place: str) -> h5py.h5g.GroupID:
        """A group without attributes: those given after its members are there take less room."""
        import h5py

        properties = h5py.h5p.create(h5py.h5p.GROUP_CREATE)
        properties.set_obj_track_times(False)
        properties.set_attr_phase_change(MOST_ATTRIBUTES, MOST_ATTRIBUTES - 1)
        return h5py.h5g.create(self._file.id, place.encode(), None, properties)

    def _fill_data(self, content: PointFile) -> None:
        import h5py

        group = self._group("entry/data", "NXdata", {
            "signal": content.signal, "axes": "time", "time_indices": 0, "sample_rate_hz": content.sample_rate_hz,
        })
        flags = np.zeros(len(content.time_s), np.int8) if content.flags is None else content.flags
        channels = (*content.channels, AlignedChannel("flags", flags, "1", QUALITY))
        columns: dict[str, Column] = {"time": (content.time_s, np.float64)}
        for channel in channels:
            flagged = channel.name == "flags" or channel.values.dtype == np.int8
            columns[channel.name] = channel.values, np.int8 if flagged else np.float32
        datasets = self._write(group, "entry/data", columns)
        time = datasets["time"]
        set_attributes(time, {"units": "s", "long_name": "Time"})
        h5py.h5ds.set_scale(time, b"time")
        for channel in channels:
            dataset = datasets[channel.name]
            set_attributes(dataset, {
                "units": channel.unit, "long_name": channel.long_name, "sensor": channel.sensor, **channel.attributes,
            })
            h5py.h5ds.attach_scale(dataset, time, 0)

    def _fill_raw(self, channel: RawChannel) -> None:
        place = f"entry/raw/{channel.name}"
        group = self._bare_group(place)
        units = {"value": channel.unit, "sequence": "1", "device_us": "us", "host_ns": "ns", "flags": "1"}
        columns: dict[str, Column] = {
            name: (channel.records[name], np.int8 if name == "flags" else RECORD_DTYPE[name]) for name in units
        }
        if channel.time_s is not None:
            units["time"], columns["time"] = "s", (channel.time_s, np.float64)
        shared = {name: key for name in columns if name != "value" and (key := _key(name, *columns[name])) is not None}
        linked = {name for name, key in shared.items() if self._linked(group, place, name, key, columns[name])}
        datasets = self._write(group, place, {name: column for name, column in columns.items() if name not in linked})
        for name, dataset in datasets.items():
            if name in shared:
                self._stored[shared[name]] = dataset
            about = channel.value_attributes if name == "value" else {}
            set_attributes(dataset, {"units": units[name], **about})
        set_attributes(group, {"NX_class": "NXcollection", "long_name": channel.long_name, **channel.attributes})

    def _fill_events(self, events: Sequence[Event]) -> None:
        import h5py

        group = self._group("entry/events", "NXcollection")
        place = "entry/events"
        columns: dict[str, Column] = {
            name: (np.array([getattr(event, name) for event in events], np.int64), np.int64)
            for name in ("time_ns", "host_ns")
        }
        for dataset in self._write(group, place, columns).values():
            set_attributes(dataset, {"units": "ns"})
        for name in ("code", "text"):
            texts = texts_of([getattr(event, name) for event in events])
            set_attributes(h5py.Group(group).create_dataset(name, data=texts).id, {"encoding": "utf-8"})
            self.checks[f"{place}/{name}"] = StoredValues(len(texts), texts.dtype, zlib.crc32(texts.tobytes()))
        self._check()

    def _fill_cycles(self, table: CycleTable) -> None:
        group = self._group("entry/cycles", "NXcollection")
        columns: dict[str, Column] = {"number": (table.number, np.int64), "start": (table.values["start"], np.float64)}
        columns |= {name: (values, np.float32) for name, values in table.values.items() if name != "start"}
        about = {"number": ("1", "Number of the cycle in its endurance test, from 1"), **table.units}
        for name, dataset in self._write(group, "entry/cycles", columns).items():
            unit, long_name = about[name]
            set_attributes(dataset, {"units": unit, "long_name": long_name})

    def _linked(
        self, group: h5py.h5g.GroupID, place: str, name: str, key: tuple[str, int, int], column: Column
    ) -> bool:
        """Whether another channel of the same message has stored this column, which is then only linked."""
        import h5py

        (values, kind), (_, length, check) = column, key
        known = self._stored.get(key)
        if known is None or rows_of(known, slice(0, length)).tobytes() != np.asarray(values).astype(kind).tobytes():
            return False
        h5py.h5o.link(known, group, name.encode())
        self.checks[f"{place}/{name}"] = StoredValues(length, np.dtype(kind), check)
        return True

    def _write(
        self, group: h5py.h5g.GroupID, place: str, columns: Mapping[str, Column]
    ) -> dict[str, h5py.h5d.DatasetID]:
        """Datasets of columns of one length, with the checks of their values.

        They are written side by side, a part at a time: what columns are computed from is then read once. The check is
        of the values as they are before HDF5 has them.
        """
        length = len(next(iter(columns.values()))[0]) if columns else 0
        datasets = {name: _created(group, name, length, np.dtype(kind)) for name, (_, kind) in columns.items()}
        checks = dict.fromkeys(columns, 0)
        for rows in parts(length) if length else ():
            for name, (values, kind) in columns.items():
                part = np.ascontiguousarray(np.asarray(values[rows]).astype(kind))
                checks[name] = zlib.crc32(part.data, checks[name])
                write_values(datasets[name], rows.start, part)
                self._check()
        for name, check in checks.items():
            self.checks[f"{place}/{name}"] = StoredValues(length, np.dtype(columns[name][1]), check)
            if length:
                set_number(datasets[name], "crc32", np.uint32(check))
        return datasets


def _key(name: str, values: Values, kind: DTypeLike) -> tuple[str, int, int] | None:
    """What a column that other channels may share is found by: name, length, check; None where it is not shared."""
    if not isinstance(values, np.ndarray) or len(values) == 0:
        return None
    return name, len(values), zlib.crc32(np.ascontiguousarray(values.astype(kind)).data)


def _created(group: h5py.h5g.GroupID, name: str, length: int, kind: np.dtype[Any]) -> h5py.h5d.DatasetID:
    import h5py

    access = h5py.h5p.create(h5py.h5p.DATASET_ACCESS)
    access.set_chunk_cache(1, 0, 1.0)  # parts are whole chunks; HDF5 would hold 8 MB of them for every open dataset
    space = h5py.h5s.create_simple((length,))
    return h5py.h5d.create(group, name.encode(), number_type(kind), space, dcpl=_storage(length, kind), dapl=access)


def _storage(length: int, kind: np.dtype[Any]) -> h5py.h5p.PropDCID:
    """How a dataset is stored: in chunks with filters and a check, or as it is when it is small."""
    import h5py

    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_attr_phase_change(MOST_ATTRIBUTES, MOST_ATTRIBUTES - 1)
    if length * kind.itemsize > UNFILTERED_BYTES:
        properties.set_chunk((min(length, CHUNK_SAMPLES),))
        properties.set_shuffle()
        properties.set_deflate(COMPRESSION)
        properties.set_fletcher32()
    properties.set_obj_track_times(False)
    return properties

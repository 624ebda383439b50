"""Cache of results computed from recorded points, in the run's folder `cache/`.

Only the point's file is authoritative. An entry is used if it is undamaged and was made from the same file content,
with the same code and settings; otherwise it is replaced. An unwritable cache, such as that of a read-only run, is not
an error, and the folder may be deleted at any time. Symbolic links are not followed. A point whose arrays were changed
in memory is not cached. A damaged entry is reported once for each folder.

Format of an entry: `KIND`, SHA-256 of the rest, length of the header (u64, little-endian), header (JSON), consecutive
arrays. The header contains the key, the values, and the name, type and length of each array.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import stat
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import rig
from drivers.posix import O_CLOEXEC, O_NOFOLLOW
from rig.campaign_folder import CampaignFolder
from rig.errors import DataWarning
from rig.recording.atomic_write import inner_folder, write_unflushed
from rig.recording.recorded_point import RecordedPoint

KIND = b"mr-damper-rig cache 1\n"
CODE = ("signals", "recording", "dampers", "identification", "characteristics", "test_point.py")
"""Packages whose code determines entries."""
TYPES = {"float64", "complex128", "bool"}
ARRAYS = ("time_s", "displacement_m", "velocity_m_s", "force_N", "current_measured_A", "force_samples")
"""Arrays of a point that are read from its file on first access."""
AS_READ = "_digests_as_read"
"""Attribute of a point: SHA-256 of its arrays as read."""
NOT_IN_THE_KEY = {"path", "arrays"}
LARGEST_BYTES = 1 << 30
READ_BYTES = 1 << 22
NOT_BLOCKING = getattr(os, "O_NONBLOCK", 0)

_reported: set[Path] = set()
"""Folders in which damaged entries have been reported."""


@dataclass(frozen=True)
class Entry:
    """Values (JSON) and arrays (n,) by name; `as_read` contains the SHA-256 of the point's original arrays."""

    values: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]
    as_read: Mapping[str, str] = field(default_factory=dict)


class PointCache:
    """A named cache entry for a point.

    Args:
        point: the opened point.
        name: name of the entry.
        settings: other settings that it depends on, as text.
    """

    def __init__(self, point: RecordedPoint, name: str, settings: str) -> None:
        self._point, self._settings = point, settings
        path = point.path
        in_run = path is not None and point.arrays is None and path.parent.name == CampaignFolder.points
        self._run = path.parent.parent if in_run and path is not None else None
        self._name = "" if path is None else f"{path.stem}.{name}"
        self._content = self._digest()
        self._known: dict[str, str] = point.__dict__.get(AS_READ, {})
        self._unchanged = _digests(point).items() <= self._known.items()

    def read(self) -> Entry | None:
        """Return the entry, or None if there is no usable one."""
        if self._run is None or not self._content:
            return None
        folder = CampaignFolder(self._run).cache
        try:
            if folder.is_symlink():
                return None
            raw = _read(folder / self._name)
            entry = None if raw is None else _unpacked(raw, self._key())
            if entry is None or not (self._unchanged or _digests(self._point).items() <= entry.as_read.items()):
                return None
            return entry
        except (OSError, MemoryError):
            return None  # created again
        except (ValueError, TypeError, KeyError, RecursionError):
            _report(folder, self._name)
            return None

    def write(self, entry: Entry) -> None:
        """Store an entry that was computed since this object was created, unless the point's file has changed.

        If storing fails, the next command computes the entry again.
        """
        if self._run is None or not self._content or not self._unchanged or self._digest() != self._content:
            return
        as_read = {**self._known, **_digests(self._point)}
        self._point.__dict__[AS_READ] = as_read
        with contextlib.suppress(OSError, ValueError, TypeError):
            parts = _packed(replace(entry, as_read=as_read), self._key())
            write_unflushed(inner_folder(self._run, CampaignFolder.cache) / self._name, parts)

    def _key(self) -> str:
        """Key of everything that an entry depends on.

        It includes the description, because the file may have been replaced since it was opened.
        """
        described = {one.name: getattr(self._point, one.name) for one in fields(self._point)
                     if one.name not in NOT_IN_THE_KEY}  # fmt: skip
        told = repr((described, self._settings, rig.__version__, np.__version__, _code()))
        return self._content + hashlib.sha256(told.encode("utf-8", "backslashreplace")).hexdigest()

    def _digest(self) -> str:
        """SHA-256 of the point's file; empty if it cannot be read."""
        if self._run is None or self._point.path is None:
            return ""
        digest = hashlib.sha256()
        try:
            with self._point.path.open("rb", buffering=0) as file:
                while part := file.read(READ_BYTES):
                    digest.update(part)
        except OSError:
            return ""
        return digest.hexdigest()


def _report(folder: Path, name: str) -> None:
    """Warn of a damaged entry, once for each folder: after a power failure, there may be many."""
    if folder not in _reported:
        _reported.add(folder)
        warnings.warn(f"{folder / name}: this cache entry is damaged; it is ignored and replaced, as is every other "
                      "damaged entry in this folder, and the results are not affected. If this happens again, check "
                      "the disk", DataWarning, stacklevel=3)  # fmt: skip


def _digests(point: RecordedPoint) -> dict[str, str]:
    """SHA-256 of each of a point's arrays that are in memory."""
    known = ((name, point.__dict__[name]) for name in ARRAYS if name in point.__dict__)
    return {
        name: hashlib.sha256(b"".join(
            one.tobytes() for one in ([value] if isinstance(value, np.ndarray) else vars(value).values())
        )).hexdigest() for name, value in known
    }


@cache
def _code() -> str:
    """SHA-256 of the code that determines entries."""
    package, digest = Path(rig.__file__).resolve().parent, hashlib.sha256()
    for name in CODE:
        place = package / name
        for file in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _read(file: Path) -> NDArray[np.uint8] | None:
    """Content of a writable regular file; None for anything else, including links.

    Raises:
        OSError: it cannot be read.
    """
    handle = os.open(file, os.O_RDONLY | O_CLOEXEC | O_NOFOLLOW | NOT_BLOCKING)
    with os.fdopen(handle, "rb", buffering=0) as opened:
        state = os.fstat(handle)
        if not stat.S_ISREG(state.st_mode) or state.st_size > LARGEST_BYTES:
            return None
        raw, done = np.empty(state.st_size, np.uint8), 0
        while count := opened.readinto(raw.data[done:]):
            done += count
    return raw[:done]


def _packed(entry: Entry, key: str) -> list[bytes | memoryview]:
    """An entry as parts of a file.

    Raises:
        TypeError: a value cannot be represented in JSON, or an array has an unsupported type.
    """
    # In descending order of item size, so that each array is aligned.
    arrays = sorted(entry.arrays.items(), key=lambda one: -one[1].dtype.itemsize)
    if any(values.dtype.name not in TYPES or values.ndim != 1 for _, values in arrays):
        raise TypeError("an array of another type")
    listed = [(name, values.dtype.name, values.size) for name, values in arrays]
    header = json.dumps({
        "key": key, "values": entry.values, "arrays": listed, "as_read": entry.as_read,
    }, default=_number).encode()
    start = len(KIND) + 32 + 8
    header += b" " * (-(start + len(header)) % 16)
    rest: list[bytes | memoryview] = [len(header).to_bytes(8, "little"), header]
    rest += [np.ascontiguousarray(values).data.cast("B") for _, values in arrays if values.size]
    digest = hashlib.sha256()
    for part in rest:
        digest.update(part)
    return [KIND, digest.digest(), *rest]


def _number(value: object) -> Any:  # noqa: ANN401 - JSON
    """Convert a NumPy number to a Python number.

    Raises:
        TypeError: the value is not a number.
    """
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} cannot be kept")


def _unpacked(raw: NDArray[np.uint8], key: str) -> Entry | None:
    """The entry in a file's content; None if it is in another format or has another key.

    Raises:
        ValueError: the content is damaged.
        KeyError: as `ValueError`.
        TypeError: as `ValueError`.
    """
    start = len(KIND) + 32
    if raw.size >= len(KIND) and bytes(raw[: len(KIND)]) != KIND:
        return None
    if raw.size < start + 8 or hashlib.sha256(raw.data[start:]).digest() != bytes(raw[len(KIND) : start]):
        raise ValueError("wrong checksum")
    size = int.from_bytes(bytes(raw[start : start + 8]), "little")
    header = json.loads(bytes(raw[start + 8 : start + 8 + size]))
    if header["key"] != key:
        return None
    arrays, place = {}, start + 8 + size
    for name, kind, length in header["arrays"]:
        if kind not in TYPES:
            return None
        end = place + int(length) * np.dtype(kind).itemsize
        arrays[name] = raw[place:end].view(kind)
        if arrays[name].size != length:
            return None
        place = end
    return Entry(header["values"], arrays, header["as_read"])

"""The running point's journal: append-only, one unbuffered write per block, every block with its own checksum.

```
header: "MRJOURN1" | length u32 | crc32 u32 of the text | context, JSON
block : "MRBK" | kind u16 | 0 u16 | index u32 | length u32 | crc32 u32 of kind..length and data | data
kinds : 1 records (RECORD_DTYPE)   2 event, JSON   3 end, JSON
```
All little-endian. Space is reserved beforehand, so the file may end in zeros. A block is discarded if its checksum,
index or length does not match: truncated or corrupted data are reported as missing and never become a false sample.
"""

from __future__ import annotations

import errno
import json
import mmap as memory
import os
import struct
import threading
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from mmap import mmap
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.posix import fcntl
from rig.recording.atomic_write import flush_directory
from rig.recording.layout import Event
from rig.recording.ring_records import RECORD_DTYPE

HEADER = struct.Struct("<8sII")
HEADER_MAGIC = b"MRJOURN1"
BLOCK = struct.Struct("<4sHHIII")
BLOCK_MAGIC = b"MRBK"
CHECKED = struct.Struct("<HHII")
RECORDS, EVENT, END = 1, 2, 3

FLUSH_PERIOD_S = 0.05
LARGEST_BLOCK_BYTES = 1 << 26
SCANNED_BYTES = 1 << 20
RELEASED_BYTES = 1 << 24
"""A mapped journal leaves memory in steps of so many bytes, once walked."""


class JournalProblem(ValueError):
    """The file is not a journal, or its header is damaged: nothing in it can be attributed to a point."""


class JournalWriter:
    """Writes one point's journal. Not thread-safe: one caller; the flush to disk runs on a thread of its own.

    Args:
        path: a file that does not exist yet.
        context_json: the header (`PointContext.to_json`).
        reserve_bytes: room to take on the disk now, so that a full disk is seen before anything moves.

    Raises:
        OSError: the file exists, the folder cannot be written, or there is no room.
    """

    def __init__(self, path: Path, context_json: str, *, reserve_bytes: int = 0) -> None:
        self.path = path
        self.records = 0
        self._blocks = 0
        self._length = 0
        self._flush_error: OSError | None = None
        self._closing = threading.Event()
        self._handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        try:
            # The process that converts journals waits for this lock; it ends with the handle or the process.
            fcntl.flock(self._handle, fcntl.LOCK_EX)
            self._reserve(reserve_bytes)
            text = context_json.encode()
            self._write(HEADER.pack(HEADER_MAGIC, len(text), zlib.crc32(text)) + text)
        except OSError:
            os.close(self._handle)
            path.unlink(missing_ok=True)
            raise
        self._flusher = threading.Thread(target=self._flush_regularly, name=f"flush {path.name}", daemon=True)
        self._flusher.start()

    def _reserve(self, size: int) -> None:
        if size <= 0 or not hasattr(os, "posix_fallocate"):
            return
        try:
            os.posix_fallocate(self._handle, 0, size)
        except OSError as error:
            if error.errno not in {errno.EOPNOTSUPP, errno.EINVAL}:
                raise

    def append(self, records: NDArray[Any]) -> None:
        """Add samples (n,) of `RECORD_DTYPE` as one block.

        Raises:
            OSError: they could not be written, or an earlier flush failed; the journal must be abandoned.
        """
        self._block(RECORDS, records.tobytes())
        self.records += len(records)

    def event(self, time_ns: int, code: str, text: str) -> None:
        """Add an event: host time (monotonic ns), slug, one line for people.

        Raises:
            OSError: it could not be written, or an earlier flush failed.
        """
        self._block(EVENT, json.dumps({"time_ns": time_ns, "code": code, "text": text}).encode())

    def close(self, *, stopped_by: str | None, lost_records: int) -> None:
        """Write how the point ended, give back unused room, flush, close.

        Raises:
            OSError: something of this journal did not reach the disk.
        """
        try:
            self._block(END, json.dumps({"stopped_by": stopped_by, "lost_records": lost_records}).encode())
            os.ftruncate(self._handle, self._length)
        finally:
            self._closing.set()
            self._flusher.join()
            os.close(self._handle)
        self._raise_flush_error()

    def _block(self, kind: int, data: bytes) -> None:
        self._raise_flush_error()
        check = zlib.crc32(data, zlib.crc32(CHECKED.pack(kind, 0, self._blocks, len(data))))
        self._write(BLOCK.pack(BLOCK_MAGIC, kind, 0, self._blocks, len(data), check) + data)
        self._blocks += 1

    def _write(self, data: bytes) -> None:
        view = memoryview(data)
        while view:
            written = os.pwrite(self._handle, view, self._length)
            self._length += written
            view = view[written:]

    def _raise_flush_error(self) -> None:
        if self._flush_error is not None:
            raise self._flush_error

    def _flush_regularly(self) -> None:
        flushed = 0
        while True:
            last = self._closing.wait(FLUSH_PERIOD_S)
            if self._length > flushed:
                first, flushed = flushed == 0, self._length
                try:
                    os.fdatasync(self._handle)
                    if first:
                        flush_directory(self.path.parent)  # else a power cut could take the name
                except OSError as error:
                    self._flush_error = error
                    return
            if last:
                return


@dataclass(frozen=True)
class JournalContent:
    """What a journal still holds.

    Attributes:
        context_json: the header.
        records: samples (n,) of `RECORD_DTYPE` in the order of arrival.
        events: what was noted.
        end: how the point ended; None when the journal was cut off.
        missing_blocks: blocks known to be missing between others.
        damaged_bytes: bytes that belong to no block with a right check.
    """

    context_json: str
    records: NDArray[Any]
    events: tuple[Event, ...] = ()
    end: dict[str, Any] | None = None
    missing_blocks: int = 0
    damaged_bytes: int = 0


@dataclass
class _Walk:
    take: Callable[[NDArray[Any]], None]
    events: list[Event] = field(default_factory=list)
    end: dict[str, Any] | None = None
    next_index: int = 0
    missing: int = 0
    damaged: int = 0


def read_journal(path: Path) -> JournalContent:
    """Read whatever of a journal is provably right.

    Raises:
        JournalProblem: it is no journal or its header is damaged.
        OSError: the file cannot be read.
    """
    return parse_journal(path.read_bytes(), str(path))


def read_header(path: Path) -> str:
    """A journal's header alone.

    Raises:
        JournalProblem: it is no journal or its header is damaged.
        OSError: the file cannot be read.
    """
    with path.open("rb") as file:
        start = file.read(HEADER.size)
        if len(start) == HEADER.size:
            start += file.read(min(HEADER.unpack(start)[1], LARGEST_BLOCK_BYTES))
    return _header(start, str(path))[0]


def parse_journal(data: bytes, name: str = "journal") -> JournalContent:
    """The same for bytes already read.

    Raises:
        JournalProblem: it is no journal or its header is damaged.
    """
    blocks: list[NDArray[Any]] = []
    content = scan_journal(data, name, blocks.append)
    return replace(content, records=joined(blocks))


def joined(blocks: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Blocks of records one after the other, (n,) of `RECORD_DTYPE`; as bytes: by fields it takes 25 times as long."""
    return np.frombuffer(bytearray().join(block.tobytes() for block in blocks), RECORD_DTYPE)


def scan_journal(data: bytes | mmap, name: str, take: Callable[[NDArray[Any]], None]) -> JournalContent:
    """Walk through a journal without keeping its samples.

    Args:
        data: the whole journal, in memory or mapped.
        name: for messages.
        take: is given the samples (n,) of each right block, in the order of arrival.

    Returns:
        Everything but the samples.

    Raises:
        JournalProblem: it is no journal or its header is damaged.
    """
    context, position = _header(data, name)
    walk = _Walk(take)
    released = 0
    while position < len(data):
        if position - released >= RELEASED_BYTES:
            released = release(data, released, position)
        size = _take_block(data, position, walk)
        if size == 0:
            following = data.find(BLOCK_MAGIC, position + 1)
            walk.damaged += (following if following > 0 else _end_of_data(data, position)) - position
            size = (following if following > 0 else len(data)) - position
        position += size
    nothing = np.zeros(0, RECORD_DTYPE)
    return JournalContent(context, nothing, tuple(walk.events), walk.end, walk.missing, walk.damaged)


def release(data: bytes | mmap, start: int, stop: int) -> int:
    """Let the pages of a mapped journal between two places leave memory; gives the place up to which they did.

    Args:
        data: the journal, in memory or mapped.
        start: a multiple of `RELEASED_BYTES`.
        stop: rounded down to one.
    """
    stop -= stop % RELEASED_BYTES
    if isinstance(data, mmap) and stop > start and hasattr(memory, "MADV_DONTNEED"):
        data.madvise(memory.MADV_DONTNEED, start, stop - start)
    return stop


def _end_of_data(data: bytes | mmap, start: int) -> int:
    """Where the zeros of the reserved room begin."""
    end = len(data)
    while end > start:
        first = max(start, end - SCANNED_BYTES)
        kept = len(data[first:end].rstrip(b"\0"))
        if kept:
            return first + kept
        end = first
    return start


def _header(data: bytes | mmap, name: str) -> tuple[str, int]:
    if len(data) < HEADER.size:
        raise JournalProblem(f"{name}: {len(data)} bytes are too few for a journal header")
    magic, length, check = HEADER.unpack_from(data)
    text = data[HEADER.size:HEADER.size + length]
    if magic != HEADER_MAGIC:
        raise JournalProblem(f"{name}: this is not a journal: it begins with {magic!r}, expected {HEADER_MAGIC!r}")
    if len(text) != length or zlib.crc32(text) != check:
        raise JournalProblem(f"{name}: the header is damaged or truncated")
    return text.decode("utf-8", "replace"), HEADER.size + length


def _take_block(data: bytes | mmap, position: int, walk: _Walk) -> int:
    """Take the block at `position` if every check fits; return its size, 0 when there is no right block here.

    Blocks never move, so a block's index cannot be greater than the room before it allows.
    """
    if position + BLOCK.size > len(data):
        return 0
    magic, kind, zero, index, length, check = BLOCK.unpack_from(data, position)
    if magic != BLOCK_MAGIC or length > LARGEST_BLOCK_BYTES or not walk.next_index <= index <= position // BLOCK.size:
        return 0
    body = data[position + BLOCK.size:position + BLOCK.size + length]
    if len(body) != length or zlib.crc32(body, zlib.crc32(CHECKED.pack(kind, zero, index, length))) != check:
        return 0
    if not _took(kind, body, walk):
        return 0
    walk.missing += index - walk.next_index
    walk.next_index = index + 1
    return int(BLOCK.size + length)


def _took(kind: int, body: bytes, walk: _Walk) -> bool:
    """Take a block's content; False for content that no recorder writes, which is damage whatever its check says."""
    if kind == RECORDS:
        if len(body) % RECORD_DTYPE.itemsize:
            return False
        walk.take(np.frombuffer(body, RECORD_DTYPE))
        return True
    if kind not in {EVENT, END}:
        return True  # of a later version
    try:
        record = json.loads(body)
        if kind == END:
            walk.end = _end(record)
        else:
            walk.events.append(_event(record))
    except (ValueError, TypeError, KeyError, RecursionError):
        return False
    return True


def _event(record: Any) -> Event:  # noqa: ANN401 - whatever JSON holds
    """An event as `JournalWriter.event` writes it.

    Raises:
        ValueError: it is not.
        TypeError: it is not even a JSON object.
        KeyError: something of it is missing.
    """
    time_ns, code, text = record["time_ns"], record["code"], record["text"]
    if type(time_ns) is not int or not 0 <= time_ns < 1 << 62 or not isinstance(code, str) or not isinstance(text, str):
        raise ValueError(f"not an event: {record!r:.80}")
    return Event(time_ns, code, text)


def _end(record: Any) -> dict[str, Any]:  # noqa: ANN401 - whatever JSON holds
    """The end of a point as `JournalWriter.close` writes it.

    Raises:
        ValueError: it is not.
        TypeError: it is not even a JSON object.
        KeyError: something of it is missing.
    """
    stopped_by, lost = record["stopped_by"], record["lost_records"]
    if not (stopped_by is None or isinstance(stopped_by, str)) or type(lost) is not int or not 0 <= lost < 1 << 62:
        raise ValueError(f"this entry is not a valid end of a point: {record!r:.80}")
    return {"stopped_by": stopped_by, "lost_records": lost}

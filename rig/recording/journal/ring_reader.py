"""Reading the station's ring with numpy: new records since the last call, by channel, and the number of lost ones.

The layout is drawn in `drivers.ring`. The writer raises the reserved index, fills the slots, publishes the write index;
a reader copies first and reads the reserved index afterwards: records that may have been overwritten count as lost.
"""

from __future__ import annotations

import mmap
import struct
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import (
    HEADER_SIZE,
    MAGIC,
    OFFSET_HEARTBEAT,
    OFFSET_PID,
    OFFSET_RECORD_SIZE,
    OFFSET_RECORDER_CURSOR,
    OFFSET_RESERVED_INDEX,
    OFFSET_WRITE_INDEX,
    RECORD_SIZE,
)
from rig.recording.ring_records import RECORD_DTYPE


class RingProblem(OSError):
    """The ring's file is missing, too short, or not one of ours."""


class RingReader:
    """One reader's view of the ring, from the newest record on; `lost` counts what was overwritten unread.

    Args:
        path: the ring's file.
        recorder: True for the one reader that publishes its cursor, which the station watches.
        earlier: read the records that are already there, too: the newest ones, at most half of the capacity.

    Raises:
        RingProblem: the file is not a ring; the message says what was found.
    """

    def __init__(self, path: Path, *, recorder: bool = False, earlier: bool = False) -> None:
        self.path = path
        self.lost = 0
        self._recorder = recorder
        try:
            with path.open("r+b" if recorder else "rb") as file:
                access = mmap.ACCESS_WRITE if recorder else mmap.ACCESS_READ
                self._map = mmap.mmap(file.fileno(), 0, access=access)
        except (OSError, ValueError) as error:
            raise RingProblem(f"{path}: the ring buffer cannot be mapped: {error}") from error
        self.capacity = self._check_header()
        # Aligned 8-byte items: one load or store each, never torn.
        self._header = memoryview(self._map)[:HEADER_SIZE].cast("Q")
        self._records: NDArray[Any] = np.frombuffer(self._map, RECORD_DTYPE, self.capacity, HEADER_SIZE)
        # The writer overwrites the oldest half while the rest is read for the first time.
        self.cursor = max(0, self.write_index - self.capacity // 2) if earlier else self.write_index

    def _check_header(self) -> int:
        header = self._map[:HEADER_SIZE]
        if len(header) < HEADER_SIZE or header[:8] != MAGIC:
            raise RingProblem(f"{self.path}: this is not a ring buffer: expected the magic number {MAGIC!r}, got "
                f"{header[:8]!r}")
        size, capacity = struct.unpack_from("<II", header, OFFSET_RECORD_SIZE)
        expected = HEADER_SIZE + capacity * RECORD_DTYPE.itemsize
        if size != RECORD_DTYPE.itemsize or capacity == 0 or len(self._map) < expected:
            raise RingProblem(
                f"{self.path}: expected records of {RECORD_DTYPE.itemsize} bytes and {expected} bytes in total, got "
                f"records of {size} and {len(self._map)} bytes",
            )
        return int(capacity)

    @property
    def write_index(self) -> int:
        """Number of records ever written."""
        return self._unsigned(OFFSET_WRITE_INDEX)

    def _unsigned(self, offset: int) -> int:
        return self._header[offset // 8]

    @property
    def writer_heartbeat_ns(self) -> int:
        """Host time of the writer's last sign of life (monotonic ns)."""
        return self._unsigned(OFFSET_HEARTBEAT)

    @property
    def writer_pid(self) -> int:
        """Process id of the station."""
        return int(struct.unpack_from("<I", self._map, OFFSET_PID)[0])

    @property
    def unread(self) -> int:
        """Records written and not yet read."""
        return self.write_index - self.cursor

    def read(self, limit: int | None = None) -> NDArray[Any]:
        """Copy of the records since the last read, oldest first, (n,) of `RECORD_DTYPE`; empty when there are none.

        Args:
            limit: at most this many records; None for all.
        """
        start, end = self._unread(limit)
        first, last = start % self.capacity, end % self.capacity
        if start == end:
            records = self._records[:0].copy()
        elif first < last:
            records = self._records[first:last].copy()
        else:
            records = np.concatenate((self._records[first:], self._records[:last]))
        return records[self._taken(start, end) :]

    def read_bytes(self) -> bytes:
        """Like `read`, but returns bytes; for few records, this takes a tenth of the time."""
        start, end = self._unread()
        first, last = (HEADER_SIZE + RECORD_SIZE * (index % self.capacity) for index in (start, end))
        if start == end:
            records = b""
        elif first < last:
            records = self._map[first:last]
        else:
            records = self._map[first : HEADER_SIZE + RECORD_SIZE * self.capacity] + self._map[HEADER_SIZE:last]
        return records[RECORD_SIZE * self._taken(start, end) :]

    def _unread(self, limit: int | None = None) -> tuple[int, int]:
        """Range of the records to copy."""
        end = self.write_index
        start = max(self.cursor, end - self.capacity)
        return start, end if limit is None else min(end, start + limit)

    def _taken(self, start: int, end: int) -> int:
        """Mark these records as read; return the number of records that may have been overwritten during the copy."""
        reserved = max(self.write_index, self._unsigned(OFFSET_RESERVED_INDEX))
        overwritten = min(max(0, reserved - self.capacity - start), end - start)
        self.lost += start + overwritten - self.cursor
        self.cursor = end
        if self._recorder:
            self._header[OFFSET_RECORDER_CURSOR // 8] = end
        return overwritten

    def skip_to_newest(self) -> None:
        """Forget what was not read; it is not counted as lost."""
        self.cursor = self.write_index

    def close(self) -> None:
        """Release the mapping."""
        self._records = np.zeros(0, RECORD_DTYPE)
        self._header.release()
        self._map.close()

    def __enter__(self) -> RingReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None,
    ) -> None:
        self.close()


class RecordBlock:
    """Some records of the ring, divided by channel once for all readers of some of them.

    Attributes:
        records: (n,) of `RECORD_DTYPE`, oldest first.
        newest: the last record of every channel in it, by ascending channel.
    """

    def __init__(self, records: NDArray[Any]) -> None:
        self.records = records
        self._sorted = self.newest = records
        self._places: dict[int, slice] = {}
        if len(records):
            self._sorted = records.take(records["channel"].argsort(kind="stable"))
            channels = self._sorted["channel"]
            last = [*(channels[1:] != channels[:-1]).nonzero()[0].tolist(), len(records) - 1]
            self.newest = self._sorted.take(last)
            ends = [index + 1 for index in last]
            places = map(slice, [0, *ends], ends)
            self._places = dict(zip(self.newest["channel"].tolist(), places, strict=True))

    def __len__(self) -> int:
        return len(self.records)

    def __contains__(self, channel: int) -> bool:
        return channel in self._places

    def place(self, channel: int) -> slice:
        """Where a channel's records are in `values`."""
        return self._places.get(channel, slice(0, 0))

    @property
    def values(self) -> NDArray[np.float64]:
        """Their values (SI), in the same order, (n,)."""
        values: NDArray[np.float64] = self._sorted["value"]
        return values

    def of(self, channel: int) -> NDArray[Any]:
        """The records of one channel, oldest first, as a view of all; empty when there are none."""
        return self._sorted[self._places.get(channel, slice(0, 0))]

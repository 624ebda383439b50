"""The ring: fixed-size records in a memory-mapped file, one writer, any number of readers.

    offset  size  header (4096 bytes, little-endian)
       0      8   magic "MRRING01"
       8      4   record size u32 (32)
      12      4   capacity u32, records
      16      8   write index u64: records published since the start
      24      8   recorder cursor u64: records the recorder has taken; the only place a reader writes
      32      8   writer heartbeat i64, ns, monotonic
      40      4   station process id u32
      48      8   reserved index u64: records published or just being written

    record "<qqdIHH":  host_ns | device_us | value | sequence | channel | flags

Record number n lies in slot n modulo capacity. The writer raises the reserved index, writes the records, then raises
the write index. A reader takes records up to the write index, then looks at the reserved index again: records older
than `reserved - capacity` may have been overwritten while it copied, and count as lost.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import struct
import threading
from collections.abc import Sequence
from enum import IntEnum
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Self

from drivers.posix import fcntl

MAGIC = b"MRRING01"
HEADER_SIZE = 4096
RECORD = struct.Struct("<qqdIHH")
RECORD_SIZE = RECORD.size
DEFAULT_CAPACITY = 1 << 19

OFFSET_RECORD_SIZE = 8
OFFSET_WRITE_INDEX = 16
OFFSET_RECORDER_CURSOR = 24
OFFSET_HEARTBEAT = 32
OFFSET_PID = 40
OFFSET_RESERVED_INDEX = 48

NO_DEVICE_TIME = -1
"""`device_us` of a record whose device has no clock."""

Record = tuple[int, int, float, int, int, int]
"""(host_ns, device_us, value, sequence, channel, flags); sequence modulo 2^32."""

_SEQUENCE_MASK = 0xFFFFFFFF
_LARGEST_BATCH_STRUCT = 128


class Channel(IntEnum):
    """What a record is about: its number, the SI unit of its values, one line for people.

    3..9 are the auxiliary channels, 42..48 their edges; the unit of an auxiliary channel is in the bench file.
    """

    unit: str
    long_name: str

    def __new__(cls, number: int, unit: str = "1", long_name: str = "") -> Self:
        """A channel; `Channel(number)` gives the one with this number."""
        channel = int.__new__(cls, number)
        channel._value_ = number
        channel.unit, channel.long_name = unit, long_name
        return channel

    FORCE = 1, "N", "Force at the load cell"
    DISPLACEMENT = 2, "m", "Damper extension"
    AUXILIARY_1 = 3, "1", "Auxiliary channel 1"
    AUXILIARY_2 = 4, "1", "Auxiliary channel 2"
    AUXILIARY_3 = 5, "1", "Auxiliary channel 3"
    AUXILIARY_4 = 6, "1", "Auxiliary channel 4"
    AUXILIARY_5 = 7, "1", "Auxiliary channel 5"
    AUXILIARY_6 = 8, "1", "Auxiliary channel 6"
    AUXILIARY_7 = 9, "1", "Auxiliary channel 7"
    COIL_CURRENT = 10, "A", "Coil current"
    COIL_TEMPERATURE = 11, "degC", "Coil temperature"
    ECU_TEMPERATURE = 12, "degC", "Temperature of the current source"
    ECU_SUPPLY = 13, "V", "Supply voltage of the current source"
    ECU_STATE = 14, "1", "State of the current source"
    ECU_FAULTS = 15, "1", "Fault bits of the current source"
    COMMANDED_CURRENT = 16, "A", "Commanded coil current"
    POSITION = 20, "m", "Position measured by the actuator controller's own sensor"
    VELOCITY = 21, "m/s", "Velocity reported by the actuator controller"
    SETPOINT = 22, "m", "Set-point of the actuator controller"
    STATE = 23, "1", "State of the actuator controller"
    CYCLES_DONE = 24, "1", "Whole cycles of the running program"
    FAULT_BITS = 25, "1", "Fault bits of the actuator controller"
    SUPPLY_PRESSURE = 26, "Pa", "Hydraulic supply pressure"
    ACCUMULATOR_PRESSURE = 27, "Pa", "Accumulator pressure"
    PULSE = 28, "1", "Cycle pulses: count and the controller's clock at the pulse"
    PHASE = 29, "1", "Phase of the running program"
    INPUTS = 30, "1", "Digital inputs of the actuator controller"
    SERVO_ERROR = 31, "m", "Following error of the servo loop"
    CONTROLLER_FORCE = 32, "N", "Coarse force input of the actuator controller"
    FORCE_EDGE = 40, "1", "Cycle pulses latched by the load cell's clock"
    DISPLACEMENT_EDGE = 41, "1", "Cycle pulses latched by the displacement sensor's clock"
    AUXILIARY_1_EDGE = 42, "1", "Cycle pulses latched by auxiliary channel 1"
    AUXILIARY_2_EDGE = 43, "1", "Cycle pulses latched by auxiliary channel 2"
    AUXILIARY_3_EDGE = 44, "1", "Cycle pulses latched by auxiliary channel 3"
    AUXILIARY_4_EDGE = 45, "1", "Cycle pulses latched by auxiliary channel 4"
    AUXILIARY_5_EDGE = 46, "1", "Cycle pulses latched by auxiliary channel 5"
    AUXILIARY_6_EDGE = 47, "1", "Cycle pulses latched by auxiliary channel 6"
    AUXILIARY_7_EDGE = 48, "1", "Cycle pulses latched by auxiliary channel 7"
    TRIP = 50, "1", "Interlock trips"
    LOOP_LATE = 51, "s", "Delay of the station's loop"
    HYBRID_TIME = 60, "s", "Hybrid test: simulated time since the start of the road"
    HYBRID_TARGET = 61, "m", "Hybrid test: target position of the specimen relative to its centre"
    HYBRID_SEEN = 62, "m", "Hybrid test: measured position of the specimen at each step, relative to its centre"
    HYBRID_BODY = 63, "m", "Hybrid test: calculated height of the body"
    HYBRID_WHEEL = 64, "m", "Hybrid test: calculated height of the wheel"
    SIGNAL_TIME = 65, "s", "Signal: time of each set-point since the start of the signal"
    SIGNAL_TARGET = 66, "m", "Signal: target position of the rod at each set-point, relative to the centre"
    SIGNAL_COMMAND = 67, "m", "Signal: iterated command at each set-point, relative to the centre"
    SIGNAL_FORCE = 68, "N", "Signal: target force at each set-point"

    @property
    def label(self) -> str:
        """Its name in recordings, such as `coil_current`."""
        return self.name.lower()


CHANNELS = {channel.label: channel for channel in Channel}
"""By name in recordings."""
_NUMBERS = frozenset(int(channel) for channel in Channel)
_UNKNOWN = "channel_"


def channel_name(number: int) -> str:
    """Name in recordings of the channel with this number; `channel_<number>` of one that this version does not know."""
    return Channel(number).label if number in _NUMBERS else f"{_UNKNOWN}{number}"


def channel_number(name: str) -> int:
    """The number of the channel that `channel_name` names.

    Raises:
        ValueError: no channel has this name.
    """
    return CHANNELS[name] if name in CHANNELS else int(name.removeprefix(_UNKNOWN))


def edge_channel(channel: int) -> Channel:
    """The channel that carries the sync edges of a sensor channel 1..9.

    Raises:
        ValueError: not a sensor channel.
    """
    if not Channel.FORCE <= channel <= Channel.AUXILIARY_7:
        raise ValueError(f"channel {channel} is not a sensor channel (1 to 9)")
    return Channel(channel + Channel.FORCE_EDGE - Channel.FORCE)


def ring_bytes(capacity: int) -> int:
    """Size of the file of a ring of so many records."""
    return HEADER_SIZE + capacity * RECORD_SIZE


class RingWriter:
    """Creates the ring file and appends to it; safe to share among the station's threads.

    Args:
        path: file to create; an existing one is replaced. It is locked (`flock`) for as long as the writer lives.
        capacity: records the ring holds before it overwrites the oldest.

    Attributes:
        overruns: records overwritten before the recorder had taken them (0 while no recorder moves its cursor).

    Raises:
        ValueError: a capacity that no ring has.
        OSError: the file cannot be made, or there is no room for it.
    """

    def __init__(self, path: Path | str, capacity: int = DEFAULT_CAPACITY) -> None:
        if not 1 <= capacity <= 0xFFFFFFFF:
            raise ValueError(f"ring capacity {capacity} is outside the range 1 to 2^32-1 records")
        target = Path(path)
        size = ring_bytes(capacity)
        # A new file each time: readers of an older ring keep theirs.
        fresh = target.with_name(target.name + ".new")
        try:
            with fresh.open("w+b") as file:
                # Ends with this process however it dies; a process that can take the lock may remove the file.
                fcntl.flock(file.fileno(), fcntl.LOCK_EX)
                # Real blocks, not a sparse file: a full disk shows here, not as SIGBUS in the middle of a test.
                os.posix_fallocate(file.fileno(), 0, size)
                mapped = mmap.mmap(file.fileno(), size)
                self._lock_handle = os.dup(file.fileno())
        except OSError:
            fresh.unlink(missing_ok=True)
            raise
        struct.pack_into("<8sII", mapped, 0, MAGIC, RECORD_SIZE, capacity)
        self.path = target
        self.capacity = capacity
        self._map = mapped
        self._view = memoryview(mapped)
        # Aligned 8-byte items: one store or load each, never torn.
        self._u64 = self._view[:HEADER_SIZE].cast("Q")
        self._i64 = self._view[:HEADER_SIZE].cast("q")
        self._u32 = self._view[:HEADER_SIZE].cast("I")
        self._u32[OFFSET_PID // 4] = os.getpid()
        fresh.replace(target)
        self._lock = threading.Lock()
        self._count = 0
        self._batches = [struct.Struct("<" + "qqdIHH" * n) for n in range(_LARGEST_BATCH_STRUCT + 1)]
        self.overruns = 0

    @property
    def write_index(self) -> int:
        """Records published since the start."""
        return self._u64[OFFSET_WRITE_INDEX // 8]

    @property
    def recorder_cursor(self) -> int:
        """Records the recorder has taken."""
        return self._u64[OFFSET_RECORDER_CURSOR // 8]

    def append(self, batch: Sequence[Record]) -> None:
        """Publish records, in order, all at once.

        Args:
            batch: records; `sequence` is stored modulo 2^32. Nothing happens for an empty batch.

        Raises:
            struct.error: a field does not fit its record; that record and those behind it are not published.
        """
        with self._lock:
            for start in range(0, len(batch), _LARGEST_BATCH_STRUCT):
                self._publish(batch[start : start + _LARGEST_BATCH_STRUCT])

    def close(self) -> None:
        """Unmap the file and let go of its lock; closing twice is harmless."""
        for view in (self._u64, self._i64, self._u32, self._view):
            view.release()
        self._map.close()
        if self._lock_handle >= 0:
            os.close(self._lock_handle)
            self._lock_handle = -1

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def remove(self) -> None:
        """Close the ring and take its file away; readers that have it mapped keep what they have not read."""
        with contextlib.suppress(FileNotFoundError):
            if os.stat(self.path).st_ino == os.fstat(self._lock_handle).st_ino:
                self.path.unlink()
        self.close()

    @property
    def unread_share(self) -> float:
        """Share of the ring the recorder has not taken; more than 1 once it lost some, 0 while there is no recorder."""
        cursor = self.recorder_cursor
        return (self.write_index - cursor) / self.capacity if cursor else 0.0

    def beat(self, now_ns: int) -> None:
        """Show that the writer lives.

        Args:
            now_ns: monotonic time.
        """
        self._i64[OFFSET_HEARTBEAT // 8] = now_ns

    def _publish(self, batch: Sequence[Record]) -> None:
        """Write up to one batch struct of records, split where the ring wraps."""
        first, after = self._count, self._count + len(batch)
        self._u64[OFFSET_RESERVED_INDEX // 8] = after
        slot = first % self.capacity
        room = self.capacity - slot
        while batch:
            part, batch = batch[:room], batch[room:]
            self._batches[len(part)].pack_into(self._map, HEADER_SIZE + slot * RECORD_SIZE, *chain.from_iterable(part))
            slot, room = 0, self.capacity
        self._u64[OFFSET_WRITE_INDEX // 8] = after
        self._count = after
        cursor = self.recorder_cursor
        if cursor and after - cursor > self.capacity:
            self.overruns += min(after - first, after - cursor - self.capacity)

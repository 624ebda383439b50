"""Splits a byte stream into the frames of a described binary format, and these into readings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

from protocols.binary_format import MOST_DECIMALS, BinaryFormat, scaled
from protocols.e2e import BEYOND
from protocols.frame_format import DEVICE_US_MODULUS, SEQUENCE_MODULUS, STATUS_SENSOR_FAULT, Reading

_NO_CLOCK = -1
_SLIP = {0xDC: 0xC0, 0xDD: 0xDB}
_DLE = 0x10


class BinaryDecoder:
    """Splits a byte stream into readings; a chunk may begin and end anywhere.

    Bytes that belong to no valid frame are skipped and counted, so one damaged byte costs one frame. Frames without a
    checksum are believed only where the next one begins right behind them. A format without a sequence number counts
    frames, damaged ones too.

    Args:
        binary_format: the frames.
        answers: every frame answers a request and stands alone: no next one has to follow.

    Attributes:
        bad_frames: frames that began right and were damaged.
        skipped_bytes: bytes that belonged to no valid frame.
    """

    def __init__(self, binary_format: BinaryFormat, *, answers: bool = False) -> None:
        self.binary_format = binary_format
        self.bad_frames = 0
        self.skipped_bytes = 0
        self._rest = b""
        self._content: bytearray | None = None
        self._escaped = False
        self._weak = not answers and binary_format.checksum == "none" and not binary_format.packed
        self._locked = False
        self._meaning = FrameMeaning(binary_format)
        self._frames = self._by_length if binary_format.stuffing == "none" else self._by_stuffing
        if binary_format.can is not None:
            self._frames = self._by_message

    def feed(self, chunk: bytes) -> list[Reading]:
        """Take bytes as they arrived; return every frame they complete, in order.

        Args:
            chunk: any number of bytes.
        """
        meaning = self._meaning
        readings: list[Reading] = []
        bad = self.bad_frames
        for frame in self._frames(chunk):
            meaning.damaged(self.bad_frames - bad)
            bad = self.bad_frames
            readings.append(meaning.reading(frame))
        meaning.damaged(self.bad_frames - bad)
        return readings

    def clear(self) -> None:
        """Forget the unfinished tail (after the port was reopened or its input discarded)."""
        self._rest, self._content, self._escaped, self._locked = b"", None, False, False

    def _by_length(self, chunk: bytes) -> Iterator[bytes]:
        """Frames of a fixed length through data in which not everything is a frame."""
        layout, data, at = self.binary_format, self._rest + chunk, 0
        size, sync = layout.length, layout.sync
        while at + size <= len(data):
            frame = data[at : at + size]
            if layout.intact(frame):
                following = data[at + size : at + size + len(sync)]
                if self._weak and not self._locked:
                    if len(following) < len(sync):
                        break
                    if following != sync:
                        at = self._skip(data, at)
                        continue
                self._locked = True
                at += size
                yield frame
                continue
            if self._locked or (sync and frame.startswith(sync)):
                self.bad_frames += 1
            self._locked = False
            at = self._skip(data, at)
        self._rest = data[at:]

    def _by_message(self, chunk: bytes) -> Iterator[bytes]:
        """Split rows of `protocols.can_frame` into the frames of a CAN message."""
        layout, message = self.binary_format, self.binary_format.can
        if message is None:
            return
        data, size = self._rest + chunk, 1 + message.size
        whole = len(data) - len(data) % size
        self._rest = data[whole:]
        for at in range(0, whole, size):
            frame, protection = data[at + 1 : at + size], message.protection
            intact = data[at] == message.size and layout.intact(frame)
            if intact and protection.fits(frame) and protection.count(frame) != BEYOND:
                if message.is_on_page(frame):
                    yield frame
            else:
                self.bad_frames += 1

    def _skip(self, data: bytes, at: int) -> int:
        """Place of the next possible frame start after `at`; counts what is skipped."""
        start, sync = at + 1, self.binary_format.sync
        if sync:
            start = data.find(sync, at + 1)
            if start < 0:
                # The data may end inside of a sync.
                ends = [len(data) - count for count in range(1, len(sync)) if data.endswith(sync[:count])]
                start = max(at + 1, min(ends, default=len(data)))
        self.skipped_bytes += start - at
        return start

    def _by_stuffing(self, chunk: bytes) -> Iterator[bytes]:
        """Frames between a start and an end, in whose content neither occurs as it is."""
        for byte in chunk:
            event, content = self._unstuffed(byte)
            if event == "byte" and self._content is not None:
                self._content.append(content)
                if len(self._content) > self.binary_format.length:
                    self._give_up()
            elif event == "start":
                self._give_up()
                self._content = bytearray()
            elif event == "end" and self._content is not None:
                frame = self.binary_format.sync + bytes(self._content) + self.binary_format.end
                whole = len(frame) == self.binary_format.length and self.binary_format.intact(frame)
                shared = self.binary_format.sync in {b"", self.binary_format.end}
                if whole:
                    self._content = bytearray() if shared else None
                    yield frame
                    continue
                self._give_up()
                self._content = bytearray() if shared else None
            elif event != "none":
                if event == "end" and self.binary_format.sync in {b"", self.binary_format.end}:
                    self._content = bytearray()
                self.skipped_bytes += 1

    def _give_up(self) -> None:
        """What has come of a frame is damaged, if anything has come."""
        if self._content:
            self.bad_frames += 1
            self.skipped_bytes += len(self._content)
        self._content = None

    def _unstuffed(self, byte: int) -> tuple[str, int]:
        """What a byte is: "start", "end", a "byte" of content, "none" (an escape), or "bad"."""
        layout, escaped, self._escaped = self.binary_format, self._escaped, False
        if layout.stuffing == "dle":
            if not escaped:
                self._escaped = byte == _DLE
                return ("none", 0) if self._escaped else ("byte", byte)
            marks = {_DLE: "byte", layout.sync[-1]: "start", layout.end[-1]: "end"}
            return self._or_bad(marks.get(byte, "bad")), byte
        escape = 0xDB if layout.stuffing == "slip" else layout.escape
        if escaped:
            if layout.stuffing == "slip":
                return (self._or_bad("byte" if byte in _SLIP else "bad"), _SLIP.get(byte, 0))
            return "byte", byte ^ layout.escape_xor
        if byte == escape:
            self._escaped = True
            return "none", 0
        if layout.end and byte == layout.end[0]:
            return "end", byte
        return ("start", byte) if layout.sync and byte == layout.sync[0] else ("byte", byte)

    def _or_bad(self, event: str) -> str:
        if event == "bad":
            self._give_up()
        return event


class FrameMeaning:
    """From a frame's bytes to a reading: value, status, and counters that are wider than the frame's own."""

    def __init__(self, binary_format: BinaryFormat) -> None:
        fields = binary_format.fields
        self._value, self._value_of = fields["value"], binary_format.getter("value")
        self._status = fields.get("status")
        self._status_of = binary_format.getter("status") if "status" in fields else None
        self._sequence = self._counter(binary_format, "sequence")
        self._time = self._counter(binary_format, "time")
        self._tick_us = fields["time"].scale if "time" in fields else 1.0
        self._decimals = fields.get("decimals")
        self._decimals_of = binary_format.getter("decimals") if "decimals" in fields else None
        self._count = 0

    @staticmethod
    def _counter(binary_format: BinaryFormat, name: str) -> Callable[[bytes], int] | None:
        """A counter of any width as one that goes on."""
        if name not in binary_format.fields:
            return None
        get, modulus = binary_format.getter(name), binary_format.modulus(name)
        total: list[int] = []

        def unwrapped(frame: bytes) -> int:
            raw = int(get(frame))
            if not total:
                total.append(raw)
            step = (raw - total[0]) % modulus
            total[0] += step - modulus if step > modulus // 2 else step
            return total[0]

        return unwrapped

    def damaged(self, count: int) -> None:
        """So many frames could not be read."""
        self._count += count

    def reading(self, frame: bytes) -> Reading:
        """One reading."""
        self._count += 1
        number = self._count if self._sequence is None else self._sequence(frame)
        clock = _NO_CLOCK if self._time is None else int(self._time(frame) * self._tick_us) % DEVICE_US_MODULUS
        raw = self._value_of(frame)
        status = self._value.meaning(raw) if self._value.judges else 0
        if self._status is not None and self._status_of is not None:
            status |= self._status.meaning(self._status_of(frame))
        if self._decimals is not None and self._decimals_of is not None:
            places = scaled(self._decimals, self._decimals_of(frame))
            if not 0.0 <= places <= MOST_DECIMALS:
                status |= STATUS_SENSOR_FAULT  # the meaning of the number is unknown
            else:
                raw /= 10.0 ** int(places)
        value = math.nan if status else scaled(self._value, raw)
        return number % SEQUENCE_MODULUS, clock, value, status, 0

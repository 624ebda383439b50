"""Readings as frames of any described binary format, as a device of that format builds them."""

from __future__ import annotations

import dataclasses
import math
import struct

import numpy as np
from numpy.typing import NDArray

from protocols.binary_format import BinaryFormat, Field
from protocols.can_signals import put
from protocols.errors import LocalProtocolError
from protocols.frame_format import STATUS_OVERLOAD, STATUS_SENSOR_FAULT
from simulators.bit_sums import size_of, total_of

Whole = NDArray[np.int64]
_DLE = 0x10
_LETTERS = {"value": "v", "status": "s", "sequence": "n", "time": "t"}


class FrameWriter:
    """Encodes readings as frames of one format.

    Args:
        binary_format: format of the frames.
        low, high: smallest and largest valid reading (in the format's unit).

    Attributes:
        size: bytes of the longest frame; with stuffing, including an appended length; for a CAN message, including a
            leading length (`protocols.can_frame`).

    Raises:
        LocalProtocolError: the format cannot represent these readings.
    """

    def __init__(self, binary_format: BinaryFormat, low: float, high: float) -> None:
        self._format = binary_format
        self._value = binary_format.fields["value"]
        least, most = span_of(binary_format)
        if low < least or high > most:
            raise LocalProtocolError(
                f"{binary_format.name}: values from {low:g} to {high:g} {binary_format.unit} do not fit; this format "
                f"can represent {least:g} to {most:g}"
            )
        self.differ = binary_format.stuffing != "none"
        self._longest = 2 * binary_format.length if self.differ else binary_format.length
        self.size = self._longest + self.differ + (binary_format.can is not None)

    @property
    def is_on_CAN(self) -> bool:
        """Whether the frames are CAN messages."""
        return self._format.can is not None

    def __call__(
        self, value: NDArray[np.float64], status: NDArray[np.uint8], sequence: Whole, stamp_us: Whole
    ) -> NDArray[np.uint8]:
        """Frames (n, size) of readings, status bits, sample numbers and device clock (us), all of shape (n,)."""
        frames = map(self._row, value.tolist(), status.tolist(), sequence.tolist(), stamp_us.tolist())
        return np.frombuffer(b"".join(frames), np.uint8).reshape(len(value), self.size)

    def joined(self, rows: NDArray[np.uint8]) -> bytes:
        """The bytes of such frames on the wire."""
        if not self.differ:
            return rows.tobytes()
        return b"".join(row[: row[-1]].tobytes() for row in rows)

    def _row(self, value: float, status: int, sequence: int, stamp_us: int) -> bytes:
        frame = self._frame(value, status, sequence, stamp_us)
        if not self.differ:
            return frame
        stuffed = self._stuffed(frame)
        return stuffed.ljust(self._longest, b"\0") + bytes([len(stuffed)])

    def _frame(self, value: float, status: int, sequence: int, stamp_us: int) -> bytes:
        layout, fields = self._format, self._format.fields
        raw: dict[str, float] = {"value": self._raw(value, status)}
        if "status" in fields:
            raw["status"] = self._status(fields["status"], status)
        if "sequence" in fields:
            raw["sequence"] = sequence
        if "time" in fields:
            raw["time"] = int(stamp_us / fields["time"].scale)
        if "decimals" in fields:
            raw["decimals"] = round(-fields["decimals"].offset / fields["decimals"].scale)
        if layout.packed:
            return self._packed(raw)
        frame = bytearray(layout.length)
        frame[: len(layout.sync)] = layout.sync
        frame[layout.length - len(layout.end) :] = layout.end
        for name, number in raw.items():
            self._put(frame, fields[name], number)
        if layout.checksum != "none":
            first, last = layout.checksum_over
            total = total_of(layout.checksum, bytes(frame[first : last + 1]))
            size = size_of(layout.checksum)
            digits = [total >> 8 * place & 0xFF for place in range(size)]
            frame[layout.checksum_at : layout.checksum_at + size] = bytes(
                digits if layout.checksum_order == "little" else digits[::-1]
            )
        if layout.can is None:
            return bytes(frame)
        for signal, numbers in layout.can.pages:
            put(frame, signal, min(numbers))
        layout.can.protection.seal(frame, sequence)
        return layout.can.row(bytes(frame))

    def _raw(self, value: float, status: int) -> float:
        """The number that stands for a value, or for what is wrong with it."""
        item = self._value
        if status & STATUS_SENSOR_FAULT and item.fault_values:
            return item.fault_values[0]
        low, high = limits(self._format)
        beyond = bool(status) or not math.isfinite(value)
        if beyond and item.overload_values:
            return item.overload_values[0]
        if item.type.startswith("f"):
            return math.nan if not math.isfinite(value) else (value - item.offset) / item.scale
        if item.valid is not None and beyond:
            whole_low, whole_high = _whole(self._format)
            return whole_high if item.valid[1] < whole_high else whole_low
        number = round((value - item.offset) / item.scale) if math.isfinite(value) else int(high)
        return min(max(number, int(low)), int(high))

    def _status(self, item: Field, status: int) -> int:
        """The status word of a healthy or unhealthy sensor; one that no meaning is attached to where all is well."""
        if status & STATUS_SENSOR_FAULT:
            return item.fault_bits & -item.fault_bits or (item.fault_values or item.overload_values or (0,))[0]
        if status & STATUS_OVERLOAD:
            return item.overload_bits & -item.overload_bits or (item.overload_values or (0,))[0]
        return next(number for number in range(256) if item.meaning(number) == 0)

    def _put(self, frame: bytearray, item: Field, number: float) -> None:
        """A number in its place, among the bits of others."""
        size, big = item.size, item.order == "big"
        if item.words_swapped and size > 2:
            whole = bytearray(item.at + size)
            self._put(whole, dataclasses.replace(item, words_swapped=False), number)
            words = [whole[at : at + 2] for at in range(item.at, item.at + size, 2)]
            frame[item.at : item.at + size] = b"".join(reversed(words))
            return
        if item.type.startswith("f"):
            frame[item.at : item.at + size] = struct.pack(f"{'>' if big else '<'}{'f' if size == 4 else 'd'}", number)
            return
        low, high = item.bits or (0, 8 * size - 1)
        word = (int(number) & (1 << high - low + 1) - 1) << low
        for place in range(size):
            at = item.at + (size - 1 - place if big else place)
            frame[at] |= word >> 8 * place & 0xFF

    def _packed(self, raw: dict[str, float]) -> bytes:
        """The bytes of a packed stream, bit by bit from the last one."""
        layout = self._format
        rest = {_LETTERS[name]: int(number) for name, number in raw.items()}
        frame = [0] * len(layout.packed)
        places = range(len(layout.packed))
        for at in reversed(places) if layout.packed_order == "big" else places:
            for bit, letter in enumerate(reversed(layout.packed[at])):
                digit = int(letter) if letter in "01" else 0
                if letter in rest:
                    digit, rest[letter] = rest[letter] & 1, rest[letter] >> 1
                frame[at] |= digit << bit
        return bytes(frame)

    def _stuffed(self, frame: bytes) -> bytes:
        """The frame as it goes out: what looks like a sync or an end inside of it is hidden."""
        layout = self._format
        inside = frame[len(layout.sync) : len(frame) - len(layout.end)]
        if layout.stuffing == "dle":
            inside = inside.replace(bytes([_DLE]), bytes([_DLE, _DLE]))
        elif layout.stuffing == "slip":
            inside = inside.replace(b"\xdb", b"\xdb\xdd").replace(b"\xc0", b"\xdb\xdc")
        else:
            hidden = {*layout.sync, *layout.end, layout.escape}
            inside = b"".join(
                bytes([layout.escape, byte ^ layout.escape_xor]) if byte in hidden else bytes([byte]) for byte in inside
            )
        return layout.sync + inside + layout.end


def _whole(binary_format: BinaryFormat) -> tuple[float, float]:
    """Lowest and highest number that the value's bits hold."""
    item = binary_format.fields["value"]
    count = binary_format.modulus("value")
    return (-(count // 2), count // 2 - 1) if item.signed else (0, count - 1)


def limits(binary_format: BinaryFormat) -> tuple[float, float]:
    """Lowest and highest number that is a reading."""
    item = binary_format.fields["value"]
    if item.type.startswith("f"):
        return item.valid or (-3.4e38, 3.4e38)
    low, high = _whole(binary_format)
    taken = {*item.overload_values, *item.fault_values}
    while low in taken:
        low += 1
    while high in taken:
        high -= 1
    return (max(low, item.valid[0]), min(high, item.valid[1])) if item.valid else (low, high)


def span_of(binary_format: BinaryFormat) -> tuple[float, float]:
    """The smallest and the largest value, in the format's unit, that a frame can carry."""
    item = binary_format.fields["value"]
    low, high = sorted(raw * item.scale + item.offset for raw in limits(binary_format))
    return low, high

"""The project's own 16-byte sensor frame, little-endian.

     0    1    2        3            4..5        6..9        10..13   14..15
    +----+----+--------+------------+-----------+-----------+--------+--------+
    | A5 | 5A | status | edge_count | sequence  | device_us | value  | crc16  |
    |    |    |  u8    |    u8      |   u16     |   u32     |  f32   |  u16   |
    +----+----+--------+------------+-----------+-----------+--------+--------+

`crc16` is CRC-16/CCITT-FALSE (polynomial 0x1021, start 0xFFFF, not reflected) over bytes 0..13. `device_us` is the
sensor's own clock and wraps after 71.6 minutes; `sequence` counts samples and wraps at 65536. The value is in the
sensor's own unit. In an edge frame (status bit 7) `device_us` is the latched time of the controller's cycle pulse,
`value` is 0, `sequence` repeats the last sample's, and `edge_count` counts pulses modulo 256.
"""

from __future__ import annotations

import struct
from binascii import crc_hqx

from protocols.errors import LocalProtocolError

SIZE = 16
SYNC = b"\xa5\x5a"
SEQUENCE_MODULUS = 1 << 16
DEVICE_US_MODULUS = 1 << 32
EDGE_MODULUS = 1 << 8

STATUS_OVERLOAD = 0x01
STATUS_SENSOR_FAULT = 0x02
STATUS_EDGE = 0x80

BODY = struct.Struct("<2sBBHIf")
"""Bytes 0..13, which the checksum covers."""

Reading = tuple[int, int, float, int, int]
"""(sequence, device_us, value, status, edge_count) as on the wire: nothing unwrapped, nothing scaled."""

_FRAME = struct.Struct("<HBBHIfH")
_CHECKED = struct.Struct("<14sH")
_FIELDS = struct.Struct("<2xBBHIf2x")
_SYNC_WORD = 0x5AA5
_CRC_START = 0xFFFF


def encode(value: float, sequence: int, device_us: int, status: int = 0, edge_count: int = 0) -> bytes:
    """Build one frame.

    Args:
        value: reading in the sensor's own unit (N, mm).
        sequence: sample number, 0..65535.
        device_us: device clock in microseconds, 0..2^32-1.
        status: status bits, 0..255.
        edge_count: pulses latched so far modulo 256.

    Returns:
        The 16 bytes of the frame.

    Raises:
        LocalProtocolError: a field does not fit its place in the frame.
    """
    try:
        body = BODY.pack(SYNC, status, edge_count, sequence, device_us, value)
    except (struct.error, OverflowError) as error:
        raise LocalProtocolError(
            f"frame16: cannot encode value={value!r} sequence={sequence!r} device_us={device_us!r} "
            f"status={status!r} edge_count={edge_count!r}: {error}"
        ) from error
    return body + crc_hqx(body, _CRC_START).to_bytes(2, "little")


class FrameDecoder:
    """Splits a byte stream into frames; a chunk may begin and end anywhere.

    Bytes that do not belong to a valid frame are skipped one sync word at a time and counted, so one damaged byte
    costs one frame. Random bytes pass sync and checksum with a chance of 2^-32 a position.

    Attributes:
        bad_frames: frames whose sync word was right and whose checksum was wrong.
        skipped_bytes: bytes that belonged to no valid frame.
    """

    def __init__(self) -> None:
        self.bad_frames = 0
        self.skipped_bytes = 0
        self._rest = b""

    def feed(self, chunk: bytes) -> list[Reading]:
        """Take bytes as they arrived; return every frame they complete, in order.

        Args:
            chunk: any number of bytes.

        Returns:
            One `Reading` tuple a frame. The unfinished tail is kept for the next call.
        """
        data = self._rest + chunk if self._rest else chunk
        end = len(data) - len(data) % SIZE
        whole = data if end == len(data) else data[:end]
        if _all_valid(whole):
            self._rest = data[end:]
            return [
                (sequence, device_us, value, status, edge_count)
                for status, edge_count, sequence, device_us, value in _FIELDS.iter_unpack(whole)
            ]
        return self._search(data)

    def clear(self) -> None:
        """Forget the unfinished tail (after the port was reopened or its input discarded)."""
        self._rest = b""

    def _search(self, data: bytes) -> list[Reading]:
        """Frame by frame through data in which not everything is a frame."""
        readings: list[Reading] = []
        at, last = 0, len(data) - SIZE
        while at <= last:
            sync, status, edge_count, sequence, device_us, value, check = _FRAME.unpack_from(data, at)
            if sync == _SYNC_WORD:
                if crc_hqx(data[at : at + 14], _CRC_START) == check:
                    readings.append((sequence, device_us, value, status, edge_count))
                    at += SIZE
                    continue
                self.bad_frames += 1
            at = self._resynchronise(data, at)
        self._rest = data[at:]
        return readings

    def _resynchronise(self, data: bytes, at: int) -> int:
        """Place of the next possible frame start after `at`; counts what is skipped."""
        start = data.find(SYNC, at + 1)
        if start < 0:
            start = len(data) - 1 if data.endswith(SYNC[:1]) else len(data)
            start = max(start, at + 1)
        self.skipped_bytes += start - at
        return start


def _all_valid(data: bytes) -> bool:
    """Whether the data, a whole number of frame lengths, are valid frames from first to last."""
    count = len(data) // SIZE
    if data[::SIZE] != SYNC[:1] * count or data[1::SIZE] != SYNC[1:] * count:
        return False
    return False not in [crc_hqx(body, _CRC_START) == check for body, check in _CHECKED.iter_unpack(data)]

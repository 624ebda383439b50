"""Many 16-byte sensor frames at once, compiled; the layout is `protocols.frame_format`'s."""

from __future__ import annotations

import math
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.frame_format import SIZE
from rig.dampers.compiled_cache import njit
from rig.dampers.kernel import cached

FloatArray = NDArray[np.float64]
POLYNOMIAL = 0x1021


def _crc_table() -> NDArray[np.uint16]:
    """Table of CRC-16/CCITT for one byte, most significant bit first."""
    table = np.zeros(256, np.uint16)
    for byte in range(256):
        crc = byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ POLYNOMIAL if crc & 0x8000 else crc << 1
        table[byte] = crc & 0xFFFF
    return table


CRC_TABLE = _crc_table()


SYNC_BYTES = (0xA5, 0x5A)


@njit()
def _put(frame: NDArray[np.uint8], status: int, edge_count: int, sequence: int, device_us: int, word: int) -> None:
    frame[0], frame[1] = SYNC_BYTES
    frame[2] = status
    frame[3] = edge_count & 0xFF
    for j in range(2):
        frame[4 + j] = (sequence >> 8 * j) & 0xFF
    for j in range(4):
        frame[6 + j] = (device_us >> 8 * j) & 0xFF
        frame[10 + j] = (word >> 8 * j) & 0xFF
    crc = 0xFFFF
    for j in range(14):
        crc = ((crc << 8) & 0xFFFF) ^ int(CRC_TABLE[(crc >> 8) ^ int(frame[j])])
    frame[14] = crc & 0xFF
    frame[15] = crc >> 8


def _encoders(key: int) -> tuple[Any, Any]:
    """Both ways to many frames; closures over what tells this `_put` apart, so that what is kept of them is of it."""

    def encode_frames(
        status: NDArray[np.uint8], edge_count: NDArray[np.int64], sequence: NDArray[np.int64],
        device_us: NDArray[np.int64], value: FloatArray,
    ) -> NDArray[np.uint8]:
        frames = np.empty((len(value) + 0 * key, SIZE), np.uint8)
        words = value.astype(np.float32).view(np.uint32)
        for i in range(len(value)):
            _put(frames[i], status[i], edge_count[i], sequence[i], device_us[i], words[i])
        return frames

    def encode_samples(
        status: NDArray[np.uint8], edges: int, first: int, device_us: FloatArray, value: FloatArray
    ) -> NDArray[np.uint8]:
        frames = np.empty((len(value) + 0 * key, SIZE), np.uint8)
        words = value.astype(np.float32).view(np.uint32)
        for i in range(len(value)):
            _put(frames[i], status[i], edges, first + i, math.floor(device_us[i]), words[i])
        return frames

    return cached(encode_frames), cached(encode_samples)


encode_frames, encode_samples = _encoders(zlib.crc32(Path(__file__).read_bytes()))
"""`encode_frames(status, edge_count, sequence, device_us, value) -> frames as bytes (n, 16)`, all of shape (n,).

Status bits (uint8); pulses latched so far, sample numbers and device clock (us), integers that are not wrapped;
readings in the wire unit. `encode_samples(status, edges, first, device_us, value)` does it for samples without a gap
or an edge among them: so many pulses latched, the first one's number, the device clock as it is.
"""


def encode_lines(value: NDArray[np.float64], unit: str) -> NDArray[np.uint8]:
    """ASCII lines of the preset `signed-decimal` as bytes, shape (n, width): `+0001234.5 N` and CR LF.

    Args:
        value: readings in the wire unit, shape (n,); one that is not a number is written as text that is none.
        unit: unit written behind the number.
    """
    if not len(value):
        return np.zeros((0, 1), np.uint8)
    text = "".join(f"{number:+010.1f} {unit}\r\n" for number in value.tolist())
    return np.frombuffer(text.encode("ascii"), np.uint8).reshape(len(value), -1)

"""Many 16-byte sensor frames at once, compiled; the layout is `protocols.frame_format`'s."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from protocols.frame_format import SIZE

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


def _seal(frames: NDArray[np.uint8], table: NDArray[np.uint16]) -> None:
    for i in range(frames.shape[0]):
        crc = 0xFFFF
        for j in range(14):
            crc = ((crc << 8) & 0xFFFF) ^ int(table[(crc >> 8) ^ int(frames[i, j])])
        frames[i, 14] = crc & 0xFF
        frames[i, 15] = crc >> 8


seal: Any = njit(cache=True)(_seal)

LAYOUT = np.dtype(
    [("sync", "<u2"), ("status", "u1"), ("edge", "u1"), ("sequence", "<u2"), ("device_us", "<u4"), ("value", "<f4"),
     ("crc", "<u2")]
)
SYNC_WORD = 0x5AA5


def encode_frames(
    status: NDArray[np.uint8],
    edge_count: NDArray[np.uint8],
    sequence: NDArray[np.int64],
    device_us: NDArray[np.int64],
    value: NDArray[np.float64],
) -> NDArray[np.uint8]:
    """Frames as bytes, shape (n, 16).

    Args:
        status: status bits, shape (n,).
        edge_count: pulses latched so far modulo 256, shape (n,).
        sequence: sample numbers, not wrapped, shape (n,).
        device_us: device clock (us), not wrapped, shape (n,).
        value: readings in the wire unit, shape (n,).
    """
    frames = np.empty(len(value), LAYOUT)
    frames["sync"] = SYNC_WORD
    frames["status"] = status
    frames["edge"] = edge_count
    frames["sequence"] = sequence & 0xFFFF
    frames["device_us"] = device_us & 0xFFFFFFFF
    frames["value"] = value
    raw = frames.view(np.uint8).reshape(-1, SIZE)
    seal(raw, CRC_TABLE)
    return raw


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

"""Checksums of sensor lines and frames, by the names that a format's `checksum` may have.

Check values are those of the nine characters `123456789`. A name that ends in `-hex` is the same sum written as
hexadecimal digits, high digit first, as in lines of text.
"""

from __future__ import annotations

import zlib
from binascii import crc_hqx
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial


@dataclass(frozen=True)
class Checksum:
    """One way to sum up bytes.

    Attributes:
        size: bytes of the sum.
        of: the sum of some bytes.
        meaning: in words, for the reference.
    """

    size: int
    of: Callable[[bytes], int]
    meaning: str


def _reflected_table(polynomial: int) -> tuple[int, ...]:
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = (byte >> 1) ^ polynomial if byte & 1 else byte >> 1
        table.append(byte)
    return tuple(table)


def _reflected(data: bytes, table: tuple[int, ...], start: int, last: int) -> int:
    total = start
    for byte in data:
        total = (total >> 8) ^ table[(total ^ byte) & 0xFF]
    return total ^ last


def _xor(data: bytes) -> int:
    """Halves laid over each other until one byte is left."""
    total, half = int.from_bytes(data, "big"), 1 << max(0, len(data) - 1).bit_length()
    while half > 1:
        half >>= 1
        total ^= total >> 8 * half
    return total & 0xFF


def _crc8(data: bytes) -> int:
    total = 0
    for byte in data:
        total ^= byte
        for _ in range(8):
            total = ((total << 1) ^ 0x07) & 0xFF if total & 0x80 else total << 1
    return total


def _crc16(polynomial: int, start: int, last: int = 0) -> Callable[[bytes], int]:
    return partial(_reflected, table=_reflected_table(polynomial), start=start, last=last)


CHECKSUMS: Mapping[str, Checksum] = {
    "xor": Checksum(1, _xor, "exclusive or of all bytes"),
    "sum8": Checksum(1, lambda data: sum(data) & 0xFF, "sum modulo 256"),
    "sum8-negated": Checksum(1, lambda data: -sum(data) & 0xFF, "two's complement of the sum: all bytes add up to 0"),
    "sum8-inverted": Checksum(1, lambda data: ~sum(data) & 0xFF, "one's complement of the sum"),
    "sum8-bit7": Checksum(1, lambda data: sum(data) & 0xFF | 0x80, "sum modulo 256, with the highest bit set"),
    "sum16": Checksum(2, lambda data: sum(data) & 0xFFFF, "sum modulo 65536"),
    "crc8": Checksum(1, _crc8, "polynomial 0x07, start 0; check value F4"),
    "crc16-modbus": Checksum(2, _crc16(0xA001, 0xFFFF), "polynomial 0x8005 reflected, start FFFF; check value 4B37"),
    "crc16-arc": Checksum(2, _crc16(0xA001, 0), "polynomial 0x8005 reflected, start 0; check value BB3D"),
    "crc16-ccitt-false": Checksum(
        2, lambda data: crc_hqx(data, 0xFFFF), "polynomial 0x1021, start FFFF; check value 29B1"
    ),
    "crc16-xmodem": Checksum(2, lambda data: crc_hqx(data, 0), "polynomial 0x1021, start 0; check value 31C3"),
    "crc16-kermit": Checksum(2, _crc16(0x8408, 0), "polynomial 0x1021 reflected, start 0; check value 2189"),
    "crc16-x25": Checksum(
        2, _crc16(0x8408, 0xFFFF, 0xFFFF), "polynomial 0x1021 reflected, start and end FFFF; check value 906E"
    ),
    "crc32": Checksum(4, zlib.crc32, "as used by Ethernet and zip; check value CBF43926"),
}
"""By name."""

HEX = "-hex"
LINE_CHECKSUMS = ("none", *(name + HEX for name in CHECKSUMS))
FRAME_CHECKSUMS = ("none", *CHECKSUMS)

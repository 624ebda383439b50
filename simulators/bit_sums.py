"""Checksums as a device computes them: bit by bit, as its maker's document says, independently of the host's own."""

from __future__ import annotations

import functools

_CRC16 = {
    # polynomial, start, reflected, last
    "crc16-modbus": (0x8005, 0xFFFF, True, 0),
    "crc16-arc": (0x8005, 0, True, 0),
    "crc16-ccitt-false": (0x1021, 0xFFFF, False, 0),
    "crc16-xmodem": (0x1021, 0, False, 0),
    "crc16-kermit": (0x1021, 0, True, 0),
    "crc16-x25": (0x1021, 0xFFFF, True, 0xFFFF),
}


def size_of(kind: str) -> int:
    """Bytes of a checksum of that kind; 0 for "none"."""
    if kind == "none":
        return 0
    return 4 if kind == "crc32" else 2 if kind.startswith("crc16") or kind == "sum16" else 1


def total_of(kind: str, data: bytes) -> int:
    """The checksum of some bytes."""
    if kind in _CRC16:
        polynomial, start, reflected, last = _CRC16[kind]
        return remainder(data, 16, polynomial, start, reflected=reflected) ^ last
    if kind == "crc8":
        return remainder(data, 8, 0x07, 0)
    if kind == "crc32":
        return remainder(data, 32, 0x04C11DB7, 0xFFFFFFFF, reflected=True) ^ 0xFFFFFFFF
    total = 0
    for byte in data:
        total = total ^ byte if kind == "xor" else total + byte
    if kind == "sum8-negated":
        total = 256 - total % 256
    if kind == "sum8-inverted":
        total = 255 - total % 256
    total %= 65536 if kind == "sum16" else 256
    return total | 0x80 if kind == "sum8-bit7" else total


def remainder(data: bytes, width: int, polynomial: int, start: int, *, reflected: bool = False) -> int:
    """The remainder of a division.

    Args:
        data: what is divided.
        width: bits of the remainder, at least 8.
        polynomial: most significant bit first, without its leading 1.
        start: the register at first, as it is in the device: mirrored where the division is reflected.
        reflected: least significant bits first.
    """
    table, mask = _table(width, polynomial, reflected), (1 << width) - 1
    for byte in data:
        if reflected:
            start = table[(start ^ byte) & 0xFF] ^ start >> 8
        else:
            start = table[start >> width - 8 ^ byte] ^ start << 8 & mask
    return start


@functools.cache
def _table(width: int, polynomial: int, reflected: bool) -> list[int]:
    """The remainder of each byte."""
    return [_shifted(0, width, polynomial, byte, reflected=reflected) for byte in range(256)]


def _shifted(register: int, width: int, polynomial: int, byte: int, *, reflected: bool) -> int:
    """The register after a byte, one bit after the other."""
    for place in range(8) if reflected else range(7, -1, -1):
        bit = byte >> place & 1
        if reflected:
            # The plain division on mirrored bits.
            feedback, register = register & 1 ^ bit, register >> 1
            register ^= _mirrored(polynomial, width) if feedback else 0
        else:
            feedback = register >> width - 1 & 1 ^ bit
            register = register << 1 & (1 << width) - 1 ^ (polynomial if feedback else 0)
    return register


def _mirrored(value: int, width: int) -> int:
    return int(f"{value:0{width}b}"[::-1], 2)

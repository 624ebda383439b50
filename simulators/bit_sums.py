"""Checksums as a device computes them: bit by bit, as its maker's document says, apart from the host's own."""

from __future__ import annotations

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
        return _divided(data, (16, polynomial), start, reflected=reflected) ^ last
    if kind == "crc8":
        return _divided(data, (8, 0x07), 0, reflected=False)
    if kind == "crc32":
        return _divided(data, (32, 0x04C11DB7), 0xFFFFFFFF, reflected=True) ^ 0xFFFFFFFF
    total = 0
    for byte in data:
        total = total ^ byte if kind == "xor" else total + byte
    if kind == "sum8-negated":
        total = 256 - total % 256
    if kind == "sum8-inverted":
        total = 255 - total % 256
    total %= 65536 if kind == "sum16" else 256
    return total | 0x80 if kind == "sum8-bit7" else total


def _mirrored(value: int, width: int) -> int:
    return int(f"{value:0{width}b}"[::-1], 2)


def _divided(data: bytes, divisor: tuple[int, int], start: int, *, reflected: bool) -> int:
    """The remainder of a division bit by bit; `divisor` is width and polynomial."""
    width, polynomial = divisor
    rest, top = start, 1 << (width - 1)
    for byte in data:
        rest ^= (_mirrored(byte, 8) if reflected else byte) << (width - 8)
        for _ in range(8):
            rest = (rest << 1) ^ polynomial if rest & top else rest << 1
        rest &= (1 << width) - 1
    return _mirrored(rest, width) if reflected else rest

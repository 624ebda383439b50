"""Damaged copies of valid input: bytes flipped, lost, doubled, put in, cut off, moved; seeded."""

from __future__ import annotations

import random

INTERESTING = (0x00, 0xFF, 0x7F, 0x80, 0x0D, 0x0A, 0x2C, 0x2D, 0x22, 0x5B, 0x5D, 0x65, 0x3D)
MOST_CHANGES = 6
LONGEST_PIECE = 24


def damaged(data: bytes, source: random.Random) -> bytes:
    """A copy of `data` with 1 to 6 changes, seldom with none."""
    work = bytearray(data)
    for _ in range(source.choice((0, 1, 1, 2, 3, MOST_CHANGES))):
        at = source.randrange(len(work) + 1)
        piece = source.randrange(1, LONGEST_PIECE)
        match source.randrange(7):
            case 0 if at < len(work):
                work[at] ^= 1 << source.randrange(8)
            case 1 if at < len(work):
                work[at] = source.choice(INTERESTING)
            case 2:
                del work[at : at + piece]
            case 3:
                work[at:at] = work[at : at + piece]
            case 4:
                work[at:at] = source.randbytes(piece)
            case 5:
                del work[at:]
            case _:
                moved = work[at : at + piece]
                del work[at : at + piece]
                there = source.randrange(len(work) + 1)
                work[there:there] = moved
    return bytes(work)


def chunks(data: bytes, source: random.Random) -> list[bytes]:
    """`data` cut anywhere, as a port brings it."""
    cuts = sorted(source.randrange(len(data) + 1) for _ in range(source.randrange(4)))
    return [data[begin:end] for begin, end in zip([0, *cuts], [*cuts, len(data)], strict=True)]

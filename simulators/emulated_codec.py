"""An emulated map's numbers as a device lays them into its registers: by shifts and halves, nothing of the driver's.

What is shared with the host is the map, as a data sheet is; how its words are made and read stands here a second time.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence

from drivers.register_maps.quantity import BITS, Quantity

SIGNED = frozenset({"i16", "i32", "i64"})
DECIMAL = frozenset({"bcd16", "bcd32"})
DIGIT_BITS = 4
FLOATS = {"f32": (">f", ">I"), "f64": (">d", ">Q")}


def raw_of(quantity: Quantity, value: float) -> int:
    """The bits (a number of 16 times its registers) that show a value (SI); what is beyond the register is its end."""
    bits = 16 * quantity.length
    if quantity.type in DECIMAL:
        return digits_of((value / quantity.factor - quantity.offset) / quantity.scale, quantity)
    if quantity.whole and isinstance(value, int):
        return value & (1 << bits) - 1  # a float would lose the last bits of 64
    shown = (value / quantity.factor - quantity.offset) / quantity.scale
    if quantity.type in FLOATS:
        number, whole = FLOATS[quantity.type]
        return int(struct.unpack(whole, struct.pack(number, shown))[0])
    if not math.isfinite(shown):
        return 0
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if quantity.type in SIGNED else (0, (1 << bits) - 1)
    return max(low, min(high, math.floor(shown + 0.5))) & (1 << bits) - 1


def digits_of(shown: float, quantity: Quantity) -> int:
    """A number as BCD digits, the last digit in the lowest four bits; larger numbers are limited to the largest one."""
    count = 16 * quantity.length // DIGIT_BITS
    number = max(0, min(10**count - 1, math.floor(shown + 0.5))) if math.isfinite(shown) else 0
    return sum(number // 10**place % 10 << DIGIT_BITS * place for place in range(count))


def value_of(quantity: Quantity, raw: int) -> float:
    """The value (SI) of a register's bits."""
    if quantity.type == "bit" or quantity.bit is not None:
        return float(raw)
    if quantity.type in FLOATS:
        number, whole = FLOATS[quantity.type]
        shown = float(struct.unpack(number, struct.pack(whole, raw))[0])
    elif quantity.type in DECIMAL:
        places = range(16 * quantity.length // DIGIT_BITS)
        shown = float(sum((raw >> DIGIT_BITS * place & 0xF) * 10**place for place in places))
    else:
        bits = 16 * quantity.length
        shown = float(raw - (1 << bits) if quantity.type in SIGNED and raw >> bits - 1 else raw)
    return (shown * quantity.scale + quantity.offset) * quantity.factor


def words_of(quantity: Quantity, raw: int, *, swapped: bool = False) -> list[int]:
    """Registers with these bits, in the order of their addresses; for a split value, highest word first.

    Args:
        quantity: defines their number and order.
        raw: the bits.
        swapped: fault: the words are in the wrong order.
    """
    words = [raw >> 16 * place & 0xFFFF for place in range(quantity.length)]
    if (quantity.word_order == "big") is not swapped:
        words.reverse()
    return words if quantity.byte_order == "big" else [turned(quantity, word) for word in words]


def lay_down(cells: dict[tuple[str, int], int], quantity: Quantity, raw: int, *, swapped: bool = False) -> None:
    """Write these bits into the registers or the coil of a quantity.

    Args:
        cells: contents by space and address.
        quantity: defines the addresses.
        raw: the bits.
        swapped: fault: the words are in the wrong order.
    """
    space = quantity.space
    if space in BITS:
        cells[space, quantity.address] = raw & 1
        return
    for at, word in zip(quantity.cells, words_of(quantity, raw, swapped=swapped), strict=False):
        cells[space, at] = word


def bits_of(quantity: Quantity, words: Sequence[int]) -> int:
    """The bits that registers hold, in the order of their addresses."""
    ordered = list(words) if quantity.word_order == "little" else list(words)[::-1]
    return sum(turned(quantity, word) << 16 * place for place, word in enumerate(ordered))


def text_words(quantity: Quantity, text: str) -> list[int]:
    """The registers that hold a text, padded with zeros."""
    letters = text.encode("ascii", "replace")[: 2 * quantity.length].ljust(2 * quantity.length, b"\0")
    words = [letters[place] << 8 | letters[place + 1] for place in range(0, len(letters), 2)]
    return [turned(quantity, word) for word in words]


def turned(quantity: Quantity, word: int) -> int:
    """A word with its bytes exchanged, where the device has them so."""
    return word if quantity.byte_order == "big" else (word & 0xFF) << 8 | word >> 8

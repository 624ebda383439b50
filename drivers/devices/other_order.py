"""Words that read wrong, read in every other order: what would make them right. No I/O."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from protocols.errors import RemoteProtocolError
from protocols.register_map import Block

ORDERS = ("big", "little")


def read_otherwise(block: Block, words: Sequence[int], expected: Mapping[str, object]) -> tuple[str, str]:
    """The order of words, or of the bytes in them, in which a block holds what is expected.

    Args:
        block: as the register map lays it out.
        words: as they came, in address order.
        expected: names and values that prove the block.

    Returns:
        What they read in that order, and what to write into the register map; both empty where no order fits.
    """
    for order, swapped, given in _orders(words):
        if (order, swapped) == (block.word_order, False):
            continue
        try:
            values = replace(block, word_order=order).decode(given)
        except RemoteProtocolError:
            continue
        if all(values.get(name) == value for name, value in expected.items()):
            shown = ", ".join(f"{name} {value}" for name, value in expected.items())
            bytes_too = " and the two bytes of each word exchanged" if swapped else ""
            how = f'word_order = "{order}"{bytes_too}'
            return f"with {how} the same words read {shown}, as expected", f"write {how} for block {block.name!r}"
    return "", ""


def _orders(words: Sequence[int]) -> Iterator[tuple[str, bool, list[int]]]:
    """Word order, whether bytes are exchanged, and the words so."""
    exchanged = [(word & 0xFF) << 8 | word >> 8 for word in words]
    for order in ORDERS:
        yield order, False, list(words)
    for order in ORDERS:
        yield order, True, exchanged

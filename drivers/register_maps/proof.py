"""Whether a device shows what proves its layout; where it does not, what would have fitted."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from drivers.register_maps.access_plan import Read
from drivers.register_maps.condition import Values
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.quantity import Quantity, Value, same
from protocols.errors import RemoteProtocolError

OTHER = {"big": "little", "little": "big"}


def unproved(controller: ControllerMap, values: Values, answers: Iterable[tuple[Read, Sequence[int]]]) -> str:
    """What a device shows otherwise than its map says, in words; empty where all is as it should be.

    Args:
        controller: its map.
        values: what its identity shows.
        answers: the words that these were made of.
    """
    told = []
    held = {quantity.name: (quantity, read, words) for read, words in answers for quantity in read.quantities}
    for name, wanted in controller.expected.items():
        quantity, read, words = held[name]
        if not same(values[name], wanted, 0.0 if quantity.whole else quantity.step):
            own = words[quantity.address - read.address : quantity.end - read.address]
            told.append(f"{name} {_shown(values[name])}, expected {_shown(wanted)}{_fitting(quantity, own, wanted)}")
    return ", ".join(told)


def _fitting(quantity: Quantity, words: Sequence[int], wanted: Value) -> str:
    """The word and byte order in which the value would be right; empty where there is none."""
    for words_order in (quantity.word_order, OTHER[quantity.word_order]):
        for bytes_order in (quantity.byte_order, OTHER[quantity.byte_order]):
            turned = replace(quantity, word_order=words_order, byte_order=bytes_order)
            try:
                fits = same(turned.decode(words), wanted, 0.0 if quantity.whole else quantity.step)
            except RemoteProtocolError:
                fits = False
            if fits:
                return f' (right with word_order = "{words_order}", byte_order = "{bytes_order}")'
    return ""


def _shown(value: Value) -> str:
    """A register's value for people: whole numbers also as they lie on the wire."""
    return f"{value} (0x{value:08X})" if isinstance(value, int) and value > 0xFFFF else str(value)

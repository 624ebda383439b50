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


def unproved(
    controller: ControllerMap, values: Values, answers: Iterable[tuple[Read, Sequence[int]]]
) -> tuple[str, str]:
    """What a device shows otherwise than its map says, and what would correct the map, as text; empty if all is well.

    Args:
        controller: its map.
        values: what its identity shows.
        answers: the words that these were made of.
    """
    problems: list[str] = []
    fixes: list[str] = []
    right: list[str] = []
    held = {quantity.name: (quantity, read, words) for read, words in answers for quantity in read.quantities}
    for name, value in controller.expected.items():
        quantity, read, words = held[name]
        if not same(values[name], value, 0.0 if quantity.whole else quantity.step):
            own = words[quantity.address - read.address : quantity.end - read.address]
            problems.append(f"{name} {_shown(values[name])}, expected {_shown(value)}")
            fixes.append(_fitting(quantity, own, value))
            right.append(f"{name} {value}" if fixes[-1] else "")
    if not problems:
        return "", ""
    fix = next((fix for fix in fixes if fix), "")
    read_right = ", ".join(one for one, how in zip(right, fixes, strict=True) if how == fix)
    why = f"with {fix}, the same words read {read_right}, as expected"
    why = why if fix else "the word order, scale, layout or device is wrong"
    return f"{', '.join(problems)}; {why}", f"write {fix} in the register map" if fix else ""


def _fitting(quantity: Quantity, words: Sequence[int], expected: Value) -> str:
    """The word and byte order in which the value would be right; empty where there is none."""
    for words_order in (quantity.word_order, OTHER[quantity.word_order]):
        for bytes_order in (quantity.byte_order, OTHER[quantity.byte_order]):
            turned = replace(quantity, word_order=words_order, byte_order=bytes_order)
            try:
                fits = same(turned.decode(words), expected, 0.0 if quantity.whole else quantity.step)
            except RemoteProtocolError:
                fits = False
            if fits:
                bytes_too = f' and byte_order = "{bytes_order}"' if bytes_order != quantity.byte_order else ""
                return f'word_order = "{words_order}"{bytes_too}'
    return ""


def _shown(value: Value) -> str:
    """A register's value for people: whole numbers also as they lie on the wire."""
    return f"{value} (0x{value:08X})" if isinstance(value, int) and value > 0xFFFF else str(value)

"""The demo controller's registers by other means than the product's: documented blocks, words packed by `struct`.

Addresses and types come from the shipped map, which a test compares with the table of docs/wires.md.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import astuple
from typing import Any

from drivers.register_maps.map_file import controller
from drivers.register_maps.read_quantities import LIMITS
from drivers.roles import ActuatorIdentity, ActuatorLimits, ActuatorStatus

LETTERS = {"u16": "H", "u32": "I", "f32": "f"}
QUANTITIES = {**controller("demo").quantities, **controller("demo-streamed").quantities}
Number = int | float | str


class Block:
    """A run of registers that travels in one request; values as in the registers, high word first."""

    def __init__(self, address: int, count: int) -> None:
        self.address, self.count = address, count
        self.quantities = [one for one in QUANTITIES.values() if address <= one.address < address + count]

    def encode(self, values: Mapping[str, Number]) -> list[int]:
        """The words of a write; registers not named are 0, a table's values are named `table_values_0` and so on."""
        words = [0] * self.count
        elements = {element.name: element for one in self.quantities for element in one.elements if one.values > 1}
        known = {one.name: one for one in self.quantities} | elements
        for name, value in values.items():
            quantity = known[name]
            if quantity.type == "string":
                raw = str(value).encode().ljust(2 * quantity.length, b"\0")
            else:
                raw = struct.pack(">" + LETTERS[quantity.type], value)
            at = quantity.address - self.address
            words[at : at + quantity.length] = struct.unpack(f">{quantity.length}H", raw)
        return words

    def decode(self, words: Sequence[int]) -> dict[str, Any]:
        """The values of an answer."""
        raw = struct.pack(f">{self.count}H", *words)
        values: dict[str, Any] = {}
        for quantity in self.quantities:
            at = 2 * (quantity.address - self.address)
            part = raw[at : at + 2 * quantity.length]
            text = quantity.type == "string"
            values[quantity.name] = (
                part.rstrip(b"\0").decode() if text else struct.unpack(">" + LETTERS[quantity.type], part)[0]
            )
        return values


IDENTITY, STATUS, CONFIG, COMMAND = Block(0, 38), Block(100, 34), Block(200, 16), Block(300, 24)
WATCHDOG, SETPOINT, TABLE = Block(350, 1), Block(360, 5), Block(400, 122)


def decode_status(words: Sequence[int], received_ns: int = 0) -> ActuatorStatus:
    """The status block."""
    values = STATUS.decode(words)
    return ActuatorStatus(received_ns, *[values[one.name] for one in STATUS.quantities])


def decode_identity(words: Sequence[int]) -> ActuatorIdentity:
    """The identity block."""
    return ActuatorIdentity(**IDENTITY.decode(words))


def encode_limits(limits: ActuatorLimits) -> list[int]:
    """The config block; `LIMITS` are in the order of `ActuatorLimits`."""
    return CONFIG.encode(dict(zip(LIMITS, astuple(limits), strict=True)))


def decode_limits(words: Sequence[int]) -> ActuatorLimits:
    """Limits from the words of the config block."""
    values = CONFIG.decode(words)
    return ActuatorLimits(*[values[name] for name in LIMITS])

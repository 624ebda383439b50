"""Indirect data: registers that show what others hold, so that the status is one contiguous read.

The host writes a list of addresses once; behind it the device shows the registers at those addresses one after the
other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from drivers.register_maps.access_plan import Written
from drivers.register_maps.entries import Table
from drivers.register_maps.quantity import BITS, HOLDING, LAST_ADDRESS, Quantity
from protocols.near_miss import meant

MOST = 123


@dataclass(frozen=True)
class Indirect:
    """A list of register addresses, and the registers that mirror their contents.

    Attributes:
        space: register type of the contents.
        pointers: first holding register of the list.
        data: first register of the contents.
        quantities: owners of the listed registers, in order.
        pointer_registers: registers per entry of the list: 1, or 2 with the high word first.
        by_value: whether the list contains only the first register of each value, and the device mirrors all of them.
        pointer_offset: offset added to each address in the list.
    """

    space: str
    pointers: int
    data: int
    quantities: tuple[Quantity, ...]
    pointer_registers: int = 1
    pointer_offset: int = 0
    by_value: bool = False

    @property
    def addresses(self) -> tuple[int, ...]:
        """Entries of the list: one address for each register, or for each quantity."""
        return tuple(
            address + self.pointer_offset
            for one in self.quantities for address in (one.cells[:1] if self.by_value else one.cells)
        )

    @property
    def sources(self) -> tuple[int, ...]:
        """The register mirrored by each register of the contents, in order."""
        return tuple(address for one in self.quantities for address in one.cells)

    def entry_of(self, place: int) -> tuple[int, int]:
        """List entry that selects a register of the contents, and the register's offset from its address.

        Args:
            place: index of the register in the contents.

        Raises:
            IndexError: the index is beyond the last register.
        """
        if not self.by_value:
            return place, 0
        for number, one in enumerate(self.quantities):
            if place < len(one.cells):
                return number, place
            place -= len(one.cells)
        raise IndexError(place)

    @property
    def requests(self) -> tuple[Written, ...]:
        """The writes that lay the list down."""
        words: list[int] = []
        for entry in self.addresses:
            words += [entry] if self.pointer_registers == 1 else [entry >> 16, entry & 0xFFFF]
        return tuple(
            Written(16, self.pointers + place, tuple(words[place : place + MOST]))
            for place in range(0, len(words), MOST)
        )

    def shown(self) -> Mapping[str, Quantity]:
        """Where the quantities are read, by name."""
        result: dict[str, Quantity] = {}
        at = self.data
        for one in self.quantities:
            result[one.name] = replace(one, space=self.space, address=at, places=(), written=False)
            at += len(one.cells)
        return result


def read_indirect(table: Table, quantities: Mapping[str, Quantity], first: Mapping[str, int]) -> Indirect | None:
    """The table [indirect]; None where there is none.

    Args:
        table: to read.
        quantities: of the file.
        first: what the file calls the first register of each space.
    """
    if not table.given:
        return None
    space = table.get("function", HOLDING)
    pointers, data = table.get("pointers") - first[HOLDING], table.get("data") - first[space]
    for key, address in (("pointers", pointers), ("data", data)):
        if not 0 <= address <= LAST_ADDRESS:
            low = first[HOLDING if key == "pointers" else space]
            table.add(key, f"must be a whole number from {low} to {low + LAST_ADDRESS}")
            return None
    listed: list[Quantity] = []
    by_value = table.get("pointer_for", "register") == "value"
    for name in table.get("quantities"):
        quantity = quantities.get(name)
        if quantity is None:
            table.add("quantities", f"{name!r} is not in [quantities]; {meant(name, quantities)}")
        elif quantity.space in BITS:
            table.add("quantities", f"{name!r} is not a register")
        elif quantity.places and by_value:
            table.add("quantities", f"{name!r} has registers at {' and '.join(map(str, quantity.cells))}, which a "
                'single pointer cannot address. Fix: pointer_for = "register"')
        else:
            listed.append(quantity)
    width = table.get("pointer_registers", 1)
    result = Indirect(space, pointers, data, tuple(listed), width, table.get("pointer_offset", 0), by_value)
    count, shown = len(result.addresses), len(result.sources)
    if result.pointers + count * width > LAST_ADDRESS + 1 or result.data + shown > LAST_ADDRESS + 1:
        table.add(None, f"the {max(count, shown)} registers of this table extend beyond the last register, 65535")
    if width == 1 and not all(0 <= entry <= LAST_ADDRESS for entry in result.addresses):
        table.add("pointer_offset", "an entry of the pointer table does not fit into 16 bits")
    return result

"""Which requests read or write a set of quantities: as few as the device allows, each of registers that may be read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

from drivers.register_maps.quantity import BITS, COIL, HOLDING, Quantity, Value
from protocols.errors import RemoteProtocolError

MOST_READ = {True: 2000, False: 125}
"""Coils, registers of one request."""
MOST_WRITTEN = 123


@dataclass(frozen=True)
class Rules:
    """What a device allows.

    Attributes:
        largest_gap: number of unrequested registers that may be read with others.
        largest_read: registers of one request.
        unreadable: first and last address of holding and of input registers that must not be read.
        first: what the file calls the first register or coil of a space, for messages; 0 where a space is not in it.
    """

    largest_gap: int = 8
    largest_read: int = 125
    unreadable: tuple[tuple[int, int], ...] = ()
    first: tuple[tuple[str, int], ...] = ()

    def first_of(self, space: str) -> int:
        """What the file calls the first register or coil of a space."""
        return dict(self.first).get(space, 0)

    def may_bridge(self, first: int, last: int) -> bool:
        """Whether the unrequested registers first..last may be read."""
        forbidden = any(low <= last and first <= high for low, high in self.unreadable)
        return last < first or (last - first < self.largest_gap and not forbidden)


@dataclass(frozen=True)
class Read:
    """One request: a run of registers or coils, and the quantities in it."""

    space: str
    address: int
    count: int
    quantities: tuple[Quantity, ...]

    def decode(self, words: Sequence[int]) -> dict[str, Value]:
        """The values (SI) of an answer.

        Raises:
            RemoteProtocolError: the answer has another length, or holds what the quantities cannot mean.
        """
        if len(words) != self.count:
            raise RemoteProtocolError(f"{self.space} {self.address}: expected {self.count} registers, got {len(words)}")
        return {quantity.name: quantity.decode(words[place]) for quantity, place in self._places}

    @cached_property
    def _places(self) -> tuple[tuple[Quantity, slice], ...]:
        """Where each quantity is among the words."""
        at = self.address
        return tuple((quantity, slice(quantity.address - at, quantity.end - at)) for quantity in self.quantities)


def reads(quantities: Iterable[Quantity], rules: Rules) -> tuple[Read, ...]:
    """The requests that read these quantities."""
    planned: list[Read] = []
    ordered = sorted(set(quantities), key=lambda quantity: (quantity.space, quantity.address, quantity.end))
    for quantity in ordered:
        last = planned[-1] if planned else None
        if last is not None and last.space == quantity.space and _fits(last, quantity, rules):
            count = max(last.count, quantity.end - last.address)
            planned[-1] = Read(last.space, last.address, count, (*last.quantities, quantity))
        else:
            planned.append(Read(quantity.space, quantity.address, quantity.end - quantity.address, (quantity,)))
    return tuple(planned)


def _fits(last: Read, quantity: Quantity, rules: Rules) -> bool:
    bits = quantity.space in BITS
    most = MOST_READ[True] if bits else rules.largest_read
    gap_ends = quantity.address - 1
    return quantity.end - last.address <= most and rules.may_bridge(last.address + last.count, gap_ends)


@dataclass(frozen=True)
class Written:
    """One write request.

    Attributes:
        function: Modbus function code.
        address: first register or coil.
        words: values of the registers or coils.
        mask: bits of a single word that are written; the other bits do not change; 0: all bits.
    """

    function: int
    address: int
    words: tuple[int, ...]
    mask: int = 0


def writes(values: Mapping[Quantity, Value], span: tuple[int, int] | None = None) -> tuple[Written, ...]:
    """Return the requests that write these values (SI).

    Adjacent values are combined if they can be written with function 16 or 15, and so are the bits of one register. The
    order is otherwise that of `values`; combined values take the position of the last one. The words of a split value
    are written one by one.

    Args:
        values: quantity -> value.
        span: first and last holding register of one combined request; registers without a value are written as 0.

    Raises:
        LocalProtocolError: a value does not fit.
    """
    words = {quantity: quantity.encode(value) for quantity, value in values.items()}
    if span is not None:
        return (_spanned(words, span),)
    order = {quantity: place for place, quantity in enumerate(words)}
    runs: list[list[Quantity]] = []
    for quantity in sorted(words, key=lambda quantity: (quantity.space, quantity.address)):
        if runs and _together(runs[-1][-1], quantity):
            runs[-1].append(quantity)
        else:
            runs.append([quantity])
    runs.sort(key=lambda run: max(order[quantity] for quantity in run))
    return tuple(request for run in runs for request in _requests(run, words))


def _together(before: Quantity, quantity: Quantity) -> bool:
    """Whether one request can write two quantities: the second follows the first or shares its register."""
    if before.space != quantity.space or before.write_function != quantity.write_function:
        return False
    if before.bit is not None or quantity.bit is not None:
        return before.address == quantity.address and None not in {before.bit, quantity.bit}
    adjacent = before.end == quantity.address and not before.places and not quantity.places
    return adjacent and quantity.write_function in {15, 16}


def _requests(run: list[Quantity], words: Mapping[Quantity, Sequence[int]]) -> Iterable[Written]:
    function, address = run[0].write_function, run[0].address
    if run[0].bit is not None:
        mask = sum(1 << quantity.bit for quantity in run if quantity.bit is not None)
        return [Written(function, address, (sum(words[quantity][0] for quantity in run),), mask)]
    if run[0].places:
        return [Written(function, at, (word,)) for at, word in zip(run[0].cells, words[run[0]], strict=True)]
    together = [word for quantity in run for word in words[quantity]]
    if function in {5, 6}:
        return [Written(function, address + place, (word,)) for place, word in enumerate(together)]
    return [
        Written(function, address + place, tuple(together[place : place + MOST_WRITTEN]))
        for place in range(0, len(together), MOST_WRITTEN)
    ]


def _spanned(words: Mapping[Quantity, Sequence[int]], span: tuple[int, int]) -> Written:
    content = [0] * (span[1] - span[0] + 1)
    for quantity, own in words.items():
        for at, word in zip(quantity.cells, own, strict=False):
            content[at - span[0]] |= word
    return Written(16, span[0], tuple(content))


def spaces(quantities: Iterable[Quantity]) -> set[str]:
    """The spaces that are used."""
    return {quantity.space for quantity in quantities} | {HOLDING, COIL}

"""Numbers in CAN frames: location of each, by integers and shifts. No DBC, no meaning, no I/O.

Bits are numbered as in a DBC file: byte n contains bits 8n to 8n+7, the most significant bit of a byte has the highest
number. A little-endian signal starts at its least significant bit and grows upwards; a big-endian (Motorola) one starts
at its most significant bit, goes down through its byte and continues at the top of the next.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from protocols.errors import LocalProtocolError

_FLOATS = {16: "<e", 32: "<f", 64: "<d"}
_WHOLE = 1e-9


@dataclass(frozen=True, slots=True)
class Signal:
    """Where one number lies in its message, and what a step of it is worth.

    Attributes:
        name: for messages to people.
        start: bit number as in a DBC.
        length: bits.
        big_endian: Motorola byte order.
        signed: two's complement.
        is_float: IEEE 754 of 16, 32 or 64 bits; `signed` does not count then.
        scale, offset: value = scale * number on the wire + offset.
        unit: of the value.
    """

    name: str
    start: int
    length: int
    big_endian: bool = False
    signed: bool = False
    is_float: bool = False
    scale: float = 1.0
    offset: float = 0.0
    unit: str = ""

    @property
    def on_wire(self) -> str:
        """The value in terms of the number on the wire: scale, type, name, offset."""
        kind = f"{'float' if self.is_float else 'int' if self.signed else 'uint'}{self.length}"
        return f"{self.scale:.9g} * " * (self.scale != 1.0) + f"{kind} {{}}{self.name}" + f" {self.offset:+.9g}" * (
            self.offset != 0.0
        )

    @property
    def low(self) -> float:
        """Least number on the wire."""
        if self.is_float:
            return -math.inf
        return -(1 << self.length - 1) if self.signed else 0

    @property
    def high(self) -> float:
        """Greatest number on the wire."""
        if self.is_float:
            return math.inf
        return (1 << self.length - (1 if self.signed else 0)) - 1

    def shift(self, size: int) -> int:
        """By how many bits the frame, read as one number in the signal's byte order, is shifted to the right.

        Args:
            size: bytes of the frame.
        """
        if not self.big_endian:
            return self.start
        return 8 * size - (8 * (self.start // 8) + 7 - self.start % 8) - self.length

    def bits(self, size: int) -> frozenset[int]:
        """The numbers of its bits in a frame of `size` bytes; those beyond it are negative or too large."""
        shift = self.shift(size)
        places = range(shift, shift + self.length)
        if not self.big_endian:
            return frozenset(places)
        return frozenset(8 * (size - 1 - place // 8) + place % 8 for place in places)

    def raw(self, value: float) -> int:
        """The number on the wire, as unsigned bits, for a value; rounded to the nearest step.

        Raises:
            LocalProtocolError: not finite, or outside what the signal can hold.
        """
        scaled = (value - self.offset) / self.scale
        if self.is_float:
            if not math.isfinite(scaled):
                raise LocalProtocolError(f"{self.name}: {value} is not a finite number")
            try:
                return int.from_bytes(struct.pack(_FLOATS[self.length], scaled), "little")
            except OverflowError as error:
                raise LocalProtocolError(f"{self.name}: {value} exceeds a float of {self.length} bits") from error
        low, high = self.low, self.high
        if not low - 0.5 <= scaled <= high + 0.5:
            unit = f" {self.unit}" if self.unit else ""
            ends = sorted((low * self.scale + self.offset, high * self.scale + self.offset))
            raise LocalProtocolError(
                f"{self.name}: {value}{unit} is outside the range {ends[0]:g} to {ends[1]:g}{unit}"
            )
        return min(max(round(scaled), int(low)), int(high)) & (1 << self.length) - 1

    def value(self, raw: int) -> float:
        """The value of the number on the wire, given as unsigned bits."""
        multiply, divide = _factor(self.scale)
        return self.number(raw) * multiply / divide + self.offset

    def number(self, raw: int) -> float:
        """Unsigned bits as the number they stand for, without scale and offset."""
        if self.is_float:
            return float(struct.unpack(_FLOATS[self.length], raw.to_bytes(self.length // 8, "little"))[0])
        return raw - (1 << self.length) if self.signed and raw >> self.length - 1 else raw


Condition = tuple[Signal, frozenset[int]]
"""A multiplexer and the numbers of it at which a signal is in the frame."""


@dataclass(frozen=True, slots=True)
class Placed:
    """A signal that may be in some frames of its message only.

    Attributes:
        plain: the whole number on the wire is wanted, without scale and offset: codes, bits, counters.
        conditions: all of them must hold.
    """

    signal: Signal
    plain: bool = False
    conditions: tuple[Condition, ...] = ()


class FrameReader:
    """Takes the wanted signals out of one message's frames.

    Args:
        size: bytes of the frame.
        wanted: by the name under which the value is given back.
    """

    def __init__(self, size: int, requested: Mapping[str, Placed]) -> None:
        self._parts = [(name, *_cut(placed, size)) for name, placed in requested.items()]
        self._big = any(
            signal.big_endian
            for placed in requested.values()
            for signal in (placed.signal, *(multiplexer for multiplexer, _ in placed.conditions))
        )

    def read(self, data: bytes) -> dict[str, float]:
        """Values by name; what is not in this frame is left out, a float that is no finite number is NaN.

        Only measurements may be floats (`drivers.devices.ecu_roles`): codes and clocks are whole numbers.
        """
        words = (int.from_bytes(data, "little"), int.from_bytes(data, "big") if self._big else 0)
        values: dict[str, float] = {}
        for name, order, shift, mask, sign, signal, factor, conditions in self._parts:
            if conditions and not _holds(words, conditions):
                continue
            number: float = words[order] >> shift & mask
            if sign:
                number = signal.number(int(number))
                if not math.isfinite(number):
                    values[name] = math.nan
                    continue
            if factor is not None:
                multiply, divide, offset = factor
                number = number * multiply / divide + offset
            values[name] = number
        return values


@dataclass(slots=True)
class FrameWriter:
    """Makes frames of one message: fixed numbers, and values that change.

    Attributes:
        size: bytes of the frame.
        fixed: number on the wire (unsigned bits) of every signal that never changes.
        changing: the others, by name.
    """

    size: int
    fixed: Sequence[tuple[Signal, int]]
    changing: Mapping[str, Placed] = field(default_factory=dict)

    def write(self, values: Mapping[str, float]) -> bytearray:
        """The frame with these values; the names are those of `changing`.

        Raises:
            LocalProtocolError: a value does not fit its signal.
        """
        words = [0, 0]
        for signal, raw in self.fixed:
            words[signal.big_endian] |= raw << signal.shift(self.size)
        for name, placed in self.changing.items():
            signal = placed.signal
            raw = int(values[name]) & (1 << signal.length) - 1 if placed.plain else signal.raw(values[name])
            words[signal.big_endian] |= raw << signal.shift(self.size)
        little, big = words
        turned = int.from_bytes(big.to_bytes(self.size, "big"), "little")
        return bytearray((little | turned).to_bytes(self.size, "little"))


def put(data: bytearray, signal: Signal, raw: int) -> None:
    """Put unsigned bits where a signal lies; what was there is replaced."""
    order = "big" if signal.big_endian else "little"
    shift = signal.shift(len(data))
    word = int.from_bytes(data, order) & ~((1 << signal.length) - 1 << shift) | raw << shift  # type: ignore[arg-type]  # one of two literals
    data[:] = word.to_bytes(len(data), order)  # type: ignore[arg-type]  # the same


def take(data: bytes, signal: Signal) -> int:
    """The unsigned bits where a signal lies."""
    word = int.from_bytes(data, "big" if signal.big_endian else "little")
    return word >> signal.shift(len(data)) & (1 << signal.length) - 1


_Pages = tuple[tuple[int, int, int, frozenset[int]], ...]
_Cut = tuple[int, int, int, bool, Signal, tuple[float, float, float] | None, _Pages]


def _cut(placed: Placed, size: int) -> _Cut:
    """How a signal is cut out of a frame: byte order, shift, mask, whether it is signed or a float, factor, pages."""
    signal = placed.signal
    special = signal.signed or signal.is_float
    factor = None if placed.plain else (*_factor(signal.scale), signal.offset)
    pages = tuple(
        (int(item.big_endian), item.shift(size), (1 << item.length) - 1, numbers) for item, numbers in placed.conditions
    )
    mask = (1 << signal.length) - 1
    return int(signal.big_endian), signal.shift(size), mask, special, signal, factor, pages


def _holds(words: tuple[int, int], conditions: Sequence[tuple[int, int, int, frozenset[int]]]) -> bool:
    return all(words[order] >> shift & mask in numbers for order, shift, mask, numbers in conditions)


def _factor(scale: float) -> tuple[float, float]:
    """Numbers to multiply with and to divide by: a scale of 0.001 is division by 1000, which rounds once."""
    inverse = round(1.0 / scale) if abs(scale) > _WHOLE else 0
    return (1.0, inverse) if inverse and abs(inverse * scale - 1.0) < _WHOLE else (scale, 1.0)

"""One value in a device's registers or coils: its location, and the conversion between words and number.

    number in its unit = raw x scale + offset        SI = number in its unit x the unit's factor

A value with several registers has its high word first (`word_order` "big") or last; within a register, the high byte is
first (`byte_order` "big", as in Modbus) or last. The registers of a split value are not adjacent. A text has two
characters per register, padded with zeros or blanks. A BCD number has one decimal digit in every four bits.
"""

from __future__ import annotations

import math
import struct
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from protocols.errors import LocalProtocolError, RemoteProtocolError

Value = int | float | str

HOLDING, INPUT, COIL, DISCRETE = "holding", "input", "coil", "discrete"
SPACES = (HOLDING, INPUT, COIL, DISCRETE)
BITS = frozenset({COIL, DISCRETE})
READ_ONLY = frozenset({INPUT, DISCRETE})

TYPES: Mapping[str, tuple[str, int]] = {
    "u16": ("H", 1), "i16": ("h", 1), "u32": ("I", 2), "i32": ("i", 2), "f32": ("f", 2),
    "u64": ("Q", 4), "i64": ("q", 4), "f64": ("d", 4), "bcd16": ("H", 1), "bcd32": ("I", 2), "string": ("s", 0),
    "bit": ("?", 1),
}  # fmt: skip
"""Type -> (struct letter, registers); a string has the length that is stated."""
WIRE_TYPES: Mapping[str, str] = {
    "u16": "uint16", "i16": "int16", "u32": "uint32", "i32": "int32", "f32": "float32", "u64": "uint64", "i64": "int64",
    "f64": "float64", "bcd16": "BCD of 4 digits", "bcd32": "BCD of 8 digits", "string": "text", "bit": "bit",
}
FLOATS = frozenset({"f32", "f64"})
BCD = frozenset({"bcd16", "bcd32"})
MASK_WRITE = 22
"""Modbus function that writes single bits of a register."""
LARGEST_FLOATS: Mapping[str, float] = {"f32": (2.0 - 2.0**-23) * 2.0**127, "f64": sys.float_info.max}
LAST_ADDRESS = 0xFFFF


@dataclass(frozen=True, slots=True)
class Quantity:
    """A named value.

    Attributes:
        space: "holding", "input", "coil" or "discrete".
        address: first register or coil, as transmitted, 0..65535.
        length: registers of one value; 1 for a coil.
        values: number of consecutive values; more than 1 only for the samples of a table.
        scale, offset: from the raw number to the number in its unit.
        factor: from its unit to SI.
        measures: dimension of its unit, such as "length" or "speed"; empty without a unit.
        bit: number of the bit, if the value is a single bit; None: the whole register.
        whole: whether it is an integer or a bit without scale or unit.
        read, written: whether the host may read or write it.
        write_function: 5, 6, 15 or 16; 22 for a single bit. With 6 or 16, a bit is inserted into the word that was read
            before.
        places: offsets of the registers of a split value from `address`, highest word first; empty if they are
            adjacent.
    """

    name: str
    space: str
    address: int
    type: str
    length: int = 1
    values: int = 1
    scale: float = 1.0
    offset: float = 0.0
    factor: float = 1.0
    measures: str = ""
    word_order: str = "big"
    byte_order: str = "big"
    bit: int | None = None
    read: bool = True
    written: bool = True
    write_function: int = 16
    places: tuple[int, ...] = ()
    whole: bool = field(init=False, repr=False, compare=False)
    _words: struct.Struct = field(init=False, repr=False, compare=False)
    _number: struct.Struct = field(init=False, repr=False, compare=False)

    @property
    def end(self) -> int:
        """First address behind it."""
        return self.address + (max(self.places) + 1 if self.places else self.length * self.values)

    @property
    def cells(self) -> Sequence[int]:
        """Addresses of the words, in word order."""
        if self.places:
            return [self.address + place for place in self.places]
        return range(self.address, self.end)

    @property
    def numbers(self) -> int:
        """Number of different raw numbers that its registers can hold."""
        return 10 ** (4 * self.length) if self.type in BCD else 1 << 16 * self.length

    def __post_init__(self) -> None:
        plain = (self.scale, self.offset, self.factor) == (1.0, 0.0, 1.0)
        object.__setattr__(self, "whole", self.type not in FLOATS and plain)
        object.__setattr__(self, "_words", struct.Struct(f"{'>' if self.byte_order == 'big' else '<'}{self.length}H"))
        if self.type in TYPES and self.type != "string":
            object.__setattr__(self, "_number", struct.Struct(">" + TYPES[self.type][0]))

    def __hash__(self) -> int:
        return hash((self.space, self.address, self.name))

    @property
    def step(self) -> float:
        """The smallest difference that it can show (SI); 0 for a float."""
        return 0.0 if self.type in FLOATS else abs(self.scale * self.factor)

    @property
    def on_wire(self) -> str:
        """The SI value in terms of the registers: factor, type, offset and place."""
        factor, offset = self.scale * self.factor, self.offset * self.factor
        number = f"{factor:.9g} * " * (factor != 1.0) + WIRE_TYPES[self.type] + f" {offset:+.9g}" * (offset != 0.0)
        where = "" if self.bit is None else f"bit {self.bit} of "
        kind = {COIL: "coil", DISCRETE: "discrete input"}.get(self.space, f"{self.space} register")
        last = self.address + self.length - 1
        place = f"{kind} {self.address}" if last == self.address else f"{kind}s {self.address} to {last}"
        if self.places:
            place = f"{kind}s {' and '.join(map(str, self.cells))}"
        return f"{number}, {where}{place}"

    @property
    def elements(self) -> tuple[Quantity, ...]:
        """Each of its values as a quantity of its own."""
        return tuple(
            replace(self, name=f"{self.name}_{place}", address=self.address + place * self.length, values=1)
            for place in range(self.values)
        )

    def decode(self, words: Sequence[int]) -> Value:
        """Return the value (SI) of words or coils that were read from `address` to `end`.

        Raises:
            RemoteProtocolError: a word is not 16 bit, a text is not ASCII, or a BCD digit is above 9.
        """
        if self.bit is not None:
            return words[0] >> self.bit & 1
        if self.type == "bit":
            return int(bool(words[0]))
        if self.places:
            words = [words[place] for place in self.places]
        ordered = words if self.word_order == "big" or self.type == "string" else words[::-1]
        try:
            raw = self._words.pack(*ordered)
        except struct.error as error:
            raise RemoteProtocolError(f"{self.name!r}: a word is outside the range 0 to 65535: {error}") from error
        if self.type == "string":
            try:
                return raw.split(b"\0", 1)[0].decode("ascii").rstrip()
            except UnicodeDecodeError as error:
                raise RemoteProtocolError(f"{self.name!r}: {raw!r} is not ASCII text") from error
        number: int | float = self._number.unpack(raw)[0] if self.type not in BCD else self._digits(raw)
        return number if self.whole else self._si(number)

    def _digits(self, raw: bytes) -> int:
        """The number that BCD digits represent.

        Raises:
            RemoteProtocolError: a digit is above 9.
        """
        if not raw.hex().isdecimal():
            raise RemoteProtocolError(f"{self.name!r}: 0x{raw.hex().upper()} is not a BCD number")
        return int(raw.hex())

    def _si(self, raw: float) -> float:
        shown = raw if self.scale == 1.0 else raw * self.scale
        shown = shown + self.offset if self.offset else shown
        return shown if self.factor == 1.0 else shown * self.factor

    def encode(self, value: Value) -> list[int]:
        """Return the words (in the order of `cells`) or coil for a value (SI); for a bit, a word with only it.

        Raises:
            LocalProtocolError: the value does not fit.
        """
        if isinstance(value, str):
            raise self._unfit(value, "got a string, expected a number")
        if not math.isfinite(value):
            raise self._unfit(value, "not a finite number")
        if self.type == "bit" or self.bit is not None:
            if value not in {0, 1}:
                raise self._unfit(value, f"expected 0 or 1 for a {'coil' if self.bit is None else 'bit'}")
            return [int(value) << (self.bit or 0)]
        number = (value / self.factor - self.offset) / self.scale
        try:
            if self.type in FLOATS:
                raw = self._number.pack(number)
            elif self.whole and number != int(number):
                raise self._unfit(value, "not a whole number")
            else:
                raw = self._number.pack(self._raw(int(value) if self.whole else round(number)))
        except (struct.error, OverflowError) as error:
            raise self._unfit(value, str(error)) from error
        words = list(struct.unpack(f"{'>' if self.byte_order == 'big' else '<'}{len(raw) // 2}H", raw))
        return words if self.word_order == "big" else words[::-1]

    def _raw(self, number: int) -> int:
        """An integer as the bits of the registers.

        Raises:
            OverflowError: a BCD number is negative or has too many digits.
        """
        if self.type not in BCD:
            return number
        if not 0 <= number < self.numbers:
            raise OverflowError(f"allowed: 0 to {self.numbers - 1}")
        return int(str(number), 16)

    def holds(self, value: Value) -> bool:
        """Whether a value fits."""
        try:
            self.encode(value)
        except LocalProtocolError:
            return False
        return True

    def nearest(self, value: float) -> float:
        """The value (SI) that it can hold, nearest to a finite number.

        Raises:
            LocalProtocolError: it holds text.
        """
        if self.holds(value):
            return value
        if self.type == "string":
            raise self._unfit(value, "got a number, expected a string")
        number = (value / self.factor - self.offset) / self.scale
        if self.type in FLOATS:
            raw: float = math.copysign(LARGEST_FLOATS[self.type], number)
        else:
            count = 2 if self.type == "bit" or self.bit is not None else self.numbers
            least = -count // 2 if self.type.startswith("i") else 0
            raw = min(max(round(number), least), least + count - 1)
        return raw if self.whole else self._si(raw)

    def _unfit(self, value: Value, why: str) -> LocalProtocolError:
        return LocalProtocolError(f"{self.name!r} ({self.type} at {self.address}) cannot hold {value!r}: {why}")


def same(shown: Value, expected: Value, step: float = 0.0) -> bool:
    """Whether a register shows a value, as well as it can; a whole number is that number or another one."""
    if isinstance(shown, str) or isinstance(expected, str):
        return str(shown) == str(expected)
    if isinstance(shown, int):
        return shown == expected
    return abs(shown - expected) <= max(0.5000001 * step, 1e-6 * abs(expected))

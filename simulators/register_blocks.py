"""A simulated controller's registers as data: what is where, and how its words become values.

A map is a set of `Block`s, each one contiguous run of 16-bit registers read or written in one request, each made of
`Register`s. Values of more than one register follow the map's word order:

    word_order "big"     address: high word, address + 1: low word      (0x01020304 -> 0102 0304)
    word_order "little"  address: low word,  address + 1: high word     (0x01020304 -> 0304 0102)

Within a register bytes are big-endian, as Modbus has it. A string holds two characters a register, zero padded.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from protocols.errors import LocalProtocolError, RemoteProtocolError

Value = int | float | str

TYPES: Mapping[str, tuple[str, int]] = {
    "u16": ("H", 1), "i16": ("h", 1), "u32": ("I", 2), "i32": ("i", 2), "f32": ("f", 2), "string": ("s", 0),
}
"""Type name -> (struct letter, registers); a string has the length its register states."""

_LAST_ADDRESS = 0xFFFF


@dataclass(frozen=True, slots=True)
class Register:
    """One named value of the map.

    Attributes:
        address: first holding register, 0..65535.
        name: the name under which drivers ask for it.
        type: "u16", "i16", "u32", "i32", "f32" or "string".
        unit: unit of the scaled value, "" for none.
        meaning: one line for people.
        length: registers of a string; derived for numbers.
        scale: scaled value = scale x wire value; 1.0 leaves integers as integers.
        writable: whether the host may write it.
    """

    address: int
    name: str
    type: str
    unit: str = ""
    meaning: str = ""
    length: int = 0
    scale: float = 1.0
    writable: bool = False

    def __post_init__(self) -> None:
        if self.type not in TYPES:
            raise LocalProtocolError(f"register {self.name!r}: type {self.type!r} is not one of {', '.join(TYPES)}")
        if self.type != "string":
            object.__setattr__(self, "length", TYPES[self.type][1])
        if self.length < 1:
            raise LocalProtocolError(f"register {self.name!r}: a string needs length >= 1 register, got {self.length}")
        if not 0 <= self.address <= _LAST_ADDRESS + 1 - self.length:
            raise LocalProtocolError(f"register {self.name!r}: address {self.address} is outside 0..{_LAST_ADDRESS}")
        if self.scale == 0 or not math.isfinite(self.scale):
            raise LocalProtocolError(f"register {self.name!r}: scale {self.scale} is not a usable factor")

    @property
    def end(self) -> int:
        """First address behind this register."""
        return self.address + self.length


@dataclass(frozen=True)
class Block:
    """A contiguous run of registers that travels in one request.

    Attributes:
        name: "identity", "status", "config", "command" ...
        registers: in ascending address order; addresses between them that no register covers are padding.
        word_order: "big" or "little".
    """

    name: str
    registers: tuple[Register, ...]
    word_order: str = "big"
    _order: tuple[int, ...] = field(init=False, repr=False, compare=False)
    _values: struct.Struct = field(init=False, repr=False, compare=False)
    _names: frozenset[str] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not self.registers:
            raise LocalProtocolError(f"block {self.name!r} has no registers")
        if self.word_order not in {"big", "little"}:
            raise LocalProtocolError(f"block {self.name!r}: word_order {self.word_order!r} is not 'big' or 'little'")
        layout, at = ">", self.address
        order: list[int] = []
        for register in self.registers:
            if register.address < at:
                raise LocalProtocolError(
                    f"block {self.name!r}: register {register.name!r} at {register.address} overlaps the one before it "
                    f"or is out of order; the next free address is {at}"
                )
            layout += f"{2 * (register.address - at)}x" if register.address > at else ""
            layout += _layout(register)
            words = range(register.address - self.address, register.end - self.address)
            order += range(at - self.address, register.address - self.address)
            swap = self.word_order == "little" and register.type != "string"
            order += reversed(words) if swap else words
            at = register.end
        object.__setattr__(self, "_order", tuple(order))
        object.__setattr__(self, "_values", struct.Struct(layout))
        object.__setattr__(self, "_names", frozenset(register.name for register in self.registers))

    @property
    def address(self) -> int:
        """First address of the run."""
        return self.registers[0].address

    @property
    def count(self) -> int:
        """Number of 16-bit registers in the run."""
        return self.registers[-1].end - self.address

    def decode(self, words: Sequence[int]) -> dict[str, Value]:
        """Turn the words of one answer into named, scaled values.

        Args:
            words: `count` register values, each 0..65535, in address order.

        Returns:
            Name -> value; integers stay integers where the scale is 1.

        Raises:
            RemoteProtocolError: the answer has another length, a word is not 16 bit, or a string is not text.
        """
        if len(words) != self.count:
            raise RemoteProtocolError(f"block {self.name!r}: expected {self.count} registers, got {len(words)}")
        try:
            raw = struct.pack(f">{self.count}H", *[words[i] for i in self._order])
        except struct.error as error:
            raise RemoteProtocolError(f"block {self.name!r}: a word is not 0..65535: {error}") from error
        values: dict[str, Value] = {}
        for register, value in zip(self.registers, self._values.unpack(raw), strict=True):
            values[register.name] = _from_wire(register, value)
        return values

    def encode(self, values: Mapping[str, Value]) -> list[int]:
        """Turn named values into the words of one write; registers not named are written as 0.

        Args:
            values: name -> scaled value.

        Returns:
            `count` words in address order.

        Raises:
            LocalProtocolError: a name is unknown, or a value does not fit its register.
        """
        if unknown := values.keys() - self._names:
            has = ", ".join(sorted(self._names))
            raise LocalProtocolError(f"block {self.name!r} has no register {min(unknown)!r}; it has {has}")
        numbers = [_to_wire(register, values.get(register.name)) for register in self.registers]
        try:
            raw = self._values.pack(*numbers)
        except (struct.error, OverflowError) as error:
            pairs = zip(self.registers, numbers, strict=True)
            text = next(_unfit(register, number, error) for register, number in pairs if not _fits(register, number))
            raise LocalProtocolError(text) from error
        words = struct.unpack(f">{self.count}H", raw)
        # The permutation reverses words inside each value, so it is its own inverse.
        return [words[i] for i in self._order]


class RegisterMap:
    """Blocks by name, for one device.

    Attributes:
        name: name of the map, as in the bench file.
        blocks: name -> `Block`.
    """

    def __init__(self, name: str, blocks: Iterable[Block]) -> None:
        self.name = name
        self.blocks: dict[str, Block] = {}
        taken: dict[int, str] = {}
        for block in blocks:
            if block.name in self.blocks:
                raise LocalProtocolError(f"register map {name!r}: block {block.name!r} is given twice")
            self.blocks[block.name] = block
            for register in block.registers:
                for address in range(register.address, register.end):
                    if address in taken:
                        raise LocalProtocolError(
                            f"register map {name!r}: {register.name!r} and {taken[address]!r} both use {address}"
                        )
                    taken[address] = register.name

    def block(self, name: str) -> Block:
        """The block of that name.

        Raises:
            LocalProtocolError: the map has no such block.
        """
        try:
            return self.blocks[name]
        except KeyError:
            raise LocalProtocolError(
                f"register map {self.name!r} has no block {name!r}; it has {', '.join(self.blocks)}"
            ) from None

    def register(self, name: str) -> Register:
        """The register of that name, in whichever block it lies.

        Raises:
            LocalProtocolError: the map has no such register.
        """
        for block in self.blocks.values():
            for register in block.registers:
                if register.name == name:
                    return register
        raise LocalProtocolError(f"register map {self.name!r} has no register {name!r}")


def _layout(register: Register) -> str:
    """Struct code of one register."""
    return f"{2 * register.length}s" if register.type == "string" else TYPES[register.type][0]


def _from_wire(register: Register, value: int | float | bytes) -> Value:
    """Scale a number, or read zero-padded text.

    Raises:
        RemoteProtocolError: the text is not ASCII.
    """
    if isinstance(value, bytes):
        try:
            return value.rstrip(b"\0").decode("ascii")
        except UnicodeDecodeError as error:
            raise RemoteProtocolError(f"register {register.name!r}: {value!r} is not ASCII text") from error
    return value if register.scale == 1.0 else value * register.scale


def _to_wire(register: Register, value: Value | None) -> int | float | bytes:
    """What the block's struct packs for a value; 0 for none.

    Raises:
        LocalProtocolError: the value is none that the register can hold.
    """
    try:
        if register.type == "string":
            return _text_to_wire(register, "" if value is None else value)
        return 0 if value is None else _number_to_wire(register, value)
    except (OverflowError, ValueError) as error:
        raise LocalProtocolError(_unfit(register, value, error)) from error


def _fits(register: Register, number: int | float | bytes) -> bool:
    try:
        struct.pack(">" + _layout(register), number)
    except (struct.error, OverflowError):
        return False
    return True


def _unfit(register: Register, value: object, error: Exception) -> str:
    kind = f"{register.type}, unit {register.unit or 'none'}"
    return f"register {register.name!r} ({kind}) cannot hold {value!r}: {error}"


def _text_to_wire(register: Register, value: Value) -> bytes:
    """Zero-padded ASCII of the register's length.

    Raises:
        ValueError: the text is too long, or not ASCII.
    """
    text = str(value).encode("ascii")
    if len(text) > 2 * register.length:
        raise ValueError(f"longer than {2 * register.length} characters")
    return text.ljust(2 * register.length, b"\0")


def _number_to_wire(register: Register, value: Value) -> int | float:
    """Undo the scale; refuse text, NaN, infinity and fractions of an integer.

    Raises:
        ValueError: the value is none the register can hold.
    """
    if isinstance(value, str):
        raise ValueError("text where a number belongs")
    number = value if register.scale == 1.0 else value / register.scale
    if not math.isfinite(number):
        raise ValueError("not a finite number")
    if register.type == "f32":
        return number
    if register.scale != 1.0:
        return round(number)
    if isinstance(number, float) and not number.is_integer():
        raise ValueError("not a whole number")
    return int(number)

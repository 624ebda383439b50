"""Binary frames of sensors, described by data: the meaning of each byte.

    sync   fields at their offsets ...   checksum   end          offsets count from 0, the first sync byte

A frame is accepted as a whole or not at all: sync, length, end and checksum must be correct. A packed stream has no
sync bytes; fixed bits in each of its bytes identify the position in the frame.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

from protocols.can_frame import CanFrame
from protocols.checksums import CHECKSUMS
from protocols.exchange import Exchange
from protocols.frame_format import STATUS_OVERLOAD, STATUS_SENSOR_FAULT

LONGEST_FRAME = 256
MOST_DECIMALS = 9
_WORD = 2
SIZES = {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u24": 3, "i24": 3, "u32": 4, "i32": 4, "u40": 5, "i40": 5,
         "u48": 6, "i48": 6, "u56": 7, "i56": 7, "u64": 8, "i64": 8, "f32": 4, "f64": 8}  # fmt: skip
"""Bytes of each type: u unsigned, i signed (two's complement), f IEEE float."""
ORDERS = ("little", "big")
STUFFINGS = ("none", "escape", "dle", "slip")
LETTERS = {"v": "value", "s": "status", "n": "sequence", "t": "time"}
"""Bits of a packed stream, by the field they belong to."""
_FLOATS = {4: {"little": "<f", "big": ">f"}, 8: {"little": "<d", "big": ">d"}}


@dataclass(frozen=True)
class Field:
    """One number in a frame.

    Attributes:
        at: its first byte; counts for nothing in a packed stream.
        type: a key of `SIZES`; "" in a packed stream.
        order: of its bytes.
        bits: lowest and highest bit of it that belong to the field, counted from 0; None: all.
        signed: two's complement.
        words_swapped: its 16-bit words come in the order opposite to that of the bytes within each of them.
        scale, offset: of the value: number * scale + offset; of the time: microseconds a tick.
        valid: lowest and highest number that is a reading; beyond is an overload.
        overload_values, fault_values: numbers that mean "input out of range" and "sensor broken".
        overload_bits, fault_bits: bits of a status of which any that is set means the same.
    """

    at: int = 0
    type: str = ""
    order: str = "little"
    bits: tuple[int, int] | None = None
    signed: bool = False
    scale: float = 1.0
    offset: float = 0.0
    valid: tuple[float, float] | None = None
    overload_values: tuple[int, ...] = ()
    fault_values: tuple[int, ...] = ()
    overload_bits: int = 0
    fault_bits: int = 0
    words_swapped: bool = False

    @property
    def size(self) -> int:
        """Bytes it takes."""
        return SIZES[self.type]

    def getter(self) -> Callable[[bytes], float]:
        """Reads the number from a frame."""
        if self.words_swapped and self.size > _WORD:
            places = range(self.at + self.size - _WORD, self.at - 1, -_WORD)
            get = replace(self, at=0, words_swapped=False).getter()
            return lambda frame: get(b"".join(frame[place : place + _WORD] for place in places))
        at, end, order, signed = self.at, self.at + self.size, self.order, self.signed
        if self.type.startswith("f"):
            read = struct.Struct(_FLOATS[self.size][order]).unpack_from
            return lambda frame: float(read(frame, at)[0])
        if self.bits is None:
            return lambda frame: int.from_bytes(frame[at:end], order, signed=signed)  # type: ignore[arg-type]  # "little" or "big"
        low, high = self.bits
        width = high - low + 1
        mask, half = (1 << width) - 1, 1 << width - 1

        def part(frame: bytes) -> int:
            raw = int.from_bytes(frame[at:end], order) >> low & mask  # type: ignore[arg-type]  # as above
            return raw - (1 << width) if signed and raw >= half else raw

        return part

    def modulus(self, packed_bits: int = 0) -> int:
        """How far the number counts before it begins anew."""
        if packed_bits:
            return int(1 << packed_bits)
        width = 8 * self.size if self.bits is None else self.bits[1] - self.bits[0] + 1
        return int(1 << width)

    def meaning(self, raw: float) -> int:
        """Status bits for a number of the value or the status."""
        beyond = self.valid is not None and not self.valid[0] <= raw <= self.valid[1]
        if beyond and raw not in self.fault_values:
            return STATUS_OVERLOAD
        status = 0
        if raw in self.overload_values or (self.overload_bits and int(raw) & self.overload_bits):
            status |= STATUS_OVERLOAD
        if raw in self.fault_values or (self.fault_bits and int(raw) & self.fault_bits):
            status |= STATUS_SENSOR_FAULT
        return status

    @property
    def judges(self) -> bool:
        """Whether some numbers are no readings."""
        return bool(
            self.valid or self.overload_values or self.fault_values or self.overload_bits or self.fault_bits
        )


@dataclass(frozen=True)
class Registers:
    """Modbus registers of one reading.

    Attributes:
        unit: address of the device.
        function: 3 (holding registers) or 4 (input registers).
        address: first register, as transmitted.
        count: number of registers.
        rtu: Modbus RTU, else Modbus TCP.
        largest_gap: maximum gap to the registers of another sensor for a combined request.
        first_address: address that the manual uses for register 0.
        value: address and number of the registers of the reading alone, without its status.
    """

    unit: int
    function: int
    address: int
    count: int
    rtu: bool
    largest_gap: int = 0
    first_address: int = 0
    value: tuple[int, int] = (0, 0)

    @property
    def end(self) -> int:
        """Address after the last register."""
        return self.address + self.count


@dataclass(frozen=True)
class BinaryFormat:
    """How one reading is written as a frame of bytes; made and checked by `protocols.sensor_format`.

    Attributes:
        name: as in the bench file.
        length: bytes of a whole frame, sync, checksum and end included, stuffing not.
        fields: by name: `value` and, if present, `status`, `sequence`, `time` and `decimals` (decimal places of the
            value).
        sync, end: bytes a frame begins and ends with.
        stuffing: "none"; "escape": in front of a sync, end or escape byte inside of the frame stands `escape`, and the
            byte is changed by `escape_xor`; "dle": sync and end are DLE and another byte, a DLE inside stands twice;
            "slip": as RFC 1055.
        escape, escape_xor: of that stuffing.
        packed: the bits of each byte of a packed stream, highest first: 0 and 1 as they must be, `LETTERS`, x for any;
            empty for frames.
        packed_order: "big": the first byte has a field's highest bits; "little": its lowest.
        checksum: "none", or a name of `protocols.checksums`.
        checksum_at: its first byte.
        checksum_over: first and last byte it covers.
        checksum_order: of its bytes.
        unit: unit of the value.
        nominal_rate_Hz: frames a second, or None.
        exchange: what is sent to the device.
        can: the CAN message that carries the frame; None for a byte stream.
        registers: of a format whose frames are Modbus answers; otherwise None.
    """

    name: str
    length: int
    fields: Mapping[str, Field]
    sync: bytes = b""
    end: bytes = b""
    stuffing: str = "none"
    escape: int = 0x10
    escape_xor: int = 0
    packed: tuple[str, ...] = ()
    packed_order: str = "big"
    checksum: str = "none"
    checksum_at: int = 0
    checksum_over: tuple[int, int] = (0, 0)
    checksum_order: str = "little"
    unit: str = "N"
    nominal_rate_Hz: float | None = None
    exchange: Exchange = field(default_factory=Exchange)
    can: CanFrame | None = None
    registers: Registers | None = None

    @property
    def has_sequence(self) -> bool:
        """Frames carry a number of their own."""
        return "sequence" in self.fields

    def intact(self, frame: bytes) -> bool:
        """Whether sync, end, fixed bits and checksum of a frame of the right length are right."""
        if not (frame.startswith(self.sync) and frame.endswith(self.end)):
            return False
        if self.packed and any(byte & mask != fixed for byte, (mask, fixed) in zip(frame, self.marks, strict=True)):
            return False
        if self.checksum == "none":
            return True
        kind = CHECKSUMS[self.checksum]
        first, last = self.checksum_over
        sent = frame[self.checksum_at : self.checksum_at + kind.size]
        return kind.of(frame[first : last + 1]).to_bytes(kind.size, self.checksum_order) == sent  # type: ignore[arg-type]  # as above

    @cached_property
    def marks(self) -> list[tuple[int, int]]:
        """Mask and value of the fixed bits of each byte of a packed stream."""
        return [
            (int("".join("1" if bit in "01" else "0" for bit in byte), 2), int(byte.translate(_FIXED), 2))
            for byte in self.packed
        ]

    def packed_bits(self, name: str) -> list[tuple[int, int]]:
        """Byte and bit (0 lowest) of every bit of a packed field, its highest first."""
        letter = next(letter for letter, field_name in LETTERS.items() if field_name == name)
        order = range(len(self.packed))
        return [
            (at, 7 - place)
            for at in (order if self.packed_order == "big" else reversed(order))
            for place, bit in enumerate(self.packed[at])
            if bit == letter
        ]

    def getter(self, name: str) -> Callable[[bytes], float]:
        """Reads a field from a frame."""
        item = self.fields[name]
        if not self.packed:
            return item.getter()
        places, half = self.packed_bits(name), 1 << max(0, len(self.packed_bits(name)) - 1)

        def unpacked(frame: bytes) -> int:
            raw = 0
            for at, bit in places:
                raw = raw << 1 | frame[at] >> bit & 1
            return raw - 2 * half if item.signed and raw >= half else raw

        return unpacked

    def modulus(self, name: str) -> int:
        """How far a counting field counts before it begins anew."""
        if self.can is not None and name == "sequence" and self.can.protection.modulus:
            return self.can.protection.modulus
        return self.fields[name].modulus(len(self.packed_bits(name)) if self.packed else 0)


_FIXED = str.maketrans({"v": "0", "s": "0", "n": "0", "t": "0", "x": "0"})


def scaled(item: Field, raw: float) -> float:
    """The value in the format's unit; not a number where it is not finite."""
    return raw * item.scale + item.offset if math.isfinite(raw) else math.nan

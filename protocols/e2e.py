"""Protection of CAN messages: a counter, a checksum, the AUTOSAR E2E profiles 1, 2, 5 and 11.

After AUTOSAR PRS_E2EProtocol (R22-11), chapters 6.3 (profile 1), 6.4 (2), 6.6 (5) and 6.11 (11). A profile's checksum
covers a data id that is not sent: a frame with a correct counter and a checksum that is wrong by the same bits every
time has another data id.
"""

from __future__ import annotations

import binascii
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from protocols.can_signals import Signal, put, take

FIFTEEN = 15
"""Counters of the profiles 1 and 11 run 0..14; 15 is not valid."""
BEYOND = -2
"""In place of a counter that is beyond its range."""


@dataclass(frozen=True, slots=True)
class Crc:
    """A cyclic redundancy check.

    Attributes:
        width: bits, a multiple of 8.
        polynomial: without its highest bit.
        initial: register at the start.
        final_xor: what the result is combined with.
        reflected: bits are taken least significant first, and the result is turned round.
    """

    width: int
    polynomial: int
    initial: int = 0
    final_xor: int = 0
    reflected: bool = False

    def table(self) -> tuple[int, ...]:
        """The register after each byte value, from a register of 0."""
        if self.reflected:
            turned = int(f"{self.polynomial:0{self.width}b}"[::-1], 2)
            return tuple(_steps(byte, lambda register: register >> 1 ^ (turned if register & 1 else 0))
                         for byte in range(256))
        top, mask = 1 << self.width - 1, (1 << self.width) - 1

        def step(register: int) -> int:
            return (register << 1 ^ (self.polynomial if register & top else 0)) & mask

        return tuple(_steps(byte << self.width - 8, step) for byte in range(256))

    def function(self) -> Callable[[bytes], int]:
        """The check as a function of bytes."""
        table, initial, final, width = self.table(), self.initial, self.final_xor, self.width
        if width == 8:
            def narrow(data: bytes) -> int:
                register = initial
                for byte in data:
                    register = table[register ^ byte]
                return register ^ final

            return narrow
        if self.reflected:
            def turned(data: bytes) -> int:
                register = initial
                for byte in data:
                    register = register >> 8 ^ table[(register ^ byte) & 0xFF]
                return register ^ final

            return turned
        mask = (1 << width) - 1

        def wide(data: bytes) -> int:
            register = initial
            for byte in data:
                register = register << 8 & mask ^ table[register >> width - 8 ^ byte]
            return register ^ final

        return wide


def _steps(register: int, step: Callable[[int], int]) -> int:
    for _ in range(8):
        register = step(register)
    return register


_J1850 = Crc(8, 0x1D).function()
"""CRC-8 SAE J1850 as the profiles 1 and 11 use it: start and final value cancel out to 0."""
_H2F = Crc(8, 0x2F, 0xFF, 0xFF).function()


@dataclass(frozen=True, slots=True)
class Protection:
    """Counter and checksum of one message.

    Attributes:
        profile: its name in a roles file.
        counter: where the counter lies; None without one.
        modulus: at which the counter starts again.
        checksum: where the checksum lies; None without one.
        compute: the checksum of a frame.
        fixed: further numbers that the header carries, such as the data id's nibble.
        data_id: the one that the checksum covers; -1 where it covers none.
        with_id: the same with another data id; None where it has none, or a list of them.
        ids: how many data ids there can be.
    """

    profile: str = "none"
    counter: Signal | None = None
    modulus: int = 0
    checksum: Signal | None = None
    compute: Callable[[bytes], int] | None = None
    fixed: tuple[tuple[Signal, int], ...] = ()
    data_id: int = -1
    with_id: Callable[[int], Protection] | None = None
    ids: int = 1 << 16

    def seal(self, data: bytearray, counter: int) -> None:
        """Put counter and checksum into a frame."""
        for signal, raw in self.fixed:
            put(data, signal, raw)
        if self.counter is not None:
            put(data, self.counter, counter % self.modulus)
        if self.checksum is not None and self.compute is not None:
            put(data, self.checksum, self.compute(bytes(data)))

    def difference(self, data: bytes) -> int:
        """By which bits the checksum of a frame is wrong; 0 where it is right, or there is none."""
        if self.checksum is None or self.compute is None:
            return 0
        return take(data, self.checksum) ^ self.compute(data)

    def fitting_ids(self, frames: Sequence[bytes]) -> list[int]:
        """The data ids with which every one of these frames is right; a checksum of 8 bits leaves many of them."""
        make, fitting = self.with_id, list(range(self.ids))
        if make is None:
            return []
        for data in frames:
            fitting = [number for number in fitting if make(number).fits(data)]
        return fitting

    def fits(self, data: bytes) -> bool:
        """Checksum and fixed numbers of a frame are right."""
        return not self.difference(data) and all(take(data, signal) == raw for signal, raw in self.fixed)

    def count(self, data: bytes) -> int:
        """The counter of a frame; -1 where it has none, `BEYOND` where it is beyond its range."""
        if self.counter is None:
            return -1
        count = take(data, self.counter)
        return count if count < self.modulus else BEYOND

    def places(self, size: int) -> dict[str, frozenset[int]]:
        """The bits of a frame of `size` bytes that it takes, by what takes them."""
        taken = {} if self.checksum is None else {"the checksum": self.checksum.bits(size)}
        if self.counter is not None:
            taken["the counter"] = self.counter.bits(size)
        for signal, _ in self.fixed:
            taken[signal.name] = signal.bits(size)
        return taken


def counted(counter: Signal, modulus: int = 0) -> Protection:
    """A counter alone, which starts again at `modulus` (0: when its bits are used up)."""
    return Protection("counter", counter, modulus or 1 << counter.length)


@dataclass(frozen=True, slots=True)
class Covered:
    """What a checksum of one's own covers beside the frame: a data id of so many bytes, before or behind it."""

    data_id: int = -1
    id_bytes: int = 2
    id_first: bool = True
    first_byte: int = 0
    last_byte: int = -1

    def of(self, size: int, checksum: range) -> Callable[[bytes], bytes]:
        """The bytes of a frame of `size` that are covered; those of the checksum never are."""
        last = size - 1 if self.last_byte < 0 else self.last_byte
        kept = [place for place in range(self.first_byte, last + 1) if place not in checksum]
        known = b"" if self.data_id < 0 else self.data_id.to_bytes(self.id_bytes, "little")
        if self.id_first:
            return lambda data: known + bytes([data[place] for place in kept])
        return lambda data: bytes([data[place] for place in kept]) + known


def checked(counter: Signal, modulus: int, checksum: Signal, crc: Crc, covered: Callable[[bytes], bytes],
            data_id: int = -1) -> Protection:  # fmt: skip
    """A counter and a checksum of the maker's own."""
    compute = crc.function()
    return Protection(
        "counter+crc", counter, modulus or 1 << counter.length, checksum, lambda data: compute(covered(data)),
        data_id=data_id,
    )


def profile_1(
    data_id: int, counter: Signal, checksum: Signal, mode: str = "both", nibble: Signal | None = None
) -> Protection:
    """AUTOSAR E2E profile 1: CRC-8 in a whole byte, counter 0..14 in four bits.

    Args:
        data_id: 16 bits (12 in mode `nibble`).
        counter: four bits.
        checksum: a whole byte.
        mode: which bytes of the data id the checksum covers: `both`, `low`, `alt` (low with even counters, high with
            odd ones), `nibble` (low, then 0; the low nibble of the high byte is sent).
        nibble: where that nibble is sent.
    """
    place = checksum.shift(0) // 8 if not checksum.big_endian else checksum.start // 8
    low, high = data_id & 0xFF, data_id >> 8
    both, lower, higher = bytes([low, high]), bytes([low]), bytes([high])

    def compute(data: bytes) -> int:
        if mode == "alt":
            known = higher if take(data, counter) & 1 else lower
        elif mode == "low":
            known = lower
        else:
            known = bytes([low, 0]) if mode == "nibble" else both
        return _J1850(known + data[:place] + data[place + 1 :])

    fixed = () if nibble is None else ((nibble, high & 0xF),)
    return Protection(
        "e2e-1", counter, FIFTEEN, checksum, compute, fixed, data_id,
        lambda other: profile_1(other, counter, checksum, mode, nibble), ids=1 << (12 if mode == "nibble" else 16),
    )


def profile_2(data_ids: Sequence[int], counter: Signal, checksum: Signal) -> Protection:
    """AUTOSAR E2E profile 2: CRC-8H2F in byte 0, counter 0..15 in the low nibble of byte 1, a list of 16 data ids."""
    known = [bytes([item]) for item in data_ids]
    return Protection(
        "e2e-2", counter, 16, checksum, lambda data: _H2F(data[1:] + known[take(data, counter)]), data_id=data_ids[0]
    )


def profile_5(data_id: int, counter: Signal, checksum: Signal) -> Protection:
    """AUTOSAR E2E profile 5: CRC-16 CCITT-FALSE in two bytes, low byte first, counter 0..255 behind them."""
    place = checksum.start // 8
    known = data_id.to_bytes(2, "little")
    return Protection(
        "e2e-5", counter, 256, checksum,
        lambda data: binascii.crc_hqx(data[:place] + data[place + 2 :] + known, 0xFFFF), data_id=data_id,
        with_id=lambda other: profile_5(other, counter, checksum),
    )


def profile_11(
    data_id: int, counter: Signal, checksum: Signal, mode: str = "both", nibble: Signal | None = None
) -> Protection:
    """AUTOSAR E2E profile 11: as profile 1 with the modes `both` and `nibble`, its header where `counter` says."""
    made = profile_1(data_id, counter, checksum, mode, nibble)
    return replace(made, profile="e2e-11")

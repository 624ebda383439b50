"""Counters and checksums of the simulated ECU's frames, by the division of `simulators.bit_sums`.

Shares no code with `protocols.e2e`, so that each finds the other's errors; tests compare both with the package
autosar-e2e.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from protocols.errors import RemoteProtocolError
from simulators.bit_sums import remainder

Bits = tuple[int, ...]
"""Numbers of a number's bits in a frame, the most significant first; byte n holds 8n..8n+7."""


@dataclass(frozen=True)
class Seal:
    """How one message is protected.

    Attributes:
        counter: its bits; empty without one.
        modulus: at which the counter starts again; 0 without one.
        checksum: its bits; empty without one.
        compute: the checksum of a frame with this counter.
        nibble: bits and number of a part of the data id that is sent.
    """

    counter: Bits = ()
    modulus: int = 0
    checksum: Bits = ()
    compute: Callable[[bytes, int], int] = lambda data, counter: 0
    nibble: tuple[Bits, int] = ((), 0)

    def put(self, data: bytearray, counter: int) -> None:
        """Protect a frame."""
        count = counter % self.modulus if self.modulus else 0
        _put(data, *self.nibble)
        _put(data, self.counter, count)
        _put(data, self.checksum, self.compute(bytes(data), count))

    def check(self, data: bytes) -> int:
        """The counter of a frame; -1 where it has none.

        Raises:
            RemoteProtocolError: wrong checksum, or a counter beyond its range.
        """
        count = _take(data, self.counter) if self.counter else -1
        if count >= max(self.modulus, 0) and self.counter:
            raise RemoteProtocolError(f"counter {count} is not valid")
        if self.checksum and _take(data, self.checksum) != self.compute(data, count):
            raise RemoteProtocolError(f"wrong checksum in {data.hex(' ')}")
        return count

    def damaged(self, data: bytes) -> bytes:
        """A frame with a bit of its checksum turned over, not always the same one; without a checksum, as it is."""
        damaged = bytearray(data)
        if self.checksum:
            bit = self.checksum[_take(data, self.counter) % len(self.checksum)]
            damaged[bit // 8] ^= 1 << bit % 8
        return bytes(damaged)


def seal_of(message: Any, given: Mapping[str, Any]) -> Seal:  # noqa: ANN401 - cantools has no types
    """The protection of a message as its table in the roles file says; the table was found right before."""
    profile = given.get("profile", "none")
    if profile == "none":
        return Seal()
    header = 8 * int(given.get("offset", 0))
    wide = profile == "e2e-5"
    counter = _bits(message, given.get("counter"), header + (16 if wide else 8), 8 if wide else 4)
    checksum = _bits(message, given.get("crc"), header, 16 if wide else 8)
    if profile == "counter":
        return Seal(counter, _modulus(given, counter))
    taken = sorted({bit // 8 for bit in checksum})
    if profile == "counter+crc":
        return Seal(counter, _modulus(given, counter), checksum, _own(given, len(checksum), taken, message.length))
    if profile == "e2e-2":
        ids = bytes(given["data_ids"])
        return Seal(
            counter, 16, checksum,
            lambda data, count: remainder(data[1:] + ids[count : count + 1], 8, 0x2F, 0xFF) ^ 0xFF,
        )
    number = int(given["data_id"])
    low, high = number & 0xFF, number >> 8
    if wide:
        return Seal(
            counter, 256, checksum,
            lambda data, _: remainder(_without(data, taken) + bytes([low, high]), 16, 0x1021, 0xFFFF),
        )
    mode = given.get("data_id_mode", "both")
    known = {"both": [low, high], "low": [low], "nibble": [low, 0]}

    def one(data: bytes, count: int) -> int:
        front = bytes(known[mode] if mode in known else [high if count % 2 else low])
        return remainder(front + _without(data, taken), 8, 0x1D, 0)

    nibble = (_bits(message, given.get("nibble"), header + 12, 4), high & 0xF) if mode == "nibble" else ((), 0)
    return Seal(counter, 15, checksum, one, nibble)


def _modulus(given: Mapping[str, Any], counter: Bits) -> int:
    return int(given.get("counter_max", 2 ** len(counter) - 1)) + 1


def _own(given: Mapping[str, Any], width: int, taken: list[int], size: int) -> Callable[[bytes, int], int]:
    """A checksum of the maker's own."""
    first, last = int(given.get("first_byte", 0)), int(given.get("last_byte", size - 1))
    known = b""
    if "data_id" in given:
        known = int(given["data_id"]).to_bytes(int(given.get("data_id_bytes", 2)), "little")

    def compute(data: bytes, _: int) -> int:
        covered = bytes(byte for place, byte in enumerate(data) if first <= place <= last and place not in taken)
        covered = known + covered if given.get("data_id_first", True) else covered + known
        start, reflected = int(given.get("initial", 0)), bool(given.get("reflected"))
        total = remainder(covered, width, int(given["polynomial"]), start, reflected=reflected)
        return total ^ int(given.get("final_xor", 0))

    return compute


def _without(data: bytes, taken: list[int]) -> bytes:
    return bytes(byte for place, byte in enumerate(data) if place not in taken)


def _bits(message: Any, name: str | None, start: int, length: int) -> Bits:  # noqa: ANN401 - cantools has no types
    """The bits of a signal, or of a little-endian number at `start`."""
    if name is None:
        return tuple(range(start + length - 1, start - 1, -1))
    signal = message.get_signal_by_name(name.rpartition(".")[2])
    if signal.byte_order == "little_endian":
        return tuple(range(signal.start + signal.length - 1, signal.start - 1, -1))
    bits = [signal.start]
    while len(bits) < signal.length:
        # Down through its byte, then on at the top of the next.
        bits.append(bits[-1] - 1 if bits[-1] % 8 else bits[-1] + 15)
    return tuple(bits)


def _put(data: bytearray, bits: Bits, number: int) -> None:
    for place, bit in enumerate(reversed(bits)):
        mask = 1 << bit % 8
        data[bit // 8] = data[bit // 8] & ~mask | (mask if number >> place & 1 else 0)


def _take(data: bytes, bits: Bits) -> int:
    return sum((data[bit // 8] >> bit % 8 & 1) << place for place, bit in enumerate(reversed(bits)))

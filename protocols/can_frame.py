"""A sensor's CAN message: which frames are its own, how they are protected, and what requests one.

Between the bus and the decoder each frame of the message is a row of bytes, so that a sensor on CAN is read as any
other stream of bytes is:

    length u8 | data, filled up to the size of the message
    identifier u32 (bit 31: extended) | remote u8 | length u8 | data        a request
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from protocols.can_signals import Condition, take
from protocols.e2e import Protection
from protocols.j1939 import parameter_group, source_address

EXTENDED = 1 << 31
"""Set in the number of a message with an extended identifier."""
_HEAD = 6
NO_PROTECTION = Protection()


@dataclass(frozen=True)
class CanFrame:
    """The message of one sensor.

    Attributes:
        identifier: without the mark of an extended one.
        size: bytes of its data.
        extended: 29-bit identifier.
        fd: CAN FD.
        by_group: J1939: known by its parameter group, from any source address.
        source_address: of such a message; None: the first address that is heard.
        protection: counter and checksum.
        pages: the multiplexers that must have one of these numbers for the reading to be in a frame.
        name: of the message in its DBC file; empty where there is none.
    """

    identifier: int
    size: int
    extended: bool = False
    fd: bool = False
    by_group: bool = False
    source_address: int | None = None
    protection: Protection = NO_PROTECTION
    pages: tuple[Condition, ...] = ()
    name: str = ""

    @property
    def key(self) -> int:
        """The identifier, `EXTENDED` set where it is extended."""
        return self.identifier | (EXTENDED if self.extended else 0)

    @property
    def group(self) -> int | None:
        """Its J1939 parameter group, by which a sender with another address is found; None for a standard frame."""
        return parameter_group(self.identifier) if self.extended else None

    @property
    def shown(self) -> str:
        """What it is called in messages."""
        number = f"0x{self.identifier:08X}" if self.extended else f"0x{self.identifier:03X}"
        return f"{self.name} ({number})" if self.name else number

    def is_own(self, identifier: int, *, extended: bool) -> bool:
        """Whether a frame is of this message, whatever its length; of one by group, from any address."""
        if extended != self.extended:
            return False
        return parameter_group(identifier) == self.group if self.by_group else identifier == self.identifier

    def is_from_elsewhere(self, identifier: int, *, extended: bool) -> bool:
        """Whether a frame has the parameter group of this message and another source address than it states."""
        if self.by_group or not (extended and self.extended) or parameter_group(identifier) != self.group:
            return False
        return source_address(identifier) != source_address(self.identifier)

    def row(self, data: bytes) -> bytes:
        """A frame as the decoder takes it."""
        return bytes([len(data)]) + data[: self.size].ljust(self.size, b"\0")

    def is_on_page(self, data: bytes) -> bool:
        """Whether the reading is in this frame."""
        return all(take(data, signal) in numbers for signal, numbers in self.pages)


def encode_request(key: int, data: bytes, *, remote: bool) -> bytes:
    """The bytes of one request.

    Args:
        key: its identifier, `EXTENDED` set where it is extended.
        data: of a remote frame only its length counts.
        remote: a remote frame.
    """
    return key.to_bytes(4, "big") + bytes([remote, len(data)]) + data


def decode_requests(data: bytes) -> Iterator[tuple[int, bytes, bool]]:
    """Identifier (with `EXTENDED`), data and whether it is a remote frame, of each of several requests."""
    at = 0
    while at < len(data):
        key, remote, length = int.from_bytes(data[at : at + 4], "big"), bool(data[at + 4]), data[at + 5]
        yield key, data[at + _HEAD : at + _HEAD + length], remote
        at += _HEAD + length

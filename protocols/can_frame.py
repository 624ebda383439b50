"""A sensor's CAN message: selection of its frames, protection, and requests.

Between the bus and the decoder, each frame is a row of bytes, so the decoder of byte streams also reads CAN sensors:

    length u8 | data, padded to the size of the message
    identifier u32 (bit 31: extended) | remote u8 | length u8 | data        a request
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from protocols.can_signals import Condition, take
from protocols.e2e import Protection
from protocols.j1939 import parameter_group, source_address

EXTENDED = 1 << 31
"""Flag in the number of a message with an extended identifier, as in a DBC file."""
_HEAD = 6
NO_PROTECTION = Protection()


@dataclass(frozen=True)
class CanFrame:
    """The message of one sensor.

    Attributes:
        identifier: without the flag of an extended identifier.
        size: number of data bytes.
        extended: 29-bit identifier.
        fd: CAN FD.
        by_group: whether it is a J1939 message, identified by its parameter group.
        source_address: of a J1939 message; None: the first address received.
        protection: counter and checksum.
        pages: multiplexers, and the numbers with which a frame contains the reading.
        name: of the message in its DBC file; empty without a DBC file.
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
        """The identifier, with the flag `EXTENDED` if it is extended."""
        return self.identifier | (EXTENDED if self.extended else 0)

    @property
    def group(self) -> int | None:
        """J1939 parameter group of the message; None for a standard frame."""
        return parameter_group(self.identifier) if self.extended else None

    @property
    def shown(self) -> str:
        """Description of the message, for error messages."""
        number = f"0x{self.identifier:08X}" if self.extended else f"0x{self.identifier:03X}"
        return f"{self.name} ({number})" if self.name else number

    def is_own(self, identifier: int, *, extended: bool) -> bool:
        """Whether a frame belongs to this message, regardless of its length (and of its address for `by_group`)."""
        if extended != self.extended:
            return False
        return parameter_group(identifier) == self.group if self.by_group else identifier == self.identifier

    def is_from_elsewhere(self, identifier: int, *, extended: bool) -> bool:
        """Whether a frame has the parameter group of this message but a different source address."""
        if self.by_group or not (extended and self.extended) or parameter_group(identifier) != self.group:
            return False
        return source_address(identifier) != source_address(self.identifier)

    def row(self, data: bytes) -> bytes:
        """A frame as a row for the decoder."""
        return bytes([len(data)]) + data[: self.size].ljust(self.size, b"\0")

    def is_on_page(self, data: bytes) -> bool:
        """Whether this frame contains the reading."""
        return all(take(data, signal) in numbers for signal, numbers in self.pages)


def encode_request(key: int, data: bytes, *, remote: bool) -> bytes:
    """The bytes of one request.

    Args:
        key: identifier, with the flag `EXTENDED` if it is extended.
        data: for a remote frame, only the length is used.
        remote: whether it is a remote frame.
    """
    return key.to_bytes(4, "big") + bytes([remote, len(data)]) + data


def decode_requests(data: bytes) -> Iterator[tuple[int, bytes, bool]]:
    """Identifier (with `EXTENDED`), data and remote flag of each request."""
    at = 0
    while at < len(data):
        key, remote, length = int.from_bytes(data[at : at + 4], "big"), bool(data[at + 4]), data[at + 5]
        yield key, data[at + _HEAD : at + _HEAD + length], remote
        at += _HEAD + length

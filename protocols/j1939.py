"""Identifiers of SAE J1939-21: priority (3 bits), group with destination (18 bits), source address (8 bits)."""

from __future__ import annotations

PLACEHOLDERS = (0xFE, 0xFF)
"""Source addresses from which no node sends data: in a description they stand for any address."""
HIGHEST_ADDRESS = 0xFD
_FIRST_BROADCAST = 0xF0
"""PDU format from which on the next byte belongs to the parameter group; below, it is the destination address."""


def source_address(identifier: int) -> int:
    """Address of the node that sends a frame."""
    return identifier & 0xFF


def parameter_group(identifier: int) -> int:
    """Number of a frame's parameter group (PGN), whatever its priority, source and destination."""
    group = identifier >> 8 & 0x3FFFF
    return group if group >> 8 & 0xFF >= _FIRST_BROADCAST else group & 0x3FF00


def from_address(identifier: int, address: int) -> int:
    """The identifier of the same message sent from another address."""
    return identifier & ~0xFF | address


def same_receiver(identifier: int) -> int:
    """What frames of one parameter group to one destination have in common, whatever their priority and source."""
    return identifier >> 8 & 0x3FFFF

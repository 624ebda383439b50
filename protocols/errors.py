"""Errors on the wire: caused by this host (`LocalProtocolError`) or by the peer (`RemoteProtocolError`)."""

from __future__ import annotations


class ProtocolError(Exception):
    """Base of everything this room raises."""


class LocalProtocolError(ProtocolError):
    """We were asked to send or describe something the wire format cannot carry.

    Situations: a value outside the field's range, an unknown register or format name, a description (register map,
    line format) that contradicts itself. Nothing has been sent when it is raised.
    """


class RemoteProtocolError(ProtocolError):
    """The peer sent bytes that the wire format forbids.

    Situations: wrong length, wrong checksum, a counter outside its range, a code without a meaning, text where a
    number belongs, a line longer than the format allows.
    """

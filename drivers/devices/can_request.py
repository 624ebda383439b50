"""A request on CAN for one message: a remote frame with its identifier, or a data frame that the device answers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from protocols.can_frame import EXTENDED, encode_request
from protocols.descriptions import Place, Problem

_STANDARD_BITS = 11


def read_request(
    given: str | Mapping[str, Any], key: int, size: int, place: Place, problems: list[Problem], *, fd: bool,
    addressed: bool
) -> bytes:
    """The request for a message, as `protocols.can_frame` writes it.

    Args:
        given: "remote", or `id`, `extended` and `data` of a data frame.
        key: identifier of the message, with the flag `EXTENDED` if it is extended.
        size: number of data bytes of the message.
        place: of the entry, for `problems`.
        problems: takes what is wrong.
        fd: whether the message is a CAN FD frame.
        addressed: whether the identifier is complete; that of a J1939 message without a source address is not.
    """
    if isinstance(given, str):
        if fd:
            problems.append((place, "CAN FD has no remote frames. Fix: write the identifier and data of a request, "
                "such as request = {id = 0x080, data = []}"))
        if not addressed:
            problems.append((place, "a remote frame needs the complete identifier. Fix: specify source_address"))
        return encode_request(key, bytes(size), remote=True)
    own = request_key(given)
    if own == key:
        problems.append(((*place, "id"), f"0x{given['id']:X} is the identifier of the requested message; a "
            "data frame with this identifier would be taken for the answer. Fix: write the identifier of the request, "
            'or "remote"'))
    return encode_request(own, bytes(given.get("data", ())), remote=False)


def request_key(table: Mapping[str, Any]) -> int:
    """Identifier of a data frame that is a request, with the flag `EXTENDED` if it is extended."""
    identifier: int = table["id"]
    return identifier | (EXTENDED if table.get("extended", identifier >> _STANDARD_BITS != 0) else 0)

"""Listening to a CAN bus without a description: which frames come, and what a DBC makes of them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from drivers import clock
from drivers.can_port import CanPort
from drivers.connection import CanAddress
from drivers.devices.dbc_file import DbcText, can_database
from protocols.errors import LocalProtocolError
from protocols.guess_can import CanFrame, CanLog

MOST_FRAMES = 200_000
"""Heard at a time; a full 1 Mbit/s bus carries some 8,000 a second."""


def listen_to_can(address: CanAddress, seconds: float) -> CanLog:
    """Record the traffic on a bus without sending anything.

    Raises:
        PortClosed: the bus cannot be opened or was lost.
    """
    port = CanPort(address, device="bus")
    port.open()
    heard = CanLog()
    try:
        begin_s = clock.monotonic()
        while len(heard.frames) < MOST_FRAMES and (left_s := begin_s + seconds - clock.monotonic()) > 0.0:
            frames, arrival_ns = port.receive(min(left_s, 0.1))
            heard.frames += [(arrival_ns * 1e-9, frame[0], frame[1], frame[2]) for frame in frames if not frame[3]]
            heard.remote.update(frame[0] for frame in frames if frame[3])
    finally:
        port.close()
    if port.bus_errors:
        heard.errors["error"] = port.bus_errors
    return heard


def decoded(frames: Sequence[CanFrame], dbc: DbcText) -> tuple[dict[int, dict[str, Any]], list[int]]:
    """Each message and signal of frames: by identifier the message's name and each signal's lowest and highest value.

    Args:
        frames: as received.
        dbc: a DBC file, or another network description (`dbc_file.FORMATS`), known by the ending of its name.

    Returns:
        That, and the identifiers that are not described.

    Raises:
        LocalProtocolError: the text is not of the format that its name states.
    """
    try:
        database = can_database(dbc.text, dbc.format)
    except LocalProtocolError as error:
        raise LocalProtocolError(f"{dbc.name}: {error}") from error
    # after python-can, which cantools would have load its MF4 reader
    from cantools.database.errors import Error

    known: dict[int, dict[str, Any]] = {}
    unknown: set[int] = set()
    for _, identifier, data, _ in frames:
        try:
            message = database.get_message_by_frame_id(identifier)
            values = message.decode(data, decode_choices=False, allow_truncated=True)
        except KeyError:
            unknown.add(identifier)
            continue
        except (ValueError, Error):
            values = {}
        entry = known.setdefault(identifier, {"message": message.name, "frames": 0, "undecoded": 0, "signals": {}})
        entry["frames"] += 1
        entry["undecoded"] += not values
        for name, value in values.items():
            if isinstance(value, (int, float)) and math.isfinite(value):
                low, high = entry["signals"].get(name, (value, value))
                entry["signals"][name] = (min(low, value), max(high, value))
    return known, sorted(unknown)

"""What a current source described by a roles file cannot do or does not report, and what remains without it."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.devices.ecu_description import (
    BOOTS,
    CLOCK,
    COIL,
    ENABLE,
    FAULTS,
    SERIAL,
    STATE,
    SUPPLY,
    EcuDescription,
)

WITHOUT: Mapping[str, str] = {
    "timeout": (
        "it is not stated that the current goes to 0 A when this host falls silent (command_timeout): if the host or "
        "the bus dies, the current stays until the supply is switched off by hand"
    ),
    "faults": "its own faults (open coil, short, heat) are not seen; its current is judged",
    "enable": "its output stage cannot be switched off; a stop commands 0 A",
    "counter": "{status} has no counter: repeated or lost frames are not noticed, only silence is",
    "checksum": "{status} has no checksum: a wrong frame is taken for right",
    "command-checksum": "commands have no checksum: the source may take a damaged one for right",
    "coil-temperature": "the coil's temperature is not measured: its limit is not watched",
    "supply": "its supply voltage is not recorded",
    "state": "the state of its output stage is not recorded",
    "restart": "a restart shows only by its faults or its silence",
    "clock": "its frames are timed by their arrival at this host",
    "identity": "nothing proves that it is the one of the bench file",
    "layout": "nothing proves that its frames are laid out as the DBC says",
    "periods": "how often {unwatched} should come is stated nowhere; write it under [periods]",
}
"""Name of what can be missing, and what remains without it; the most important first."""


def missing(described: EcuDescription) -> tuple[tuple[str, str], ...]:
    """Name and consequence of everything that is missing."""
    status, roles = described.heard[described.status], described.roles
    sends = {role for frame in described.sent for role in frame.writer.changing}
    unwatched = [message.name for message in described.heard.values() if not message.period_s]
    there = {
        "timeout": described.command_timeout_s is not None and described.cyclic,
        "faults": any(role == FAULTS or role.startswith(f"{FAULTS}.") for role in roles),
        "enable": ENABLE in sends,
        "counter": status.protection.counter is not None or CLOCK in status.roles,
        "checksum": status.protection.checksum is not None,
        "command-checksum": all(frame.protection.checksum is not None for frame in described.sent),
        "coil-temperature": COIL in roles,
        "supply": SUPPLY in roles,
        "state": STATE in roles,
        "restart": BOOTS in roles,
        "clock": CLOCK in roles,
        "identity": SERIAL in roles,
        "layout": described.layout is not None,
        "periods": not unwatched,
    }
    known = {"status": status.name, "unwatched": ", ".join(unwatched)}
    return tuple((name, text.format(**known)) for name, text in WITHOUT.items() if not there[name])

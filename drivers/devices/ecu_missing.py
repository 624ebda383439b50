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
        "no command time-out is specified (command_timeout): if this host or the bus fails, the current continues "
        "to flow until the supply is switched off manually"
    ),
    "faults": "the ECU's own faults (open coil, short circuit, overheating) are not reported; only the current is "
    "checked",
    "enable": "the output stage cannot be switched off; a stop commands 0 A",
    "counter": "{status} has no counter: repeated or lost frames are not detected, only a loss of communication",
    "checksum": "{status} has no checksum: a corrupted frame is accepted",
    "command-checksum": "commands have no checksum: the current source may accept a corrupted command",
    "coil-temperature": "the coil's temperature is not measured: its limit is not monitored",
    "supply": "the ECU's supply voltage is not recorded",
    "state": "the state of the ECU's output stage is not recorded",
    "restart": "a restart is detected only if it causes a fault or a loss of communication",
    "clock": "the ECU's frames are time-stamped on arrival at this host",
    "identity": "the ECU's identity cannot be checked against the bench file",
    "layout": "the frame layout cannot be checked against the DBC file",
    "periods": "the period of {unwatched} is not specified. Fix: enter the period under [periods]",
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

"""What a current source described by a roles file cannot do or does not tell, and what is left without it."""

from __future__ import annotations

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


def lacking(described: EcuDescription) -> tuple[tuple[str, str], ...]:
    """Name and words of everything that is missing, the most important first."""
    status, roles = described.heard[described.status], described.roles
    sends = {role for frame in described.sent for role in frame.writer.changing}
    told_faults = any(role == FAULTS or role.startswith(f"{FAULTS}.") for role in roles)
    sealed = all(frame.protection.checksum is not None for frame in described.sent)
    unwatched = [message.name for message in described.heard.values() if not message.period_s]
    without = {
        "timeout": (
            described.command_timeout_s is not None and described.cyclic,
            "it is not stated that the current goes to 0 A when this host falls silent (command_timeout): if the host "
            "or the bus dies, the current stays until the supply is switched off by hand",
        ),
        "faults": (told_faults, "its own faults (open coil, short, heat) are not seen; its current is judged"),
        "enable": (ENABLE in sends, "its output stage cannot be switched off; a stop commands 0 A"),
        "counter": (
            status.protection.counter is not None or CLOCK in status.roles,
            f"{status.name} has no counter: repeated or lost frames are not noticed, only silence is",
        ),
        "checksum": (
            status.protection.checksum is not None, f"{status.name} has no checksum: a wrong frame is taken for right"
        ),
        "command-checksum": (sealed, "commands have no checksum: the source may take a damaged one for right"),
        "coil-temperature": (COIL in roles, "the coil's temperature is not measured: its limit is not watched"),
        "supply": (SUPPLY in roles, "its supply voltage is not recorded"),
        "state": (STATE in roles, "the state of its output stage is not recorded"),
        "restart": (BOOTS in roles, "a restart shows only by its faults or its silence"),
        "clock": (CLOCK in roles, "its frames are timed by their arrival at this host"),
        "identity": (SERIAL in roles, "nothing proves that it is the one of the bench file"),
        "layout": (described.layout is not None, "nothing proves that its frames are laid out as the DBC says"),
        "periods": (
            not unwatched,
            f"how often {', '.join(unwatched)} should come is stated nowhere; write it under [periods]",
        ),
    }
    return tuple((name, text) for name, (has, text) in without.items() if not has)

"""States and faults of the simulated current ECU; its description maps them to the codes of its frames."""

from __future__ import annotations

from enum import IntEnum, IntFlag


class EcuState(IntEnum):
    """What the ECU's output stage is doing."""

    INIT = 0
    OFF = 1
    ENABLED = 2
    FAULT = 3


class EcuFault(IntFlag):
    """Bits of `Faults`; on any of them the ECU drives 0 A on its own."""

    OVER_TEMPERATURE = 1 << 0
    UNDERVOLTAGE = 1 << 1
    OPEN = 1 << 2
    SHORT = 1 << 3
    COMMAND_TIMEOUT = 1 << 4
    COMMAND_CHECK = 1 << 5
    RESTARTED = 1 << 6

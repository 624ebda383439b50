"""What the simulated ECU's frames look like, whoever laid them out: the ECU itself knows physics and faults only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple, Protocol

EXTENDED = 1 << 31
"""Set in the number of a frame with an extended identifier, as in a DBC file."""

Frame = tuple[int, bytes]
"""Identifier (`EXTENDED` set where it is extended) and data."""


class Command(NamedTuple):
    """What a command asks for; `counter` is -1 where commands have none."""

    counter: int
    enable: bool
    clear_faults: bool
    setpoint_A: float


@dataclass(frozen=True)
class Shown:
    """What the ECU would say of itself at one instant; `state` and `faults` by its own firmware's codes."""

    state: int = 0
    current_A: float = 0.0
    faults: int = 0
    duty_percent: float = 0.0
    device_us: int = 0
    coil_degC: float = 0.0
    ecu_degC: float = 0.0
    supply_V: float = 0.0
    boot_count: int = 0
    serial_number: int = 0


class EcuWire(Protocol):
    """Frames of one kind of ECU.

    Attributes:
        periods_us: of each message that it sends, in the order in which those of one instant go out.
        temperatures: the messages among them that tell temperatures and nothing that the rig cannot do without.
        counter_modulus: at which the counter of commands starts again.
    """

    periods_us: Mapping[str, int]
    temperatures: frozenset[str]
    counter_modulus: int

    def reset(self) -> None:
        """Start: counters at 0, no command heard."""

    def timeout_s(self, usual_s: float) -> float:
        """After so long without a command the ECU goes to 0 A by itself (s); infinite for one that does not."""

    def is_command(self, identifier: int) -> bool:
        """Whether a frame is one of the host's commands."""

    def command(self, identifier: int, data: bytes) -> Command | None:
        """What the host asks for; None while a part of it has not come.

        Raises:
            RemoteProtocolError: wrong length, checksum or counter.
        """

    def commands(self, command: Command) -> list[Frame]:
        """The frames by which a host would ask for that."""

    def frame(self, name: str, shown: Shown) -> Frame:
        """The next frame of a message."""

    def damaged(self, frame: Frame) -> Frame:
        """A frame with a wrong checksum; one without a checksum as it is."""

"""What the supervisor needs of the devices, as roles; the threads fill them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from protocols.actuator import ActuatorIdentity, ActuatorLimits, ActuatorStatus, Command
from protocols.register_map import Value
from rig.station.safe_stop import StopAction


class Coil(Protocol):
    """What the supervisor needs of the ECU's side."""

    def zero_now(self) -> None:
        """Command 0 A and put the frame on the wire at once; never raises."""

    @property
    def fresh_current_A(self) -> float | None:
        """Measured current (A), None when its status is stale."""


class Motion(Protocol):
    """What the supervisor needs of the actuator's side."""

    def act(self, action: StopAction) -> None:
        """Have the actuator's thread carry out a stop action before anything else; returns at once."""

    def fill_view(self, now_ns: int) -> tuple[bool | None, float | None, bool | None, bool | None]:
        """Moving, clock (s), hydraulics low, hydraulics off; each None without a fresh status."""

    @property
    def stop_taken(self) -> bool:
        """No stop command waits to be sent or to be acknowledged."""

    @property
    def state_name(self) -> str | None:
        """The controller's state by name, None without a fresh status."""


class Travel(Protocol):
    """What the supervisor needs of the LVDT's side."""

    def still_s(self, now_ns: int) -> float | None:
        """Device seconds of proved standstill, None when the LVDT is stale."""

    def restart_still(self) -> None:
        """Begin the proof of standstill anew."""

    def position_m(self, now_ns: int) -> float | None:
        """Latest position (m), None when stale."""


class Watched(Protocol):
    """A source of data whose thread and age the supervisor watches."""

    slug: str
    name: str

    @property
    def alive(self) -> bool:
        """Its thread runs."""

    def silent_ns(self, now_ns: int) -> tuple[int, int]:
        """Age of its last data and the age at which they are stale (ns)."""


class ActuatorDriver(Protocol):
    """What this thread needs of the controller's driver."""

    @property
    def is_open(self) -> bool:
        """The connection stands, as far as is known."""

    @property
    def url(self) -> str:
        """URL of the connection."""

    @property
    def stale(self) -> int:
        """Answers to other requests that were recognised and thrown away."""

    @property
    def busy(self) -> int:
        """"Busy" answers that were asked again."""

    @property
    def sent(self) -> Sequence[tuple[int, int]]:
        """Sequence and command of the last commands written, oldest first."""

    def open(self) -> None:
        """Open the connection."""

    def close(self) -> None:
        """Close the connection."""

    def read_identity(self) -> ActuatorIdentity:
        """Identity block, signature proved."""

    def read_status(self) -> ActuatorStatus:
        """Status block."""

    def exchange(self, watchdog_counter: int) -> ActuatorStatus:
        """Feed the watchdog and read the status block in one trip."""

    def write_limits(self, limits: ActuatorLimits) -> None:
        """Write the config block."""

    def read_limits(self) -> ActuatorLimits:
        """Read the config block back."""

    def write_table(self, values_m: list[float]) -> None:
        """Load the samples of a table waveform (m about the centre)."""

    def send(self, command: Command, **values: Value) -> int:
        """Send a command; its sequence number."""

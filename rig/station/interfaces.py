"""Interface of the device threads that the supervisor uses."""

from __future__ import annotations

from typing import Protocol

from rig.station.safe_stop import StopAction


class Coil(Protocol):
    """What the supervisor needs of the ECU's side."""

    def zero_now(self) -> None:
        """Command 0 A and put the frame on the wire at once; never raises."""

    @property
    def fresh_current_A(self) -> float | None:
        """Measured current (A), None when its status is stale."""

    @property
    def zero_within_s(self) -> float:
        """After so long a commanded 0 A must be measured (wall s)."""

    @property
    def falls_within_s(self) -> float | None:
        """After so long without commands it is at 0 A (wall s); None: it keeps its current."""

    @property
    def own_timeout_s(self) -> float | None:
        """Time-out of its own commands that its description declares (wall s); None: none, or set manually."""


class Motion(Protocol):
    """What the supervisor needs of the actuator's side."""

    def act(self, action: StopAction) -> None:
        """Have the actuator's thread carry out a stop action before anything else; returns at once."""

    def stop_inputs(self, now_ns: int) -> tuple[bool | None, float | None, bool | None, bool | None]:
        """Moving, clock (s), hydraulics low, hydraulics off; each None without a fresh status."""

    def restart_still(self) -> None:
        """Begin the proof of standstill anew, by statuses read after the stop command was sent."""

    def hold_place(self) -> None:
        """Standstill is proved: the rod has to stay where it is."""

    def left_place(self, now_ns: int) -> bool:
        """A fresh status shows the rod away from where its standstill was proved."""

    @property
    def stop_taken(self) -> bool:
        """No stop command waits to be sent or to be acknowledged."""

    @property
    def state_name(self) -> str | None:
        """The controller's state by name, None without a fresh status."""

    @property
    def pressure_name(self) -> str | None:
        """`off`, `low`, `on`, `unknown`; `none` where there is none to take away; None without a fresh status."""


class Travel(Protocol):
    """What the supervisor needs of the LVDT's side."""

    def still_s(self, now_ns: int) -> float | None:
        """Device seconds of proved standstill, None when the LVDT is stale or says nothing of the rod."""

    @property
    def changed(self) -> bool:
        """The LVDT's value has changed since the proof of standstill began, and not stood for too long since."""

    def restart_still(self) -> None:
        """Begin the proof of standstill anew."""

    def hold_place(self) -> None:
        """Standstill is proved: the rod has to stay where it is."""

    def left_place(self, now_ns: int) -> bool:
        """An LVDT that shows where the rod is shows it away from where its standstill was proved."""

    def position_m(self, now_ns: int) -> float | None:
        """Latest position (m), None when stale."""

    @property
    def speed_m_s(self) -> float:
        """Speed of the rod (m/s); NaN while unknown."""


class Watched(Protocol):
    """A source of data whose thread and age the supervisor watches."""

    slug: str
    name: str

    @property
    def alive(self) -> bool:
        """Its thread runs."""

    def silent_ns(self, now_ns: int) -> tuple[int, int]:
        """Age of its last data and the age at which they are stale (ns)."""

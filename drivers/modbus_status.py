"""Status of a Modbus actuator: what its registers show at a poll, completed by what they do not show."""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers import clock
from drivers.derived_status import DerivedStatus
from drivers.errors import WrongAnswer
from drivers.register_access import RegisterAccess
from drivers.register_maps.access_plan import Written
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.quantity import Value
from drivers.roles import ActuatorStatus
from protocols.errors import RemoteProtocolError


class ModbusStatus:
    """Reads the status of one device.

    Args:
        access: its registers.
        controller: its map.
        derived: what its registers do not show.
        url: where it is, for errors.

    Attributes:
        values: what it showed at the last poll (SI); empty before the first.
        position_m: the last finite one.
    """

    def __init__(self, access: RegisterAccess, controller: ControllerMap, derived: DerivedStatus, url: str) -> None:
        self._access = access
        self._map = controller
        self._derived = derived
        self._url = url
        self.values: dict[str, Value] = {}
        self.position_m = 0.0

    @property
    def state(self) -> int:
        """The rig's state for what was shown at the last poll."""
        return self._map.state_of(self.values)

    def read(self, requests: Sequence[Written], *, once: bool = False) -> int:
        """Write and read.

        Args:
            requests: what is written.
            once: it is out of date when it would be written again.

        Returns:
            When the answer was there (ns, monotonic).

        Raises:
            WrongAnswer: the words do not make up the status.
            DriverError: the controller cannot be reached.
        """
        values = self._access.read(self._map.status_reads, "status", requests, once=once)
        if len(self._map.status_reads) > 1 and self._map.differs(values, self.values):
            # What changed between two requests of a poll is only half seen.
            values = self._access.read(self._map.status_reads, "status")
        received_ns = clock.monotonic_ns()
        self._access.explains = False
        values |= self._derived.unwrapped(values)
        self.values = values
        # A stop may write where the rod is: a position that is no number must not hold it back.
        if math.isfinite(position_m := float(values["position"])):
            self.position_m = position_m
        return received_ns

    def shown(self, received_ns: int) -> ActuatorStatus:
        """The status of what was read.

        Raises:
            WrongAnswer: the words do not make up the status.
        """
        try:
            status = self._map.status(self.values, received_ns, self._derived.knows(self.values, received_ns))
        except RemoteProtocolError as error:
            raise WrongAnswer("actuator", self._url, f"status: {error}") from error
        return self._derived.completed(status)

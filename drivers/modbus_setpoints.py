"""Set-points of a Modbus actuator, and what feeds its watchdog: what is written with a poll; each has its counters."""

from __future__ import annotations

import math

from drivers.capabilities import WatchdogKind
from drivers.register_maps.access_plan import Written
from drivers.register_maps.condition import Values
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.recipe import Recipe, Write, position_for
from drivers.roles import State
from drivers.setpoint_generator import Setpoint

COUNTERS = 1 << 16
HELD = frozenset({State.HOLD, State.MOVING, State.RUNNING})
"""States in which the device goes where its set-points say."""


class ModbusSetpoints:
    """Makes the requests of one device.

    Args:
        controller: its map.

    Attributes:
        halted: the device was halted by a command; a set-point could have it go on.
    """

    def __init__(self, controller: ControllerMap) -> None:
        self.halted = False
        self._recipes = controller.recipes
        streamed = bool(controller.recipes.setpoint) and not controller.recipes.feed
        self._by_setpoints = streamed and controller.capabilities.watchdog is WatchdogKind.TIMEOUT
        self._toggle = 0
        self._counter = 0
        self._steps = 0
        self._held_m = math.nan

    def feed(self, counter: int) -> list[Written]:
        """The writes that feed the watchdog; where set-points do, one that leaves the rod where it is held.

        Args:
            counter: taken modulo 65536.
        """
        if self._by_setpoints:
            known = math.isfinite(self._held_m) and not self.halted
            held_m = position_for(self._recipes.setpoint, self._held_m)  # a watchdog is fed wherever the rod is
            return self.setpoint(Setpoint(held_m, 0.0), counter) if known else []
        self._toggle ^= 1
        return _requests(self._recipes.feed, {"counter": counter % COUNTERS, "toggle": self._toggle})

    def seen(self, state: int, values: Values) -> None:
        """What a poll shows: under pressure the rod is held where it was, else it is wherever it is.

        Args:
            state: of the device.
            values: of its quantities (SI).
        """
        if state not in HELD or not math.isfinite(self._held_m):
            shown = values.get("setpoint", values["position"]) if state in HELD else values["position"]
            self._held_m = float(shown)

    def setpoint(self, setpoint: Setpoint, counter: int | None) -> list[Written]:
        """The writes of a set-point; the watchdog's counter in it stays where it is not fed.

        Args:
            setpoint: where to be (m), and how fast to go on (m/s).
            counter: as in `feed`; None: it is not fed.

        Raises:
            LocalProtocolError: a value does not fit its register.
        """
        if counter is not None:
            self._counter = counter % COUNTERS
        self._held_m = setpoint.position_m
        self._steps = (self._steps + 1) % COUNTERS
        given = {
            "position": setpoint.position_m, "velocity": setpoint.velocity_m_s, "sequence": self._steps,
            "counter": self._counter,
        }
        return _requests(self._recipes.setpoint, given)


def _requests(recipe: Recipe, given: Values) -> list[Written]:
    return [request for step in recipe if isinstance(step, Write) for request in step.requests(given)]

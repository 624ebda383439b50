"""Set-points of a Modbus actuator and feeding of its watchdog: the values written with each poll.

A set-point that the device acknowledges is transferred in steps within one poll. If the acknowledgement does not arrive
in time, the device counts as "busy", and the motion is continued or stopped as after any other set-point that was not
accepted.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

from drivers import clock
from drivers.capabilities import WatchdogKind
from drivers.errors import Busy
from drivers.recipe_run import Outcome, RecipeRun
from drivers.register_access import RegisterAccess
from drivers.register_maps.access_plan import Written
from drivers.register_maps.condition import Values
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.quantity import Value
from drivers.register_maps.recipe import Recipe, Write, position_for
from drivers.roles import Command, State
from drivers.setpoint_generator import Setpoint

COUNTERS = 1 << 16
HELD = frozenset({State.HOLD, State.MOVING, State.RUNNING})
"""States in which the device goes where its set-points say."""
LOOK_AGAIN_S = 0.001
"""Interval between two reads of an acknowledgement (s)."""


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
        self._waits = controller.setpoint_waits
        streamed = bool(controller.recipes.setpoint) and not controller.recipes.feed
        self._by_setpoints = streamed and controller.capabilities.watchdog is WatchdogKind.TIMEOUT
        self._toggle = 0
        self._counter = 0
        self._steps = 0
        self._held_m = math.nan
        self._powered = False

    def feed(self, counter: int) -> list[Written]:
        """The writes that feed the watchdog; where set-points do, one that leaves the rod where it is held.

        Args:
            counter: taken modulo 65536.
        """
        if self._by_setpoints:
            known = math.isfinite(self._held_m) and not self.halted and (self._powered or self._recipes.while_off)
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
        self._powered = state in HELD
        if state not in HELD or not math.isfinite(self._held_m):
            shown = values.get("setpoint", values["position"]) if state in HELD else values["position"]
            self._held_m = float(shown)

    def setpoint(self, setpoint: Setpoint, counter: int | None) -> list[Written]:
        """All writes of a set-point; the watchdog counter does not change if the watchdog is not fed.

        Args:
            setpoint: where to be (m), and how fast to go on (m/s).
            counter: as in `feed`; None: the watchdog is not fed.

        Raises:
            LocalProtocolError: a value does not fit its register.
        """
        return _requests(self._recipes.setpoint, self._given(setpoint, counter))

    @property
    def holds_first(self) -> bool:
        """Whether the current rod position may be sent to a device without pressure."""
        return bool(self._recipes.setpoint) and self._recipes.while_off

    def hand_over(self, setpoint: Setpoint, counter: int | None, access: RegisterAccess) -> Sequence[Written]:
        """Transfer a set-point that the device acknowledges.

        Args:
            setpoint: where to be (m), and how fast to go on (m/s).
            counter: as in `setpoint`.
            access: access to the device's registers.

        Returns:
            The writes that remain for the poll: none after a handshake, otherwise the complete set-point.

        Raises:
            LocalProtocolError: a value does not fit its register; nothing was written.
            Busy: the device did not acknowledge in time and may act on the set-point later; the request is withdrawn.
            DriverError: the device cannot be reached, or refuses.
        """
        if not self._waits:
            return self.setpoint(setpoint, counter)
        given = self._given(setpoint, counter)
        run = RecipeRun(Command.NONE, 0, self._recipes.setpoint, given)
        run.check()
        while run.go_on(clock.monotonic(), access.show, access.write) is Outcome.UNDER_WAY:
            time.sleep(LOOK_AGAIN_S)
        if run.outcome is Outcome.NOT_ANSWERED:
            for request in _requests(run.rest, given):
                access.write(request)
            raise Busy(access.device, access.url, f"the device did not acknowledge the set-point {run.awaited}")
        return ()

    def _given(self, setpoint: Setpoint, counter: int | None) -> dict[str, Value]:
        if counter is not None:
            self._counter = counter % COUNTERS
        self._held_m = setpoint.position_m
        self._steps = (self._steps + 1) % COUNTERS
        return {
            "position": setpoint.position_m, "velocity": setpoint.velocity_m_s, "sequence": self._steps,
            "counter": self._counter, "toggle": self._steps & 1,
        }


def _requests(recipe: Recipe, given: Values) -> list[Written]:
    return [request for step in recipe if isinstance(step, Write) for request in step.requests(given)]

"""Set-points of a Modbus actuator, and what feeds its watchdog: what is written with a poll; each has its counters.

A set-point that the device acknowledges is handed over step by step, within one poll. While the device keeps the host
waiting, no other set-point is sent, so the wait counts as "busy": the motion goes on, or is ended, as after any other
set-point that was not taken.
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
"""Between two reads of an acknowledgement."""


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
        """The writes of a set-point, those of a handshake at once; the watchdog's counter stays where it is not fed.

        Args:
            setpoint: where to be (m), and how fast to go on (m/s).
            counter: as in `feed`; None: it is not fed.

        Raises:
            LocalProtocolError: a value does not fit its register.
        """
        return _requests(self._recipes.setpoint, self._given(setpoint, counter))

    @property
    def holds_first(self) -> bool:
        """A device without pressure may be sent where its rod is."""
        return bool(self._recipes.setpoint) and self._recipes.while_off

    def hand_over(self, setpoint: Setpoint, counter: int | None, access: RegisterAccess) -> Sequence[Written]:
        """Hand a set-point over, where the device acknowledges it.

        Args:
            setpoint: where to be (m), and how fast to go on (m/s).
            counter: as in `setpoint`.
            access: the device's registers.

        Returns:
            What is left to be written with the poll: nothing after a handshake, else the whole set-point.

        Raises:
            LocalProtocolError: a value does not fit its register; nothing was written.
            Busy: the device did not acknowledge in time; it may act on the set-point later. Its request is taken back.
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

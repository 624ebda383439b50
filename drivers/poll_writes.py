"""What is written with a poll: the watchdog's food, and set-points; each has its counters."""

from __future__ import annotations

from drivers.register_maps.access_plan import Written
from drivers.register_maps.condition import Values
from drivers.register_maps.controller_map import Recipes
from drivers.register_maps.recipe import Recipe, Write
from drivers.setpoint_generator import Setpoint

COUNTERS = 1 << 16


class PollWrites:
    """Makes the requests of one device.

    Args:
        recipes: of its map.
    """

    def __init__(self, recipes: Recipes) -> None:
        self._recipes = recipes
        self._toggle = 0
        self._counter = 0
        self._steps = 0

    def feed(self, counter: int) -> list[Written]:
        """The writes that feed the watchdog.

        Args:
            counter: taken modulo 65536.
        """
        self._toggle ^= 1
        return _requests(self._recipes.feed, {"counter": counter % COUNTERS, "toggle": self._toggle})

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
        self._steps = (self._steps + 1) % COUNTERS
        given = {
            "position": setpoint.position_m, "velocity": setpoint.velocity_m_s, "sequence": self._steps,
            "counter": self._counter,
        }
        return _requests(self._recipes.setpoint, given)


def _requests(recipe: Recipe, given: Values) -> list[Written]:
    return [request for step in recipe if isinstance(step, Write) for request in step.requests(given)]

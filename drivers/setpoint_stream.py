"""Set-points sent one by one to a device that has no function generator: made for each poll, as long as it may move."""

from __future__ import annotations

from collections.abc import Iterable
from typing import ClassVar

from drivers.register_maps.access_plan import Written
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.recipe import Write
from drivers.roles import ActuatorStatus, Command, Move, Program, State
from drivers.setpoint_generator import SetpointGenerator

NUMBERS = 1 << 16
FOLLOWS = frozenset({State.HOLD, State.MOVING, State.RUNNING, State.FADING, State.HALTING})
"""In these states of the device a set-point moves it."""


class SetpointStream:
    """Streams to one device.

    While the device cannot move, the set-point follows the rod, so that nothing jumps when it can. A stop of the
    device's own ends the motion here; the set-point follows the rod until the next motion is asked for.

    Args:
        controller: its map, with set-points.
    """

    COMMANDS: ClassVar[frozenset[Command]] = frozenset(
        {Command.MOVE_TO, Command.START, Command.FADE_STOP, Command.HALT}
    )

    def __init__(self, controller: ControllerMap) -> None:
        self._steps = controller.recipes.setpoint
        self._generator = SetpointGenerator(0.0)
        self._streaming = False
        self._released = True
        self._number = 0
        self._program_id = 0
        self._sequence = 0

    def command(self, command: Command, order: Move | Program | None, now_s: float, *, own_recipe: bool) -> None:
        """A command is about to be carried out.

        Args:
            command: which.
            order: of a move or a program.
            now_s: host time.
            own_recipe: the device has steps for it, which are written beside.

        Raises:
            LocalProtocolError: it cannot be made here; nothing begins.
        """
        self._sequence += 1
        self._streaming = self._streaming or command not in {Command.ACQUIRE, Command.RELEASE, Command.RESET}
        if isinstance(order, Move):
            self._generator.move(order, now_s)
            self._released = False
        elif isinstance(order, Program):
            self._generator.start(order, now_s)
            self._released, self._program_id = False, self._sequence
        elif command in {Command.FADE_STOP, Command.HALT} and own_recipe:
            self._released = True
        elif command is Command.FADE_STOP:
            self._generator.fade(now_s)
        elif command is Command.HALT:
            self._generator.halt(now_s)

    def requests(self, now_s: float) -> Iterable[Written]:
        """The writes of this moment's set-point; none before the first command."""
        if not self._streaming:
            return ()
        setpoint = self._generator.at(now_s)
        self._number = (self._number + 1) % NUMBERS
        given = {"position": setpoint.position_m, "velocity": setpoint.velocity_m_s, "sequence": self._number}
        return [request for step in self._steps if isinstance(step, Write) for request in step.requests(given)]

    def shown(self, status: ActuatorStatus) -> ActuatorStatus:
        """The status with the motion that is made here; takes the rod's place where it cannot move."""
        generator = self._generator
        follows = status.state in FOLLOWS
        if not follows or self._released:
            generator.rest(status.position_m)
        if not follows:
            return status
        state = generator.state
        running = state in {State.RUNNING, State.FADING}
        setpoint_m = generator.last.position_m
        return status._replace(
            state=int(state), phase=int(generator.phase), cycles_done=generator.cycles_done,
            program_id=self._program_id if running else 0, setpoint_m=setpoint_m,
            servo_error_m=setpoint_m - status.position_m,
        )

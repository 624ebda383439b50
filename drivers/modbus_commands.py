"""Commands of a Modbus actuator: each is its recipe, written once, and gone on with at later polls.

Where the device repeats the number of the last command, an unknown outcome (time-out, broken connection) is read back
first; only a command that did not arrive is written again, with the same number, so the device never executes it twice.
A number that another master has used meanwhile is ignored by the device: then the command gets a new one. Where the
device repeats none, what is harmless to repeat is written again.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from drivers import clock
from drivers.command_numbers import CommandNumbers
from drivers.derived_status import DerivedStatus
from drivers.errors import DriverError, LinkLost, NoAnswer, WrongAnswer
from drivers.modbus_link import ModbusLink
from drivers.modbus_setpoints import ModbusSetpoints
from drivers.modbus_status import ModbusStatus
from drivers.recipe_run import Outcome, RecipeRun
from drivers.register_access import RegisterAccess
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.quantity import Value
from drivers.register_maps.recipe import Recipe, position_for, values_of
from drivers.roles import ActuatorStatus, Command, Move, Program, Result, State
from drivers.setpoint_generator import Setpoint
from protocols.errors import LocalProtocolError

SENT_KEPT = 64
SEND_ATTEMPTS = 3
REOPEN_TIMEOUT_S = 0.2
STOPS = frozenset({Command.FADE_STOP, Command.HALT, Command.HYDRAULICS_OFF, Command.HYDRAULICS_LOW})
PRESSURISES = frozenset({Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON, Command.RESET})
NOT_TWICE = frozenset({Command.START})
"""Without a number that the device repeats, such a command is not sent again when its outcome is unknown."""


class ModbusCommands:
    """Carries out the commands of one device.

    Args:
        link: its connection, which an unknown outcome opens again.
        access: its registers.
        controller: its map.
        status: what it shows.
        setpoints: what is written with a poll.
        derived: what its registers do not show.
        owner_id: identifies this host in its lease.
        poll: reads the status; goes on with the command that waits.
        numbered: the device repeats the number of the last command.

    Attributes:
        sent: sequence and command of the last commands written, oldest first.
    """

    def __init__(
        self, link: ModbusLink, access: RegisterAccess, controller: ControllerMap, status: ModbusStatus,
        setpoints: ModbusSetpoints, derived: DerivedStatus, owner_id: int, poll: Callable[[], ActuatorStatus], *,
        numbered: bool,
    ) -> None:
        self._link = link
        self._access = access
        self._map = controller
        self._status = status
        self._setpoints = setpoints
        self._derived = derived
        self._owner_id = owner_id
        self._poll = poll
        self.sent: deque[tuple[int, int]] = deque(maxlen=SENT_KEPT)
        self._numbered = numbered
        if not numbered:
            self.sent.append((0, int(Command.NONE)))
        self._numbers = CommandNumbers()
        self._run: RecipeRun | None = None
        self._low = False

    def send(self, command: Command, order: Move | Program | None = None) -> int:
        """Write a command and make sure that it arrived (`drivers.modbus_actuator.ModbusActuator.send`).

        Raises:
            LocalProtocolError: the controller knows no such command, or a value does not fit; nothing was written.
            RequestRefused: the controller refused the write.
            NoAnswer: its outcome is unknown.
            LinkLost: so it is, and the connection cannot be made again.
            WrongAnswer: so it is; the answer was not one to this write.
        """
        sequence = self._next_number()
        recipe = self._recipe(command)
        run = self._started(command, sequence, recipe, order)
        run.check()
        if command in PRESSURISES and recipe:
            self._hold_where_it_is()
        self._run = None
        for attempt in range(SEND_ATTEMPTS):
            try:
                if attempt > 0:
                    if self._arrived(command, sequence):
                        break
                    if self._numbers.swallowed:
                        sequence = self._next_number()
                    run = self._started(command, sequence, recipe, order)
                self._note(command, sequence, order)
                run.go_on(clock.monotonic(), self._access.show, self._access.write)
                break
            except (NoAnswer, LinkLost, WrongAnswer):
                if attempt == SEND_ATTEMPTS - 1 or (command in NOT_TWICE and not self._numbered):
                    raise
        self._follow(run)
        return sequence

    def go_on(self, received_ns: int) -> None:
        """Go on with the command that waits, after a poll whose answer was there then.

        Raises:
            DriverError: the controller cannot be reached.
        """
        if self._run is not None:
            self._run.go_on(received_ns * 1e-9, self._access.show, self._access.write)
            self._follow(self._run)

    def answered(self, status: ActuatorStatus) -> ActuatorStatus:
        """The status with the command that was requested, and low pressure where the host shows it."""
        if self._low and status.hydraulics_off:
            status = self._map.with_low_pressure(status)
        return self._numbers.as_requested(status) if self._numbered else status

    def _recipe(self, command: Command) -> Recipe:
        """The steps of a command; none where the host makes its motion, or low pressure needs no command.

        Raises:
            LocalProtocolError: the controller knows no such command.
        """
        off = self._status.values and self._status.state == State.OFF
        one_pressure = self._map.recipe(Command.HYDRAULICS_LOW) is None and self._map.capabilities.hydraulics
        if command is Command.HYDRAULICS_LOW and one_pressure:
            # A device with one pressure only: low is shown while it is off; requested under pressure it takes it away.
            self._low = bool(off)
            return () if off else self._recipe(Command.HYDRAULICS_OFF)
        if command in {Command.HYDRAULICS_ON, Command.HYDRAULICS_OFF, Command.RESET}:
            self._low = self._low and command is Command.RESET
        recipe = self._map.recipe(command)
        if recipe is None:
            raise LocalProtocolError(f"{command.name.lower().replace('_', '-')} is not supported by this controller")
        return recipe

    def _started(self, command: Command, sequence: int, recipe: Recipe, order: Move | Program | None) -> RecipeRun:
        stops = command in STOPS and command not in PRESSURISES
        position_m = position_for(recipe, self._status.position_m) if stops else self._status.position_m
        given: dict[str, Value] = {"sequence": sequence, "owner": self._owner_id, "position": position_m}
        codes = {number: own[0] for number, own in self._map.words.waveforms.codes.items()}
        return RecipeRun(command, sequence, recipe, given | values_of(order, codes))

    def _note(self, command: Command, sequence: int, order: Move | Program | None) -> None:
        """A command is about to be written."""
        self._setpoints.halted = command is Command.HALT
        self._numbers.used(sequence, command, self._map.carrier(command, low=self._low))
        if (sequence, int(command)) not in self.sent:
            self.sent.append((sequence, int(command)))
        self._derived.sent(command, sequence, order if isinstance(order, Program) else None)

    def _follow(self, run: RecipeRun) -> None:
        """Say how a command stands; one that waits is gone on with at the next polls.

        A stop counts as taken when it is written: it is proved by standstill, and written again if it is not answered.
        """
        done = run.outcome is Outcome.DONE or run.command in STOPS
        result = Result.DONE if done else Result.BUSY
        if run.outcome is Outcome.NOT_ANSWERED and run.command in STOPS:
            run.restart()
        elif run.outcome is Outcome.NOT_ANSWERED:
            result = Result.REFUSED_STATE
        self._derived.answer = (run.sequence, int(run.command), result)
        self._run = run if run.outcome is Outcome.UNDER_WAY else None

    def _arrived(self, command: Command, sequence: int) -> bool:
        """Whether the controller has seen this command; connects again first if it must.

        Raises:
            LinkLost: the connection cannot be made again.
            DriverError: it cannot be asked.
        """
        try:
            self._link.open(REOPEN_TIMEOUT_S)
        except DriverError as error:
            raise LinkLost("actuator", self._link.url, f"command {sequence}: outcome unknown, {error}") from error
        return self._numbered and self._poll().acknowledges(command, sequence)

    def _next_number(self) -> int:
        """The next command's number.

        Raises:
            DriverError: the controller cannot be asked for the last one it saw.
        """
        if not self._status.values:
            self._poll()
        return self._numbers.following()

    def _hold_where_it_is(self) -> None:
        """A device that follows set-points gets the position of the rod before it can move the rod.

        Raises:
            DriverError: it cannot be read or written.
        """
        if self._setpoints.holds_first:
            self._poll()
            for request in self._setpoints.setpoint(Setpoint(float(self._status.values["position"]), 0.0), None):
                self._access.write(request)

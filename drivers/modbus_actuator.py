"""The actuator controller over Modbus, as its register map describes it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import asdict, astuple

from drivers import clock
from drivers.capabilities import Capabilities
from drivers.command_numbers import CommandNumbers
from drivers.connection import ActuatorConnection, LinkKind, draw_owner_id
from drivers.derived_status import DerivedStatus
from drivers.errors import DriverError, LinkLost, NoAnswer, WrongAnswer, WrongLayout
from drivers.modbus_link import ModbusLink
from drivers.origins import Origins
from drivers.poll_writes import PollWrites
from drivers.recipe_run import Outcome, RecipeRun
from drivers.register_access import RegisterAccess
from drivers.register_maps.access_plan import Written
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.map_origins import map_origins
from drivers.register_maps.needs import is_numbered
from drivers.register_maps.proof import unproved
from drivers.register_maps.quantity import Value
from drivers.register_maps.recipe import Recipe, Write, position_for, values_of
from drivers.roles import (
    ActuatorIdentity,
    ActuatorLimits,
    ActuatorStatus,
    Command,
    Move,
    Program,
    Result,
    State,
)
from drivers.setpoint_generator import Setpoint
from protocols.errors import LocalProtocolError, RemoteProtocolError

SENT_KEPT = 64
SEND_ATTEMPTS = 3
REOPEN_TIMEOUT_S = 0.2
STOPS = frozenset({Command.FADE_STOP, Command.HALT, Command.HYDRAULICS_OFF, Command.HYDRAULICS_LOW})
PRESSURISES = frozenset({Command.HYDRAULICS_LOW, Command.HYDRAULICS_ON, Command.RESET})
NOT_TWICE = frozenset({Command.START})
"""Without a number that the device repeats, such a command is not sent again when its outcome is unknown."""


class ModbusActuator:
    """Drives one actuator controller by its register map; one owner thread.

    A command is its recipe. Where the device repeats the number of the last command, an unknown outcome (time-out,
    broken connection) is read back first; only a command that did not arrive is written again, with the same number, so
    the device never executes it twice. A number that another master has used meanwhile is ignored by the device: then
    the command gets a new one. Where the device repeats none, what is harmless to repeat is written again.

    Args:
        connection: how to reach it; an `owner_id` of 0 has one drawn at random.
        controller: its register map.

    Attributes:
        owner_id: identifies this host in the controller's lease.
        sent: sequence and command of the last commands written, oldest first.
    """

    def __init__(self, connection: ActuatorConnection, controller: ControllerMap) -> None:
        self.owner_id = connection.owner_id or draw_owner_id()
        self._link = ModbusLink(
            connection.url, connection.device_id, connection.timeout_s, baudrate=connection.baudrate,
            parity=connection.parity,
        )
        self._access = RegisterAccess(self._link, controller.rules, together=controller.read_while_writing)
        self._map = controller
        self.sent: deque[tuple[int, int]] = deque(maxlen=SENT_KEPT)
        self._numbered = is_numbered(controller.quantities, controller.recipes.commands)
        if not self._numbered:
            self.sent.append((0, int(Command.NONE)))
        self._derived = DerivedStatus(controller, answered=not self._numbered, rate=connection.motion.device_rate)
        self._numbers = CommandNumbers()
        self._run: RecipeRun | None = None
        self._low = False
        self._written: ActuatorLimits | None = None
        self._values: dict[str, Value] = {}
        self._position_m = 0.0
        self._writes = PollWrites(controller)

    @property
    def capabilities(self) -> Capabilities:
        """What the controller can do."""
        return self._map.capabilities

    @property
    def origins(self) -> Origins:
        """The registers that each channel is made of."""
        return map_origins(self._map)

    @property
    def link_kind(self) -> LinkKind:
        """Modbus TCP or RTU."""
        return self._link.address.kind

    @property
    def url(self) -> str:
        """URL of the connection."""
        return self._link.url

    @property
    def is_open(self) -> bool:
        """Whether the connection stands, as far as is known."""
        return self._link.is_open

    @property
    def stale(self) -> int:
        """Answers to earlier requests that were recognised and thrown away, since construction."""
        return self._link.stale

    @property
    def busy(self) -> int:
        """"Busy" answers that were asked again, since construction."""
        return self._link.busy

    def open(self) -> None:
        """Connect; does nothing when connected. Nothing is written, but for the addresses of an indirect map.

        Raises:
            PortClosed: no answer at the URL.
            DriverError: the indirect map cannot be written.
        """
        before = self._link.is_open
        self._link.open()
        if self._map.indirect is not None and not before:
            for request in self._map.indirect.requests:
                self._access.write(request)

    def close(self) -> None:
        """Disconnect; closing twice is harmless. The controller goes on with what it does."""
        self._link.close()

    def read_identity(self) -> ActuatorIdentity:
        """Who the controller is; proves word order, number format and layout by what its map says it must show.

        Until the first status after it, a block that cannot be read is looked into part by part.

        Raises:
            WrongLayout: it shows something else, or has no such registers.
            DriverError: the controller cannot be read.
        """
        self._access.explains = not self._values
        answers = [(read, self._access.words(read)) for read in self._map.identity_reads]
        try:
            values = {name: value for read, words in answers for name, value in read.decode(words).items()}
        except RemoteProtocolError as error:
            raise WrongLayout("actuator", self.url, f"identity: {error}") from error
        wrong, fix = unproved(self._map, values, answers)
        if wrong:
            raise WrongLayout("actuator", self.url, wrong, fix)
        return self._map.identity(values)

    def read_status(self) -> ActuatorStatus:
        """The status, without feeding the watchdog.

        Raises:
            DriverError: the controller cannot be read.
        """
        return self._poll([])

    def exchange(self, watchdog_counter: int) -> ActuatorStatus:
        """Feed the watchdog and read the status, in one trip where the device can.

        Args:
            watchdog_counter: must differ from the last one to feed; taken modulo 65536.

        Raises:
            DriverError: the controller cannot be reached.
        """
        return self._poll(self._writes.feed(watchdog_counter))

    @property
    def takes_speed(self) -> bool:
        """A set-point states how fast to go on."""
        return self._map.setpoint_has_speed

    def knows(self, command: Command) -> bool:
        """Whether the controller has this command itself."""
        return command in self._map.recipes.commands

    def follow(self, setpoint: Setpoint, watchdog_counter: int | None) -> ActuatorStatus:
        """Write a set-point and read the status, in one trip where the device can; never written again.

        A watchdog that is not fed by the set-point's own write is fed by a write of its own before.

        Args:
            setpoint: where to be (m), and how fast to go on (m/s) for a device that takes a speed.
            watchdog_counter: must differ from the last one to feed, modulo 65536; None: it is not fed.

        Raises:
            DriverError: the controller cannot be reached, or refuses; the set-point may have arrived.
        """
        requests = self._writes.setpoint(setpoint, watchdog_counter)
        if watchdog_counter is not None and not self._map.setpoint_feeds:
            for request in self._writes.feed(watchdog_counter):
                self._access.write(request)
        return self._poll(requests, once=True)

    def read_limits(self) -> ActuatorLimits:
        """Limits and watchdog setting as the controller holds them; those it does not hold are as they were written.

        Raises:
            WrongAnswer: the words do not make up the limits, or none were written yet and the controller holds a part.
            DriverError: the controller cannot be read.
        """
        values = self._access.read(self._map.limit_reads, "limits")
        return self._map.held_limits(values, self._written)

    def write_limits(self, limits: ActuatorLimits) -> None:
        """Write the limits that the controller holds, read them back and compare.

        Raises:
            LocalProtocolError: a limit does not fit its register; nothing was written.
            WrongAnswer: the controller holds something else afterwards.
            DriverError: the controller cannot be reached.
        """
        requests = Write(self._map.limit_values(limits)).requests({})
        for request in requests:
            try:
                self._access.write(request)
            except (NoAnswer, LinkLost, WrongAnswer):
                # Writing limits twice is harmless.
                self._link.open()
                self._access.write(request)
        self._written = limits
        held = self.read_limits()
        for name, wanted, got in zip(asdict(limits), astuple(limits), astuple(held), strict=True):
            if got != wanted:
                raise WrongAnswer("actuator", self.url, f"{name}: wrote {wanted:g}, read back {got:g}")

    def write_table(self, values_m: list[float]) -> None:
        """Load the samples of a table waveform, about the centre.

        Args:
            values_m: displacements, m.

        Raises:
            LocalProtocolError: a value is not finite.
            DriverError: the controller cannot be reached or refuses.
        """
        recipes = self._map.recipes
        for index in range(0, len(values_m), recipes.table_values):
            part = values_m[index : index + recipes.table_values]
            for step in recipes.table:
                if isinstance(step, Write):
                    for request in step.requests({"index": index, "count": len(part)}, part):
                        self._access.write(request)

    def send(self, command: Command, order: Move | Program | None = None) -> int:
        """Write a command and make sure that it arrived; what its recipe waits for is waited for by the later polls.

        Args:
            command: what to do.
            order: where to, for `MOVE_TO`; what to run, for `START`.

        Returns:
            The command's sequence number; its result appears in the status (`acked_sequence`, `result`).

        Raises:
            LocalProtocolError: the controller knows no such command, or a value does not fit; nothing was written.
            RequestRefused: the controller refused the write.
            NoAnswer: no answer; the command may have arrived.
            LinkLost: the connection broke and cannot be made again; the command may have arrived.
            WrongAnswer: the answer was not one to this write; the command may have arrived.
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

    # How a command is carried out

    def _recipe(self, command: Command) -> Recipe:
        """The steps of a command; none where the host makes its motion, or shows low pressure by itself.

        Raises:
            LocalProtocolError: the controller knows no such command.
        """
        off = self._values and self._state == State.OFF
        if command is Command.HYDRAULICS_LOW and self._map.recipe(command) is None and self.capabilities.hydraulics:
            # A device with one pressure only: low is shown while it is off; asked for under pressure it takes it away.
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
        position_m = position_for(recipe, self._position_m) if stops else self._position_m
        given: dict[str, Value] = {"sequence": sequence, "owner": self.owner_id, "position": position_m}
        codes = {number: own[0] for number, own in self._map.words.waveforms.codes.items()}
        return RecipeRun(command, sequence, recipe, given | values_of(order, codes))

    def _note(self, command: Command, sequence: int, order: Move | Program | None) -> None:
        """A command is about to be written."""
        self._writes.halted = command is Command.HALT
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
            raise LinkLost("actuator", self.url, f"command {sequence}: outcome unknown, {error}") from error
        return self._numbered and self._poll([]).acknowledges(command, sequence)

    def _next_number(self) -> int:
        """The next command's number.

        Raises:
            DriverError: the controller cannot be asked for the last one it saw.
        """
        if not self._values:
            self._poll([])
        return self._numbers.following()

    # Reading and writing

    def _poll(self, requests: Sequence[Written], *, once: bool = False) -> ActuatorStatus:
        """Write, read the status, and go on with the command that waits.

        Args:
            requests: what is written.
            once: it is out of date when it would be written again.

        Raises:
            WrongAnswer: the words do not make up the status.
            DriverError: the controller cannot be reached.
        """
        values = self._access.read(self._map.status_reads, "status", requests, once=once)
        if len(self._map.status_reads) > 1 and self._map.differs(values, self._values):
            # What changed between two requests of a poll is only half seen.
            values = self._access.read(self._map.status_reads, "status")
        received_ns = clock.monotonic_ns()
        self._access.explains = False
        values |= self._derived.unwrapped(values)
        self._values = values
        # A stop may write where the rod is: a position that is no number must not hold it back.
        if math.isfinite(position_m := float(values["position"])):
            self._position_m = position_m
        self._writes.seen(self._state, values)
        if self._run is not None:
            self._run.go_on(received_ns * 1e-9, self._access.show, self._access.write)
            self._follow(self._run)
        try:
            status = self._map.status(values, received_ns, self._derived.knows(values, received_ns))
        except RemoteProtocolError as error:
            raise WrongAnswer("actuator", self.url, f"status: {error}") from error
        status = self._derived.completed(status)
        if self._low and status.hydraulics_off:
            status = self._map.with_low_pressure(status)
        if self._numbered:
            status = self._numbers.as_asked(status)
        return status

    @property
    def _state(self) -> int:
        return self._map.state_of(self._values)

    def _hold_where_it_is(self) -> None:
        """A device that follows set-points is told where the rod is before it can move it.

        Raises:
            DriverError: it cannot be read or written.
        """
        if self._map.recipes.setpoint:
            self._poll([])
            for request in self._writes.setpoint(Setpoint(float(self._values["position"]), 0.0), None):
                self._access.write(request)

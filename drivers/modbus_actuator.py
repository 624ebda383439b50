"""The actuator controller over Modbus, as its register map describes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, astuple

from drivers.capabilities import Capabilities
from drivers.connection import ActuatorConnection, LinkKind, draw_owner_id
from drivers.derived_status import DerivedStatus
from drivers.errors import LinkLost, NoAnswer, WrongAnswer, WrongLayout
from drivers.modbus_commands import ModbusCommands
from drivers.modbus_link import ModbusLink
from drivers.modbus_setpoints import ModbusSetpoints
from drivers.modbus_status import ModbusStatus
from drivers.origins import Origins
from drivers.register_access import RegisterAccess
from drivers.register_maps.access_plan import Written
from drivers.register_maps.controller_map import ControllerMap
from drivers.register_maps.map_origins import map_origins
from drivers.register_maps.needs import is_numbered
from drivers.register_maps.proof import unproved
from drivers.register_maps.recipe import Write
from drivers.roles import (
    ActuatorIdentity,
    ActuatorLimits,
    ActuatorStatus,
    Command,
    Move,
    Program,
)
from drivers.setpoint_generator import Setpoint
from protocols.errors import RemoteProtocolError


class ModbusActuator:
    """Drives one actuator controller by its register map; one owner thread.

    Its parts: the status (`modbus_status`), commands (`modbus_commands`), set-points and what feeds the watchdog
    (`modbus_setpoints`). Identity, limits and tables are read and written here.

    Args:
        connection: how to reach it; an `owner_id` of 0 has one drawn at random.
        controller: its register map.

    Attributes:
        owner_id: identifies this host in the controller's lease.
    """

    def __init__(self, connection: ActuatorConnection, controller: ControllerMap) -> None:
        self.owner_id = connection.owner_id or draw_owner_id()
        self._link = ModbusLink(
            connection.url, connection.device_id, connection.timeout_s, baudrate=connection.baudrate,
            parity=connection.parity,
        )
        self._access = RegisterAccess(self._link, controller.rules, together=controller.read_while_writing)
        self._map = controller
        numbered = is_numbered(controller.quantities, controller.recipes.commands)
        derived = DerivedStatus(controller, answered=not numbered, rate=connection.motion.device_rate)
        self._status = ModbusStatus(self._access, controller, derived, connection.url)
        self._setpoints = ModbusSetpoints(controller)
        self._commands = ModbusCommands(
            self._link, self._access, controller, self._status, self._setpoints, derived, self.owner_id, self._poll,
            numbered=numbered,
        )
        self._written: ActuatorLimits | None = None

    @property
    def sent(self) -> Sequence[tuple[int, int]]:
        """Sequence and command of the last commands written, oldest first."""
        return self._commands.sent

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
        self._access.explains = not self._status.values
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
        return self._poll()

    def exchange(self, watchdog_counter: int) -> ActuatorStatus:
        """Feed the watchdog and read the status, in one trip where the device can.

        Args:
            watchdog_counter: must differ from the last one to feed; taken modulo 65536.

        Raises:
            DriverError: the controller cannot be reached.
        """
        return self._poll(self._setpoints.feed(watchdog_counter))

    @property
    def takes_speed(self) -> bool:
        """A set-point states how fast to go on."""
        return self._map.setpoint_has_speed

    def knows(self, command: Command) -> bool:
        """Whether the controller has this command itself."""
        return command in self._map.recipes.commands

    def follow(self, setpoint: Setpoint, watchdog_counter: int | None) -> ActuatorStatus:
        """Write a set-point once and read the status, in one request if the device supports this.

        A set-point with a handshake is transferred first. A separate write then feeds the watchdog if necessary.

        Args:
            setpoint: where to be (m), and how fast to go on (m/s) for a device that takes a speed.
            watchdog_counter: must differ from the last one to feed, modulo 65536; None: it is not fed.

        Raises:
            DriverError: the controller cannot be reached or rejects the request; the set-point may have arrived.
        """
        if watchdog_counter is not None and not self._map.setpoint_feeds:
            for request in self._setpoints.feed(watchdog_counter):
                self._access.write(request)
        requests = self._setpoints.hand_over(setpoint, watchdog_counter, self._access)
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
        for name, value, got in zip(asdict(limits), astuple(limits), astuple(held), strict=True):
            if got != value:
                raise WrongAnswer("actuator", self.url, f"{name}: wrote {value:g}, read back {got:g}")

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
        return self._commands.send(command, order)

    def _poll(self, requests: Sequence[Written] = (), *, once: bool = False) -> ActuatorStatus:
        """Write, read the status, and go on with the command that waits.

        Args:
            requests: what is written.
            once: it is out of date when it would be written again.

        Raises:
            WrongAnswer: the words do not make up the status.
            DriverError: the controller cannot be reached.
        """
        received_ns = self._status.read(requests, once=once)
        self._setpoints.seen(self._status.state, self._status.values)
        self._commands.go_on(received_ns)
        return self._commands.answered(self._status.shown(received_ns))

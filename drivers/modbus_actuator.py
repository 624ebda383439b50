"""The actuator controller over Modbus."""

from __future__ import annotations

import time
from collections import deque
from dataclasses import asdict, astuple

from drivers.capabilities import Capabilities, WatchdogKind
from drivers.connection import ActuatorConnection, LinkKind, draw_owner_id
from drivers.devices.controller import ControllerDescription
from drivers.devices.other_order import read_otherwise
from drivers.errors import DriverError, LinkLost, NoAnswer, WrongAnswer, WrongLayout
from drivers.modbus_link import ModbusLink
from drivers.roles import ActuatorIdentity, ActuatorLimits, ActuatorStatus, Command, Move, Program
from drivers.setpoint_generator import Setpoint
from protocols.errors import RemoteProtocolError

SEQUENCE_MODULUS = 1 << 16
CLEAR_OF_OTHERS = SEQUENCE_MODULUS // 2
"""How far from another master's sequence numbers ours go on; it counts up, too."""
SENT_KEPT = 64
SEND_ATTEMPTS = 3
REOPEN_TIMEOUT_S = 0.2
LIMIT_TOLERANCE = 1e-6
"""Relative difference that the 32-bit floats of the registers may make."""


class ModbusActuator:
    """Drives one actuator controller whose description says what lies where; one owner thread.

    A command is written once with a new sequence number. When its outcome is unknown (time-out, broken connection) the
    acknowledged sequence and command are read back first; only a command that did not arrive is written again, with the
    same sequence number, so the controller never executes it twice. A number that another master has used meanwhile is
    ignored by the controller: then the command gets a new one.

    Args:
        connection: how to reach it; an `owner_id` of 0 has one drawn at random.
        description: what lies where and what it means.

    Attributes:
        owner_id: identifies this host in the controller's lease.
        sent: sequence and command of the last commands written, oldest first.
    """

    def __init__(self, connection: ActuatorConnection, description: ControllerDescription) -> None:
        self.owner_id = connection.owner_id or draw_owner_id()
        self._link = ModbusLink(
            connection.url, connection.device_id, connection.timeout_s, baudrate=connection.baudrate,
            parity=connection.parity,
        )
        self._description = description
        self._status = description.map.block("status")
        self._command = description.map.block("command")
        self.sent: deque[tuple[int, int]] = deque(maxlen=SENT_KEPT)
        self._sequence: int | None = None
        self._sent = Command.NONE
        self._counter = 0
        self._seen: ActuatorStatus | None = None

    @property
    def capabilities(self) -> Capabilities:
        """What the controller can do."""
        return self._description.capabilities

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
        """Connect; does nothing when connected.

        Raises:
            PortClosed: nobody answers at the URL.
        """
        self._link.open()

    def close(self) -> None:
        """Disconnect; closing twice is harmless. The controller goes on with what it does."""
        self._link.close()

    def read_identity(self) -> ActuatorIdentity:
        """Who the controller is; proves word order, float format and layout.

        Raises:
            WrongLayout: signature or layout are not those of the register map.
            DriverError: the controller cannot be read.
        """
        block = self._description.map.block("identity")
        words = self._link.read(block.address, block.count)
        try:
            identity = self._description.decode_identity(words)
        except RemoteProtocolError as error:
            raise WrongLayout("actuator", self.url, f"identity block: {error}") from error
        expected = self._description.expected_identity
        if wrong := [name for name, value in expected.items() if getattr(identity, name) != value]:
            shown = ", ".join(
                f"{name} {_shown(getattr(identity, name))}, expected {_shown(expected[name])}" for name in wrong
            )
            otherwise, fix = read_otherwise(block, words, expected)
            why = otherwise or "wrong word order, scale, layout or device"
            raise WrongLayout("actuator", self.url, f"{shown}; {why}", fix)
        return identity

    def read_status(self) -> ActuatorStatus:
        """Status block, without feeding the watchdog.

        Raises:
            DriverError: the controller cannot be read.
        """
        return self._to_status(self._link.read(self._status.address, self._status.count))

    def exchange(self, watchdog_counter: int) -> ActuatorStatus:
        """Feed the watchdog and read the status block, in one trip.

        Args:
            watchdog_counter: must differ from the last one to feed; taken modulo 65536.

        Raises:
            DriverError: the controller cannot be reached.
        """
        if self.capabilities.watchdog is not WatchdogKind.COUNTER:
            return self.read_status()
        watchdog = self._description.map.block("watchdog")
        words = self._link.exchange(
            self._status.address, self._status.count, watchdog.address, [watchdog_counter % SEQUENCE_MODULUS]
        )
        return self._to_status(words)

    def knows(self, command: Command) -> bool:
        """Whether the controller has this command."""
        return self._description.knows(command)

    def follow(self, setpoint: Setpoint, watchdog_counter: int | None) -> ActuatorStatus:
        """Write a set-point and read the status block, in one trip; never written again, for by then it is the past.

        A watchdog whose counter lies apart from the set-point is fed by a write of its own before.

        Args:
            setpoint: where to be now (m), and how fast to go on (m/s).
            watchdog_counter: must differ from the last one to feed, modulo 65536; None: the last one stays.

        Raises:
            DriverError: the controller cannot be reached, or refuses; the set-point may have arrived.
        """
        if watchdog_counter is not None:
            self._counter = watchdog_counter % SEQUENCE_MODULUS
            if not self._description.counter_with_setpoint:
                self._link.write(self._description.map.block("watchdog").address, [self._counter])
        words = self._description.encode_setpoint(setpoint, self._counter)
        address = self._description.map.block("setpoint").address
        return self._to_status(
            self._link.exchange(self._status.address, self._status.count, address, words, retries=0)
        )

    def read_limits(self) -> ActuatorLimits:
        """Limits and watchdog setting as the controller holds them.

        Raises:
            WrongAnswer: the words do not make up the block.
            DriverError: the controller cannot be read.
        """
        block = self._description.map.block("config")
        words = self._link.read(block.address, block.count)
        try:
            return self._description.decode_limits(words)
        except RemoteProtocolError as error:
            raise WrongAnswer("actuator", self.url, f"config block: {error}") from error

    def write_limits(self, limits: ActuatorLimits) -> None:
        """Write limits and watchdog setting, read them back and compare.

        Raises:
            LocalProtocolError: a limit does not fit its register; nothing was written.
            WrongAnswer: the controller holds something else afterwards.
            DriverError: the controller cannot be reached.
        """
        words, address = self._description.encode_limits(limits), self._description.map.block("config").address
        try:
            self._link.write(address, words)
        except (NoAnswer, LinkLost, WrongAnswer):
            # Writing limits twice is harmless.
            self._link.open()
            self._link.write(address, words)
        held = self.read_limits()
        for name, wanted, got in zip(asdict(limits), astuple(limits), astuple(held), strict=True):
            if abs(got - wanted) > LIMIT_TOLERANCE * max(abs(wanted), 1e-3):
                raise WrongAnswer("actuator", self.url, f"wrote {name} = {wanted:g}, the controller holds {got:g}")

    def write_table(self, values_m: list[float]) -> None:
        """Load the samples of a table waveform, about the centre.

        Args:
            values_m: displacements, m.

        Raises:
            LocalProtocolError: a value is not finite.
            DriverError: the controller cannot be reached or refuses.
        """
        size, table = self._description.table_values, self._description.map.block("table")
        for index in range(0, len(values_m), size):
            part = values_m[index : index + size]
            words = table.encode({
                "table_index": index,
                "table_count": len(part),
                **{f"table_value_{i}": value for i, value in enumerate(part)},
            })
            self._link.write(table.address, words)

    def send(self, command: Command, order: Move | Program | None = None) -> int:
        """Write a command and make sure that it arrived.

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
        sequence = self._next_sequence()
        for attempt in range(SEND_ATTEMPTS):
            try:
                if attempt > 0:
                    if self._arrived(command, sequence):
                        break
                    sequence = self._next_sequence() if self._swallowed else sequence
                self._sequence, self._sent = sequence, command
                if (sequence, int(command)) not in self.sent:
                    self.sent.append((sequence, int(command)))
                words = self._description.encode_command(command, sequence, self.owner_id, order)
                self._link.write(self._command.address, words)
                break
            except (NoAnswer, LinkLost, WrongAnswer):
                if attempt == SEND_ATTEMPTS - 1:
                    raise
        return sequence

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
        return self.read_status().acknowledges(command, sequence)

    @property
    def _swallowed(self) -> bool:
        """The controller has seen our last number with another command: it ignored, or will ignore, ours."""
        seen = self._seen
        return seen is not None and seen.acked_sequence == self._sequence and seen.acked_command != self._sent

    def _next_sequence(self) -> int:
        """The number after our last one; far from it where another master uses the same ones; 1..65535.

        Raises:
            DriverError: the controller cannot be asked for the last one it saw.
        """
        if self._sequence is None or self._seen is None:
            return _following(self.read_status().acked_sequence)
        following = _following(self._sequence)
        if self._swallowed or self._seen.acked_sequence == following:
            return _following(self._sequence + CLEAR_OF_OTHERS)
        return following

    def _to_status(self, words: list[int]) -> ActuatorStatus:
        """Decode a status block that has just arrived.

        Raises:
            WrongAnswer: the words do not make up the block.
        """
        try:
            self._seen = self._description.decode_status(words, time.monotonic_ns())
        except RemoteProtocolError as error:
            raise WrongAnswer("actuator", self.url, f"status block: {error}") from error
        return self._seen


def _following(sequence: int) -> int:
    """The sequence number after this one; never 0."""
    return sequence % (SEQUENCE_MODULUS - 1) + 1


def _shown(value: float | str) -> str:
    """A register's value for people: whole numbers also as they lie on the wire."""
    return f"{value} (0x{value:08X})" if isinstance(value, int) and value > 0xFFFF else str(value)

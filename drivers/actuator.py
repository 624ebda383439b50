"""The actuator controller over Modbus."""

from __future__ import annotations

import secrets
import time
from collections import deque
from dataclasses import asdict, astuple

from drivers.errors import DriverError, LinkLost, NoAnswer, RequestRefused, WrongAnswer, WrongLayout
from drivers.modbus_link import ModbusLink
from protocols.actuator import (
    LAYOUT_VERSION,
    MAP,
    SIGNATURE_F32,
    SIGNATURE_U32,
    ActuatorIdentity,
    ActuatorLimits,
    ActuatorStatus,
    Command,
    Result,
    decode_identity,
    decode_limits,
    decode_status,
    encode_limits,
)
from protocols.errors import RemoteProtocolError
from protocols.register_map import RegisterMap, Value

SEQUENCE_MODULUS = 1 << 16
CLEAR_OF_OTHERS = SEQUENCE_MODULUS // 2
"""How far from another master's sequence numbers ours go on; it counts up, too."""
SENT_KEPT = 64
SEND_ATTEMPTS = 3
REOPEN_TIMEOUT_S = 0.2
CONFIRM_PAUSE_S = 0.001
LIMIT_TOLERANCE = 1e-6
"""Relative difference that the 32-bit floats of the registers may make."""


class ModbusActuator:
    """Drives one actuator controller; one owner thread.

    A command is written once with a new sequence number. When its outcome is unknown (time-out, broken connection) the
    acknowledged sequence and command are read back first; only a command that did not arrive is written again, with the
    same sequence number, so the controller never executes it twice. A number that another master has used meanwhile is
    ignored by the controller: then the command gets a new one.

    Args:
        url: modbus-tcp://host:port, or modbus-rtu: and a serial port.
        register_map: where the controller keeps its values.
        device_id: Modbus unit number.
        timeout_s: longest wait for one answer, s.
        owner_id: identifies this host in the controller's lease, 1..65535; drawn at random when not given.
        baudrate: Bd of a serial line.
        parity: "N", "E" or "O", of a serial line.

    Attributes:
        owner_id: as above.
        sent: sequence and command of the last commands written, oldest first.
    """

    def __init__(
        self,
        url: str,
        register_map: RegisterMap = MAP,
        device_id: int = 1,
        timeout_s: float = 0.04,
        *,
        owner_id: int | None = None,
        baudrate: int = 115_200,
        parity: str = "N",
    ) -> None:
        self.owner_id = draw_number() if owner_id is None else owner_id
        self._link = ModbusLink(url, device_id, timeout_s, baudrate=baudrate, parity=parity)
        self._identity = register_map.block("identity")
        self._status = register_map.block("status")
        self._config = register_map.block("config")
        self._command = register_map.block("command")
        self._table = register_map.block("table")
        self._watchdog = register_map.block("watchdog")
        self.sent: deque[tuple[int, int]] = deque(maxlen=SENT_KEPT)
        self._sequence: int | None = None
        self._sent = Command.NONE
        self._seen: ActuatorStatus | None = None

    @property
    def url(self) -> str:
        """URL of the connection."""
        return self._link.url

    @property
    def is_open(self) -> bool:
        """Whether the connection stands, as far as is known."""
        return self._link.is_open

    @property
    def timeouts(self) -> int:
        """Answers that did not come in time, since construction."""
        return self._link.timeouts

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

    def drain(self) -> int:
        """Throw away answers that nobody waits for any more; number of bytes."""
        return self._link.drain()

    def read_identity(self) -> ActuatorIdentity:
        """Who the controller is; proves word order, float format and layout.

        Raises:
            WrongLayout: signature or layout are not those of the register map.
            DriverError: the controller cannot be read.
        """
        words = self._link.read(self._identity.address, self._identity.count)
        try:
            identity = decode_identity(words, self._identity)
        except RemoteProtocolError as error:
            raise WrongLayout("actuator", self.url, f"identity block: {error}") from error
        if identity.signature_u32 != SIGNATURE_U32 or identity.signature_f32 != SIGNATURE_F32:
            raise WrongLayout(
                "actuator", self.url,
                f"signature registers read 0x{identity.signature_u32:08X} and {identity.signature_f32:g}, expected "
                f"0x{SIGNATURE_U32:08X} and {SIGNATURE_F32:g}: wrong word order, scale or device",
            )
        if identity.layout_version != LAYOUT_VERSION:
            raise WrongLayout(
                "actuator", self.url, f"register layout {identity.layout_version}, expected {LAYOUT_VERSION}"
            )
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
        words = self._link.exchange(
            self._status.address, self._status.count, self._watchdog.address, [watchdog_counter % SEQUENCE_MODULUS]
        )
        return self._to_status(words)

    def read_limits(self) -> ActuatorLimits:
        """Limits and watchdog setting as the controller holds them.

        Raises:
            WrongAnswer: the words do not make up the block.
            DriverError: the controller cannot be read.
        """
        words = self._link.read(self._config.address, self._config.count)
        try:
            return decode_limits(words, self._config)
        except RemoteProtocolError as error:
            raise WrongAnswer("actuator", self.url, f"config block: {error}") from error

    def write_limits(self, limits: ActuatorLimits) -> None:
        """Write limits and watchdog setting, read them back and compare.

        Raises:
            LocalProtocolError: a limit does not fit its register; nothing was written.
            WrongAnswer: the controller holds something else afterwards.
            DriverError: the controller cannot be reached.
        """
        words = encode_limits(limits, self._config)
        try:
            self._link.write(self._config.address, words)
        except (NoAnswer, LinkLost, WrongAnswer):
            # Writing limits twice is harmless.
            self._link.open()
            self._link.write(self._config.address, words)
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
        size = sum(register.name.startswith("table_value_") for register in self._table.registers)
        for index in range(0, len(values_m), size):
            part = values_m[index : index + size]
            words = self._table.encode({
                "table_index": index,
                "table_count": len(part),
                **{f"table_value_{i}": value for i, value in enumerate(part)},
            })
            self._link.write(self._table.address, words)

    def send(self, command: Command, **values: Value) -> int:
        """Write a command and make sure that it arrived.

        Args:
            command: what to do.
            **values: registers of the command block by name (`amplitude`, `frequency`, ...), SI.

        Returns:
            The command's sequence number; its result appears in the status (`acked_sequence`, `result`).

        Raises:
            LocalProtocolError: a value is unknown or does not fit; nothing was written.
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
                self._link.write(self._command.address, self._command.encode({
                    "command": int(command), "sequence": sequence, "owner_id": self.owner_id, **values,
                }))
                break
            except (NoAnswer, LinkLost, WrongAnswer):
                if attempt == SEND_ATTEMPTS - 1:
                    raise
        return sequence

    def confirm(self, sequence: int, timeout_s: float = 0.5) -> ActuatorStatus:
        """Wait until the controller has answered the last command that was sent.

        Args:
            sequence: what `send` returned.
            timeout_s: longest wait, s.

        Returns:
            The status that shows the command done.

        Raises:
            RequestRefused: the controller refused the command.
            NoAnswer: no result in time.
            DriverError: the controller cannot be read.
        """
        deadline = time.monotonic() + timeout_s
        while True:
            status = self.read_status()
            if status.acknowledges(self._sent, sequence) and status.result not in {Result.IDLE, Result.BUSY}:
                break
            if time.monotonic() >= deadline:
                raise NoAnswer(
                    "actuator", self.url,
                    f"command {sequence} has no result after {timeout_s:g} s; the last one seen is "
                    f"{status.acked_sequence} with result {status.result} of command {status.acked_command}",
                )
            time.sleep(CONFIRM_PAUSE_S)
        if status.result != Result.DONE:
            result = Result(status.result).name if status.result in set(Result) else str(status.result)
            raise RequestRefused(
                "actuator", self.url, f"command {status.acked_command} (sequence {sequence}) refused: {result}"
            )
        return status

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
            self._seen = decode_status(words, time.monotonic_ns(), self._status)
        except RemoteProtocolError as error:
            raise WrongAnswer("actuator", self.url, f"status block: {error}") from error
        return self._seen


def draw_number() -> int:
    """A number 1..65535 at random, to tell this host from others: containers repeat process ids."""
    return secrets.randbelow(SEQUENCE_MODULUS - 1) + 1


def _following(sequence: int) -> int:
    """The sequence number after this one; never 0."""
    return sequence % (SEQUENCE_MODULUS - 1) + 1

"""The coil's current ECU over CAN: cyclic command frames out, status frames in."""

from __future__ import annotations

import threading
import time
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from drivers.can_port import CanPort
from drivers.errors import DriverError, NoAnswer, WrongIdentity
from drivers.ring import NO_DEVICE_TIME, Channel, Record
from protocols import ecu
from protocols.ecu import CoilCommand, CoilStatus, CoilTemperature, EcuIdentity
from protocols.errors import RemoteProtocolError
from protocols.quality import Quality
from protocols.slcan import Frame

DEFAULT_PERIOD_S = 0.010
_OWN_FRAMES = frozenset({ecu.STATUS_ID, ecu.TEMPERATURE_ID, ecu.IDENTITY_ID})
_COMMANDS_KEPT = 4096
_STANDARD_BITS, _EXTENDED_BITS = 47, 67


class EcuBatch(NamedTuple):
    """What one read gave.

    Attributes:
        records: ring records in SI and degC, in the order of the wire; the set-points sent meanwhile among them.
        statuses: status frames that passed every check.
        temperatures: temperature frames.
        lost: status frames that the counter says are missing.
        bad: status frames dropped for CRC, counter, length or kind.
        arrival_ns: monotonic time at which the frames were there, ns.
    """

    records: list[Record]
    statuses: list[CoilStatus]
    temperatures: list[CoilTemperature]
    lost: int
    bad: int
    arrival_ns: int


@dataclass(slots=True)
class EcuCounters:
    """Totals since construction; only those in a row and `lateness` ever decrease.

    Attributes:
        bad_in_a_row: status frames dropped since the last good one; `malformed_in_a_row` of them for length or kind.
        gaps_in_a_row: good status frames one after the other whose counter has left some out.
        lateness: grows by 2 with a repeated status frame, falls by 1 with a fresh one: duplicates that keep coming.
        other_bits: bits on the bus of frames that are not the ECU's, without stuffing.
    """

    statuses: int = 0
    lost: int = 0
    duplicates: int = 0
    bad_checks: int = 0
    bad_in_a_row: int = 0
    malformed: int = 0
    malformed_in_a_row: int = 0
    gaps_in_a_row: int = 0
    lateness: int = 0
    other_bits: int = 0
    foreign_commands: int = 0
    other_frames: int = 0
    sent: int = 0
    late_sends: int = 0


class CanEcu:
    """Drives one current ECU.

    `read_batch` belongs to one owner thread. The command frame goes out from a thread of its own after `start`;
    `command` and `send_now` may be called from any thread. Until `command` is called the frames ask for 0 A, disabled.

    Args:
        interface: any interface of python-can.
        channel: what that interface calls the bus; a serial URL for slcan.
        bitrate: bit/s.
        serial_number: refuse an ECU with another one; None takes any.

    Attributes:
        counters: totals.
        status: last status frame that passed every check, None before the first.
        temperature: last temperature frame.
        identity: last identity frame.
        send_error: what ended the command thread, None while it runs.
    """

    def __init__(
        self, interface: str, channel: str, *, bitrate: int = 500_000, serial_number: int | None = None
    ) -> None:
        self.counters = EcuCounters()
        self.status: CoilStatus | None = None
        self.temperature: CoilTemperature | None = None
        self.identity: EcuIdentity | None = None
        self.send_error: DriverError | None = None
        self._name = f"{interface}:{channel}"
        self._serial_number = serial_number
        self._port = CanPort(interface, channel, bitrate)
        self._is_open = False
        self._send_lock = threading.Lock()
        self._counter = 0
        self._wanted = (0.0, False, False)
        self._sent: deque[Record] = deque(maxlen=_COMMANDS_KEPT)
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None
        self._status_ns: int | None = None
        self._sequence = 0  # unwrapped counter of status frames
        self._device_us = NO_DEVICE_TIME  # unwrapped
        self._reported: tuple[int, int] | None = None

    @property
    def is_open(self) -> bool:
        """Whether `open` succeeded and `close` has not been called."""
        return self._is_open

    @property
    def commanded_A(self) -> float:
        """Set-point of the command frames, A; 0 while they ask for the output stage to be off."""
        current_A, enable, _ = self._wanted
        return current_A if enable else 0.0

    @property
    def bus_errors(self) -> int:
        """Errors the interface reported."""
        return self._port.bus_errors

    @property
    def malformed(self) -> int:
        """Frames and lines that cannot be the ECU's: wrong length, remote, extended, not decodable."""
        return self.counters.malformed + self._port.malformed

    def open(self) -> None:
        """Join the bus; sends nothing yet.

        Raises:
            PortClosed: the interface or its channel cannot be opened.
            LinkLost: the adapter does not take its set-up.
        """
        if not self._is_open:
            self._port.open()
            self._is_open = True

    def close(self) -> None:
        """End the command frames and leave the bus; the ECU goes to 0 A by its own time-out. Twice is harmless."""
        self._ending.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
        if self._is_open:
            self._is_open = False
            self._port.close()

    def start(self, period_s: float = DEFAULT_PERIOD_S) -> None:
        """Send the command frame from now on, every `period_s` wall seconds.

        Raises:
            PortClosed: the bus is not open.
            LinkLost: the first frame was not taken.
        """
        if self._thread is not None:
            return
        self.send_now()
        self._ending.clear()
        self._thread = threading.Thread(target=self._send_cyclically, args=(period_s,), name="ecu-command", daemon=True)
        self._thread.start()

    def command(self, current_A: float, *, enable: bool = True, clear_faults: bool = False) -> None:
        """Set what the next command frame asks for.

        Args:
            current_A: set-point, A, within -32.768..32.767.
            enable: output stage on.
            clear_faults: ask the ECU to clear its latched faults.

        Raises:
            LocalProtocolError: the set-point does not fit the frame; the old one stays.
        """
        ecu.encode_command(CoilCommand(0, enable, clear_faults, current_A))
        self._wanted = (current_A, enable, clear_faults)

    def send_now(self) -> None:
        """Send the command frame at once, beside the cycle.

        Raises:
            PortClosed: the bus is not open or has gone.
            LinkLost: the interface does not take the frame.
        """
        with self._send_lock:
            current_A, enable, clear_faults = self._wanted
            data = ecu.encode_command(CoilCommand(self._counter, enable, clear_faults, current_A))
            self._port.send(ecu.COMMAND_ID, data)
            self._counter = (self._counter + 1) % ecu.COUNTER_MODULUS
            self.counters.sent += 1
        self._sent.append((
            time.monotonic_ns(), NO_DEVICE_TIME, current_A, self.counters.sent, Channel.COMMANDED_CURRENT, 0,
        ))

    def read_batch(self, timeout_s: float) -> EcuBatch:
        """Whatever has arrived, waiting for the first frame.

        Args:
            timeout_s: longest wait, s.

        Returns:
            The batch; without frames after a time-out.

        Raises:
            PortClosed: the bus is not open or has gone.
        """
        lost_before = self.counters.lost
        bad_before = self.counters.bad_checks + self.counters.malformed
        frames, arrival_ns = self._port.receive(timeout_s)
        batch = EcuBatch([], [], [], 0, 0, arrival_ns)
        while self._sent:
            batch.records.append(self._sent.popleft())
        for frame in frames:
            self._take(frame, batch)
        return batch._replace(
            lost=self.counters.lost - lost_before,
            bad=self.counters.bad_checks + self.counters.malformed - bad_before,
        )

    def read_identity(self, timeout_s: float = 2.5) -> EcuIdentity:
        """Wait for the ECU's identity frame (sent every second); call it before `read_batch` has an owner thread.

        Args:
            timeout_s: longest wait, s.

        Raises:
            NoAnswer: none came.
            WrongIdentity: serial number or frame layout are not the expected ones.
            PortClosed: the bus is not open or has gone.
        """
        self.identity = None
        identity = self._wait_for_identity(timeout_s)
        if identity.layout != ecu.LAYOUT:
            raise WrongIdentity("ecu", self._name, f"frame layout {identity.layout}, expected {ecu.LAYOUT}")
        if self._serial_number is not None and identity.serial_number != self._serial_number:
            raise WrongIdentity(
                "ecu", self._name, f"serial number {identity.serial_number}, expected {self._serial_number}"
            )
        return identity

    def age_ns(self, now_ns: int | None = None) -> int | None:
        """Nanoseconds since the last good status frame; None before the first.

        Args:
            now_ns: monotonic time; now without it.
        """
        if self._status_ns is None:
            return None
        return (time.monotonic_ns() if now_ns is None else now_ns) - self._status_ns

    def _wait_for_identity(self, timeout_s: float) -> EcuIdentity:
        """Read until an identity frame has come.

        Raises:
            NoAnswer: none came in time.
        """
        deadline = time.monotonic() + timeout_s
        while (left_s := deadline - time.monotonic()) > 0:
            self.read_batch(min(left_s, 0.1))
            if self.identity is not None:
                return self.identity
        raise NoAnswer("ecu", self._name, f"no identity frame within {timeout_s:g} s")

    def _send_cyclically(self, period_s: float) -> None:
        """Body of the command thread; ends at `close` or when the port is gone."""
        due = time.monotonic() + period_s
        while not self._ending.wait(max(0.0, due - time.monotonic())):
            try:
                self.send_now()
            except DriverError as error:
                self.send_error = error
                return
            due += period_s
            now = time.monotonic()
            if now > due:
                # A late cycle is not made up for by a burst.
                self.counters.late_sends += 1
                due = now + period_s

    def _take(self, frame: Frame, batch: EcuBatch) -> None:
        """Sort one frame; nothing is decoded before its kind and length are checked."""
        identifier, data, extended, remote, length = frame
        if extended or identifier not in _OWN_FRAMES:
            self._take_other(identifier, extended=extended, length=0 if remote else length)
            return
        if remote or length != ecu.FRAME_LENGTH or len(data) != ecu.FRAME_LENGTH:
            self._malformed(identifier)
            return
        if identifier == ecu.STATUS_ID:
            self._take_status(data, batch)
        elif identifier == ecu.TEMPERATURE_ID:
            self._take_temperature(data, batch)
        else:
            self.identity = ecu.decode_identity(data)

    def _take_other(self, identifier: int, *, extended: bool, length: int) -> None:
        """A frame that is none of the ECU's."""
        self.counters.other_bits += (_EXTENDED_BITS if extended else _STANDARD_BITS) + 8 * length
        if extended and identifier in _OWN_FRAMES:
            self._malformed(identifier)
        elif identifier == ecu.COMMAND_ID and not extended:
            self.counters.foreign_commands += 1
        else:
            self.counters.other_frames += 1

    def _malformed(self, identifier: int) -> None:
        self.counters.malformed += 1
        if identifier == ecu.STATUS_ID:
            self.counters.bad_in_a_row += 1
            self.counters.malformed_in_a_row += 1

    def _take_status(self, data: bytes, batch: EcuBatch) -> None:
        """Check, count and record one status frame."""
        counters = self.counters
        try:
            status = ecu.decode_status(data)
        except RemoteProtocolError:
            counters.bad_checks += 1
            counters.bad_in_a_row += 1
            return
        counters.bad_in_a_row = counters.malformed_in_a_row = 0
        step = 1 if self.status is None else ecu.counter_delta(self.status.counter, status.counter)
        if step == 0:
            counters.duplicates += 1
            counters.lateness += 2
            return
        counters.lateness = max(0, counters.lateness - 1)
        counters.gaps_in_a_row = counters.gaps_in_a_row + 1 if step > 1 else 0
        counters.statuses += 1
        counters.lost += step - 1
        self._sequence += step
        self._device_us = self._unwrap(status)
        self.status, self._status_ns = status, batch.arrival_ns
        batch.statuses.append(status)
        flags = Quality.GAP_BEFORE if step > 1 else Quality.GOOD
        self._record(batch, Channel.COIL_CURRENT, status.current_A, flags)
        state = (status.state, status.faults)
        if state != self._reported:
            self._report(batch, status)

    def _take_temperature(self, data: bytes, batch: EcuBatch) -> None:
        """Record temperatures and supply; and, for late readers, state and faults as they stand."""
        temperature = self.temperature = ecu.decode_temperature(data)
        batch.temperatures.append(temperature)
        self._record(batch, Channel.COIL_TEMPERATURE, temperature.coil_degC)
        self._record(batch, Channel.ECU_TEMPERATURE, temperature.ecu_degC)
        self._record(batch, Channel.ECU_SUPPLY, temperature.supply_V)
        if self.status is not None:
            self._report(batch, self.status)

    def _report(self, batch: EcuBatch, status: CoilStatus) -> None:
        self._record(batch, Channel.ECU_STATE, status.state)
        self._record(batch, Channel.ECU_FAULTS, status.faults)
        self._reported = (status.state, status.faults)

    def _record(self, batch: EcuBatch, channel: Channel, value: float, flags: Quality = Quality.GOOD) -> None:
        batch.records.append((
            batch.arrival_ns, self._device_us, float(value), self._sequence & 0xFFFFFFFF, int(channel), int(flags),
        ))

    def _unwrap(self, status: CoilStatus) -> int:
        """Device clock in microseconds, from a 0.1 ms counter that wraps after 6.5536 s."""
        ticks = status.device_time_ticks
        if self.status is None:
            return ticks * ecu.DEVICE_TIME_TICK_US
        passed = (ticks - self.status.device_time_ticks) % ecu.DEVICE_TIME_MODULUS
        return self._device_us + passed * ecu.DEVICE_TIME_TICK_US

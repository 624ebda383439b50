"""The coil's current source over CAN: cyclic command frames out, status frames in."""

from __future__ import annotations

import threading
import time
from collections import deque

from drivers.can_port import CanPort
from drivers.current_source import (
    SourceBatch,
    SourceCounters,
    SourceIdentity,
    SourceStatus,
    SourceTemperature,
    SourceTiming,
    SourceTraits,
)
from drivers.devices.source import SourceDescription
from drivers.errors import DriverError
from drivers.ring import NO_DEVICE_TIME, Channel, Record
from protocols.current_frames import COUNTER_MODULUS, CoilCommand, CoilStatus, counter_delta
from protocols.errors import RemoteProtocolError
from protocols.quality import Quality
from protocols.slcan import Frame

DEFAULT_PERIOD_S = 0.010
_COMMANDS_KEPT = 4096
_STANDARD_BITS, _EXTENDED_BITS = 47, 67


class CanCurrentSource:
    """Drives one current source whose description says what its frames mean.

    `read_batch` belongs to one owner thread. The command frame goes out from a thread of its own after `start`;
    `command` and `send_now` may be called from any thread. Until `command` is called the frames ask for 0 A, disabled.

    Args:
        interface: any interface of python-can.
        channel: what that interface calls the bus; a serial URL for slcan.
        description: its frames, codes and layout.
        bitrate: bit/s.

    Attributes:
        counters: totals.
        status: last status frame that passed every check, None before the first.
        temperature: last temperature frame.
        identity: last identity frame.
        send_error: what ended the command thread, None while it runs.
    """

    def __init__(
        self, interface: str, channel: str, description: SourceDescription, *, bitrate: int = 500_000
    ) -> None:
        self.counters = SourceCounters()
        self.status: SourceStatus | None = None
        self.temperature: SourceTemperature | None = None
        self.identity: SourceIdentity | None = None
        self.send_error: DriverError | None = None
        self._description = description
        self._frames = description.frames
        self._own = frozenset({self._frames.status_id, self._frames.temperature_id, self._frames.identity_id})
        self._port = CanPort(interface, channel, bitrate)
        self._is_open = False
        self._send_lock = threading.Lock()
        self._counter = 0
        self._wanted = (0.0, False, False)
        self._sent: deque[Record] = deque(maxlen=_COMMANDS_KEPT)
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None
        self._last: CoilStatus | None = None
        self._sequence = 0  # unwrapped counter of status frames
        self._device_us = NO_DEVICE_TIME  # unwrapped
        self._reported: tuple[int, int] | None = None

    @property
    def timing(self) -> SourceTiming:
        """How often it tells what."""
        return SourceTiming()

    @property
    def traits(self) -> SourceTraits:
        """What else the rig has to know of it."""
        return SourceTraits()

    @property
    def lacking(self) -> tuple[tuple[str, str], ...]:
        """What it cannot do or does not tell: nothing."""
        return ()

    @property
    def refusal(self) -> tuple[str, str]:
        """Nothing speaks against what is heard."""
        return "", ""

    @property
    def identity_problem(self) -> str:
        """Why the identity frame is not one of the described device; empty while it is, or none has come."""
        identity, layout = self.identity, self._description.layout
        if identity is None or identity.layout == layout:
            return ""
        return f"frame layout {identity.layout}, expected {layout}"

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
        self._frames.encode_command(CoilCommand(0, enable, clear_faults, current_A))
        self._wanted = (current_A, enable, clear_faults)

    def send_now(self) -> None:
        """Send the command frame at once, beside the cycle.

        Raises:
            PortClosed: the bus is not open or has gone.
            LinkLost: the interface does not take the frame.
        """
        with self._send_lock:
            current_A, enable, clear_faults = self._wanted
            data = self._frames.encode_command(CoilCommand(self._counter, enable, clear_faults, current_A))
            self._port.send(self._frames.command_id, data)
            self._counter = (self._counter + 1) % COUNTER_MODULUS
            self.counters.sent += 1
        self._sent.append((
            time.monotonic_ns(), NO_DEVICE_TIME, current_A, self.counters.sent, Channel.COMMANDED_CURRENT, 0,
        ))

    def read_batch(self, timeout_s: float) -> SourceBatch:
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
        batch = SourceBatch([], [], [], 0, 0, arrival_ns)
        while self._sent:
            batch.records.append(self._sent.popleft())
        for frame in frames:
            self._take(frame, batch)
        return batch._replace(
            lost=self.counters.lost - lost_before,
            bad=self.counters.bad_checks + self.counters.malformed - bad_before,
        )

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

    def _take(self, frame: Frame, batch: SourceBatch) -> None:
        """Sort one frame; nothing is decoded before its kind and length are checked."""
        identifier, data, extended, remote, length = frame
        if extended or identifier not in self._own:
            self._take_other(identifier, extended=extended, length=0 if remote else length)
            return
        expected = self._frames.lengths[identifier]
        if remote or length != expected or len(data) != expected:
            self._malformed(identifier)
            return
        if identifier == self._frames.status_id:
            self._take_status(data, batch)
        elif identifier == self._frames.temperature_id:
            self._take_temperature(data, batch)
        else:
            self.identity = SourceIdentity(*self._frames.decode_identity(data))

    def _take_other(self, identifier: int, *, extended: bool, length: int) -> None:
        """A frame that is none of the ECU's."""
        self.counters.other_bits += (_EXTENDED_BITS if extended else _STANDARD_BITS) + 8 * length
        if extended and identifier in self._own:
            self._malformed(identifier)
        elif identifier == self._frames.command_id and not extended:
            self.counters.foreign_commands += 1
        else:
            self.counters.other_frames += 1

    def _malformed(self, identifier: int) -> None:
        self.counters.malformed += 1
        if identifier == self._frames.status_id:
            self.counters.bad_in_a_row += 1
            self.counters.malformed_in_a_row += 1

    def _take_status(self, data: bytes, batch: SourceBatch) -> None:
        """Check, count and record one status frame."""
        counters = self.counters
        try:
            wire = self._frames.decode_status(data)
        except RemoteProtocolError:
            counters.bad_checks += 1
            counters.bad_in_a_row += 1
            return
        counters.bad_in_a_row = counters.malformed_in_a_row = 0
        step = 1 if self._last is None else counter_delta(self._last.counter, wire.counter)
        if step == 0:
            counters.duplicates += 1
            counters.lateness += 2
            return
        counters.lateness = max(0, counters.lateness - 1)
        counters.gaps_in_a_row = counters.gaps_in_a_row + 1 if step > 1 else 0
        counters.statuses += 1
        counters.lost += step - 1
        self._sequence += step
        self._device_us = self._unwrap(wire)
        described = self._description
        status = SourceStatus(described.state(wire.state), wire.current_A, described.faults(wire.faults))
        self._last, self.status = wire, status
        batch.statuses.append(status)
        flags = Quality.GAP_BEFORE if step > 1 else Quality.GOOD
        self._record(batch, Channel.COIL_CURRENT, status.current_A, flags)
        state = (status.state, status.faults)
        if state != self._reported:
            self._report(batch, status)

    def _take_temperature(self, data: bytes, batch: SourceBatch) -> None:
        """Record temperatures and supply; and, for late readers, state and faults as they stand."""
        temperature = self.temperature = SourceTemperature(*self._frames.decode_temperature(data))
        batch.temperatures.append(temperature)
        self._record(batch, Channel.COIL_TEMPERATURE, temperature.coil_degC)
        self._record(batch, Channel.ECU_TEMPERATURE, temperature.source_degC)
        self._record(batch, Channel.ECU_SUPPLY, temperature.supply_V)
        if self.status is not None:
            self._report(batch, self.status)

    def _report(self, batch: SourceBatch, status: SourceStatus) -> None:
        self._record(batch, Channel.ECU_STATE, status.state)
        self._record(batch, Channel.ECU_FAULTS, status.faults)
        self._reported = (status.state, status.faults)

    def _record(self, batch: SourceBatch, channel: Channel, value: float, flags: Quality = Quality.GOOD) -> None:
        batch.records.append((
            batch.arrival_ns, self._device_us, float(value), self._sequence & 0xFFFFFFFF, int(channel), int(flags),
        ))

    def _unwrap(self, status: CoilStatus) -> int:
        """Device clock in microseconds, from a counter that wraps."""
        ticks, tick_us = status.device_time_ticks, self._frames.tick_us
        if self._last is None:
            return ticks * tick_us
        passed = (ticks - self._last.device_time_ticks) % self._frames.device_time_modulus
        return self._device_us + passed * tick_us

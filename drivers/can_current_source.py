"""The coil's current source over CAN: command frames out, status frames in, laid out as its description says."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections import deque
from itertools import repeat

from drivers import clock
from drivers.can_bus import BusHandle
from drivers.can_port import CanPort
from drivers.current_source import (
    UNKNOWN_STATE,
    SourceBatch,
    SourceCounters,
    SourceFault,
    SourceIdentity,
    SourceStatus,
    SourceTemperature,
    SourceTiming,
    SourceTraits,
)
from drivers.devices.ecu_description import (
    BOOTS,
    CLEAR,
    CLOCK,
    COIL,
    COMMAND,
    CURRENT,
    ECU,
    ENABLE,
    FAULTS,
    FIRMWARE,
    LAYOUT,
    SERIAL,
    STATE,
    SUPPLY,
    EcuDescription,
)
from drivers.errors import DriverError
from drivers.frame_checks import FrameChecks
from drivers.origins import ChannelOrigin, Origins
from drivers.ring import NO_DEVICE_TIME, Channel, Record
from protocols.can_frame import EXTENDED, decode_requests
from protocols.j1939 import parameter_group, same_receiver, source_address
from protocols.quality import Quality
from protocols.slcan import Frame

DEFAULT_PERIOD_S = 0.010
REPEATS = 3
"""A command that is sent on change is sent so often, a period apart: one lost frame loses no command."""
FAREWELL_PAUSE_S = 0.005
_COMMANDS_KEPT = 4096
DEVICE_US_MODULUS = 1 << 63
_STANDARD_BITS, _EXTENDED_BITS = 47, 67
LONG_NAMES = {
    Channel.COIL_CURRENT: "Coil current measured by the ECU",
    Channel.COIL_TEMPERATURE: "Coil temperature reported by the ECU",
}
_CHANNELS = {
    COMMAND: Channel.COMMANDED_CURRENT, CURRENT: Channel.COIL_CURRENT, COIL: Channel.COIL_TEMPERATURE,
    ECU: Channel.ECU_TEMPERATURE, SUPPLY: Channel.ECU_SUPPLY,
}
_TEMPERATURES = ((COIL, Channel.COIL_TEMPERATURE), (ECU, Channel.ECU_TEMPERATURE), (SUPPLY, Channel.ECU_SUPPLY))


class _Request:
    """One request that is sent in every period of its message.

    Args:
        period_s: of the requests, s.
        request: identifier with the flag `EXTENDED`, data, and whether it is a remote frame.
    """

    def __init__(self, period_s: float, request: tuple[int, bytes, bool]) -> None:
        self._period_ns = int(1e9 * period_s)
        self._key, self._data, self._remote = request
        self._due_ns = 0

    def send(self, port: CanPort | BusHandle) -> int:
        """Send the request if it is due, and return when the next one is due (monotonic, ns)."""
        now_ns = clock.monotonic_ns()
        if now_ns >= self._due_ns:
            # A late request is not made up for by a burst.
            late = now_ns - self._due_ns if self._due_ns else 0
            self._due_ns = now_ns + self._period_ns - late % self._period_ns
            extended = bool(self._key & EXTENDED)
            port.send(self._key & ~EXTENDED, self._data, extended=extended, remote=self._remote)
        return self._due_ns


class CanCurrentSource:
    """Drives one current source whose description says what its frames mean.

    `read_batch` belongs to one owner thread. The command frames go out from a thread of its own after `start`;
    `command` and `send_now` may be called from any thread. Until `command` is called the frames ask for 0 A, disabled.

    Args:
        port: its bus, not yet open.
        description: its frames, codes and layout.

    Attributes:
        counters: totals.
        status: last status that passed every check, None before the first.
        temperature: last temperatures.
        identity: last identity.
        send_error: what ended the command thread, None while it runs.
    """

    def __init__(self, port: CanPort | BusHandle, description: EcuDescription) -> None:
        self.counters = SourceCounters()
        self.status: SourceStatus | None = None
        self.temperature: SourceTemperature | None = None
        self.identity: SourceIdentity | None = None
        self.send_error: DriverError | None = None
        self._description = description
        self._heard = description.heard
        self._groups = {parameter_group(key): key for key, message in description.heard.items() if message.by_group}
        self._address = description.source_address
        self._other_addresses: set[int] = set()
        self._stated = {
            parameter_group(key): source_address(key) for key, message in description.heard.items()
            if key & EXTENDED and not message.by_group
        }
        self._elsewhere: dict[int, set[int]] = {}
        self._requests = [
            _Request(message.period_s, request) for message in description.heard.values()
            for request in decode_requests(message.request)
        ]
        self._checks = FrameChecks(description, self.counters)
        self._port = port
        self._is_open = False
        self._send_lock = threading.Lock()
        self._count = 0
        self._own = frozenset(frame.identifier | (EXTENDED if frame.extended else 0) for frame in description.sent)
        self._own_groups = frozenset(same_receiver(frame.identifier) for frame in description.sent if frame.j1939)
        self._requested = (0.0, False, False)
        self._sent: deque[Record] = deque(maxlen=_COMMANDS_KEPT)
        self._left = REPEATS
        self._ending = threading.Event()
        self._thread: threading.Thread | None = None
        self._values: dict[str, float] = {}
        self._roles = description.roles
        self._ticks: int | None = None
        self._ticked = 0  # unwrapped, of the device's clock
        self._device_us = NO_DEVICE_TIME
        self._reported: tuple[int, int] | None = None
        self._at_ns = 0
        self._current_heard = False

    @property
    def timing(self) -> SourceTiming:
        """How often it tells what."""
        return self._description.timing

    @property
    def traits(self) -> SourceTraits:
        """What else the rig has to know of it."""
        described = self._description
        return SourceTraits(
            own_timeout_s=described.command_timeout_s, lowest_A=described.low_A,
            tells_bad_commands=bool(described.reported_faults & SourceFault.COMMAND_CHECK),
        )

    @property
    def origins(self) -> Origins:
        """The signals that each channel is read from or sent as."""
        described = self._description.signals
        signals = {role: signal.on_wire.format(f"{message}.") for role, (message, signal) in described.items()}
        faults = "; ".join(text for role, text in signals.items() if role.startswith(FAULTS))
        wires = {channel: f"value = {signals[role]}" for role, channel in _CHANNELS.items() if role in signals}
        if STATE in signals:
            wires[Channel.ECU_STATE] = f"value = meaning of {signals[STATE]} according to the roles file"
        if faults:
            wires[Channel.ECU_FAULTS] = f"value = meaning of {faults} according to the roles file"
        return {channel: ChannelOrigin("ecu", wire, LONG_NAMES.get(channel, "")) for channel, wire in wires.items()}

    @property
    def lacking(self) -> tuple[tuple[str, str], ...]:
        """What it cannot do or does not tell: a name, and what is left without it."""
        return self._description.lacking

    @property
    def refusal(self) -> tuple[str, str]:
        """Slug and words of why its frames cannot be believed; two empty texts while nothing speaks against them."""
        if self._other_addresses and self._description.source_address is None and self._address is not None:
            senders = ", ".join(f"0x{one:02X}" for one in sorted({self._address, *self._other_addresses}))
            return "can-foreign", (
                f"several nodes send the messages of the ECU (J1939 source addresses {senders}). Fix: write the ECU's "
                "address in the roles file, such as source_address = "
                f"0x{self._address:02X}"
            )
        elsewhere = self._heard_elsewhere()
        return ("no-answer", elsewhere) if elsewhere and not self._current_heard else self._checks.refusal()

    def _heard_elsewhere(self) -> str:
        """Message about parameter groups received only from another source address; empty if there are none."""
        described, addresses = self._description, self._elsewhere
        if described.source_address is not None and self._other_addresses:
            stated, heard = described.source_address, sorted(self._other_addresses)
            group = ""
        elif addresses:
            number, others = next(iter(addresses.items()))
            stated, heard = self._stated[number], sorted(others)
            group = f"J1939 parameter group 0x{number:05X} ({number})"
        else:
            return ""
        shown = ", ".join(f"0x{one:02X}" for one in heard)
        return (
            f"{group or 'the messages of the ECU'} received from source address {shown}, but expected from "
            f"0x{stated:02X}. Fix: write source_address = 0x{heard[0]:02X} in the roles file"
        )

    @property
    def identity_problem(self) -> str:
        """Why the identity is not one of the described device; empty while it is, or none has come."""
        identity, layout = self.identity, self._description.layout
        if identity is None or layout is None or identity.layout == layout:
            return ""
        return f"frame layout {identity.layout}, expected {layout}"

    @property
    def commanded_A(self) -> float:
        """Set-point of the command frames, A; 0 while they ask for the output stage to be off."""
        current_A, enable, _ = self._requested
        return current_A if enable else 0.0

    @property
    def waits_for_state(self) -> bool:
        """Its current is heard, but never yet its state or faults, which come in slower messages."""
        return self._current_heard and self.status is None

    @property
    def bus_errors(self) -> int:
        """Errors the interface reported."""
        return self._port.bus_errors

    @property
    def malformed(self) -> int:
        """Frames and lines that cannot be the ECU's: wrong length, remote, of the other kind, not decodable."""
        return self.counters.malformed + self._port.malformed

    def open(self) -> None:
        """Join the bus; sends nothing yet.

        Raises:
            PortClosed: the interface or its channel cannot be opened.
            LinkLost: the adapter rejects its configuration.
        """
        if not self._is_open:
            self._port.open()
            self._is_open = True

    def close(self) -> None:
        """Leave the ECU at 0 A with its output stage off, if anything was ever sent, and the bus; twice is harmless.

        Should these last frames not arrive, the ECU goes to 0 A by its own time-out.
        """
        self._ending.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None
            self._farewell()
        if self._is_open:
            self._is_open = False
            self._port.close()

    def _farewell(self) -> None:
        """The last command, as often as one that is sent on change: a frame may be lost."""
        self.command(0.0, enable=False)
        with contextlib.suppress(DriverError):
            for place in range(REPEATS):
                if place:
                    time.sleep(FAREWELL_PAUSE_S)
                self.send_now()

    def start(self, period_s: float = DEFAULT_PERIOD_S) -> None:
        """Send the command frames from now on, every `period_s` wall seconds.

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
        """Set what the next command frames ask for.

        Args:
            current_A: set-point, A, within what its signal holds.
            enable: output stage on; without such a signal the set-point is 0 A while it is off.
            clear_faults: ask the ECU to clear its latched faults.

        Raises:
            LocalProtocolError: the set-point does not fit the frame; the old one stays.
        """
        requested = (current_A, enable, clear_faults)
        self._frames(*requested)
        if requested != self._requested:
            self._left = REPEATS
        self._requested = requested

    def send_now(self) -> None:
        """Send the command frames at once, beside the cycle.

        Raises:
            PortClosed: the bus is not open or was lost.
            LinkLost: the interface does not accept a frame.
        """
        with self._send_lock:
            current_A, enable, clear_faults = self._requested
            frames = self._frames(current_A, enable, clear_faults)
            for frame, data in zip(self._description.sent, frames, strict=True):
                frame.protection.seal(data, self._count)
                self._port.send(frame.identifier, bytes(data), extended=frame.extended, fd=frame.fd)
            self._count += 1
            self._left = max(0, self._left - 1)
            self.counters.sent += 1
        self._sent.append((
            clock.monotonic_ns(), NO_DEVICE_TIME, current_A, self.counters.sent, Channel.COMMANDED_CURRENT, 0,
        ))

    def _frames(self, current_A: float, enable: bool, clear_faults: bool) -> list[bytearray]:
        """The frames of one command, their protection left open."""
        on_off = self._description.on_off
        values = {COMMAND: current_A if enable else 0.0}
        for role, on in ((ENABLE, enable), (CLEAR, clear_faults)):
            if role in on_off:
                values[role] = on_off[role][0 if on else 1]
        return [frame.writer.write(values) for frame in self._description.sent]

    def read_batch(self, timeout_s: float) -> SourceBatch:
        """Whatever has arrived, waiting for the first frame.

        Args:
            timeout_s: longest wait, s.

        Returns:
            The batch; without frames after a time-out.

        Raises:
            PortClosed: the bus is not open or was lost.
            LinkLost: the interface does not accept a request.
        """
        lost_before = self.counters.lost
        bad_before = self.counters.bad_checks + self.counters.malformed
        frames, arrival_ns = self._receive(timeout_s)
        batch = SourceBatch([], [], [], 0, 0, arrival_ns)
        while self._sent:
            batch.records.append(self._sent.popleft())
        for frame, at_ns in zip(frames, self._port.at_ns or repeat(arrival_ns), strict=False):
            self._at_ns = at_ns
            self._take(frame, batch)
        self.counters.stamps_ns = self._port.stamps.uncertainty_ns or 0
        return batch._replace(
            lost=self.counters.lost - lost_before,
            bad=self.counters.bad_checks + self.counters.malformed - bad_before,
        )

    def _receive(self, timeout_s: float) -> tuple[list[Frame], int]:
        """Frames that have arrived, waiting for the first one; requests are sent when they are due."""
        end_ns = clock.monotonic_ns() + int(1e9 * timeout_s)
        while True:
            next_ns = min((request.send(self._port) for request in self._requests), default=end_ns)
            now_ns = clock.monotonic_ns()
            frames, arrival_ns = self._port.receive(max(0, min(next_ns, end_ns) - now_ns) * 1e-9)
            if frames or next_ns >= end_ns or arrival_ns >= end_ns:
                return frames, arrival_ns

    def _send_cyclically(self, period_s: float) -> None:
        """Body of the command thread; ends at `close` or when the port is gone."""
        due = clock.monotonic() + period_s
        cyclic = self._description.cyclic
        while not self._waited(due - clock.monotonic()):
            try:
                if cyclic or self._left:
                    self.send_now()
            except DriverError as error:
                self.send_error = error
                break
            due += period_s
            now = clock.monotonic()
            if now > due:
                # A late cycle is not made up for by a burst.
                self.counters.late_sends += 1
                due = now + period_s
        clock.back_whenever()

    def _waited(self, left_s: float) -> bool:
        """Wait for the next cycle; True once there is none."""
        clock.back_within(left_s)
        return self._ending.wait(max(0.0, left_s))

    def _take(self, frame: Frame, batch: SourceBatch) -> None:
        """Sort one frame; nothing is decoded before its kind and length are checked."""
        identifier, data, extended, remote, length = frame
        key = identifier | EXTENDED if extended else identifier
        if extended and (named := self._groups.get(parameter_group(identifier))) is not None:
            if not self._is_from_ecu(source_address(identifier)):
                self._take_other(key, length=0 if remote else length)
                return
            key = named
        message = self._heard.get(key)
        if message is None:
            self._take_other(key, length=0 if remote else length)
            return
        is_status = key == self._description.status
        if remote and message.request:
            self._take_other(key, length=0)  # another host requests the same message
            return
        if remote or length != message.size or len(data) != message.size:
            self._checks.malformed(is_status)
            return
        step = self._checks.step(key, message, data)
        if step is None:
            return
        values = message.reader.read(data)
        self._values.update(values)
        self._checks.heard(key, batch.arrival_ns)
        if CLOCK in values:
            self._tick(int(values[CLOCK]))
        if is_status and CURRENT in values:
            self._take_status(batch, step)
        if message.roles & {COIL, ECU, SUPPLY, BOOTS}:
            self._take_temperature(values, batch)
        if message.roles & {SERIAL, FIRMWARE, LAYOUT}:
            self._take_identity()

    def _is_from_ecu(self, address: int) -> bool:
        """Whether a frame of one of its parameter groups is the ECU's: from its address, or the first that is heard."""
        if self._address is None:
            self._address = address
        if address != self._address:
            self._other_addresses.add(address)
        return address == self._address

    def _take_other(self, key: int, *, length: int) -> None:
        """A frame that is none of the ECU's."""
        if key & EXTENDED and parameter_group(key) in self._stated:
            self._elsewhere.setdefault(parameter_group(key), set()).add(source_address(key))
        self.counters.other_bits += (_EXTENDED_BITS if key & EXTENDED else _STANDARD_BITS) + 8 * length
        if key ^ EXTENDED in self._heard:
            self._checks.malformed(key ^ EXTENDED == self._description.status)
        elif key in self._own or (key & EXTENDED and same_receiver(key) in self._own_groups):
            self.counters.foreign_commands += 1
        else:
            self.counters.other_frames += 1

    def _take_status(self, batch: SourceBatch, step: int) -> None:
        """Record one status, unless what it is told beside by other messages has become too old."""
        self._current_heard = True
        if not self._checks.measured(self._values[CURRENT]) or not self._checks.complete(batch.arrival_ns):
            return
        described, values, roles = self._description, self._values, self._roles
        state = described.state(int(values[STATE])) if STATE in values else UNKNOWN_STATE
        status = self.status = SourceStatus(state, values[CURRENT], described.faults(values))
        self.counters.statuses += 1
        batch.statuses.append(status)
        flags = Quality.GAP_BEFORE if step > 1 else Quality.GOOD
        self._record(batch, Channel.COIL_CURRENT, status.current_A, flags)
        reported = (status.state, status.faults)
        if reported != self._reported and any(role == STATE or role.startswith(FAULTS) for role in roles):
            self._report(batch, status)

    def _take_temperature(self, values: dict[str, float], batch: SourceBatch) -> None:
        """Record temperatures and supply; and, for late readers, state and faults as they stand."""
        for role, channel in _TEMPERATURES:
            if role not in values:
                continue
            if math.isnan(values[role]):
                self.counters.not_numbers[channel] = self.counters.not_numbers.get(channel, 0) + 1
            else:
                self._record(batch, channel, values[role])
        leading = next((role for role in (COIL, ECU, SUPPLY, BOOTS) if role in self._roles), COIL)
        if leading not in values or math.isnan(values[leading]):
            return  # a temperature that stays away is noticed by the age of the last one
        known = self._values
        temperature = self.temperature = SourceTemperature(
            known.get(COIL, math.nan), known.get(ECU, math.nan), known.get(SUPPLY, math.nan), int(known.get(BOOTS, 0))
        )
        batch.temperatures.append(temperature)
        if self.status is not None:
            self._report(batch, self.status)

    def _take_identity(self) -> None:
        """An identity, once everything that makes one has come."""
        roles = [role for role in (SERIAL, FIRMWARE, LAYOUT) if role in self._roles]
        if all(role in self._values for role in roles):
            self.identity = SourceIdentity(*(int(self._values.get(role, 0)) for role in (SERIAL, FIRMWARE, LAYOUT)))

    def _report(self, batch: SourceBatch, status: SourceStatus) -> None:
        if STATE in self._roles:
            self._record(batch, Channel.ECU_STATE, status.state)
        if any(role.startswith(FAULTS) for role in self._roles):
            self._record(batch, Channel.ECU_FAULTS, status.faults)
        self._reported = (status.state, status.faults)

    def _record(self, batch: SourceBatch, channel: Channel, value: float, flags: Quality = Quality.GOOD) -> None:
        batch.records.append((
            self._at_ns, self._device_us, float(value), self._checks.sequence & 0xFFFFFFFF, int(channel),
            int(flags),
        ))

    def _tick(self, ticks: int) -> None:
        """Device clock in microseconds, from a counter that wraps."""
        described = self._description
        self._ticked += ticks if self._ticks is None else (ticks - self._ticks) % described.clock_modulus
        self._ticks = ticks
        # A record's time has 63 bits; a clock of 64 bits may show anything.
        self._device_us = round(self._ticked * described.tick_us) % DEVICE_US_MODULUS

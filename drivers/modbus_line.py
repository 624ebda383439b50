"""Modbus sensors and an analogue output on one connection (TCP or serial line).

    period of 5 ms:   read registers 0..3 (load cell, LVDT)  |  write 1000 (output)  |  read 4..5 (output)

Sensors with the same period and adjacent registers are read in one request. One request is pending at a time; requests
to the output have priority, but only one of them is sent before a reading that is due. On TCP, the transaction
identifier assigns an answer to its request. On a serial line, a late answer cannot be distinguished from the next one,
so after a time-out the line stays silent for the same time again and discards what arrives. If the device has its own
clock (a simulated device that runs faster), requests are sent in advance on TCP and readings are counted.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace

from drivers import clock
from drivers.connection import LineSettings
from drivers.errors import DamagedAnswer, DriverError, LinkLost, NoAnswer
from drivers.modbus_wire import TRANSACTIONS
from drivers.ring import Channel
from drivers.sample_stream import Batch, SampleCounters, SampleScale, SampleStream
from drivers.serial_port import SerialPort
from drivers.serial_sensor import AHEAD_S, AHEAD_TIMEOUT_S, REQUEST_RATE_Hz
from drivers.shared_connection import SharedConnection
from protocols import modbus
from protocols.binary_decoder import FrameMeaning
from protocols.binary_format import BinaryFormat, Registers
from protocols.errors import RemoteProtocolError
from protocols.frame_format import DEVICE_US_MODULUS, SEQUENCE_MODULUS, Reading
from protocols.modbus_format import FUNCTIONS, MOST_REGISTERS

MOST_AHEAD = 64
"""Maximum number of pending requests per block to a device with its own clock."""
READINGS_KEPT = 1 << 16
LOOK_NS = 5_000_000
"""Interval at which an idle line checks for requests to the output."""
SPACES = {number: name for name, number in FUNCTIONS.items()}
EXCEPTION_HINTS = {
    1: "the device does not support this function. Fix: check function (holding or input)",
    2: "the device has no such register. Fix: check address, first_address and type in the sensor's format",
    3: "the device rejects the number of registers. Fix: check type in the sensor's format",
    4: "the device reports a failure. Fix: check the device",
    6: "the device is busy. Fix: read it less often (lower rate)",
    10: "the gateway cannot reach the device. Fix: check device_id and the gateway",
    11: "the device behind the gateway does not answer. Fix: check device_id, wiring and power of the device",
}


@dataclass
class Block:
    """Registers that are read in one request, and their sensors.

    Attributes:
        unit, function, address, count: of the request.
        period_ns: interval between requests (wall ns).
        timeout_ns: longest wait for the answer (ns).
        ahead: maximum number of pending requests.
        sensors: owners of the registers.
        due_ns: time of the next request.
        number: of the last request.
        under_way: number of pending requests.
    """

    unit: int
    function: int
    address: int
    count: int
    period_ns: int
    timeout_ns: int
    ahead: int
    sensors: list[ModbusSensor]
    due_ns: int = 0
    number: int = 0
    under_way: int = 0

    @property
    def request(self) -> bytes:
        """PDU of the request."""
        return modbus.read_request(self.address, self.count, self.function)


@dataclass
class Call:
    """A request from another driver on the line, and its result.

    Attributes:
        device: name of that driver's device.
        answer: PDU, or None if there is none yet.
        failure: reason why there is no answer.
    """

    device: str
    unit: int
    pdu: bytes
    timeout_ns: int
    answer: bytes | None = None
    failure: str = ""
    damaged: bool = False

    @property
    def done(self) -> bool:
        """Whether the request has finished."""
        return self.answer is not None or bool(self.failure)


@dataclass
class UnderWay:
    """A pending request: of a block (with its number) or of another driver."""

    transaction: int
    of: Block | Call
    pdu: bytes
    unit: int
    number: int
    sent_ns: int
    timeout_ns: int


class ModbusLine:
    """One connection, and all its requests.

    Args:
        url: `modbus-tcp://host:port`, `socket://host:port`, or a serial port.
        line: settings of the serial line.
        rtu: Modbus RTU, else Modbus TCP.
        device_rate: device seconds per second of the host's clock.

    Attributes:
        stale: number of answers to abandoned requests.
        has_output: whether an analogue output, which drives the coil, uses the connection.
    """

    def __init__(self, url: str, line: LineSettings, *, rtu: bool, device_rate: float = 1.0) -> None:
        self.url = url
        self.rtu = rtu
        self.stale = 0
        self.has_output = False
        self.device_rate = device_rate
        self._clocked = device_rate == 1.0
        self.port = SerialPort(
            url, line.baudrate, device=url, bytesize=line.data_bits, parity=line.parity, stopbits=line.stop_bits
        )
        self.connection: SharedConnection[tuple[bytes, int]] = SharedConnection(
            url, self._open, self.port.close, self.port.read_available, self._take
        )
        self._sensors: list[ModbusSensor] = []
        self._blocks: list[Block] | None = None
        self._calls: deque[Call] = deque()
        self._under_way: deque[UnderWay] = deque()
        self._transaction = 0
        self._sent_call = False
        """Whether the last request was from another driver."""
        self._quiet_ns = 0
        self._frames = modbus.TcpFrames()
        self._held = b""

    def add(self, sensor: ModbusSensor) -> None:
        """Add a sensor to the line."""
        self._sensors.append(sensor)
        self.connection.add(sensor.name)
        self._blocks = None

    def ask(self, device: str, unit: int, pdu: bytes, timeout_s: float) -> bytes:
        """Send a request from another driver, before any sensor request, and return the answer.

        Raises:
            NoAnswer: no answer arrived in time.
            DamagedAnswer: the answer cannot be decoded.
            DriverError: the connection was lost.
        """
        call = Call(device, unit, pdu, int(timeout_s * 1e9))
        with self.connection.state:
            self._calls.append(call)
            try:
                self._send(clock.monotonic_ns())
            except DriverError as error:
                self.connection.lose(error)
        # Also wait for the request that is already pending.
        self.connection.wait(lambda: call.done, timeout_s + self._longest_s, device, self.next_ns)
        with self.connection.state:
            if not call.done:
                self._forget(call)
                call.failure = f"no answer within {timeout_s * 1e3:g} ms"
        if call.answer is None:
            raise (DamagedAnswer if call.damaged else NoAnswer)(device, self.url, call.failure)
        return call.answer

    def next_ns(self) -> int:
        """Send all due requests, and return the latest time of the next call; the caller holds the state lock.

        Raises:
            DriverError: the connection was lost.
        """
        now_ns = clock.monotonic_ns()
        self._give_up(now_ns)
        self._send(now_ns)
        if self._under_way:
            first = self._under_way[0]
            return first.sent_ns + first.timeout_ns + 1
        if self._quiet_ns > now_ns:
            return self._quiet_ns
        return min([now_ns + LOOK_NS, *(block.due_ns for block in self._planned if self._is_read(block))])

    @property
    def waits_for(self) -> str:
        """Text about the pending request of another driver that delays the sensors; empty if there is none."""
        with self.connection.state:
            first = self._under_way[0] if self._under_way else None
        if first is None or not isinstance(first.of, Call):
            return ""
        waited_ms = (clock.monotonic_ns() - first.sent_ns) // 1_000_000
        return f"the device has not answered the request of {first.of.device} for {waited_ms} ms"

    @property
    def _longest_s(self) -> float:
        return max([block.timeout_ns for block in self._planned], default=0) * 1e-9

    def _open(self) -> None:
        self.port.open()
        self._calls.clear()
        self._under_way.clear()
        for block in self._planned:
            block.under_way = block.due_ns = 0
        self._forget_input()
        self._quiet_ns = 0

    @property
    def _planned(self) -> list[Block]:
        if self._blocks is None:
            self._blocks = blocks_of(self._sensors)
        return self._blocks

    # Sending

    def _is_read(self, block: Block) -> bool:
        return any(sensor.is_open for sensor in block.sensors)

    def _send(self, now_ns: int) -> None:
        if now_ns < self._quiet_ns:
            return
        if self._clocked or self.rtu:
            self._send_one(now_ns)
            return
        while self._calls:
            self._send_call(now_ns)
        for block in self._planned:
            while self._is_read(block) and block.under_way < block.ahead:
                self._send_block(block, now_ns)

    def _send_one(self, now_ns: int) -> None:
        """Send the next request if only one may be pending.

        Only one request to the output is sent before a block that is due: several in succession take longer than the
        period of a fast sensor on a slow device, whose samples would be lost.
        """
        if self._under_way:
            return
        read = [block for block in self._planned if block.due_ns <= now_ns and self._is_read(block)]
        if self._calls and not (read and self._sent_call):
            self._send_call(now_ns)
        elif read:
            block = min(read, key=lambda block: block.due_ns)
            late = (now_ns - block.due_ns) // block.period_ns if block.due_ns and self._clocked else 0
            block.due_ns = (block.due_ns or now_ns) + (late + 1) * block.period_ns if self._clocked else now_ns
            block.number += late
            self._send_block(block, now_ns)
            self._sent_call = False

    def _send_call(self, now_ns: int) -> None:
        call = self._calls.popleft()
        self._sent_call = True
        self._put(call, call.unit, call.pdu, 0, call.timeout_ns, now_ns)

    def _send_block(self, block: Block, now_ns: int) -> None:
        block.number += 1
        block.under_way += 1
        self._put(block, block.unit, block.request, block.number, block.timeout_ns, now_ns)

    def _put(self, of: Block | Call, unit: int, pdu: bytes, number: int, timeout_ns: int, now_ns: int) -> None:
        self._transaction = self._transaction % (TRANSACTIONS - 1) + 1
        frame = modbus.encode_rtu(unit, pdu) if self.rtu else modbus.encode_tcp(self._transaction, unit, pdu)
        self._under_way.append(UnderWay(self._transaction, of, pdu, unit, number, now_ns, timeout_ns))
        self.port.write(frame)

    def _give_up(self, now_ns: int) -> None:
        """Abandon overdue requests; on a serial line, also pause before the next request."""
        if not self._under_way or now_ns - self._under_way[0].sent_ns <= self._under_way[0].timeout_ns:
            return
        waited_ns = self._under_way[0].timeout_ns
        self._fail("no answer in time")
        if self.rtu:
            self._quiet_ns = now_ns + waited_ns
            self._held = b""

    def _fail(self, why: str, *, damaged: bool = False) -> None:
        """Abandon all pending requests."""
        while self._under_way:
            self._end(self._under_way.popleft(), why, damaged=damaged)

    def _end(self, request: UnderWay, why: str, *, damaged: bool = False) -> None:
        if isinstance(request.of, Call):
            request.of.failure, request.of.damaged = why, damaged
        else:
            request.of.under_way -= 1
            for sensor in request.of.sensors:
                sensor.bad_frames += damaged

    def _forget(self, call: Call) -> None:
        if call in self._calls:
            self._calls.remove(call)

    def _forget_input(self) -> None:
        self._frames, self._held = modbus.TcpFrames(), b""

    # Receiving

    def _take(self, got: tuple[bytes, int]) -> None:
        chunk, arrival_ns = got
        if not chunk:
            return
        try:
            if self.rtu:
                self._take_rtu(chunk, arrival_ns)
            else:
                self._take_tcp(chunk, arrival_ns)
        except RemoteProtocolError as error:
            # The start of the next answer is unknown, so pending requests are repeated.
            self._fail(str(error), damaged=True)
            self._forget_input()
            if self.rtu:
                self._quiet_ns = clock.monotonic_ns() + max(LOOK_NS, int(self._longest_s * 1e9))

    def _take_tcp(self, chunk: bytes, arrival_ns: int) -> None:
        self._frames.feed(chunk)
        while (frame := self._frames.next()) is not None:
            transaction, unit, pdu = frame
            request = next((one for one in self._under_way if one.transaction == transaction), None)
            if request is None:
                self.stale += 1
                continue
            self._under_way.remove(request)
            self._answered(request, unit, pdu, arrival_ns)

    def _take_rtu(self, chunk: bytes, arrival_ns: int) -> None:
        if not self._under_way:
            for sensor in self._sensors:
                sensor.skipped_bytes += len(chunk)
            self.stale += 1
            return
        self._held += chunk
        while self._under_way:
            request = self._under_way[0]
            size = modbus.rtu_answer_size(self._held, request.pdu)
            if size is None or len(self._held) < size:
                return
            frame, self._held = self._held[:size], self._held[size:]
            unit, pdu = modbus.decode_rtu(frame)
            self._under_way.popleft()
            self._answered(request, unit, pdu, arrival_ns)
        self._held = b""

    def _answered(self, request: UnderWay, unit: int, pdu: bytes, arrival_ns: int) -> None:
        if unit != request.unit:
            self._end(request, f"the request was sent to unit {request.unit}, but unit {unit} answered", damaged=True)
        elif isinstance(request.of, Call):
            request.of.answer = pdu
        else:
            block = request.of
            block.under_way -= 1
            for other in self._under_way if not self._clocked else ():
                other.sent_ns = arrival_ns  # the device's clock continues
            code = modbus.refusal(request.pdu, pdu)
            head, size = bytes([block.function, 2 * block.count]), 2 + 2 * block.count
            if code is None and (len(pdu) != size or not pdu.startswith(head)):
                for sensor in block.sensors:
                    sensor.bad_frames += 1
                return
            device_us = request.sent_ns // 1000 % DEVICE_US_MODULUS if self._clocked else -1
            for sensor in block.sensors:
                if code is not None:
                    sensor.refused(code, block)
                else:
                    first = 2 + 2 * (sensor.registers.address - block.address)
                    sensor.take(pdu[first : first + 2 * sensor.registers.count], request.number, device_us)


def blocks_of(sensors: list[ModbusSensor]) -> list[Block]:
    """Combine sensors with the same period and adjacent registers into one request each."""
    blocks: list[Block] = []
    for sensor in sorted(sensors, key=lambda one: one.registers.address):
        mine, before = sensor.registers, None
        for block in blocks:
            gap = mine.address - (block.address + block.count)
            allowed = min(mine.largest_gap, *(one.registers.largest_gap for one in block.sensors))
            same = (block.unit, block.function, block.period_ns) == (mine.unit, mine.function, sensor.period_ns)
            if same and gap <= allowed and mine.end - block.address <= MOST_REGISTERS:
                before = block
        if before is None:
            blocks.append(Block(
                mine.unit, mine.function, mine.address, mine.count, sensor.period_ns, sensor.timeout_ns, sensor.ahead,
                [sensor],
            ))
        else:
            before.count = max(before.count, mine.end - before.address)
            before.timeout_ns = max(before.timeout_ns, sensor.timeout_ns)
            before.sensors.append(sensor)
    return blocks


class ModbusSensor:
    """A sensor whose readings are Modbus registers on a shared line; a `drivers.roles.Sensor`.

    Args:
        line: the connection.
        name: device name for messages, as in the bench file.
        channel: ring channel 1..9.
        layout: format of the readings.
        registers: of that format.
        scale: conversion from wire units to SI, and the sensor's rate (default: the rate of the format).

    Attributes:
        bad_frames: number of answers that could not be decoded.
        skipped_bytes: number of bytes that were not part of an answer.
        moved: whether the name of the line now points to a different port.
    """

    def __init__(
        self, line: ModbusLine, *, name: str, channel: Channel, layout: BinaryFormat, registers: Registers,
        scale: SampleScale,
    ) -> None:
        self.name = name
        self.channel = channel
        self.registers = registers
        self.bad_frames = self.skipped_bytes = 0
        rate_Hz = scale.rate_Hz or layout.nominal_rate_Hz or REQUEST_RATE_Hz
        clocked = scale.device_rate == 1.0
        self.period_ns = int(1e9 / (rate_Hz * scale.device_rate))
        self.timeout_ns = int((layout.exchange.answer_timeout_s if clocked else AHEAD_TIMEOUT_S) * 1e9)
        self.ahead = max(1, min(MOST_AHEAD, int(AHEAD_S * rate_Hz * scale.device_rate)))
        self._line = line
        self._layout = layout
        self._meaning = FrameMeaning(layout)
        self._stream = SampleStream(None, channel, replace(scale, rate_Hz=rate_Hz))
        self._readings: deque[Reading] = deque(maxlen=READINGS_KEPT)
        self._codes: dict[int, int] = {}
        self._together = ""
        """Text about the sensors whose registers the refused request covers as well."""
        self._answers = 0
        line.add(self)

    @property
    def url(self) -> str:
        """URL of the connection."""
        return self._line.url

    @property
    def moved(self) -> bool:
        """Whether the name of the port now points to a different port."""
        return self._line.port.moved

    @property
    def is_open(self) -> bool:
        """Whether the connection is open for this sensor."""
        return self._line.connection.is_open_for(self.name)

    @property
    def lost_slug(self) -> str:
        """Fault code of a lost connection: that of the output if one shares it, independent of the thread."""
        return "can-lost" if self._line.has_output else ""

    @property
    def counters(self) -> SampleCounters:
        """Totals of samples, losses and faults since construction."""
        return self._stream.counters

    @property
    def refusal(self) -> tuple[str, str]:
        """Code and text of the exception that the device returns; without a code, the request that blocks the line."""
        if not self._codes or self._answers:
            return "", self._line.waits_for
        code = next(reversed(self._codes))
        mine = self.registers
        first = mine.address + mine.first_address
        shown = f"register {first}" if mine.count == 1 else f"registers {first} to {first + mine.count - 1}"
        name = modbus.EXCEPTION_NAMES.get(code, "unknown")
        meant = EXCEPTION_HINTS.get(code, "Fix: see the manual of the device")
        return "modbus-reject", (
            f"unit {mine.unit} answered the request to read {SPACES[mine.function]} {shown} with exception {code} "
            f"({name}){self._together}: {meant}"
        )

    def open(self) -> None:
        """Open the connection, or use it if another device has opened it.

        Raises:
            PortClosed: it cannot be opened.
        """
        self._line.connection.open(self.name)
        self.discard_input()

    def close(self) -> None:
        """Release the connection; the last user closes it."""
        self._line.connection.close(self.name)

    def discard_input(self) -> None:
        """Discard the readings that have arrived."""
        with self._line.connection.state:
            self._readings.clear()

    def read_batch(self, timeout_s: float) -> Batch:
        """Return the readings that have arrived, waiting for the first one.

        Args:
            timeout_s: longest wait, s.

        Raises:
            PortClosed: the connection was lost.
        """
        line = self._line
        line.connection.wait(lambda: bool(self._readings), timeout_s, self.name, line.next_ns)
        with line.connection.state:
            readings = list(self._readings)
            self._readings.clear()
        return self._stream.take_readings(readings, clock.monotonic_ns())

    def take(self, data: bytes, number: int, device_us: int) -> None:
        """Accept the registers of one answer; the caller holds the state lock."""
        self._answers += 1
        self._codes.clear()
        layout = self._layout
        frame = layout.sync + data + bytes(2 if self.registers.rtu else 0)
        _, _, value, status, _ = self._meaning.reading(frame)
        self._readings.append((number % SEQUENCE_MODULUS, device_us, value, status, 0))

    def refused(self, code: int, block: Block) -> None:
        """Record an exception to the request of a block; the caller holds the state lock."""
        others = " and ".join(one.name for one in block.sensors if one is not self)
        self._together = "" if not others else (
            f" (read in one request with {others}; the device may refuse the registers of one of them)"
        )
        self._codes[code] = self._codes.pop(code, 0) + 1
        self._answers = 0


@dataclass
class SharedWire:
    """Access to the line for another driver; a `drivers.modbus_wire.Wire`.

    Attributes:
        line: the connection.
        unit: Modbus address of the device.
        device: name of the device.
    """

    line: ModbusLine
    unit: int
    device: str
    stale: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        self.line.connection.add(self.device)
        self.line.has_output = True

    @property
    def is_open(self) -> bool:
        """Whether the connection is open for this device."""
        return self.line.connection.is_open_for(self.device)

    def open(self, timeout_s: float) -> None:
        """Open the connection, or use it if a sensor has opened it.

        Raises:
            PortClosed: it cannot be opened.
        """
        del timeout_s
        self.line.connection.open(self.device)

    def close(self) -> None:
        """Release the connection; the last user closes it."""
        self.line.connection.close(self.device)

    def ask(self, pdu: bytes, timeout_s: float) -> bytes:
        """Send one request and wait for its answer.

        Raises:
            NoAnswer: no answer arrived in time.
            LinkLost: the connection broke or is not open.
            DamagedAnswer: the answer cannot be read.
        """
        try:
            return self.line.ask(self.device, self.unit, pdu, timeout_s)
        except (NoAnswer, DamagedAnswer):
            raise
        except DriverError as error:
            raise LinkLost(self.device, error.port, error.message, error.fix) from error

    def drain(self) -> int:
        """Nothing to discard: the line assigns answers to requests and discards all others."""
        return 0



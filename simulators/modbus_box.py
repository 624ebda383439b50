"""A simulated data-acquisition device: sensors and an analogue output at one Modbus address.

The simulated sensors provide the samples; this module is the device's side of the connection. If one request reads the
registers of several sensors, they are sampled at the same time.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field

from pymodbus.constants import ExcCodes

from protocols import modbus
from protocols.binary_format import BinaryFormat, Registers
from protocols.errors import RemoteProtocolError
from simulators.output_module import DEVICE_ID, SimulatedOutput
from simulators.serial_port import SensorPort, SocketPort

SPACES = {
    modbus.READ_COILS: "coil", modbus.READ_DISCRETE: "discrete", modbus.READ: "holding", modbus.READ_INPUT: "input",
    modbus.WRITE_COIL: "coil", modbus.WRITE_COILS: "coil", modbus.WRITE_REGISTER: "holding", modbus.WRITE: "holding",
}  # fmt: skip
REGISTER_READS = frozenset({modbus.READ, modbus.READ_INPUT})
_FIXED_SIZE = 8
"""Length of serial-line requests with a fixed length (bytes)."""
_TCP_HEAD, _RTU_HEAD, _CRC_SIZE = 9, 3, 2


@dataclass
class _Request:
    """A pending request to read sensor registers, waiting for samples."""

    transaction: int
    unit: int
    pdu: bytes
    members: list[BoxPort]


class ModbusBox:
    """One simulated device.

    Args:
        port: connection of the device.
        rtu: Modbus RTU, else Modbus TCP.
        clocked: whether host and device share a clock; a request followed by another one was then abandoned.

    Attributes:
        output: analogue output of the device, if any.
    """

    def __init__(self, port: SensorPort, *, rtu: bool, clocked: bool) -> None:
        self.port = port
        self.output: SimulatedOutput | None = None
        self._rtu, self._clocked = rtu, clocked
        self._members: list[BoxPort] = []
        self._waiting: deque[_Request] = deque()
        self._held = b""
        self._frames = modbus.TcpFrames()
        if isinstance(port, SocketPort):
            port.on_heard = self.hear  # outputs are answered immediately, not at the rig's next tick

    @property
    def address(self) -> str:
        """Host and port of the device on TCP."""
        return self.port.url.partition("://")[2]

    def has_room(self, wanted: Registers) -> bool:
        """Whether none of these registers belongs to a sensor of the device."""
        return not any(_overlap(member.registers, wanted) for member in self._members)

    def add(self, layout: BinaryFormat, registers: Registers) -> BoxPort:
        """Add a sensor and return its port."""
        member = BoxPort(self, layout, registers)
        self._members.append(member)
        return member

    def can_host(self, output: SimulatedOutput) -> bool:
        """Whether the registers of an output are unused."""
        blocks = output.blocks()
        return not self._rtu and not any(
            SPACES[member.registers.function] == space and member.registers.unit == DEVICE_ID
            and member.registers.address < first + count and first < member.registers.end
            for space, runs in blocks.items() for first, count in runs for member in self._members
        )

    def hear(self) -> None:
        """Process the received requests: reads of sensors wait for samples; other requests are answered."""
        for came_ns, data in self.port.heard():
            try:
                requests = list(self._rtu_requests(data) if self._rtu else self._tcp_requests(data))
            except RemoteProtocolError:
                self._held, self._frames = b"", modbus.TcpFrames()
                continue
            for transaction, unit, pdu in requests:
                members = self._read_by(unit, pdu)
                if members:
                    if self._clocked:
                        self._forget(members)
                    self._waiting.append(_Request(transaction, unit, pdu, members))
                    for member in members:
                        member.requests.append((came_ns, member.request))
                else:
                    self._answer(transaction, unit, self._of_output(unit, pdu))

    def flush(self) -> None:
        """Answer the requests whose samples are complete."""
        while self._waiting and all(member.frames for member in self._waiting[0].members):
            request = self._waiting.popleft()
            first, count = (int.from_bytes(request.pdu[at : at + 2], "big") for at in (1, 3))
            data = bytearray(2 * count)
            damaged = b""
            for member in request.members:
                frame, mine = member.frames.popleft(), member.registers
                content = frame[member.head : member.head + 2 * mine.count]
                if not frame.startswith(member.sync) or len(content) != 2 * mine.count:
                    damaged = frame
                data[2 * (mine.address - first) : 2 * (mine.end - first)] = content
            if damaged:
                self.port.write(damaged, len(damaged))
            else:
                self._answer(request.transaction, request.unit, bytes([request.pdu[0], 2 * count]) + bytes(data))

    def _forget(self, members: Iterable[BoxPort]) -> None:
        for request in [one for one in self._waiting if set(one.members) & set(members)]:
            self._waiting.remove(request)
            for member in request.members:
                member.frames.clear()

    def _answer(self, transaction: int, unit: int, pdu: bytes | None) -> None:
        if pdu is not None:
            frame = modbus.encode_rtu(unit, pdu) if self._rtu else modbus.encode_tcp(transaction, unit, pdu)
            self.port.write(frame, len(frame))

    def _read_by(self, unit: int, pdu: bytes) -> list[BoxPort]:
        """Sensors whose registers a request reads completely."""
        if pdu[0] not in REGISTER_READS:
            return []
        first, count = (int.from_bytes(pdu[at : at + 2], "big") for at in (1, 3))
        return [
            member for member in self._members
            if (member.registers.unit, member.registers.function) == (unit, pdu[0])
            and first <= member.registers.address and member.registers.end <= first + count
        ]

    def _of_output(self, unit: int, pdu: bytes) -> bytes | None:
        """Answer of the analogue output; an exception if there is no output, None for no answer."""
        function, output = pdu[0], self.output
        if output is None or unit != DEVICE_ID:
            return _refused(function, ExcCodes.ILLEGAL_ADDRESS)
        if function not in SPACES:
            return _refused(function, ExcCodes.ILLEGAL_FUNCTION)
        faults = output.server.faults
        if faults.silent:
            return None
        space, address = SPACES[function], int.from_bytes(pdu[1:3], "big")
        answer = self._access(output, pdu, space, address)
        if answer is None:
            return _refused(function, ExcCodes.ILLEGAL_ADDRESS)
        return bytes([answer[0] ^ 1]) + answer[1:] if faults.wrong_function else answer

    @staticmethod
    def _access(output: SimulatedOutput, pdu: bytes, space: str, address: int) -> bytes | None:
        function, count = pdu[0], int.from_bytes(pdu[3:5], "big")
        if function in modbus.BIT_READS or function in REGISTER_READS:
            words = output.read(address, count, space)
            if words is None:
                return None
            if function in REGISTER_READS:
                content = b"".join(word.to_bytes(2, "big") for word in words)
            else:
                content = sum(bit << place for place, bit in enumerate(words)).to_bytes((count + 7) // 8, "little")
            return bytes([function, len(content)]) + content
        if function == modbus.WRITE_COIL:
            written = [int(pdu[3:5] == b"\xff\x00")]
        elif function == modbus.WRITE_REGISTER:
            written = [count]
        elif function == modbus.WRITE_COILS:
            written = [pdu[6 + place // 8] >> place % 8 & 1 for place in range(count)]
        else:
            written = [int.from_bytes(pdu[6 + 2 * place : 8 + 2 * place], "big") for place in range(count)]
        return None if output.write(address, written, space) is None else pdu[:5]

    def _tcp_requests(self, data: bytes) -> Iterable[tuple[int, int, bytes]]:
        self._frames.feed(data)
        while (frame := self._frames.next()) is not None:
            yield frame

    def _rtu_requests(self, data: bytes) -> Iterable[tuple[int, int, bytes]]:
        self._held += data
        while len(self._held) > 6:
            size = _FIXED_SIZE if self._held[1] <= modbus.WRITE_REGISTER else 9 + self._held[6]
            if len(self._held) < size:
                return
            frame, self._held = self._held[:size], self._held[size:]
            unit, pdu = modbus.decode_rtu(frame)
            yield 0, unit, pdu


@dataclass(eq=False)
class BoxPort:
    """Port of one sensor on the device; a `simulators.serial_port.SensorPort`.

    Attributes:
        box: the device.
        layout: format of the sensor.
        registers: of that format.
        requests: received requests without samples.
        frames: samples, each encoded as an answer to a request for only this sensor.
    """

    box: ModbusBox
    layout: BinaryFormat
    registers: Registers
    requests: list[tuple[int, bytes]] = field(default_factory=list)
    frames: deque[bytes] = field(default_factory=deque)

    @property
    def request(self) -> bytes:
        """Request that reads only this sensor."""
        return self.layout.exchange.request

    @property
    def sync(self) -> bytes:
        """First bytes of its frames."""
        return self.layout.sync

    @property
    def head(self) -> int:
        """Number of bytes before the registers."""
        return _RTU_HEAD if self.registers.rtu else _TCP_HEAD

    @property
    def waits(self) -> bool:
        """Whether the rig's clock waits until the host has read, so nothing is dropped."""
        return self.box.port.waits

    @waits.setter
    def waits(self, value: bool) -> None:
        self.box.port.waits = value

    @property
    def url(self) -> str:
        """URL that the host opens."""
        return self.box.port.url

    @property
    def dropped_frames(self) -> int:
        """Number of answers dropped because the host did not read them."""
        return self.box.port.dropped_frames

    @property
    def unheard_frames(self) -> int:
        """Number of answers dropped before a host read the first one."""
        return self.box.port.unheard_frames

    @property
    def sent_bytes(self) -> int:
        """Number of answer bytes accepted so far."""
        return self.box.port.sent_bytes

    @property
    def read_once(self) -> bool:
        """Whether a host has ever connected."""
        return self.box.port.read_once

    def write(self, data: bytes, frame_size: int) -> None:
        """Accept complete samples of `frame_size` bytes; damaged samples remain damaged."""
        if len(data) % frame_size:
            self.frames.append(data)
        else:
            self.frames += (data[at : at + frame_size] for at in range(0, len(data), frame_size))
        self.box.flush()

    def unread(self) -> int:
        """Number of bytes sent but not yet read by the host."""
        return self.box.port.unread()

    def listen(self) -> None:
        """Store requests from now on."""
        self.box.port.listen()

    def heard(self) -> list[tuple[int, bytes]]:
        """The requests since the last call, each with its monotonic arrival time (ns)."""
        self.box.hear()
        requests, self.requests = self.requests, []
        return requests

    def close(self) -> None:
        """Switch the device off and close the connection for all its sensors and its output."""
        self.box.port.close()


def _refused(function: int, code: ExcCodes) -> bytes:
    """An exception as the answer to a function."""
    return bytes([function | modbus.EXCEPTION_BIT, code])


def _overlap(one: Registers, other: Registers) -> bool:
    same = (one.unit, one.function) == (other.unit, other.function)
    return same and one.address < other.end and other.address < one.end

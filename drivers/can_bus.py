"""One CAN bus that the current source and sensors share: one bus object, each device with the frames that are its own.

A sensor's handle (`CanSensorPort`) is a port of bytes like `SerialPort`: a sensor on CAN is driven as any other is.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from drivers import clock
from drivers.can_port import CanPort
from drivers.connection import CanAddress
from drivers.errors import DriverError
from drivers.shared_connection import SharedConnection
from drivers.stamp_clock import StampClock
from protocols.can_frame import EXTENDED, CanFrame, decode_requests
from protocols.j1939 import from_address, source_address
from protocols.slcan import Frame

FRAMES_KEPT = 1 << 16
SHOWN = 4
"""So many addresses are named in a message."""
Hears = Callable[[int, bool], bool]
"""Whether a device hears the frames of an identifier, which is extended or not."""
NEVER_NS = (1 << 63) - 1


class CanBus:
    """A bus and the devices on it.

    Args:
        address: where it is.
        fd: CAN FD frames are among those that are sent or heard.
    """

    def __init__(self, address: CanAddress, *, fd: bool = False) -> None:
        self.port = CanPort(address, fd=fd, device=address.text)
        self.handles: list[BusHandle] = []
        self.connection: SharedConnection[tuple[list[Frame], int]] = SharedConnection(
            address.text, self.port.open, self.port.close, self.port.receive, self._take
        )

    def join(self, device: str, hears: Hears, *, rest: bool = False) -> BusHandle:
        """A device's part of the bus.

        Args:
            device: its name.
            hears: which frames are its own.
            rest: it is given the frames that belong to no other device, too.
        """
        handle = BusHandle(self, device, hears, rest=rest)
        self.handles.append(handle)
        self.connection.add(device)
        return handle

    def _take(self, got: tuple[list[Frame], int]) -> None:
        frames, arrival_ns = got
        stamps_ns = self.port.at_ns or [arrival_ns] * len(frames)
        for frame, at_ns in zip(frames, stamps_ns, strict=True):
            owners = [handle for handle in self.handles if handle.hears(frame[0], frame[2])]
            rest = [handle for handle in self.handles if handle.rest and not owners]
            for handle in owners or rest:
                handle.waiting.append((frame, at_ns))


class BusHandle:
    """What one device has of the bus; the same as a `CanPort` of its own.

    Attributes:
        at_ns: host time of each frame of the last `receive`.
        waiting: frames that it has not taken yet, each with its host time.
    """

    def __init__(self, bus: CanBus, device: str, hears: Hears, *, rest: bool) -> None:
        self.device = device
        self.hears, self.rest = hears, rest
        self.at_ns: list[int] = []
        self.waiting: deque[tuple[Frame, int]] = deque(maxlen=FRAMES_KEPT)
        self._bus = bus

    @property
    def bus_errors(self) -> int:
        """Error frames that the interface reported."""
        return self._bus.port.bus_errors

    @property
    def malformed(self) -> int:
        """What was received and is no frame."""
        return self._bus.port.malformed

    @property
    def stamps(self) -> StampClock:
        """Follows the interface's time stamps."""
        return self._bus.port.stamps

    @property
    def is_open(self) -> bool:
        """Whether the bus is open for this device."""
        return self._bus.connection.is_open_for(self.device)

    def open(self) -> None:
        """Join the bus.

        Raises:
            PortClosed: the interface or its channel cannot be opened.
            LinkLost: the adapter does not take its set-up.
        """
        self._bus.connection.open(self.device)
        self.waiting.clear()

    def close(self) -> None:
        """Leave the bus; closing twice is harmless."""
        self._bus.connection.close(self.device)

    def receive(self, timeout_s: float) -> tuple[list[Frame], int]:
        """Frames of this device that have arrived, waiting up to `timeout_s` (s) for the first one.

        Raises:
            PortClosed: the bus is not open or has gone.
        """
        self._bus.connection.wait(lambda: bool(self.waiting), timeout_s, self.device, lambda: NEVER_NS)
        frames: list[Frame] = []
        self.at_ns = []
        while self.waiting:
            frame, at_ns = self.waiting.popleft()
            frames.append(frame)
            self.at_ns.append(at_ns)
        return frames, clock.monotonic_ns()

    def send(
        self, identifier: int, data: bytes, *, extended: bool = False, fd: bool = False, remote: bool = False
    ) -> None:
        """Hand one frame to the interface.

        Raises:
            PortClosed: the bus is not open.
            LinkLost: the interface does not take it.
        """
        try:
            self._bus.port.send(identifier, data, extended=extended, fd=fd, remote=remote)
        except DriverError as error:
            raise type(error)(self.device, error.port, error.message, error.fix) from error


class CanSensorPort:
    """A sensor's message as a port of bytes: rows of `protocols.can_frame`.

    Args:
        bus: where the sensor is.
        device: its name.
        frame: its message.

    Attributes:
        moved: a bus has no name that could lead elsewhere.
    """

    moved = False

    def __init__(self, bus: CanBus, device: str, frame: CanFrame) -> None:
        self.url = bus.connection.name
        self._frame = frame
        self._handle = bus.join(device, self._hears)
        self._address = frame.source_address
        self._others: set[int] = set()
        self._sizes: set[int] = set()
        self._heard = 0

    @property
    def is_open(self) -> bool:
        """Whether the bus is open for this sensor."""
        return self._handle.is_open

    @property
    def refusal(self) -> tuple[str, str]:
        """Slug and words of why the frames cannot be this sensor's; two empty texts while nothing speaks against."""
        frame, others = self._frame, sorted(self._others)
        shown = ", ".join(f"0x{one:02X}" for one in others[:SHOWN])
        group = f"J1939 parameter group 0x{frame.group or 0:05X} ({frame.group or 0})"
        if others and not self._heard:
            stated = source_address(frame.identifier) if frame.source_address is None else frame.source_address
            return "no-answer", (
                f"{group}: received from source address {shown}, expected 0x{stated:02X}. Fix: write source_address = "
                f"0x{others[0]:02X} in the sensor's format"
            )
        if others and frame.by_group and frame.source_address is None and self._address is not None:
            return "can-foreign", (
                f"several nodes send the {group} (source addresses 0x{self._address:02X}, {shown}). Fix: write the "
                f"sensor's address in its format, such as source_address = 0x{self._address:02X}"
            )
        if self._sizes and not self._heard:
            sizes = ", ".join(map(str, sorted(self._sizes)))
            return "serial-baud", (
                f"frames of CAN message {frame.shown} have {sizes} data bytes, expected {frame.size}. Fix: "
                "check the DBC file or the length in the sensor's format"
            )
        return "", ""

    def open(self) -> None:
        """Join the bus.

        Raises:
            PortClosed: the interface or its channel cannot be opened.
            LinkLost: the adapter does not take its set-up.
        """
        self._handle.open()

    def close(self) -> None:
        """Leave the bus; closing twice is harmless."""
        self._handle.close()

    def discard_input(self, limit_s: float = 0.1) -> int:
        """Discard the frames that have arrived; number of bytes.

        Raises:
            PortClosed: the bus is not open or has gone.
        """
        del limit_s
        data, _ = self.read_available(0.0)
        return len(data)

    def read_available(self, timeout_s: float) -> tuple[bytes, int]:
        """The frames that have arrived as rows, and the monotonic time at which they were there (ns).

        Raises:
            PortClosed: the bus is not open or has gone.
        """
        frames, arrival_ns = self._handle.receive(timeout_s)
        rows = [row for frame in frames if (row := self._row(frame))]
        if rows:
            arrival_ns = min(arrival_ns, self._handle.at_ns[-1])
        return b"".join(rows), arrival_ns

    def write(self, data: bytes, timeout_s: float = 0.1) -> None:
        """Send requests.

        Raises:
            PortClosed: the bus is not open.
            LinkLost: the interface does not take a frame.
        """
        del timeout_s
        for key, content, remote in decode_requests(data):
            if self._frame.source_address is None and self._address is not None and remote and self._frame.by_group:
                key = from_address(key, self._address)
            self._handle.send(key & ~EXTENDED, content, extended=bool(key & EXTENDED), remote=remote)

    def _hears(self, identifier: int, extended: bool) -> bool:
        frame = self._frame
        own = frame.is_own(identifier, extended=extended)
        return own or frame.is_from_elsewhere(identifier, extended=extended)

    def _row(self, received: Frame) -> bytes:
        """A frame as the decoder takes it; empty for one that is another node's."""
        identifier, data, extended, remote, _ = received
        frame = self._frame
        if not frame.is_own(identifier, extended=extended):
            self._others.add(source_address(identifier))
            return b""
        if frame.by_group:
            address = source_address(identifier)
            if self._address is None:
                self._address = address
            if address != self._address:
                self._others.add(address)
                return b""
        if remote:
            return b""  # a request, perhaps another host's
        self._sizes.add(len(data))
        self._heard += len(data) == frame.size
        return frame.row(data)

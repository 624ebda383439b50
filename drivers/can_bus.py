"""One CAN bus shared by the current source and sensors: one bus object distributes the frames to the devices.

A sensor's handle (`CanSensorPort`) is a byte port like `SerialPort`, so a sensor on CAN uses the same driver as any
other sensor.
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
from protocols.j1939 import source_address
from protocols.slcan import Frame

FRAMES_KEPT = 1 << 16
SHOWN = 4
"""Maximum number of addresses listed in a message."""
Hears = Callable[[int, bool], bool]
"""Whether a device receives frames with an identifier (standard or extended)."""
NEVER_NS = (1 << 63) - 1


class CanBus:
    """A CAN bus and its devices.

    Args:
        address: of the bus.
    """

    def __init__(self, address: CanAddress) -> None:
        self.port = CanPort(address, device=address.text)
        self.handles: list[BusHandle] = []
        self.connection: SharedConnection[tuple[list[Frame], int]] = SharedConnection(
            address.text, self.port.open, self.port.close, self.port.receive, self._take
        )

    def join(self, device: str, hears: Hears, *, rest: bool = False, fd: bool = False) -> BusHandle:
        """Add a device and return its handle; all devices join before the bus is opened.

        Args:
            device: its name.
            hears: selects the frames of this device.
            rest: whether it also receives the frames that no other device selects.
            fd: whether it sends or receives CAN FD frames.
        """
        self.port.fd = self.port.fd or fd
        handle = BusHandle(self, device, hears, rest=rest)
        self.handles.append(handle)
        self.connection.add(device)
        return handle

    def _take(self, got: tuple[list[Frame], int]) -> None:
        frames, arrival_ns = got
        stamps_ns = self.port.at_ns or [arrival_ns] * len(frames)
        for frame, at_ns in zip(frames, stamps_ns, strict=True):
            owners = [handle for handle in self.handles if handle.hears(frame[0], frame[2])]
            for handle in owners or [one for one in self.handles if one.rest]:
                handle.waiting.append((frame, at_ns))


class BusHandle:
    """A device's access to the bus, with the interface of a `CanPort`.

    Attributes:
        at_ns: host time of each frame of the last `receive`.
        waiting: frames that the device has not fetched yet, each with its host time.
    """

    def __init__(self, bus: CanBus, device: str, hears: Hears, *, rest: bool) -> None:
        self.device = device
        self.hears, self.rest = hears, rest
        self.at_ns: list[int] = []
        self.waiting: deque[tuple[Frame, int]] = deque(maxlen=FRAMES_KEPT)
        self._bus = bus

    @property
    def bus_errors(self) -> int:
        """Number of error frames that the interface reported."""
        return self._bus.port.bus_errors

    @property
    def malformed(self) -> int:
        """Number of received items that are not frames."""
        return self._bus.port.malformed

    @property
    def stamps(self) -> StampClock:
        """Converter for the time stamps of the interface."""
        return self._bus.port.stamps

    @property
    def is_open(self) -> bool:
        """Whether the bus is open for this device."""
        return self._bus.connection.is_open_for(self.device)

    def open(self) -> None:
        """Open the bus, or use it if another device has opened it.

        Raises:
            PortClosed: the interface or its channel cannot be opened.
            LinkLost: the adapter rejects its configuration.
        """
        self._bus.connection.open(self.device)
        self.waiting.clear()

    def close(self) -> None:
        """Release the bus; repeated calls have no effect."""
        self._bus.connection.close(self.device)

    def receive(self, timeout_s: float) -> tuple[list[Frame], int]:
        """Frames of this device that have arrived, waiting up to `timeout_s` (s) for the first one.

        Raises:
            PortClosed: the bus is not open or was lost.
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
        """Pass one frame to the interface.

        Raises:
            PortClosed: the bus is not open.
            LinkLost: the interface does not accept it.
        """
        try:
            self._bus.port.send(identifier, data, extended=extended, fd=fd, remote=remote)
        except DriverError as error:
            raise type(error)(self.device, error.port, error.message, error.fix) from error


class CanSensorPort:
    """A sensor's CAN message as a byte port: rows as defined in `protocols.can_frame`.

    Args:
        bus: of the sensor.
        device: its name.
        frame: the sensor's message.

    Attributes:
        moved: always False; the name of a bus cannot point to another device.
    """

    moved = False

    def __init__(self, bus: CanBus, device: str, frame: CanFrame) -> None:
        self.url = bus.connection.name
        self._frame = frame
        self._handle = bus.join(device, self._hears, fd=frame.fd)
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
        """Code and reason why the frames cannot come from this sensor; two empty strings if they may."""
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
        """Open the bus, or use it if another device has opened it.

        Raises:
            PortClosed: the interface or its channel cannot be opened.
            LinkLost: the adapter rejects its configuration.
        """
        self._handle.open()

    def close(self) -> None:
        """Release the bus; repeated calls have no effect."""
        self._handle.close()

    def discard_input(self, limit_s: float = 0.1) -> int:
        """Discard the frames that have arrived, and return their number of bytes.

        Raises:
            PortClosed: the bus is not open or was lost.
        """
        del limit_s
        data, _ = self.read_available(0.0)
        return len(data)

    def read_available(self, timeout_s: float) -> tuple[bytes, int]:
        """The frames that have arrived, as rows, and the monotonic time of their arrival (ns).

        Raises:
            PortClosed: the bus is not open or was lost.
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
            LinkLost: the interface does not accept a frame.
        """
        del timeout_s
        for key, content, remote in decode_requests(data):
            self._handle.send(key & ~EXTENDED, content, extended=bool(key & EXTENDED), remote=remote)

    def _hears(self, identifier: int, extended: bool) -> bool:
        frame = self._frame
        own = frame.is_own(identifier, extended=extended)
        return own or frame.is_from_elsewhere(identifier, extended=extended)

    def _row(self, received: Frame) -> bytes:
        """A frame as a row for the decoder; empty for a frame from another node."""
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
            return b""  # a request, possibly from another host
        self._sizes.add(len(data))
        self._heard += len(data) == frame.size
        return frame.row(data)

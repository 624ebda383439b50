"""CAN ports: the project's own block reader for slcan, python-can for every other interface.

python-can reads slcan one byte at a time (half a core on a full bus) and waits 2 s after opening; `SlcanPort` reads
blocks. Both give frames in batches, stamped by the monotonic clock when they were there.
"""

from __future__ import annotations

import contextlib
import sys
import time
from typing import TYPE_CHECKING, Any, Protocol

from drivers.errors import LinkLost, PortClosed
from drivers.serial_port import SerialPort
from protocols import slcan
from protocols.slcan import Frame, SlcanDecoder

if TYPE_CHECKING:
    import types

LARGEST_BATCH = 1000


class CanPort(Protocol):
    """What the ECU driver needs of a CAN interface."""

    @property
    def malformed(self) -> int:
        """What came in and was no frame."""

    @property
    def bus_errors(self) -> int:
        """Errors the interface reported."""

    def open(self) -> None:
        """Join the bus."""

    def close(self) -> None:
        """Leave the bus; closing twice is harmless."""

    def receive(self, timeout_s: float) -> tuple[list[Frame], int]:
        """Frames that have arrived, waiting for the first; and when (monotonic ns)."""

    def send(self, identifier: int, data: bytes) -> None:
        """Hand one standard frame to the interface."""


class SlcanPort:
    """A serial CAN adapter (Lawicel protocol) on a tty or `socket://`.

    Args:
        channel: URL of the serial port.
        bitrate: CAN bit rate, bit/s.
        tty_baudrate: Bd of the serial port; ignored by sockets and USB adapters.
        device: name of the device for messages.

    Raises:
        LocalProtocolError: slcan has no code for the bit rate.
    """

    def __init__(self, channel: str, bitrate: int, *, tty_baudrate: int = 921_600, device: str = "ecu") -> None:
        self._setup = slcan.CLOSE + slcan.encode_bitrate(bitrate) + slcan.OPEN
        self._port = SerialPort(channel, tty_baudrate, device=device)
        self._decoder = SlcanDecoder()

    @property
    def malformed(self) -> int:
        """Lines that were neither frame nor answer."""
        return self._decoder.malformed

    @property
    def bus_errors(self) -> int:
        """Errors the adapter reported (BEL); a bus-off shows only as silence."""
        return self._decoder.errors

    def open(self) -> None:
        """Open the port, set the bit rate and join the bus.

        Raises:
            PortClosed: the port cannot be opened.
            LinkLost: it does not take the commands.
        """
        self._port.open()
        self._decoder.clear()
        self._port.write(self._setup)

    def close(self) -> None:
        """Leave the bus as far as the adapter still listens; closing twice is harmless."""
        if self._port.is_open:
            try:
                self._port.write(slcan.CLOSE)
            except (PortClosed, LinkLost):
                # The adapter may be what went away; it leaves the bus when its host does.
                self._decoder.clear()
        self._port.close()

    def receive(self, timeout_s: float) -> tuple[list[Frame], int]:
        """Frames that have arrived.

        Args:
            timeout_s: longest wait for the first byte, s.

        Raises:
            PortClosed: the port is not open or has gone.
        """
        chunk, arrival_ns = self._port.read_available(timeout_s)
        return (self._decoder.feed(chunk) if chunk else []), arrival_ns

    def send(self, identifier: int, data: bytes) -> None:
        """Hand one standard frame to the adapter.

        Raises:
            PortClosed: the port is not open or has gone.
            LinkLost: the adapter takes no more bytes.
        """
        self._port.write(slcan.encode_frame(identifier, data), timeout_s=0.02)


class LibraryPort:
    """Any other interface of python-can: socketcan, pcan, kvaser, vector, virtual, socketcand ...

    Args:
        interface: name as python-can has it.
        channel: what that interface calls the bus.
        bitrate: bit/s.
        device: name of the device for messages.
    """

    def __init__(self, interface: str, channel: str, bitrate: int, *, device: str = "ecu") -> None:
        self.malformed = 0
        self.bus_errors = 0
        self.device = device
        self._interface = interface
        self._channel = channel
        self._bitrate = bitrate
        self._can: types.ModuleType | None = None
        self._bus: Any = None

    def open(self) -> None:
        """Join the bus.

        Raises:
            PortClosed: unknown interface, missing driver, no such channel.
        """
        can = self._can = import_can()
        try:
            self._bus = can.Bus(interface=self._interface, channel=self._channel, bitrate=self._bitrate)
        except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError) as error:
            raise PortClosed(self.device, self._name, f"cannot open: {error}") from error

    def close(self) -> None:
        """Leave the bus; closing twice is harmless."""
        bus, self._bus = self._bus, None
        if bus is None or self._can is None:
            return
        # After an unplug there is nothing left to shut down.
        with contextlib.suppress(self._can.CanError, OSError):
            bus.shutdown()

    def receive(self, timeout_s: float) -> tuple[list[Frame], int]:
        """Frames that have arrived.

        Args:
            timeout_s: longest wait for the first frame, s.

        Raises:
            PortClosed: the bus is not open or has gone.
        """
        frames: list[Frame] = []
        message = self._receive_one(timeout_s)
        arrival_ns = time.monotonic_ns()
        while message is not None:
            if message.is_error_frame:
                self.bus_errors += 1
            else:
                frames.append((
                    message.arbitration_id, bytes(message.data), message.is_extended_id, message.is_remote_frame,
                    message.dlc,
                ))
            if len(frames) >= LARGEST_BATCH:
                break
            message = self._receive_one(0.0)
        return frames, arrival_ns

    def send(self, identifier: int, data: bytes) -> None:
        """Hand one standard frame to the interface.

        Raises:
            PortClosed: the bus is not open.
            LinkLost: the interface does not take it.
        """
        if self._bus is None or self._can is None:
            raise PortClosed(self.device, self._name, "the bus is not open")
        try:
            self._bus.send(self._can.Message(arbitration_id=identifier, data=data, is_extended_id=False), timeout=0.02)
        except (self._can.CanError, OSError, ValueError) as error:
            raise LinkLost(self.device, self._name, f"frame 0x{identifier:03X} not taken: {error}") from error

    @property
    def _name(self) -> str:
        return f"{self._interface}:{self._channel}"

    def _receive_one(self, timeout_s: float) -> Any:  # noqa: ANN401 - python-can's Message, imported only when needed
        """Next message or None.

        Raises:
            PortClosed: the bus is not open or has gone.
        """
        if self._bus is None or self._can is None:
            raise PortClosed(self.device, self._name, "the bus is not open")
        try:
            return self._bus.recv(timeout_s)
        except (self._can.CanError, OSError, ValueError) as error:
            raise PortClosed(self.device, self._name, f"the bus is gone: {error}") from error


def import_can() -> types.ModuleType:
    """python-can without its MF4 log reader, which would load numpy and pandas into the process that owns the ports."""
    absent = "asammdf" not in sys.modules
    if absent:
        sys.modules["asammdf"] = None  # type: ignore[assignment]  # None makes the import fail, as python-can expects
    try:
        import can
    finally:
        if absent:
            del sys.modules["asammdf"]
    return can


def can_port(interface: str, channel: str, bitrate: int, *, device: str = "ecu") -> CanPort:
    """The port for an interface name of the bench file.

    Args:
        interface: "slcan" for the project's own reader, else a python-can interface.
        channel: what that interface calls the bus; a serial URL for slcan.
        bitrate: bit/s.
        device: name of the device for messages.

    Raises:
        LocalProtocolError: slcan has no code for the bit rate.
    """
    if interface == "slcan":
        return SlcanPort(channel, bitrate, device=device)
    return LibraryPort(interface, channel, bitrate, device=device)

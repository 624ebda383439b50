"""The CAN port: a bus of python-can, whatever the interface; frames in batches, stamped by the monotonic clock."""

from __future__ import annotations

import contextlib
from collections import deque
from typing import TYPE_CHECKING, Any

from drivers import clock
from drivers.can_library import import_can
from drivers.connection import CanAddress
from drivers.errors import LinkLost, PortClosed
from drivers.port_causes import is_down, reason
from drivers.stamp_clock import StampClock
from protocols.slcan import Frame

if TYPE_CHECKING:
    import types

LARGEST_BATCH = 1000


SLCAN = "slcan"
SOCKETCAN = "socketcan"
ECHOING = frozenset({"udp_multicast"})
"""Interfaces of python-can that also deliver the frames that this host has sent."""
_ECHOES_KEPT = 256


class CanPort:
    """Any interface of python-can: socketcan, pcan, kvaser, vector, virtual, socketcand ...; slcan with our own reader.

    Args:
        address: where the bus is.
        fd: CAN FD frames are among those that are sent or heard.
        device: name of the device for messages.

    Attributes:
        fd: CAN FD frames are among those that are sent or heard; has effect from the next `open` on.
        bus_errors: error frames the interface reported.
        at_ns: host time of each frame of the last `receive`, by the interface's time stamps as far as these are used;
            empty where the interface gives none.
        stamps: follows them.
    """

    def __init__(self, address: CanAddress, *, fd: bool = False, device: str = "ecu") -> None:
        self.bus_errors = 0
        self.at_ns: list[int] = []
        self.stamps = StampClock()
        self.device = device
        self._address = address
        self.fd = fd
        self._switched = "data_bitrate" in address.options
        self._interface = address.interface
        self._channel = address.channel
        self._can: types.ModuleType | None = None
        self._bus: Any = None
        self._echoes: deque[tuple[int, bytes]] = deque(maxlen=_ECHOES_KEPT)

    @property
    def malformed(self) -> int:
        """What came in and was no frame; 0 for interfaces that never show such a thing."""
        return int(getattr(self._bus, "malformed", 0))

    def open(self) -> None:
        """Join the bus.

        Raises:
            PortClosed: unknown interface, missing driver, no such channel, or the interface is down.
        """
        if self._interface == SOCKETCAN and is_down(self._channel):
            rate = f" type can bitrate {self._address.bitrate}" * (not self._channel.startswith("vcan"))
            fix = f"sudo ip link set {self._channel} up{rate}"
            raise PortClosed(self.device, self._name, f"the CAN interface {self._channel} is down", fix)
        can = self._can = import_can()
        try:
            if self._interface == SLCAN:
                # loads python-can and pyserial: only when needed
                from drivers.slcan_bus import BlockSlcanBus

                self._bus = BlockSlcanBus(
                    self._channel, self._address.bitrate, device=self.device, **self._address.options
                )
            else:
                options = {"fd": True, **self._address.options} if self.fd else dict(self._address.options)
                self._bus = can.Bus(
                    interface=self._interface, channel=self._channel, bitrate=self._address.bitrate, **options
                )
        except (can.CanError, OSError, ValueError, TypeError, ImportError, NotImplementedError, NameError) as error:
            # NameError: python-can's Kvaser interface without its library.
            raise PortClosed(self.device, self._name, f"cannot be opened: {reason(error)}") from error

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
            PortClosed: the bus is not open or was lost.
        """
        clock.back_within(timeout_s)
        if self._interface == SLCAN:
            return self._receive_block(timeout_s)
        frames: list[Frame] = []
        self.at_ns = []
        message = self._receive_one(timeout_s)
        read_ns = arrival_ns = clock.monotonic_ns()
        while message is not None:
            if message.is_error_frame:
                self.bus_errors += 1
            elif not self._is_echo(message.arbitration_id, bytes(message.data)):
                frames.append((
                    message.arbitration_id, bytes(message.data), message.is_extended_id, message.is_remote_frame,
                    message.dlc,
                ))
                self.at_ns.append(self.stamps.host_ns(int(1e9 * message.timestamp), read_ns))
            if len(frames) >= LARGEST_BATCH:
                break
            message = self._receive_one(0.0)
            read_ns = clock.monotonic_ns()
        return frames, arrival_ns

    def send(
        self, identifier: int, data: bytes, *, extended: bool = False, fd: bool = False, remote: bool = False
    ) -> None:
        """Pass one frame to the interface; for a remote frame, only the length of the data is used.

        Raises:
            PortClosed: the bus is not open.
            LinkLost: the interface does not accept it.
        """
        if self._bus is None or self._can is None:
            raise PortClosed(self.device, self._name, "the bus is not open")
        try:
            content = {"dlc": len(data)} if remote else {"data": data}
            message = self._can.Message(
                arbitration_id=identifier, is_extended_id=extended, is_fd=fd, is_remote_frame=remote,
                bitrate_switch=fd and self._switched, **content,
            )
            if self._interface in ECHOING:
                self._echoes.append((identifier, bytes(data)))
            self._bus.send(message, timeout=0.02)
        except (self._can.CanError, OSError, ValueError) as error:
            raise LinkLost(self.device, self._name, f"frame 0x{identifier:03X} not sent: {error}") from error

    def _is_echo(self, identifier: int, data: bytes) -> bool:
        """Whether a frame is one that this host has sent; each is delivered once."""
        if not self._echoes:
            return False
        with contextlib.suppress(ValueError):
            self._echoes.remove((identifier, data))
            return True
        return False

    @property
    def _name(self) -> str:
        return self._address.text

    def _receive_block(self, timeout_s: float) -> tuple[list[Frame], int]:
        """What our own slcan reader has, without a message of python-can for each frame.

        Raises:
            PortClosed: the bus is not open or was lost.
        """
        if self._bus is None or self._can is None:
            raise PortClosed(self.device, self._name, "the bus is not open")
        try:
            frames, errors = self._bus.take(timeout_s)
        except self._can.CanError as error:
            raise PortClosed(self.device, self._name, f"the bus connection was lost: {error}") from error
        self.bus_errors += errors
        return frames, clock.monotonic_ns()

    def _receive_one(self, timeout_s: float) -> Any:  # noqa: ANN401 - python-can's Message, imported only when needed
        """Next message or None.

        Raises:
            PortClosed: the bus is not open or was lost.
        """
        if self._bus is None or self._can is None:
            raise PortClosed(self.device, self._name, "the bus is not open")
        try:
            return self._bus.recv(timeout_s)
        except (self._can.CanError, OSError, ValueError) as error:
            raise PortClosed(self.device, self._name, f"the bus connection was lost: {error}") from error

"""CAN side of a simulated sensor: sends its rows of bytes as frames, and receives requests for readings."""

from __future__ import annotations

from protocols.binary_format import BinaryFormat
from protocols.can_frame import CanFrame, decode_requests
from protocols.j1939 import from_address
from rig.clock import monotonic_ns
from simulators.slcan_bus import SlcanBus, frame_line

SIMULATED_ADDRESS = 0x90
"""J1939 source address of a sensor whose format does not specify one."""


class CanSensorPort:
    """Port of one sensor; a `simulators.serial_port.SensorPort`.

    Args:
        bus: the bus, which other devices may share.
        layout: the sensor's format.
        message: CAN message of the sensor.

    Attributes:
        waits: has no effect; frames wait in the sockets of the bus's clients.
    """

    def __init__(self, bus: SlcanBus, layout: BinaryFormat, message: CanFrame) -> None:
        self.waits = False
        self.dropped_frames = self.unheard_frames = self.sent_bytes = 0
        self._bus = bus
        self._request = layout.exchange.request
        self._asked = next(decode_requests(self._request), None)
        address = SIMULATED_ADDRESS if message.source_address is None else message.source_address
        self._key = from_address(message.key, address) if message.by_group else message.key
        self._heard: list[tuple[int, bytes]] = []
        self._closed = self._read_once = False

    @property
    def url(self) -> str:
        """Address of the bus."""
        return f"socket://127.0.0.1:{self._bus.port}"

    def write(self, data: bytes, frame_size: int) -> None:
        """Send rows of `frame_size` bytes (`protocols.can_frame`), each as one frame."""
        if self._closed:
            return
        rows = [data[at : at + frame_size] for at in range(0, len(data), frame_size)]
        self._bus.send_lines([frame_line(self._key, row[1 : 1 + row[0]]) for row in rows])
        self.sent_bytes += len(data)

    def unread(self) -> int:
        """Always 0: nothing waits here."""
        return 0

    @property
    def read_once(self) -> bool:
        """Whether a client receives frames from the bus."""
        self._read_once = self._read_once or any(client.listening for client in self._bus.clients)
        return self._read_once

    def listen(self) -> None:
        """Store requests from now on."""
        self._bus.listeners.append(self._hear)

    def heard(self) -> list[tuple[int, bytes]]:
        """The requests since the last call, each with its monotonic arrival time (ns)."""
        heard, self._heard = self._heard, []
        return heard

    def close(self) -> None:
        """Switch the sensor off; the bus remains open."""
        self._closed = True

    def _hear(self, identifier: int, data: bytes, remote: bool) -> None:
        if self._asked is None:
            return
        key, content, is_remote = self._asked
        if (identifier, remote) == (key, is_remote) and (remote or data == content):
            self._heard.append((monotonic_ns(), self._request))


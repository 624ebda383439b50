"""The sensor's end of a serial line: a pty, or a TCP socket that `socket://` opens.

Either holds at most 4 KiB that the host has not read; then whole frames are dropped and counted. While the rig's clock
waits for the host (`waits`), what does not fit is kept instead. Nothing here blocks.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import socket
import struct
import termios
import tty
from collections.abc import Callable
from typing import Protocol

from rig.clock import monotonic_ns
from simulators.peer_queue import PeerQueue

CAPACITY = 4096
_PTY_CAPACITY = 4095
"""The line discipline keeps one byte of its 4 KiB to itself."""
ARRIVED_NS = 100_000_000
"""The line discipline takes bytes over on a thread of its own, on a busy machine some time later."""
_READ_SIZE = 4096
_SMALLEST_SEND_BUFFER = 1


class SensorPort(Protocol):
    """Where a sensor's bytes go.

    Attributes:
        waits: nothing is dropped: the rig's clock stands until the host has read.
    """

    waits: bool

    @property
    def url(self) -> str:
        """What the host opens."""

    @property
    def dropped_frames(self) -> int:
        """Whole frames dropped because the host had not read."""

    @property
    def unheard_frames(self) -> int:
        """Whole frames dropped before any host read from the port."""

    @property
    def sent_bytes(self) -> int:
        """Bytes accepted so far."""

    def write(self, data: bytes, frame_size: int) -> None:
        """Send whole frames of `frame_size` bytes as far as there is room; drop and count the rest."""

    def unread(self) -> int:
        """Bytes sent and not yet read by the host."""

    @property
    def read_once(self) -> bool:
        """Whether the host has ever read from this port."""

    def listen(self) -> None:
        """Keep what the host sends from now on; until then it is thrown away."""

    def heard(self) -> list[tuple[int, bytes]]:
        """What the host has sent since the last call, each part with the monotonic time (ns) it came at."""

    def close(self) -> None:
        """Hang up."""


SPEEDS = {int(name[1:]): getattr(termios, name) for name in dir(termios) if name[0] == "B" and name[1:].isdigit()}
"""The system's code of a baud rate, by the rate (Bd)."""
UNSET = termios.B38400
"""The rate of a pty before one is chosen."""
GARBLING = bytes((37 * place + 11) % 256 for place in range(256))


class PtyPort:
    """A pseudo-terminal in raw mode. The slave stays open here, so the host may come and go.

    A pty carries bytes at any rate. As on a real line, a host that has chosen another rate than the device's gets
    other bytes.

    Args:
        baudrate: at which the device sends (Bd); 0: whatever the host has chosen.

    Raises:
        OSError: this machine has no ptys left (or none at all).
    """

    def __init__(self, baudrate: int = 0) -> None:
        self._speed = SPEEDS.get(baudrate, UNSET) if baudrate else UNSET  # B0 hangs up
        self._chosen = False
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.url = os.ttyname(self._slave)
        self.dropped_frames = self.unheard_frames = 0
        self.sent_bytes = 0
        self.waits = False
        self._held = bytearray()
        self._heard: list[tuple[int, bytes]] | None = None
        self._complete_ns = monotonic_ns()
        self._waiting = 0
        self._read_once = False
        self._closed = False

    def write(self, data: bytes, frame_size: int) -> None:
        """Send whole frames as far as there is room; drop and count the rest."""
        if self._closed:
            return
        room = len(data) if self.waits else max(0, _PTY_CAPACITY - self.unread())
        take = data if len(data) <= room else data[: room // frame_size * frame_size]
        self._held += take if self._heard_right() else bytes(map(GARBLING.__getitem__, take))
        self.sent_bytes += len(take)
        dropped = -(-(len(data) - len(take)) // frame_size)
        self.dropped_frames += dropped if self._read_once else 0
        self.unheard_frames += 0 if self._read_once else dropped
        self._pass_on()
        self._discard_input()

    def _heard_right(self) -> bool:
        """The host listens at the device's rate, or one of the two has none."""
        if self._speed == UNSET:
            return True
        speed = termios.tcgetattr(self._master)[5]
        self._chosen = self._chosen or speed != UNSET
        return not self._chosen or speed == self._speed

    def unread(self) -> int:
        """Bytes sent and not yet read by the host."""
        if self._closed:
            return 0
        self._pass_on()
        on_the_line = self._on_the_line()
        if not self._read_once:
            self._look_for_a_reader(on_the_line, on_the_line + len(self._held) < self.sent_bytes)
        return on_the_line + len(self._held)

    def _look_for_a_reader(self, on_the_line: int, missing: bool) -> None:
        """A client reads where bytes go from the line, or where some are missing that had time to arrive there."""
        now_ns = monotonic_ns()
        if not missing:
            self._complete_ns = now_ns
        self._read_once = on_the_line < self._waiting or now_ns - self._complete_ns > ARRIVED_NS
        self._waiting = on_the_line

    def _on_the_line(self) -> int:
        """Bytes that the host could read now."""
        count: int = struct.unpack("i", fcntl.ioctl(self._slave, termios.FIONREAD, b"\0\0\0\0"))[0]
        return count

    def _pass_on(self) -> None:
        """Put on the line what waits here, as far as there is room."""
        room = _PTY_CAPACITY - self._on_the_line() if self._held else 0
        if room > 0:
            try:
                del self._held[: os.write(self._master, self._held[:room])]
            except BlockingIOError:
                return

    @property
    def read_once(self) -> bool:
        """Whether the host has ever read from this port."""
        return self._read_once

    def close(self) -> None:
        """Hang up: the host's next read ends or fails, as when a cable is pulled."""
        if not self._closed:
            self._closed = True
            if self._heard is not None:
                asyncio.get_running_loop().remove_reader(self._master)
            os.close(self._master)
            os.close(self._slave)

    def listen(self) -> None:
        """Keep what the host sends from now on; until then it is thrown away."""
        self._heard = []
        asyncio.get_running_loop().add_reader(self._master, self._discard_input)

    def heard(self) -> list[tuple[int, bytes]]:
        """What the host has sent since the last call, each part with the monotonic time (ns) it came at."""
        parts, self._heard = self._heard or [], None if self._heard is None else []
        return parts

    def _discard_input(self) -> None:
        """Read what the host sent; sensors that stream take no commands."""
        try:
            while data := os.read(self._master, _READ_SIZE):
                if self._heard is not None:
                    self._heard.append((monotonic_ns(), data))
        except BlockingIOError:
            return


class SocketPort:
    """A listening TCP socket for one host at a time, with 4 KiB of its own in front of a minimal send buffer.

    Attributes:
        on_heard: called when stored data have arrived.
    """

    def __init__(self) -> None:
        self.on_heard: Callable[[], None] = lambda: None
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SMALLEST_SEND_BUFFER)
        self._listener.bind(("127.0.0.1", 0))
        self._listener.listen(1)
        self._listener.setblocking(False)
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
        self.dropped_frames = self.unheard_frames = 0
        self.sent_bytes = 0
        self.waits = False
        self._held = bytearray()
        self._heard: list[tuple[int, bytes]] | None = None
        self._queue = PeerQueue()
        self._peer: socket.socket | None = None
        self._read_once = False
        asyncio.get_running_loop().add_reader(self._listener.fileno(), self._accept)

    def write(self, data: bytes, frame_size: int) -> None:
        """Hold whole frames as far as there is room and pass on what the socket takes; drop and count the rest."""
        if self._listener.fileno() < 0:
            return
        self._pass_on()
        room = len(data) if self.waits else max(0, CAPACITY - len(self._held))
        take = data if len(data) <= room else data[: room // frame_size * frame_size]
        self._held += take
        self.sent_bytes += len(take)
        dropped = -(-(len(data) - len(take)) // frame_size)
        self.dropped_frames += dropped if self._read_once else 0
        self.unheard_frames += 0 if self._read_once else dropped
        self._pass_on()

    def unread(self) -> int:
        """Bytes that wait here and in the host's socket."""
        self._pass_on()
        return len(self._held) + (self._queue.unread(self._peer) if self._peer is not None else 0)

    @property
    def read_once(self) -> bool:
        """Whether a host has ever connected."""
        return self._read_once

    def listen(self) -> None:
        """Keep what the host sends from now on; until then it is thrown away."""
        self._heard = []

    def heard(self) -> list[tuple[int, bytes]]:
        """What the host has sent since the last call, each part with the monotonic time (ns) it came at."""
        parts, self._heard = self._heard or [], None if self._heard is None else []
        return parts

    def close(self) -> None:
        """Hang up and stop listening."""
        if self._listener.fileno() >= 0:
            self._hang_up()
            asyncio.get_running_loop().remove_reader(self._listener.fileno())
            self._listener.close()
            self._queue.close()

    def _accept(self) -> None:
        peer, _ = self._listener.accept()
        if self._peer is not None:
            peer.close()
            return
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._peer = peer
        self._read_once = True
        asyncio.get_running_loop().add_reader(peer.fileno(), self._discard_input)

    def _discard_input(self) -> None:
        """Read what the host sent, and discard it without a listener; an empty read means it hung up."""
        if self._peer is None:
            return
        try:
            data = self._peer.recv(_READ_SIZE)
            gone = not data
            if data and self._heard is not None:
                self._heard.append((monotonic_ns(), data))
                self.on_heard()
        except BlockingIOError:
            return
        except OSError:
            gone = True
        if gone:
            self._hang_up()

    def _pass_on(self) -> None:
        if self._peer is None or not self._held:
            return
        try:
            sent = self._peer.send(self._held)
        except BlockingIOError:
            return
        except OSError:
            self._hang_up()
            return
        del self._held[:sent]

    def _hang_up(self) -> None:
        if self._peer is not None:
            asyncio.get_running_loop().remove_reader(self._peer.fileno())
            self._peer.close()
            self._peer = None
            self._held.clear()


def open_port(kind: str, baudrate: int = 0) -> SensorPort:
    """A port of the kind "pty" or "socket"; where ptys cannot be had, "pty" falls back to a socket.

    Args:
        kind: "pty" or "socket".
        baudrate: at which the device sends (Bd); 0: at any.
    """
    if kind == "pty":
        try:
            return PtyPort(baudrate)
        except OSError:
            return SocketPort()
    return SocketPort()

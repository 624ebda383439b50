"""A byte stream: a tty, a USB adapter, a serial device server (`rfc2217://`) or a socket (`socket://host:port`).

Reads are one `select` and one `os.read` wherever there is a file descriptor. `socket://` is opened here rather than by
pyserial, whose own waits 0.3 s at every close; every other URL goes through `serial_for_url`.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
from urllib.parse import urlsplit

import serial

from drivers import clock
from drivers.errors import LinkLost, PortClosed
from drivers.port_causes import reason

READ_SIZE = 1 << 16
OPEN_TIMEOUT_S = 2.0


class SerialPort:
    """One byte stream with one owner thread.

    Args:
        url: what `serial_for_url` takes, or `socket://host:port`.
        baudrate: Bd; ignored by sockets.
        device: name of the device behind it, for messages.
        bytesize: data bits, 5..8.
        parity: "N", "E" or "O".
        stopbits: 1 or 2.
    """

    def __init__(
        self,
        url: str,
        baudrate: int = 115200,
        *,
        device: str,
        bytesize: int = 8,
        parity: str = "N",
        stopbits: float = 1,
    ) -> None:
        self.url = url
        self.device = device
        self._baudrate = baudrate
        self._bytesize = bytesize
        self._parity = parity
        self._stopbits = stopbits
        self._serial: serial.Serial | None = None
        self._socket: socket.socket | None = None
        self._fd = -1
        self._opened = ""

    @property
    def is_open(self) -> bool:
        """Whether `open` succeeded and `close` has not been called."""
        return self._serial is not None or self._socket is not None

    @property
    def moved(self) -> bool:
        """The name (`/dev/serial/by-id/...`) leads to another port than the one that was opened."""
        return bool(self._opened) and os.path.exists(self.url) and os.path.realpath(self.url) != self._opened

    def open(self) -> None:
        """Open the port and throw away what waited in it.

        Raises:
            PortClosed: no such port, no permission, in use, connection refused, or settings it does not take.
        """
        if self.is_open:
            return
        try:
            if self.url.startswith(("socket://", "modbus-tcp://")):
                self._open_socket()
            else:
                self._open_serial()
        except (OSError, ValueError) as error:  # serial.SerialException is an OSError
            raise PortClosed(self.device, self.url, f"cannot be opened: {reason(error)}") from error
        self.discard_input()

    def close(self) -> None:
        """Close the port; closing twice is harmless. The thread that reads must have ended or be the caller."""
        opened, self._serial, self._socket, self._fd = self._serial or self._socket, None, None, -1
        if opened is not None:
            # A port that is already gone cannot be closed any better.
            with contextlib.suppress(OSError):
                opened.close()

    def read_available(self, timeout_s: float) -> tuple[bytes, int]:
        """Whatever has arrived, waiting for the first byte.

        Args:
            timeout_s: longest wait for the first byte, s.

        Returns:
            The bytes, empty after a time-out, and the monotonic time at which they were there, ns.

        Raises:
            PortClosed: the port is not open, or the other end is gone.
        """
        clock.back_within(timeout_s)
        try:
            data = self._read_fd(timeout_s) if self._fd >= 0 else self._read_object(timeout_s)
        except (OSError, ValueError) as error:
            raise PortClosed(self.device, self.url, f"the connection to the port was lost: {error}") from error
        return data, clock.monotonic_ns()

    def write(self, data: bytes, timeout_s: float = 0.1) -> None:
        """Send all bytes.

        Args:
            data: bytes to send.
            timeout_s: longest wait for room in the port's buffer, s.

        Raises:
            PortClosed: the port is not open, or the other end is gone.
            LinkLost: the port took only a part of the data in time.
        """
        if not self.is_open:
            raise PortClosed(self.device, self.url, "the port is not open")
        deadline = clock.monotonic() + timeout_s
        rest = memoryview(data)
        try:
            while rest:
                rest = rest[self._write_some(rest, max(0.0, deadline - clock.monotonic())) :]
        except (TimeoutError, serial.SerialTimeoutException) as error:
            raise LinkLost(
                self.device, self.url, f"sent {len(data) - len(rest)} of {len(data)} bytes within {timeout_s} s"
            ) from error
        except (OSError, ValueError) as error:
            raise PortClosed(self.device, self.url, f"the connection to the port was lost: {error}") from error

    def discard_input(self, limit_s: float = 0.1) -> int:
        """Throw away what has arrived so far.

        Args:
            limit_s: longest time to go on while new bytes keep coming, s.

        Returns:
            Number of bytes thrown away.

        Raises:
            PortClosed: the port is not open, or the other end is gone.
        """
        thrown = 0
        deadline = clock.monotonic() + limit_s
        while clock.monotonic() < deadline:
            data, _ = self.read_available(0.0)
            thrown += len(data)
            if len(data) < READ_SIZE // 16:
                break
        return thrown

    def _open_socket(self) -> None:
        """Connect to `socket://host:port`.

        Raises:
            ValueError: the URL has no host or port.
        """
        parts = urlsplit(self.url)
        if parts.hostname is None or parts.port is None:
            raise ValueError("expected socket://host:port")
        connection = socket.create_connection((parts.hostname, parts.port), timeout=OPEN_TIMEOUT_S)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        connection.setblocking(False)
        self._socket, self._fd = connection, connection.fileno()

    def _open_serial(self) -> None:
        """Open anything pyserial knows; a real tty is taken for us alone."""
        port = serial.serial_for_url(
            self.url, do_not_open=True, timeout=0, write_timeout=0.1, baudrate=self._baudrate,
            bytesize=self._bytesize, parity=self._parity, stopbits=self._stopbits,
        )
        self._opened = os.path.realpath(self.url) if os.path.exists(self.url) else ""
        if self._opened:
            port.exclusive = True
        port.open()
        self._serial = port
        try:
            self._fd = port.fileno()
        except (AttributeError, OSError):  # io.UnsupportedOperation is an OSError: no descriptor behind this URL
            self._fd = -1
        if self._fd >= 0 and hasattr(port, "set_low_latency_mode"):
            # FTDI adapters hold bytes for 16 ms otherwise; other drivers do not have the setting.
            with contextlib.suppress(OSError, ValueError, NotImplementedError):
                port.set_low_latency_mode(True)

    def _read_fd(self, timeout_s: float) -> bytes:
        """One select, one read.

        Raises:
            OSError: end of file.
        """
        ready, _, _ = select.select((self._fd,), (), (), timeout_s)
        if not ready:
            return b""
        try:
            data = os.read(self._fd, READ_SIZE)
        except BlockingIOError:
            return b""
        if not data:
            raise OSError("end of file: the device closed the connection or was disconnected")
        return data

    def _read_object(self, timeout_s: float) -> bytes:
        """Block read for ports without a file descriptor.

        Raises:
            OSError: the port is not open.
        """
        port = self._serial
        if port is None:
            raise OSError("the port is not open")
        port.timeout = timeout_s
        first: bytes = port.read(1)
        waiting = port.in_waiting if first else 0
        return first + port.read(min(waiting, READ_SIZE)) if waiting else first

    def _write_some(self, data: memoryview, wait_s: float) -> int:
        """Send what fits now; number of bytes taken.

        Raises:
            TimeoutError: no room within the wait.
        """
        if self._fd < 0 and self._serial is not None:
            return int(self._serial.write(data) or 0)
        _, ready, _ = select.select((), (self._fd,), (), wait_s)
        if not ready:
            raise TimeoutError("the port's buffer is full")
        try:
            return os.write(self._fd, data)
        except BlockingIOError:
            return 0


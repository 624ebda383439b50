"""An slcan adapter with an ECU's frames behind it, for driver tests."""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import Self


class SlcanDevice:
    """Takes one connection; collects what the host sends.

    Attributes:
        channel: URL for the driver.
        lines: lines the host has sent, set-up included.
    """

    def __init__(self) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.channel = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self.lines: list[bytes] = []
        self._changed = threading.Condition()
        self._connected = threading.Event()
        self._connection: socket.socket | None = None
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def send(self, data: bytes) -> None:
        """Send bytes to the host once it has joined the bus."""
        self.wait_for(lambda lines: b"O" in lines)
        if self._connection is not None:
            self._connection.sendall(data)

    def frame(self, identifier: int, data: bytes) -> None:
        """Send one standard frame to the host."""
        self.send(b"t%03X%d%s\r" % (identifier, len(data), data.hex().encode()))

    def wait_for(self, condition, timeout_s: float = 5.0) -> bool:  # noqa: ANN001 - a test's condition on the lines
        """Wait until the host has sent what is wanted."""
        with self._changed:
            return self._changed.wait_for(lambda: condition(self.lines), timeout_s)

    def pull(self) -> None:
        """Unplug the adapter; harmless when the host has left already."""
        self._connected.wait(5)
        if self._connection is not None:
            with contextlib.suppress(OSError):
                self._connection.shutdown(socket.SHUT_RDWR)

    def _serve(self) -> None:
        try:
            self._connection, _ = self._server.accept()
        except OSError:
            return
        self._connected.set()
        rest = b""
        with self._connection as connection:
            while True:
                try:
                    data = connection.recv(4096)
                except OSError:
                    return
                if not data:
                    return
                *lines, rest = (rest + data).split(b"\r")
                with self._changed:
                    self.lines += lines
                    self._changed.notify_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._connection is not None:
            self.pull()
        with contextlib.suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        self._server.close()
        self._thread.join(5)

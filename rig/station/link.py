"""The station's end of the link to the application: JSON lines in, JSON lines out, never blocking who emits.

Input is read by the calling thread (`run`); output has a thread of its own with a bounded queue, so that an application
that does not read cannot hold up an interlock. Events that find the queue full are dropped and counted.
"""

from __future__ import annotations

import json
import os
import select
import signal
import threading
from collections import deque
from collections.abc import Callable
from types import FrameType

MOST_QUEUED = 10_000
LONGEST_LINE = 1 << 22
READ_SIZE = 1 << 16


class Link:
    """Two file descriptors and the threads on them."""

    def __init__(self, in_fd: int, out_fd: int) -> None:
        self._in_fd = in_fd
        self._out_fd = out_fd
        self.dropped = 0
        self._queue: deque[bytes] = deque()
        self._something = threading.Condition()
        self._ending = False
        self._wake_read, self._wake_write = os.pipe()
        self._signalled: int | None = None
        self._writer = threading.Thread(target=self._write, name="link", daemon=True)

    def start(self) -> None:
        """Start the writing thread."""
        self._writer.start()

    def emit(self, message: dict[str, object]) -> None:
        """Queue a message for the application; returns at once."""
        line = json.dumps(message).encode() + b"\n"
        with self._something:
            if len(self._queue) >= MOST_QUEUED:
                self.dropped += 1
                return
            self._queue.append(line)
            self._something.notify()

    def catch(self, number: int) -> None:
        """Have a signal end `run` instead of the process."""
        signal.signal(number, self._on_signal)

    def leave(self) -> None:
        """End `run` from another thread."""
        os.write(self._wake_write, b"x")

    def run(self, take: Callable[[dict[str, object]], None]) -> int | None:
        """Read messages until the input ends, `leave` is called or a caught signal arrives.

        Args:
            take: called with each message, on this thread; must not block.

        Returns:
            The signal's number, or None for the end of input or `leave`.
        """
        rest = b""
        while True:
            ready, _, _ = select.select([self._in_fd, self._wake_read], [], [])
            if self._wake_read in ready:
                return self._signalled
            chunk = os.read(self._in_fd, READ_SIZE)
            if not chunk:
                return None
            *lines, rest = (rest + chunk).split(b"\n")
            for line in lines:
                self._take_line(line, take)
            if len(rest) > LONGEST_LINE:
                self.emit({"event": "warning", "slug": "station-link", "detail": "line too long: dropped"})
                rest = b""

    def end(self, timeout_s: float = 1.0) -> None:
        """Write what is queued and end the writing thread."""
        with self._something:
            self._ending = True
            self._something.notify()
        self._writer.join(timeout_s)

    def _on_signal(self, number: int, frame: FrameType | None) -> None:
        del frame
        self._signalled = number
        os.write(self._wake_write, b"s")

    def _take_line(self, line: bytes, take: Callable[[dict[str, object]], None]) -> None:
        try:
            message = json.loads(line)
        except ValueError:
            message = None
        if isinstance(message, dict):
            take(message)
        elif line.strip():
            self.emit({"event": "warning", "slug": "station-link", "detail": f"not a JSON object: {line[:80]!r}"})

    def _write(self) -> None:
        while True:
            with self._something:
                while not self._queue and not self._ending:
                    self._something.wait()
                if not self._queue:
                    return
                data = b"".join(self._queue)
                self._queue.clear()
            view = memoryview(data)
            try:
                while view:
                    view = view[os.write(self._out_fd, view) :]
            except OSError:
                # The application is gone; the end of its input says so to `run`. What it does not read is dropped.
                self.dropped += data.count(b"\n")

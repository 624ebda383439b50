"""Bytes under way: pipes, connections and listeners of a world.

Latency, chunking and limits are drawn from its seed.
"""

from __future__ import annotations

import errno
from collections import deque
from collections.abc import Callable

from simulators.scenarios.kernel import Kernel
from simulators.scenarios.threads import Waiters

FIRST_PORT = 40_001
PIPE_BYTES = 1 << 16
PIPE_ATOM = 4096
"""A pipe takes so little whole or not at all, and says that it can be written when it takes so much."""
SOCKET_BYTES = 1 << 18
PIPE_NS = (5_000, 60_000)
WIRE_NS = (30_000, 250_000)
SLOW_SHARE, SLOW_NS = 0.002, (1_000_000, 4_000_000)
"""Of the chunks on a wire so many take longer."""
CUT_SHARE = 0.05
"""Of the reads so many end inside of what has arrived."""


class Stream:
    """Bytes in one direction, in order.

    Attributes:
        closed: the writing end is gone.
        deaf: the reading end is gone.
        on_arrival: called with the time at which something can be read; for readers that are no tasks.
        on_room: called when something was read; for writers that are no tasks.
        back: of a connection, the stream in the other direction.
    """

    def __init__(self, kernel: Kernel, *, wire: bool) -> None:
        self.kernel = kernel
        self.closed = self.deaf = False
        self.on_arrival: Callable[[int], None] | None = None
        self.on_room: Callable[[], None] | None = None
        self.back: Stream | None = None
        self.readers, self.writers = Waiters(kernel), Waiters(kernel)
        self._capacity, self._latency_ns = (SOCKET_BYTES, WIRE_NS) if wire else (PIPE_BYTES, PIPE_NS)
        self._wire = wire
        self._reset_ns: int | None = None
        self._reset_reported = False
        self._parts: deque[tuple[int, bytes]] = deque()
        self._size = 0
        self._last_ns = 0

    @property
    def unread(self) -> int:
        """Bytes written and not yet read."""
        return self._size

    @property
    def room(self) -> int:
        """Bytes that can be written without waiting."""
        room = self._capacity - self._size
        return room if room > 0 else 0

    @property
    def writable(self) -> bool:
        """What `select` says of the writing end."""
        return self._fails or self.room >= (1 if self._wire else PIPE_ATOM)

    @property
    def _fails(self) -> bool:
        """Writing fails at once."""
        back = self.back
        gone = self.deaf if back is None else back._reset_ns is not None and back._is_reset  # noqa: SLF001 - this class
        return self.closed or gone

    @property
    def _is_reset(self) -> bool:
        """The reset has arrived at the reading end."""
        return self._reset_ns is not None and self._reset_ns <= self.kernel.now_ns

    def write(self, data: bytes) -> int:
        """Write what fits; how much.

        To a connection that the other end has closed the first write goes well; it is answered by a reset.

        Raises:
            BrokenPipeError: no reader.
        """
        if self._fails:
            raise BrokenPipeError(errno.EPIPE, "Broken pipe")
        if self.deaf and self.back is not None:
            self.back.cut()
            return len(data)
        room, size = self.room, len(data)
        if not self._wire and room < size <= PIPE_ATOM:
            return 0
        part = bytes(data if size <= room else data[:room])
        if part:
            self._size += len(part)
            self._parts.append((self._arrives(), part))
            self._notify(self._last_ns)
        return len(part)

    def close(self) -> None:
        """No more will be written."""
        if not self.closed:
            self.closed = True
            self._notify(self._arrives())

    def cut(self) -> None:
        """The writing end is gone without a farewell: what is under way arrives, then the reading end's call fails."""
        if self._reset_ns is None:
            self.closed = True
            self._reset_ns = self._arrives()
            self._notify(self._reset_ns)
            if self.back is not None:
                self.back.writers.wake(at_ns=self._reset_ns)

    def leave(self) -> None:
        """No reader any more."""
        self.deaf = True
        self._parts.clear()
        self._size = 0
        self._read_on()

    @property
    def readable_ns(self) -> int | None:
        """When something can be read, the end of the stream included; None while nothing is under way."""
        if self._parts:
            return self._parts[0][0]
        return self._last_ns if self.closed else None

    def read(self, most: int) -> bytes | None:
        """What has arrived, up to so many bytes; empty at the end of the stream, None while there is nothing.

        Raises:
            ConnectionResetError: the connection is gone; said once, as a machine does.
        """
        now_ns, taken, size = self.kernel.now_ns, [], 0
        if self._wire and most > 1 and self._parts and self.kernel.chance.random() < CUT_SHARE:
            most = max(1, int(self.kernel.chance.random() * min(most, len(self._parts[0][1]))))
        while self._parts and self._parts[0][0] <= now_ns and size < most:
            at_ns, part = self._parts.popleft()
            if len(part) > most - size:
                self._parts.appendleft((at_ns, part[most - size :]))
                part = part[: most - size]
            taken.append(part)
            size += len(part)
        if size:
            self._size -= size
            self._read_on()
            return b"".join(taken)
        if not self.closed or self._parts or self._last_ns > now_ns:
            return None
        if self._is_reset and not self._reset_reported:
            self._reset_reported = True
            raise ConnectionResetError(errno.ECONNRESET, "Connection reset by peer")
        return b""

    def _read_on(self) -> None:
        self.writers.wake()
        if self.on_room is not None:
            self.on_room()

    def _arrives(self) -> int:
        kernel = self.kernel
        draw = kernel.chance.random
        low, high = SLOW_NS if self._wire and draw() < SLOW_SHARE else self._latency_ns
        at_ns = kernel.now_ns + low + int(draw() * (high - low))
        if at_ns > self._last_ns:
            self._last_ns = at_ns
        return self._last_ns

    def _notify(self, at_ns: int) -> None:
        if self.on_arrival is not None:
            self.on_arrival(at_ns)
        self.readers.wake(at_ns=at_ns)


class End:
    """One end of a pipe or connection: what can be read from it, what can be written to it."""

    def __init__(self, inward: Stream | None, outward: Stream | None, *, blocking: bool = True) -> None:
        self.inward, self.outward = inward, outward
        self.blocking = blocking
        self.holders = 0

    def close(self) -> None:
        """Let go of it; the other end reads what is under way and then the end.

        A connection of which something was not read is reset instead.
        """
        unread = self.inward is not None and self.inward.back is not None and self.inward.unread
        if self.inward is not None:
            self.inward.leave()
        if self.outward is not None and unread:
            self.outward.cut()
        elif self.outward is not None:
            self.outward.close()

    def reset(self) -> None:
        """Let go of it in a way that the other end's next call fails."""
        if self.inward is not None:
            self.inward.leave()
        if self.outward is not None:
            self.outward.cut()


def pipe(kernel: Kernel) -> tuple[End, End]:
    """The reading and the writing end."""
    stream = Stream(kernel, wire=False)
    return End(stream, None), End(None, stream)


def connection(kernel: Kernel) -> tuple[End, End]:
    """Both ends of a connection."""
    there, back = Stream(kernel, wire=True), Stream(kernel, wire=True)
    there.back, back.back = back, there
    return End(back, there), End(there, back)


class Network:
    """Who listens at which port of this machine."""

    def __init__(self, kernel: Kernel) -> None:
        self.kernel = kernel
        self.listeners: dict[int, Callable[[End], None]] = {}
        self._next_port = FIRST_PORT

    def restart(self) -> None:
        """No listener; the next one gets the first port again."""
        self.listeners.clear()
        self._next_port = FIRST_PORT

    def listen(self, accept: Callable[[End], None]) -> int:
        """Accept connections; the port."""
        port, self._next_port = self._next_port, self._next_port + 1
        self.listeners[port] = accept
        return port

    def connect(self, port: int) -> End:
        """Connect.

        Raises:
            ConnectionRefusedError: no listener there.
        """
        accept = self.listeners.get(port)
        if accept is None:
            raise ConnectionRefusedError(errno.ECONNREFUSED, "Connection refused")
        near, far = connection(self.kernel)
        accept(far)
        return near


class Socket:
    """`socket.socket` of a connection that stands, as the drivers use it."""

    def __init__(
        self, kernel: Kernel, end: End, descriptor: int, forget: Callable[[int], None], timeout_s: float | None
    ) -> None:
        self._kernel = kernel
        self._end = end
        self._descriptor = descriptor
        self._forget = forget
        self.settimeout(timeout_s)

    def fileno(self) -> int:
        """Its descriptor; -1 once closed."""
        return self._descriptor

    def settimeout(self, timeout_s: float | None) -> None:
        """How long calls may wait; its descriptor does not wait any more, unless for ever."""
        self._timeout_s = timeout_s
        self._end.blocking = timeout_s is None

    def setblocking(self, flag: bool) -> None:
        """Wait or not."""
        self.settimeout(None if flag else 0.0)

    def setsockopt(self, *_: object) -> None:
        """Nothing here depends on options."""

    def recv(self, most: int) -> bytes:
        """Read.

        Raises:
            TimeoutError: nothing in time.
            BlockingIOError: nothing there, and no waiting.
        """
        self._kernel.system_call()
        stream = self._inward()
        until_ns = stream.readers.until(self._timeout_s)
        while (data := stream.read(most)) is None:
            self._in_time(until_ns)
            wait_for(self._kernel, [stream], [], until_ns)
        return data

    def send(self, data: bytes) -> int:
        """Write what fits.

        Raises:
            TimeoutError: no room in time.
            BlockingIOError: no room, and no waiting.
        """
        self._kernel.system_call()
        stream = self._outward()
        until_ns = stream.writers.until(self._timeout_s)
        while not (written := stream.write(data)) and data:
            self._in_time(until_ns)
            stream.writers.wait(until_ns)
        return written

    def sendall(self, data: bytes) -> None:
        """Write all.

        Raises:
            TimeoutError: it does not fit in time.
            BlockingIOError: it does not fit, and no waiting.
        """
        self._kernel.system_call()
        stream = self._outward()
        until_ns, rest = stream.writers.until(self._timeout_s), bytes(data)
        while rest := rest[stream.write(rest) :]:
            self._in_time(until_ns)
            stream.writers.wait(until_ns)

    def _in_time(self, until_ns: int | None) -> None:
        if until_ns is not None and self._kernel.now_ns >= until_ns:
            raise TimeoutError("timed out") if self._timeout_s else BlockingIOError(errno.EAGAIN, "would block")

    def close(self) -> None:
        """Hang up."""
        if self._descriptor >= 0:
            self._forget(self._descriptor)
            self._descriptor = -1

    def shutdown(self, _how: int) -> None:
        """Nothing more to send."""
        if self._end.outward is not None:
            self._end.outward.close()

    def _inward(self) -> Stream:
        if self._descriptor < 0 or self._end.inward is None:
            raise OSError(errno.EBADF, "Bad file descriptor")
        return self._end.inward

    def _outward(self) -> Stream:
        if self._descriptor < 0 or self._end.outward is None:
            raise OSError(errno.EBADF, "Bad file descriptor")
        return self._end.outward


def wait_for(kernel: Kernel, readers: list[Stream], writers: list[Stream], until_ns: int | None) -> None:
    """Wait until one of them may be read or written, or until a time.

    Raises:
        RuntimeError: not called by a task.
    """
    ends = [at_ns for stream in readers if (at_ns := stream.readable_ns) is not None]
    if ends and min(ends) <= kernel.now_ns:
        return
    task = kernel.task()
    ends += [] if until_ns is None else [until_ns]
    waiting = [stream.readers for stream in readers] + [stream.writers for stream in writers]
    for waiters in waiting:
        waiters.add(task)
    try:
        kernel.block(min(ends, default=None))
    finally:
        for waiters in waiting:
            waiters.drop(task)

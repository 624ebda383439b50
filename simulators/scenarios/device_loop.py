"""The devices' process: asyncio in virtual time, its connections those of the world's network.

The simulated devices are an asyncio program; here it runs unchanged, on an event loop that waits in the world's kernel.
Serial ports are the network's, by number; or opened by a name, as those of USB adapters are: a file stands for each.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

from simulators.scenarios.kernel import Kernel, Task
from simulators.scenarios.machine import Machine
from simulators.scenarios.streams import End, Network, Stream

READ_SIZE = 1 << 16


class ScenarioLoop(asyncio.BaseEventLoop):
    """An event loop of one world."""

    def __init__(self, kernel: Kernel, network: Network) -> None:
        super().__init__()
        self._kernel = kernel
        self._network = network
        self._task: Task | None = None
        self._until_ns: int | None = None
        self._selector = self
        self._clock_resolution = 1e-6

    def __del__(self) -> None:
        """It holds nothing of the machine's: it need not be closed."""

    def time(self) -> float:
        """Virtual time (s)."""
        return self._kernel.now_ns * 1e-9

    @property
    def now_ns(self) -> int:
        """Virtual time (ns)."""
        return self._kernel.now_ns

    def select(self, timeout: float | None) -> list[Any]:
        """Wait until something is to be done; as a selector."""
        kernel = self._kernel
        self._task = kernel.current
        if timeout is not None and timeout <= 0.0:
            return []
        self._until_ns = None if timeout is None else kernel.now_ns + int(timeout * 1e9) + 1
        # The other tasks of this thread are no part of this loop.
        hooks = sys.get_asyncgen_hooks()
        asyncio._set_running_loop(None)  # noqa: SLF001 - what `run_forever` itself does
        sys.set_asyncgen_hooks(None, None)
        kernel.block(self._until_ns)
        asyncio._set_running_loop(self)  # noqa: SLF001
        sys.set_asyncgen_hooks(*hooks)
        return []

    def at(self, due_ns: int, do: Callable[[], None]) -> None:
        """Do something at a time; from any task."""
        if due_ns <= self._kernel.now_ns:
            self.call_soon(do)
        else:
            self.call_at(due_ns * 1e-9, do)
        if self._task is not None and (self._until_ns is None or due_ns < self._until_ns):
            self._kernel.wake(self._task, due_ns)

    async def create_server(self, protocol_factory: Callable[[], Any], *_: object, **__: object) -> Any:  # noqa: ANN401 - asyncio
        """Accept connections of the world's processes."""

        def accept(end: End) -> None:
            self.at(self._kernel.now_ns, lambda: Transport(self, end, protocol_factory()).begin())

        return Server(self._network, self._network.listen(accept))

    def _process_events(self, event_list: list[Any]) -> None:
        del event_list

    def _write_to_self(self) -> None:
        if self._task is not None:
            self._kernel.wake(self._task)


class Server:
    """What `create_server` gives."""

    def __init__(self, network: Network, port: int) -> None:
        self._network = network
        self._port = port
        self.sockets = (self,)

    def getsockname(self) -> tuple[str, int]:
        """Where it listens."""
        return "127.0.0.1", self._port

    def close(self) -> None:
        """Accept no more connections."""
        self._network.listeners.pop(self._port, None)

    def is_serving(self) -> bool:
        """It accepts."""
        return self._port in self._network.listeners

    async def wait_closed(self) -> None:
        """It is closed at once."""


class Transport(asyncio.Transport):
    """One connection of the devices."""

    def __init__(self, loop: ScenarioLoop, end: End, protocol: Any) -> None:  # noqa: ANN401 - as asyncio has it
        super().__init__()
        self._loop = loop
        self._end = end
        self._protocol = protocol
        self._paused = self._closing = self._left = False
        self._waiting = b""
        if end.inward is None or end.outward is None:
            raise ValueError("a connection requires two directions")
        self._in: Stream = end.inward
        self._out: Stream = end.outward
        self._in.on_arrival = self._arriving
        self._out.on_room = self._room

    def begin(self) -> None:
        """The connection is made."""
        self._protocol.connection_made(self)
        self._look()

    def set_protocol(self, protocol: Any) -> None:  # noqa: ANN401 - as asyncio has it
        """Who takes the bytes."""
        self._protocol = protocol

    def get_protocol(self) -> Any:  # noqa: ANN401 - as asyncio has it
        """Who takes the bytes."""
        return self._protocol

    def get_extra_info(self, name: str, default: Any = None) -> Any:  # noqa: ANN401 - as asyncio has it
        """Addresses; `socket` is the stream of what the host has not read."""
        return {"peername": ("127.0.0.1", 1), "sockname": ("127.0.0.1", 2), "socket": self._out}.get(name, default)

    def is_closing(self) -> bool:
        """It is closed or about to be."""
        return self._closing

    def is_reading(self) -> bool:
        """It reads."""
        return not self._paused

    def pause_reading(self) -> None:
        """Leave what comes where it is."""
        self._paused = True

    def resume_reading(self) -> None:
        """Read on."""
        self._paused = False
        self._look()

    def write(self, data: Any) -> None:  # noqa: ANN401 - as asyncio has it
        """Send."""
        if self._closing:
            return
        self._waiting += bytes(data)
        self._pass_on()

    def get_write_buffer_size(self) -> int:
        """Bytes that wait here."""
        return len(self._waiting)

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        """There is no limit."""

    def can_write_eof(self) -> bool:
        """It can."""
        return True

    def close(self) -> None:
        """Hang up when what waits here is sent; read no more."""
        self._closing = True
        if not self._waiting:
            self._leave(self._end.close)

    def abort(self) -> None:
        """Hang up at once, so that the host's next call fails."""
        self._leave(self._end.reset)

    def _leave(self, how: Callable[[], None]) -> None:
        if not self._left:
            self._left = self._closing = True
            self._waiting = b""
            self._in.on_arrival = self._out.on_room = None
            how()
            self._loop.at(self._loop.now_ns, lambda: self._protocol.connection_lost(None))

    def _pass_on(self) -> None:
        try:
            self._waiting = self._waiting[self._out.write(self._waiting) :]
        except OSError:
            self._leave(self._end.close)
        if self._closing and not self._waiting:
            self._leave(self._end.close)

    def _room(self) -> None:
        if self._waiting:
            self._loop.at(self._loop.now_ns, self._look)

    def _arriving(self, at_ns: int) -> None:
        self._loop.at(at_ns, self._look)

    def _look(self) -> None:
        if self._waiting:
            self._pass_on()
        while not (self._paused or self._closing):
            try:
                data = self._in.read(READ_SIZE)
            except OSError:
                data = b""
            if data is None:
                if self._in.readable_ns is not None:
                    self._loop.at(self._in.readable_ns, self._look)
                return
            if not data:
                self.close()
                return
            self._protocol.data_received(data)


class Queue:
    """What a host has not read of a connection (`simulators.peer_queue`)."""

    def unread(self, stream: Stream) -> int:
        """Bytes."""
        return stream.unread

    def close(self) -> None:
        """Nothing is held."""


CAPACITY = 4096


class WirePort:
    """A sensor's serial line: what the host has not read when the line's buffer is full is dropped."""

    def __init__(self, kernel: Kernel, network: Network) -> None:
        self.dropped_frames = self.unheard_frames = self.sent_bytes = 0
        self.waits = False
        self.read_once = False
        self._kernel = kernel
        self._network = network
        self._number = network.listen(self._accept)
        self.url = f"socket://127.0.0.1:{self._number}"
        self._end: End | None = None
        self._held = b""
        self._listens = False

    def listen(self) -> None:
        """Keep what the host sends from now on; until then it is left where it is."""
        self._listens = True

    def heard(self) -> list[tuple[int, bytes]]:
        """What the host has sent since the last call, each part with the time (ns) it came at."""
        parts: list[tuple[int, bytes]] = []
        inward = None if self._end is None else self._end.inward
        while self._listens and inward is not None:
            came_ns = inward.readable_ns
            try:
                data = None if came_ns is None or came_ns > self._kernel.now_ns else inward.read(READ_SIZE)
            except OSError:
                data = None
            if not data or came_ns is None:
                break
            parts.append((came_ns, data))
        return parts

    def write(self, data: bytes, frame_size: int) -> None:
        """Send whole frames as far as there is room; drop and count the rest."""
        if self._end is None or self._end.outward is None or self._end.outward.deaf:
            self.unheard_frames += 0 if self.read_once else -(-len(data) // frame_size)
            self.dropped_frames += -(-len(data) // frame_size) if self.read_once else 0
            return
        room = len(data) if self.waits else max(0, CAPACITY - self._end.outward.unread - len(self._held))
        take = data if len(data) <= room else data[: room // frame_size * frame_size]
        self.dropped_frames += -(-(len(data) - len(take)) // frame_size)
        self.sent_bytes += len(take)
        self._held += take
        self._held = self._held[self._end.outward.write(self._held) :]

    def unread(self) -> int:
        """Bytes sent and not yet read by the host."""
        return len(self._held) + (0 if self._end is None or self._end.outward is None else self._end.outward.unread)

    def close(self) -> None:
        """Hang up and stop listening."""
        self._network.listeners.pop(self._number, None)
        if self._end is not None:
            self._end.reset()
            self._end = None

    def _accept(self, end: End) -> None:
        if self._end is not None and self._end.inward is not None and not self._end.inward.closed:
            end.close()
            return
        self._end, self.read_once, self._held = end, True, b""


class Tty(WirePort):
    """A sensor's line that the host opens by a path; the file there holds the number of its port."""

    def __init__(self, machine: Machine, folder: Path) -> None:
        super().__init__(machine.kernel, machine.network)
        folder.mkdir(exist_ok=True)
        number = self.url.rpartition(":")[2]
        self._path = folder / f"tty{number}"
        self._path.write_text(number, encoding="utf-8")
        self.url = str(self._path)

    def close(self) -> None:
        """Hang up; the device's file goes with it."""
        super().close()
        self._path.unlink(missing_ok=True)


class Serial:
    """`serial.Serial` of such a line, as the drivers use it."""

    def __init__(self, machine: Machine, url: str) -> None:
        self.exclusive = False
        self._machine = machine
        self._url = url
        self._descriptor = -1

    def open(self) -> None:
        """Open.

        Raises:
            OSError: no such device, or its other end is closed.
        """
        number = int(Path(self._url).read_text(encoding="utf-8"))
        self._descriptor = self._machine.descriptor(self._machine.network.connect(number), self._machine.here)
        self._machine.set_blocking(self._descriptor, False)

    def fileno(self) -> int:
        """Its descriptor."""
        return self._descriptor

    def close(self) -> None:
        """Hang up."""
        self._machine.close(self._descriptor)


def serial_for_url(machine: Machine, url: str, **_settings: Any) -> Serial:  # noqa: ANN401 - a line has none here
    """`serial.serial_for_url` of a path."""
    return Serial(machine, url)

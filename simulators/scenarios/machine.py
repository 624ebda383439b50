"""The machine on which a world's processes run: processes, descriptors, network, disk and clock."""

from __future__ import annotations

import contextlib
import datetime
import errno
import fcntl
import os as real_os
import random
import signal as real_signal
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

from simulators.scenarios.disk import Disk
from simulators.scenarios.kernel import Kernel, Task
from simulators.scenarios.streams import End, Network, Socket, wait_for
from simulators.scenarios.threads import Waiters

FIRST_DESCRIPTOR = 1_000_000
FIRST_PID = 1000
STANDARD_ERROR = 2
HARMLESS = frozenset({
    real_signal.SIGCHLD, real_signal.SIGCONT, real_signal.SIGURG, real_signal.SIGWINCH, real_signal.SIGPIPE,
    real_signal.SIGTSTP,
})
"""Signals that do nothing where no handler is set: Python ignores SIGPIPE, and there is no terminal to stop for."""
EPOCH = datetime.datetime(2026, 1, 1, 8, 0, 0, tzinfo=datetime.UTC)


class Process:
    """One simulated process.

    Attributes:
        alive: it runs.
        exit_code: of its end, negative for a signal; None while it runs.
        stalled_ns: until when it does not run although it could.
        errors: what its threads died of.
        at_exit: what the interpreter waits for when the main thread has ended.
    """

    def __init__(self, machine: Machine, name: str, parent: Process | None, stderr: Path | None) -> None:
        self.machine = machine
        self.name = name
        self.parent = parent
        self.stderr = stderr
        machine.pids += 1
        self.pid = self.group = machine.pids
        self.alive = True
        self.exit_code: int | None = None
        self.stalled_ns = 0
        self.stdin = self.stdout = -1
        self.descriptors: set[int] = set()
        self.handlers: dict[int, Any] = {}
        self.files: dict[str, Any] = {}
        self.begin: Callable[[], None] = lambda: None
        self.errors: list[str] = []
        self.at_exit: list[Callable[[], object]] = []
        self.ended = Waiters(machine.kernel)
        self.main: Task | None = None

    def uncaught(self, thread: str, trace: str) -> None:
        """A thread ended by an error."""
        self.errors.append(f"{thread}: {trace}")
        self.write_error(f"Exception in thread {thread}:\n{trace}")

    def write_error(self, text: str) -> None:
        """Onto its standard error."""
        if self.stderr is not None:
            with self.stderr.open("a", encoding="utf-8") as file:
                file.write(text)

    def __repr__(self) -> str:
        return f"{self.name}({self.pid})"


class Machine:
    """Processes, descriptors, network, disk and clock of one world."""

    def __init__(self, kernel: Kernel, disk: Disk, seed: int) -> None:
        self.kernel = kernel
        self.disk = disk
        self.network = Network(kernel)
        self.chance = random.Random(f"machine {seed}")
        self.pids = FIRST_PID
        self.processes: dict[int, Process] = {}
        self.programs: dict[str, Callable[[list[str]], int | None]] = {}
        self.ends: dict[int, End] = {}
        self.wall_step_s = 0.0
        self.suspended_ns = 0
        self.log_full = False
        self._next_descriptor = FIRST_DESCRIPTOR

    # Processes

    @property
    def here(self) -> Process | None:
        """The process whose task runs now; None outside of the world."""
        return None if self.kernel.current is None else self.kernel.current.process

    def start(
        self, name: str, do: Callable[[], object], *, parent: Process | None = None, stderr: Path | None = None,
        begin: bool = True,
    ) -> Process:
        """A new process; `do` is its main thread."""
        process = Process(self, name, parent, stderr)
        self.processes[process.pid] = process

        def main() -> None:
            code: object
            try:
                code = do()
            except SystemExit as leaving:
                code = leaving.code
            except KeyboardInterrupt:
                code = -int(real_signal.SIGINT)
            except BaseException:  # noqa: BLE001 - an uncaught error ends the process and is told
                process.uncaught("MainThread", traceback.format_exc())
                code = 1
            while process.at_exit:
                with contextlib.suppress(KeyboardInterrupt):
                    process.at_exit.pop(0)()
            self.end(process, code if isinstance(code, int) else 0 if code is None else 1)

        if begin:
            process.main = self.kernel.spawn("MainThread", process, main)
        else:
            process.begin = main
        return process

    def end(self, process: Process, code: int) -> None:
        """End a process: by itself, or by a signal (a negative code)."""
        if not process.alive:
            return
        process.alive = False
        process.exit_code = code
        for task in [task for task in self.kernel.tasks if task.process is process]:
            self.kernel.abandon(task)
        for descriptor in sorted(process.descriptors):
            self.close(descriptor, process)
        process.ended.wake()
        current = self.kernel.current
        if current is not None and current.process is process and code < 0:
            self.kernel.block()  # killed by itself: it never returns

    def signal(self, process: Process, number: int) -> None:
        """Send a signal to a process."""
        if not process.alive:
            return
        default: Any = real_signal.default_int_handler if number == real_signal.SIGINT else real_signal.SIG_DFL
        handler = process.handlers.get(number, default)
        if number == real_signal.SIGKILL:
            self.end(process, -int(number))
        elif handler == real_signal.SIG_DFL:
            if number not in HARMLESS:
                self.end(process, -int(number))
        elif callable(handler) and process.main is not None:
            self.kernel.interrupt(process.main, lambda: handler(int(number), None))

    # Clock

    def now(self) -> datetime.datetime:
        """The wall clock."""
        return EPOCH + datetime.timedelta(seconds=self.kernel.time_s + self.wall_step_s)

    def wall_s(self) -> float:
        """The wall clock as `time.time` has it (s)."""
        return self.now().timestamp()

    # Descriptors

    def copy(self, descriptor: int, process: Process | None) -> int:
        """`os.dup`, perhaps for another process."""
        if descriptor >= FIRST_DESCRIPTOR:
            return self.descriptor(self._end(descriptor), process)
        copied = real_os.dup(descriptor)
        self.disk.copied(descriptor, copied)
        if process is not None:
            process.descriptors.add(copied)
        return copied

    def descriptor(self, end: End, process: Process | None) -> int:
        """A new descriptor of a process for one end."""
        number, self._next_descriptor = self._next_descriptor, self._next_descriptor + 1
        self.ends[number] = end
        end.holders += 1
        if process is not None:
            process.descriptors.add(number)
        return number

    def close(self, descriptor: int, process: Process | None = None) -> None:
        """Close a descriptor.

        Raises:
            OSError: it is none.
        """
        process = process or self.here
        if process is not None:
            process.descriptors.discard(descriptor)
        if descriptor < FIRST_DESCRIPTOR:
            self.disk.closed(descriptor)
            real_os.close(descriptor)
            return
        end = self.ends.pop(descriptor, None)
        if end is None:
            raise OSError(errno.EBADF, "Bad file descriptor")
        end.holders -= 1
        if not end.holders:
            end.close()

    def connect(self, address: tuple[str, int], timeout: float | None = None) -> Socket:
        """`socket.create_connection` to a port of this machine."""
        self.kernel.sleep_ns(50_000)
        end = self.network.connect(address[1])
        process = self.here
        number = self.descriptor(end, process)
        return Socket(self.kernel, end, number, lambda closed: self.close(closed, process), timeout)

    def read(self, descriptor: int, size: int) -> bytes:
        """`os.read`.

        Raises:
            OSError: it is no descriptor that can be read.
            BlockingIOError: nothing there, and no waiting.
        """
        if descriptor < FIRST_DESCRIPTOR:
            return real_os.read(descriptor, size)
        end = self._end(descriptor)
        if end.inward is None:
            raise OSError(errno.EBADF, "Bad file descriptor")
        self.kernel.system_call()
        while (data := end.inward.read(size)) is None:
            if not end.blocking:
                raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
            wait_for(self.kernel, [end.inward], [], None)
        return data

    def write(self, descriptor: int, data: Any) -> int:  # noqa: ANN401
        """`os.write`: all of it, or what fits where there is no waiting.

        Raises:
            OSError: it is no descriptor that can be written.
            BlockingIOError: no room, and no waiting.
        """
        self.kernel.system_call()
        if descriptor == STANDARD_ERROR and self.here is not None:
            if self.log_full:
                raise OSError(errno.ENOSPC, "No space left on device")
            self.here.write_error(bytes(data).decode("utf-8", "replace"))
            return len(data)
        if descriptor < FIRST_DESCRIPTOR:
            size = self.disk.write(descriptor, len(data))
            at = _place(descriptor)
            self.disk.changes(descriptor, at, at + size)
            return real_os.write(descriptor, bytes(data)[:size])
        end, rest = self._end(descriptor), bytes(data)
        if end.outward is None:
            raise OSError(errno.EBADF, "Bad file descriptor")
        while (written := end.outward.write(rest)) < len(rest) and (end.blocking or not written):
            if not end.blocking:
                raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")
            rest = rest[written:]
            end.outward.writers.wait(None)
        return len(data) if end.blocking else written

    def set_blocking(self, descriptor: int, flag: bool) -> None:
        """`os.set_blocking`."""
        self._end(descriptor).blocking = flag

    def _end(self, descriptor: int) -> End:
        end = self.ends.get(descriptor)
        if end is None:
            raise OSError(errno.EBADF, "Bad file descriptor")
        return end

    def select(
        self, read: Any, write: Any, other: Any, timeout: float | None = None  # noqa: ANN401
    ) -> tuple[list[Any], list[Any], list[Any]]:
        """`select.select`."""
        del other
        kernel = self.kernel
        kernel.system_call()
        until_ns = None if timeout is None else kernel.now_ns + int(max(0.0, timeout) * 1e9)
        readers = [(item, stream) for item in read if (stream := self._end(_number(item)).inward) is not None]
        writers = [(item, stream) for item in write if (stream := self._end(_number(item)).outward) is not None]
        while True:
            now_ns = kernel.now_ns
            ready = [item for item, stream in readers if (at := stream.readable_ns) is not None and at <= now_ns]
            free = [item for item, stream in writers if stream.writable]
            if ready or free or (until_ns is not None and now_ns >= until_ns):
                return ready, free, []
            wait_for(kernel, [stream for _, stream in readers], [stream for _, stream in writers], until_ns)


def _number(item: Any) -> int:  # noqa: ANN401
    number = item if isinstance(item, int) else int(item.fileno())
    if number < 0:
        raise ValueError(f"file descriptor cannot be a negative integer ({number})")
    return number


def _place(descriptor: int) -> int:
    """Where the next write to a file goes; 0 for what is no file."""
    try:
        if fcntl.fcntl(descriptor, fcntl.F_GETFL) & real_os.O_APPEND:
            return real_os.fstat(descriptor).st_size
        return real_os.lseek(descriptor, 0, real_os.SEEK_CUR)
    except OSError:
        return 0

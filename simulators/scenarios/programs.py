"""Programs that a world's processes start, and the pipes between them: `subprocess` as production code uses it."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from simulators.scenarios.machine import Machine
from simulators.scenarios.streams import pipe

BEGINS_NS = 20_000_000
"""How long the start of an interpreter takes."""


class Writer:
    """The writing end of a pipe as a file, of text or bytes."""

    def __init__(self, machine: Machine, descriptor: int) -> None:
        self._machine, self._descriptor, self._waiting = machine, descriptor, b""
        self._owner = machine.here
        self.closed = False

    def fileno(self) -> int:
        """Its descriptor."""
        return self._descriptor

    def write(self, data: str | bytes) -> int:
        """Keep until the next flush.

        Raises:
            ValueError: it is closed.
        """
        if self.closed:
            raise ValueError("write to closed file")
        self._waiting += data.encode() if isinstance(data, str) else bytes(data)
        return len(data)

    def flush(self) -> None:
        """Write."""
        while self._waiting:
            self._waiting = self._waiting[self._machine.write(self._descriptor, self._waiting) :]

    def close(self) -> None:
        """Flush and close."""
        if not self.closed:
            self.closed = True
            try:
                self.flush()
            finally:
                self._machine.close(self._descriptor, self._owner)

    def __enter__(self) -> Writer:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Reader:
    """The reading end of a pipe as a file of lines, of text or bytes."""

    def __init__(self, machine: Machine, descriptor: int, *, text: bool) -> None:
        self._machine, self._descriptor, self._text, self._rest = machine, descriptor, text, b""
        self._owner = machine.here
        self.closed = False

    def fileno(self) -> int:
        """Its descriptor."""
        return self._descriptor

    def __iter__(self) -> Iterator[Any]:
        while True:
            while b"\n" not in self._rest:
                data = self._machine.read(self._descriptor, 1 << 16)
                if not data:
                    if self._rest:
                        yield self._rest.decode() if self._text else self._rest
                    return
                self._rest += data
            line, _, self._rest = self._rest.partition(b"\n")
            yield (line + b"\n").decode() if self._text else line + b"\n"

    def close(self) -> None:
        """Close."""
        if not self.closed:
            self.closed = True
            self._machine.close(self._descriptor, self._owner)

    def __enter__(self) -> Reader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Popen:
    """`subprocess.Popen` of one of the project's own programs."""

    def __init__(
        self, machine: Machine, arguments: list[str], *, stderr: Any = None, pass_fds: tuple[int, ...] = (),  # noqa: ANN401
        **options: Any,  # noqa: ANN401
    ) -> None:
        stdin, stdout = options.pop("stdin", None), options.pop("stdout", None)
        text, start_new_session = options.pop("text", False), options.pop("start_new_session", False)
        if options:
            raise TypeError(f"not supported in a scenario: {', '.join(sorted(options))}")
        module = arguments.index("-m") + 1
        name, parent = arguments[module], machine.here
        program = machine.programs[name]
        log = parent.stderr if parent is not None else None
        if stderr is not None and isinstance(getattr(stderr, "name", None), str):
            log = Path(stderr.name)
        self._machine = machine
        process = machine.start(name, lambda: program(arguments[module + 1 :]), parent=parent, stderr=log, begin=False)
        if parent is not None and not start_new_session:
            process.group = parent.group
        self.stdin = self.stdout = None
        if stdin == subprocess.PIPE:
            theirs, ours = pipe(machine.kernel)
            process.stdin = machine.descriptor(theirs, process)
            self.stdin = Writer(machine, machine.descriptor(ours, parent))
        if stdout == subprocess.PIPE:
            ours, theirs = pipe(machine.kernel)
            process.stdout = machine.descriptor(theirs, process)
            self.stdout = Reader(machine, machine.descriptor(ours, parent), text=text)
        for number in pass_fds:
            machine.copy(number, process)
        self.process = process
        self.pid = process.pid
        process.main = machine.kernel.spawn("MainThread", process, process.begin, BEGINS_NS)

    @property
    def returncode(self) -> int | None:
        """The exit code, once it has ended."""
        return self.process.exit_code

    def poll(self) -> int | None:
        """The exit code, None while it runs."""
        return self.process.exit_code

    def wait(self, timeout: float | None = None) -> int:
        """Wait for its end.

        Raises:
            TimeoutExpired: it has not ended in time.
        """
        until_ns = self.process.ended.until(timeout)
        while self.process.exit_code is None:
            if until_ns is not None and self._machine.kernel.now_ns >= until_ns:
                raise subprocess.TimeoutExpired(self.process.name, timeout or 0.0)
            self.process.ended.wait(until_ns)
        return self.process.exit_code

    def send_signal(self, number: int) -> None:
        """Send it a signal."""
        self._machine.signal(self.process, number)

    def terminate(self) -> None:
        """SIGTERM."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """SIGKILL."""
        self.send_signal(signal.SIGKILL)

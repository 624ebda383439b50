"""Programs of this project that have loaded their modules before they are needed, for runs that follow each other.

The other end is `python -m drivers.prepared FD TITLE MODULE [TEXT...]`. TITLE names the program in messages about the
process, which has the arguments of its program on no command line. The process imports MODULE, calls its
`load_in_advance(TEXT...)` if it has one, and waits. Until a message arrives on the socket FD, it has no file, lock or
device. The message, {"arguments": [...], "replace": [...]}, comes with open descriptors: the first ones replace its own
descriptors with the numbers in `replace`; the others (locks) stay open for as long as it lives. Then
`MODULE.main(arguments)` runs and returns the exit code. If the socket ends without a message, the process ends.

Each process runs once. A process that has run is never used again: what it left behind could reach the next run.
"""

from __future__ import annotations

import importlib
import json
import os
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from typing import IO, Any

from drivers.processes import PREPARED, own_program

LONGEST_MESSAGE = 1 << 16
MOST_DESCRIPTORS = 64


class Prepared:
    """One process of a program that waits for its arguments.

    Its standard input and output are pipes, unless other ones are passed to `start`.

    Args:
        module: the module of the program.
        early: passed to its `load_in_advance`.
        title: name of the program in messages to users; empty: the module.
    """

    def __init__(self, module: str, early: Sequence[str] = (), title: str = "") -> None:
        self._program = (title or module, module, *early)
        self._waiting: tuple[subprocess.Popen[bytes], socket.socket] | None = None

    def prepare(self) -> None:
        """Start the process that loads the program; nothing if one waits already."""
        if self._waiting is not None and self._waiting[0].poll() is None:
            return
        self.close()
        own, other = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with other:
            process = subprocess.Popen(
                own_program(PREPARED, str(other.fileno()), *self._program), stdin=subprocess.PIPE,
                stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True, pass_fds=(other.fileno(),),
            )
        self._waiting = process, own

    def start(
        self, arguments: Sequence[str], replaced: Mapping[int, int], inherited: Sequence[int] = ()
    ) -> subprocess.Popen[bytes] | None:
        """Run the program in the process that waits.

        Args:
            arguments: of the program.
            replaced: number of a descriptor of the process -> descriptor of this process that takes its place.
            inherited: further descriptors that the process keeps open.

        Returns:
            The process; None if none waits: the caller starts the program as usual.
        """
        if self._waiting is None:
            return None
        (process, line), self._waiting = self._waiting, None
        message = json.dumps({"arguments": list(arguments), "replace": list(replaced)}).encode()
        with line:
            try:
                socket.send_fds(line, [message], [*replaced.values(), *inherited])
            except OSError:  # it has ended meanwhile, or the message is too long
                _end(process)
                return None
        for number, pipe in enumerate((process.stdin, process.stdout)):
            if number in replaced and pipe is not None:
                pipe.close()
        return process

    def close(self) -> None:
        """End the process that waits."""
        if self._waiting is not None:
            (process, line), self._waiting = self._waiting, None
            line.close()
            _end(process)


def start_program(
    module: str, arguments: Sequence[str], files: Mapping[int, IO[Any]], inherited: Sequence[int] = (), *,
    prepared: Prepared | None,
) -> subprocess.Popen[bytes]:
    """Start a program of this project, in the process that was loaded in advance, if there is one.

    It has a session of its own; its standard input and output are pipes, unless `files` has others.

    Args:
        module: its module, as for `python -m`.
        arguments: of the program.
        files: number of a descriptor of the process (0, 1, 2) -> file that takes its place.
        inherited: further descriptors that the process keeps open.
        prepared: a process of this program that may wait; None: the program is loaded now.

    Raises:
        OSError: the process cannot be started.
    """
    if prepared is not None:
        replaced = {number: file.fileno() for number, file in files.items()}
        if (loaded := prepared.start(arguments, replaced, inherited)) is not None:
            return loaded
    return subprocess.Popen(
        own_program(module, *arguments), stdin=files.get(0, subprocess.PIPE), stdout=files.get(1, subprocess.PIPE),
        stderr=files.get(2, subprocess.DEVNULL), start_new_session=True, pass_fds=inherited,
    )


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()  # it has no device
    process.wait()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            pipe.close()


def wait(descriptor: int, module: str, *early: str) -> int:
    """Load a program, wait for its arguments, and run it; returns its exit code."""
    program = importlib.import_module(module)
    getattr(program, "load_in_advance", lambda: None)(*early)
    with socket.socket(fileno=descriptor) as line:
        message, received, _, _ = socket.recv_fds(line, LONGEST_MESSAGE, MOST_DESCRIPTORS)
    if not message:
        return 0
    request = json.loads(message)
    for number, given in zip(request["replace"], received, strict=False):
        os.dup2(given, number)
        os.close(given)
    code: int = program.main(request["arguments"])
    return code


if __name__ == "__main__":
    sys.exit(wait(int(sys.argv[1]), *sys.argv[3:]))

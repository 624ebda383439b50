"""What `os`, `time`, `select`, `subprocess` ... are to production code while a world is installed.

The project's modules find these in place of the real ones; the modules themselves are not changed. What a world has no
counterpart for cannot be used in it and says so: nothing waits for real time by accident.
"""

from __future__ import annotations

import concurrent.futures
import errno
import fcntl as real_fcntl
import gc
import io
import mmap
import os as real_os
import queue as real_queue
import resource
import secrets
import select
import shutil
import signal as real_signal
import socket
import subprocess as real_subprocess
import sys as real_sys
import threading
import time
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from drivers import plugins
from simulators.scenarios import futures, threads
from simulators.scenarios.kernel import Kernel
from simulators.scenarios.machine import Machine, Process
from simulators.scenarios.programs import Popen, Reader, Writer
from simulators.scenarios.streams import pipe

LOCK_AGAIN_NS = 5_000_000
ROOM = 1 << 40
"""Bytes of a world's disk; it is full when it says so."""
WALL_TIME = vars(time)["time"]


class NoCounterpart(AttributeError):
    """Production code uses something of the machine that a world does not have."""


class StubModule:
    """Stands for a module: what a world has of it, and what is the same everywhere."""

    def __init__(self, name: str, own: Mapping[str, object], real: object = None, same: str = "") -> None:
        self.__dict__.update(own)
        self._name, self._real, self._same = name, real, frozenset(same.split())

    def __getattr__(self, name: str) -> object:
        if self._real is not None and (name in self._same or name.isupper() or name[:3] in {"SIG", "LOC"}):
            return self.__dict__.setdefault(name, getattr(self._real, name))
        raise NoCounterpart(f"{self._name}.{name} is not supported in a scenario")


SAME_OS = """
path sep strerror stat fstat lstat statvfs environ getuid PathLike fspath cpu_count sysconf pread lseek fchmod truncate
uname name fsdecode fsencode stat_result rmdir access readlink sched_getaffinity chmod supports_follow_symlinks
supports_fd supports_dir_fd getcwd utime DirEntry curdir pardir devnull error symlink getgroups"""


class Files:
    """The functions of `os` for files."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._disk = machine.disk

    def open(self, path: Any, flags: int, mode: int = 0o777, **named: Any) -> int:  # noqa: ANN401
        """`os.open`."""
        here = self._machine.here
        if here is None:
            return real_os.open(path, flags, mode, **named)
        writes = bool(flags & (real_os.O_WRONLY | real_os.O_RDWR)) and self._disk.watches(path)
        made = writes and not real_os.path.exists(path)
        if made:
            self._disk.make(path)
        number = real_os.open(path, flags & ~real_os.O_TRUNC if writes else flags, mode, **named)
        here.descriptors.add(number)
        if writes:
            self._disk.opened(path, made=made, handle=number)
        if writes and flags & real_os.O_TRUNC:
            self.ftruncate(number, 0)
        return number

    def file(self, path: Any, mode: str = "r", *given: Any, **named: Any) -> Any:  # noqa: ANN401
        """`io.open`: of what is written to it only the file's name and end are watched."""
        here, writes = self._machine.here, not set(mode).isdisjoint("wax+") and self._disk.watches(path)
        made = writes and here is not None and not real_os.path.exists(path)
        if made:
            self._disk.make(path)
        opened = io.open(path, mode, *given, **named)  # noqa: SIM115, UP020 - the caller closes it
        if made:
            self._disk.opened(path, made=True)
        return opened

    def pwrite(self, handle: int, data: Any, offset: int) -> int:  # noqa: ANN401
        """`os.pwrite`."""
        self._machine.kernel.system_call()
        view = memoryview(data).cast("B")
        size = self._disk.write(handle, len(view))
        self._disk.changes(handle, offset, offset + size)
        return real_os.pwrite(handle, view[:size], offset)

    def posix_fallocate(self, handle: int, offset: int, size: int) -> None:
        """`os.posix_fallocate`."""
        self._disk.write(handle, 1)
        if offset + size > real_os.fstat(handle).st_size:
            self.ftruncate(handle, offset + size)  # a world's disk is full when it says so

    def ftruncate(self, handle: int, size: int) -> None:
        """`os.ftruncate`."""
        before = real_os.fstat(handle).st_size
        self._disk.changes(handle, min(size, before), max(size, before))
        real_os.ftruncate(handle, size)

    def fsync(self, handle: int) -> None:
        """`os.fsync`."""
        self._disk.flush(handle)

    def replace(self, old: Any, new: Any) -> None:  # noqa: ANN401
        """`os.replace`."""
        if self._machine.here is not None:
            self._machine.kernel.system_call()
            self._disk.make(new)
            self._disk.replaces(Path(old), Path(new))
        real_os.replace(old, new)

    def unlink(self, path: Any) -> None:  # noqa: ANN401
        """`os.unlink`."""
        if self._machine.here is not None:
            self._machine.kernel.system_call()
            self._disk.removes(Path(path))
        real_os.unlink(path)

    def mkdir(self, path: Any, mode: int = 0o777) -> None:  # noqa: ANN401
        """`os.mkdir`."""
        if self._machine.here is not None:
            self._disk.make(path)
        real_os.mkdir(path, mode)

    @staticmethod
    def listdir(path: Any = ".") -> list[Any]:  # noqa: ANN401
        """`os.listdir`, in an order that does not depend on the file system."""
        return sorted(real_os.listdir(path))

    @staticmethod
    def scandir(path: Any = ".") -> Scanned:  # noqa: ANN401
        """`os.scandir`, in the same order."""
        with real_os.scandir(path) as entries:
            return Scanned(sorted(entries, key=lambda entry: entry.name))

    def link(self, old: Any, new: Any, **named: Any) -> None:  # noqa: ANN401
        """`os.link`."""
        if self._machine.here is not None:
            self._disk.make(new)
        real_os.link(old, new, **named)
        if self._machine.here is not None:
            self._disk.links(Path(new))


class Scanned:
    """What `os.scandir` gives."""

    def __init__(self, entries: list[Any]) -> None:
        self._entries = iter(entries)

    def __iter__(self) -> Iterator[Any]:
        return self._entries

    def __enter__(self) -> Scanned:
        return self

    def __exit__(self, *_: object) -> None:
        pass


def stubs(machine: Machine) -> dict[int, object]:
    """By the identity of the real module, class or function: what stands for it."""
    kernel = machine.kernel
    pairs: list[tuple[object, object]] = [
        (real_os, _operating_system(machine)),
        (time, _time(machine)),
        (threading, _threading(machine)),
        (real_queue, _queue(kernel)),
        (select, StubModule("select", {"select": machine.select})),
        (socket, StubModule("socket", {"create_connection": machine.connect}, socket, "socket getaddrinfo inet_aton")),
        (real_subprocess, _subprocess(machine)),
        (real_signal, StubModule("signal", {"signal": partial(_handle, machine)}, real_signal, "Signals")),
        (real_fcntl, StubModule("fcntl", {"flock": partial(_flock, machine)}, real_fcntl, "ioctl")),
        (secrets, _secrets(machine)),
        (gc, StubModule("gc", {"collect": lambda: 0, "freeze": lambda: None})),
        (resource, StubModule("resource", {"setrlimit": lambda *_: None}, resource, "getrlimit")),
        (real_sys, System(machine)),
        (concurrent.futures.ThreadPoolExecutor, partial(futures.ThreadPoolExecutor, kernel)),
        (concurrent.futures.Future, partial(futures.Future, kernel)),
        (concurrent.futures.wait, futures.wait_for_futures),
        (WALL_TIME, machine.wall_s),
        (shutil, StubModule("shutil", {"disk_usage": lambda _: SimpleNamespace(free=ROOM)}, shutil, "rmtree")),
        (mmap, StubModule("mmap", {"mmap": _mapped}, mmap)),
        (io, StubModule("io", {"open": Files(machine).file}, io, "text_encoding")),
    ]
    return {id(real): stand for real, stand in pairs}


def _operating_system(machine: Machine) -> StubModule:
    files = Files(machine)
    own = {
        "open": files.open, "pwrite": files.pwrite, "posix_fallocate": files.posix_fallocate, "fsync": files.fsync,
        "fdatasync": files.fsync, "replace": files.replace, "rename": files.replace, "unlink": files.unlink,
        "remove": files.unlink, "mkdir": files.mkdir, "link": files.link,
        "ftruncate": files.ftruncate, "listdir": files.listdir, "scandir": files.scandir,
        "close": machine.close, "read": machine.read, "write": machine.write,
        "dup": lambda number: machine.copy(number, machine.here),
        "dup2": lambda _old, new, **_named: new, "pipe": lambda: tuple(_pipe(machine)),
        "fdopen": partial(_fdopen, machine), "set_blocking": machine.set_blocking,
        "getpid": lambda: machine.here.pid if machine.here else real_os.getpid(),
        "getppid": lambda: _parent(machine.here),
        "kill": partial(_kill, machine), "killpg": partial(_kill, machine, group=True), "nice": lambda step: step,
    }  # fmt: skip
    return StubModule("os", own, real_os, SAME_OS)


def _fdopen(machine: Machine, number: int, mode: str = "r", *given: Any, **named: Any) -> Any:  # noqa: ANN401
    """`os.fdopen`: a file that is read is a real one, with a descriptor of its own; another one is written here."""
    if mode not in {"r", "rb"}:
        return Writer(machine, number)
    copied = real_os.dup(number)
    machine.close(number)
    return real_os.fdopen(copied, mode, *given, **named)


def _time(machine: Machine) -> StubModule:
    kernel = machine.kernel

    def clock_ns(clock: int) -> int:
        return kernel.clock_ns() + (machine.suspended_ns if clock == time.CLOCK_BOOTTIME else 0)

    own = {
        "monotonic_ns": kernel.clock_ns, "monotonic": kernel.clock_s, "perf_counter": kernel.clock_s,
        "perf_counter_ns": kernel.clock_ns, "time": machine.wall_s, "clock_gettime_ns": clock_ns,
        "sleep": lambda length_s: kernel.sleep_ns(int(length_s * 1e9)),
        "gmtime": lambda at_s=None: time.gmtime(machine.wall_s() if at_s is None else at_s),
        "strftime": lambda form, at=None: time.strftime(form, time.gmtime(machine.wall_s()) if at is None else at),
    }  # fmt: skip
    return StubModule("time", own, time)


def _threading(machine: Machine) -> StubModule:
    kernel, main, other = machine.kernel, SimpleNamespace(name="MainThread"), SimpleNamespace(name="thread")
    own: dict[str, object] = {
        name: partial(getattr(threads, name), kernel) for name in ("Thread", "Lock", "RLock", "Condition", "Event")
    }
    own["main_thread"] = lambda: main
    own["current_thread"] = lambda: main if machine.here and kernel.thread is machine.here.main else other
    return StubModule("threading", own)


def _queue(kernel: Kernel) -> StubModule:
    own: dict[str, object] = dict.fromkeys(("Queue", "SimpleQueue"), partial(threads.Queue, kernel))
    return StubModule("queue", own, real_queue, "Empty Full")


def _subprocess(machine: Machine) -> StubModule:
    return StubModule("subprocess", {"Popen": partial(Popen, machine)}, real_subprocess, "PIPE DEVNULL TimeoutExpired")


def _secrets(machine: Machine) -> StubModule:
    chance = machine.chance
    return StubModule("secrets", {
        "randbelow": chance.randrange, "token_hex": lambda size: f"{chance.getrandbits(8 * size):0{2 * size}x}",
    })


def _kill(machine: Machine, pid: int, number: int, *, group: bool = False) -> None:
    reached = [
        process for process in machine.processes.values()
        if process.alive and (process.group if group else process.pid) == pid
    ]
    if not reached:
        raise ProcessLookupError(errno.ESRCH, "No such process")
    for process in reached if number else ():
        machine.signal(process, number)


def _pipe(machine: Machine) -> Iterator[int]:
    return (machine.descriptor(end, machine.here) for end in pipe(machine.kernel))


def _parent(process: Process | None) -> int:
    return process.parent.pid if process is not None and process.parent is not None and process.parent.alive else 1


def _handle(machine: Machine, number: int, handler: Any) -> Any:  # noqa: ANN401
    process = machine.here
    if process is None:
        return None
    default = real_signal.default_int_handler if number == real_signal.SIGINT else real_signal.SIG_DFL
    before = process.handlers.get(int(number), default)
    process.handlers[int(number)] = handler
    return before


def _mapped(handle: int, *given: Any, **named: Any) -> mmap.mmap:  # noqa: ANN401
    """`mmap.mmap` of the file in a way that a killed process leaves no lock behind: the map keeps its file open."""
    access = real_fcntl.fcntl(handle, real_fcntl.F_GETFL) & (real_os.O_RDWR | real_os.O_WRONLY)
    again = real_os.open(f"/proc/self/fd/{handle}", access)
    with real_os.fdopen(again, "rb", buffering=0):
        return mmap.mmap(again, *given, **named)


def _flock(machine: Machine, handle: int, way: int) -> None:
    if machine.here is not None and handle in machine.here.descriptors:
        machine.kernel.system_call()  # another one would not be closed at its death
    while True:
        try:
            real_fcntl.flock(handle, way | real_fcntl.LOCK_NB)
            return
        except BlockingIOError:
            if way & real_fcntl.LOCK_NB:
                raise
        machine.kernel.sleep_ns(LOCK_AGAIN_NS)


class System:
    """`sys`, with the standard streams of the process that asks."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine

    def __getattr__(self, name: str) -> object:
        process = self._machine.here
        if process is not None and name == "stdin":
            process.files.setdefault(name, Reader(self._machine, process.stdin, text=True))
            return process.files[name]
        if process is not None and name == "stdout":
            process.files.setdefault(name, Writer(self._machine, process.stdout))
            return process.files[name]
        if process is not None and name == "stderr":
            return ErrorStream(process)
        return getattr(real_sys, name)


class ErrorStream(io.TextIOBase):
    """The standard error of a process."""

    def __init__(self, process: Process) -> None:
        super().__init__()
        self._process = process

    def write(self, text: str) -> int:
        """Write."""
        self._process.write_error(text)
        return len(text)

    def fileno(self) -> int:
        """Its descriptor."""
        return 2


PLACES = ("rig", "drivers", "protocols", "simulators")
ALSO = ("can.bus", "can.interfaces.slcan", "pathlib", "pathlib._local")
"""Other people's modules that look at the clock, or at files for us."""
FOR_US = dict.fromkeys(("pathlib", "pathlib._local"), (real_os, io))
"""Modules of which only some names are replaced. In Python 3.13, paths are in a separate module."""


def _is_for(module: str, value: object) -> bool:
    """Whether a module finds the world's counterpart; files opened through `io` are watched for `pathlib` only."""
    return any(value is one for one in FOR_US[module]) if module in FOR_US else value is not io


REAL = ("simulators.scenarios", "rig.jobs", "rig.dampers.compiled_cache")
"""Modules that keep the real operating system: compiling is not part of a scenario."""


class Installed:
    """While entered, the project's modules find a world's machine in place of the real one."""

    def __init__(self, machine: Machine) -> None:
        self._stubs = stubs(machine)
        self._before: list[tuple[Any, str, object]] = []

    def put(self, module: Any, name: str, value: object) -> None:  # noqa: ANN401
        """Put one more thing in place, until the end."""
        self._before.append((module, name, getattr(module, name)))
        setattr(module, name, value)

    def stand_in(self, real: object) -> object:
        """The scenario's counterpart of a module, class or function that a third-party module uses."""
        return self._stubs[id(real)]

    def __enter__(self) -> Installed:
        for module_name, module in list(real_sys.modules.items()):
            place = module_name.partition(".")[0]
            if module is None or module_name.startswith(REAL):
                continue
            if place not in {*PLACES, *plugins.driver_packages()} and module_name not in ALSO:
                continue
            for name, value in list(vars(module).items()):
                stand = self._stubs.get(id(value))
                if stand is None or not _is_for(module_name, value):
                    continue
                self.put(module, name, stand)
        return self

    def __exit__(self, *_: object) -> None:
        for module, name, value in reversed(self._before):
            setattr(module, name, value)
        self._before.clear()

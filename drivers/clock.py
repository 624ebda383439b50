"""Host time for control: integer nanoseconds, monotonic; the machine's own, or one that a simulated rig shares.

A real rig does not wait for its host, so its host's time is `time.monotonic_ns`. A simulated rig's clock waits: it
pauses while a process that must watch the rig has not had its turn on the processor. Such a rig keeps its clock in a
file and names the file in the bench file that it writes; the processes that watch it apply every time limit to it.
So no limit is exceeded because the computer is busy, and none is wider for a process that hangs, is stopped or is dead:
the rig does not wait for those.

    offset  size  header
       0      8   magic "RIGCLOCK"
       8      4   process id of the simulated rig u32; it holds an exclusive lock on the file while it lives
      16      8   sequence: odd while the three numbers below are being written
      24      8   rig's clock, ns
      32      8   the machine's clock at that moment, ns
      40      8   how far the rig's clock may run on from there, ns; 0 while it pauses
     256     16   for each `Role`: process id, when it must have run again (rig's clock, ns)
    1024      4   bytes of the addresses u32, then the rig's own addresses, one a line (UTF-8)

What changes while others read it is an i64 at a multiple of 8, written as one word of the machine (`words`). `struct`
first clears the bytes: a reader then saw a clock of 0, took its rig for one that hangs, and no longer waited for it.
"""

from __future__ import annotations

import mmap
import os
import struct
import threading
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from enum import Enum, IntEnum, auto
from pathlib import Path

from drivers.posix import fcntl
from drivers.processes import stat_fields

MAGIC = b"RIGCLOCK"
SIZE = 1 << 16
OFFSET_PID, OFFSET_ADDRESSES = 8, 1024
NUMBER = struct.Struct("<I")
SEQUENCE, CLOCK, MACHINE, AHEAD, ROLES = 2, 3, 4, 5, 32
"""Words of the file, see `words`; from `ROLES` on two for each role: process id, and when it must have run again."""
NEVER_NS = (1 << 63) - 1
LOOK_NS = 50_000_000
"""A rig that has not written its clock for so long is looked at: it may have been stopped or killed."""
LONGEST_SILENCE_NS = 60_000_000_000
"""A rig that runs and has not written its clock for so long hangs."""
TRIES = 20


class Role(IntEnum):
    """Which process of the host waits for its turn; `SETPOINTS`: the station's stream of set-points, by its grid.

    `STEPS`: the station's current program, by the time of its next step.
    """

    APPLICATION = 0
    STATION = 1
    SETPOINTS = 2
    STEPS = 3


def words(file: mmap.mmap) -> memoryview:
    """The file as words of 8 bytes; each is read and written as a whole."""
    return memoryview(file).cast("q")


class ClockRefused(ValueError):
    """A shared clock is not that of a simulated rig that serves every address of the bench."""


class SharedClock:
    """A simulated rig's clock as the host's processes read it.

    Args (construction):
        path: its file.
        role: which of the host's processes this is; None: one that only reads the time.

    Raises:
        ClockRefused: the file is not a clock, or the rig that wrote it does not live.
    """

    def __init__(self, path: Path, role: Role | None) -> None:
        try:
            handle = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_CLOEXEC)
        except OSError as error:
            raise ClockRefused(
                f"{path}: the simulated rig's clock cannot be opened: {error.strerror}. Fix: start the simulated "
                "rig on this computer, or remove shared from [clock]"
            ) from error
        try:
            if os.fstat(handle).st_size != SIZE or os.pread(handle, len(MAGIC), 0) != MAGIC:
                raise ClockRefused(f"{path}: this file is not the clock of a simulated rig")
            if not _locked(handle):
                raise ClockRefused(f"{path}: the simulated rig that owns this clock has ended. Fix: start the "
                    "simulated rig again")
            self._map = mmap.mmap(handle, SIZE)
            self._words = words(self._map)
        finally:
            os.close(handle)
        self._rig = NUMBER.unpack_from(self._map, OFFSET_PID)[0]
        self._role = role
        self._dues: dict[int, int] = {}
        self._last_ns = 0
        self._looked_ns = 0
        self._detached_ns: int | None = None

    @property
    def addresses(self) -> frozenset[str]:
        """Where the rig's own devices are."""
        (size,) = NUMBER.unpack_from(self._map, OFFSET_ADDRESSES)
        begin = OFFSET_ADDRESSES + NUMBER.size
        return frozenset(bytes(self._map[begin : begin + size]).decode("utf-8").splitlines())

    def now_ns(self) -> int:
        """The rig's clock (ns); it runs like the machine's once the rig has ended, was stopped or hangs."""
        machine_ns = time.monotonic_ns()
        if self._detached_ns is not None:
            return machine_ns + self._detached_ns
        rig_ns, at_ns, ahead_ns = self._read()
        since_ns = max(0, machine_ns - at_ns)
        now_ns = max(self._last_ns, rig_ns + min(since_ns, ahead_ns))
        self._last_ns = now_ns
        if since_ns > LOOK_NS and machine_ns - self._looked_ns > LOOK_NS:
            self._looked_ns = machine_ns
            if since_ns > LONGEST_SILENCE_NS or not running(self._rig):
                self._detached_ns = now_ns - machine_ns
        return now_ns

    def due(self, thread: int, at_ns: int | None) -> None:
        """A thread must have run again by `at_ns`; None: it waits for something that no clock brings."""
        if self._role is None:
            return
        if at_ns is None:
            self._dues.pop(thread, None)
        else:
            self._dues[thread] = at_ns
        first_ns = min(list(self._dues.values()), default=NEVER_NS)
        self._state(self._role, os.getpid(), first_ns)

    def setpoint_due(self, at_ns: int | None, role: Role = Role.SETPOINTS) -> None:
        """The station must send its next set-point at `at_ns`; None: no motion is streamed, no program is followed."""
        if self._role is Role.STATION:
            self._state(role, os.getpid(), NEVER_NS if at_ns is None else at_ns)

    def close(self) -> None:
        """Let the rig's clock go on without this process."""
        self.setpoint_due(None)
        self.setpoint_due(None, Role.STEPS)
        if self._role is not None:
            self._state(self._role, 0, NEVER_NS)

    def _state(self, role: Role, process: int, due_ns: int) -> None:
        place = ROLES + 2 * role
        self._words[place + 1] = due_ns
        self._words[place] = process

    def leave(self) -> None:
        """The same, and the time goes on from here as the machine's does."""
        self._detached_ns = self.now_ns() - time.monotonic_ns()
        self.close()
        self._role = None

    def _read(self) -> tuple[int, int, int]:
        file = self._words
        for _ in range(TRIES):
            before = file[SEQUENCE]
            numbers = file[CLOCK], file[MACHINE], file[AHEAD]
            if before % 2 == 0 and file[SEQUENCE] == before:
                return numbers
        return self._last_ns, time.monotonic_ns(), 0  # the rig was held up while it wrote


class ProcessState(Enum):
    """What a process does, however rarely it has its turn."""

    RUNNING = auto()
    STOPPED = auto()
    """By SIGSTOP or a debugger."""
    DEAD = auto()


def process_state(process: int) -> ProcessState:
    """What a process does; where the system does not show it, one that lives counts as running."""
    fields = stat_fields(process)
    if fields is None:
        lives = not Path("/proc/self/stat").exists() and _lives(process)
        return ProcessState.RUNNING if lives else ProcessState.DEAD
    shown = fields[0]
    if shown in b"ZXx":
        return ProcessState.DEAD
    return ProcessState.STOPPED if shown in b"Tt" else ProcessState.RUNNING


def running(process: int) -> bool:
    """Whether a process lives and is not stopped."""
    return process_state(process) is ProcessState.RUNNING


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _locked(handle: int) -> bool:
    """Another process holds the file's lock."""
    try:
        fcntl.flock(handle, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    return False


_shared: SharedClock | None = None


def follow(path: str, role: Role | None, addresses: Collection[str] | None = None) -> None:
    """Read the time from the clock of a simulated rig from now on; an empty path: from the machine's own.

    Args:
        path: the clock's file, as the rig's bench file names it.
        role: which of the host's processes this is; None: one for which the rig's clock does not wait.
        addresses: of every device that this host watches; each must be one of that rig's own, so that no limit of a
            real device is ever judged by a clock that waits. None: none is watched.

    Raises:
        ClockRefused: no simulated rig keeps this clock, or a device is not one of its own.
    """
    global _shared
    clock = SharedClock(Path(path), role) if path else None
    if clock is not None and addresses is not None:
        unknown = sorted(set(addresses) - clock.addresses)
        if unknown:
            raise ClockRefused(
                f"clock.shared: {unknown[0]} is not a device of the simulated rig that owns {path}; time limits of "
                "other devices are checked with this computer's clock. Fix: remove shared from [clock]"
            )
    if _shared is not None:
        _shared.close()
    _shared = clock


@contextmanager
def restored() -> Iterator[None]:
    """The process reads the time from the same clock after the block as before it, whatever was followed in it."""
    global _shared
    before = _shared
    try:
        yield
    finally:
        if _shared is not None and _shared is not before:
            _shared.close()
        _shared = before


def leave() -> None:
    """The rig is watched no longer: time goes on from where its clock is, as the machine's does."""
    if _shared is not None:
        _shared.leave()


def monotonic_ns() -> int:
    """Host time for control, ages and time-outs (ns); never steps."""
    shared = _shared
    return time.monotonic_ns() if shared is None else shared.now_ns()


def monotonic() -> float:
    """The same in seconds."""
    return time.monotonic() if _shared is None else monotonic_ns() * 1e-9


def elapsed_ns() -> int:
    """The same, going on while the machine is suspended (ns), as a device does."""
    if _shared is None and hasattr(time, "CLOCK_BOOTTIME"):
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    return monotonic_ns()


def back_within(timeout_s: float) -> None:
    """This thread begins to wait and must run again within `timeout_s`: a clock that waits, waits for it."""
    shared = _shared
    if shared is not None and timeout_s > 0.0:
        shared.due(threading.get_ident(), shared.now_ns() + int(1e9 * timeout_s))


def back_whenever() -> None:
    """This thread ends, or waits for something that time alone does not bring."""
    shared = _shared
    if shared is not None:
        shared.due(threading.get_ident(), None)


def setpoint_due(at_ns: int | None) -> None:
    """The next set-point of a streamed motion is due then (ns); None: no motion is streamed.

    Unlike `back_within` it holds while the answer to the last one is awaited: a set-point that is left out is another
    motion, whichever process had no turn.
    """
    shared = _shared
    if shared is not None:
        shared.setpoint_due(at_ns)


def step_due(at_ns: int | None) -> None:
    """The next step of a current program is due then (ns); None: no program is followed.

    The clock does not pass it: the rod goes on moving, and a step that comes late is a step at another place.
    """
    shared = _shared
    if shared is not None:
        shared.setpoint_due(at_ns, Role.STEPS)

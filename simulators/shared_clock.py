"""The simulated rig's own clock, which waits for the host; written for the processes that watch the rig.

`drivers.clock` has the file's layout and the reading end.
"""

from __future__ import annotations

import fcntl
import mmap
import os
from collections.abc import Iterable
from pathlib import Path

from drivers.clock import (
    AHEAD,
    CLOCK,
    MACHINE,
    MAGIC,
    NEVER_NS,
    NUMBER,
    OFFSET_ADDRESSES,
    OFFSET_PID,
    ROLES,
    SEQUENCE,
    SIZE,
    ProcessState,
    Role,
    process_state,
    running,
    words,
)

AHEAD_NS, AHEAD_FAST_NS = 5_000_000, 3_000_000
"""The clock runs on by itself for so long; then this process must have had its turn again."""
LATE_NS, LATE_FAST_NS = 5_000_000, 1_000_000
"""A thread of the host may be so late before the clock waits for it; above speed 1 more of the rig's motion passes."""
SETPOINT_LATE_NS = 400_000
"""A set-point of a streamed motion may be so late: what the plan counts on (`rig.matrix.streaming.JITTER_S`)."""
EXACT = frozenset({Role.SETPOINTS, Role.STEPS})
"""Set-points, and steps of a current program, which may be as late."""
LONGEST_WAIT_NS = 60_000_000_000
"""A process that has not had its turn for so long (wall time) hangs."""
LOOK_NS = 20_000_000
"""While the clock waits, it is looked so often what the host's processes do."""
HANGS_S = 0.5
"""A process of which no thread wants the processor, looked at for so long, waits for something else than its turn."""
STOPPED_S = 5.0
"""A process that is stopped for longer (SIGSTOP, a debugger) is no slow one; a shorter stop is what load looks like."""
WANTS_PROCESSOR = b"RD"


class Follower:
    """A process of the host that watches the rig.

    Args (construction):
        process: its id.
        allowed_ns: how late its threads may be.
    """

    def __init__(self, process: int, allowed_ns: int) -> None:
        self.process = process
        self._allowed_ns = allowed_ns
        self.late_ns = 0
        """Since when it has been late, by the machine's clock; 0 while it is not."""
        self._due_ns = self._looked_ns = 0
        self._stopped_ns = 0
        self._idle_s = 0.0
        self._given_up = False

    def waits(self, due_ns: int, rig_ns: int, machine_ns: int) -> bool:
        """Whether the rig's clock must wait for it.

        Args:
            due_ns: when one of its threads must have run again (rig's clock).
            rig_ns: the rig's clock.
            machine_ns: the machine's.
        """
        in_time = rig_ns <= due_ns + self._allowed_ns
        if in_time or due_ns != self._due_ns:
            self._due_ns, self.late_ns, self._given_up = due_ns, 0, False
            self._idle_s, self._stopped_ns = 0.0, 0
        if in_time or self._given_up:
            return False
        if not self.late_ns:
            self.late_ns = self._looked_ns = machine_ns
        elif machine_ns - self._looked_ns >= LOOK_NS:
            # A look that comes late says nothing of the time before it.
            looked_s, self._looked_ns = 1e-9 * min(machine_ns - self._looked_ns, 2 * LOOK_NS), machine_ns
            state = process_state(self.process)
            stopped = state is ProcessState.STOPPED
            self._stopped_ns = (self._stopped_ns or machine_ns) if stopped else 0
            if not stopped and not wants_processor(self.process):
                self._idle_s += looked_s
            hangs = self._idle_s > HANGS_S or machine_ns - self.late_ns > LONGEST_WAIT_NS
            # However seldom this process has its turn to look: a stopped one does not wait for the processor.
            for_good = stopped and machine_ns - self._stopped_ns > STOPPED_S * 1e9
            self._given_up = hangs or for_good or state is ProcessState.DEAD
        return not self._given_up


class SharedClock:
    """The clock's file.

    Args (construction):
        path: where it is made.
        addresses: of the rig's devices: no other may be judged by this clock.
        machine_ns: the machine's clock now, at which this one begins.
        fast: the rig is faster than life.

    Attributes:
        now_ns: the rig's clock.
        allowed_s: how late a thread of the host may be (s).

    Raises:
        OSError: the file cannot be made.
    """

    def __init__(self, path: Path, addresses: Iterable[str], machine_ns: int, *, fast: bool) -> None:
        self._handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o600)
        fcntl.flock(self._handle, fcntl.LOCK_EX)
        os.ftruncate(self._handle, SIZE)
        self._map = mmap.mmap(self._handle, SIZE)
        self._words = words(self._map)
        listed = "\n".join(addresses).encode("utf-8")
        NUMBER.pack_into(self._map, OFFSET_PID, os.getpid())
        NUMBER.pack_into(self._map, OFFSET_ADDRESSES, len(listed))
        begin = OFFSET_ADDRESSES + NUMBER.size
        self._map[begin : begin + len(listed)] = listed
        for role in Role:
            self._words[ROLES + 2 * role + 1] = NEVER_NS
        self.now_ns = self._began_ns = self._machine_ns = machine_ns
        self._ahead_ns = self._sequence = self._looked_ns = 0
        self._setpoint_ns = NEVER_NS
        self._busy = False
        self._longest_ns, self._allowed_ns = (AHEAD_FAST_NS, LATE_FAST_NS) if fast else (AHEAD_NS, LATE_NS)
        self.allowed_s = 1e-9 * self._allowed_ns
        self._followers: dict[Role, Follower] = {}
        self._write()
        self._map[: len(MAGIC)] = MAGIC

    def look(self, machine_ns: int, *, setpoints: bool = True) -> bool:
        """Bring the clock up to now; whether it must wait for a process of the host.

        Args:
            machine_ns: the machine's clock now.
            setpoints: whether it waits for streamed set-points; not while a fault holds up what carries them.
        """
        self.now_ns = self.at(machine_ns)
        self._machine_ns = machine_ns
        self._setpoint_ns = NEVER_NS
        late = False
        for role in Role:
            process, due_ns = self._words[ROLES + 2 * role], self._words[ROLES + 2 * role + 1]
            exact = role in EXACT
            allowed_ns = SETPOINT_LATE_NS if exact else self._allowed_ns
            follower = self._followers.get(role)
            if follower is None or follower.process != process:
                follower = self._followers[role] = Follower(process, allowed_ns)
            if process == 0 or (role is Role.SETPOINTS and not setpoints):
                continue
            waits = follower.waits(due_ns, self.now_ns, machine_ns)
            if exact and due_ns < NEVER_NS and (waits or self.now_ns <= due_ns + allowed_ns):
                self._setpoint_ns = min(self._setpoint_ns, due_ns + allowed_ns + 1)
            late |= waits
        return late

    def at(self, machine_ns: int) -> int:
        """The clock between two looks, as its readers see it (ns)."""
        return self.now_ns + min(max(0, machine_ns - self._machine_ns), self._ahead_ns)

    @property
    def elapsed_s(self) -> float:
        """What has passed of the clock since its begin (s)."""
        return 1e-9 * (self.now_ns - self._began_ns)

    def go_on(self, *, waiting: bool) -> None:
        """Let the clock pause from now on, or run."""
        # No farther than the next set-point: this process may have its next turn long after it was due.
        self._ahead_ns = 0 if waiting else max(0, min(self._longest_ns, self._setpoint_ns - self.now_ns))
        self._write()

    @property
    def watched(self) -> bool:
        """A process of the host watches the rig."""
        return any(one.process for one in self._followers.values())

    def busy(self, machine_ns: int) -> bool:
        """Whether a process of the host wants its turn on the processor; looked at every `LOOK_NS`."""
        if machine_ns - self._looked_ns > LOOK_NS:
            self._looked_ns = machine_ns
            self._busy = any(one.process and wants_processor(one.process) for one in self._followers.values())
        return self._busy

    def close(self) -> None:
        """From now on the host's time is its own again."""
        self._ahead_ns = NEVER_NS >> 1
        self._write()
        self._words.release()
        self._map.close()
        os.close(self._handle)

    def _write(self) -> None:
        file = self._words
        file[SEQUENCE] = self._sequence + 1
        file[CLOCK], file[MACHINE], file[AHEAD] = self.now_ns, self._machine_ns, self._ahead_ns
        self._sequence += 2
        file[SEQUENCE] = self._sequence


def wants_processor(process: int) -> bool:
    """Whether a thread of a process is ready to run, or waits for the disk; where that cannot be told it is."""
    try:
        threads = os.listdir(f"/proc/{process}/task")
    except OSError:
        return not os.path.exists("/proc/self/task") and running(process)
    for thread in threads:
        try:
            with open(f"/proc/{process}/task/{thread}/stat", "rb") as file:
                if file.read(512).rpartition(b")")[2].split()[0] in WANTS_PROCESSOR:
                    return True
        except (OSError, IndexError):
            continue  # it has just ended
    return False

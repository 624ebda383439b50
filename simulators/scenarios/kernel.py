"""Virtual time: tasks of simulated processes, one at a time, switched where they wait.

Every thread of every simulated process is a greenlet. It runs until it waits; then time jumps to the next thing that
can happen. How long a hand-over takes, which of two tasks that are due together goes first, and where a task is held up
between two system calls is drawn from the world's seed.
"""

from __future__ import annotations

import ctypes
import random
import traceback
from collections.abc import Callable
from heapq import heappop, heappush
from typing import Any

from greenlet import getcurrent, greenlet

CLOCK_STEP_NS = 200
"""Every look at the clock takes so long: a task that polls it reaches the end of its wait."""
HANDOVER_NS = (3_000, 40_000)
"""Between waking a task and its run."""
TIMER_LATE_NS = (10_000, 90_000)
"""By which a timer is late."""
STALLED_LOOK_NS = 2_000_000
"""How often a stalled process is looked at: it may go on earlier than was thought."""
HELD_UP_SHARE = 0.01
HELD_UP_NS = (20_000, 600_000)
"""How often a task is held up at a system call, as on a machine where others run, and for how long."""

class NothingHappens(Exception):
    """Every task waits for something that cannot come."""


def keep_for_ever(suspended: greenlet) -> None:
    """Never end a greenlet: to end one runs its `finally` blocks, and a killed process runs none.

    One reference too many, which is not released: neither the collector nor the interpreter's end reaches it.
    """
    ctypes.pythonapi.Py_IncRef(ctypes.py_object(suspended))


class Task:
    """One thread of one simulated process.

    Attributes:
        name: of the thread.
        process: whose it is; an object with `alive`, `stalled_ns` and `uncaught`.
        finished: it has returned, or its process is gone.
        daemon: its process does not wait for it.
        thread: the task itself; for a signal handler the task in whose place it runs.
        raises: what it is to raise where it waits.
    """

    __slots__ = (
        "daemon", "finished", "greenlet", "handlers", "held", "name", "notified", "on_finish", "process", "raises",
        "thread", "wait", "waiting", "woken",
    )  # fmt: skip

    def __init__(self, name: str, process: Any, run: Callable[[], None], hub: greenlet) -> None:  # noqa: ANN401
        self.name = name
        self.process = process
        self.finished = self.daemon = False
        self.waiting = self.woken = self.notified = False
        self.wait = 0
        self.thread: Task = self
        self.handlers = 0
        self.held: list[tuple[int, bool]] = []
        self.raises: BaseException | None = None
        self.on_finish: list[Callable[[], None]] = []
        self.greenlet = greenlet(run, hub)


class Kernel:
    """The scheduler of one world.

    Args:
        seed: what everything is drawn from.

    Attributes:
        now_ns: virtual time; begins a thousand seconds after the machine's start.
        chance: the world's random numbers for scheduling.
        switches: tasks resumed so far.
    """

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(f"kernel {seed}")
        self._random = self.chance.random
        self.start_ns = self.now_ns = 1_000_000_000_000
        self.switches = 0
        self.current: Task | None = None
        self.tasks: dict[Task, None] = {}
        self.trace: Callable[[Task], None] | None = None
        self._due: list[tuple[int, float, int, Task, int, bool]] = []
        self._order = 0
        self._hub = getcurrent()
        self._switch = self._hub.switch
        self.held_up = HELD_UP_SHARE

    # Time

    @property
    def time_s(self) -> float:
        """Seconds of virtual time since the world began."""
        return (self.now_ns - self.start_ns) * 1e-9

    def clock_ns(self) -> int:
        """What a process reads from the machine's monotonic clock (ns)."""
        self.now_ns += CLOCK_STEP_NS
        return self.now_ns

    def clock_s(self) -> float:
        """The same in seconds."""
        return self.clock_ns() * 1e-9

    # Tasks

    @property
    def thread(self) -> Task | None:
        """The thread that runs now; a signal handler is part of the thread that it interrupts."""
        return None if self.current is None else self.current.thread

    def spawn(self, name: str, process: Any, do: Callable[[], object], after_ns: int = 0) -> Task:  # noqa: ANN401
        """A new task that begins to run soon."""

        def run() -> None:
            try:
                if task.raises is not None:
                    raise task.raises
                do()
            except SystemExit:
                pass
            except BaseException:  # noqa: BLE001 - an uncaught error of a thread ends that thread and is told
                process.uncaught(name, traceback.format_exc())
            if task.process.alive:
                self._finish(task)

        task = Task(name, process, run, self._hub)
        self.tasks[task] = None
        task.waiting = True
        self._push(self.now_ns + after_ns + self._draw(HANDOVER_NS), task, woken=True)
        return task

    def interrupt(self, task: Task, do: Callable[[], object]) -> None:
        """Have a thread do something where it waits, as a signal handler: it waits on when that is done.

        What the handler raises is raised where the thread waits.
        """
        if task is self.thread:
            do()
            return

        def handle() -> None:
            try:
                do()
            except BaseException as error:  # noqa: BLE001 - handed on, whatever it is
                task.raises = error
                self._push(self.now_ns, task, woken=True)

        def go_on() -> None:
            task.handlers -= 1
            held, task.held = task.held, []
            for wait, woken in held:
                heappush(self._due, (self.now_ns, self.chance.random(), self._next(), task, wait, woken))

        handler = self.spawn(f"{task.name}, signal", task.process, handle)
        handler.thread = task
        handler.on_finish.append(go_on)
        task.handlers += 1

    def _finish(self, task: Task) -> None:
        task.finished = True
        self.tasks.pop(task, None)
        for call in task.on_finish:
            call()

    def abandon(self, task: Task) -> None:
        """Never run a task again: its process is gone."""
        if not task.finished:
            task.finished = True
            task.waiting = False
            task.wait += 1
            self.tasks.pop(task, None)
            keep_for_ever(task.greenlet)

    def block(self, until_ns: int | None = None) -> bool:
        """Yield until this task is woken, or until a time.

        Returns:
            Whether it was woken; False at the time-out.

        Raises:
            RuntimeError: not called by a task.
        """
        task = self.current
        if task is None:
            task = self.task()
        task.wait += 1
        task.waiting = True
        task.woken = task.notified = False
        if until_ns is not None:
            if until_ns > self.now_ns:
                self._push(until_ns + self._draw(TIMER_LATE_NS), task, woken=False)
            else:
                self._push(self.now_ns, task, woken=False)
        self._switch()
        if task.raises is not None:
            error, task.raises = task.raises, None
            raise error
        return task.woken

    def task(self) -> Task:
        """The task that runs now.

        Raises:
            RuntimeError: none does.
        """
        if self.current is None:
            raise RuntimeError("only a task of the scenario can wait")
        return self.current

    def wake(self, task: Task, at_ns: int | None = None) -> None:
        """Let a waiting task run soon, or at a time; nothing for one that does not wait."""
        if task.waiting:
            task.notified = task.notified or at_ns is None
            if at_ns is None or at_ns < self.now_ns:
                at_ns = self.now_ns
            self._push(at_ns + self._draw(HANDOVER_NS), task, woken=True)

    def sleep_ns(self, length_ns: int) -> None:
        """Let a time pass for this task."""
        until_ns = self.now_ns + max(0, length_ns)
        while self.block(until_ns) and self.now_ns < until_ns:
            pass

    def system_call(self) -> None:
        """Where a task may be held up: others run meanwhile."""
        if self.current is not None and self._random() < self.held_up:
            self.sleep_ns(self._draw(HELD_UP_NS))

    # The loop

    def run(self, until: Callable[[], bool]) -> None:
        """Let things happen until a condition holds; it is asked after every step.

        Raises:
            NothingHappens: nothing can happen any more.
            RuntimeError: called by a task.
        """
        if self.current is not None:
            raise RuntimeError("a scenario must be started from outside its tasks")
        due = self._due
        while not until():
            if not due:
                raise NothingHappens(", ".join(sorted(f"{task.process.name}:{task.name}" for task in self.tasks)))
            at_ns, _, _, task, wait, woken = heappop(due)
            if task.finished or not task.waiting or task.wait != wait:
                continue
            if task.process.stalled_ns > at_ns:
                again_ns = min(task.process.stalled_ns, at_ns + STALLED_LOOK_NS)
                heappush(due, (again_ns, self.chance.random(), self._next(), task, wait, woken))
                continue
            if task.notified and not woken:
                continue  # woken before its time-out; the hand-over is under way
            if at_ns > self.now_ns:
                self.now_ns = at_ns
            if task.handlers:
                task.held.append((wait, woken))
                continue
            task.waiting = False
            task.woken = woken
            self.switches += 1
            self.current = task
            if self.trace is not None:
                self.trace(task)
            task.greenlet.switch()
            self.current = None

    def _push(self, at_ns: int, task: Task, *, woken: bool) -> None:
        self._order += 1
        heappush(self._due, (at_ns, self._random(), self._order, task, task.wait, woken))

    def _next(self) -> int:
        self._order += 1
        return self._order

    def _draw(self, bounds: tuple[int, int]) -> int:
        low, high = bounds
        return low + int(self._random() * (high - low))

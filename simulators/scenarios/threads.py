"""`threading` and `queue` as a world has them: the parts that production code uses."""

from __future__ import annotations

import queue
from collections import deque
from collections.abc import Callable
from typing import Any

from simulators.scenarios.kernel import Kernel, Task


class Waiters:
    """Tasks that wait for one thing."""

    def __init__(self, kernel: Kernel) -> None:
        self.kernel = kernel
        self._tasks: deque[Task] = deque()

    def add(self, task: Task) -> None:
        """One more waits, perhaps for other things too."""
        self._tasks.append(task)

    def drop(self, task: Task) -> None:
        """It waits no more."""
        if task in self._tasks:
            self._tasks.remove(task)

    def wait(self, until_ns: int | None) -> bool:
        """Wait to be woken; False at the time-out.

        Raises:
            RuntimeError: not called by a task.
        """
        task = self.kernel.task()
        self.add(task)
        try:
            return self.kernel.block(until_ns)
        finally:
            self.drop(task)

    def wake(self, count: int | None = None, at_ns: int | None = None) -> None:
        """Wake so many, all without a number; soon, or at a time. Who was killed meanwhile is not counted."""
        if not self._tasks:
            return
        left = len(self._tasks) if count is None else count
        while self._tasks and left > 0:
            task = self._tasks.popleft()
            if not task.finished:
                self.kernel.wake(task, at_ns)
                left -= 1

    def until(self, timeout_s: float | None) -> int | None:
        """The time at which a wait ends."""
        return None if timeout_s is None else self.kernel.now_ns + int(max(0.0, timeout_s) * 1e9)


class Lock:
    """`threading.Lock`."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._waiters = Waiters(kernel)
        self._held = False

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        """Take it."""
        self._kernel.system_call()
        until_ns = self._waiters.until(None if timeout < 0 else timeout) if self._held else None
        while self._held:
            if not blocking or (until_ns is not None and self._kernel.now_ns >= until_ns):
                return False
            self._waiters.wait(until_ns)
        self._held = True
        return True

    def release(self) -> None:
        """Give it back.

        Raises:
            RuntimeError: it is not held.
        """
        if not self._held:
            raise RuntimeError("release unlocked lock")
        self._held = False
        self._waiters.wake(1)

    def locked(self) -> bool:
        """It is held."""
        return self._held

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


class RLock:
    """`threading.RLock`."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._lock = Lock(kernel)
        self._owner: object = None
        self._count = 0

    def acquire(self, blocking: bool = True, timeout: float = -1) -> bool:
        """Take it, again and again by one task."""
        me = self._kernel.thread
        if self.owned:
            self._count += 1
            return True
        if not self._lock.acquire(blocking, timeout):
            return False
        self._owner, self._count = me, 1
        return True

    @property
    def owned(self) -> bool:
        """The thread that asks holds it."""
        return self._count > 0 and self._owner is self._kernel.thread

    def release(self) -> None:
        """Give it back once.

        Raises:
            RuntimeError: this thread does not hold it.
        """
        if not self.owned:
            raise RuntimeError("cannot release un-acquired lock")
        self._count -= 1
        if not self._count:
            self._owner = None
            self._lock.release()

    def release_all(self) -> int:
        """Give it back entirely; how often it was held."""
        count, self._count, self._owner = self._count, 0, None
        self._lock.release()
        return count

    def take_again(self, count: int) -> None:
        """Hold it as often as before `release_all`."""
        self._lock.acquire()
        self._owner, self._count = self._kernel.thread, count

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *_: object) -> None:
        self.release()


class Condition:
    """`threading.Condition` on an `RLock` of its own."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._lock = RLock(kernel)
        self._waiters = Waiters(kernel)

    def __enter__(self) -> bool:
        return self._lock.acquire()

    def __exit__(self, *_: object) -> None:
        self._lock.release()

    def wait(self, timeout: float | None = None) -> bool:
        """Wait for a notification.

        Raises:
            RuntimeError: this thread does not hold its lock.
        """
        self._check()
        until_ns = self._waiters.until(timeout)
        count = self._lock.release_all()
        try:
            return self._waiters.wait(until_ns)
        finally:
            self._lock.take_again(count)

    def wait_for(self, predicate: Callable[[], Any], timeout: float | None = None) -> Any:  # noqa: ANN401
        """Wait until it holds."""
        until_ns = self._waiters.until(timeout)
        result = predicate()
        while not result:
            left_s = None if until_ns is None else (until_ns - self._kernel.now_ns) * 1e-9
            if left_s is not None and left_s <= 0.0:
                break
            self.wait(left_s)
            result = predicate()
        return result

    def notify(self, n: int = 1) -> None:
        """Wake so many.

        Raises:
            RuntimeError: this thread does not hold its lock.
        """
        self._check()
        self._waiters.wake(n)

    def notify_all(self) -> None:
        """Wake all."""
        self._check()
        self._waiters.wake()

    def _check(self) -> None:
        if not self._lock.owned:
            raise RuntimeError("cannot wait on or notify un-acquired lock")


class Event:
    """`threading.Event`."""

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._waiters = Waiters(kernel)
        self._set = False

    def is_set(self) -> bool:
        """It is set."""
        return self._set

    def set(self) -> None:
        """Set it."""
        self._set = True
        self._waiters.wake()

    def clear(self) -> None:
        """Clear it."""
        self._set = False

    def wait(self, timeout: float | None = None) -> bool:
        """Wait until it is set; a task that waited when it was set continues, cleared again or not."""
        self._kernel.system_call()
        return self._set or self._waiters.wait(self._waiters.until(timeout)) or self._set


class Queue:
    """`queue.Queue` and `queue.SimpleQueue`."""

    def __init__(self, kernel: Kernel, maxsize: int = 0) -> None:
        self._kernel = kernel
        self._size = maxsize
        self._items: deque[Any] = deque()
        self._filled, self._emptied = Waiters(kernel), Waiters(kernel)

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:  # noqa: ANN401
        """Add.

        Raises:
            Full: there is no room in time.
        """
        until_ns = self._emptied.until(timeout)
        while self._size > 0 and len(self._items) >= self._size:
            if not block or (until_ns is not None and self._kernel.now_ns >= until_ns):
                raise queue.Full
            self._emptied.wait(until_ns)
        self._items.append(item)
        self._filled.wake(1)

    def put_nowait(self, item: Any) -> None:  # noqa: ANN401
        """Add where there is room."""
        self.put(item, block=False)

    def get(self, block: bool = True, timeout: float | None = None) -> Any:  # noqa: ANN401
        """Take the oldest.

        Raises:
            Empty: there is none in time.
        """
        self._kernel.system_call()
        until_ns = self._filled.until(timeout)
        while not self._items:
            if not block or (until_ns is not None and self._kernel.now_ns >= until_ns):
                raise queue.Empty
            self._filled.wait(until_ns)
        item = self._items.popleft()
        self._emptied.wake(1)
        return item

    def get_nowait(self) -> Any:  # noqa: ANN401
        """Take the oldest if there is one."""
        return self.get(block=False)

    def drain(self) -> list[Any]:
        """Take all that is in it."""
        items = list(self._items)
        self._items.clear()
        self._emptied.wake()
        return items

    def empty(self) -> bool:
        """Nothing is in it."""
        return not self._items

    def qsize(self) -> int:
        """How much is in it."""
        return len(self._items)


class Thread:
    """`threading.Thread` of the process that makes it."""

    def __init__(
        self, kernel: Kernel, target: Callable[..., object], args: tuple[Any, ...] = (), name: str = "thread",
        daemon: bool | None = None,
    ) -> None:  # fmt: skip
        self.name = name
        self.daemon = kernel.current is not None and kernel.current.daemon if daemon is None else daemon
        self._kernel = kernel
        self._target = target
        self._args = args
        self._task: Task | None = None
        self._ended = Event(kernel)

    def start(self) -> None:
        """Begin to run.

        Raises:
            RuntimeError: it has been started before.
        """
        if self._task is not None:
            raise RuntimeError("threads can only be started once")
        process = self._kernel.task().process
        self._task = self._kernel.spawn(self.name, process, lambda: self._target(*self._args))
        self._task.daemon = self.daemon
        self._task.on_finish.append(self._ended.set)
        if not self.daemon:
            process.at_exit.append(self.join)

    def is_alive(self) -> bool:
        """It runs."""
        return self._task is not None and not self._task.finished

    def join(self, timeout: float | None = None) -> None:
        """Wait for its end.

        Raises:
            RuntimeError: it was never started, or waits for itself.
        """
        if self._task is None or self._task is self._kernel.thread:
            raise RuntimeError("cannot join the current thread, or a thread that has not been started")
        self._ended.wait(timeout)

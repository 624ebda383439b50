"""`concurrent.futures` as a world has it: the parts that production code uses."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import CancelledError, InvalidStateError
from types import SimpleNamespace
from typing import Any

from simulators.scenarios.kernel import Kernel
from simulators.scenarios.threads import Event, Queue, Thread


class Future:
    """`concurrent.futures.Future`."""

    def __init__(self, kernel: Kernel) -> None:
        self.kernel = kernel
        self._ended = Event(kernel)
        self._running = self._cancelled = False
        self._result: Any = None
        self._error: BaseException | None = None

    def cancel(self) -> bool:
        """Do not begin; whether it never will."""
        if not self._running and not self._ended.is_set():
            self._cancelled = True
            self._ended.set()
        return self._cancelled

    def cancelled(self) -> bool:
        """It was cancelled."""
        return self._cancelled

    def done(self) -> bool:
        """It has ended, one way or the other."""
        return self._ended.is_set()

    def set_running_or_notify_cancel(self) -> bool:
        """Begin, unless cancelled."""
        self._running = not self._cancelled
        return self._running

    def set_result(self, result: Any) -> None:  # noqa: ANN401
        """End with a result."""
        self._end(result, None)

    def set_exception(self, error: BaseException) -> None:
        """End with an error."""
        self._end(None, error)

    def _end(self, result: Any, error: BaseException | None) -> None:  # noqa: ANN401
        if self._ended.is_set():
            raise InvalidStateError("the future is already done")
        self._result, self._error = result, error
        self._running = False
        self._ended.set()

    def wait(self, timeout: float | None) -> bool:
        """Wait for the end; whether it came in time."""
        return self._ended.wait(timeout)

    def result(self, timeout: float | None = None) -> Any:  # noqa: ANN401
        """Wait for the end and give the result.

        Raises:
            TimeoutError: it has not ended in time.
            CancelledError: it never will.
        """
        if not self._ended.wait(timeout):
            raise TimeoutError
        if self._cancelled:
            raise CancelledError
        if self._error is not None:
            raise self._error
        return self._result


class ThreadPoolExecutor:
    """`concurrent.futures.ThreadPoolExecutor` with its threads begun as they are needed."""

    def __init__(self, kernel: Kernel, max_workers: int = 1, thread_name_prefix: str = "pool") -> None:
        self._kernel = kernel
        self._queue = Queue(kernel)
        self._most = max_workers
        self._name = thread_name_prefix
        self._threads: list[Thread] = []
        self._closed = False

    def submit(self, call: Callable[..., Any], *args: Any, **named: Any) -> Future:  # noqa: ANN401
        """Have it called by a thread.

        Raises:
            RuntimeError: no more is taken.
        """
        if self._closed:
            raise RuntimeError("cannot schedule new futures after shutdown")
        future = Future(self._kernel)
        self._queue.put((future, lambda: call(*args, **named)))
        if len(self._threads) < self._most:
            if not self._threads:
                self._kernel.task().process.at_exit.append(self.shutdown)
            name = f"{self._name}_{len(self._threads)}"
            self._threads.append(Thread(self._kernel, self._work, (), name, daemon=True))
            self._threads[-1].start()
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """End the threads when they have done what waits."""
        self._closed = True
        for item in self._queue.drain() if cancel_futures else ():
            if item is not None:
                item[0].cancel()
        for _ in self._threads:
            self._queue.put(None)
        for thread in self._threads if wait else ():
            thread.join()

    def _work(self) -> None:
        while (item := self._queue.get()) is not None:
            future, call = item
            if not future.set_running_or_notify_cancel():
                continue
            try:
                future.set_result(call())
            except BaseException as error:  # noqa: BLE001 - raised to the caller that asks for the result
                future.set_exception(error)


def wait_for_futures(futures: Iterable[Future], timeout: float | None = None) -> SimpleNamespace:
    """`concurrent.futures.wait` for all of them; what has ended and what has not, in the order given."""
    waiting = list(futures)
    end_ns = None if not waiting or timeout is None else waiting[0].kernel.now_ns + int(timeout * 1e9)
    for future in waiting:
        future.wait(None if end_ns is None else max(0.0, (end_ns - future.kernel.now_ns) * 1e-9))
    done = {future: None for future in waiting if future.done()}
    return SimpleNamespace(done=done.keys(), not_done={future: None for future in waiting if future not in done}.keys())

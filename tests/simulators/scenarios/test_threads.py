"""Locks, conditions, events, queues, threads and futures: the same little program on the real ones and in a world."""

from __future__ import annotations

import concurrent.futures
import queue
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace
from typing import Any

import pytest

from simulators.scenarios import futures, threads
from simulators.scenarios.kernel import Kernel


@dataclass(eq=False)
class Owner:
    """A process as the kernel sees one."""

    name: str = "owner"
    alive: bool = True
    stalled_ns: int = 0
    at_exit: list[Any] = field(default_factory=list)

    def uncaught(self, thread: str, trace: str) -> None:
        """A thread ended by an error."""
        raise AssertionError(f"{thread}: {trace}")


def virtual(program: Callable[[Any], object], seed: int) -> object:
    """The result of a program on a world's primitives."""
    kernel, results = Kernel(seed), []
    names = ("Lock", "RLock", "Condition", "Event", "Queue", "Thread")
    tools = SimpleNamespace(
        **{name: partial(getattr(threads, name), kernel) for name in names},
        SimpleQueue=partial(threads.Queue, kernel), Future=partial(futures.Future, kernel),
        Executor=partial(futures.ThreadPoolExecutor, kernel), wait=futures.wait_for_futures,
        sleep=lambda length_s: kernel.sleep_ns(int(length_s * 1e9)), now=kernel.clock_s,
    )  # fmt: skip
    kernel.spawn("main", Owner(), lambda: results.append(program(tools)))
    kernel.run(lambda: bool(results))
    return results[0]


REAL = SimpleNamespace(
    Lock=threading.Lock, RLock=threading.RLock, Condition=threading.Condition, Event=threading.Event,
    Queue=queue.Queue, SimpleQueue=queue.SimpleQueue, Thread=threading.Thread, Future=concurrent.futures.Future,
    Executor=concurrent.futures.ThreadPoolExecutor, wait=concurrent.futures.wait, sleep=time.sleep, now=time.monotonic,
)  # fmt: skip


def error_of(call: Callable[[], object]) -> str:
    """The name of what a call raises; empty for nothing."""
    try:
        call()
    except Exception as error:  # noqa: BLE001 - its name is the result
        return type(error).__name__
    return ""


def lock_time_outs(tools: Any) -> object:  # noqa: ANN401
    lock = tools.Lock()
    first = (lock.acquire(), lock.acquire(blocking=False), lock.acquire(timeout=0.02), lock.locked())
    lock.release()
    return first, error_of(lock.release), lock.acquire(timeout=0.02)


def lock_handed_over(tools: Any) -> object:  # noqa: ANN401
    lock, log = tools.Lock(), []

    def work(name: str) -> None:
        for _ in range(5):
            with lock:
                log.append(name)
                before = len(log)
                tools.sleep(0.001)
                assert len(log) == before

    workers = [tools.Thread(target=work, args=(name,), daemon=True) for name in "abc"]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return sorted(log), [worker.is_alive() for worker in workers]


def tried(lock: Any) -> tuple[bool, str]:  # noqa: ANN401
    return lock.acquire(timeout=0.01), error_of(lock.release)


def reentrant(tools: Any) -> object:  # noqa: ANN401
    lock, seen = tools.RLock(), []
    with lock, lock:
        other = tools.Thread(target=lambda: seen.extend(tried(lock)), daemon=True)
        other.start()
        other.join()
    return seen, error_of(lock.release)


def condition_wakes(tools: Any) -> object:  # noqa: ANN401
    condition, got = tools.Condition(), []

    def wait() -> None:
        with condition:
            got.append(condition.wait(5.0))

    waiters = [tools.Thread(target=wait, daemon=True) for _ in range(3)]
    for waiter in waiters:
        waiter.start()
    tools.sleep(0.05)
    with condition:
        condition.notify()
    tools.sleep(0.05)
    after_one = list(got)
    with condition:
        condition.notify_all()
    for waiter in waiters:
        waiter.join()
    with condition:
        late = condition.wait(0.01), condition.wait_for(lambda: False, 0.01), condition.wait_for(lambda: 7, 0.0)
    return after_one, got, late, error_of(condition.notify), error_of(lambda: condition.wait(0.01))


def condition_in_an_inner_lock(tools: Any) -> object:  # noqa: ANN401
    condition, log = tools.Condition(), []

    def notify() -> None:
        with condition:
            log.append("notifies")
            condition.notify_all()

    with condition, condition:
        tools.Thread(target=notify, daemon=True).start()
        tools.sleep(0.02)
        log.append("waits")
        log.append(condition.wait(5.0))
    return log


def event_set_and_cleared(tools: Any) -> object:  # noqa: ANN401
    event, got = tools.Event(), []
    waiter = tools.Thread(target=lambda: got.append(event.wait(1.0)), daemon=True)
    waiter.start()
    tools.sleep(0.05)
    event.set()
    event.clear()
    waiter.join()
    return got, event.is_set(), event.wait(0.01), event.set(), event.wait()


def queue_limits(tools: Any) -> object:  # noqa: ANN401
    line = tools.Queue(2)
    line.put(1)
    line.put(2)
    full = error_of(lambda: line.put_nowait(3)), error_of(lambda: line.put(3, timeout=0.01))
    taken = line.get(), line.get(), line.empty(), line.qsize()
    return full, taken, error_of(line.get_nowait), error_of(lambda: line.get(timeout=0.01))


def queue_between_threads(tools: Any) -> object:  # noqa: ANN401
    line, answers = tools.Queue(1), tools.SimpleQueue()

    def work() -> None:
        while (item := line.get(timeout=5.0)) is not None:
            answers.put(item * item)

    workers = [tools.Thread(target=work, daemon=True) for _ in range(3)]
    for worker in workers:
        worker.start()
    for item in range(20):
        line.put(item, timeout=5.0)
    for _ in workers:
        line.put(None)
    for worker in workers:
        worker.join()
    return sorted(answers.get() for _ in range(20)), answers.empty()


def thread_misuse(tools: Any) -> object:  # noqa: ANN401
    thread = tools.Thread(target=lambda: None, daemon=True)
    before = error_of(thread.join)
    thread.start()
    thread.join()
    return before, error_of(thread.start), thread.is_alive()


def future_ends(tools: Any) -> object:  # noqa: ANN401
    given, failed, dropped, late = (tools.Future() for _ in range(4))
    given.set_running_or_notify_cancel()
    running = given.cancel()
    given.set_result(5)
    failed.set_exception(KeyError("no"))
    return (
        running, given.result(), given.done(), given.cancel(), error_of(lambda: given.set_result(6)),
        error_of(failed.result), dropped.cancel(), dropped.cancel(), dropped.cancelled(), dropped.done(),
        dropped.set_running_or_notify_cancel(), error_of(dropped.result), error_of(lambda: late.result(0.01)),
    )  # fmt: skip


def pool(tools: Any) -> object:  # noqa: ANN401
    executor = tools.Executor(1)
    began = tools.now()
    first, second, third = (executor.submit(lambda n=n: tools.sleep(0.1) or n) for n in range(3))
    ended = tools.wait([first, second], 0.15)
    sizes = len(ended.done), len(ended.not_done), first in ended.done
    tools.sleep(0.1)
    executor.shutdown(wait=True, cancel_futures=True)
    return (
        sizes, first.result(), second.result(), third.result() if not third.cancelled() else 2,
        error_of(lambda: executor.submit(print)), tools.now() - began < 2.0,
    )  # fmt: skip


PROGRAMS = (
    lock_time_outs, lock_handed_over, reentrant, condition_wakes, condition_in_an_inner_lock, event_set_and_cleared,
    queue_limits, queue_between_threads, thread_misuse, future_ends, pool,
)  # fmt: skip


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda program: program.__name__)
def test_a_program_gives_the_same_in_any_scenario_as_on_the_machine(program: Callable[[Any], object]) -> None:
    real = program(REAL)
    for seed in range(10):
        assert virtual(program, seed) == real, seed


def test_a_condition_s_notification_before_its_time_out_is_not_lost() -> None:
    def program(tools: Any) -> object:  # noqa: ANN401
        condition, got = tools.Condition(), []

        def wait() -> None:
            with condition:
                got.append(condition.wait(0.01))

        waiter = tools.Thread(target=wait)
        waiter.start()
        tools.sleep(0.0098)
        with condition:
            notified = bool(not got)
            condition.notify()
        waiter.join()
        return notified == got[0] or not notified

    assert all(virtual(program, seed) for seed in range(100))


def test_a_shutdown_that_cancels_races_with_its_worker_without_an_error() -> None:
    def program(tools: Any) -> object:  # noqa: ANN401
        executor, ran = tools.Executor(1), []
        made = [executor.submit(lambda: ran.append(1)) for _ in range(3)]
        executor.shutdown(wait=True, cancel_futures=True)
        return all(future.done() for future in made) and len(ran) + sum(future.cancelled() for future in made) == 3

    assert all(virtual(program, seed) for seed in range(100))


def test_a_killed_waiter_swallows_no_wake_up() -> None:
    kernel, ended = Kernel(1), []
    waiters, dead = threads.Waiters(kernel), Owner()
    first = kernel.spawn("first", dead, lambda: waiters.wait(None))
    kernel.run(lambda: kernel.switches == 1)
    kernel.spawn("second", Owner(), lambda: ended.append(waiters.wait(None)))
    kernel.run(lambda: kernel.switches == 2)
    dead.alive = False
    kernel.abandon(first)
    waiters.wake(1)
    kernel.run(lambda: bool(ended))
    assert ended == [True]


def test_ended_futures_come_in_the_order_given() -> None:
    def program(tools: Any) -> object:  # noqa: ANN401
        made = [tools.Future() for _ in range(20)]
        for future in made[::2]:
            future.set_result(None)
        ended = tools.wait(made, 0.0)
        return list(ended.done) == made[::2] and list(ended.not_done) == made[1::2]

    assert virtual(program, 1)

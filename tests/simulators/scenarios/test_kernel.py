"""The scheduler of a world: virtual time, order from the seed, deaths, signals."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from simulators.scenarios.kernel import Kernel, NothingHappens


@dataclass(eq=False)
class Owner:
    """A process as the kernel sees one."""

    name: str = "owner"
    alive: bool = True
    stalled_ns: int = 0
    errors: list[str] = field(default_factory=list)

    def uncaught(self, thread: str, trace: str) -> None:
        """A thread ended by an error."""
        self.errors.append(f"{thread}: {trace}")


def test_time_jumps_to_the_end_of_a_wait() -> None:
    kernel, owner, ended = Kernel(1), Owner(), []
    kernel.spawn("sleeper", owner, lambda: (kernel.sleep_ns(3_600_000_000_000), ended.append(kernel.time_s)))
    kernel.run(lambda: bool(ended))
    assert 3600.0 <= ended[0] < 3600.001


def test_a_task_that_is_woken_before_its_time_out_is_reported_so_even_when_it_runs_after_it() -> None:
    def reported(seed: int) -> bool:
        kernel, owner, begun, outcomes = Kernel(seed), Owner(), [], []
        end_ns = kernel.now_ns + 1_000_000
        task = kernel.spawn("waiter", owner, lambda: (begun.append(True), outcomes.append(kernel.block(end_ns))))
        kernel.run(lambda: bool(begun))
        kernel.now_ns = end_ns - 1
        kernel.wake(task)
        kernel.run(lambda: task.finished)
        return outcomes[0]

    assert all(reported(seed) for seed in range(50))


def test_the_order_of_what_is_due_together_comes_from_the_seed() -> None:
    def order(seed: int) -> str:
        kernel, owner, ran = Kernel(seed), Owner(), []
        for name in "abcdef":
            kernel.spawn(name, owner, lambda name=name: ran.append(name))
        kernel.run(lambda: len(ran) == 6)
        return "".join(ran)

    assert order(3) == order(3)
    assert len({order(seed) for seed in range(10)}) > 5


def test_a_scenario_where_everybody_waits_for_ever_says_who() -> None:
    kernel = Kernel(1)
    kernel.spawn("waits", Owner("station"), kernel.block)
    with pytest.raises(NothingHappens, match="station:waits"):
        kernel.run(lambda: False)


def test_an_error_of_a_thread_is_reported_and_ends_no_other() -> None:
    kernel, owner, ended = Kernel(1), Owner(), []

    def fail() -> None:
        raise ValueError("of this thread")

    kernel.spawn("bad", owner, fail)
    kernel.spawn("good", owner, lambda: (kernel.sleep_ns(10**9), ended.append(True)))
    kernel.run(lambda: bool(ended))
    assert ["of this thread" in error for error in owner.errors] == [True]


def test_waiting_outside_of_a_scenario_is_refused() -> None:
    with pytest.raises(RuntimeError, match="only a task"):
        Kernel(1).block()


def test_a_stalled_process_runs_when_it_may_again() -> None:
    kernel, owner, ran = Kernel(1), Owner(), []
    owner.stalled_ns = kernel.now_ns + 5_000_000_000
    kernel.spawn("task", owner, lambda: ran.append(kernel.time_s))
    kernel.run(lambda: bool(ran))
    assert ran[0] >= 5.0


def test_a_handler_runs_in_place_of_the_thread_it_interrupts_which_then_waits_on() -> None:
    kernel, owner, log = Kernel(1), Owner(), []
    began_ns = kernel.now_ns
    task = kernel.spawn("main", owner, lambda: (kernel.sleep_ns(10**9), log.append(("main", kernel.time_s))))
    kernel.run(lambda: task.waiting and kernel.switches > 0)

    def handle() -> None:
        assert kernel.thread is task
        kernel.sleep_ns(3 * 10**9)
        log.append(("handler", kernel.time_s))

    kernel.spawn("sender", owner, lambda: kernel.interrupt(task, handle))
    kernel.run(lambda: task.finished)
    assert [name for name, _ in log] == ["handler", "main"]
    assert kernel.now_ns >= began_ns + 3 * 10**9


def test_what_a_handler_raises_is_raised_where_the_thread_waits() -> None:
    kernel, owner, log = Kernel(1), Owner(), []

    def main() -> None:
        try:
            kernel.block()
        except KeyboardInterrupt:
            log.append("interrupted")
        kernel.sleep_ns(1000)
        log.append("went on")

    def handle() -> None:
        raise KeyboardInterrupt

    task = kernel.spawn("main", owner, main)
    kernel.run(lambda: kernel.switches > 0)
    kernel.spawn("sender", owner, lambda: kernel.interrupt(task, handle))
    kernel.run(lambda: task.finished)
    assert log == ["interrupted", "went on"]


KILLED = """
    import gc, sys
    from simulators.scenarios.kernel import Kernel
    from types import SimpleNamespace
    kernel = Kernel(1)
    owner = SimpleNamespace(name="owner", alive=True, stalled_ns=0, uncaught=lambda *told: print("told", told))
    def run():
        try:
            kernel.block()
        finally:
            print("finally", flush=True)
            open(sys.argv[1], "w").close()
    task = kernel.spawn("killed", owner, run)
    other = kernel.spawn("other", owner, lambda: kernel.sleep_ns(10**9))
    kernel.run(lambda: kernel.switches == 2)
    owner.alive = False
    kernel.abandon(task)
    del task
    gc.collect()
    kernel.run(lambda: kernel.time_s > 0.5)
    del kernel, run, other
    gc.collect()
"""


def test_a_killed_task_runs_no_finally_block_not_even_when_the_interpreter_ends(tmp_path: Path) -> None:
    effect = tmp_path / "effect"
    command = [sys.executable, "-c", textwrap.dedent(KILLED), str(effect)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert (ran.stdout, ran.stderr) == ("", "")
    assert not effect.exists()


PROGRAM = """
    from simulators.scenarios import threads
    from simulators.scenarios.kernel import Kernel
    from types import SimpleNamespace
    kernel = Kernel(7)
    owner = SimpleNamespace(name="owner", alive=True, stalled_ns=0, uncaught=print, at_exit=[])
    queue, lock, log = threads.Queue(kernel, 3), threads.Lock(kernel), []
    def work(name):
        while (item := queue.get()) is not None:
            with lock:
                log.append((name, item, kernel.now_ns))
                kernel.sleep_ns(1000)
    def main():
        workers = [threads.Thread(kernel, work, (name,), name) for name in ("a", "b", "c")]
        for worker in workers: worker.start()
        for item in range(40): queue.put(item)
        for worker in workers: queue.put(None)
        for worker in workers: worker.join()
    task = kernel.spawn("main", owner, main)
    kernel.run(lambda: task.finished)
    print(log, kernel.now_ns, kernel.switches)
"""


def test_the_same_seed_is_the_same_course_under_another_hash_seed() -> None:
    outputs = {
        subprocess.run(
            [sys.executable, "-c", textwrap.dedent(PROGRAM)], capture_output=True, text=True, timeout=60, check=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in ("0", "1", "4711")
    }  # fmt: skip
    assert len(outputs) == 1
    assert "(" in outputs.pop()

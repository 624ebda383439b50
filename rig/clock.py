"""Host time, integer nanoseconds, monotonic: for control it is that of `drivers.clock`."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from datetime import UTC, datetime
from typing import TypeVar

from drivers import clock

SUSPEND_S = 0.1
STEP_S = 0.5
"""A smaller difference is a clock being slewed, or this process being held up between two readings."""

Result = TypeVar("Result")


def monotonic_ns() -> int:
    """Host time for control, ages and time-outs (ns); never steps."""
    return clock.monotonic_ns()


def machine_ns() -> int:
    """This computer's own clock (ns), also while a simulated rig's clock waits: for how long something took."""
    return time.monotonic_ns()


def wait_for(changed: threading.Condition, true: Callable[[], bool], timeout_s: float) -> bool:
    """`Condition.wait_for` by the time for control; the condition's lock is held by the caller."""
    until_ns = monotonic_ns() + int(1e9 * timeout_s)
    while not true():
        left_ns = until_ns - monotonic_ns()
        if left_ns <= 0:
            return False
        changed.wait(left_ns * 1e-9)
    return True


def result_of(future: Future[Result], timeout_s: float) -> Result:
    """`Future.result` by the time for control.

    Raises:
        TimeoutError: there is none in time.
        Exception: what the future holds.
    """
    until_ns = monotonic_ns() + int(1e9 * timeout_s)
    while True:
        left_ns = until_ns - monotonic_ns()
        try:
            return future.result(max(0.0, left_ns * 1e-9))
        except TimeoutError:
            if future.done() or monotonic_ns() >= until_ns:
                raise


def utc_now() -> datetime:
    """Wall time (UTC) for file names and provenance only; it may step and is never used for control."""
    return datetime.now(UTC)


def suspended_ns() -> int:
    """How long this machine has been suspended since it was booted (ns); 0 where that cannot be told.

    BOOTTIME goes on while a machine sleeps, MONOTONIC does not. The second reading comes later, so a pause between the
    two makes the answer too small and never too large.
    """
    if not hasattr(time, "CLOCK_BOOTTIME"):
        return 0
    boot_ns = time.clock_gettime_ns(time.CLOCK_BOOTTIME)
    return boot_ns - time.clock_gettime_ns(time.CLOCK_MONOTONIC)


class SuspendWatch:
    """Tells when the machine has been suspended since the last look."""

    def __init__(self) -> None:
        self._known_ns = max(suspended_ns() for _ in range(3))

    def slept_s(self) -> float:
        """Seconds of suspension since the last call that told of one; below `SUSPEND_S` nothing is told (0)."""
        now_ns = suspended_ns()
        slept_s = (now_ns - self._known_ns) * 1e-9
        self._known_ns = max(self._known_ns, now_ns)
        return slept_s if slept_s > SUSPEND_S else 0.0


class WallClockWatch:
    """Tells when the wall clock has stepped against the monotonic one (fault row `clock-step`)."""

    def __init__(self) -> None:
        self._offset_s = self._offset()

    @staticmethod
    def _offset() -> float:
        return utc_now().timestamp() - machine_ns() * 1e-9

    def stepped_s(self) -> float:
        """Seconds by which the wall clock stepped since the last call that told of a step; 0 for less than `STEP_S`."""
        offset_s = self._offset()
        stepped_s = offset_s - self._offset_s
        if abs(stepped_s) < STEP_S:
            return 0.0
        self._offset_s = offset_s
        return stepped_s

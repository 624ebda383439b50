"""The one place where host time is read: integer nanoseconds, monotonic. Tests and faults replace it here."""

from __future__ import annotations

import time
from datetime import UTC, datetime

SUSPEND_S = 0.1
STEP_S = 0.5
"""A smaller difference is a clock being slewed, or this process being held up between two readings."""


def monotonic_ns() -> int:
    """Host time for control, ages and time-outs (ns); never steps."""
    return time.monotonic_ns()


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
        return utc_now().timestamp() - monotonic_ns() * 1e-9

    def stepped_s(self) -> float:
        """Seconds by which the wall clock stepped since the last call that told of a step; 0 for less than `STEP_S`."""
        offset_s = self._offset()
        stepped_s = offset_s - self._offset_s
        if abs(stepped_s) < STEP_S:
            return 0.0
        self._offset_s = offset_s
        return stepped_s

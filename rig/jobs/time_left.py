"""Estimate and format of the remaining time of jobs."""

from __future__ import annotations

import math
import time


class TimeLeft:
    """Estimates the remaining time of jobs.

    Args:
        total: number of jobs.
    """

    def __init__(self, total: int) -> None:
        self._total = total
        self._began_s = time.monotonic()

    def after(self, done: int) -> float:
        """Remaining time (s) after `done` jobs; infinite before the first."""
        elapsed_s = time.monotonic() - self._began_s
        return math.inf if done == 0 else elapsed_s / done * (self._total - done)

    def text(self, done: int) -> str:
        """`3 of 30, 40 s left`; without the time after the last job."""
        left_s = self.after(done)
        left = f", {duration(left_s)} left" if 0.0 < left_s < math.inf else ""
        return f"{done} of {self._total}{left}"


def duration(seconds: float) -> str:
    """Format a time in seconds: "4.5 s", "3 min 20 s", "34 h 12 min"."""
    if seconds < 99.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min"

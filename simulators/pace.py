"""How fast simulated time runs: `speed` times the wall at most, later when this process or a reader falls behind."""

from __future__ import annotations

import math
from typing import Protocol

LONGEST_LAG_S = 0.5
LONGEST_LAG_FAST_S = 0.02
LONGEST_WAIT_S = 0.52
CATCH_UP = 4.0


class Pace:
    """Turns wall time into plant steps.

    At speed 1 a short stall is caught up, so that device clocks keep their rate against the host's; a longer one, and
    nearly any at higher speed, is forgotten: simulated time then stays behind. No physics is ever skipped.
    """

    def __init__(self, speed: float, dt_s: float, tick_s: float, largest_slice: int) -> None:
        self.speed = speed
        self._dt_s = dt_s
        self._largest = max(1, min(largest_slice, int(CATCH_UP * speed * tick_s / dt_s)))
        self._lag_s = LONGEST_LAG_S if speed <= 1.0 else LONGEST_LAG_FAST_S
        self._anchor_ns = -1
        self._anchor_step = 0

    def due(self, now_ns: int, step: int) -> int:
        """Steps to run now, bounded to one slice.

        Args:
            now_ns: host's monotonic clock (ns).
            step: steps run so far.
        """
        if self._anchor_ns < 0:
            self.hold(now_ns, step)
        behind = self._behind(now_ns, step)
        longest = self._lag_s * self.speed / self._dt_s
        if behind > longest:
            self.hold(now_ns - int(self._lag_s * 1e9), step)
            behind = longest
        return max(0, min(self._largest, int(behind)))

    def ahead_s(self, now_ns: int, step: int) -> float:
        """By how much the host's clock is ahead of the plant (simulated s): the plant runs in slices."""
        return 0.0 if self._anchor_ns < 0 else max(0.0, self._behind(now_ns, step)) * self._dt_s

    def hold(self, now_ns: int, step: int) -> None:
        """Start counting anew: no wall time before `now_ns` is owed."""
        self._anchor_ns = now_ns
        self._anchor_step = step

    def _behind(self, now_ns: int, step: int) -> float:
        target = self._anchor_step + (now_ns - self._anchor_ns) * 1e-9 * self.speed / self._dt_s
        return target - step


class Reader(Protocol):
    """A client that reads what the rig sends."""

    @property
    def read_once(self) -> bool:
        """Whether a client reads here at all."""

    def unread(self) -> int:
        """Bytes sent and not yet read."""


class Backpressure:
    """The rig's clock waits for its readers, `LONGEST_WAIT_S` at a stretch for each.

    A reader that has not caught up by then is waited for no more until it has: the physics go on, as a real rig's do,
    and what its port cannot hold is lost.

    Args:
        served_s: wall time in which this process ran (s): its own absence is not the reader's.
    """

    def __init__(self) -> None:
        self._behind_since_s: dict[int, float] = {}

    def waits_for(self, reader: Reader, allowed: float, served_s: float) -> bool:
        """Whether `reader` is behind by more than `allowed` bytes, and not yet for too long."""
        return self._waits(id(reader), reader.read_once and reader.unread() > allowed, served_s)

    def waits_for_poll(self, silent_s: float, allowed_s: float, served_s: float) -> bool:
        """Whether the host that polls the controller is late by more than `allowed_s`, and not yet for too long."""
        return self._waits(0, silent_s > allowed_s, served_s)

    @property
    def waiting(self) -> bool:
        """A reader is behind, and not for too long."""
        return any(since_s > -math.inf for since_s in self._behind_since_s.values())

    def given_up(self, reader: Reader) -> bool:
        """Whether a reader that is behind was waited for in vain."""
        return self._behind_since_s.get(id(reader)) == -math.inf

    def _waits(self, key: int, behind: bool, served_s: float) -> bool:
        if not behind:
            self._behind_since_s.pop(key, None)
            return False
        if served_s - self._behind_since_s.setdefault(key, served_s) < LONGEST_WAIT_S:
            return True
        self._behind_since_s[key] = -math.inf
        return False

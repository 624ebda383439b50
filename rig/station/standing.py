"""A sensor whose value stands still while the rod moves, at any speed. Pure, no clock, no I/O.

What moves is told by the controller, by its own transducers. A sensor whose steps are finer than its noise never
repeats one value for long: it is stuck when the rod has gone a way meanwhile. One of coarse steps may repeat a value
along a whole stroke: it is stuck when the controller's own measure of it has changed by several of those steps.
"""

from __future__ import annotations

import math
from typing import NamedTuple

TRAVEL_M = 0.2e-3
STEPS = 4.0
SETTLED_POLLS = 5
"""Polls of the controller, before and after, by which its status and the sensor may differ in age."""


class Reference(NamedTuple):
    """What the controller says: polls and the rod's way so far (m), its own measure of the sensor's quantity (SI)."""

    polls: int
    path_m: float
    value: float


class StandingJudge:
    """Follows one sensor's repeated values.

    Args (construction):
        samples: so many equal ones before anything is judged.
        floor: what the controller's measure of the quantity may change by itself (SI), beside the sensor's steps.
    """

    def __init__(self, samples: int, floor: float) -> None:
        self._samples = samples
        self._floor = floor
        self._repeats = 0
        self._began = Reference(0, 0.0, math.nan)
        self._low = self._high = math.nan
        self._beyond_since: int | None = None

    def forget(self) -> None:
        """The last sample has another value than the one before."""
        self._repeats = 0

    def judge(self, repeats: int, reference: Reference, *, fine: bool, step: float) -> bool:
        """Take one read.

        Args:
            repeats: how many samples in a row have had the last value.
            reference: the controller's last status.
            fine: the sensor's values usually differ from one sample to the next.
            step: the smallest difference between two of its values that was seen (SI); 0 where none was.

        Returns:
            True while it stands and the rod does not.
        """
        if repeats < self._repeats or self._repeats == 0:
            self._began, self._beyond_since = reference, None
            self._low, self._high = math.inf, -math.inf
        self._repeats = repeats
        if repeats < self._samples:
            return False
        if fine:
            return reference.path_m - self._began.path_m > TRAVEL_M
        if reference.polls - self._began.polls < SETTLED_POLLS or not math.isfinite(reference.value):
            return False
        self._low, self._high = min(self._low, reference.value), max(self._high, reference.value)
        if not self._high - self._low > STEPS * step + self._floor:
            return False
        self._beyond_since = reference.polls if self._beyond_since is None else self._beyond_since
        return reference.polls - self._beyond_since >= SETTLED_POLLS

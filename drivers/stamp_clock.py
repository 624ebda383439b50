"""A CAN interface's time stamps on the host's monotonic clock, with what that is good to.

A frame is read some time after it was stamped, never before. Of each window the least difference of reading and stamp
is kept: there stamps lie on the host's clock, late by the shortest time that a frame took to be read. What the least
differences of neighbouring windows vary by is the uncertainty: clock drift and the luck of one window.
"""

from __future__ import annotations

from collections import deque

WINDOW_NS = 250_000_000
WINDOWS = 8
FEWEST_WINDOWS = 4
FEWEST_FRAMES = 10
"""In a window, for its least difference to count."""
WORST_NS = 1_000_000
"""Stamps that are no better than this are not used."""
STEP_NS = 50_000_000
"""A least difference that jumps by so much is another clock: the wall's was set, the adapter started again."""


class StampClock:
    """Follows one interface's stamps.

    Attributes:
        uncertainty_ns: of a mapped stamp; None while stamps are not used.
    """

    def __init__(self) -> None:
        self.uncertainty_ns: int | None = None
        self._least: deque[int] = deque(maxlen=WINDOWS)
        self._window_least = 0
        self._window_end_ns = 0
        self._count = 0

    def host_ns(self, stamp_ns: int, arrival_ns: int) -> int:
        """When a frame was on the bus, by the host's monotonic clock: its arrival while the stamps are not used.

        Args:
            stamp_ns: the interface's stamp; 0 or less where it gives none.
            arrival_ns: monotonic time at which the frame had been read.
        """
        if stamp_ns <= 0:
            return arrival_ns
        difference = arrival_ns - stamp_ns
        if self._count and abs(difference - self._window_least) > STEP_NS and difference < self._window_least:
            self._forget()
        if arrival_ns >= self._window_end_ns:
            self._close(arrival_ns)
        self._window_least = min(difference, self._window_least) if self._count else difference
        self._count += 1
        if self.uncertainty_ns is None:
            return arrival_ns
        mapped = stamp_ns + min(self._least[-1], self._window_least)
        if arrival_ns - mapped > STEP_NS:
            # No frame waits so long to be read: it is the clock.
            self._forget()
            return arrival_ns
        return mapped

    def _close(self, arrival_ns: int) -> None:
        """Begin another window; what the last one showed counts if it had enough frames."""
        if self._count >= FEWEST_FRAMES:
            self._least.append(self._window_least)
        self._count, self._window_end_ns = 0, arrival_ns + WINDOW_NS
        steps = [abs(later - earlier) for earlier, later in zip(self._least, list(self._least)[1:], strict=False)]
        good = len(self._least) >= FEWEST_WINDOWS and max(steps) <= WORST_NS
        self.uncertainty_ns = max(steps) if good else None

    def _forget(self) -> None:
        self._least.clear()
        self._count, self.uncertainty_ns = 0, None

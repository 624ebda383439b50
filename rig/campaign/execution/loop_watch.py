"""Monitor of the campaign's loop: whether it runs, and since when it has run without a pause."""

from __future__ import annotations

import threading
from collections.abc import Callable

LONGEST_TURN_S = 10.0
"""Longer than any disk may keep the campaign's loop from turning (wall s).

The station has stopped the rig long before, but holds it under pressure for an application that may come back.
"""
LOOK_S = 0.5


class TurnClock:
    """When the loop turned, by which the silence of other processes is measured.

    A pause of the loop is not their silence: after one (a suspended machine, a starved process) they get the same time
    again to report what they saw.

    Args:
        longest_pause_s: a longer time between two turns is a pause (wall s).

    Attributes:
        now_ns: when the present turn began (host's clock).
    """

    def __init__(self, longest_pause_s: float) -> None:
        self.now_ns = 0
        self._longest_pause_ns = int(1e9 * longest_pause_s)
        self._since_ns = 0

    def turn(self, now_ns: int) -> None:
        """A turn begins."""
        if now_ns - self.now_ns > self._longest_pause_ns:
            self._since_ns = now_ns
        self.now_ns = now_ns

    def silent_ns(self, last_ns: int) -> int:
        """For how long nothing has come since `last_ns` while the loop turned without a pause."""
        return self.now_ns - max(last_ns, self._since_ns)


class LoopWatch:
    """Looks on a thread of its own whether the loop still turns.

    Time in which this whole process stood still does not count: the thread counts its own looks.

    Args:
        let_go: called once, from that thread, when the loop has not turned for `longest_s`.
        longest_s: how long one turn may take (wall s).
    """

    def __init__(self, let_go: Callable[[], object], longest_s: float = LONGEST_TURN_S) -> None:
        self._let_go = let_go
        self._looks = max(2, round(longest_s / LOOK_S))
        self._turns = 0
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="loop watch", daemon=True)
        self._thread.start()

    def turned(self) -> None:
        """The loop has turned once more."""
        self._turns += 1

    def end(self) -> None:
        """Watch no longer."""
        self._ending.set()

    def _watch(self) -> None:
        seen, looks = -1, 0
        while not self._ending.wait(LOOK_S):
            looks = looks + 1 if self._turns == seen else 0
            seen = self._turns
            if looks >= self._looks:
                self._let_go()
                return

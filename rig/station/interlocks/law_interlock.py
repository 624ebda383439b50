"""Interlock on a current that a control law commands anew at every step: it never settles, but its mean follows. Pure.

A current that follows its command with a lag of T has the mean of the command, except for T times its change between
the ends of the window, divided by the window. So a source that does not follow is detected although no command lasts.
"""

from __future__ import annotations

import math
from collections import deque
from itertools import islice

from drivers.current_source import SourceStatus, SourceTiming
from rig.station.interlocks.current_interlock import TRACKING_A, TRACKING_SHARE
from rig.station.interlocks.finding import CONSECUTIVE, Finding

WINDOW_S = 1.0
WINDOW_SETTLINGS = 6.0
"""The window is so many times what the current takes to settle, at least."""


class LawInterlock:
    """Compares the mean of the measured current with that of its commands over the last second or more.

    Args (construction):
        timing: how often the source tells its current.
        settling_s: a new set-point's current is there after so long (s of its clock).
    """

    def __init__(self, timing: SourceTiming, settling_s: float) -> None:
        self._window_s = max(WINDOW_S, WINDOW_SETTLINGS * settling_s)
        self._statuses = max(CONSECUTIVE, round(self._window_s / timing.status_s))
        self._status_s, self._settling_s, self._patience_s = timing.status_s, settling_s, 0.0
        self._seen = self._none_seen()
        self._off = 0
        self._commanded = False

    def follow(self, *, law: bool, patience_s: float = 0.0) -> None:
        """From now on a law or a program commands the current; or it is constant and nothing is checked here.

        Args:
            law: whether the current changes with its commands.
            patience_s: time that a command and its effect may take on the wires (s of the source's clock).
        """
        self._off, self._commanded, self._patience_s = 0, law, patience_s
        self._seen = self._none_seen()

    def _none_seen(self) -> deque[tuple[float, float]]:
        """Room for the statuses of a window, and for those before it whose commands still take effect in it."""
        before = math.ceil((self._settling_s + self._patience_s) / self._status_s)
        return deque(maxlen=self._statuses + before)

    def check(self, status: SourceStatus, commanded_A: float, t_ns: int) -> list[Finding]:
        """Take one status.

        Args:
            status: the source's status.
            commanded_A: what it was asked for when that came (A).
            t_ns: host arrival of the status.
        """
        seen = self._seen
        seen.append((status.current_A, commanded_A))
        if not self._commanded or len(seen) < self._statuses:
            return []
        commands_A = [requested_A for _, requested_A in seen]
        measured_A = sum(seen_A for seen_A, _ in islice(reversed(seen), self._statuses)) / self._statuses
        requested_A = sum(commands_A[-self._statuses :]) / self._statuses
        span_A = max(commands_A) - min(commands_A)
        settling = (self._settling_s + self._patience_s) / self._window_s
        allowed_A = TRACKING_A + TRACKING_SHARE * abs(requested_A) + settling * span_A
        self._off = self._off + 1 if not abs(measured_A - requested_A) <= allowed_A else 0
        if self._off != CONSECUTIVE:
            return []
        detail = (
            f"mean of {self._statuses} status messages: measured {measured_A:.3f} A, commanded {requested_A:.3f} A, "
            f"allowed difference {allowed_A:.3f} A"
        )
        return [Finding("current-tracking", detail, t_ns, measured_A, requested_A)]

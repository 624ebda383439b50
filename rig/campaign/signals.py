"""The operator's signals as a queue: a stop stops the rig once, further ones change nothing and cut nothing short."""

from __future__ import annotations

import signal
import threading
from collections import deque
from types import FrameType, TracebackType
from typing import Any

from rig.campaign import event as ev
from rig.campaign.cause import Cause
from rig.errors import Stopped
from rig.faults.row import StopKind

STOPS = {
    signal.SIGINT: (StopKind.FADE_OUT, Cause("sigint", "Ctrl-C")),
    signal.SIGTERM: (StopKind.PRESSURE_OFF, Cause("sigterm", "SIGTERM")),
    signal.SIGHUP: (StopKind.PRESSURE_OFF, Cause("sigterm", "SIGHUP: the terminal went away")),
}
PAUSES = (signal.SIGTSTP, signal.SIGUSR1)
"""Ctrl-Z, or `kill -USR1`: pause after the running point; once more: go on."""


class Signals:
    """While entered, SIGINT, SIGTERM and SIGHUP become `Abort` events instead of ending the process.

    Ctrl-Z must not suspend a process that a moving rig depends on: it asks for a pause, and the next one ends it.
    Outside the main thread Python cannot catch signals; then nothing is caught here and the main thread's handlers act.
    """

    def __init__(self) -> None:
        self._caught: deque[int] = deque()
        self._before: dict[int, Any] = {}
        self._paused = False

    def take(self) -> list[ev.Event]:
        """What was asked for since the last call, oldest first."""
        events: list[ev.Event] = []
        while self._caught:
            number = signal.Signals(self._caught.popleft())
            if number in PAUSES:
                self._paused = not self._paused
                events.append(ev.PauseAsked() if self._paused else ev.ResumeAsked())
            else:
                stop, cause = STOPS[number]
                events.append(ev.Abort(stop, cause))
        return events

    def check(self) -> None:
        """Obey before the rig is connected, where a stop needs no order.

        Raises:
            Stopped: the operator asked for a stop.
        """
        for number in tuple(self._caught):
            if number in STOPS:
                _, cause = STOPS[signal.Signals(number)]
                raise Stopped(cause.slug, f"stopped by operator ({cause.detail}) before the rig was connected")

    def _catch(self, number: int, frame: FrameType | None) -> None:
        self._caught.append(number)

    def __enter__(self) -> Signals:
        if threading.current_thread() is threading.main_thread():
            for number in (*STOPS, *PAUSES):
                self._before[number] = signal.signal(number, self._catch)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()

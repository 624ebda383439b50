"""The operator's signals as a queue: the first one stops the rig, further ones change nothing and cut nothing short."""

from __future__ import annotations

import signal
import threading
from collections import deque
from types import FrameType, TracebackType
from typing import Any

from rig.campaign import event as ev
from rig.campaign.cause import Cause, StopKind

STOPS = {
    signal.SIGINT: (StopKind.S2, Cause("sigint", "Ctrl-C")),
    signal.SIGTERM: (StopKind.S1, Cause("sigterm", "SIGTERM")),
    signal.SIGHUP: (StopKind.S1, Cause("sigterm", "SIGHUP: the terminal went away")),
}


class Signals:
    """While entered, SIGINT, SIGTERM and SIGHUP become `Abort` events instead of ending the process.

    Outside the main thread Python cannot catch signals; then nothing is caught here and the main thread's handlers act.
    """

    def __init__(self) -> None:
        self._caught: deque[int] = deque()
        self._before: dict[int, Any] = {}

    def take(self) -> list[ev.Event]:
        """The aborts that came since the last call, oldest first."""
        aborts: list[ev.Event] = []
        while self._caught:
            stop, cause = STOPS[signal.Signals(self._caught.popleft())]
            aborts.append(ev.Abort(stop, cause))
        return aborts

    def _catch(self, number: int, frame: FrameType | None) -> None:
        self._caught.append(number)

    def __enter__(self) -> Signals:
        if threading.current_thread() is threading.main_thread():
            for number in STOPS:
                self._before[number] = signal.signal(number, self._catch)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()

"""The operator's signals in, what the operator sees out; neither can hurt a campaign.

Signals are a queue: a stop stops the rig once, further ones change nothing and cut nothing short. The display runs on a
thread of its own: the first failure switches it off, the rig continues.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import signal
import threading
from collections import deque
from collections.abc import Callable, Mapping
from types import FrameType, TracebackType
from typing import Any

from rig.campaign.results import Display, PointResult
from rig.campaign.sequencer import event as ev
from rig.campaign.stop_cause import because
from rig.errors import Stopped
from rig.faults.row import StopKind
from rig.matrix.plan import Plan

STOPS = {
    signal.SIGINT: (StopKind.FADE_OUT, because("sigint", "said", text="Ctrl-C")),
    signal.SIGTERM: (StopKind.PRESSURE_OFF, because("sigterm", "said", text="SIGTERM")),
    signal.SIGHUP: (StopKind.PRESSURE_OFF, because("sigterm", "said", text="SIGHUP: the terminal went away")),
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


log = logging.getLogger(__name__)

MOST_WAITING = 10_000
"""Calls kept for a display that is slow or stands still (Ctrl-S, a pipe that nobody reads); further ones are lost."""


class GuardedDisplay:
    """Passes everything on to `display`, in order, on a thread of its own, until it fails once.

    A terminal that is closed or stands still must not stop a rig, nor keep it from being stopped.
    """

    def __init__(self, display: Display) -> None:
        self._display = display
        self.failed = ""
        """What the display failed with; empty while it works."""
        self._waiting: queue.Queue[Callable[[], None] | None] = queue.Queue(MOST_WAITING)
        self._thread = threading.Thread(target=self._work, name="display", daemon=True)
        self._thread.start()

    def close(self, timeout_s: float) -> None:
        """Show what waits, for `timeout_s` at most; nothing is shown after that."""
        self._put(None)
        self._thread.join(timeout_s)
        self.failed = self.failed or "closed"

    def planned(self, plan: Plan) -> None:
        """As `Display.planned`."""
        self._show(lambda: self._display.planned(plan))

    def phase(self, text: str) -> None:
        """As `Display.phase`."""
        self._show(lambda: self._display.phase(text))

    def progress(self, point_id: str, cycles_done: int, time_left_s: float, live: Mapping[str, float]) -> None:
        """As `Display.progress`."""
        if self._waiting.empty():
            self._show(lambda: self._display.progress(point_id, cycles_done, time_left_s, live))

    def point_done(self, result: PointResult) -> None:
        """As `Display.point_done`."""
        self._show(lambda: self._display.point_done(result))

    def message(self, level: str, text: str) -> None:
        """As `Display.message`."""
        self._show(lambda: self._display.message(level, text))

    def _show(self, show: Callable[[], None]) -> None:
        if not self.failed:
            self._put(show)

    def _put(self, call: Callable[[], None] | None) -> None:
        with contextlib.suppress(queue.Full):
            self._waiting.put_nowait(call)

    def _work(self) -> None:
        while (show := self._waiting.get()) is not None:
            if self.failed:
                continue
            try:
                show()
            except Exception as error:
                self.failed = f"{type(error).__name__}: {error}"
                log.exception("the display failed and stays dark; the campaign goes on")

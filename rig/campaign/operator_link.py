"""Input of the operator (signals, pages) and output to the operator; neither can disturb a campaign.

Signals are queued: a stop stops the rig once, further ones have no effect and interrupt nothing. The display runs on a
separate thread: its first failure switches it off, and the campaign continues.
"""

from __future__ import annotations

import contextlib
import logging
import queue
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from types import FrameType
from typing import ParamSpec

from rig.campaign.live_link import LiveLink, Request
from rig.campaign.results import Display, PointResult
from rig.campaign.sequencer import event as ev
from rig.campaign.stop_cause import because
from rig.errors import Stopped
from rig.faults.row import StopKind
from rig.matrix.plan import Plan

STOPS = {
    signal.SIGINT: (StopKind.FADE_OUT, because("sigint", "said", text="Ctrl-C")),
    signal.SIGTERM: (StopKind.PRESSURE_OFF, because("sigterm", "said", text="SIGTERM")),
    signal.SIGHUP: (StopKind.PRESSURE_OFF, because("sigterm", "said", text="SIGHUP: the terminal was closed")),
}
PAUSES = (signal.SIGTSTP, signal.SIGUSR1)
"""Ctrl-Z, or `kill -USR1`: pause after the running point; once more: go on."""

BEFORE = "stopped by operator ({detail}) before the rig was connected"

Given = ParamSpec("Given")


@dataclass
class Signals:
    """What the operator asked for by signals, or on a page.

    Attributes:
        caught: numbers of signals not yet taken, oldest first.
        paused: an odd number of pauses was asked for.
        live: where pages ask; None without any.
    """

    caught: deque[int] = field(default_factory=deque)
    paused: bool = False
    live: LiveLink | None = None
    _early: deque[ev.Event] = field(default_factory=deque)

    @property
    def held(self) -> bool:
        """The campaign begins only when the operator presses Start."""
        return self.live is not None and self.live.held

    def catch(self, number: int, _frame: FrameType | None) -> None:
        """The handler: keeps the number, whatever the process does at this moment."""
        self.caught.append(number)

    def beginning(self) -> list[ev.Event]:
        """The campaign's first event; of a held one none, until the operator presses Start."""
        return [] if self.held else [ev.Begin()]

    def take(self) -> list[ev.Event]:
        """What was asked for since the last call, oldest first."""
        events: list[ev.Event] = [*self._early, *self._requests()]
        self._early.clear()
        while self.caught:
            number = signal.Signals(self.caught.popleft())
            if number in PAUSES:
                self.paused = not self.paused
                events.append(ev.PauseAsked() if self.paused else ev.ResumeAsked())
            else:
                stop, cause = STOPS[number]
                events.append(ev.Abort(stop, cause))
        if self.live is not None:
            self.live.paused = self.paused
        return events

    def _requests(self) -> list[ev.Event]:
        """What pages asked for; a pause that is there already, or a start of what runs, changes nothing."""
        events: list[ev.Event] = []
        for request in () if self.live is None else self.live.take():
            if request.do is Request.STOP:
                events.append(ev.Abort(StopKind.FADE_OUT, because("operator", "page-stop", by=request.by)))
            elif request.do is Request.BEGIN:
                events.append(ev.Begin())
            elif self.paused is not (request.do is Request.PAUSE):
                self.paused = not self.paused
                events.append(ev.PauseAsked() if self.paused else ev.ResumeAsked())
        return events

    def check(self) -> None:
        """Obey before the rig is connected, where a stop needs no order.

        Raises:
            Stopped: the operator asked for a stop.
        """
        for number in tuple(self.caught):
            if number in STOPS:
                _, cause = STOPS[signal.Signals(number)]
                raise Stopped(cause.slug, BEFORE.format(detail=cause.detail))
        for event in self._requests():
            if isinstance(event, ev.Abort):
                raise Stopped(event.cause.slug, BEFORE.format(detail=event.cause.detail))
            self._early.append(event)


@contextmanager
def operator_signals() -> Iterator[Signals]:
    """While the block runs, SIGINT, SIGTERM and SIGHUP become `Abort` events instead of ending the process.

    Ctrl-Z must not suspend a process that a moving rig depends on: it asks for a pause, and the next one ends it.
    Outside the main thread Python cannot catch signals; then nothing is caught here and the main thread's handlers act.
    """
    signals, before = Signals(), {}
    if threading.current_thread() is threading.main_thread():
        for number in (*STOPS, *PAUSES):
            before[number] = signal.signal(number, signals.catch)
    try:
        yield signals
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


log = logging.getLogger(__name__)

DISPLAY_ENDS_S = 5.0
MOST_WAITING = 10_000
"""Calls kept for a display that is slow or stands still (Ctrl-S, a pipe that is not read); further ones are lost."""


class GuardedDisplay:
    """Passes everything on to `display`, in order, on a thread of its own, until it fails once.

    A terminal that is closed or stands still must not stop a rig, nor keep it from being stopped.
    """

    def __init__(self, display: Display) -> None:
        self.failed = ""
        """What the display failed with; empty while it works."""
        self._waiting: queue.Queue[Callable[[], None] | None] = queue.Queue(MOST_WAITING)
        self._thread = threading.Thread(target=self._work, name="display", daemon=True)
        self._thread.start()
        self.planned = self._later(display.planned)
        self.phase = self._later(display.phase)
        self.progress = self._later(display.progress, live=True)
        self.point_done = self._later(display.point_done)
        self.message = self._later(display.message)

    def close(self, timeout_s: float) -> None:
        """Show what waits, for `timeout_s` at most; nothing is shown after that."""
        self._put(None)
        self._thread.join(timeout_s)
        self.failed = self.failed or "closed"

    def _later(self, show: Callable[Given, None], *, live: bool = False) -> Callable[Given, None]:
        """`show` on the display's thread; what is `live` is left out while anything else waits."""

        def shown_later(*values: Given.args, **named: Given.kwargs) -> None:
            if not self.failed and (self._waiting.empty() or not live):
                self._put(partial(show, *values, **named))

        return shown_later

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
                log.exception("the display failed and was switched off; the campaign continues")


class Displays:
    """Several displays, each told everything."""

    def __init__(self, *displays: GuardedDisplay) -> None:
        self._displays = displays

    def planned(self, plan: Plan) -> None:
        """To each."""
        for display in self._displays:
            display.planned(plan)

    def phase(self, text: str) -> None:
        """To each."""
        for display in self._displays:
            display.phase(text)

    def progress(self, point_id: str, cycles_done: int, time_left_s: float, live: Mapping[str, float]) -> None:
        """To each."""
        for display in self._displays:
            display.progress(point_id, cycles_done, time_left_s, live)

    def point_done(self, result: PointResult) -> None:
        """To each."""
        for display in self._displays:
            display.point_done(result)

    def message(self, level: str, text: str) -> None:
        """To each."""
        for display in self._displays:
            display.message(level, text)

    def close(self, timeout_s: float) -> None:
        """Show what waits, for `timeout_s` each at most."""
        for display in self._displays:
            display.close(timeout_s)


@contextmanager
def operator_link(display: Display, live: LiveLink | None = None) -> Iterator[tuple[Signals, Displays]]:
    """The operator's wishes, and displays that cannot hold the campaign up; what still waits is shown at the end.

    Args:
        display: where the campaign was started.
        live: the folder that pages read; None without any.
    """
    shown = Displays(*(GuardedDisplay(one) for one in (display, *(() if live is None else (live.display,)))))
    try:
        with operator_signals() as signals:
            signals.live = live
            shown.phase("preparing")
            yield signals, shown
    finally:
        shown.close(DISPLAY_ENDS_S)

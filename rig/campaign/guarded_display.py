"""A display that cannot hurt a campaign: the first failure switches it off, the rig goes on."""

from __future__ import annotations

import contextlib
import logging
import queue
import threading
from collections.abc import Callable, Mapping

from rig.campaign.options import Display, PointResult
from rig.matrix.plan import Plan

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

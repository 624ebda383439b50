"""A display that cannot hurt a campaign: the first failure switches it off, the rig goes on."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping

from rig.campaign.options import Display, PointResult
from rig.matrix.plan import Plan

log = logging.getLogger(__name__)


class GuardedDisplay:
    """Passes everything on to `display` until it fails once; a closed terminal must not stop a rig."""

    def __init__(self, display: Display) -> None:
        self._display = display
        self.failed = ""
        """What the display failed with; empty while it works."""

    def planned(self, plan: Plan) -> None:
        """As `Display.planned`."""
        self._show(lambda: self._display.planned(plan))

    def phase(self, text: str) -> None:
        """As `Display.phase`."""
        self._show(lambda: self._display.phase(text))

    def progress(self, point_id: str, cycles_done: int, time_left_s: float, live: Mapping[str, float]) -> None:
        """As `Display.progress`."""
        self._show(lambda: self._display.progress(point_id, cycles_done, time_left_s, live))

    def point_done(self, result: PointResult) -> None:
        """As `Display.point_done`."""
        self._show(lambda: self._display.point_done(result))

    def message(self, level: str, text: str) -> None:
        """As `Display.message`."""
        self._show(lambda: self._display.message(level, text))

    def _show(self, show: Callable[[], None]) -> None:
        if self.failed:
            return
        try:
            show()
        except Exception as error:
            self.failed = f"{type(error).__name__}: {error}"
            log.exception("the display failed and stays dark; the campaign goes on")

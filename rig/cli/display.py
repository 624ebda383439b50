"""The operator's display of a running campaign: live on a terminal, plain lines elsewhere."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from types import TracebackType
from typing import TYPE_CHECKING, Self

from rich.console import Console, Group
from rich.live import Live
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
from rich.text import Text

from rig.cli.tables import COLOURS, plan_table
from rig.cli.words import verdict_words
from rig.display import SI, Shown
from rig.jobs.time_left import duration

if TYPE_CHECKING:
    from rig.campaign.results import PointResult
    from rig.display import Display
    from rig.matrix.plan import Plan
    from rig.recording.recorded_point import RecordedPoint
    from rig.test_point import TestPoint

AMPERE = Shown("A", 1.0)
"""Currents are shown in it whatever the display."""
# Live value -> (label, quantity of the display, resolution in SI, characters).
LIVE = {
    "position_m": ("position", "displacement", 1e-4, 8),
    "force_N": ("force", "force", 1.0, 7),
    "current_A": ("current", "current", 0.01, 6),
    "coil_temperature_degC": ("coil", "temperature", 0.1, 6),
}
PHRASE, PEAKS = 24, 26
"""Columns of a point's line."""
MARKS = {"valid": "✓", "suspect": "?", "invalid": "✗"}
LEVELS = {"info": "", "warning": "yellow", "error": "red"}


def described(point: RecordedPoint, shown: Display = SI) -> str:
    """A point that was not planned here, in one phrase: "sine 50 mm 1.5 Hz 1 A"."""
    if point.has_frequency and point.frequency_Hz == 0.0:
        return point.phrase(shown)
    amplitude = shown.displacement.text(point.amplitude_m)
    return f"{point.waveform} {amplitude} {point.rate(shown)} {round(point.current_A, 3) + 0.0:.3g} A"


def peaks(result: PointResult, shown: Display) -> str:
    """A point's peak forces: "comp. -790, reb. 812 N"; empty where they are not known."""
    peak = result.peak_force
    if peak is None:
        return ""
    compression = shown.force.signed(peak.compression_N)
    return f"comp. {compression:.4g}, reb. {shown.force.signed_text(peak.rebound_N)}"


class PlainDisplay:
    """One line an event; for files, pipes and continuous integration. Implements `rig.campaign.results.Display`."""

    def __init__(self, console: Console) -> None:
        self.console = console
        self.total = 0
        self.done = 0
        self.shown = SI
        self.time_left_s = 0.0
        self._seen: set[str] = set()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        return None

    def planned(self, plan: Plan) -> None:
        """Print the plan."""
        self.total, self.shown = len(plan.points), plan.display
        for part in plan_table(plan):
            self.console.print(part)

    def phase(self, text: str) -> None:
        """Print a phase when it is entered for the first time; every point goes through most of them."""
        if text not in self._seen:
            self._seen.add(text)
            self.console.print(Text(f"  {text}", style="dim"))

    def progress(self, point_id: str, cycles_done: int, time_left_s: float, live: Mapping[str, float]) -> None:
        """Remember the time left for the next point's line."""
        del point_id, cycles_done, live
        self.time_left_s = time_left_s

    def point_done(self, result: PointResult) -> None:
        """Print a point's peak forces, its verdict and reasons, and the time left."""
        self.done += 1
        line = Text(f"{MARKS.get(result.verdict, '-')} {result.id}  ", style=COLOURS.get(result.verdict, ""))
        forces = peaks(result, self.shown)
        line.append(f"{result.point.phrase(self.shown):<{PHRASE}} {forces:<{PEAKS if forces else 0}} ", style="none")
        line.append(verdict_words(result))
        line.append(self._left(), style="dim")
        self.console.print(line)

    def _left(self) -> str:
        """How far the campaign is."""
        return f"   {self.done}/{self.total}, {duration(self.time_left_s)} left"

    def message(self, level: str, text: str) -> None:
        """Print what the operator should read."""
        prefix = "" if level == "info" else f"{level}: "
        self.console.print(Text(prefix + text, style=LEVELS.get(level, "")))


class LiveDisplay(PlainDisplay):
    """The same lines, with bars and live numbers under them that are redrawn in place."""

    def __init__(self, console: Console) -> None:
        super().__init__(console)
        self._points: Mapping[str, TestPoint] = {}
        self._bars = Progress(
            TextColumn("{task.description}"),
            BarColumn(40, complete_style="cyan"),
            MofNCompleteColumn(),
            TextColumn("{task.fields[note]}"),
            console=console,
        )
        self._campaign = self._bars.add_task("campaign", total=None, note="")
        self._point = self._bars.add_task("", total=None, note="", visible=False)
        self._numbers = Text()
        self._phase = Text(style="dim")
        self._live = Live(
            Group(self._phase, self._bars, self._numbers), console=console, refresh_per_second=8, transient=True
        )

    def __enter__(self) -> Self:
        self._live.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        # A terminal that went away takes the display with it, and nothing else.
        with contextlib.suppress(OSError):
            self._live.stop()

    def planned(self, plan: Plan) -> None:
        """Print the plan and give the bars their lengths."""
        super().planned(plan)
        self._points = {item.point.id: item.point for item in plan.points}
        self._bars.update(self._campaign, total=self.total)

    def _left(self) -> str:
        """Nothing: the bars show it."""
        return ""

    def phase(self, text: str) -> None:
        """Show the phase."""
        self._phase.plain = text

    def progress(self, point_id: str, cycles_done: int, time_left_s: float, live: Mapping[str, float]) -> None:
        """Redraw bars and numbers."""
        super().progress(point_id, cycles_done, time_left_s, live)
        self._bars.update(self._campaign, completed=self.done, note=f"points, {duration(time_left_s)} left")
        point = self._points.get(point_id)
        if point is not None:
            total = round(point.cycles)
            measured = max(0, min(total, round(cycles_done - point.ramp_in_cycles)))  # ramps are none of them
            note = f"cycles, {point.phrase(self.shown)}" if point.has_frequency else point.motion
            self._bars.update(
                self._point, description=point.id, total=total, completed=measured, note=note, visible=True
            )
        else:
            self._bars.update(self._point, visible=False)
        self._numbers.plain = "   ".join(self._live_numbers(live))

    def _live_numbers(self, live: Mapping[str, float]) -> Iterator[str]:
        for name, (label, quantity, resolution, width) in LIVE.items():
            if name in live:
                shown: Shown = getattr(self.shown, quantity, AMPERE)
                yield f"{label} {shown.fixed(live[name], resolution):>{width}} {shown.unit}"


def display_for(console: Console) -> PlainDisplay:
    """Live on a terminal, plain elsewhere."""
    return LiveDisplay(console) if console.is_terminal else PlainDisplay(console)

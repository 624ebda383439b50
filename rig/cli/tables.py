"""A plan as blocks of a document: verdict, points as a table, every reason in full.

A plan of many points is shown by groups: number of points, their range, the first and the last of them.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.segment import Segment
from rich.style import Style

from rig.document.blocks import Block, Blocks, Column, Note, Paragraph, Row, table
from rig.document.terminal import Line, lines
from rig.document.words import FAIR, GOOD, PLAIN, POOR

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

    from rig.matrix.plan import Plan, PlannedPoint

FEW = 40
"""Up to so many points all rows are shown."""
FIRST, LAST = 3, 2
"""Of a longer group, so many rows from its beginning and its end."""
NO_VALUE = "-"

COLUMNS = (
    Column("point"), Column("limits"), Column("waveform"), Column("ampl.", "mm", True), Column("freq.", "Hz", True),
    Column("current", "A", True), Column("speed", "m/s", True), Column("accel.", "m/s^2", True),
    Column("force", "N", True), Column("heat", "J", True), Column("time", "", True),
)  # fmt: skip
COLOURS = {"valid": "green", "suspect": "yellow", "invalid": "red"}


def duration(seconds: float) -> str:
    """Seconds as a person says them: "4.5 s", "3 min 20 s", "34 h 12 min"."""
    if seconds < 99.5:
        return f"{seconds:.1f} s" if seconds < 9.95 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes} min"


def energy(joule: float) -> str:
    """Energy in short: "613 J", "35.2 kJ", "1.2 MJ"."""
    for scale, unit in ((1e6, "MJ"), (1e3, "kJ")):
        if joule >= 0.9995 * scale:
            return f"{joule / scale:.3g} {unit}"
    return f"{joule:.3g} J"


def number(value: float | None, digits: int = 4) -> str:
    """A number in short, "unknown" when there is none."""
    return "unknown" if value is None or not math.isfinite(value) else f"{value:.{digits}g}"


@dataclass(frozen=True)
class PlanText:
    """A plan that a console prints at its own width; `everything`: every row, however many there are."""

    plan: Plan
    everything: bool = False

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        for text, style in self.lines(options.max_width):
            yield Segment(text, Style.parse(style))
            yield Segment.line()

    def __str__(self) -> str:
        return "\n".join(text for text, _ in self.lines(80))

    def lines(self, width: int) -> Iterator[Line]:
        """The lines and their styles, none longer than `width` characters."""
        return lines(plan_blocks(self.plan, everything=self.everything), width)


def plan_blocks(plan: Plan, *, everything: bool = False) -> Blocks:
    """The plan; of a long one the first and last rows of each group, or `everything`."""
    items = plan.planned_points
    shown = _rows(items, plan) if everything or len(items) <= FEW else _groups(items, plan)
    return [*_verdict(plan), *shown, *(Note(FAIR, f"warning: {text}") for text in plan.warnings)]


def _verdict(plan: Plan) -> Blocks:
    bad, total = sum(not item.feasible for item in plan.points), len(plan.points)
    stated = f"all {total} points within limits" if bad == 0 else f"{bad} of {total} points outside limits"
    if plan.warm_up is not None and not plan.warm_up.feasible:
        stated += ", warm-up outside limits"
    heat = "" if plan.energy_J is None else f"; {energy(plan.energy_J)} of heat"
    return [
        Note(GOOD if plan.feasible else POOR, stated),
        Paragraph(f"{plan.specimen} on {plan.bench_name}; {_rig_time(plan)}{heat}; force {plan.prediction}"),
    ]


def _rig_time(plan: Plan) -> str:
    if plan.duration_s is not None:
        return f"{duration(plan.duration_s)} of rig time"
    return f"{duration(plan.recorded_s)} of motion; the time for warm-up and cooling is unknown"


def _groups(items: Sequence[PlannedPoint], plan: Plan) -> Blocks:
    """Points of one verdict and one set of causes together."""
    groups: dict[tuple[str, ...], list[PlannedPoint]] = {}
    for item in items:
        groups.setdefault(tuple(cause.slug for cause in item.causes), []).append(item)
    shown, blocks = 0, list[Block]()
    for slugs, members in groups.items():
        verdict = f"outside limits ({', '.join(slugs)})" if slugs else "within limits"
        count = f"{len(members)} point{'s' if len(members) > 1 else ''}"
        few = len(members) <= FIRST + LAST + 1
        rows = members if few else [*members[:FIRST], *members[-LAST:]]
        shown += len(rows)
        blocks += [Paragraph(""), Note(POOR if slugs else GOOD, f"{verdict}: {count}, {_ranges(members)}")]
        blocks += _rows(rows, plan, left_out=0 if few else len(members) - len(rows))
    stated = f"{shown} of {len(items)} rows shown; use --all to show all rows, or --json for the data"
    return [*blocks, Paragraph(""), Paragraph(stated)]


def _ranges(items: Sequence[PlannedPoint]) -> str:
    values = {
        "mm": [1e3 * item.point.amplitude_m for item in items],
        "Hz": [item.point.frequency_Hz for item in items if item.point.has_frequency],
        "A": [item.point.current_A for item in items],
    }
    return ", ".join(
        f"{min(all_of):.4g} {unit}" if min(all_of) == max(all_of) else f"{min(all_of):.4g} to {max(all_of):.4g} {unit}"
        for unit, all_of in values.items()
        if all_of
    )


def _rows(items: Sequence[PlannedPoint], plan: Plan, left_out: int = 0) -> Blocks:
    """A table, then the reasons of points outside limits. `left_out` rows follow the first ones."""
    rows = [Row(_cells(item), PLAIN if item.feasible else POOR) for item in items]
    if left_out:
        rows.insert(FIRST, Row((f"... {left_out} more ...", *[""] * (len(COLUMNS) - 1))))
    reasons = [
        Note(POOR, f"{item.point.id}: {_why(item, item is plan.warm_up)}") for item in items if not item.feasible
    ]
    return [table(COLUMNS, rows), *reasons]


def _cells(item: PlannedPoint) -> tuple[str, ...]:
    point = item.point
    frequency = f"{point.frequency_Hz:.4g}" if point.has_frequency else NO_VALUE
    return (
        point.id, "within" if item.feasible else "outside", point.motion, f"{point.amplitude_m * 1e3:.4g}",
        frequency, f"{point.current_A:.3g}", f"{item.peaks.speed_m_s:.3f}",
        f"{item.peaks.acceleration_m_s2:.2f}", number(item.predicted_force_N), number(item.energy_J),
        duration(item.duration_s),
    )  # fmt: skip


def _why(item: PlannedPoint, warm_up: bool) -> str:
    """A point's reasons; a warm-up that does not warm enough needs more amplitude, not another that fits."""
    if item.would_fit_m is None and warm_up:
        return "; ".join(item.reasons)
    fit = "no amplitude fits" if item.would_fit_m is None else f"{item.would_fit_m * 1e3:.2f} mm fits"
    return "; ".join((*item.reasons, fit))


def plan_table(plan: Plan) -> list[PlanText]:
    """The plan as text, for a console of any width."""
    return [PlanText(plan)]

"""A plan as blocks of a document: points as a table, a line for each cause that refuses points, the verdict last.

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
from rig.document.words import FAIR, GOOD, PLAIN, POOR, all_of
from rig.errors import clean_text, some
from rig.jobs.time_left import duration

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

    from rig.display import Display
    from rig.matrix.feasibility import Reason
    from rig.matrix.plan import Plan, PlannedPoint

FEW = 40
"""Up to so many points all rows are shown."""
FIRST, LAST = 3, 2
"""Of a longer group, so many rows from its beginning and its end."""
MOST_SPANS = 6
"""Runs of neighbouring points that a line names."""
SHORT = {
    "stopping-distance": "stopping", "specimen-current": "current", "current-settling": "settling",
    "hybrid-unstable": "unstable",
}  # fmt: skip
"""Causes as a narrow column names them."""
NO_VALUE = "-"

COLOURS = {"valid": "green", "suspect": "yellow", "invalid": "red"}


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
    """The plan, its verdict last; of a long one the first and last rows of each group, or `everything`."""
    items = plan.planned_points
    shown = _rows(items, plan) if everything or len(items) <= FEW else _groups(items, plan)
    reasons = [Note(POOR, f"{item.point.id}: {_why(item, plan)}") for item in items if everything and item.causes]
    return [
        *shown, *reasons, *_causes(items), *(Note(FAIR, f"warning: {text}") for text in plan.warnings), Paragraph(""),
        *verdict_blocks(plan),
    ]  # fmt: skip


def verdict_blocks(plan: Plan) -> Blocks:
    """What is planned, and whether it is within limits."""
    bad, total = sum(not item.feasible for item in plan.points), len(plan.points)
    stated = f"{bad} of {total} points outside limits" if bad else f"{all_of(total, 'point')} within limits"
    if plan.warm_up is not None and not plan.warm_up.feasible:
        stated += ", warm-up outside limits"
    heat = "" if plan.energy_J is None else f"; {energy(plan.energy_J)} of heat"
    return [
        *map(Paragraph, _endurance(plan)),
        Paragraph(f"{plan.specimen} on {plan.bench_name}; {_rig_time(plan)}{heat}; force {plan.prediction}"),
        Note(GOOD if plan.feasible else POOR, stated),
    ]


def _causes(items: Sequence[PlannedPoint]) -> Blocks:
    """A line for each cause: its points, and its reason; where that has other numbers at each point, the worst one."""
    blamed: dict[tuple[str, int], list[tuple[str, Reason]]] = {}
    for item in items:
        for number, cause in enumerate(item.causes):  # a point may have two causes with the same slug
            before = sum(other.slug == cause.slug for other in item.causes[:number])
            blamed.setdefault((cause.slug, before), []).append((item.point.id, cause))
    lines, order = list[Block](), [item.point.id for item in items]
    for (slug, _), members in blamed.items():
        name, worst = max(members, key=lambda one: one[1].excess)
        alike = len({cause.text for _, cause in members}) == 1
        at = "" if len(members) == 1 or alike else f"worst point {name}: "
        count = "" if len(members) == 1 else f"{len(members)} points, "
        ids = _spans([one for one, _ in members], order)
        lines.append(Note(POOR, f"{slug} ({count}{ids}): {at}{clean_text(worst.text)}"))
    return lines


def _spans(ids: Sequence[str], order: Sequence[str]) -> str:
    """Some of the points in order, neighbours together: "p001 to p004, p009"; the first ones of many."""
    place_of = {name: place for place, name in enumerate(order)}
    places = sorted(place_of[name] for name in ids)
    spans: list[list[int]] = []
    for place in places:
        if spans and place == spans[-1][-1] + 1:
            spans[-1].append(place)
        else:
            spans.append([place])
    words = [
        order[span[0]] if len(span) == 1 else f"{order[span[0]]}{' to ' if len(span) > 2 else ', '}{order[span[-1]]}"
        for span in spans
    ]
    return some(words, most=MOST_SPANS)


def _endurance(plan: Plan) -> Iterator[str]:
    """Each endurance test in one line, and the disk space that they need."""
    # loads numpy: not needed for the help
    from rig.matrix.plan import endurance_json

    tests = endurance_json(item.point for item in plan.points)
    for test in tests:
        yield (
            f"endurance test {test['id']}: {test['cycles']:,} cycles in {test['blocks']:,} blocks of at most "
            f"{test['cycles_per_block']:,} cycles, {test['performance_points']:,} performance points in between and at "
            f"the end; {duration(test['motion_s'])} of motion"
        )
    if tests:
        working, blocks = plan.storage.working / 1e6, plan.storage.blocks / 1e6
        yield (
            f"disk space: about {plan.storage.total / 1e6:,.0f} MB, of which {blocks:,.0f} MB for the blocks and "
            f"{working:,.0f} MB for the journal of the running block"
        )


def _rig_time(plan: Plan) -> str:
    trials = f", of which trials of signals take up to {duration(plan.trials_s)}" if plan.trials_s else ""
    most = "up to " if trials else ""
    if plan.duration_s is not None:
        return f"{most}{duration(plan.duration_s)} of rig time{trials}"
    motion_s = plan.recorded_s + plan.trials_s
    return f"{most}{duration(motion_s)} of motion{trials}; the time for warm-up and cooling is unknown"


def _groups(items: Sequence[PlannedPoint], plan: Plan) -> Blocks:
    """Points of one verdict and one set of causes together."""
    groups: dict[tuple[str, ...], list[PlannedPoint]] = {}
    for item in items:
        groups.setdefault(tuple(cause.slug for cause in item.causes), []).append(item)
    shown, blocks = 0, list[Block]()
    for slugs, members in groups.items():
        verdict = f"outside limits ({', '.join(dict.fromkeys(slugs))})" if slugs else "within limits"
        count = f"{len(members)} point{'s' if len(members) > 1 else ''}"
        few = len(members) <= FIRST + LAST + 1
        rows = members if few else [*members[:FIRST], *members[-LAST:]]
        shown += len(rows)
        ranges = _ranges(members, plan.display)
        blocks += [Paragraph(""), Note(POOR if slugs else GOOD, f"{verdict}: {count}, {ranges}")]
        blocks += _rows(rows, plan, left_out=0 if few else len(members) - len(rows))
    stated = f"{shown} of {len(items)} rows shown; use --all to show all rows, or --json for the data"
    return [*blocks, Paragraph(""), Paragraph(stated)]


def _ranges(items: Sequence[PlannedPoint], shown: Display) -> str:
    values = {
        shown.displacement.unit: [shown.displacement.value(item.point.amplitude_m) for item in items],
        "Hz": [item.point.frequency_Hz for item in items if item.point.has_frequency],
        "A": [item.point.current_A for item in items],
    }
    return ", ".join(
        f"{min(all_of):.4g} {unit}" if min(all_of) == max(all_of) else f"{min(all_of):.4g} to {max(all_of):.4g} {unit}"
        for unit, all_of in values.items()
        if all_of
    )


def _rows(items: Sequence[PlannedPoint], plan: Plan, left_out: int = 0) -> Blocks:
    """A table with each motion's own speed and acceleration.

    In a plan that is refused, cause and amplitude or speed that would fit replace heat and time.
    `left_out` rows follow the first ones.
    """
    shown, refused = plan.display, not plan.feasible
    length = shown.displacement.unit
    fit_units = {item.fits(shown)[1] for item in items if not item.feasible}
    with_unit = len(fit_units) > 1  # amplitudes and speeds
    fits = "fits" if with_unit or not fit_units else f"fits ({next(iter(fit_units))})"
    head = [
        Column("point"), *([Column("limits")] if refused else []), Column("waveform"), Column("ampl.", length, True),
        *([Column(fits, "", True)] if refused else []), Column("freq.", "Hz", True), Column("current", "A", True),
        Column("speed", shown.speed.unit, True), Column("accel.", shown.acceleration.unit, True),
        Column("force", shown.force.unit, True),
        *([] if refused else [Column("heat", "J", True), Column("time", "", True)]),
    ]  # fmt: skip
    rows = [Row(_cells(item, plan, with_unit=with_unit), PLAIN if item.feasible else POOR) for item in items]
    if left_out:
        rows.insert(FIRST, Row((f"... {left_out} more ...", *[""] * (len(head) - 1))))
    return [table(head, rows)]


def _cells(item: PlannedPoint, plan: Plan, *, with_unit: bool) -> tuple[str, ...]:
    point, shown, refused = item.point, plan.display, not plan.feasible
    frequency = f"{point.frequency_Hz:.4g}" if point.has_frequency else NO_VALUE
    causes = [SHORT.get(cause.slug, cause.slug) for cause in item.causes] or ["within"]
    limits = causes[0] if len(causes) == 1 else f"{causes[0]} +{len(causes) - 1}"
    force_N = item.predicted_force_N
    return (
        point.id, *([limits] if refused else []), point.motion, number(shown.displacement.value(point.amplitude_m)),
        *([_fits(item, plan, with_unit=with_unit)] if refused else []), frequency, f"{point.current_A:.3g}",
        number(shown.speed.value(point.peak_speed_m_s), 3),
        f"{shown.acceleration.value(point.peak_acceleration_m_s2):.2f}",
        number(None if force_N is None else shown.force.value(force_N)),
        *([] if refused else [number(item.energy_J), duration(item.duration_s)]),
    )  # fmt: skip


def _fits(item: PlannedPoint, plan: Plan, *, with_unit: bool) -> str:
    """What would fit, rounded down; a warm-up that does not warm enough needs more of it."""
    value, unit = item.fits(plan.display)
    if item.feasible or (not value and item is plan.warm_up):
        return NO_VALUE
    return "none" if not value else f"{value} {unit}" if with_unit else value


def _why(item: PlannedPoint, plan: Plan) -> str:
    """A point's reasons, and what would fit."""
    fits = item.fits_text(plan.display)
    if not fits and item is not plan.warm_up:
        fits = "no speed is allowed at this stroke" if item.point.by_speed else "no amplitude fits"
    return "; ".join((*item.reasons, *([fits] if fits else [])))


def plan_table(plan: Plan) -> list[PlanText]:
    """The plan as text, for a console of any width."""
    return [PlanText(plan)]

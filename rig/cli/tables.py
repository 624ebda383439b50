"""A plan as text for any width: the verdict first, then the points as a table or in blocks, then every reason in full.

A plan of many points is shown by groups: how many points, over which range, the first and the last of them.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from rich.segment import Segment
from rich.style import Style

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult

    from rig.matrix.plan import Plan, PlannedPoint

FEW = 40
"""Up to so many points all rows are shown."""
FIRST, LAST = 3, 2
"""Of a longer group, so many rows from its beginning and its end."""
NARROWEST = 20
NO_VALUE = "-"

HEADINGS = (
    ("point", ""), ("verdict", ""), ("waveform", ""), ("ampl.", "mm"), ("freq.", "Hz"), ("current", "A"),
    ("speed", "m/s"), ("accel.", "m/s^2"), ("force", "N"), ("heat", "J"), ("time", ""),
)  # fmt: skip
LEFT = frozenset({0, 1, 2})
GOOD, BAD, LOOK, PLAIN, HEAD = "green", "red", "yellow", "", "bold"

COLOURS = {"valid": "green", "feasible": "green", "suspect": "yellow", "infeasible": "red", "invalid": "red"}

Line = tuple[str, str]
"""A text without line end, and its style."""


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
    return "unknown" if value is None else f"{value:.{digits}g}"


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
        width = max(NARROWEST, width)
        yield from _verdict(self.plan, width)
        items = self.plan.judged
        if self.everything or len(items) <= FEW:
            yield ("", PLAIN)
            yield from _rows(items, self.plan, width)
        else:
            yield from _groups(items, self.plan, width)
        for text in self.plan.warnings:
            yield from _wrapped(f"warning: {text}", width, LOOK)


def _verdict(plan: Plan, width: int) -> Iterator[Line]:
    bad, total = sum(not item.feasible for item in plan.points), len(plan.points)
    told = f"all {total} points feasible" if bad == 0 else f"{bad} of {total} points infeasible"
    if plan.warm_up is not None and not plan.warm_up.feasible:
        told += ", warm-up infeasible"
    yield from _wrapped(told, width, GOOD if plan.feasible else BAD)
    heat = "" if plan.energy_J is None else f"; {energy(plan.energy_J)} of heat"
    yield from _wrapped(
        f"{plan.specimen} on {plan.bench_name}; {_rig_time(plan)}{heat}; force {plan.prediction}", width, PLAIN
    )


def _rig_time(plan: Plan) -> str:
    if plan.duration_s is not None:
        return f"{duration(plan.duration_s)} of rig time"
    return f"{duration(plan.recorded_s)} of motion; how long warming up and cooling down take is unknown"


def _groups(items: Sequence[PlannedPoint], plan: Plan, width: int) -> Iterator[Line]:
    """Points of one verdict and one set of causes together."""
    groups: dict[tuple[str, ...], list[PlannedPoint]] = {}
    for item in items:
        groups.setdefault(tuple(cause.slug for cause in item.causes), []).append(item)
    shown = 0
    for slugs, members in groups.items():
        verdict = f"infeasible ({', '.join(slugs)})" if slugs else "feasible"
        count = f"{len(members)} point{'s' if len(members) > 1 else ''}"
        yield ("", PLAIN)
        yield from _wrapped(f"{verdict}: {count}, {_ranges(members)}", width, BAD if slugs else GOOD)
        few = len(members) <= FIRST + LAST + 1
        rows = members if few else [*members[:FIRST], *members[-LAST:]]
        shown += len(rows)
        yield from _rows(rows, plan, width, left_out=0 if few else len(members) - len(rows))
    yield ("", PLAIN)
    yield from _wrapped(f"{shown} of {len(items)} rows shown; --all shows all of them, --json as data", width, PLAIN)


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


def _rows(items: Sequence[PlannedPoint], plan: Plan, width: int, left_out: int = 0) -> Iterator[Line]:
    """A table where it fits, else a block for each point; then the reasons. `left_out` rows follow the first ones."""
    cells = [_cells(item) for item in items]
    widths = [max(map(len, column)) for column in zip(*zip(*HEADINGS, strict=True), *cells, strict=True)]
    gap = 2 if sum(widths) + 2 * (len(widths) - 1) <= width else 1
    table = sum(widths) + gap * (len(widths) - 1) <= width
    if table:
        for row in zip(*HEADINGS, strict=True):
            yield (_aligned(row, widths, gap), HEAD)
    for index, (item, row) in enumerate(zip(items, cells, strict=True)):
        style = PLAIN if item.feasible else BAD
        if left_out and index == FIRST:
            yield (f"... {left_out} more ...", PLAIN)
        if table:
            yield (_aligned(row, widths, gap), style)
        else:
            yield from _block(item, width, style)
    for item in items:
        if not item.feasible:
            yield from _wrapped(f"{item.point.id}: {_why(item, item is plan.warm_up)}", width, BAD)


def _cells(item: PlannedPoint) -> tuple[str, ...]:
    point = item.point
    frequency = f"{point.frequency_Hz:.4g}" if point.has_frequency else NO_VALUE
    return (
        point.id, "feasible" if item.feasible else "infeasible", point.motion, f"{point.amplitude_m * 1e3:.4g}",
        frequency, f"{point.current_A:.3g}", f"{item.peaks.speed_m_s:.3f}",
        f"{item.peaks.acceleration_m_s2:.2f}", number(item.predicted_force_N), number(item.energy_J),
        duration(item.duration_s),
    )  # fmt: skip


def _aligned(row: Sequence[str], widths: Sequence[int], gap: int) -> str:
    padded = [text.ljust(size) if column in LEFT else text.rjust(size)
              for column, (text, size) in enumerate(zip(row, widths, strict=True))]  # fmt: skip
    return (" " * gap).join(padded).rstrip()


def _block(item: PlannedPoint, width: int, style: str) -> Iterator[Line]:
    name, verdict, waveform, *values = _cells(item)
    amplitude, frequency, current, speed, acceleration, force, heat, time = values
    yield from _wrapped(f"{name} {verdict}", width, style)
    often = () if frequency == NO_VALUE else (f"{frequency} Hz",)
    parts = (
        f"{waveform} {amplitude} mm", *often, f"{current} A", f"speed {speed} m/s",
        f"accel. {acceleration} m/s^2", f"force {force}{'' if force == 'unknown' else ' N'}",
        f"heat {heat}{'' if heat == 'unknown' else ' J'}", time,
    )  # fmt: skip
    glued = ", ".join(part.replace(" ", "\0") for part in parts)
    for text, _ in _wrapped(glued, width - 2, PLAIN):
        yield (f"  {text.strip()}".replace("\0", " "), PLAIN)


def _why(item: PlannedPoint, warm_up: bool) -> str:
    """A point's reasons; a warm-up that does not warm enough needs more amplitude, not another that fits."""
    if item.would_fit_m is None and warm_up:
        return "; ".join(item.reasons)
    fit = "no amplitude would fit" if item.would_fit_m is None else f"{item.would_fit_m * 1e3:.2f} mm would fit"
    return "; ".join((*item.reasons, fit))


def _wrapped(text: str, width: int, style: str) -> Iterator[Line]:
    """Lines of at most `width`; the second and later ones are indented."""
    indent = "  " if width > NARROWEST else ""
    for line in textwrap.wrap(text, width, subsequent_indent=indent, break_on_hyphens=False):
        yield (line, style)


def plan_table(plan: Plan) -> list[PlanText]:
    """The plan as text, for a console of any width."""
    return [PlanText(plan)]

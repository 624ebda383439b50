"""A plan as text for any width: the verdict first, then the points as a table or in blocks, then every reason in full.

A plan of many points is shown by groups: how many points, over which range, the first and the last of them.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rich.segment import Segment
from rich.style import Style
from rich.table import Table
from rich.text import Text

from rig.matrix.methods import FEW_MODELS

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
        frequency, f"{point.current_A:.3g}", f"{point.peak_speed_m_s:.3f}",
        f"{point.peak_acceleration_m_s2:.2f}", number(item.predicted_force_N), number(item.energy_J),
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


if TYPE_CHECKING:
    from rig.matrix.plan import Plan

__all__ = ["COLOURS", "duration", "fit_tables", "inside", "number", "plan_table"]

INADEQUATE = (
    "Model error exceeds the repeatability of the tests: the values are a best fit, the intervals do not include model "
    "error"
)
INTERVAL = "95 % interval (each parameter by itself)"
COLOURS = {"valid": "green", "feasible": "green", "suspect": "yellow", "infeasible": "red", "invalid": "red"}


def plan_table(plan: Plan) -> list[PlanText]:
    """The plan as text, for a console of any width."""
    return [PlanText(plan)]


def fit_tables(fit: Mapping[str, Any], truth: Mapping[str, float] | None = None) -> list[Table | Text]:
    """A fit (the keys of `rig identify --json`) as tables and sentences.

    With `truth` (parameter values of a simulated damper) its column and whether the interval holds it are added.
    """
    table = Table(title=f"Fit: {fit['model']} by {fit['method']}", title_justify="left")
    for name in ("parameter", "value", str(fit.get("interval", INTERVAL)), "unit"):
        table.add_column(name, justify="right" if name == "value" else "left")
    drawn = (fit.get("bootstrap") or {}).get("parameters")
    if drawn is not None:
        table.add_column(f"95 %, tests drawn {fit['bootstrap']['count']} times")
    if truth is not None:
        table.add_column("truth", justify="right")
        table.add_column("inside")
    for name, entry in fit["parameters"].items():
        row = [name, *_estimate(entry), str(entry["unit"])]
        if drawn is not None:
            row.append(f"{drawn[name]['low']:.5g} to {drawn[name]['high']:.5g}" if name in drawn else "-")
        if truth is not None:
            true = truth.get(name)
            row += ["-" if true is None else f"{true:.5g}", {True: "yes", False: "NO", None: "-"}[inside(entry, true)]]
        table.add_row(*row, style="" if entry["identifiable"] else "yellow")
    told = fit.get("formula") or fit.get("equation")
    equation = [Text(str(told))] if told else []
    return [*_ranking(fit), table, *equation, *_held_out(fit), *_pairs(fit), *_remarks(fit), *_to_try(fit)]


REFERENCES = {"mean_cycle": "no model: its own other cycles", "regression": "no model: regression"}


def _ranking(fit: Mapping[str, Any]) -> list[Table | Text]:
    """The models compared, best first, and why one of them was given up; none where there is one."""
    scores = fit.get("selection") or ()
    if len(scores) < 2:
        return []
    table = Table(title="Models compared, best first", title_justify="left")
    for name in ("model", "error on unseen tests, % of peak", "RMSE N", "parameters"):
        table.add_column(name, justify="left" if name == "model" else "right")
    for entry in scores:
        unseen = entry.get("holdout_nrmse_percent_of_peak")
        numbers = ("-" if unseen is None else number(unseen, 3), "-" if entry.get("rmse_N") is None else
                   number(entry["rmse_N"], 3), str(entry.get("parameters", "-")))  # fmt: skip
        table.add_row(str(entry["model"]), *numbers, style="yellow" if entry.get("reason") else "")
    for entry in fit.get("references") or ():
        unseen, name = entry.get("holdout_nrmse_percent_of_peak"), REFERENCES.get(entry["name"], entry["name"])
        table.add_row(name, entry.get("reason") if unseen is None else number(unseen, 3), "-", "-", style="dim")
    return [table, *(Text(str(entry["reason"]), style="yellow") for entry in scores if entry.get("reason"))]


def _held_out(fit: Mapping[str, Any]) -> list[Table]:
    """The error of each held-out test; none where no test was held out."""
    tests = (fit["error"].get("holdout") or {}).get("per_test") or ()
    if not tests:
        return []
    table = Table(title="Held-out tests", title_justify="left")
    for name in ("test", "error, % of peak", "RMSE N", "its own scatter N"):
        table.add_column(name, justify="left" if name == "test" else "right")
    for test in tests:
        values = (test.get(key) for key in ("nrmse_percent_of_peak", "rmse_N", "noise_N"))
        table.add_row(str(test.get("id", "-")), *("-" if value is None else number(value, 3) for value in values))
    return [table]


def _pairs(fit: Mapping[str, Any]) -> list[Table]:
    """The error of each amplitude and frequency foretold from the others; none where that was not asked for."""
    unseen = fit.get("unseen")
    if not unseen:
        return []
    title = f"Foretold from the others: {number(unseen['nrmse_percent_of_peak'], 3)} % of peak on the mean"
    table = Table(title=title, title_justify="left")
    for name in ("amplitude mm", "frequency Hz", "tests", "error, % of peak", "worst test", "its error"):
        table.add_column(name, justify="left" if name == "worst test" else "right")
    for pair in unseen["per_pair"]:
        motion = pair["amplitude_m"], pair["frequency_Hz"]
        tests = [test for test in unseen["per_test"] if (test["amplitude_m"], test["frequency_Hz"]) == motion]
        worst = max(tests, key=lambda test: float(test["nrmse_percent_of_peak"]))
        errors = (pair["nrmse_percent_of_peak"], worst["nrmse_percent_of_peak"])
        mean, most = (number(error, 3) for error in errors)
        row = (number(1e3 * motion[0]), number(motion[1]), str(pair["tests"]), mean, str(worst["id"]), most)
        table.add_row(*row)
    return [table]


def _to_try(fit: Mapping[str, Any]) -> list[Text]:
    """What else this command can do with the same tests, where it would tell more."""
    hints = []
    if fit.get("adequate") is False and {entry["model"] for entry in fit.get("selection") or ()} <= set(FEW_MODELS):
        hints.append("rig identify RUN --model all: compares every model on tests it has not seen")
    if fit["error"].get("holdout") is None:
        hints.append("rig identify RUN --holdout frequency_Hz=...: measures the error on tests that are not fitted")
        if not fit.get("unseen"):
            told = "foretells each amplitude and frequency from the others, where several were tested"
            hints.append(f"rig identify RUN --unseen pairs: {told}")
    return [Text(f"try: {hint}", style="cyan") for hint in hints]


def inside(entry: Mapping[str, Any], true: float | None) -> bool | None:
    """Whether a parameter's interval holds the true value; None when there is no interval or no truth."""
    low, high = entry["low"], entry["high"]
    if true is None or low is None or high is None or not entry["identifiable"]:
        return None
    return bool(low <= true <= high)


def _remarks(fit: Mapping[str, Any]) -> list[Text]:
    """Errors, what cannot be identified and why, warnings."""
    error = fit["error"]
    measures = f"RMSE {number(error['rmse_N'], 3)} N, {number(error['nrmse_percent_of_peak'], 3)} % of peak"
    lines = [Text(f"error over {len(error['per_test'])} tests: {measures}")]
    if holdout := error.get("holdout"):
        measures = f"RMSE {number(holdout['rmse_N'], 3)} N, {number(holdout['nrmse_percent_of_peak'], 3)} % of peak"
        lines.append(Text(f"error over held-out tests, which the fit has not seen: {measures}"))
    if fit.get("adequate") is False:
        lines.append(Text(INADEQUATE, style="red"))
    for name, entry in (fit.get("profiles") or {}).items():
        low, high = ("open" if end is None else f"{end:.5g}" for end in (entry["low"], entry["high"]))
        lines.append(Text(f"{name} by profile likelihood, 95 %: {low} to {high}"))
    lines += [Text(text, style="yellow") for text in _reasons(fit["parameters"])]
    for place, cause in enumerate(fit.get("diagnosis") or (), 1):
        lines.append(Text(f"diagnosis {place}: {cause['text']}", style="red" if place == 1 else ""))
        lines.append(Text(f"  next: {cause['next']}"))
    for proposal in fit.get("next_tests") or ():
        lines.append(Text(f"next test: {proposal['text']}; lines for the matrix file:"))
        lines.append(Text(proposal["toml"].strip(), style="cyan"))
    lines += [Text(f"warning: {text}", style="yellow") for text in fit.get("warnings", [])]
    return lines


def _reasons(parameters: Mapping[str, Any]) -> list[str]:
    """Why parameters cannot be identified, those with the same reason together."""
    named: dict[str, list[str]] = {}
    for name, entry in parameters.items():
        if not entry["identifiable"]:
            reason = str(entry.get("reason") or "the data do not determine it")
            rest = reason.removeprefix(f"{name} ")
            named.setdefault(rest if rest != reason else f"cannot be identified: {reason}", []).append(name)
    return [f"{', '.join(names)} {reason}" for reason, names in named.items()]


def _estimate(entry: Mapping[str, Any]) -> tuple[str, str]:
    low, high = entry["low"], entry["high"]
    if not entry["identifiable"] and low is None and high is not None:
        return number(entry["value"], 5), f"below {high:.5g}; cannot be identified"
    if not entry["identifiable"] or low is None or high is None:
        return "-" if entry["value"] is None else number(entry["value"], 5), "cannot be identified"
    return number(entry["value"], 5), f"{low:.5g} to {high:.5g}"

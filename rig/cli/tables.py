"""Tables a person reads on the terminal. Colours mean: green can be used, yellow look at it, red cannot be used."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

if TYPE_CHECKING:
    from rig.matrix.plan import Plan, PlannedPoint

INTERVAL = "95 % interval (each parameter by itself)"
COLOURS = {"valid": "green", "feasible": "green", "suspect": "yellow", "infeasible": "red", "invalid": "red"}


def duration(seconds: float) -> str:
    """Seconds as a person says them: "4.5 s", "3 min 20 s", "1 h 12 min"."""
    if seconds < 100:
        return f"{seconds:.1f} s" if seconds < 10 else f"{seconds:.0f} s"
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 60:
        return f"{minutes} min {rest} s"
    return f"{minutes // 60} h {minutes % 60} min"


def number(value: float | None, digits: int = 4) -> str:
    """A number in short, "unknown" when there is none."""
    return "unknown" if value is None else f"{value:.{digits}g}"


def plan_table(plan: Plan) -> list[Table | Text]:
    """The plan as a table and a sentence."""
    table = Table(title=f"Plan: {plan.specimen} on {plan.bench_name}", title_justify="left")
    for name in ("point", "waveform", "A mm", "f Hz", "I A", "speed m/s", "acc. m/s²", "force N", "heat J", "time"):
        table.add_column(name, justify="left" if name in {"point", "waveform"} else "right", no_wrap=True)
    table.add_column("verdict", overflow="fold")
    for item in plan.judged:
        point = item.point
        table.add_row(
            point.id,
            point.waveform,
            f"{point.amplitude_m * 1e3:.4g}",
            f"{point.frequency_Hz:.4g}",
            f"{point.current_A:.3g}",
            f"{point.peak_speed_m_s:.3f}",
            f"{point.peak_acceleration_m_s2:.2f}",
            number(item.predicted_force_N),
            number(item.energy_J),
            duration(item.duration_s),
            _verdict(item, item is plan.warm_up),
        )
    bad, total = sum(not item.feasible for item in plan.points), len(plan.points)
    said = f"all {total} points feasible" if bad == 0 else f"{bad} of {total} points infeasible"
    if plan.warm_up is not None and not plan.warm_up.feasible:
        said += ", warm-up infeasible"
    verdict = Text(said, style="green" if plan.feasible else "red")
    return [table, Text.assemble(verdict, f"; {_rig_time(plan)}; force {plan.prediction}")]


def _rig_time(plan: Plan) -> str:
    if plan.duration_s is not None:
        return f"{duration(plan.duration_s)} of rig time"
    return f"{duration(plan.recorded_s)} of motion; how long warming up and cooling down take is unknown"


def _verdict(item: PlannedPoint, warm_up: bool) -> Text:
    """A point's verdict; a warm-up that does not warm enough needs more amplitude, not another that fits."""
    if item.feasible:
        return Text("feasible", style="green")
    fits_m = item.would_fit_m
    if fits_m is None and warm_up:
        return Text("; ".join(item.reasons), style="red")
    fit = "no amplitude would fit" if fits_m is None else f"{fits_m * 1e3:.2f} mm would fit"
    return Text("; ".join((*item.reasons, fit)), style="red")


def fit_tables(fit: Mapping[str, Any], truth: Mapping[str, float] | None = None) -> list[Table | Text]:
    """A fit (the keys of `rig identify --json`) as tables and sentences.

    With `truth` (parameter values of a simulated damper) its column and whether the interval holds it are added.
    """
    table = Table(title=f"Fit: {fit['model']} by {fit['method']}", title_justify="left")
    for name in ("parameter", "value", str(fit.get("interval", INTERVAL)), "unit"):
        table.add_column(name, justify="right" if name == "value" else "left")
    if truth is not None:
        table.add_column("truth", justify="right")
        table.add_column("inside")
    for name, entry in fit["parameters"].items():
        row = [name, *_estimate(entry), str(entry["unit"])]
        if truth is not None:
            true = truth.get(name)
            row += ["-" if true is None else f"{true:.5g}", {True: "yes", False: "NO", None: "-"}[inside(entry, true)]]
        table.add_row(*row, style="" if entry["identifiable"] else "yellow")
    equation = [Text(str(fit["equation"]))] if fit.get("equation") else []
    return [table, *equation, *_remarks(fit)]


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
        lines.append(Text("the model does not describe these data within their noise", style="red"))
    for name, entry in (fit.get("profiles") or {}).items():
        low, high = ("open" if end is None else f"{end:.5g}" for end in (entry["low"], entry["high"]))
        lines.append(Text(f"{name} by profile likelihood, 95 %: {low} to {high}"))
    lines += [Text(text, style="yellow") for text in _reasons(fit["parameters"])]
    for each in fit.get("next_tests") or ():
        lines.append(Text(f"next test: {each['text']}; lines for the matrix file:"))
        lines.append(Text(each["toml"].strip(), style="cyan"))
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

"""Tables a person reads on the terminal. Colours mean: green can be used, yellow look at it, red cannot be used."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from rich.table import Table
from rich.text import Text

from rig.cli.plan_text import PlanText, duration, number

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
        lines.append(Text(INADEQUATE, style="red"))
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

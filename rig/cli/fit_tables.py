"""A fit as tables and sentences for a console: ranking, parameters, errors on unseen tests, what to try."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rich.table import Table
from rich.text import Text

from rig.cli.tables import number
from rig.dampers.covered import in_words
from rig.matrix.methods import FEW_MODELS

INADEQUATE = (
    "Model error exceeds the repeatability of the tests: the values are a best fit, the intervals do not include model "
    "error"
)
INTERVAL = "95 % interval (each parameter by itself)"


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
    beyond: Mapping[str, Sequence[str]] = next((entry["beyond"] for entry in scores if entry.get("beyond")), {})
    table = Table(title="Models compared, best first", title_justify="left")
    some = any(entry.get("within_nrmse_percent_of_peak") is not None for entry in scores)
    apart = ("without those beyond the data",) if beyond and some else ()
    only = "" if some or not beyond else " (extrapolation only)"
    for name in ("model", f"error on unseen tests{only}, % of peak", *apart, "RMSE N", "parameters"):
        table.add_column(name, justify="left" if name == "model" else "right")

    def errors(entry: Mapping[str, Any]) -> list[str]:
        keys = ("holdout_nrmse_percent_of_peak", *("within_nrmse_percent_of_peak" for _ in apart))
        return ["-" if entry.get(key) is None else number(entry[key], 3) for key in keys]

    for entry in scores:
        rmse = "-" if entry.get("rmse_N") is None else number(entry["rmse_N"], 3)
        style = "yellow" if entry.get("reason") else ""
        table.add_row(str(entry["model"]), *errors(entry), rmse, str(entry.get("parameters", "-")), style=style)
    for entry in fit.get("references") or ():
        told = errors(entry)
        if entry.get("holdout_nrmse_percent_of_peak") is None:
            told[0] = str(entry.get("reason"))
        table.add_row(REFERENCES.get(entry["name"], entry["name"]), *told, "-", "-", style="dim")
    reasons = [Text(str(entry["reason"]), style="yellow") for entry in scores if entry.get("reason")]
    tests = "; ".join(f"{test}: {outside(names)}" for test, names in beyond.items())
    apart_told = [Text(f"unseen tests beyond the data of their fit (extrapolation): {tests}")] if tests else []
    return [table, *apart_told, *reasons]


def outside(names: Sequence[str] | None) -> str:
    """In which quantities a test lies beyond the data of its fit; `-` where a file does not tell."""
    if names is None:
        return "-"
    return in_words(names) or "no"


def _apart(summary: Mapping[str, Any]) -> str:
    """How many of the unseen tests are extrapolations, and the mean without them; empty where none is."""
    tests = summary["per_test"]
    beyond = sum(bool(test.get("beyond")) for test in tests)
    if not beyond:
        return ""
    within = summary.get("within_nrmse_percent_of_peak")
    if within is None:
        return ", all of it extrapolation: every one lies beyond the data of its fit"
    return f"; {number(within, 3)} % without the {beyond} of {len(tests)} beyond the data of their fit"


def _held_out(fit: Mapping[str, Any]) -> list[Table]:
    """The error of each held-out test; none where no test was held out."""
    tests = (fit["error"].get("holdout") or {}).get("per_test") or ()
    if not tests:
        return []
    table = Table(title="Held-out tests", title_justify="left")
    for name in ("test", "error, % of peak", "RMSE N", "its own scatter N", "beyond the fitted data"):
        table.add_column(name, justify="left" if name == "test" else "right")
    for test in tests:
        values = (test.get(key) for key in ("nrmse_percent_of_peak", "rmse_N", "noise_N"))
        numbers = ("-" if value is None else number(value, 3) for value in values)
        table.add_row(str(test.get("id", "-")), *numbers, outside(test.get("beyond")))
    return [table]


def _pairs(fit: Mapping[str, Any]) -> list[Table]:
    """The error of each amplitude and frequency foretold from the others; none where that was not asked for."""
    unseen = fit.get("unseen")
    if not unseen:
        return []
    title = f"Foretold from the others: {number(unseen['nrmse_percent_of_peak'], 3)} % of peak on the mean"
    table = Table(title=title + _apart(unseen), title_justify="left")
    names = ("amplitude mm", "frequency Hz", "tests", "error, % of peak", "worst test", "its error")
    for name in (*names, "beyond the others"):
        table.add_column(name, justify="left" if name == "worst test" else "right")
    for pair in unseen["per_pair"]:
        motion = pair["amplitude_m"], pair["frequency_Hz"]
        tests = [test for test in unseen["per_test"] if (test["amplitude_m"], test["frequency_Hz"]) == motion]
        worst = max(tests, key=lambda test: float(test["nrmse_percent_of_peak"]))
        errors = (pair["nrmse_percent_of_peak"], worst["nrmse_percent_of_peak"])
        mean, most = (number(error, 3) for error in errors)
        quantities = list(dict.fromkeys(name for test in tests for name in test.get("beyond") or ()))
        told = outside(None if all(test.get("beyond") is None for test in tests) else quantities)
        row = (number(1e3 * motion[0]), number(motion[1]), str(pair["tests"]), mean, str(worst["id"]), most, told)
        table.add_row(*row)
    return [table]


def _to_try(fit: Mapping[str, Any]) -> list[Text]:
    """What else this command can do with the same tests, where it would tell more."""
    hints = []
    if fit.get("adequate") is False and {entry["model"] for entry in fit.get("selection") or ()} <= set(FEW_MODELS):
        hints.append("rig identify RUN --model all: compares every model on tests it has not seen")
    if fit["error"].get("holdout") is None and len(fit["error"].get("per_test") or ()) > 1:
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
    if grouped := fit.get("test_set"):
        lines.append(Text(f"{grouped['statement']}; {len(grouped['motions'])} motion(s)"))
    if holdout := error.get("holdout"):
        measures = f"RMSE {number(holdout['rmse_N'], 3)} N, {number(holdout['nrmse_percent_of_peak'], 3)} % of peak"
        lines.append(Text(f"error over held-out tests, which the fit has not seen: {measures}{_apart(holdout)}"))
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

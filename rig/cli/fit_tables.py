"""A fit in short, as blocks of a document: ranking, parameters, errors on validation tests, what to try."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rig.cli.tables import number
from rig.document.blocks import Block, Blocks, Column, Listing, Note, Paragraph, Row, Table, table
from rig.document.words import FAIR, PLAIN, POOR
from rig.matrix.methods import FEW_MODELS
from rig.report.fit import cross_validation, extrapolated_words, outside, selection

INADEQUATE = (
    "Model error exceeds the repeatability of the tests: the values are a best fit, the intervals do not include model "
    "error"
)
INTERVAL = "95 % interval (each parameter by itself)"


def fit_tables(fit: Mapping[str, Any], truth: Mapping[str, float] | None = None) -> Blocks:
    """A fit (the keys of `rig identify --json`) as tables and sentences.

    With `truth` (parameter values of a simulated damper) its column and whether the interval holds it are added.
    """
    head = [
        Column("parameter"), Column("value", "", True), Column(str(fit.get("interval", INTERVAL))), Column("unit"),
    ]  # fmt: skip
    drawn, rows = (fit.get("bootstrap") or {}).get("parameters"), []
    if drawn is not None:
        head.append(Column(f"95 %, {fit['bootstrap']['count']} bootstrap samples"))
    if truth is not None:
        head += [Column("truth", "", True), Column("inside")]
    for name, entry in fit["parameters"].items():
        row = [name, *_estimate(entry), str(entry["unit"])]
        if drawn is not None:
            row.append(f"{drawn[name]['low']:.5g} to {drawn[name]['high']:.5g}" if name in drawn else "-")
        if truth is not None:
            true = truth.get(name)
            row += ["-" if true is None else f"{true:.5g}", {True: "yes", False: "NO", None: "-"}[inside(entry, true)]]
        rows.append(Row(tuple(row), PLAIN if entry["identifiable"] else FAIR))
    formula = fit.get("formula") or fit.get("equation")
    equation: Blocks = [Paragraph(str(formula))] if formula else []
    parameters = table(head, rows, title=f"Fit: {fit['model']} by {fit['method']}")
    return [
        *selection(fit), parameters, *equation, *_held_out(fit), *cross_validation(fit), *_remarks(fit), *_to_try(fit),
    ]  # fmt: skip


def _held_out(fit: Mapping[str, Any]) -> list[Table]:
    """The error of each validation test; empty where there is none."""
    tests = (fit["error"].get("holdout") or {}).get("per_test") or ()
    if not tests:
        return []
    head = [
        Column("test"), Column("error", "% of peak", True), Column("RMSE", "N", True), Column("cycle SD", "N", True),
        Column("outside the fitted data"),
    ]  # fmt: skip
    rows = []
    for test in tests:
        values = (test.get(key) for key in ("nrmse_percent_of_peak", "rmse_N", "noise_N"))
        numbers = ("-" if value is None else number(value, 3) for value in values)
        inside = "-" if test.get("beyond") is None else "no"
        rows.append([str(test.get("id", "-")), *numbers, outside(test.get("beyond")) or inside])
    return [table(head, rows, title="Validation tests")]


def _to_try(fit: Mapping[str, Any]) -> Blocks:
    """What else this command can do with the same tests, where that gives more information."""
    hints = []
    if fit.get("adequate") is False and {entry["model"] for entry in fit.get("selection") or ()} <= set(FEW_MODELS):
        hints.append("rig identify RUN --model all: compares every model on validation tests")
    if fit["error"].get("holdout") is None and len(fit["error"].get("per_test") or ()) > 1:
        hints.append("rig identify RUN --holdout frequency_Hz=...: measures the error on tests that are not fitted")
        if not fit.get("unseen"):
            hints.append("rig identify RUN --unseen pairs: leave-one-motion-out cross-validation")
    return [Paragraph(f"try: {hint}") for hint in hints]


def inside(entry: Mapping[str, Any], true: float | None) -> bool | None:
    """Whether a parameter's interval holds the true value; None when there is no interval or no truth."""
    low, high = entry["low"], entry["high"]
    if true is None or low is None or high is None or not entry["identifiable"]:
        return None
    return bool(low <= true <= high)


def _remarks(fit: Mapping[str, Any]) -> Blocks:
    """Errors, what cannot be identified and why, warnings."""
    error = fit["error"]
    measures = f"RMSE {number(error['rmse_N'], 3)} N, {number(error['nrmse_percent_of_peak'], 3)} % of peak"
    lines: list[Block] = [Paragraph(f"error over {len(error['per_test'])} tests: {measures}")]
    if grouped := fit.get("test_set"):
        lines.append(Paragraph(f"{grouped['statement']}; {len(grouped['motions'])} motion(s)"))
    if holdout := error.get("holdout"):
        measures = f"RMSE {number(holdout['rmse_N'], 3)} N, {number(holdout['nrmse_percent_of_peak'], 3)} % of peak"
        lines.append(Paragraph(f"error over validation tests: {measures}{extrapolated_words(holdout)}"))
    if fit.get("adequate") is False:
        lines.append(Note(POOR, INADEQUATE))
    for name, entry in (fit.get("profiles") or {}).items():
        low, high = ("open" if end is None else f"{end:.5g}" for end in (entry["low"], entry["high"]))
        lines.append(Paragraph(f"{name} by profile likelihood, 95 %: {low} to {high}"))
    lines += [Note(FAIR, text) for text in _reasons(fit["parameters"])]
    for place, cause in enumerate(fit.get("diagnosis") or (), 1):
        lines.append(Note(POOR if place == 1 else PLAIN, f"diagnosis {place}: {cause['text']}"))
        lines.append(Paragraph(f"  next: {cause['next']}"))
    for proposal in fit.get("next_tests") or ():
        lines.append(Paragraph(f"next test: {proposal['text']}; lines for the matrix file:"))
        lines.append(Listing(proposal["toml"].strip()))
    lines += [Note(FAIR, f"warning: {text}") for text in fit.get("warnings", [])]
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

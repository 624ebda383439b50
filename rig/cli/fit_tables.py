"""Summary of a fit, as blocks of a document: ranking, parameters, errors on validation tests, next steps."""

from __future__ import annotations

import math
from collections.abc import Mapping

from rig.cli.tables import number
from rig.display import SI, Display, Shown
from rig.document.blocks import Block, Blocks, Column, Listing, Note, Paragraph, Row, Table, table
from rig.document.words import FAIR, PLAIN, POOR
from rig.files.run_display import run_display
from rig.fits.entries import Cause, ErrorSummary, Estimate
from rig.fits.fit_file import INTERVAL
from rig.fits.fit_record import FitRecord
from rig.fits.residual_weights import of_physics, residual_line
from rig.fits.summary import INADEQUATE
from rig.matrix.methods import FEW_MODELS
from rig.report.display_text import in_display
from rig.report.fit import corrections, cross_validation, extrapolated_words, outside, selection


def fit_summary(fit: FitRecord, truth: Mapping[str, float] | None = None) -> Blocks:
    """A fit at the end of a run: parameters, why some are not identified, its most probable problem; no proposals.

    The report and `rig identify` show the rest. `truth`: as in `fit_tables`.
    """
    lines: list[Block] = []
    if fit.adequate is False:
        lines.append(Note(POOR, INADEQUATE))
    lines += [Note(FAIR, text) for text in _reasons(fit.parameters)]
    lines += _residual(fit)
    lines += [_found(cause) for cause in fit.diagnosis[:1]]
    lines += [Note(FAIR, f"warning: {text}") for text in fit.warnings]
    if fit.next_tests:
        count = "1 further test" if len(fit.next_tests) == 1 else f"{len(fit.next_tests)} further tests"
        lines.append(Paragraph(f"{count} would improve the fit; the report contains the lines to add to the matrix "
            "file."))
    return [_parameters(fit, truth), *lines]


def fit_error(fit: FitRecord) -> str:
    """Model and error of a fit, in one line."""
    force = _display(fit).force
    unseen = "" if fit.holdout is None else f", {number(fit.holdout.nrmse_percent_of_peak, 3)} % for validation tests"
    tests = len(fit.error.per_test)
    of = "1 test" if tests == 1 else f"{tests} tests"
    return f"Fit: {fit.model}, error {_measures(fit.error, force)} for {of}{unseen}"


def fit_tables(fit: FitRecord, truth: Mapping[str, float] | None = None) -> Blocks:
    """A fit as tables and sentences.

    With `truth` (parameter values of a simulated damper) its column and whether the interval holds it are added.
    """
    shown = _display(fit)
    equation: Blocks = [Paragraph(fit.equation)] if fit.form else []
    return [
        *selection(fit, shown), _parameters(fit, truth), *_residual(fit), *equation, *corrections(fit), *_held_out(fit),
        *cross_validation(fit, shown), *_remarks(fit), *_to_try(fit),
    ]  # fmt: skip


def _parameters(fit: FitRecord, truth: Mapping[str, float] | None) -> Table:
    head = [Column("parameter"), Column("value", "", True), Column(INTERVAL), Column("unit")]
    if fit.drawn is not None:
        head.append(Column(f"95 %, {fit.drawn.count} bootstrap samples"))
    if truth is not None:
        head += [Column("truth", "", True), Column("inside")]
    rows = []
    for name, entry in of_physics(fit.parameters).items():
        row = [name, *_estimate(entry), entry.unit]
        if fit.drawn is not None:
            drawn = fit.drawn.parameters.get(name)
            row.append("-" if drawn is None else f"{drawn.low:.5g} to {drawn.high:.5g}")
        if truth is not None:
            true = truth.get(name)
            row += ["-" if true is None else f"{true:.5g}", {True: "yes", False: "NO", None: "-"}[entry.holds(true)]]
        rows.append(Row(tuple(row), PLAIN if entry.identifiable else FAIR))
    return table(head, rows, title=f"Fit: {fit.model} by {fit.method} (parameters in SI units)")


def _residual(fit: FitRecord) -> list[Block]:
    stated = residual_line(fit.parameters)
    return [Paragraph(stated)] if stated else []


def _held_out(fit: FitRecord) -> list[Table]:
    """The error of each validation test; empty where there is none."""
    if fit.holdout is None or not fit.holdout.per_test:
        return []
    force = _display(fit).force
    head = [
        Column("test"), Column("error", "% of ampl.", True), Column("RMSE", force.unit, True),
        Column("cycle SD", force.unit, True), Column("outside the fitted data"),
    ]  # fmt: skip
    rows = []
    for test in fit.holdout.per_test:
        forces = [None if value is None else force.value(value) for value in (test.rmse_N, test.noise_N)]
        values = (test.nrmse_percent_of_peak, *forces)
        numbers = (number(value, 3) if value is not None and math.isfinite(value) else "-" for value in values)
        inside = "-" if test.beyond is None else "no"
        rows.append([test.id, *numbers, outside(test.beyond) or inside])
    return [table(head, rows, title="Validation tests")]


def _to_try(fit: FitRecord) -> Blocks:
    """What else this command can do with the same tests, where that gives more information."""
    hints = []
    if fit.adequate is False and {score.model for score in fit.selection} <= set(FEW_MODELS):
        hints.append("rig identify RUN --model all (compares all models on validation tests)")
    if fit.holdout is None and len(fit.error.per_test) > 1:
        hints.append("rig identify RUN --holdout frequency_Hz=... (evaluates the error on validation tests)")
        if fit.unseen is None:
            hints.append("rig identify RUN --unseen pairs (leave-one-motion-out cross-validation)")
    return [Paragraph(f"try: {hint}") for hint in hints]


def _remarks(fit: FitRecord) -> Blocks:
    """Errors, what cannot be identified and why, warnings."""
    shown = _display(fit)
    force = shown.force
    lines: list[Block] = [Paragraph(f"error over {len(fit.error.per_test)} tests: {_measures(fit.error, force)}")]
    if fit.test_set is not None:
        lines.append(Paragraph(f"{fit.test_set.statement}; {len(fit.test_set.motions)} motion(s)"))
    if fit.holdout is not None:
        measures = f"{_measures(fit.holdout, force)}{extrapolated_words(fit.holdout)}"
        lines.append(Paragraph(f"error on validation tests: {measures}"))
    if fit.adequate is False:
        lines.append(Note(POOR, INADEQUATE))
    for name, profile in fit.profiles.items():
        low, high = ("open" if end is None else f"{end:.5g}" for end in (profile.low, profile.high))
        lines.append(Paragraph(f"{name} by profile likelihood, 95 %: {low} to {high}"))
    lines += [Note(FAIR, text) for text in _reasons(fit.parameters)]
    for place, cause in enumerate(fit.diagnosis, 1):
        lines.append(_found(cause, place))
        lines.append(Paragraph(f"  next step: {cause.next}"))
    for proposal in fit.next_tests:
        lines.append(Paragraph(f"next test: {in_display(proposal.text, shown)}; lines for the matrix file:"))
        lines.append(Listing(in_display(proposal.toml.strip(), shown)))
    lines += [Note(FAIR, f"warning: {text}") for text in fit.warnings]
    return lines


def _found(cause: Cause, place: int | None = None) -> Note:
    """An entry of the diagnosis, numbered in a list; the first cause of a misfit is shown as a problem."""
    severity = POOR if cause.of_misfit else FAIR
    at = "" if place is None else f" {place}"
    text = f"{'probable cause' if cause.of_misfit else 'observation'}{at}: {cause.text}"
    return Note(severity if place in {None, 1} else PLAIN, text)


def _display(fit: FitRecord) -> Display:
    """How values are shown in the run to which a fit belongs."""
    return SI if fit.path is None else run_display(fit.path.parent)


def _measures(error: ErrorSummary, force: Shown) -> str:
    return f"RMSE {force.text(error.rmse_N, 3)}, {number(error.nrmse_percent_of_peak, 3)} % of force amplitude"


def _reasons(parameters: Mapping[str, Estimate]) -> list[str]:
    """Why parameters cannot be identified, those with the same reason together."""
    named: dict[str, list[str]] = {}
    for name, entry in of_physics(parameters).items():
        if not entry.identifiable:
            reason = entry.reason or "the data do not determine this parameter"
            rest = reason.removeprefix(f"{name} ")
            named.setdefault(rest if rest != reason else f"not identifiable: {reason}", []).append(name)
    return [f"{', '.join(names)} {reason}" for reason, names in named.items()]


def _estimate(entry: Estimate) -> tuple[str, str]:
    value = "-" if entry.value is None else number(entry.value, 5)
    if entry.has_interval:
        return value, f"{entry.low:.5g} to {entry.high:.5g}"
    if not entry.identifiable and entry.low is None and entry.high is not None:
        return value, f"below {entry.high:.5g}; not identifiable"
    return value, "not identifiable"

"""A fit for people who print it: at most 40 lines of 80 columns, or HTML for a notebook."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import replace

from rig.dampers.covered import ends_in_words
from rig.document.blocks import Block, Blocks, Heading, Note, Paragraph
from rig.document.html import fragment
from rig.document.numbers import NOTHING, number
from rig.document.terminal import lines
from rig.document.words import FAIR, GOOD, PLAIN, POOR, Severity
from rig.fits.entries import Band, ErrorSummary, TestedRange
from rig.fits.fit_record import FitRecord
from rig.fits.parameters import WIDTH, parameter_table
from rig.fits.residual_weights import of_physics, residual_line

UNITS = {"m": "m", "m_s": "m/s", "A": "A", "degC": "degC"}
"""End of the name of a tested quantity -> its unit."""
MOST_LINES = 40
MOST_PARAMETERS = 22
MOST_REMARKS = 3
LONGEST_REMARK = 230
"""Characters: three lines."""
INADEQUATE = (
    "Model error exceeds the repeatability of the tests: the values are a best fit; the intervals do not include "
    "model error"
)
ADEQUACY: dict[bool | None, tuple[Severity, str]] = {
    True: (GOOD, "The model fits the tests within measurement noise."),
    False: (POOR, f"{INADEQUATE}."),
    None: (PLAIN, "It is unknown whether the model fits the tests within measurement noise."),
}


def summary(fit: FitRecord) -> str:
    """The fit as text: model, verdict, parameters, errors, tested range, warnings."""
    shown = [text for text, _ in lines(_blocks(fit), WIDTH)]
    if len(shown) > MOST_LINES:
        shown = [*shown[: MOST_LINES - 1], "... more: fit.params, fit.warnings, fit.diagnosis, fit.to_json()"]
    return "\n".join(shown)


def summary_html(fit: FitRecord) -> str:
    """The same as a fragment of HTML; every text of the fit is escaped."""
    return fragment(_blocks(fit))


def _blocks(fit: FitRecord) -> Blocks:
    """The summary, the most important first."""
    tests = len(fit.error.per_test)
    by = f" by {fit.method}" if fit.method else ""
    severity, verdict = ADEQUACY[fit.adequate]
    own, residual = of_physics(fit.parameters), residual_line(fit.parameters)
    shown = dict(list(own.items())[:MOST_PARAMETERS])
    hidden = len(own) - len(shown)
    causes, observations = ([one.text for one in fit.diagnosis if one.of_misfit is kind] for kind in (True, False))
    return [
        Heading(f"Fit of {fit.model}{by} to {tests} test{'s' * (tests != 1)}", 3),
        Note(severity, verdict),
        *_errors(fit),
        replace(parameter_table(shown), title="Parameters"),
        *([Paragraph(f"{hidden} more parameters: fit.params")] if hidden else []),
        *([Paragraph(residual)] if residual else []),
        *([Paragraph(f"Tested: {_tested(fit.tested)}")] if fit.tested is not None else []),
        *([Paragraph(_prediction_error(fit.tested.band))] if fit.tested is not None else []),
        *_undetermined(fit),
        *_remarks("Probable cause of the misfit", causes, "fit.diagnosis"),
        *_remarks("Observation", observations, "fit.diagnosis"),
        *_remarks("Warning", fit.warnings, "fit.warnings"),
    ]


def _errors(fit: FitRecord) -> Iterator[Block]:
    yield Paragraph(f"Error on the fitted tests: {_measures(fit.error)}")
    if fit.holdout is not None:
        count = len(fit.holdout.per_test)
        yield Paragraph(f"Error on {count} validation test{'s' * (count != 1)}: {_measures(fit.holdout)}")


def _tested(tested: TestedRange) -> str:
    """The tested ranges in words and units."""
    ranges = []
    for name, ends in tested.ranges():
        quantity, _, suffix = name.partition("_")
        if ends is not None:
            ranges.append(f"{quantity} {ends_in_words(ends)} {UNITS[suffix]}")
    levels = ", ".join(f"{current_A:.3g}" for current_A in tested.only_at_A)
    return ", ".join(ranges) + f"; only near the currents {levels} A" * bool(levels)


def _prediction_error(band: Band) -> str:
    """The prediction error at the ends of the tested currents."""
    if not band.of_predictions:
        return "Prediction error: unknown"
    known = sorted({0, len(band.current_A) - 1})
    ends = " to ".join(
        f"{number(band.half_width_N[at], 3)} N at {number(round(band.current_A[at], 3), 3)} A" for at in known
    )
    return f"Prediction error (95 %, within the tested range): {ends}"


def _measures(error: ErrorSummary) -> str:
    parts = (f"RMSE {number(error.rmse_N, 3)} N", f"{number(error.nrmse_percent_of_peak, 3)} % of force amplitude")
    return ", ".join(parts).replace(NOTHING, "-")


def _undetermined(fit: FitRecord) -> Iterator[Block]:
    """The parameters that the tests do not determine, those with the same reason together."""
    sums = [f"{name}: value and interval of {one.quantity}" for name, one in fit.parameters.items() if one.quantity]
    yield from _remarks("Not determined alone", sums, "fit.params")
    named: dict[str, list[str]] = {}
    for name, one in of_physics(fit.parameters).items():
        if not one.identifiable and not one.quantity:
            named.setdefault(one.reason.removeprefix(f"{name} ") or "no reason stated", []).append(name)
    texts = [f"{', '.join(names)}: {reason}" for reason, names in named.items()]
    yield from _remarks("Not determined", texts, "fit.params")


def _remarks(title: str, texts: Sequence[str], where: str) -> Iterator[Block]:
    for text in texts[:MOST_REMARKS]:
        yield Note(FAIR, textwrap.shorten(f"{title}: {text}", LONGEST_REMARK, placeholder=f" ... ({where})"))
    if len(texts) > MOST_REMARKS:
        yield Paragraph(f"{len(texts) - MOST_REMARKS} more: {where}")

"""The report's sections on the fit: parameters with intervals, quality for each test, profiles, proposed tests.

Colours show how well a value is known: green an interval below 2 %, amber up to 20 %, red beyond or not at all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

import rig.dampers
from rig.dampers.covered import in_words
from rig.display import SI, Display, Shown
from rig.document.blocks import (
    Blocks,
    Card,
    Cards,
    Column,
    Details,
    Figures,
    Head,
    Heading,
    Keys,
    Listing,
    Paragraph,
    Row,
    section,
    table,
)
from rig.document.figure import Axis, Figure, Style, Trace
from rig.document.numbers import NOTHING, PLUS_MINUS, between, number, signed
from rig.document.style import FITTED, MEASURED, RESIDUAL
from rig.document.words import FAIR, GOOD, PLAIN, POOR, Key, Label, Shade, Strong, Words
from rig.errors import RigError, some
from rig.fits.entries import (
    ErrorSummary,
    Estimate,
    ModelScore,
    Reference,
    Residual,
    TestError,
    Unseen,
    UnseenTest,
)
from rig.fits.fit_record import FitRecord
from rig.fits.residual_weights import of_physics, residual_line
from rig.report.display_text import in_display
from rig.signals.arrays import FloatArray

WELL_KNOWN_PERCENT, KNOWN_PERCENT = 2.0, 20.0
THRESHOLD = 3.84
STRONG_CORRELATION = 0.9
SMALLEST_WHITE_P = 0.001
DARKEST_PERCENT = 25.0
MARK = "*"
MOST_PAIRS = 8
METHODS = {"separable": "separable least squares"}
"""Names of fitting methods in words."""


def outside(names: Sequence[str] | None) -> str:
    """The quantities in which a test lies outside the fitted data; empty for none or unknown."""
    return in_words(names or ())


def validation_words(beyond: Sequence[str] | None) -> str:
    """That a test was kept for validation, and in which quantities it lies outside the fitted data."""
    quantities = outside(beyond)
    return f"validation, outside the fitted data: {quantities}" if quantities else "validation"


def corrections(fit: FitRecord) -> Blocks:
    """What was taken into account besides the model, with its numbers, in one line; empty for nothing."""
    stated = [
        ", ".join((name, *(f"{key} = {value:.5g}" for key, value in numbers.items())))
        for name, numbers in fit.corrections.others.items()
    ]
    if fit.series is not None:
        stiffness = fit.series.stiffness_N_m
        stated.append(f"series_spring, {'none found' if stiffness is None else f'stiffness_N_m = {stiffness:.5g}'}")
    if fit.temperature is not None:
        stated.append(f"temperature_law {fit.temperature.law}, reference_degC = {fit.temperature.reference_degC:.4g}")
    return [Paragraph(f"corrections: {'; '.join(stated)}")] if stated else []


def parameters(fit: FitRecord, display: Display = SI) -> Blocks:
    """Fitted parameters with their intervals, then those that the data do not determine, and why."""
    meanings = _meanings(fit.model)
    again = [] if fit.drawn is None else [f"95 %, {fit.drawn.count} bootstrap samples"]
    known: list[list[Words]] = []
    unknown: list[list[Words]] = []
    for name, entry in of_physics(fit.parameters).items():
        meaning = entry.quantity or meanings.get(name, "")
        if entry.identifiable or entry.has_interval:
            value, interval = between(entry.value, entry.low, entry.high)
            known.append([name, value, interval, _half_percent(entry), *_bootstrapped(fit, name), entry.unit, meaning])
        else:
            reason = entry.reason or "not determined by the data"
            unknown.append([name, number(entry.value, 5), entry.unit, meaning, reason])
    head: list[Head] = ["Parameter", "Value", "95 % interval", Column(PLUS_MINUS, "%", True), *again, "Unit", "Meaning"]
    title = "Fitted parameters" + ("" if display.usual else " (SI units, positive in rebound)")
    parts: Blocks = [Heading(title, 3), *_equation(fit, display), *corrections(fit)]
    parts.append(table(head, known, (1, 2)))
    if residual := residual_line(fit.parameters):
        parts.append(Paragraph(residual))
    if unknown:
        parts.append(Heading("Not identifiable from these data", 3))
        rows = [Row(tuple(cells), faded=True) for cells in unknown]
        parts.append(table(["Parameter", "Value used", "Unit", "Meaning", "Reason"], rows, (1,)))
    parts += [
        *_diagnosis(fit), *_next_tests(fit, display), *_profiles(fit), *selection(fit, display),
        *cross_validation(fit, display),
    ]
    return parts + [Paragraph(note, small=True) for note in fit.notes]


RANGES: dict[str, tuple[str, Callable[[Display], Shown] | None]] = {
    "displacement_m": ("Displacement about mid-stroke", lambda display: display.displacement),
    "velocity_m_s": ("Velocity", lambda display: display.speed), "current_A": ("Current", None),
    "temperature_degC": ("Coil temperature", lambda display: display.temperature),
}  # fmt: skip
"""Quantities of the tested range: title, and how they are shown (None: in A)."""


def _equation(fit: FitRecord, display: Display) -> Blocks:
    """The model's equation, and the range in which the tests support it."""
    stated: Blocks = [Paragraph((Strong(fit.model), f": {fit.form}"))] if fit.form else []
    rows = []
    for name, ends in [] if fit.tested is None else fit.tested.ranges():
        if ends is not None:
            title, shown = RANGES[name]
            unit = "A" if shown is None else shown(display).unit
            low, high = ends if shown is None else sorted(map(shown(display).signed, ends))
            rows.append([title, *(number(round(end, 3) + 0.0, 4) for end in (low, high)), unit])
    if not rows:
        return stated
    note = "The tests support the model only within these ranges; outside the ranges, the force is extrapolated."
    return [
        *stated, table(["Valid for", "from", "to", "Unit"], rows, (1, 2)), Paragraph(note, small=True),
        *_prediction_error(fit, display),
    ]  # fmt: skip


def _prediction_error(fit: FitRecord, display: Display) -> Blocks:
    """How far predictions within the tested range are off, for each current."""
    if fit.tested is None or not fit.tested.band.of_predictions:
        text = (
            "Prediction error: unknown; all tests have one motion, or no test lies within the range of tests of other "
            "motions."
        )
        return [Paragraph(text, small=True)]
    band = fit.tested.band
    rows = [
        [number(round(current_A, 3) + 0.0, 4), _force(width_N, display.force)]
        for current_A, width_N in zip(band.current_A, band.half_width_N, strict=True)
    ]  # fmt: skip
    head: list[Head] = [Column("Current", "A", True), Column("Prediction error", display.force.unit, True)]
    return [table(head, rows, (0, 1)), Paragraph(f"{band.describe()}.", small=True)]


def quality(fit: FitRecord, display: Display = SI) -> Blocks:
    """Errors, residuals and energy of each test, and how the parameters depend on each other."""
    rows = [_test_row(test, "", display) for test in fit.error.per_test]
    if fit.holdout is not None:
        rows += [_test_row(test, validation_words(test.beyond), display) for test in fit.holdout.per_test]
    if not rows:
        return []
    unit, energy = display.force.unit, display.energy.unit
    head: list[Head] = [
        Column("Test"), Column("Error", "%", True), Column("RMS error", unit, True), Column("Cycle SD", unit, True),
        Column("Noise", unit, True), Column("Systematic residual", unit, True), Column("Whiteness p", "", True),
        Column("Energy", energy, True), Column("Modelled", energy, True), Column("Remark"),
    ]  # fmt: skip
    note = (
        "Cycle SD: standard deviation of the force from cycle to cycle. Noise: the part of the residual that changes "
        "from cycle to cycle. Systematic residual: the part of the residual that repeats in every cycle and that the "
        "model does not describe. Whiteness p: probability of such a residual if the residual were pure noise with "
        "the bandwidth of the measured noise. Energy: measured and modelled energy dissipated in the mean cycle."
    )
    return [*section("Quality of the fit", note), *_passivity(fit), table(head, rows), *_correlation(fit)]


def _passivity(fit: FitRecord) -> Blocks:
    passivity = fit.passivity
    if passivity is None:
        return []
    share = 100.0 * passivity.share
    severity, word = (GOOD, "passive") if share == 100.0 else (POOR, "not passive")
    worst = f"; the largest energy input is {passivity.worst}" if passivity.worst else ""
    text = f" The fitted model dissipates energy at {number(share, 3)} % of the tested speeds and currents{worst}."
    return [Paragraph((Label(word, severity), text))]


def _test_row(test: TestError, remark: str, display: Display) -> list[Words]:
    force, energy = display.force, display.energy
    residual = test.residual or Residual()
    white: Words = NOTHING
    if residual.known_p:
        least = residual.least_p
        good = least >= SMALLEST_WHITE_P
        white = Label(number(least, 2) if good else f"< {SMALLEST_WHITE_P:g}", GOOD if good else FAIR)
    return [
        test.id, number(test.nrmse_percent_of_peak, 3), _force(test.rmse_N, force), _force(test.noise_N, force),
        _force(residual.noise_N, force), _force(residual.repeating_N, force, 2), white, _energy(test.energy_J, energy),
        _energy(test.modelled_energy_J, energy), remark,
    ]  # fmt: skip


def _energy(value_J: float | None, energy: Shown) -> str:
    return NOTHING if value_J is None else number(energy.value(value_J))


def _force(value_N: float | None, force: Shown, digits: int = 3) -> str:
    return number(None if value_N is None else force.value(value_N), digits)


def _bootstrapped(fit: FitRecord, name: str) -> list[Words]:
    """The bootstrap interval as a cell; none where there is no bootstrap."""
    if fit.drawn is None:
        return []
    entry = fit.drawn.parameters.get(name)
    return [NOTHING if entry is None else between(entry.low, entry.low, entry.high)[1]]


def _half_percent(entry: Estimate) -> Words:
    if not entry.value or entry.low is None or entry.high is None:
        return NOTHING
    percent = 50.0 * abs((entry.high - entry.low) / entry.value)
    severity = GOOD if percent <= WELL_KNOWN_PERCENT else FAIR if percent <= KNOWN_PERCENT else POOR
    return Label(number(percent, 2), severity)


def _diagnosis(fit: FitRecord) -> Blocks:
    if not fit.diagnosis:
        return []
    from rig.identification.diagnosis.ranking import SEEN  # loads the search of each cause

    rows = [
        [cause.slug, cause.text, NOTHING if cause.slug in SEEN else number(100.0 * cause.explains, 3), cause.next]
        for cause in fit.diagnosis
    ]
    note = (
        "The damper model was fitted again with each cause added separately; the first cause explains the largest "
        f"share of the misfit. The shares do not add up to 100 %. {NOTHING}: cause found directly in the tests, with "
        "no share of the misfit assigned."
    )
    head: list[Head] = [Column("Cause"), Column("Finding"), Column("Explains", "%", True), Column("Next step")]
    title = "Probable causes of the misfit" if any(cause.of_misfit for cause in fit.diagnosis) else "Observations"
    return [*section(title, note, 3), table(head, rows)]


def _next_tests(fit: FitRecord, display: Display) -> Blocks:
    if not fit.next_tests:
        return []
    note = "Add these lines to the matrix file. The gain is predicted from the fitted model and the noise in the tests."
    return [
        *section("Proposed next tests", note, 3),
        *(
            block for one in fit.next_tests for block in (
                Paragraph(in_display(one.text, display)), Listing(in_display(one.toml.strip(), display)),
            )
        ),
    ]


def _profiles(fit: FitRecord) -> Blocks:
    cards = []
    for name, profile in fit.profiles.items():
        entry, at = fit.parameters[name], fit.values[name]
        values, deviance = np.array(profile.values, float), np.array(profile.deviance, float)
        if values.size < 3:
            continue
        grid = np.linspace(values[0], values[-1], 121)
        root = np.where(values < at, -1.0, 1.0) * np.sqrt(deviance)
        traces = [Trace(grid, np.interp(grid, values, root) ** 2, name="profile")]
        if entry.standard_error:
            traces.append(Trace(grid, ((grid - at) / entry.standard_error) ** 2, Style.FITTED, "linear"))
        traces.append(Trace(_ends(values), np.full(2, THRESHOLD), Style.RESIDUAL, "95 %"))
        figure = Figure(Axis(name, entry.unit), Axis("Deviance", limits=(0.0, 8.0)), traces, 400, 220)
        ends = " \N{HORIZONTAL ELLIPSIS} ".join(
            "open" if end is None else number(end, 5) for end in (profile.low, profile.high)
        )
        cards.append(Card((Strong(name), f" {ends}"), (Figures((figure,)),)))
    if not cards:
        return []
    keys = (Key("profile likelihood", MEASURED), Key("linear interval", FITTED, dashed=True), Key("95 %", RESIDUAL))
    return [Heading("Profile likelihoods", 3), Keys(keys), Cards(tuple(cards))]


def _ends(values: FloatArray) -> FloatArray:
    return np.array([values[0], values[-1]])


def _correlation(fit: FitRecord) -> Blocks:
    rows, identifiable = fit.correlation, fit.identifiable
    names = [name for name in rows if name in identifiable]
    if len(names) < 2:
        return []
    matrix = fit.correlation_matrix(names)
    pairs = sorted(
        ((abs(float(matrix[k, j])), a, b) for k, a in enumerate(names) for j, b in enumerate(names[:k])),
        key=lambda pair: -pair[0],
    )
    strong = [f"{b} and {a} ({number(rows[a][b], 2)})" for size, a, b in pairs if size > STRONG_CORRELATION]
    stated = f"Correlation above {STRONG_CORRELATION:g}: {some(strong, most=MOST_PAIRS)}." if strong else (
        f"No pair of parameters has a correlation above {STRONG_CORRELATION:g}."
    )  # fmt: skip
    cells = [[a, *(_heat(rows[a].get(b, math.nan)) for b in names)] for a in names]
    made = table(["", *names], cells, range(1, len(names) + 1))
    condition = f"Condition number of the scaled normal equations: {number(fit.condition, 3)}."
    return [Paragraph(f"{stated} {condition}"), Details("Correlation between parameters", (made,))]


def _heat(value: float) -> Words:
    """A correlation, orange where positive and blue where negative, darker where stronger."""
    return NOTHING if math.isnan(value) else Shade(signed(f"{round(value, 2) + 0.0:.2f}"), value)


def _meanings(name: str) -> dict[str, str]:
    try:
        model = rig.dampers.model(name)
    except RigError:  # a model that is not installed here; its parameters are shown without their meaning
        return {}
    return {parameter.name: parameter.meaning for parameter in model.parameters}


REFERENCES = {
    "mean_cycle": "no model: other cycles",
    "regression": "no model: regression",
}
"""Short names: with longer ones, or a reason as a cell, the table would be wider than a terminal."""
EXPLAINED = {
    "mean_cycle": "each cycle is predicted from the other cycles of its test (lower bound of the error)",
    "regression": "regression on motion and current",
}


def selection(fit: FitRecord, display: Display = SI) -> Blocks:
    """The models compared, best first, and why one was given up; empty for a single model."""
    scores = fit.selection
    if len(scores) < 2:
        return []
    beyond = next((score.beyond for score in scores if score.beyond), {})
    some = any(score.within_nrmse_percent_of_peak is not None for score in scores)
    also_within = bool(beyond) and some
    rows, notes = [], [score.reason for score in scores if score.reason]
    for score in scores:
        errors = (number(value, 3) for value in _validation_errors(score, also_within=also_within))
        cells = (score.model, *errors, _force(score.rmse_N, display.force), str(score.parameters), number(score.bic, 6))
        rows.append(Row(cells, FAIR if score.reason else PLAIN))
    for one in fit.references:
        errors = (number(value, 3) for value in _validation_errors(one, also_within=also_within))
        name = REFERENCES.get(one.name, one.name)
        rows.append(Row((name, *errors, NOTHING, NOTHING, NOTHING), faded=True))
        reason = one.reason if one.holdout_nrmse_percent_of_peak is None else ""
        notes.append(f"{name}: {'; '.join(text for text in (EXPLAINED.get(one.name, ''), reason) if text)}")
    head = [
        Column("Model"), Column("Validation error" + ("" if some or not beyond else " (extrapolated)"), "%", True),
        *([Column("Excluding extrapolated tests", "%", True)] if also_within else []),
        Column("RMS error", display.force.unit, True), Column("Parameters", "", True), Column("BIC", "", True),
    ]  # fmt: skip
    if beyond:
        notes.insert(0, f"Validation tests outside the fitted data (extrapolated): {_outside_words(beyond)}.")
    stated = (Paragraph(note, small=True) for note in notes)
    return [Heading("Models compared, best first", 3), table(head, rows), *stated]


def _validation_errors(of: ModelScore | Reference, *, also_within: bool) -> tuple[float | None, ...]:
    """Mean error (% of force amplitude) on unseen tests and, where requested, on those within the fitted data."""
    within = (of.within_nrmse_percent_of_peak,) if also_within else ()
    return (of.holdout_nrmse_percent_of_peak, *within)


def extrapolated_words(summary: ErrorSummary | Unseen) -> str:
    """How many of some validation tests are extrapolated, and the mean without them; empty where none is."""
    beyond = sum(bool(test.beyond) for test in summary.per_test)
    if not beyond:
        return ""
    within = summary.within_nrmse_percent_of_peak
    if within is None:
        return ", all outside the fitted data (extrapolated)"
    return f"; {number(within, 3)} % without the {beyond} of {len(summary.per_test)} tests outside the fitted data"


def _outside_words(beyond: Mapping[str, Sequence[str]]) -> str:
    return "; ".join(f"{test} ({outside(names)})" for test, names in beyond.items())


def cross_validation(fit: FitRecord, display: Display = SI) -> Blocks:
    """Errors on tests of each amplitude and frequency, by a fit to the others; empty where that was not requested."""
    unseen = fit.unseen
    if unseen is None or not unseen.per_test:
        return []
    currents = sorted({test.current_A for test in unseen.per_test})
    rows: list[list[Words]] = []
    for pair in unseen.per_pair:
        motion = pair.amplitude_m, pair.frequency_Hz
        here = [test for test in unseen.per_test if (test.amplitude_m, test.frequency_Hz) == motion]
        cells = [_cell([test for test in here if test.current_A == current]) for current in currents]
        name = f"{display.displacement.text(motion[0], 3)} {number(motion[1], 3)} Hz"
        rows.append([name, *cells, number(pair.nrmse_percent_of_peak, 3)])
    head: list[Head] = ["Excluded motion", *(f"{number(current, 3)} A" for current in currents), "Mean"]
    note = (
        "Each amplitude and frequency is predicted with the same model fitted to all other motions. Errors are in % "
        f"of the force amplitude. Mean of all tests: {number(unseen.nrmse_percent_of_peak, 3)} "
        f"%{extrapolated_words(unseen)}."
    )
    made = table(head, rows, range(1, len(head)))
    return [*section("Leave-one-motion-out cross-validation", note, 3), made, *_extrapolated(unseen)]


def _cell(tests: Sequence[UnseenTest]) -> Words:
    """The error of one motion and current, of the worst test where there are several; marked where extrapolated."""
    known = [test for test in tests if math.isfinite(test.nrmse_percent_of_peak)]
    if not known:
        return NOTHING
    worst = max(known, key=lambda test: test.nrmse_percent_of_peak)
    error = worst.nrmse_percent_of_peak
    return Shade(number(error, 3) + (MARK if worst.beyond else ""), error / DARKEST_PERCENT)


def _extrapolated(unseen: Unseen) -> Blocks:
    """Which of the tests are outside the data of the others."""
    beyond = {test.id: test.beyond for test in unseen.per_test if test.beyond}
    if not beyond:
        return []
    stated = f"{MARK} Outside the range of the other data (extrapolated): {_outside_words(beyond)}."
    return [Paragraph(stated, small=True)]

"""The report's sections on the fit: parameters with intervals, quality for each test, profiles, proposed tests.

Colours show how well a value is known: green an interval below 2 %, amber up to 20 %, red beyond or not at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import rig.dampers
from rig.dampers.covered import in_words
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
from rig.errors import RigError
from rig.signals.arrays import FloatArray

JsonObject = Mapping[str, Any]

WELL_KNOWN_PERCENT, KNOWN_PERCENT = 2.0, 20.0
THRESHOLD = 3.84
STRONG_CORRELATION = 0.9
SMALLEST_WHITE_P = 0.001
DARKEST_PERCENT = 25.0
MARK = "*"
MOST_PAIRS = 8
SEEN = frozenset({"signs-reversed", "force-offset"})
"""Causes that are visible in the tests themselves and that no fit was made with."""
METHODS = {"separable": "separable least squares"}
"""Names of fitting methods in words."""


def outside(names: Sequence[str] | None) -> str:
    """The quantities in which a test lies outside the fitted data; empty for none or unknown."""
    return in_words(names or ())


def validation_words(test: JsonObject) -> str:
    """That a test was kept for validation, and in what it lies outside the fitted data."""
    quantities = outside(test.get("beyond"))
    return f"validation, outside the fitted data: {quantities}" if quantities else "validation"


def parameters(fit: JsonObject) -> Blocks:
    """Fitted parameters with their intervals, then those that the data do not determine, and why."""
    meanings = _meanings(str(fit.get("model")))
    again = [f"95 %, {fit['bootstrap']['count']} bootstrap samples"] if fit.get("bootstrap") else []
    known: list[list[Words]] = []
    unknown: list[list[Words]] = []
    for name, entry in (fit.get("parameters") or {}).items():
        value, unit, meaning = number(entry.get("value"), 5), str(entry.get("unit", "")), meanings.get(name, "")
        if entry.get("identifiable", True):
            low, high = entry.get("low"), entry.get("high")
            value, interval = between(entry.get("value"), low, high)
            half = _half_percent(entry.get("value"), low, high)
            known.append([name, value, interval, half, *_bootstrapped(fit, name), unit, meaning])
        else:
            unknown.append([name, value, unit, meaning, entry.get("reason") or "the data do not determine it"])
    head: list[Head] = ["Parameter", "Value", "95 % interval", Column(PLUS_MINUS, "%", True), *again, "Unit", "Meaning"]
    parts: Blocks = [Heading("Fitted parameters"), *_equation(fit), table(head, known, (1, 2))]
    if unknown:
        parts.append(Heading("Not identifiable from these data", 3))
        rows = [Row(tuple(cells), faded=True) for cells in unknown]
        parts.append(table(["Parameter", "Value used", "Unit", "Meaning", "Reason"], rows, (1,)))
    parts += [*_diagnosis(fit), *_next_tests(fit), *_profiles(fit), *selection(fit), *cross_validation(fit)]
    return parts + [Paragraph(note, small=True) for note in fit.get("notes") or ()]


RANGES = (
    ("displacement_m", "Displacement about mid-stroke", 1e3, "mm"), ("velocity_m_s", "Velocity", 1.0, "m/s"),
    ("current_A", "Current", 1.0, "A"), ("temperature_degC", "Coil temperature", 1.0, "\N{DEGREE SIGN}C"),
)  # fmt: skip


def _equation(fit: JsonObject) -> Blocks:
    """The model's equation, and the range in which the tests support it."""
    stated: Blocks = (
        [Paragraph((Strong(str(fit.get("model", ""))), f": {fit['equation']}"))] if fit.get("equation") else []
    )
    tested, rows = fit.get("tested") or {}, []
    for name, title, scale, unit in RANGES:
        ends = [end for end in tested.get(name) or () if isinstance(end, (int, float))]
        if len(ends) == 2:
            rows.append([title, *(number(round(scale * end, 3) + 0.0, 4) for end in ends), unit])
    if not rows:
        return stated
    note = "The model is supported by tests in these ranges only; outside them its force is an extrapolation."
    return [*stated, table(["Valid for", "from", "to", "Unit"], rows, (1, 2)), Paragraph(note, small=True)]


def quality(fit: JsonObject) -> Blocks:
    """Errors, residuals and energy of each test, and how the parameters depend on each other."""
    error = fit.get("error") or {}
    tests = [*((test, "") for test in error.get("per_test") or ())]
    tests += [(test, validation_words(test)) for test in (error.get("holdout") or {}).get("per_test") or ()]
    if not any("energy_J" in test for test, _ in tests):
        return []
    head: list[Head] = [
        Column("Test"), Column("Error", "%", True), Column("RMS error", "N", True), Column("Cycle SD", "N", True),
        Column("Noise", "N", True), Column("Systematic residual", "N", True), Column("Whiteness p", "", True),
        Column("Energy", "J", True), Column("Modelled", "J", True), Column("Remark"),
    ]  # fmt: skip
    note = (
        "Cycle SD: standard deviation of the force from cycle to cycle. Noise, systematic residual: the parts of the "
        "residual that change and that repeat with every cycle; the model does not describe the latter. Whiteness p: "
        "probability of such a residual if it were pure noise, at the rate of the noise. Energy: dissipated in a mean "
        "cycle, measured and modelled."
    )
    rows = [_test_row(test, remark) for test, remark in tests]
    return [*section("Quality of the fit", note), *_passivity(fit), table(head, rows), *_correlation(fit)]


def _passivity(fit: JsonObject) -> Blocks:
    passivity = fit.get("passivity") or {}
    if passivity.get("share") is None:
        return []
    share = 100.0 * float(passivity["share"])
    severity, word = (GOOD, "passive") if share == 100.0 else (POOR, "not passive")
    worst = f"; the largest energy input is {passivity['worst']}" if passivity.get("worst") else ""
    text = f" The fitted model dissipates energy at {number(share, 3)} % of the tested speeds and currents{worst}."
    return [Paragraph((Label(word, severity), text))]


def _test_row(test: JsonObject, remark: str) -> list[Words]:
    residual = test.get("residual") or {}
    chances = [residual[key] for key in ("portmanteau_p", "runs_p") if residual.get(key) is not None]
    white: Words = NOTHING
    if chances:
        least = min(chances)
        good = least >= SMALLEST_WHITE_P
        white = Label(number(least, 2) if good else f"< {SMALLEST_WHITE_P:g}", GOOD if good else FAIR)
    return [
        str(test.get("id", "")), number(test.get("nrmse_percent_of_peak"), 3), number(test.get("rmse_N"), 3),
        number(test.get("noise_N"), 3), number(residual.get("noise_N"), 3), number(residual.get("repeating_N"), 2),
        white, number(test.get("energy_J")), number(test.get("modelled_energy_J")), remark,
    ]  # fmt: skip


def _bootstrapped(fit: JsonObject, name: str) -> list[Words]:
    """The bootstrap interval as a cell; none where there is no bootstrap."""
    bootstrap = fit.get("bootstrap")
    if not bootstrap:
        return []
    entry = bootstrap["parameters"].get(name)
    return [between(entry["low"], entry["low"], entry["high"])[1] if entry else NOTHING]


def _half_percent(value: object, low: object, high: object) -> Words:
    if not (isinstance(value, float) and isinstance(low, float) and isinstance(high, float) and value != 0.0):
        return NOTHING
    percent = 50.0 * abs((high - low) / value)
    severity = GOOD if percent <= WELL_KNOWN_PERCENT else FAIR if percent <= KNOWN_PERCENT else POOR
    return Label(number(percent, 2), severity)


def _diagnosis(fit: JsonObject) -> Blocks:
    causes = fit.get("diagnosis") or ()
    if not causes:
        return []
    rows = [
        [cause["slug"], cause["text"],
         NOTHING if cause["slug"] in SEEN else number(100.0 * float(cause["explains"]), 3), cause["next"]]
        for cause in causes
    ]  # fmt: skip
    note = (
        "Each cause was fitted separately, together with the damper; the first explains most. The shares do not add "
        f"up. {NOTHING}: found in the tests themselves, without a share of the misfit."
    )
    head: list[Head] = [Column("Cause"), Column("Finding"), Column("Explains", "%", True), Column("Next step")]
    return [*section("Probable causes of the misfit", note, 3), table(head, rows)]


def _next_tests(fit: JsonObject) -> Blocks:
    proposed = fit.get("next_tests") or ()
    if not proposed:
        return []
    note = "Lines for the matrix file; the gain is predicted from the fitted model and the noise of these tests."
    return [
        *section("Proposed next tests", note, 3),
        *(block for one in proposed for block in (Paragraph(one["text"]), Listing(one["toml"].strip()))),
    ]


def _profiles(fit: JsonObject) -> Blocks:
    cards = []
    for name, profile in (fit.get("profiles") or {}).items():
        entry = fit["parameters"][name]
        values, deviance = np.array(profile["values"], float), np.array(profile["deviance"], float)
        if values.size < 3:
            continue
        grid = np.linspace(values[0], values[-1], 121)
        root = np.where(values < entry["value"], -1.0, 1.0) * np.sqrt(deviance)
        traces = [Trace(grid, np.interp(grid, values, root) ** 2, name="profile")]
        if entry.get("standard_error"):
            linear = ((grid - entry["value"]) / entry["standard_error"]) ** 2
            traces.append(Trace(grid, linear, Style.FITTED, "linear"))
        traces.append(Trace(_ends(values), np.full(2, THRESHOLD), Style.RESIDUAL, "95 %"))
        figure = Figure(
            Axis(name, str(entry.get("unit", ""))), Axis("Deviance", limits=(0.0, 8.0)), traces, 400, 220
        )
        ends = " \N{HORIZONTAL ELLIPSIS} ".join(
            "open" if end is None else number(end, 5) for end in (profile["low"], profile["high"])
        )
        cards.append(Card((Strong(name), f" {ends}"), (Figures((figure,)),)))
    if not cards:
        return []
    keys = (Key("profile likelihood", MEASURED), Key("linear interval", FITTED, dashed=True), Key("95 %", RESIDUAL))
    return [Heading("Profile likelihoods", 3), Keys(keys), Cards(tuple(cards))]


def _ends(values: FloatArray) -> FloatArray:
    return np.array([values[0], values[-1]])


def _correlation(fit: JsonObject) -> Blocks:
    rows = fit.get("correlation") or {}
    names = [name for name in rows if (fit["parameters"].get(name) or {}).get("identifiable")]
    if len(names) < 2:
        return []
    pairs = sorted(
        ((abs(rows[a].get(b) or 0.0), a, b) for k, a in enumerate(names) for b in names[:k]), key=lambda pair: -pair[0]
    )
    strong = [f"{b} and {a} ({number(rows[a][b], 2)})" for size, a, b in pairs if size > STRONG_CORRELATION]
    stated = f"Correlation above {STRONG_CORRELATION:g}: {', '.join(strong[:MOST_PAIRS])}." if strong else (
        f"No two parameters have a correlation above {STRONG_CORRELATION:g}."
    )  # fmt: skip
    cells = [[a, *(_heat(rows[a].get(b)) for b in names)] for a in names]
    matrix = table(["", *names], cells, range(1, len(names) + 1))
    condition = f"Condition number of the scaled normal equations: {number(fit.get('condition'), 3)}."
    return [Paragraph(f"{stated} {condition}"), Details("Correlation of the parameters", (matrix,))]


def _heat(value: object) -> Words:
    """A correlation, orange where positive and blue where negative, darker where stronger."""
    if not isinstance(value, (int, float)):
        return NOTHING
    return Shade(signed(f"{round(value, 2) + 0.0:.2f}"), float(value))


def _meanings(name: str) -> dict[str, str]:
    try:
        model = rig.dampers.model(name)
    except RigError:  # a model that is not installed here; its parameters are shown without their meaning
        return {}
    return {parameter.name: parameter.meaning for parameter in model.parameters}


REFERENCES = {
    "mean_cycle": "no model: each cycle from the other cycles of its test (floor)",
    "regression": "no model: regression on motion and current",
}


def selection(fit: JsonObject) -> Blocks:
    """The models compared, best first, and why one was given up; empty for a single model."""
    entries: Sequence[JsonObject] = fit.get("selection") or ()
    if len(entries) < 2:
        return []
    beyond: Mapping[str, Sequence[str]] = next((entry["beyond"] for entry in entries if entry.get("beyond")), {})
    some = any(entry.get("within_nrmse_percent_of_peak") is not None for entry in entries)
    keys = ["holdout_nrmse_percent_of_peak", *(["within_nrmse_percent_of_peak"] if beyond and some else [])]
    rows = []
    for entry in entries:
        values = (number(entry.get(key), 3) for key in (*keys, "rmse_N"))
        cells = (str(entry.get("model")), *values, str(entry.get("parameters", NOTHING)), number(entry.get("bic"), 6))
        rows.append(Row(cells, FAIR if entry.get("reason") else PLAIN))
    for entry in fit.get("references") or ():
        error, *within = (number(entry.get(key), 3) for key in keys)
        error = str(entry.get("reason")) if entry.get(keys[0]) is None and entry.get("reason") else error
        name = REFERENCES.get(str(entry.get("name")), str(entry.get("name")))
        rows.append(Row((name, error, *within, NOTHING, NOTHING, NOTHING), faded=True))
    head = [
        Column("Model"), Column("Validation error" + ("" if some or not beyond else " (extrapolated)"), "%", True),
        *(Column("Without extrapolated tests", "%", True) for _ in keys[1:]), Column("RMS error", "N", True),
        Column("Parameters", "", True), Column("BIC", "", True),
    ]  # fmt: skip
    notes = [str(entry["reason"]) for entry in entries if entry.get("reason")]
    if beyond:
        notes.insert(0, f"Validation tests outside the fitted data (extrapolated): {_outside_words(beyond)}.")
    stated = (Paragraph(note, small=True) for note in notes)
    return [Heading("Models compared, best first", 3), table(head, rows), *stated]


def extrapolated_words(summary: JsonObject) -> str:
    """How many of some validation tests are extrapolated, and the mean without them; empty where none is."""
    tests = summary.get("per_test") or ()
    beyond = sum(bool(test.get("beyond")) for test in tests)
    if not beyond:
        return ""
    within = summary.get("within_nrmse_percent_of_peak")
    if within is None:
        return ", all outside the fitted data (extrapolated)"
    return f"; {number(within, 3)} % without the {beyond} of {len(tests)} outside the fitted data"


def _outside_words(beyond: Mapping[str, Sequence[str]]) -> str:
    return "; ".join(f"{test} ({outside(names)})" for test, names in beyond.items())


def cross_validation(fit: JsonObject) -> Blocks:
    """Errors on tests of each amplitude and frequency, by a fit to the others; empty where that was not requested."""
    unseen: JsonObject = fit.get("unseen") or {}
    tests: Sequence[JsonObject] = unseen.get("per_test") or ()
    if not tests:
        return []
    currents = sorted({float(test["current_A"]) for test in tests})
    rows: list[list[Words]] = []
    for pair in unseen["per_pair"]:
        motion = pair["amplitude_m"], pair["frequency_Hz"]
        here = [test for test in tests if (test["amplitude_m"], test["frequency_Hz"]) == motion]
        cells = [_cell([test for test in here if float(test["current_A"]) == current]) for current in currents]
        name = f"{number(1e3 * motion[0], 3)} mm {number(motion[1], 3)} Hz"
        rows.append([name, *cells, number(pair["nrmse_percent_of_peak"], 3)])
    head: list[Head] = ["Motion left out", *(f"{number(current, 3)} A" for current in currents), "Mean"]
    note = (
        "Each amplitude and frequency predicted by a fit of the same model to the others; error in % of the peak "
        f"force. Mean of all tests: {number(unseen.get('nrmse_percent_of_peak'), 3)} %{extrapolated_words(unseen)}."
    )
    made = table(head, rows, range(1, len(head)))
    return [*section("Leave-one-motion-out cross-validation", note, 3), made, *_extrapolated(unseen)]


def _cell(tests: Sequence[JsonObject]) -> Words:
    """The error of one motion and current, of the worst test where there are several; marked where extrapolated."""
    if not tests:
        return NOTHING
    known = [test for test in tests if test["nrmse_percent_of_peak"] is not None]
    if not known:
        return NOTHING
    worst = max(known, key=lambda test: float(test["nrmse_percent_of_peak"]))
    error = float(worst["nrmse_percent_of_peak"])
    return Shade(number(error, 3) + (MARK if worst.get("beyond") else ""), error / DARKEST_PERCENT)


def _extrapolated(unseen: JsonObject) -> Blocks:
    """Which of the tests are outside the data of the others."""
    beyond = {str(test["id"]): test["beyond"] for test in unseen["per_test"] if test.get("beyond")}
    if not beyond:
        return []
    stated = f"{MARK} Outside the data of the others (extrapolated): {_outside_words(beyond)}."
    return [Paragraph(stated, small=True)]

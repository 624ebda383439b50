"""The report's part about the fit: parameters and how sure they are, quality test by test, profiles, what to test next.

Colours mean how well something is known: green an interval below 2 %, amber up to 20 %, red beyond or not at all.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import rig.dampers
from rig.errors import RigError
from rig.report.chart import Chart, Trace
from rig.report.fragment import (
    NOTHING,
    between,
    beyond,
    block,
    card,
    charts,
    chip,
    code_block,
    details,
    heading,
    held_out,
    key,
    key_line,
    lead,
    number,
    paragraph,
    shaded,
    signed,
    table,
    text,
)
from rig.report.style import FITTED, MEASURED, RESIDUAL
from rig.signals.arrays import FloatArray

JsonObject = Mapping[str, Any]

WELL_KNOWN_PERCENT, KNOWN_PERCENT = 2.0, 20.0
THRESHOLD = 3.84
STRONG_CORRELATION = 0.9
SMALLEST_WHITE_P = 0.001
DARKEST_PERCENT = 25.0
MARK = "*"
SEEN = frozenset({"signs-reversed", "force-offset"})
"""Causes that no fit was asked about."""


def parameters(fit: JsonObject) -> str:
    """Fitted parameters with their intervals, then those the data cannot identify, and why."""
    known, unknown = [], []
    meanings = _meanings(str(fit.get("model")))
    for name, entry in (fit.get("parameters") or {}).items():
        value, unit = number(entry.get("value"), 5), text(entry.get("unit", ""))
        if entry.get("identifiable", True):
            low, high = entry.get("low"), entry.get("high")
            value, interval = between(entry.get("value"), low, high)
            half = _half_percent(entry.get("value"), low, high)
            row = [text(name), value, interval, half, *_drawn_again(fit, name), unit, text(meanings.get(name, ""))]
            known.append(("", row))
        else:
            why = entry.get("reason") or "the data do not determine it"
            unknown.append(("no", [text(name), value, unit, text(meanings.get(name, "")), text(why)]))
    parts = [heading("Fitted parameters"), _equation(fit)]
    again = [f"95 %, tests drawn {fit['bootstrap']['count']} times"] if fit.get("bootstrap") else []
    head = ["Parameter", "Value", "95 % interval", "\N{PLUS-MINUS SIGN} %", *again, "Unit", "Meaning"]
    parts.append(table(head, known, (1, 2, 3)))
    if unknown:
        parts.append(heading("Not identifiable from these data", level=3))
        parts.append(table(["Parameter", "Value used", "Unit", "Meaning", "Why"], unknown, (1,)))
    parts += [_diagnosis(fit), _next_tests(fit), _profiles(fit), _selection(fit), _foretold(fit)]
    parts += [lead(text(note)) for note in fit.get("notes") or ()]
    return "".join(parts)


RANGES = (
    ("displacement_m", "Displacement about mid-stroke", 1e3, "mm"), ("velocity_m_s", "Velocity", 1.0, "m/s"),
    ("current_A", "Current", 1.0, "A"), ("temperature_degC", "Coil temperature", 1.0, "\N{DEGREE SIGN}C"),
)  # fmt: skip


def _equation(fit: JsonObject) -> str:
    """The model's equation, and where the tests let it be used."""
    told = paragraph(f"<b>{text(fit.get('model', ''))}</b>: {text(fit['equation'])}") if fit.get("equation") else ""
    tested = fit.get("tested") or {}
    rows = []
    for name, title, scale, unit in RANGES:
        ends = [end for end in tested.get(name) or () if isinstance(end, (int, float))]
        if len(ends) == 2:
            rows.append(("", [title, *(number(round(scale * end, 3) + 0.0, 4) for end in ends), unit]))
    if not rows:
        return told
    note = "Valid where it was tested; beyond these ranges it is an extrapolation, which nothing here supports."
    return told + table(["Valid for", "from", "to", "Unit"], rows, (1, 2)) + lead(note)


def quality(fit: JsonObject) -> str:
    """Errors, residuals and energy test by test, and how the parameters depend on each other."""
    error = fit.get("error") or {}
    tests = [*((test, "") for test in error.get("per_test") or ())]
    tests += [(test, held_out(test)) for test in (error.get("holdout") or {}).get("per_test") or ()]
    if not any("energy_J" in test for test, _ in tests):
        return ""
    head = ["Test", "Error %", "RMS error N", "Scatter N", "Noise N", "Repeats N", "White?", "Energy J", "Model J", ""]
    rows = [("", _test_row(test, remark)) for test, remark in tests]
    note = (
        "Scatter: of the force from cycle to cycle. Noise and repeats: the residual's parts that change and that come "
        "back with every cycle, which is what the model lacks. White: chance of such a residual if it were pure noise, "
        "at the noise's own rate. Energy: dissipated in a mean cycle, measured and by the model."
    )
    passivity = fit.get("passivity") or {}
    passive = ""
    if passivity.get("share") is not None:
        share = 100.0 * float(passivity["share"])
        kind, words = ("good", "passive") if share == 100.0 else ("poor", "not passive")
        passive = paragraph(
            f"{chip(words, kind)} The fitted model takes energy out at {number(share, 3)} % of the tested speeds "
            f"and currents{': at worst it puts in ' + text(passivity['worst']) if passivity.get('worst') else ''}."
        )
    return heading("Quality of the fit", note) + passive + table(head, rows, range(1, 9)) + _correlation(fit)


def _test_row(test: JsonObject, remark: str) -> list[str]:
    residual = test.get("residual") or {}
    chances = [residual[key] for key in ("portmanteau_p", "runs_p") if residual.get(key) is not None]
    white = NOTHING
    if chances:
        least = min(chances)
        good = least >= SMALLEST_WHITE_P
        white = chip(f"p {number(least, 2)}" if good else f"p < {SMALLEST_WHITE_P:g}", "good" if good else "fair")
    repeats = residual.get("repeating_N")
    return [
        text(test.get("id", "")), number(test.get("nrmse_percent_of_peak"), 3), number(test.get("rmse_N"), 3),
        number(test.get("noise_N"), 3), number(residual.get("noise_N"), 3), number(repeats, 2), white,
        number(test.get("energy_J")), number(test.get("modelled_energy_J")), text(remark),
    ]  # fmt: skip


def _drawn_again(fit: JsonObject, name: str) -> list[str]:
    """The interval of tests drawn again, as a cell; none where they were not."""
    bootstrap = fit.get("bootstrap")
    if not bootstrap:
        return []
    entry = bootstrap["parameters"].get(name)
    return [between(entry["low"], entry["low"], entry["high"])[1] if entry else NOTHING]


def _half_percent(value: object, low: object, high: object) -> str:
    if not (isinstance(value, float) and isinstance(low, float) and isinstance(high, float) and value != 0.0):
        return NOTHING
    percent = 50.0 * abs((high - low) / value)
    kind = "good" if percent <= WELL_KNOWN_PERCENT else "fair" if percent <= KNOWN_PERCENT else "poor"
    return chip(number(percent, 2), kind)


def _diagnosis(fit: JsonObject) -> str:
    causes = fit.get("diagnosis") or ()
    if not causes:
        return ""
    rows = [
        [text(cause["slug"]), text(cause["text"]),
         NOTHING if cause["slug"] in SEEN else number(100.0 * float(cause["explains"]), 3), text(cause["next"])]
        for cause in causes
    ]  # fmt: skip
    note = (
        "Each cause was fitted together with the damper, alone; the first explains most. Shares do not add up. "
        f"{NOTHING}: seen in the tests themselves, and no share of the misfit."
    )
    head = ["Cause", "What was found", "Explains %", "What to do"]
    return heading("What probably explains the misfit", note, level=3) + table(head, [("", row) for row in rows], (2,))


def _next_tests(fit: JsonObject) -> str:
    proposed = fit.get("next_tests") or ()
    if not proposed:
        return ""
    proposals = "".join(
        paragraph(text(proposal["text"])) + code_block(proposal["toml"].strip()) for proposal in proposed
    )
    note = lead("Lines for the matrix file. Expected from the fitted model and the noise of these tests.")
    return heading("What to test next", level=3) + block("card", proposals + note)


def _profiles(fit: JsonObject) -> str:
    cards = []
    for name, profile in (fit.get("profiles") or {}).items():
        entry = fit["parameters"][name]
        values, deviance = np.array(profile["values"], float), np.array(profile["deviance"], float)
        if values.size < 3:
            continue
        grid = np.linspace(values[0], values[-1], 121)
        root = np.where(values < entry["value"], -1.0, 1.0) * np.sqrt(deviance)
        traces = [Trace(grid, np.interp(grid, values, root) ** 2, "m", "profile")]
        if entry.get("standard_error"):
            traces.append(Trace(grid, ((grid - entry["value"]) / entry["standard_error"]) ** 2, "p", "linear"))
        traces.append(Trace(_ends(values), np.full(2, THRESHOLD), "e", "95 %"))
        chart = Chart(f"{name} {entry.get('unit', '')}", "Deviance", traces, 400, 220, y_range=(0.0, 8.0))
        ends = " \N{HORIZONTAL ELLIPSIS} ".join(
            "open" if end is None else number(end, 5) for end in (profile["low"], profile["high"])
        )
        cards.append(card(f"<b>{text(name)}</b><span>{ends}</span>", chart.svg()))
    if not cards:
        return ""
    keys = (
        key("profile likelihood", MEASURED) + key("linear interval's parabola", FITTED, dashed=True)
        + key("95 %", RESIDUAL)
    )
    return heading("Profile likelihoods", level=3) + key_line("", keys) + charts(cards)


def _ends(values: FloatArray) -> FloatArray:
    return np.array([values[0], values[-1]])


def _correlation(fit: JsonObject) -> str:
    rows = fit.get("correlation") or {}
    names = [name for name in rows if (fit["parameters"].get(name) or {}).get("identifiable")]
    if len(names) < 2:
        return ""
    pairs = sorted(
        ((abs(rows[a][b] or 0.0), a, b) for k, a in enumerate(names) for b in names[:k]), key=lambda pair: -pair[0]
    )
    strong = [f"{text(b)} and {text(a)} ({number(rows[a][b], 2)})" for size, a, b in pairs if size > STRONG_CORRELATION]
    said = f"Correlated beyond {STRONG_CORRELATION:g}: {', '.join(strong[:8])}." if strong else (
        f"No two parameters are correlated beyond {STRONG_CORRELATION:g}."
    )  # fmt: skip
    cells = [("", [text(a), *(_heat(rows[a].get(b)) for b in names)]) for a in names]
    matrix = table(["", *(text(name) for name in names)], cells, range(1, len(names) + 1))
    condition = f"Condition number of the scaled normal equations: {number(fit.get('condition'), 3)}."
    return paragraph(f"{said} {condition}") + details("Correlation of the parameters", matrix)


def _heat(value: object) -> str:
    """A correlation, orange where positive and blue where negative, the stronger the darker."""
    if not isinstance(value, (int, float)):
        return NOTHING
    colour = "213,94,0" if value > 0.0 else "0,114,178"
    return shaded(signed(f"{round(value, 2) + 0.0:.2f}"), f"rgba({colour},{0.5 * abs(value):.2f})")


def _meanings(name: str) -> dict[str, str]:
    try:
        model = rig.dampers.model(name)
    except RigError:  # a model that is not known here; its parameters stand without their meaning
        return {}
    return {parameter.name: parameter.meaning for parameter in model.parameters}


REFERENCES = {
    "mean_cycle": "no model: each cycle by the test's others (floor)",
    "regression": "no model: regression on motion and current",
}


def _selection(fit: JsonObject) -> str:
    entries: Sequence[JsonObject] = fit.get("selection") or ()
    if len(entries) < 2:
        return ""
    outside: Mapping[str, Sequence[str]] = next((entry["beyond"] for entry in entries if entry.get("beyond")), {})
    keys = ["holdout_nrmse_percent_of_peak", *(["within_nrmse_percent_of_peak"] if outside else [])]
    rows = [("", [text(entry.get("model")), *(number(entry.get(key), 3) for key in keys), number(entry.get("bic"), 6)])
            for entry in entries]  # fmt: skip
    rows += [("", [text(REFERENCES.get(str(entry.get("name")), entry.get("name"))),
                   *(number(entry.get(key), 3) for key in keys),
                   NOTHING]) for entry in fit.get("references") or ()]  # fmt: skip
    notes = [entry["reason"] for entry in entries if entry.get("reason")]
    if outside:
        told = "; ".join(f"{test} ({beyond(names)})" for test, names in outside.items())
        notes.insert(0, f"Unseen tests beyond the data of their fit, so foretold by extrapolation: {told}.")
    head = ["Model", "Error on unseen tests %", *(["Without those beyond the data %"] if outside else []), "BIC"]
    below = "".join(lead(text(note)) for note in notes)
    return heading("Models compared", level=3) + table(head, rows, range(1, len(head))) + below


def _foretold(fit: JsonObject) -> str:
    """Errors on tests of each amplitude and frequency, by a fit to the others; empty where that was not asked for."""
    unseen: JsonObject = fit.get("unseen") or {}
    tests: Sequence[JsonObject] = unseen.get("per_test") or ()
    if not tests:
        return ""
    currents = sorted({float(test["current_A"]) for test in tests})
    rows = []
    for pair in unseen["per_pair"]:
        motion = pair["amplitude_m"], pair["frequency_Hz"]
        here = [test for test in tests if (test["amplitude_m"], test["frequency_Hz"]) == motion]
        cells = [_cell([test for test in here if float(test["current_A"]) == current]) for current in currents]
        name = f"{number(1e3 * motion[0], 3)} mm {number(motion[1], 3)} Hz"
        rows.append(("", [name, *cells, number(pair["nrmse_percent_of_peak"], 3)]))
    head = ["Motion left out", *(f"{number(current, 3)} A" for current in currents), "Mean"]
    note = (
        "Each amplitude and frequency by a fit of the same model to the others: error in % of the test's peak force. "
        f"Mean of all tests: {number(unseen.get('nrmse_percent_of_peak'), 3)} %."
    )
    return heading("Foretold from the others", note, 3) + table(head, rows, range(1, len(head))) + _outside(unseen)


def _cell(tests: Sequence[JsonObject]) -> str:
    """The error of one motion and current, of the worst test where there are several; marked where beyond the data."""
    if not tests:
        return NOTHING
    worst = max(tests, key=lambda test: float(test["nrmse_percent_of_peak"]))
    error = float(worst["nrmse_percent_of_peak"])
    mark = MARK if worst.get("beyond") else ""
    return shaded(number(error, 3) + mark, f"rgba(213,94,0,{0.5 * min(1.0, error / DARKEST_PERCENT):.2f})")


def _outside(unseen: JsonObject) -> str:
    """Which of the tests lie beyond the others' data, and the mean without them."""
    outside = {str(test["id"]): test["beyond"] for test in unseen["per_test"] if test.get("beyond")}
    if not outside:
        return ""
    within = unseen.get("within_nrmse_percent_of_peak")
    without = f" Without them: {number(within, 3)} %." if within is not None else " There are no others."
    told = "; ".join(f"{test} ({beyond(names)})" for test, names in outside.items())
    return lead(text(f"{MARK} Beyond the data of the others, so foretold by extrapolation: {told}.") + without)

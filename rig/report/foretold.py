"""What the model foretells of each amplitude and frequency that it has not seen, current by current."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from rig.report.fragment import NOTHING, beyond, heading, lead, number, shaded, table, text

JsonObject = Mapping[str, Any]
DARKEST_PERCENT = 25.0
SAME_CURRENT_A = 0.02
MARK = "*"


def foretold(fit: JsonObject) -> str:
    """Errors on tests of each motion, by a fit to the others; empty where that was not asked for."""
    unseen: JsonObject = fit.get("unseen") or {}
    tests: Sequence[JsonObject] = unseen.get("per_test") or ()
    if not tests:
        return ""
    currents = _levels([float(test["current_A"]) for test in tests])
    rows = []
    for pair in unseen["per_pair"]:
        motion = pair["amplitude_m"], pair["frequency_Hz"]
        here = [test for test in tests if (test["amplitude_m"], test["frequency_Hz"]) == motion]
        cells = [_cell([test for test in here if _nearest(currents, test) == current]) for current in currents]
        name = f"{number(1e3 * motion[0], 3)} mm {number(motion[1], 3)} Hz"
        rows.append(("", [name, *cells, number(pair["nrmse_percent_of_peak"], 3)]))
    head = ["Motion left out", *(f"{number(current, 3)} A" for current in currents), "Mean"]
    note = (
        "Each amplitude and frequency by a fit of the same model to the others: error in % of the test's peak force. "
        f"Mean of all tests: {number(unseen.get('nrmse_percent_of_peak'), 3)} %."
    )
    return heading("Foretold from the others", note, 3) + table(head, rows, range(1, len(head))) + _outside(unseen)


def _levels(currents_A: Sequence[float]) -> list[float]:
    """The currents (A) that were commanded, each once, lowest first."""
    levels: list[float] = []
    for current in sorted(currents_A):
        if not levels or current - levels[-1] > SAME_CURRENT_A:
            levels.append(current)
    return levels


def _nearest(levels: Sequence[float], test: JsonObject) -> float:
    return min(levels, key=lambda level: abs(level - float(test["current_A"])))


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

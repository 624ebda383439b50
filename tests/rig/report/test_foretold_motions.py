"""Errors on motions left out, in the report: each motion and current in its cell, what lies beyond the data marked."""

from __future__ import annotations

import re
from typing import Any

from rig.document.html import fragment
from rig.report.fit import parameters


def unseen_test(
    motion: tuple[float, float], current_A: float, error: float, beyond: list[str] | None = None
) -> dict[str, Any]:
    return {
        "id": f"{1e3 * motion[0]:g} mm {current_A:g} A", "amplitude_m": motion[0], "frequency_Hz": motion[1],
        "current_A": current_A, "nrmse_percent_of_peak": error, "beyond": beyond or [],
    }  # fmt: skip


def cells(html: str) -> list[list[str]]:
    rows = re.findall(r"<tr.*?</tr>", html)
    return [[re.sub(r"<.*?>", "", cell) for cell in re.findall(r"<t[dh].*?</t[dh]>", row)] for row in rows]


def test_every_motion_and_current_has_its_error_and_what_lies_beyond_is_marked_and_told() -> None:
    slow, fast = (0.02, 0.5), (0.005, 4.0)
    tests = [unseen_test(slow, 0.0, 5.0), unseen_test(slow, 1.0, 6.0), unseen_test(slow, 1.0, 7.5)]
    tests.append(unseen_test(fast, 1.0, 9.0, ["velocity_m_s"]))
    pairs = [
        {"amplitude_m": slow[0], "frequency_Hz": slow[1], "tests": 3, "nrmse_percent_of_peak": 6.17},
        {"amplitude_m": fast[0], "frequency_Hz": fast[1], "tests": 1, "nrmse_percent_of_peak": 9.0},
    ]
    mean = {"nrmse_percent_of_peak": 6.88, "within_nrmse_percent_of_peak": 6.17}
    html = fragment(parameters({"unseen": {**mean, "per_pair": pairs, "per_test": tests}}))
    assert cells(html[html.index("Leave-one-motion-out") :]) == [
        ["Motion left out", "0 A", "1 A", "Mean"],
        ["20 mm 0.5 Hz", "5", "7.5", "6.17"],
        ["5 mm 4 Hz", "–", "9*", "9"],
    ]
    assert "5 mm 1 A (velocity)" in html
    assert "6.17 % without the 1 of 4 outside the fitted data" in html


def test_a_fit_that_foretold_nothing_says_nothing() -> None:
    assert "Leave-one-motion-out" not in fragment(parameters({"unseen": None}))

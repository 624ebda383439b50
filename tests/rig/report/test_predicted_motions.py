"""Errors on motions left out, in the report: each motion and current in its cell, what lies beyond the data marked."""

from __future__ import annotations

import re

from rig.document.html import fragment
from rig.fits.entries import Evaluation, Unseen, UnseenPair, UnseenTest
from rig.fits.fit_record import FitRecord
from rig.report.fit import parameters


def unseen_test(
    motion: tuple[float, float], current_A: float, error: float, beyond: tuple[str, ...] = ()
) -> UnseenTest:
    return UnseenTest(
        f"{1e3 * motion[0]:g} mm {current_A:g} A", *motion, current_A, nrmse_percent_of_peak=error, beyond=beyond
    )


def of(unseen: Unseen | None) -> FitRecord:
    return FitRecord("bingham", {}, evaluation=Evaluation(unseen=unseen))


def cells(html: str) -> list[list[str]]:
    rows = re.findall(r"<tr.*?</tr>", html)
    return [[re.sub(r"<.*?>", "", cell) for cell in re.findall(r"<t[dh].*?</t[dh]>", row)] for row in rows]


def test_every_motion_and_current_has_its_error_and_what_lies_beyond_is_marked_and_reported() -> None:
    slow, fast = (0.02, 0.5), (0.005, 4.0)
    tests = [unseen_test(slow, 0.0, 5.0), unseen_test(slow, 1.0, 6.0), unseen_test(slow, 1.0, 7.5)]
    tests.append(unseen_test(fast, 1.0, 9.0, ("velocity_m_s",)))
    pairs = (UnseenPair(*slow, 3, 6.17), UnseenPair(*fast, 1, 9.0))
    html = fragment(parameters(of(Unseen("leave-one-pair-out", 6.88, pairs, tuple(tests)))))
    assert cells(html[html.index("Leave-one-motion-out") :]) == [
        ["Excluded motion", "0 A", "1 A", "Mean"],
        ["20 mm 0.5 Hz", "5", "7.5", "6.17"],
        ["5 mm 4 Hz", "–", "9*", "9"],
    ]
    assert "5 mm 1 A (velocity)" in html
    assert "6.17 % without the 1 of 4 tests outside the fitted data" in html


def test_a_fit_that_forereported_nothing_says_nothing() -> None:
    assert "Leave-one-motion-out" not in fragment(parameters(of(None)))

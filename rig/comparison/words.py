"""Values held against acceptance bands, as text: value, limits, margin."""

from __future__ import annotations

import math

from rig.comparison.acceptance import FIT, PERCENT, Result, State
from rig.display import Display, Shown
from rig.document.numbers import PLUS_MINUS
from rig.document.words import FAIR, GOOD, POOR, Severity
from rig.recording.tested_specimens import TITLES, SpecimenVerdict

NOTHING = "-"
SEVERITIES: dict[State, Severity] = {State.PASSED: GOOD, State.FAILED: POOR, State.UNSURE: FAIR, State.MISSING: FAIR}
SPECIMEN: dict[str, tuple[str, Severity]] = {
    verdict: (TITLES[verdict], severity) for verdict, severity in (
        (SpecimenVerdict.OK, GOOD), (SpecimenVerdict.NOT_OK, POOR), (SpecimenVerdict.NOT_TESTED, FAIR),
    )
}  # fmt: skip
"""Verdict on a specimen -> title, severity."""


def result_text(result: Result, display: Display, *, several: bool = False) -> str:
    """One value: what it is of, the value, its band, the margin, the expanded uncertainty and the remark.

    Args:
        result: of the value.
        display: units and signs.
        several: name the run.
    """
    shown = result.shown(display)
    text = f"{result.title} of the fit" if result.where == FIT else f"{result.title} at {result.location(display)}"
    if several:
        text += f" in {result.run}"
    missing = math.isnan(result.value)
    value = result.why or "not measured" if missing else with_unit(number_text(shown.signed(result.value)), shown.unit)
    text += f": {value}, allowed {band_text(result, shown)}"
    if not missing:
        text += f", margin {margin_text(result, display)}"
        if math.isfinite(result.expanded):
            expanded = with_unit(number_text(shown.value(result.expanded), 2), shown.unit)
            text += f", uncertainty {PLUS_MINUS}{expanded} (k = 2)"
        text += f"; {result.why}" if result.why else ""
    return text + (f" [{result.note}]" if result.note else "")


def band_text(result: Result, shown: Shown) -> str:
    """The band: "900 to 1100 N", "at least 5 N"."""
    low, high = result.band(shown)
    if low is None:
        return f"at most {with_unit(number_text(high), shown.unit)}"
    if high is None:
        return f"at least {with_unit(number_text(low), shown.unit)}"
    return f"{number_text(low)} to {with_unit(number_text(high), shown.unit)}"


def margin_text(result: Result, display: Display) -> str:
    """The margin: "-22 N (-7.6 %)"."""
    shown = result.shown(display)
    text = with_unit(number_text(shown.value(result.margin), 3), shown.unit)
    share = result.margin_percent
    return text if math.isnan(share) or result.unit == PERCENT else f"{text} ({number_text(share, 3)} %)"


def with_unit(shown: str, unit: str) -> str:
    """A number with its unit; nothing stays nothing."""
    return shown if shown == NOTHING else f"{shown} {unit}".rstrip()


def number_text(value: float | None, digits: int = 4) -> str:
    """A number with so many significant digits; `NOTHING` where there is none."""
    if value is None or not math.isfinite(value):
        return NOTHING
    shown = f"{value + 0.0:.{digits}g}"  # + 0.0: no minus zero
    return f"{value:.0f}" if "e" in shown and 1.0 <= abs(value) < 1e7 else shown

"""Numbers as text: the digits that are known, typographic signs, a dash where there is no number."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rig.signals.estimate import Estimate

MINUS = "\N{MINUS SIGN}"
NOTHING = "\N{EN DASH}"
ELLIPSIS = "\N{HORIZONTAL ELLIPSIS}"
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
MOST_DECIMALS = 9
CONFIDENCE = 1.96
"""Standard deviations of a 95 % interval."""


def number(value: object, digits: int = 4) -> str:
    """A number with so many significant digits; a dash where there is none."""
    if not isinstance(value, (int, float)) or isinstance(value, bool) or not math.isfinite(value):
        return NOTHING
    shown = f"{value + 0.0:.{digits}g}"  # no minus before a zero
    if "e" in shown and 1e-4 <= abs(value) < 1e7:
        shown = f"{value:.0f}"
    return signed(shown)


def between(value: object, low: object, high: object) -> tuple[str, str]:
    """A value and its interval with as many digits as are known: two of the half width."""
    ends = [end for end in (low, high) if isinstance(end, (int, float)) and math.isfinite(end)]
    if not isinstance(value, (int, float)) or not math.isfinite(value) or len(ends) < 2 or ends[0] == ends[1]:
        return number(value, 5), f"{number(low, 5)} {ELLIPSIS} {number(high, 5)}"
    decimals = 1 - math.floor(math.log10(abs(ends[1] - ends[0]) / 2.0))
    if decimals > MOST_DECIMALS:
        return number(value, 5), f"{number(low, 5)} {ELLIPSIS} {number(high, 5)}"
    if decimals < 0:
        shown = [_in_full(round(one, decimals), decimals) for one in (value, *ends)]
    else:
        shown = [signed(f"{one:.{decimals}f}") for one in (value, *ends)]
    return shown[0], f"{shown[1]} {ELLIPSIS} {shown[2]}"


def _in_full(rounded: float, decimals: int) -> str:
    """A large number, rounded to tens or more, as `number` writes it."""
    size = math.floor(math.log10(abs(rounded))) if rounded else 0
    return number(rounded, max(1, size + 1 + decimals))


def plus_minus(value: Estimate) -> str:
    """A value and its standard deviation, rounded to two digits of the deviation."""
    return signed(value.plain)


def signed(shown: str) -> str:
    """A number as text with typographic signs in place of `+-` and `-`."""
    return shown.replace("+-", "\N{PLUS-MINUS SIGN}").replace("-", MINUS)

"""Numbers as text: the digits that are known, typographic signs, a dash where there is no number."""

from __future__ import annotations

import math

from rig.signals.rounding import MOST_PLACES, places_of, rounded

MINUS = "\N{MINUS SIGN}"
NOTHING = "\N{EN DASH}"
ELLIPSIS = "\N{HORIZONTAL ELLIPSIS}"
PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
MOST_DIGITS = 6
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
    """A value and its interval with as many digits as half the interval's width lets be known."""
    ends = [end for end in (low, high) if isinstance(end, (int, float)) and math.isfinite(end)]
    if not isinstance(value, (int, float)) or not math.isfinite(value) or len(ends) < 2 or ends[0] == ends[1]:
        return number(value, 5), f"{number(low, 5)} {ELLIPSIS} {number(high, 5)}"
    shown = [_in_full(one, places_of(abs(ends[1] - ends[0]) / 2.0)) for one in (value, *ends)]
    return shown[0], f"{shown[1]} {ELLIPSIS} {shown[2]}"


def known_digits(value: float, std: float) -> str:
    """A value without its uncertainty, rounded to it; with four digits where the uncertainty is not known."""
    if not math.isfinite(value) or not math.isfinite(std) or std <= 0.0:
        return number(value)
    return _in_full(value, min(places_of(std), _most_places(value)))


def with_uncertainty(value: float, std: float) -> str:
    """"123.4 +- 0.6" with typographic signs, both rounded to the uncertainty; the value alone where that is unknown."""
    if not math.isfinite(value) or not math.isfinite(std) or std <= 0.0:
        return number(value)
    places = places_of(std)
    shown = number(std, 2) if places > _most_places(value) else _in_full(std, places)
    return f"{known_digits(value, std)} {PLUS_MINUS} {shown}"


def _most_places(value: float) -> int:
    """Decimal places with which a value has `MOST_DIGITS` digits: no instrument knows more."""
    return MOST_DIGITS - 1 - math.floor(math.log10(abs(value))) if value else MOST_PLACES


def _in_full(value: float, places: int) -> str:
    """A value rounded to decimal places; a large one, rounded to tens or more, as `number` writes it."""
    if places >= 0:
        return signed(rounded(value, places))
    whole = round(value, places)
    size = math.floor(math.log10(abs(whole))) if whole else 0
    return number(whole, max(1, size + 1 + places))


def signed(shown: str) -> str:
    """A number as text with typographic signs in place of `+-` and `-`."""
    return shown.replace("+-", "\N{PLUS-MINUS SIGN}").replace("-", MINUS)

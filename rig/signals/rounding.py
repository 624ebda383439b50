"""Rounding of a value to its uncertainty: the one rule that report, terminal and messages share. Loads no numpy."""

from __future__ import annotations

import math

MOST_PLACES = 9
TWO_DIGITS_BELOW, NEXT_DECADE_FROM = 3.55, 9.5
"""Leading digits of an uncertainty, as the Particle Data Group rounds it (Review of Particle Physics, introduction,
section 5.3): two digits below 3.55, one digit up to 9.5, and 10 with two digits from there."""


def places_of(std: float) -> int:
    """Decimal places of a value with this uncertainty; negative for tens and more.

    Args:
        std: the uncertainty, finite and > 0: 0.0157 gives 3 (0.016), 0.57 gives 1 (0.6), 420 gives -2 (400).
    """
    decade = math.floor(math.log10(std))
    leading = std / 10.0**decade
    return min(MOST_PLACES, (0 if TWO_DIGITS_BELOW <= leading < NEXT_DECADE_FROM else 1)
               - decade - (leading >= NEXT_DECADE_FROM))  # fmt: skip


def rounded(value: float, places: int) -> str:
    """A finite value with so many decimal places as text, never a minus zero; negative ones round to tens and more."""
    return f"{round(value, places) + 0.0:.{max(0, places)}f}"

"""Sentences that state quantities in SI, with those quantities in the units and signs of `[display]`."""

from __future__ import annotations

import re

from rig.display import Display
from rig.signals.rounding import places_of, rounded

QUANTITY = re.compile(r"(?P<value>[-+]?\d+(?:\.\d+)?)(?: \+- (?P<std>\d+(?:\.\d+)?))? (?P<unit>N|mm)\b")
DIGITS = 4


def in_display(text: str, display: Display, *, directed: bool = False) -> str:
    """A text with its forces (N, also N/s and N/A) and lengths (mm) in the units of the display.

    Args:
        text: as the recording or the fit states it, such as "+0.35 +- 0.12 N" or "a sine of 81 mm at 1.5 Hz".
        display: units and signs; the usual one leaves the text as it is.
        directed: whether the values have a direction and follow the sign convention of the display.
    """
    if display.usual:
        return text

    def shown(found: re.Match[str]) -> str:
        by, si = (display.force, 1.0) if found["unit"] == "N" else (display.displacement, 1e-3)
        value = float(found["value"]) * si
        number = by.signed(value) if directed else by.value(value)
        std = by.value(float(found["std"] or 0.0) * si)
        plain = rounded(number, places_of(std)) if std > 0.0 else f"{number + 0.0:.{DIGITS}g}"
        plus = "+" if directed and not plain.startswith("-") else ""
        return f"{plus}{plain}{f' +- {rounded(std, places_of(std))}' if std > 0.0 else ''} {by.unit}"

    return QUANTITY.sub(shown, text)

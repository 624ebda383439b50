"""Filters over points: `waveform=triangle,current_A=1` means every condition must hold."""

from __future__ import annotations

import difflib
import math
from dataclasses import dataclass

from rig.errors import FileProblem

TEXTS = ("id", "waveform", "verdict")
NUMBERS = ("amplitude_m", "frequency_Hz", "current_A", "cycles", "repeat", "centre_m")
RELATIVE_TOLERANCE = 1e-6
IMPORTED_TOLERANCE = 0.05
"""Amplitude and frequency of an imported test are estimates of what somebody asked for."""


@dataclass(frozen=True)
class Selection:
    """Conditions (attribute, wanted values); a point meets one when its attribute equals any of the values."""

    conditions: tuple[tuple[str, tuple[str | float, ...]], ...]

    @classmethod
    def parse(cls, text: str) -> Selection:
        """Read `name=value[|value...][,name=value...]`; numbers are in the unit of the name.

        Raises:
            FileProblem: one line for each condition that cannot be read.
        """
        conditions, problems = [], []
        for part in text.split(","):
            try:
                conditions.append(_condition(part))
            except ValueError as error:
                problems.append(str(error))
        if problems:
            raise FileProblem(f"filter {text!r}", problems)
        return cls(tuple(conditions))

    def holds(self, point: object) -> bool:
        """True when the point meets every condition."""
        tolerance = IMPORTED_TOLERANCE if getattr(point, "imported", False) else RELATIVE_TOLERANCE
        return all(
            any(_equal(getattr(point, name), value, tolerance) for value in values)
            for name, values in self.conditions
        )


def _condition(part: str) -> tuple[str, tuple[str | float, ...]]:
    name, separator, value = (piece.strip() for piece in part.partition("="))
    if not separator or not value:
        raise ValueError(f"{part.strip()!r} is not a condition; write one like waveform=triangle or current_A=1")
    if name in TEXTS:
        return name, tuple(item.strip() for item in value.split("|"))
    if name not in NUMBERS:
        near = difflib.get_close_matches(name, (*TEXTS, *NUMBERS), 1, 0.4)
        hint = f"did you mean {near[0]}?" if near else "known: " + ", ".join((*TEXTS, *NUMBERS))
        raise ValueError(f"{name!r} is no attribute of a point; {hint}")
    try:
        return name, tuple(float(item) for item in value.split("|"))
    except ValueError as error:
        raise ValueError(f"{name} = {value!r} is not a number, in the unit its name says") from error


def _equal(found: object, wanted: str | float, tolerance: float) -> bool:
    if isinstance(wanted, str):
        return str(found) == wanted
    return isinstance(found, (int, float)) and math.isclose(found, wanted, rel_tol=tolerance, abs_tol=1e-9)

"""Where a damper was tested, and what lies beyond: there a model's force is an extrapolation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray

Ends = tuple[float, float]

QUANTITIES = ("displacement_m", "velocity_m_s", "current_A", "temperature_degC")
BEYOND = 0.02  # share of a range by which its ends may be passed: overshoot and noise
LEAST = {"current_A": 0.02, "temperature_degC": 2.0}  # A, K: and at least so much of these
ROOM_A = 0.05  # about a tested current, where it is the only thing known: a set-point and its error
ROOM_OF_GAP = 0.25  # and at most so much of the least distance of two tested currents
NEARLY_ZERO = 1e-3  # share of the larger end of a range: people read a smaller end as 0
SHARE = 0.01  # of a test's samples that lie beyond, from which on the test does


@dataclass(frozen=True, kw_only=True)
class Covered:
    """Lowest and highest value in the tests that a model was fitted to.

    Attributes:
        displacement_m: extension about mid-stroke (m).
        velocity_m_s: velocity (m/s).
        current_A: coil current (A).
        temperature_degC: coil temperature (degC); None where none was recorded.
        only_at_A: the tested currents (A), rising, where the force is known at these alone because the model has
            powers of the current that so few do not tell; empty where it is known from the lowest to the highest.
    """

    displacement_m: Ends
    velocity_m_s: Ends
    current_A: Ends
    temperature_degC: Ends | None = None
    only_at_A: tuple[float, ...] = ()

    def ranges(self) -> list[tuple[str, Ends | None]]:
        """Each quantity with its lowest and highest value."""
        return [(name, getattr(self, name)) for name in QUANTITIES]

    def intervals(self, share: float = BEYOND) -> dict[str, tuple[Ends, ...]]:
        """Quantity -> where it is within, rising: what is known of it, and so large a share of its range beyond."""
        intervals: dict[str, tuple[Ends, ...]] = {}
        for name, ends in self.ranges():
            if ends is not None:
                room = max(share * (ends[1] - ends[0]), LEAST.get(name, 0.0))
                intervals[name] = ((ends[0] - room, ends[1] + room),)
        if self.only_at_A:
            ((low, high),) = intervals["current_A"]
            apart_A = min((b - a for a, b in pairwise(self.only_at_A)), default=math.inf)
            room_A = min(ROOM_A, ROOM_OF_GAP * apart_A)
            intervals["current_A"] = tuple((max(low, at - room_A), min(high, at + room_A)) for at in self.only_at_A)
        return intervals

    def outside(self, values: Mapping[str, FloatArray | None], share: float = BEYOND) -> dict[str, BoolArray]:
        """Quantity -> which of its values (SI, any shape) lie beyond by `share`; only those with such values.

        A temperature that is given where no test recorded one is outside: its effect is unknown. What is no number (a
        temperature that was not read) does not.
        """
        intervals, outside = self.intervals(share), {}
        for name, given in values.items():
            if given is None:
                continue
            where = np.full(given.shape, name not in intervals) | ~np.isnan(given)
            for low, high in intervals.get(name, ()):
                where &= ~((given >= low) & (given <= high))
            outside[name] = where
        return {name: where for name, where in outside.items() if np.any(where)}

    def describe(self) -> str:
        """The ranges in words and units."""
        ranges = ", ".join(f"{name} {ends_in_words(value)}" for name, value in self.ranges() if value is not None)
        if not self.only_at_A:
            return ranges
        currents = ", ".join(f"{current_A:.4g}" for current_A in self.only_at_A)
        return (
            f"{ranges}, only near the currents {currents} A (too few currents for the model to interpolate "
            "between them)"
        )


def ends_in_words(ends: Ends) -> str:
    """Both ends of a range; one that is nearly zero beside the other, such as the noise of a current, as 0."""
    largest = max(map(abs, ends))
    low, high = (f"{end:.4g}" if abs(end) > NEARLY_ZERO * largest else "0" for end in ends)
    return f"{low} to {high}"


def in_words(names: Iterable[str]) -> str:
    """Quantities without their units, each once: `velocity, current`."""
    return ", ".join(dict.fromkeys(name.partition("_")[0] for name in names))

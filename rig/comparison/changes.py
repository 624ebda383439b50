"""The change from one reading to another, and how sure it is."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from rig.comparison.readings import COVERAGE, Reading


@dataclass(frozen=True)
class Change:
    """Difference to the first run's reading (SI), its standard uncertainty, both also in % of the first value.

    The percentage has the first value's sign: more force in jounce, which is negative, is a positive change.
    """

    value: float
    std: float
    percent: float
    percent_std: float

    @property
    def differs(self) -> bool | None:
        """Whether it is more than its expanded uncertainty; None where that is not known."""
        return abs(self.value) > COVERAGE * self.std if math.isfinite(self.std) else None

    def to_json(self) -> dict[str, Any]:
        """Every attribute and `differs`; null where unknown."""
        numbers = {name: value if math.isfinite(value) else None for name, value in vars(self).items()}
        return {**numbers, "differs": self.differs}


def change(before: Reading, after: Reading, *, same_gauge: bool) -> Change:
    """From one reading to another.

    Args:
        before: the first run's.
        after: the later run's.
        same_gauge: one load cell with one calibration measured both: its error is in both and takes itself out.
    """
    value = after.value - before.value
    parts = [before.std, after.std]
    if not same_gauge:
        parts += [part for part in (before.calibration, after.calibration) if math.isfinite(part)]
    std = math.hypot(*parts)
    scale = 100.0 / before.value if before.value != 0.0 else math.nan
    ratio = after.value / before.value if before.value != 0.0 else math.nan
    percent_std = abs(scale) * math.hypot(after.std, ratio * before.std, *parts[2:])
    return Change(value, std, scale * value, percent_std)

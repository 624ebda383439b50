"""The change from one reading to another, and how sure it is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig.comparison.readings import COVERAGE, Motion, Quantity, Reading, widening

SPEED_POWER_STD = 0.5 / math.sqrt(3.0)
"""Of the power of speed that a force follows: anything from dry friction (0) to viscous damping (1)."""


@dataclass(frozen=True)
class Change:
    """Difference to the first run's reading (SI), its standard uncertainty, both also in % of the first value.

    The percentage has the first value's sign: more force in compression, which is negative, is a positive change. It is
    NaN where it would mislead: the first value is not significantly different from zero, the sign changes, or a value
    is `small`. Both uncertainties are widened by Student's t where the scatter is known from few cycles, so that twice
    either is an interval of 95 %. `correction_percent` is by how much the later value was corrected to the first one's
    motion.
    """

    value: float
    std: float
    percent: float
    percent_std: float
    correction_percent: float = 0.0

    @property
    def differs(self) -> bool | None:
        """Whether it is more than its expanded uncertainty; None where that is not known."""
        return abs(self.value) > COVERAGE * self.std if math.isfinite(self.std) else None

    @property
    def absolute(self) -> Change:
        """The same without a percentage."""
        return replace(self, percent=math.nan, percent_std=math.nan)

    def to_json(self) -> dict[str, Any]:
        """Every attribute and `differs`; null where unknown."""
        numbers = {name: value if math.isfinite(value) else None for name, value in vars(self).items()}
        return {**numbers, "differs": self.differs}


@dataclass(frozen=True)
class Transfer:
    """Factor that brings a value of one motion to another, and its relative standard uncertainty."""

    factor: float = 1.0
    std: float = 0.0


def transfer(quantity: Quantity, before: Motion, after: Motion) -> Transfer:
    """What a later value is multiplied by so that it is one of the first motion; 1 where both requested the same.

    The force's own law between dry friction and viscous damping is not known: its power of speed is 0.5 with the
    standard deviation of a uniform distribution from 0 to 1.

    Args:
        quantity: what is compared.
        before: the first run's motion.
        after: the later run's, one that `Motion.same_as` takes for the same.
    """
    one, other = before.read, after.read
    sizes = (one.amplitude_m, other.amplitude_m, one.frequency_Hz, other.frequency_Hz)
    if (one.requested is not None and other.requested is not None) or not all(size > 0.0 for size in sizes):
        return Transfer()
    amplitude = math.log(one.amplitude_m / other.amplitude_m)
    frequency = math.log(one.frequency_Hz / other.frequency_Hz)
    by_amplitude, by_frequency = (power + quantity.speed_power for power in quantity.powers)
    std = math.hypot(
        SPEED_POWER_STD * (amplitude + frequency),
        *(by_amplitude * motion.amplitude_std_m / motion.amplitude_m for motion in (one, other)),
        *(by_frequency * motion.frequency_std_Hz / motion.frequency_Hz for motion in (one, other)),
    )
    return Transfer(math.exp(by_amplitude * amplitude + by_frequency * frequency), std)


def change(
    before: Reading, after: Reading, *, same_gauge: bool, moved: Transfer | None = None, of_band: bool = False
) -> Change:
    """From one reading to another.

    Args:
        before: the first run's.
        after: the later run's.
        same_gauge: one load cell with one calibration measured both: its error is in both and takes itself out.
        moved: brings the later value to the first one's motion; None where both have one motion.
        of_band: the percentage is for a band in %, so that a large one is an answer although it would mislead a reader.
    """
    moved = moved or Transfer()
    later = moved.factor * after.value
    value = later - before.value
    of_later = [moved.factor * after.std, abs(later) * moved.std]
    calibrations: list[float] = []
    if not same_gauge:
        calibrations = [part for part in (before.calibration, after.calibration) if math.isfinite(part)]
    std = math.hypot(before.std, *of_later, *calibrations)
    wider = widening(_freedom(std, ((before.std, before.freedom), (of_later[0], after.freedom))))
    misleading = before.value * later <= 0.0 or before.small or after.small
    relative = before.significant and (of_band or not misleading)
    scale = 100.0 / before.value if relative else math.nan
    ratio = later / before.value if relative else math.nan
    percent_std = abs(scale) * math.hypot(*of_later, ratio * before.std, *calibrations)
    return Change(value, wider * std, scale * value, wider * percent_std, 100.0 * (moved.factor - 1.0))


def _freedom(std: float, parts: Iterable[tuple[float, float]]) -> float:
    """Effective degrees of freedom of a combined standard uncertainty (Welch and Satterthwaite; GUM, G.4.1)."""
    weights = math.fsum(part**4 / freedom for part, freedom in parts if math.isfinite(part))
    return std**4 / weights if weights > 0.0 and math.isfinite(std) else math.inf


@dataclass(frozen=True)
class ChangeSummary:
    """The changes of one quantity over all motions that two runs share.

    Attributes:
        tests: number of motions.
        differ: those whose change is more than its expanded uncertainty.
        absolute: those without a relative change; the median does not include them.
        median_percent: median of the relative changes; NaN without any.
        median: median of all changes (SI).
        largest: the largest relative change; without any, the largest absolute one.
        at: its motion.
        significant: the largest of the changes that are more than their expanded uncertainty, and its motion; None
            without any.
    """

    tests: int
    differ: int
    absolute: int
    median_percent: float
    median: float
    largest: Change
    at: Motion
    significant: tuple[Motion, Change] | None = None

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        known = math.isfinite(self.largest.percent)
        return {
            "tests": self.tests, "differ": self.differ, "absolute": self.absolute,
            "median_percent": self.median_percent if math.isfinite(self.median_percent) else None,
            "median": self.median,
            "largest_percent": self.largest.percent if known else None, "largest": self.largest.value,
            "at": self.at.label,
        }  # fmt: skip


def summarised(changes: list[tuple[Motion, Change]]) -> ChangeSummary | None:
    """Changes of one quantity, with their motions, in one; None without any."""
    if not changes:
        return None
    relative = [(motion, one) for motion, one in changes if math.isfinite(one.percent)]
    if relative:
        at, largest = _largest(relative)
        median_percent = float(np.median([one.percent for _, one in relative]))
    else:
        (at, largest), median_percent = _largest(changes), math.nan
    median = float(np.median([one.value for _, one in changes]))
    differing = [(motion, one) for motion, one in changes if one.differs]
    significant = _largest(differing) if differing else None
    absolute = len(changes) - len(relative)
    return ChangeSummary(len(changes), len(differing), absolute, median_percent, median, largest, at, significant)


def _largest(changes: Sequence[tuple[Motion, Change]]) -> tuple[Motion, Change]:
    """The largest relative change; without any, the largest absolute one."""
    relative = [pair for pair in changes if math.isfinite(pair[1].percent)]
    return max(relative or changes, key=lambda pair: abs(pair[1].percent if relative else pair[1].value))

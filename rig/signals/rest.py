"""A rig at rest, from samples to numbers: its zeros, their noise, and what has drifted between two rests.

What two instruments differ by at rest is the difference of their zeros. Once measured before the motion and once after
it, it tells that one of them has drifted; which one, no bench can tell by itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.estimate import Estimate

FEWEST_SAMPLES = 10
CONTROLLER_NOISE_SHARE = 0.001
"""Of the load cell's range: what a single reading of the controller's coarse force input is taken to scatter by."""
FEWEST_FOR_SCATTER = 5
BLOCKS = 5
CURRENT_NOISE_A = 0.002
SURE = 5.0
"""Standard errors by which a difference at rest, or a drift, is more than noise ..."""
FEW = 4.0
"""... and of a drift so many times more, divided by the degrees of freedom that the noise itself is known by."""
DRIFT_SHARE = 0.01
"""Of the largest measured force, or of the largest measured displacement from rest."""
FEWEST_STATUSES = 3
REPEATS = 1e-6
"""Of the noise: the scatter that rounding makes of one value many times over."""


@dataclass(frozen=True)
class AtRest:
    """Samples of the rest window.

    Attributes:
        force_N: of the load cell, (n,).
        displacement_m: of the LVDT, (m,).
        position_m: the controller's own position, (k,).
        controller_force_N: the controller's own coarse force input, (k,); empty where it has none.
        force_flagged, displacement_flagged: how many samples the sensor itself says are overloaded, faulty or none.
        current_A: what the ECU reports of the coil, whose output stage is off, (j,).
    """

    force_N: FloatArray
    displacement_m: FloatArray
    position_m: FloatArray
    controller_force_N: FloatArray
    force_flagged: int = 0
    displacement_flagged: int = 0
    current_A: FloatArray = field(default_factory=lambda: np.zeros(0))

    @property
    def force_zero(self) -> Estimate:
        """The load cell's mean (N); its standard error from blocks of the window, which see drift and hum too."""
        return _mean(self.force_N, 0.0)

    def force_difference(self, range_N: float) -> Estimate | None:
        """By how much the load cell shows more than the controller's own force input (N); None where that has none."""
        if not len(self.controller_force_N):
            return None
        floor_N = CONTROLLER_NOISE_SHARE * range_N if len(self.controller_force_N) < FEWEST_FOR_SCATTER else 0.0
        cell, coarse = self.force_zero, _mean(self.controller_force_N, floor_N)
        return Estimate(cell.value - coarse.value, math.hypot(cell.std, coarse.std))

    @property
    def current_zero(self) -> Estimate | None:
        """What the ECU reports while its output stage is off (A); None without a report."""
        known = self.current_A[np.isfinite(self.current_A)]
        return _mean(known, CURRENT_NOISE_A) if len(known) else None

    def numbers(self, range_N: float) -> dict[str, float]:
        """What a point's file tells of the rest before the first motion, by attribute of `/entry/quality`."""
        zero, difference, current = self.force_zero, self.force_difference(range_N), self.current_zero
        values = {"rest_force_N": zero.value, "force_zero_std_N": zero.std}
        if difference is not None:
            values |= {"rest_force_difference_N": difference.value, "rest_force_difference_std_N": difference.std}
        if current is not None:
            values |= {"rest_current_A": current.value, "rest_current_std_A": current.std}
        return values


def _mean(values: FloatArray, floor: float) -> Estimate:
    """Mean of samples (n,) and its standard error: of single samples, or of blocks of them where that is larger."""
    count = len(values)
    scatter = max(float(np.std(values, ddof=1)) if count > 1 else 0.0, floor)
    blocks = [float(np.mean(block)) for block in np.array_split(values, BLOCKS)] if count >= 2 * BLOCKS else []
    slow = float(np.std(blocks, ddof=1)) / math.sqrt(BLOCKS) if blocks else 0.0
    return Estimate(float(np.mean(values)), max(scatter / math.sqrt(count), slow))


@dataclass(frozen=True)
class Reading:
    """One quantity over a rest window: mean and standard deviation (of a sample; SI) of `count` samples."""

    mean: float
    std: float
    count: int

    @classmethod
    def of(cls, samples: FloatArray) -> Reading:
        """Of samples (n,); those that are not finite do not count."""
        finite = samples[np.isfinite(samples)]
        if len(finite) == 0:
            return cls(math.nan, math.nan, 0)
        std = float(np.std(finite, ddof=1)) if len(finite) > 1 else 0.0
        return cls(float(np.mean(finite)), std, len(finite))


@dataclass(frozen=True)
class RestWindow:
    """A resting rig as its instruments show it; the controller's own inputs are its `position_m` and force.

    `force_flagged` and `displacement_flagged` count samples that the sensor itself calls overloaded or faulty.
    """

    force_N: Reading
    displacement_m: Reading
    position_m: Reading
    controller_force_N: Reading
    force_flagged: int = 0
    displacement_flagged: int = 0

    def to_json(self) -> dict[str, Any]:
        """The fields by name, readings as objects; null for what nothing was read of."""
        values = asdict(self)
        for name in ("force_N", "displacement_m", "position_m", "controller_force_N"):
            values[name] = {key: None if math.isnan(value) else value for key, value in values[name].items()}
        return values

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> RestWindow:
        """The opposite of `to_json`.

        Raises:
            KeyError, TypeError, ValueError: something is missing or of a wrong type.
        """
        force_N, displacement_m, position_m, controller_force_N = (
            Reading(_number(values[name]["mean"]), _number(values[name]["std"]), int(values[name]["count"]))
            for name in ("force_N", "displacement_m", "position_m", "controller_force_N")
        )
        flagged = int(values["force_flagged"]), int(values["displacement_flagged"])
        return cls(force_N, displacement_m, position_m, controller_force_N, *flagged)

    @classmethod
    def of(cls, seen: AtRest) -> RestWindow:
        """Of these samples."""
        return cls(
            Reading.of(seen.force_N), Reading.of(seen.displacement_m), Reading.of(seen.position_m),
            Reading.of(seen.controller_force_N), seen.force_flagged, seen.displacement_flagged,
        )


def _number(value: float | None) -> float:
    return math.nan if value is None else float(value)


class Spread(NamedTuple):
    """Of some values: the lowest, the highest, and the least difference of two that are not equal (inf: all are)."""

    lowest: float
    highest: float
    step: float

    @classmethod
    def of(cls, values: FloatArray) -> Spread | None:
        """Of values (n,), which are sorted in place; None when there are none."""
        if not len(values):
            return None
        values.sort()
        steps = values[1:] - values[:-1]
        steps = steps[steps > 0.0]
        return cls(float(values[0]), float(values[-1]), float(steps.min()) if len(steps) else math.inf)


class Drifted(NamedTuple):
    """A drift (SI), the least that would have been one, and what of that is noise."""

    drift: float
    limit: float
    noise: float


@dataclass(frozen=True)
class ZeroDrift:
    """A sensor and the controller's own input of the same quantity, at rest at the start and at the end (SI).

    Attributes:
        start: the sensor's reading and the controller's before the first motion.
        end: both at the end.
        peak: the largest value measured between.
        step: the sensor's resolution; inf where it is not known.
        flagged: samples at the end that the sensor itself calls overloaded or faulty.
    """

    start: tuple[Reading, Reading]
    end: tuple[Reading, Reading]
    peak: float
    step: float
    flagged: int

    @property
    def is_checked(self) -> bool:
        """Whether the readings can tell; not those of a stuck sensor, whose noise is gone at the end."""
        (first, first_own), (last, last_own) = self.start, self.end
        few = min(first.count, last.count) < FEWEST_SAMPLES or min(first_own.count, last_own.count) < FEWEST_STATUSES
        stuck = last.std < REPEATS * first.std and first.std > self._resolution
        return not (few or self.flagged or stuck)

    @property
    def _resolution(self) -> float:
        return 0.0 if math.isinf(self.step) else self.step

    def significant(self) -> Drifted | None:
        """What has drifted when the two agree less at the end than at the start, beyond tolerance and noise."""
        if not self.is_checked:
            return None
        (first, first_own), (last, last_own) = self.start, self.end
        drift = (last.mean - last_own.mean) - (first.mean - first_own.mean)
        noise = math.hypot(_noise(first, last), _noise(first_own, last_own))
        limit = max(DRIFT_SHARE * self.peak, noise, self._resolution)
        return Drifted(drift, limit, noise) if abs(drift) > limit else None


def _noise(first: Reading, last: Reading) -> float:
    """What the difference of two means may be by noise alone; few samples know their own scatter badly."""
    freedom = first.count + last.count - 2
    variance = ((first.count - 1) * first.std**2 + (last.count - 1) * last.std**2) / freedom
    return SURE * (1.0 + FEW / freedom) * math.sqrt(variance * (1.0 / first.count + 1.0 / last.count))


def is_constant(values: FloatArray, tolerance: float) -> bool:
    """Whether a signal, shape (n,), shows one value: both halves of it have the same mean, within a tolerance."""
    half = len(values) // 2
    return abs(float(np.mean(values[:half]) - np.mean(values[half:]))) <= tolerance


def difference_N(up_N: FloatArray, down_N: FloatArray) -> tuple[float, float]:
    """Mean of one way less mean of the other, and its standard error (N); not known with few samples."""
    if min(len(up_N), len(down_N)) < FEWEST_STATUSES:
        return 0.0, math.inf
    error_N = math.sqrt(float(np.var(up_N)) / len(up_N) + float(np.var(down_N)) / len(down_N))
    return float(np.mean(up_N) - np.mean(down_N)), error_N

"""What a resting rig must show before it is armed (rows `not-tared`, `sensors-swapped`): values in, verdict out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rig.campaign.stop_cause import StopCause, because
from rig.signals.estimate import Estimate

FEWEST_SAMPLES = 10
REST_FORCE_SHARE = 0.20
REST_FORCE_NOISE_SHARE = 0.02
REST_DISPLACEMENT_NOISE_M = 0.5e-3
MIRRORED_SHARE = 0.05
CONTROLLER_NOISE_SHARE = 0.001
"""Of the load cell's range: what a single reading of the controller's coarse force input is taken to scatter by."""
FEWEST_FOR_SCATTER = 5
SURE = 5.0
"""Standard errors by which a difference at rest is more than noise."""
BLOCKS = 5
CURRENT_NOISE_A = 0.002


@dataclass(frozen=True)
class RestLimits:
    """What is compared with what.

    Attributes:
        force_N: the bench's force limit; a damper at rest shows its gas force, not more than a fifth of this.
        position_min_m: lower stroke limit (m).
        position_max_m: upper stroke limit (m).
        disagreement_m: how far host LVDT and controller position may be apart (m).
        range_N: the load cell's range.
        zero_N: how far load cell and the controller's own force input may be apart, in proportion to the test's force.
        current_zero_A: what the ECU may report while its output stage is off.
        force_per_wire, displacement_per_wire: SI units per unit on the wire of load cell (N) and LVDT (m).
        force_offset_N, displacement_offset_m: what they show at zero.
    """

    force_N: float
    position_min_m: float
    position_max_m: float
    disagreement_m: float
    range_N: float
    zero_N: float
    current_zero_A: float
    force_per_wire: float
    displacement_per_wire: float
    force_offset_N: float
    displacement_offset_m: float


@dataclass(frozen=True)
class AtRest:
    """Samples of the rest window.

    Attributes:
        force_N: of the load cell, (n,).
        displacement_m: of the LVDT, (m,).
        position_m: the controller's own position, (k,).
        controller_force_N: the controller's own coarse force input, (k,).
        force_flagged, displacement_flagged: how many samples the sensor itself says are overloaded, faulty or none.
        current_A: what the ECU reports of the coil, whose output stage is off, (j,).
    """

    force_N: NDArray[np.float64]
    displacement_m: NDArray[np.float64]
    position_m: NDArray[np.float64]
    controller_force_N: NDArray[np.float64]
    force_flagged: int = 0
    displacement_flagged: int = 0
    current_A: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))

    def exchanged(self, limits: RestLimits) -> AtRest:
        """What the same bytes mean when each port carries the other sensor."""
        force_wire = (self.force_N + limits.force_offset_N) / limits.force_per_wire
        displacement_wire = (self.displacement_m + limits.displacement_offset_m) / limits.displacement_per_wire
        return AtRest(
            displacement_wire * limits.force_per_wire - limits.force_offset_N,
            force_wire * limits.displacement_per_wire - limits.displacement_offset_m,
            self.position_m,
            self.controller_force_N,
            current_A=self.current_A,
        )

    @property
    def force_zero(self) -> Estimate:
        """The load cell's mean (N); its standard error from blocks of the window, which see drift and hum too."""
        return _mean(self.force_N, 0.0)

    def force_difference(self, range_N: float) -> Estimate:
        """By how much the load cell shows more than the controller's own force input (N)."""
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
        values = {
            "rest_force_N": zero.value, "force_zero_std_N": zero.std, "rest_force_difference_N": difference.value,
            "rest_force_difference_std_N": difference.std,
        }
        if current is not None:
            values |= {"rest_current_A": current.value, "rest_current_std_A": current.std}
        return values


def _mean(values: NDArray[np.float64], floor: float) -> Estimate:
    """Mean of samples (n,) and its standard error: of single samples, or of blocks of them where that is larger."""
    count = len(values)
    scatter = max(float(np.std(values, ddof=1)) if count > 1 else 0.0, floor)
    blocks = [float(np.mean(block)) for block in np.array_split(values, BLOCKS)] if count >= 2 * BLOCKS else []
    slow = float(np.std(blocks, ddof=1)) / math.sqrt(BLOCKS) if blocks else 0.0
    return Estimate(float(np.mean(values)), max(scatter / math.sqrt(count), slow))


def judge_rest(seen: AtRest, limits: RestLimits) -> StopCause | None:
    """The first thing that does not look like a tared rig at rest; None when all is well.

    Args:
        seen: the samples of the rest window.
        limits: the bench's limits.
    """
    for name, samples, fewest in (
        ("load cell", seen.force_N, FEWEST_SAMPLES),
        ("LVDT", seen.displacement_m, FEWEST_SAMPLES),
        ("controller position", seen.position_m, 1),
        ("controller force", seen.controller_force_N, 1),
    ):
        if len(samples) < fewest or not np.all(np.isfinite(samples)):
            return because("not-tared", "few-samples", name=name, count=len(samples), fewest=fewest)
    for name, flagged in (("load cell", seen.force_flagged), ("LVDT", seen.displacement_flagged)):
        if flagged:
            return because("not-tared", "flagged-samples", name=name, count=flagged)
    cause = _first(seen, limits)
    if cause is None:
        return None
    for what, explains in (
        ("plugs", _first(seen.exchanged(limits), limits) is None),
        ("force-sign", _mirrored(seen.force_N, seen.controller_force_N, limits.zero_N)),
        ("lvdt-sign", _mirrored(seen.displacement_m, seen.position_m, limits.disagreement_m)),
    ):
        if explains:
            return cause.explained("sensors-swapped", what)
    return cause


def _mirrored(shown: NDArray[np.float64], expected: NDArray[np.float64], allowed: float) -> bool:
    """Whether more is apart than allowed, and the other sign would explain nearly all of it.

    What it explains less of may be a zero that was not taken; near zero, noise alone has either sign.
    """
    apart, mirrored = float(np.mean(shown) - np.mean(expected)), float(-np.mean(shown) - np.mean(expected))
    return abs(apart) > allowed and abs(mirrored) < MIRRORED_SHARE * abs(apart)


def _first(seen: AtRest, limits: RestLimits) -> StopCause | None:
    force_N, displacement_m, position_m = seen.force_N, seen.displacement_m, seen.position_m
    causes = (
        _over("load cell at rest", abs(float(np.mean(force_N))), REST_FORCE_SHARE * limits.force_N, "N"),
        _force_zero(seen, limits),
        _over("load cell's noise at rest", float(np.std(force_N)), REST_FORCE_NOISE_SHARE * limits.force_N, "N"),
        _over("LVDT's noise at rest", 1e3 * float(np.std(displacement_m)), 1e3 * REST_DISPLACEMENT_NOISE_M, "mm"),
        _over(
            "LVDT against controller position",
            1e3 * abs(float(np.mean(displacement_m) - np.mean(position_m))),
            1e3 * limits.disagreement_m,
            "mm",
        ),
        _outside(float(np.mean(displacement_m)), limits),
        _current_zero(seen, limits),
    )
    return next((cause for cause in causes if cause is not None), None)


def _force_zero(seen: AtRest, limits: RestLimits) -> StopCause | None:
    difference_N = seen.force_difference(limits.range_N)
    if not difference_N.beyond(0.0, limits.zero_N, SURE):
        return None
    return because("not-tared", "force-zero", difference=difference_N.signed, limit_N=limits.zero_N)


def _current_zero(seen: AtRest, limits: RestLimits) -> StopCause | None:
    zero_A = seen.current_zero
    if zero_A is None or not zero_A.beyond(0.0, limits.current_zero_A, SURE):
        return None
    limit_mA = 1e3 * limits.current_zero_A
    return because("not-tared", "current-zero", zero=zero_A.times(1e3).signed, limit_mA=limit_mA)


def _over(what: str, value: float, limit: float, unit: str) -> StopCause | None:
    if value <= limit:
        return None
    return because("not-tared", "rest-value", what=what, value=value, limit=limit, unit=unit)


def _outside(mean_m: float, limits: RestLimits) -> StopCause | None:
    if limits.position_min_m <= mean_m <= limits.position_max_m:
        return None
    low_mm, high_mm = 1e3 * limits.position_min_m, 1e3 * limits.position_max_m
    return because("not-tared", "rest-position", value_mm=1e3 * mean_m, low_mm=low_mm, high_mm=high_mm)

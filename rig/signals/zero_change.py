"""Whether the load cell's zero moves while a campaign runs: with time (drift), or with the coil's current (crosstalk).

Each point's offset against the controller's own force input is laid over both. Where the points' order does not tell
the two apart, each is what would explain everything alone, and both are named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.estimate import Estimate

COLLINEAR = 0.98
"""Points whose time and current rise together so closely cannot tell drift from crosstalk."""
FEWEST_FOR_BOTH = 4
UNKNOWN = Estimate(0.0, float("inf"))


@dataclass(frozen=True)
class ZeroSeen:
    """The load cell's offset (N) at one point: when it began (s), and at what current of the coil (A)."""

    time_s: float
    current_A: float
    offset_N: Estimate


@dataclass(frozen=True)
class ZeroChange:
    """How the zero moved over a campaign.

    Attributes:
        drift_N_s: per second; `crosstalk_N_A` per ampere of the coil.
        over_time_N, over_current_N: what that makes between the first and the last point, and between the smallest and
            the largest current (N).
        told_apart: whether the points tell the two from each other; else each is what explains all alone.
    """

    drift_N_s: Estimate
    crosstalk_N_A: Estimate
    over_time_N: Estimate
    over_current_N: Estimate
    told_apart: bool

    def moved(self, tolerance_N: float, k: float) -> tuple[bool, bool]:
        """Whether it certainly moved by more than a tolerance with time, and with the current."""
        drift, crosstalk = (change.beyond(0.0, tolerance_N, k) for change in (self.over_time_N, self.over_current_N))
        return drift, crosstalk


def zero_changes(seen: Sequence[ZeroSeen], floor_N: float) -> tuple[ZeroChange, ...]:
    """The zero over time and current: both together where the points allow it, and each alone (the last).

    Args:
        seen: the points that tell an offset.
        floor_N: what no offset is known better than (one standard deviation).

    Returns:
        Nothing for fewer than two points.
    """
    known = [point for point in seen if point.offset_N.known]
    if len(known) < 2:
        return ()
    time_s = np.array([point.time_s for point in known])
    current_A = np.array([point.current_A for point in known])
    offset_N = np.array([point.offset_N.value for point in known])
    std_N = np.array([point.offset_N.widened(floor_N).std for point in known])
    (drift,), (crosstalk,) = (_slopes((column,), offset_N, std_N) for column in (time_s, current_A))
    alone = _change(drift, crosstalk, time_s, current_A, told_apart=False)
    both_vary = len(known) >= FEWEST_FOR_BOTH and np.ptp(time_s) > 0.0 and np.ptp(current_A) > 0.0
    if not both_vary or abs(float(np.corrcoef(time_s, current_A)[0, 1])) > COLLINEAR:
        return (alone,)
    drift, crosstalk = _slopes((time_s, current_A), offset_N, std_N)
    return (_change(drift, crosstalk, time_s, current_A, told_apart=True), alone)


def _change(
    drift: Estimate, crosstalk: Estimate, time_s: FloatArray, current_A: FloatArray, *, told_apart: bool,
) -> ZeroChange:
    long_s, wide_A = float(np.ptp(time_s)), float(np.ptp(current_A))
    over_time_N = drift.times(long_s) if long_s > 0.0 else UNKNOWN
    over_current_N = crosstalk.times(wide_A) if wide_A > 0.0 else UNKNOWN
    return ZeroChange(drift, crosstalk, over_time_N, over_current_N, told_apart)


def _slopes(columns: Sequence[FloatArray], values: FloatArray, std: FloatArray) -> list[Estimate]:
    """Weighted least squares with a constant; what the residuals scatter beyond `std` widens the deviations."""
    spans = [float(np.ptp(column)) for column in columns]
    if not all(span > 0.0 for span in spans):
        return [UNKNOWN] * len(columns)
    scaled = [(column - np.mean(column)) / span for column, span in zip(columns, spans, strict=True)]
    design = np.column_stack((np.ones(len(values)), *scaled)) / std[:, None]
    solution, *_ = np.linalg.lstsq(design, values / std, rcond=None)
    rest = values / std - design @ solution
    freedom = len(values) - design.shape[1]
    widening = max(1.0, float(rest @ rest) / freedom) if freedom > 0 else 1.0
    deviations = np.sqrt(widening * np.diag(np.linalg.inv(design.T @ design)))
    return [
        Estimate(float(solution[i + 1]) / span, float(deviations[i + 1]) / span) for i, span in enumerate(spans)
    ]

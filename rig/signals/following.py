"""How far a measured signal is from its target after removal of the delay: the tracking error of signals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rig.signals.arrays import FloatArray

LONGEST_DELAY_S = 0.2
DELAY_STEP_S = 0.5e-3
MOST_COMPARED = 20_000


class Following(NamedTuple):
    """A measured signal compared with its target.

    Attributes:
        nrms: RMS deviation after removal of the delay, relative to the RMS of the target about its mean.
        delay_s: of the measured signal behind its target (s).
        measured: the measured signal at the compared times plus the delay (k,).
        target: the target at these times (k,).
    """

    nrms: float
    delay_s: float
    measured: FloatArray
    target: FloatArray

    @property
    def mean(self) -> float:
        """Mean deviation, in the unit of the signals."""
        return float(np.mean(self.measured - self.target))

    @property
    def reached(self) -> float:
        """Span of the measured signal relative to the span of the target."""
        span = float(np.ptp(self.target))
        return float(np.ptp(self.measured)) / span if span > 0.0 else np.inf


def following(time_s: FloatArray, measured: FloatArray, query_s: FloatArray, target: FloatArray) -> Following:
    """Compare a measured signal with its target, at the delay at which the RMS deviation is smallest.

    Linear interpolation of 25 samples per cycle is 0.8 % off between two samples, so the result is taken from a cubic
    spline through the samples.

    Args:
        time_s: of the samples (n,), s, increasing; at least two.
        measured: the samples (n,), finite.
        query_s: times at which to compare (k,), s.
        target: the target at these times (k,).
    """
    from scipy.interpolate import CubicSpline  # 0.2 s to load

    rows = slice(None, None, max(1, len(query_s) // MOST_COMPARED))
    query_s, target = query_s[rows], target[rows]

    def apart(delay_s: float) -> float:
        return float(np.mean((np.interp(query_s + delay_s, time_s, measured) - target) ** 2))

    coarse = np.arange(-LONGEST_DELAY_S / 4.0, LONGEST_DELAY_S, 8.0 * DELAY_STEP_S)
    near_s = float(min(coarse, key=apart))
    best_s = float(min(near_s + DELAY_STEP_S * np.arange(-8, 9), key=apart))
    spline = CubicSpline(time_s, measured)

    def at(delay_s: float) -> FloatArray:
        return np.asarray(spline(np.clip(query_s + delay_s, time_s[0], time_s[-1])), np.float64)

    before, here, after = (float(np.mean((at(best_s + k * DELAY_STEP_S) - target) ** 2)) for k in (-1, 0, 1))
    bend = before - 2.0 * here + after
    if bend > 0.0:  # the least of the parabola through the three
        best_s += DELAY_STEP_S * float(np.clip(0.5 * (before - after) / bend, -1.0, 1.0))
    compared, size = at(best_s), float(np.std(target))
    nrms = float(np.sqrt(np.mean((compared - target) ** 2))) / size if size > 0.0 else np.inf
    return Following(nrms, best_s, compared, target)

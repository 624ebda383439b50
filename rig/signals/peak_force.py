"""Peak forces of a point: the largest force in each direction, as damper dynamometers print it.

The one place where it is calculated. The conversion of a point stores it (`RecordedPoint.quality.loop`), so that the
terminal, page, JSON and report show one number; `RecordedPoint.peak_force_N` calculates it for files without it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.loop_shape import by_phase
from rig.signals.spikes import median_of_three

ABOUT_PEAK = 0.05
"""Share of a cycle over which a parabola is fitted about the peak; a sine loses less than 0.001 % by this."""


class PeakForce(NamedTuple):
    """Largest force in rebound and, with its sign, in compression (N); NaN where it is unknown.

    Rebound resists extension and is positive, compression is negative. The gas force is part of both.
    """

    rebound_N: float = math.nan
    compression_N: float = math.nan

    @property
    def known(self) -> bool:
        """Whether both are numbers."""
        return math.isfinite(self.rebound_N) and math.isfinite(self.compression_N)


UNKNOWN = PeakForce()


def peak_force(time_s: FloatArray, force_N: FloatArray, start_s: FloatArray | None = None) -> PeakForce:
    """Peak forces of a motion.

    With cycles, as `of_cycles`: noise does not make them too large. Without, the extremes of `median_of_three`.

    Args:
        time_s: (n,) s, increasing.
        force_N: (n,) N; NaN where nothing was measured.
        start_s: beginnings of the full cycles and the end of the last (k + 1,), s; None for a motion without cycles.
    """
    if start_s is not None and len(start_s) > 1:
        forces = by_phase(time_s, force_N, start_s)
        if forces is not None:
            return of_cycles(forces)
    known = force_N[np.isfinite(force_N)]
    if len(known) < 3:
        return UNKNOWN
    middle = median_of_three(known)[1:-1]
    return PeakForce(float(np.max(middle)), float(np.min(middle)))


def of_cycles(forces_N: FloatArray) -> PeakForce:
    """Peak forces of cycles, force at equal phases of each (k, n), N, from their mean cycle.

    The largest of many noisy values is too large. So a parabola is fitted about the peak, and its top is the result.
    """
    mean_N = np.mean(forces_N, axis=0)
    half = max(2, round(0.5 * ABOUT_PEAK * mean_N.size))
    around_N = np.lib.stride_tricks.sliding_window_view(np.pad(mean_N, half, mode="wrap"), 2 * half + 1)
    highest, lowest = (around_N[find(np.mean(around_N, axis=1))] for find in (np.argmax, np.argmin))
    return PeakForce(_top(highest), -_top(-lowest))


def _top(values: FloatArray) -> float:
    """Highest value of the parabola through values (n,), between the first and the last."""
    curve = np.polyfit(np.linspace(-1.0, 1.0, values.size), values, 2)
    bend, slope, _ = curve
    top = -slope / (2.0 * bend) if bend < 0.0 else 0.0
    return float(np.max(np.polyval(curve, [-1.0, min(1.0, max(-1.0, top)), 1.0])))

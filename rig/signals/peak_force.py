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

SPIKE_SAMPLES = 3
"""Of a motion without cycles, the median of so many samples: a single sample is no peak."""

ABOUT_PEAK = 0.02
"""Share of a cycle over which the force is averaged about the peak; a sine loses 0.07 % of its peak by this."""


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

    With cycles, as `of_cycles`: noise does not make them too large. Without, the extremes of the running median of
    `SPIKE_SAMPLES` samples.

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
    if len(known) < SPIKE_SAMPLES:
        return UNKNOWN
    middle = np.median(np.lib.stride_tricks.sliding_window_view(known, SPIKE_SAMPLES), axis=1)
    return PeakForce(float(np.max(middle)), float(np.min(middle)))


def of_cycles(forces_N: FloatArray) -> PeakForce:
    """Peak forces of cycles, force at equal phases of each (k, n), N, of their mean about the phase of the peak.

    The largest of many noisy values is too large. So the phase of the peak is found in half of the cycles and the force
    there is read in the other half, and the reverse; the result is the mean of both. A single cycle has its extremes.
    """
    width = max(1, round(ABOUT_PEAK * forces_N.shape[1]))
    around = np.pad(forces_N, ((0, 0), (width // 2, (width - 1) // 2)), mode="wrap")
    smooth_N = np.mean(np.lib.stride_tricks.sliding_window_view(around, width, axis=1), axis=2)
    if len(smooth_N) == 1:
        return PeakForce(float(np.max(smooth_N)), float(np.min(smooth_N)))
    halves = np.mean(smooth_N[::2], axis=0), np.mean(smooth_N[1::2], axis=0)
    return PeakForce(*(
        0.5 * float(halves[0][find(halves[1])] + halves[1][find(halves[0])]) for find in (np.argmax, np.argmin)
    ))

"""Velocity for the recorded file: local parabola through measured displacement (Savitzky-Golay), without phase.

It is for looking at a recording. A fit differentiates again from displacement (`rig.recording.differentiation`).
"""

from __future__ import annotations

import numpy as np

from rig.recording.layout import FloatArray

HALF_WIDTH = 4
METHOD = f"local parabola through {2 * HALF_WIDTH + 1} samples"


def velocity_of(time_s: FloatArray, displacement_m: FloatArray) -> tuple[FloatArray, str]:
    """Velocity (n,) in m/s and the method's name.

    Args:
        time_s: (n,) s, increasing, nearly uniform.
        displacement_m: (n,) m.

    Returns:
        NaN within `HALF_WIDTH` samples of an end, of a gap or of a missing value. The slope at the middle of a
        least-squares parabola over uniform samples is `sum(k x_k) / (dt sum(k^2))`.
    """
    count = len(time_s)
    velocity = np.full(count, np.nan)
    width = 2 * HALF_WIDTH + 1
    if count < width:
        return velocity, METHOD
    offsets = np.arange(-HALF_WIDTH, HALF_WIDTH + 1, dtype=np.float64)
    spans = time_s[width - 1:] - time_s[:count - width + 1]
    slopes = np.correlate(displacement_m, offsets, "valid") / float(np.sum(offsets**2)) / (spans / (width - 1))
    typical = float(np.median(spans))
    slopes[spans > typical * (1.0 + 0.5 / (width - 1))] = np.nan
    velocity[HALF_WIDTH:count - HALF_WIDTH] = slopes
    return velocity, METHOD

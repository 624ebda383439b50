"""What the machine achieved, from measured displacement: full cycles, amplitude, mean and frequency."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from rig.recording.layout import FloatArray

HYSTERESIS_SHARE = 0.2
"""A crossing counts once the displacement has been this share of the amplitude on the other side."""
FULL_SHARE = 0.9
"""A cycle is full when its amplitude is at least this share of the typical one, as ramps are not."""


@dataclass(frozen=True)
class Achieved:
    """Measured motion over the full cycles.

    Attributes:
        cycles: number of full cycles.
        start_s: time of their first upward crossing of the mean; `end_s` of their last, s.
        amplitude_m: mean over the cycles of half the peak-to-peak; `amplitude_std_m` its scatter from cycle to cycle.
        mean_m: mean displacement over the cycles.
        frequency_Hz: cycles per second.
    """

    cycles: int
    start_s: float
    end_s: float
    amplitude_m: float
    amplitude_std_m: float
    mean_m: float
    frequency_Hz: float


def achieved_motion(time_s: FloatArray, displacement_m: FloatArray) -> Achieved | None:
    """Measure the motion of one point.

    Args:
        time_s: (n,) s, increasing.
        displacement_m: (n,) m; NaN where nothing was measured.

    Returns:
        None when there is not one full cycle.
    """
    good = np.isfinite(displacement_m)
    time_s, displacement_m = time_s[good], displacement_m[good]
    if len(time_s) < 8:
        return None
    low, high = np.percentile(displacement_m, (2.0, 98.0))
    level = 0.5 * (low + high)
    for _ in range(2):
        crossings = upward_crossings(time_s, displacement_m - level, HYSTERESIS_SHARE * 0.5 * (high - low))
        if len(crossings) < 2:
            return None
        first, last, amplitudes = _full_cycles(time_s, displacement_m, crossings)
        if last <= first:
            return None
        kept = (time_s >= crossings[first]) & (time_s < crossings[last])
        level = float(np.mean(displacement_m[kept]))
    duration_s = crossings[last] - crossings[first]
    return Achieved(
        cycles=last - first, start_s=float(crossings[first]), end_s=float(crossings[last]),
        amplitude_m=float(np.mean(amplitudes)), amplitude_std_m=float(np.std(amplitudes)), mean_m=level,
        frequency_Hz=float((last - first) / duration_s),
    )


def upward_crossings(time_s: FloatArray, about_mean_m: FloatArray, hysteresis_m: float) -> FloatArray:
    """Times (k,) s at which the displacement passes zero upwards, interpolated between the two samples.

    A crossing counts only if the displacement was below `-hysteresis_m` since the one before.
    """
    crossings = []
    state = np.zeros(len(about_mean_m), np.int8)
    state[about_mean_m > hysteresis_m] = 1
    state[about_mean_m < -hysteresis_m] = -1
    decided = np.flatnonzero(state)
    rises = np.flatnonzero((state[decided[:-1]] < 0) & (state[decided[1:]] > 0))
    for below, above in zip(decided[rises], decided[rises + 1], strict=True):
        piece = about_mean_m[below:above + 1]
        right = int(below + np.flatnonzero(piece[1:] >= 0)[0] + 1)
        left = right - 1
        y0, y1 = about_mean_m[left], about_mean_m[right]
        crossings.append(time_s[left] + (time_s[right] - time_s[left]) * (-y0 / (y1 - y0)))
    return np.array(crossings)


def _full_cycles(
    time_s: FloatArray, displacement_m: FloatArray, crossings: FloatArray,
) -> tuple[int, int, FloatArray]:
    """First and last crossing of the longest stretch of full cycles, and those cycles' amplitudes."""
    edges = np.searchsorted(time_s, crossings)
    heights = np.array([
        0.5 * float(np.ptp(displacement_m[left:right])) if right > left else 0.0
        for left, right in itertools.pairwise(edges)
    ])
    typical = float(np.median(heights[heights >= 0.5 * np.max(heights)]))
    full = np.abs(heights / typical - 1.0) <= 1.0 - FULL_SHARE
    best = (0, 0)
    start = 0
    for i, is_full in enumerate(np.append(full, False)):
        if not is_full:
            if i - start > best[1] - best[0]:
                best = (start, i)
            start = i + 1
    return best[0], best[1], heights[best[0]:best[1]]

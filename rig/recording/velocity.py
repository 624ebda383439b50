"""Velocity for the recorded file: local parabola through measured displacement (Savitzky-Golay), without phase.

It is for looking at a recording. A fit differentiates again from displacement (`rig.recording.differentiation`).
"""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from rig.recording.layout import FloatArray

HALF_WIDTH = 4
WIDTH = 2 * HALF_WIDTH + 1
MARGIN = 4 * HALF_WIDTH
"""Samples beyond a part on each side, with which its velocity is that of the whole."""
GAP_STEPS = 1.5
UNIFORM = 0.02
"""Steps that differ by less from a window's mean are one step: an error below 0.5 % of the velocity."""
CHUNK = 65_536
METHOD = f"local parabola through {WIDTH} samples"


def velocity_of(time_s: FloatArray, displacement_m: FloatArray) -> tuple[FloatArray, str]:
    """Velocity (n,) in m/s and the method's name.

    Args:
        time_s: (n,) s, increasing.
        displacement_m: (n,) m; NaN where nothing was measured.

    Returns:
        NaN where the displacement is, and only there (a single sample has no velocity). The slope at the middle of a
        least-squares parabola over uniform samples is `sum(k x_k) / (dt sum(k^2))`; where a window's times are not
        uniform, the parabola is fitted at those times. At the ends, and beside a gap, it
        is the slope of the parabola through the nearest samples on that side.
    """
    velocity = np.full(len(time_s), np.nan)
    known = np.flatnonzero(np.isfinite(displacement_m))
    if len(known) < 2:
        return velocity, METHOD
    steps = np.diff(time_s[known])
    typical_s = float(np.median(steps))
    bounds = [0, *(np.flatnonzero(steps > GAP_STEPS * typical_s) + 1).tolist(), len(known)]
    for first, last in itertools.pairwise(bounds):
        rows = known[first:last]
        if len(rows) > 2:
            velocity[rows] = _stretch(time_s[rows], displacement_m[rows])
            continue
        beside = known[max(0, first - 1) : last + 1]
        velocity[rows] = np.polyfit(time_s[beside] - time_s[rows[0]], displacement_m[beside], 1)[0]
    return velocity, METHOD


def _stretch(time_s: FloatArray, displacement_m: FloatArray) -> FloatArray:
    """Velocity (m,) of at least three samples without a gap."""
    count = len(time_s)
    width = min(WIDTH, count)
    velocity = np.empty(count)
    if count >= WIDTH:
        offsets = np.arange(-HALF_WIDTH, HALF_WIDTH + 1, dtype=np.float64)
        spans_s = time_s[WIDTH - 1 :] - time_s[: count - WIDTH + 1]
        sums = np.correlate(displacement_m, offsets, "valid")
        inner = sums / float(np.sum(offsets**2)) / (spans_s / (WIDTH - 1))
        uneven = _uneven(time_s, spans_s)
        for at in range(0, len(uneven), CHUNK):
            windows = uneven[at : at + CHUNK]
            inner[windows] = _slopes(time_s, displacement_m, windows)
        velocity[HALF_WIDTH : count - HALF_WIDTH] = inner
    ends = ((slice(0, width), slice(0, HALF_WIDTH)), (slice(count - width, count), slice(-HALF_WIDTH, None)))
    for rows, wanted in ends if count >= WIDTH else ((slice(0, count), slice(0, count)),):
        centre_s = float(np.mean(time_s[rows]))
        curve, slope, _ = np.polyfit(time_s[rows] - centre_s, displacement_m[rows], 2)
        velocity[wanted] = slope + 2.0 * curve * (time_s[wanted] - centre_s)
    return velocity


def _uneven(time_s: FloatArray, spans_s: FloatArray) -> NDArray[np.intp]:
    """First samples of the windows in which a step is not what it is on average."""
    steps_s = np.diff(time_s)
    windows = np.lib.stride_tricks.sliding_window_view(steps_s, WIDTH - 1)
    mean_s = spans_s / (WIDTH - 1)
    return np.flatnonzero(np.maximum(windows.max(axis=1) - mean_s, mean_s - windows.min(axis=1)) > UNIFORM * mean_s)


def _slopes(time_s: FloatArray, displacement_m: FloatArray, first: NDArray[np.intp]) -> FloatArray:
    """Slope, at the middle sample, of the parabola through each window that begins at `first` (k,)."""
    rows = first[:, None] + np.arange(WIDTH)
    t = time_s[rows] - time_s[first + HALF_WIDTH, None]
    scale_s = np.max(np.abs(t), axis=1)
    t /= scale_s[:, None]
    design = np.stack((np.ones_like(t), t, t * t), axis=2)
    x = displacement_m[rows] - displacement_m[first + HALF_WIDTH, None]
    normal, right = design.transpose(0, 2, 1) @ design, design.transpose(0, 2, 1) @ x[:, :, None]
    return np.asarray(np.linalg.solve(normal, right)[:, 1, 0] / scale_s, np.float64)

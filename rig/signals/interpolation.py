"""Bringing one channel to another's sample times without inventing what was not measured."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from rig.signals.arrays import BoolArray, FloatArray, IntArray

LARGEST_STEP_PERIODS = 1.5
"""Neighbours further apart than this many sample periods have a gap between them."""


def cubic_at(query_s: FloatArray, time_s: FloatArray, values: FloatArray, period_s: float) -> FloatArray:
    """Cubic through the two neighbours on each side, by Lagrange's formula on the true sample times.

    Args:
        query_s: where to evaluate (m,), s.
        time_s: sample times (n,), s, increasing.
        values: samples (n,), any unit.
        period_s: nominal sample period, s.

    Returns:
        (m,) values; NaN where one of the four neighbours does not exist, is NaN, or lies beyond a gap.
    """
    inside, near = _between(query_s, time_s, 2)
    x = query_s[inside]
    nodes = [time_s[near + k] for k in (-2, -1, 0, 1)]
    step = LARGEST_STEP_PERIODS * period_s
    whole = np.all([later - earlier <= step for earlier, later in itertools.pairwise(nodes)], axis=0)
    total = np.zeros(len(x))
    for j, node in enumerate(nodes):
        weight = np.ones(len(x))
        for k, other in enumerate(nodes):
            if k != j:
                weight *= (x - other) / (node - other)
        total += weight * values[near + j - 2]
    return _placed(np.where(whole, total, np.nan), inside)


def monotone_at(query_s: FloatArray, time_s: FloatArray, values: FloatArray, period_s: float) -> FloatArray:
    """Cubic that never leaves the range of its two neighbours (Fritsch and Butland 1984); arguments as `cubic_at`.

    At a sharp corner between samples it cuts the corner instead of overshooting it. Of a resolved sine with n samples a
    cycle it misses at most 5/n^2 of the amplitude, at the peaks.

    Returns:
        (m,) values; NaN as `cubic_at`.
    """
    inside, near = _between(query_s, time_s, 2)
    near -= 1  # the last sample before
    steps = np.diff(time_s)
    slopes = np.diff(values) / steps
    at_nodes = _limited(steps[:-1], steps[1:], slopes[:-1], slopes[1:])  # from the second sample on
    close = steps <= LARGEST_STEP_PERIODS * period_s
    whole = (close[:-2] & close[1:-1] & close[2:])[near - 1]
    first, last, low, high = at_nodes[near - 1], at_nodes[near], values[near], values[near + 1]
    step = steps[near]
    part = (query_s[inside] - time_s[near]) / step
    rest = 1.0 - part
    curve = low * rest**2 * (1.0 + 2.0 * part) + high * part**2 * (3.0 - 2.0 * part)
    curve += step * part * rest * (rest * first - part * last)
    return _placed(np.where(whole, np.clip(curve, np.minimum(low, high), np.maximum(low, high)), np.nan), inside)


def _between(query_s: FloatArray, time_s: FloatArray, either_side: int) -> tuple[BoolArray, IntArray]:
    """Which of the wanted times have so many samples on either side (m,), and each one's first sample after it."""
    right = np.searchsorted(time_s, query_s, side="right")
    inside = (right >= either_side) & (right <= len(time_s) - either_side)
    return inside, right[inside]


def _placed(values: FloatArray, inside: BoolArray) -> FloatArray:
    """The values at their places, NaN elsewhere."""
    result = np.full(len(inside), np.nan)
    result[inside] = values
    return result


def _limited(before: FloatArray, after: FloatArray, slope: FloatArray, next_slope: FloatArray) -> FloatArray:
    """Slope at a sample between two steps: their weighted harmonic mean; 0 where they differ in sign."""
    same = slope * next_slope > 0.0
    weight = (before + 2.0 * after) / (3.0 * (before + after))
    mixed = np.where(same, weight * next_slope + (1.0 - weight) * slope, 1.0)
    return np.where(same, slope * next_slope / mixed, 0.0)


def linear_at(query_s: FloatArray, time_s: FloatArray, values: FloatArray, period_s: float) -> FloatArray:
    """Straight line between the two neighbours; arguments and result as `cubic_at`."""
    inside, near = _between(query_s, time_s, 1)
    step = time_s[near] - time_s[near - 1]
    part = (query_s[inside] - time_s[near - 1]) / step
    line = values[near - 1] + part * (values[near] - values[near - 1])
    return _placed(np.where(step <= LARGEST_STEP_PERIODS * period_s, line, np.nan), inside)


def status_at(query_s: FloatArray, time_s: FloatArray, values: FloatArray, *, by_arrival: bool) -> FloatArray:
    """A status value at wanted times (m,), s: straight between neighbouring frames, NaN across lost ones.

    Args:
        query_s: where to evaluate (m,), s.
        time_s: times of the frames (n,), s; those that do not come after all before are left out.
        values: (n,), any unit.
        by_arrival: the times are arrivals, which are irregular: up to two lost frames are then not told from late ones.
    """
    increasing = np.diff(np.maximum.accumulate(time_s), prepend=-np.inf) > 0
    time_s, values = time_s[increasing], values[increasing]
    if len(time_s) < 3:
        return np.full(len(query_s), np.nan)
    period_s = float(np.median(np.diff(time_s)))
    return linear_at(query_s, time_s, values, 2.0 * period_s if by_arrival else period_s)


def flags_at(query_s: FloatArray, time_s: FloatArray, flags: NDArray[np.int8]) -> NDArray[np.int8]:
    """Flags (m,) of the two neighbours of each wanted time, joined; 0 beyond the ends."""
    result = np.zeros(len(query_s), np.int8)
    if len(time_s) < 2:
        return result
    right = np.searchsorted(time_s, query_s, side="right")
    inside = (right >= 1) & (right <= len(time_s) - 1)
    near = right[inside]
    result[inside] = flags[near] | flags[near - 1]
    return result

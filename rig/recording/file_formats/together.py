"""Channels of one test that were sampled at different times, as on a CAN bus, interpolated to common times."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.interpolation import monotone_at

LARGEST_STEP = 2.5
"""Neighbours further apart than so many of a channel's median steps have a gap between them."""
SLOWEST_FORCE = 2.0
"""The force may have so many times the step of the displacement; slower, its loop is not what was measured."""


def brought_together(
    values: Mapping[str, FloatArray], times_s: Mapping[str, FloatArray]
) -> tuple[FloatArray, dict[str, FloatArray]] | None:
    """Every channel at the times of the displacement, as far as displacement and force overlap.

    Args:
        values: quantity -> its samples, each of its own length; `displacement` and `force` are among them.
        times_s: quantity -> their times (s).

    Returns:
        The time (n,) and every channel (n,): NaN in gaps, the force by a monotone cubic, others linear; None where the
        force was sampled too slowly, or they hardly overlap.
    """
    clean = {name: _increasing(times_s[name], samples) for name, samples in values.items()}
    if any(len(time_s) < 4 for time_s, _samples in clean.values()):
        return None
    steps_s = {name: float(np.median(np.diff(time_s))) for name, (time_s, _samples) in clean.items()}
    (time_s, displacement), (force_s, _force) = clean["displacement"], clean["force"]
    inside = (time_s >= force_s[0]) & (time_s <= force_s[-1])
    if steps_s["force"] > SLOWEST_FORCE * steps_s["displacement"] or np.count_nonzero(inside) < len(time_s) // 2:
        return None
    base_s = time_s[inside]
    brought = {"displacement": displacement[inside]}
    for name, (own_s, samples) in clean.items():
        if name == "force":
            brought[name] = monotone_at(base_s, own_s, samples, LARGEST_STEP * steps_s[name] / 1.5)
        elif name != "displacement":
            brought[name] = _linear_at(base_s, own_s, samples, LARGEST_STEP * steps_s[name])
    return base_s, brought


def _increasing(time_s: FloatArray, samples: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Samples whose time comes after that of all before them."""
    latest = np.maximum.accumulate(np.where(np.isfinite(time_s), time_s, -np.inf))
    kept = np.isfinite(time_s) & (time_s > np.concatenate([[-np.inf], latest[:-1]]))
    return time_s[kept], samples[kept]


def _linear_at(query_s: FloatArray, time_s: FloatArray, samples: FloatArray, largest_s: float) -> FloatArray:
    after = np.clip(np.searchsorted(time_s, query_s), 1, len(time_s) - 1)
    gap = (time_s[after] - time_s[after - 1] > largest_s) | (query_s < time_s[0]) | (query_s > time_s[-1])
    return np.where(gap, np.nan, np.interp(query_s, time_s, samples))

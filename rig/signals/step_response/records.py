"""Records of steps, and how they were taken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.signals.arrays import FloatArray


@dataclass(frozen=True)
class Record:
    """One step.

    Attributes:
        time_s: (n,) s after the step, rising; samples before it are negative.
        value: (n,) the quantity.
    """

    time_s: FloatArray
    value: FloatArray


@dataclass(frozen=True)
class Seen:
    """How the records were taken.

    Attributes:
        bandwidth_Hz: cut-off frequency of the sensor's filter (second order, Butterworth), whose delay at low
            frequencies is already removed from the times; None: no filter.
        time_std_s: standard uncertainty of the origin of the times, common to all records (s).
        drifts: whether the quantity drifts linearly before and after the step.
    """

    bandwidth_Hz: float | None = None
    time_std_s: float = 0.0
    drifts: bool = True


UNFILTERED = Seen()
"""Without filter, at exactly known times."""


def drift_columns(time_s: FloatArray, *, drifts: bool) -> FloatArray:
    """Columns of the line that a quantity follows before a step or long after it, (n, 2); without drift (n, 1)."""
    return np.column_stack((np.ones(len(time_s)), time_s)) if drifts else np.ones((len(time_s), 1))

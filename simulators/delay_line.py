"""A pure delay at the plant's rate: what a signal was so many seconds earlier."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
SHORT = 24
"""Number of values up to which a list is faster than an array; the results are identical."""


class DelayLine:
    """Delays a signal that comes slice by slice; before its first value it stood at that value."""

    def __init__(self, delay_s: float, dt_s: float) -> None:
        self._whole = math.floor(delay_s / dt_s)
        self._share = delay_s / dt_s - self._whole
        self._past: list[float] | None = None

    def delayed(self, signal: FloatArray) -> FloatArray:
        """The signal (n,) of `delay_s` earlier, straight between the plant's steps."""
        if not len(signal):
            return signal
        if self._past is None:
            self._past = [float(signal[0])] * (self._whole + 1)
        known, late = self._past + signal.tolist(), self._share
        self._past = known[len(signal):]
        if len(signal) > SHORT:
            values = np.array(known)
            return np.asarray((1.0 - late) * values[1:1 + len(signal)] + late * values[:len(signal)])
        rest = 1.0 - late
        return np.array([rest * known[at + 1] + late * known[at] for at in range(len(signal))])

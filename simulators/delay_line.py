"""A pure delay at the plant's rate: what a signal was so many seconds earlier."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class DelayLine:
    """Delays a signal that comes slice by slice; before its first value it stood at that value."""

    def __init__(self, delay_s: float, dt_s: float) -> None:
        self._whole = math.floor(delay_s / dt_s)
        self._share = delay_s / dt_s - self._whole
        self._past: FloatArray | None = None

    def delayed(self, signal: FloatArray) -> FloatArray:
        """The signal (n,) of `delay_s` earlier, straight between the plant's steps."""
        if not len(signal):
            return signal
        if self._past is None:
            self._past = np.full(self._whole + 1, signal[0])
        known = np.concatenate((self._past, signal))
        self._past = known[len(signal):]
        return np.asarray((1.0 - self._share) * known[1:1 + len(signal)] + self._share * known[:len(signal)])

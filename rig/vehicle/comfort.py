"""Frequency weightings of ISO 2631-1:1997, and the weighted RMS of an acceleration.

The weightings are the products of their transfer functions in annex A of the standard: band limitation by second-order
Butterworth filters, acceleration-velocity transition, upward step. Applied to the spectrum of a whole record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rig.dampers.arrays import ComplexArray, FloatArray

BUTTERWORTH = 1.0 / math.sqrt(2.0)


@dataclass(frozen=True)
class Weighting:
    """Corner frequencies (Hz) and resonant quality factors of one weighting; infinite: that part is not there."""

    f1: float
    f2: float
    f3: float
    f4: float
    Q4: float
    f5: float = math.inf
    Q5: float = 1.0
    f6: float = math.inf
    Q6: float = 1.0

    def gain(self, frequency_Hz: FloatArray) -> ComplexArray:
        """Complex gain at these frequencies, of the same shape; 0 at 0 Hz."""
        moving = frequency_Hz > 0.0
        p = np.asarray(2j * np.pi * frequency_Hz[moving], np.complex128)
        total: ComplexArray = 1.0 / (1.0 + _second_order(self.f1, BUTTERWORTH, p, below=True))
        total = total / (1.0 + _second_order(self.f2, BUTTERWORTH, p))
        w3, w4 = 2.0 * math.pi * self.f3, 2.0 * math.pi * self.f4
        total = total * (1.0 + p / w3) / (1.0 + p / (self.Q4 * w4) + (p / w4) ** 2)
        if math.isfinite(self.f5):
            rising = 1.0 + _second_order(self.f5, self.Q5, p)
            total = total * rising / (1.0 + _second_order(self.f6, self.Q6, p)) * (self.f5 / self.f6) ** 2
        gains = np.zeros(frequency_Hz.shape, np.complex128)
        gains[moving] = total
        return gains


def _second_order(
    corner_Hz: float, quality: float, p: ComplexArray, *, below: bool = False
) -> ComplexArray:
    """The first and second power of a second-order polynomial in p / w, or in w / p."""
    w = 2.0 * math.pi * corner_Hz
    ratio = w / p if below else p / w
    terms: ComplexArray = ratio / quality + ratio**2
    return terms


WEIGHTINGS = {
    "Wk": Weighting(0.4, 100.0, 12.5, 12.5, 0.63, 2.37, 0.91, 3.35, 0.91),
    "Wd": Weighting(0.4, 100.0, 2.0, 2.0, 0.63),
    "We": Weighting(0.4, 100.0, 1.0, 1.0, 0.63),
}
"""Vertical, horizontal, and rotation at a seat."""

OF_MOTION = {"heave": "Wk", "pitch": "We", "roll": "We"}


def weighted_rms(acceleration: FloatArray, step_s: float, name: str) -> float:
    """Weighted RMS of an acceleration (k,) sampled every `step_s`, in its own unit (m/s^2, rad/s^2).

    Raises:
        KeyError: no weighting of that name.
        ValueError: fewer than two samples.
    """
    if len(acceleration) < 2:
        raise ValueError(f"got {len(acceleration)} acceleration samples, expected at least two")
    frequency_Hz = np.asarray(np.fft.rfftfreq(len(acceleration), step_s), np.float64)
    spectrum: ComplexArray = np.fft.rfft(acceleration)
    weighted = np.fft.irfft(spectrum * WEIGHTINGS[name].gain(frequency_Hz), len(acceleration))
    return float(np.sqrt(np.mean(weighted**2)))

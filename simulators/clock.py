"""The clocks of the simulated rig: each device's own, and the wall as a device that is never descheduled sees it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

U32 = 1 << 32
FloatArray = NDArray[np.float64]
LARGEST_PPM = 50.0
LONGEST_STALL_S = 0.020


class DeviceClock:
    """A free-running microsecond counter: `device = offset + (1 + ppm 1e-6) simulated`.

    Attributes:
        offset_us: reading at simulated time 0 (us).
        ppm: rate error (parts per million); positive runs fast.
    """

    def __init__(self, offset_us: float, ppm: float) -> None:
        self.offset_us = float(offset_us)  # compiled loops are compiled again for an integer
        self.ppm = ppm

    @classmethod
    def drawn(cls, offset_us: float, ppm: float, random: np.random.Generator) -> DeviceClock:
        """A clock with what is given, and what is NaN drawn: offset over the counter's range, rate within +-50 ppm."""
        drawn_offset, drawn_ppm = random.uniform(0.0, U32), random.uniform(-LARGEST_PPM, LARGEST_PPM)
        return cls(drawn_offset if math.isnan(offset_us) else offset_us, drawn_ppm if math.isnan(ppm) else ppm)

    def drift(self, ppm: float, time_s: float) -> None:
        """Change the rate at simulated time `time_s` (s) without a step in the reading."""
        self.offset_us += (self.ppm - ppm) * time_s
        self.ppm = ppm

    def unwrapped_us(self, time_s: float) -> float:
        """Reading at simulated time `time_s` (s), not wrapped (us)."""
        return self.offset_us + (1e6 + self.ppm) * time_s

    def wrapped_us(self, time_s: float) -> int:
        """Reading at simulated time `time_s` (s) as the device sends it: whole microseconds modulo 2^32."""
        return math.floor(self.unwrapped_us(time_s)) % U32

    def time_s(self, device_us: FloatArray) -> FloatArray:
        """Simulated times (s) of unwrapped readings (us); any shape."""
        return (device_us - self.offset_us) / (1e6 + self.ppm)


class ServedTime:
    """Wall time for watchdogs, without the stretches in which this process was not running.

    A controller on its own processor never misses that its master is alive because it was descheduled itself; a
    process on a loaded machine would. Each tick counts at most `LONGEST_STALL_S`.
    """

    def __init__(self) -> None:
        self.now_s = 0.0
        self._last_ns = -1

    def tick(self, monotonic_ns: int) -> float:
        """Count the time since the last tick; returns the served time (s)."""
        if self._last_ns >= 0:
            self.now_s += min((monotonic_ns - self._last_ns) * 1e-9, LONGEST_STALL_S)
        self._last_ns = monotonic_ns
        return self.now_s

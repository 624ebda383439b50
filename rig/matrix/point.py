"""One test point: what the machine is asked to do, as a value (PHYSICS: waveforms (1) and (2))."""

from __future__ import annotations

import math
from dataclasses import dataclass

CORNER_SHARE = 0.05
"""A triangle's corner is rounded by the controller; it still counts as a triangle if that takes <= 1/20 period."""


@dataclass(frozen=True)
class TestPoint:
    """A waveform about a centre at a constant coil current.

    `cycles` are at full amplitude; the ramps come beside them. `repeat` counts from 1.
    """

    __test__ = False  # not a test class, whatever its name

    id: str
    waveform: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    cycles: int = 10
    ramp_in_cycles: float = 1.0
    ramp_out_cycles: float = 1.0
    centre_m: float = 0.0
    repeat: int = 1
    rest_s: float = 0.0

    @property
    def peak_speed_m_s(self) -> float:
        """Largest speed (m/s): 2 pi f A of a sine (1), 4 f A of a triangle (2)."""
        if self.waveform == "triangle":
            return 4.0 * self.frequency_Hz * self.amplitude_m
        return math.tau * self.frequency_Hz * self.amplitude_m

    @property
    def peak_acceleration_m_s2(self) -> float:
        """Largest acceleration (m/s2): (2 pi f)^2 A of a sine.

        Of a triangle, the speed step 8 f A of a corner spread over `CORNER_SHARE` of a period: 160 f^2 A.
        """
        if self.waveform == "triangle":
            return 8.0 * self.frequency_Hz**2 * self.amplitude_m / CORNER_SHARE
        return (math.tau * self.frequency_Hz) ** 2 * self.amplitude_m

    @property
    def motion_s(self) -> float:
        """Duration of the programme, ramps included (s)."""
        return (self.ramp_in_cycles + self.cycles + self.ramp_out_cycles) / self.frequency_Hz

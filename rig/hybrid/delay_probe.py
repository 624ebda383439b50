"""The small sine that measures the delay of the actuator behind its set-points; pure numbers, no numpy."""

from __future__ import annotations

import math
from dataclasses import dataclass

PROBE_RAMP_CYCLES = 1.0
LEAST_SHARE = 0.3
"""Of the amplitude: a rod that moves less was not moved by the sine."""


@dataclass(frozen=True)
class Probe:
    """The small motion by which the delay is measured, m and Hz; `cycles` at full amplitude."""

    amplitude_m: float
    frequency_Hz: float
    cycles: int = 6

    @property
    def duration_s(self) -> float:
        """With ramps, s."""
        return (self.cycles + 2.0 * PROBE_RAMP_CYCLES) / self.frequency_Hz

    def at(self, t_s: float) -> tuple[float, float, float]:
        """Position (m), speed (m/s) and share of the full amplitude at a time."""
        phase = t_s * self.frequency_Hz
        left = self.cycles + 2.0 * PROBE_RAMP_CYCLES - phase
        share = max(0.0, min(1.0, phase / PROBE_RAMP_CYCLES, left / PROBE_RAMP_CYCLES))
        angle, rate = 2.0 * math.pi * phase, 2.0 * math.pi * self.frequency_Hz
        slope = 0.0 if share == 1.0 else math.copysign(self.frequency_Hz / PROBE_RAMP_CYCLES, left - phase)
        value = self.amplitude_m * math.sin(angle)
        return share * value, self.amplitude_m * rate * share * math.cos(angle) + slope * value, share


class DelayMeasurement:
    """By how much a sine is behind its set-points: by the phase of its fundamental over the full cycles."""

    def __init__(self, probe: Probe) -> None:
        self._probe = probe
        self._sums = [0.0] * 3
        self._count = 0

    def add(self, t_s: float, extension_m: float, share: float) -> None:
        """Where the rod was; only what is at full amplitude counts."""
        if share < 1.0 or not math.isfinite(extension_m):
            return
        angle = 2.0 * math.pi * self._probe.frequency_Hz * t_s
        self._count += 1
        for place, value in enumerate((extension_m * math.sin(angle), extension_m * math.cos(angle), extension_m)):
            self._sums[place] += value

    @property
    def delay_s(self) -> float:
        """The delay, s; NaN where the rod hardly moved."""
        in_phase, quadrature, _ = self._sums
        least = LEAST_SHARE * self._probe.amplitude_m * 0.5 * self._count
        if self._count == 0 or math.hypot(in_phase, quadrature) < least:
            return math.nan
        return math.atan2(-quadrature, in_phase) / (2.0 * math.pi * self._probe.frequency_Hz)

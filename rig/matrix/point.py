"""One test point: what the machine is asked to do, as a value (PHYSICS: waveforms (1) and (2))."""

from __future__ import annotations

import math
from dataclasses import dataclass

CORNER_SHARE = 0.05
"""A triangle's corner is rounded by the controller; it still counts as a triangle if that takes <= 1/20 period."""


@dataclass(frozen=True)
class TestPoint:
    """A waveform about a centre at a constant coil current, or currents that step while the rod stands.

    `cycles` are at full amplitude; the ramps come beside them. `repeat` counts from 1. `kind` is `loop`, `friction`
    (a slow triangle without current, for gas force and friction) or `current_step`: then `waveform` is `hold`, the
    amplitude 0, a cycle one step, `steps_A` the currents in turn and `current_A` the largest of them.
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
    kind: str = "loop"
    steps_A: tuple[float, ...] = ()

    @property
    def first_current_A(self) -> float:
        """The current that must have settled before the point begins (A)."""
        return self.steps_A[0] if self.steps_A else self.current_A

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

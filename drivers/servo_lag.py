"""By how much a rod is behind its set-points, learned while it follows: from where the rod is to what it follows."""

from __future__ import annotations

import math

from drivers.setpoint_generator import Setpoint

LONGEST_S = 0.03
KEPT = 0.98
"""Of what was learned, with every new set-point."""
LEAST_M2_S2 = 1e-3
"""Sum of squared speeds from which on the lag is known."""


class ServoLag:
    """The time by which the rod follows its set-points; 0 until the rod has moved.

    Attributes:
        lag_s: as learned so far.
    """

    def __init__(self) -> None:
        self.lag_s = 0.0
        self._behind = 0.0
        self._speeds = 0.0

    def add(self, sent: Setpoint, position_m: float) -> None:
        """The rod was here (m) when it was sent this set-point; NaN teaches nothing."""
        behind = (sent.position_m - position_m) * sent.velocity_m_s
        if math.isnan(behind):
            return
        self._behind = KEPT * self._behind + behind
        self._speeds = KEPT * self._speeds + sent.velocity_m_s**2
        if self._speeds > LEAST_M2_S2:
            self.lag_s = min(LONGEST_S, max(0.0, self._behind / self._speeds))

    def setpoint_of(self, position_m: float, velocity_m_s: float) -> Setpoint:
        """The set-point that a rod follows which is here (m), at this speed (m/s), and does not accelerate."""
        return Setpoint(position_m + self.lag_s * velocity_m_s, velocity_m_s)

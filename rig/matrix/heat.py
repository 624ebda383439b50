"""How a damper warms and cools: one heat capacity, one loss to ambient (PHYSICS section 11), solved exactly.

`C T' = P - h (T - Ta)`, so that T goes to `Ta + P/h` with the time constant `C/h`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class HeatModel:
    """Heat capacity C, loss h, ambient Ta."""

    capacity_J_K: float = 1500.0
    loss_W_K: float = 5.0
    ambient_degC: float = 23.0

    def after(self, start_degC: float, power_W: float, duration_s: float) -> float:
        """Temperature (degC) after `duration_s` seconds under constant power (W)."""
        final_degC = self.ambient_degC + power_W / self.loss_W_K
        return final_degC + (start_degC - final_degC) * math.exp(-duration_s * self.loss_W_K / self.capacity_J_K)

    def time_to(self, target_degC: float, start_degC: float, power_W: float = 0.0) -> float:
        """Seconds under constant power until the target is reached from `start_degC`; inf when it never is."""
        final_degC = self.ambient_degC + power_W / self.loss_W_K
        share = (start_degC - final_degC) / (target_degC - final_degC) if target_degC != final_degC else math.inf
        if start_degC == target_degC:
            return 0.0
        if not 1.0 <= share < math.inf:
            return math.inf
        return math.log(share) * self.capacity_J_K / self.loss_W_K

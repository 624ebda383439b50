"""Gas force and friction from a slow triangle without current.

The force up and the force down at the same place, near mid-stroke: half their sum is what the damper pushes with at
rest (gas, and what stands beside it), half their difference is what resists motion at that low speed: friction, and
the viscous rest, which is said with its speed. No model is involved: the tanh models are not physical near rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.characteristics.loop import Measured, over_cycles
from rig.errors import IdentificationFailed
from rig.recording.cycles import find_cycles, full_cycles
from rig.recording.run import RecordedPoint

MIDDLE = 0.5
"""Share of the amplitude about the mean position in which the force is taken: away from the reversals."""
FEWEST_SAMPLES = 10


@dataclass(frozen=True)
class FrictionTest:
    """What one slow test shows.

    Attributes:
        id: of the point.
        speed_m_s: mean measured speed between the reversals, m/s.
        gas_force_N: half the sum of the forces up and down about mid-stroke, N, positive when it pulls the rod in.
        friction_N: half their difference, N.
        stiffness_N_m: slope of the mean force over displacement (a gas spring's), N/m.
    """

    id: str
    speed_m_s: float
    gas_force_N: Measured
    friction_N: Measured
    stiffness_N_m: Measured

    def to_json(self) -> dict[str, Any]:
        """Every attribute; measured ones as objects."""
        return {name: each.to_json() if isinstance(each, Measured) else each for name, each in vars(self).items()}


def friction_of(point: RecordedPoint) -> FrictionTest:
    """Evaluate a friction point.

    Raises:
        NoCycles: there is no whole cycle.
        IdentificationFailed: too few samples between the reversals.
    """
    cycles = full_cycles(find_cycles(point.time_s, point.displacement_m))
    half_m = MIDDLE * float(np.median(cycles.amplitude_m))
    gas, friction, stiffness, speeds = [], [], [], []
    for start_s, stop_s in zip(cycles.start_s, cycles.start_s[1:], strict=False):
        inside = (point.time_s >= start_s) & (point.time_s < stop_s)
        u = point.displacement_m[inside] - cycles.mean_m
        v, force = point.velocity_m_s[inside], point.force_N[inside]
        good = (np.abs(u) <= half_m) & np.isfinite(force) & np.isfinite(v)
        up, down = good & (v > 0.0), good & (v < 0.0)
        if min(np.count_nonzero(up), np.count_nonzero(down)) < FEWEST_SAMPLES:
            raise IdentificationFailed(f"{point.id}: fewer than {FEWEST_SAMPLES} samples between the reversals")
        rising, falling = np.polyfit(u[up], force[up], 1), np.polyfit(u[down], force[down], 1)
        gas.append(0.5 * float(rising[1] + falling[1]))
        friction.append(0.5 * float(rising[1] - falling[1]))
        stiffness.append(0.5 * float(rising[0] + falling[0]))
        speeds.append(0.5 * float(np.mean(v[up]) - np.mean(v[down])))
    speed_m_s = float(np.mean(speeds)) if speeds else math.nan
    return FrictionTest(point.id, speed_m_s, over_cycles(gas), over_cycles(friction), over_cycles(stiffness))

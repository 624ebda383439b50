"""Gas force and friction from a slow triangle without current.

The force up and the force down at the same place, near mid-stroke (which is which says the cycle's own way from its top
to its bottom, not the sign of a velocity that noise turns round): half their sum is what the damper pushes with at
rest (gas, and what stands beside it), half their difference is what resists motion at that low speed: friction, and
the viscous rest, which is said with its speed. No model is involved: the tanh models are not physical near rest.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from rig.characteristics.loop import Measured, over_cycles
from rig.errors import IdentificationFailed
from rig.recording.recorded_point import RecordedPoint
from rig.signals.arrays import FloatArray
from rig.signals.cycles import find_cycles, full_cycles

MIDDLE = 0.5
"""Share of the amplitude about the mean position in which the force is taken: away from the reversals."""
FEWEST_SAMPLES = 10


@dataclass(frozen=True)
class FrictionTest:
    """What one slow test shows.

    Attributes:
        id: of the point.
        speed_m_s: mean slope of the measured flanks between the reversals, m/s.
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
    for start_s, stop_s in itertools.pairwise(cycles.start_s):
        inside = (point.time_s >= start_s) & (point.time_s < stop_s)
        t, u, force = point.time_s[inside], point.displacement_m[inside] - cycles.mean_m, point.force_N[inside]
        top_s, bottom_s = _reversals(t, u, half_m)
        good = (np.abs(u) <= half_m) & np.isfinite(force)
        falling = (t > top_s) & (t < bottom_s)
        up, down = good & ~falling, good & falling
        if min(np.count_nonzero(up), np.count_nonzero(down)) < FEWEST_SAMPLES:
            raise IdentificationFailed(f"{point.id}: fewer than {FEWEST_SAMPLES} samples between the reversals")
        # The rise after the bottom belongs before the one that the cycle begins in the middle of: one straight flank.
        flank_s = np.where(t >= bottom_s, t - (stop_s - start_s), t) - start_s
        extending, compressing = (np.polyfit(u[part], force[part], 1) for part in (up, down))
        gas.append(0.5 * float(extending[1] + compressing[1]))
        friction.append(0.5 * float(extending[1] - compressing[1]))
        stiffness.append(0.5 * float(extending[0] + compressing[0]))
        rise, fall = (float(np.polyfit(flank_s[part], u[part], 1)[0]) for part in (up, down))
        speeds.append(0.5 * (rise - fall))
    speed_m_s = float(np.mean(speeds)) if speeds else math.nan
    return FrictionTest(point.id, speed_m_s, over_cycles(gas), over_cycles(friction), over_cycles(stiffness))


def _reversals(t: FloatArray, u: FloatArray, beyond_m: float) -> tuple[float, float]:
    """When a cycle turns at its top and at its bottom (s): the middle of the times spent beyond `beyond_m`.

    The noise of a single sample, whose derivative grows with the sampling rate, has no say in the direction.

    Raises:
        IdentificationFailed: no sample lies beyond.
    """
    above, below = t[u > beyond_m], t[u < -beyond_m]
    if above.size == 0 or below.size == 0:
        raise IdentificationFailed("a cycle of the friction test has no samples near its reversals")
    return float(np.mean(above)), float(np.mean(below))

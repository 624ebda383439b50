"""The damper's 0 A signature (fault row `wrong-damper`), from the slow proof move before the matrix.

Its mean is gas force and offset, its swing friction and oil at that speed. It must not be stronger than the specimen's
prior allows, because the plan relies on that, and in a resumed campaign it must be the signature of the first session.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np

from rig.campaign.cause import Cause
from rig.matrix.model import Specimen
from rig.signals.arrays import FloatArray

FEWEST_SAMPLES = 5
STEPS_A_CYCLE = 400
STRONGER_SHARE, STRONGER_N = 0.4, 30.0
"""How much stronger than its prior a damper may be: priors are rough, but the plan relies on them."""
MEAN_SHARE, MEAN_N = 0.15, 25.0
SWING_SHARE, SWING_N = 0.35, 20.0
"""How far a signature may be from the first session's: gas force and oil follow the temperature."""


@dataclass(frozen=True)
class Signature:
    """Mean of the forces on the way up and down, and half of their difference, N."""

    mean_N: float
    swing_N: float

    @property
    def peak_N(self) -> float:
        """Mean and swing together (N), without sign."""
        return abs(self.mean_N) + self.swing_N

    def __str__(self) -> str:
        return f"{self.mean_N:.0f} N ± {self.swing_N:.0f} N"

    def to_json(self) -> dict[str, float]:
        """Its fields by name."""
        return asdict(self)

    @classmethod
    def from_json(cls, entry: Mapping[str, float]) -> Signature:
        """From `to_json`.

        Raises:
            KeyError: a field is missing.
        """
        return cls(float(entry["mean_N"]), float(entry["swing_N"]))


def expected_signature(specimen: Specimen, amplitude_m: float, speed_m_s: float) -> Signature | None:
    """What the specimen's prior predicts for a slow move there and back; None without a prior.

    Args:
        specimen: the damper as the matrix describes it.
        amplitude_m: half of the move's way (m).
        speed_m_s: its speed (m/s).
    """
    if specimen.prior is None:
        return None
    from rig.dampers import model, parameter_set

    prior = parameter_set(specimen.prior)
    damper = model(prior.model, "printed" if prior.hysteresis == "printed" else "kwok")
    # Two cycles; the second counts, because models with memory start at rest.
    dt_s = 4.0 * amplitude_m / speed_m_s / STEPS_A_CYCLE
    quarter = np.arange(2 * STEPS_A_CYCLE) % STEPS_A_CYCLE / STEPS_A_CYCLE
    v = np.where((quarter < 0.25) | (quarter >= 0.75), speed_m_s, -speed_m_s)
    force_N = damper.force(prior.values, np.cumsum(v) * dt_s, v, np.zeros_like(v), 0.0, dt_s)[STEPS_A_CYCLE:]
    upwards = v[STEPS_A_CYCLE:] > 0.0
    return measured_signature(np.asarray(force_N[upwards]), np.asarray(force_N[~upwards]))


def measured_signature(up_N: FloatArray, down_N: FloatArray) -> Signature | None:
    """The signature of a slow move; None with too few samples.

    Args:
        up_N: force on the way up, (n,) N.
        down_N: force on the way down, (m,) N.
    """
    if min(len(up_N), len(down_N)) < FEWEST_SAMPLES:
        return None
    up, down = float(np.median(up_N)), float(np.median(down_N))
    return Signature(0.5 * (up + down), 0.5 * abs(up - down))


def judge_damper(found: Signature | None, expected: Signature | None, first: Signature | None) -> Cause | None:
    """Whether the damper is the campaign's; None when it is.

    Args:
        found: its signature now; None when there was none to be measured.
        expected: what its prior predicts; None without a prior.
        first: the signature of the campaign's first session; None in the first.
    """
    if found is None or not (math.isfinite(found.mean_N) and math.isfinite(found.swing_N)):
        return Cause("wrong-damper", "its 0 A signature could not be measured")
    if first is not None:
        mean_off = abs(found.mean_N - first.mean_N) > MEAN_SHARE * abs(first.mean_N) + MEAN_N
        swing_off = abs(found.swing_N - first.swing_N) > SWING_SHARE * first.swing_N + SWING_N
        if mean_off or swing_off:
            return Cause("wrong-damper", f"0 A signature {found}, in the campaign's first session {first}")
    if expected is not None and found.peak_N > (1.0 + STRONGER_SHARE) * expected.peak_N + STRONGER_N:
        return Cause(
            "wrong-damper",
            f"0 A signature {found}, the prior predicts {expected}: the plan does not hold for this damper; mount the "
            "right one, or correct the specimen's prior",
        )
    return None


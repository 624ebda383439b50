"""The damper's 0 A signature (fault row `wrong-damper`): one slow, small sine at 0 A before the matrix.

Its mean is gas force and offset, its swing friction and oil. It must not be stronger than the specimen's prior allows,
because the plan relies on that, and in a resumed campaign it must be the signature of the first session.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from rig.campaign.cause import Cause
from rig.matrix.model import Specimen
from rig.matrix.point import TestPoint

FloatArray = NDArray[np.float64]

LARGEST_AMPLITUDE_M = 5e-3
FREQUENCY_HZ = 1.0
SLOWEST_HZ = 0.1
CYCLES = 2
FEWEST_SAMPLES = 50
MOVED_SHARE = 0.1
AT_REST = 5
"""So many samples at least come before the slow ramp of the move can be told from rest."""
STRONGER_SHARE, STRONGER_N = 0.4, 30.0
"""How much stronger than its prior a damper may be: priors are rough, but the plan relies on them."""
MEAN_SHARE, MEAN_N = 0.15, 25.0
SWING_SHARE, SWING_N = 0.35, 20.0
"""How far a signature may be from the first session's: gas force and oil follow the temperature."""


@dataclass(frozen=True)
class Signature:
    """Mean force and swing (square root of two times the standard deviation) of the move, N."""

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


def signature_point(points: tuple[TestPoint, ...]) -> TestPoint:
    """The move of a campaign: no larger and no faster than the gentlest of its points.

    Args:
        points: the campaign's points; at least one.
    """
    amplitude_m = min(LARGEST_AMPLITUDE_M, *(point.amplitude_m for point in points))
    slowest_m_s = min(point.peak_speed_m_s for point in points)
    frequency_Hz = min(FREQUENCY_HZ, max(SLOWEST_HZ, slowest_m_s / (math.tau * amplitude_m)))
    return TestPoint("signature", "sine", amplitude_m, frequency_Hz, 0.0, cycles=CYCLES, centre_m=points[0].centre_m)


def expected_signature(specimen: Specimen, point: TestPoint) -> Signature | None:
    """What the specimen's prior predicts; None without a prior."""
    if specimen.prior is None:
        return None
    from rig.dampers import model, parameter_set

    prior = parameter_set(specimen.prior)
    damper = model(prior.model, "printed" if prior.hysteresis == "printed" else "kwok")
    steps = 400
    phase = math.tau * (np.arange(2 * steps) + 0.5) / steps
    omega = math.tau * point.frequency_Hz
    u = point.amplitude_m * np.sin(phase)
    v = omega * point.amplitude_m * np.cos(phase)
    # Models with memory start at rest: the second cycle counts.
    force_N = damper.force(prior.values, u, v, -omega * omega * u, 0.0, 1.0 / (point.frequency_Hz * steps))[steps:]
    return _signature(np.asarray(force_N, np.float64))


def measured_signature(force_N: FloatArray, displacement_m: FloatArray, point: TestPoint) -> Signature | None:
    """The signature over the cycles at full amplitude; None when these samples show no such move.

    Args:
        force_N: load cell, (n,) N, evenly spaced, from before the move until after it.
        displacement_m: LVDT, (m,) m, likewise.
        point: the move that was commanded.
    """
    if min(len(force_N), len(displacement_m)) < FEWEST_SAMPLES:
        return None
    away = np.abs(displacement_m - float(np.median(displacement_m[:AT_REST])))
    moving = np.flatnonzero(away > MOVED_SHARE * point.amplitude_m)
    if len(moving) < FEWEST_SAMPLES:
        return None
    first, last = moving[0] / len(away), (moving[-1] + 1) / len(away)
    # The ramps take one cycle each.
    ramp = (last - first) / (CYCLES + 2.0)
    return _signature(force_N[round((first + ramp) * len(force_N)) : round((last - ramp) * len(force_N))])


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


def _signature(samples: FloatArray) -> Signature:
    return Signature(float(np.mean(samples)), math.sqrt(2.0) * float(np.std(samples)))

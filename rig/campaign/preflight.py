"""What a resting rig must show before anything moves (fault row `not-tared`): values in, verdict out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.campaign.cause import Cause

FEWEST_SAMPLES = 10
REST_FORCE_SHARE = 0.20
REST_FORCE_NOISE_SHARE = 0.02
REST_DISPLACEMENT_NOISE_M = 0.5e-3


@dataclass(frozen=True)
class RestLimits:
    """What is compared with what.

    Attributes:
        force_N: the bench's force limit; a damper at rest shows its gas force, not more than a fifth of this.
        position_min_m: lower stroke limit (m).
        position_max_m: upper stroke limit (m).
        disagreement_m: how far host LVDT and controller position may be apart (m).
    """

    force_N: float
    position_min_m: float
    position_max_m: float
    disagreement_m: float


def judge_rest(
    force_N: NDArray[np.float64],
    displacement_m: NDArray[np.float64],
    position_m: NDArray[np.float64],
    limits: RestLimits,
) -> Cause | None:
    """The first thing that does not look like a tared rig at rest; None when all is well.

    Args:
        force_N: load-cell samples of the rest window, (n,), N.
        displacement_m: LVDT samples of the rest window, (m,), m.
        position_m: the controller's own position in the rest window, (k,), m.
        limits: the bench's limits.
    """
    for name, samples, fewest in (
        ("load cell", force_N, FEWEST_SAMPLES),
        ("LVDT", displacement_m, FEWEST_SAMPLES),
        ("controller position", position_m, 1),
    ):
        if len(samples) < fewest or not np.all(np.isfinite(samples)):
            return Cause("not-tared", f"{name}: {len(samples)} samples at rest, expected {fewest} or more, all finite")
    found = (
        _over("load cell at rest", abs(float(np.mean(force_N))), REST_FORCE_SHARE * limits.force_N, "N"),
        _over("load cell's noise at rest", float(np.std(force_N)), REST_FORCE_NOISE_SHARE * limits.force_N, "N"),
        _over("LVDT's noise at rest", 1e3 * float(np.std(displacement_m)), 1e3 * REST_DISPLACEMENT_NOISE_M, "mm"),
        _over(
            "LVDT against controller position",
            1e3 * abs(float(np.mean(displacement_m) - np.mean(position_m))),
            1e3 * limits.disagreement_m,
            "mm",
        ),
        _outside(float(np.mean(displacement_m)), limits),
    )
    return next((cause for cause in found if cause is not None), None)


def _over(what: str, value: float, limit: float, unit: str) -> Cause | None:
    if value <= limit:
        return None
    return Cause("not-tared", f"{what}: {value:.3g} {unit}, allowed {limit:.3g} {unit}; tare it or check its cable")


def _outside(mean_m: float, limits: RestLimits) -> Cause | None:
    if limits.position_min_m <= mean_m <= limits.position_max_m:
        return None
    allowed = f"{1e3 * limits.position_min_m:g}..{1e3 * limits.position_max_m:g} mm"
    return Cause(
        "not-tared", f"LVDT at rest: {1e3 * mean_m:.3g} mm, allowed {allowed}; move the rod by hand or tare it"
    )

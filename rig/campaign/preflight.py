"""What a resting rig must show before it is armed (rows `not-tared`, `sensors-swapped`): values in, verdict out."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.campaign.cause import Cause

FEWEST_SAMPLES = 10
REST_FORCE_SHARE = 0.20
REST_FORCE_NOISE_SHARE = 0.02
REST_DISPLACEMENT_NOISE_M = 0.5e-3
MIRRORED_SHARE = 0.05
FORCE_DISAGREEMENT_SHARE = 0.02
"""Of the load cell's range: host load cell and the controller's own coarse force input at rest."""


@dataclass(frozen=True)
class RestLimits:
    """What is compared with what.

    Attributes:
        force_N: the bench's force limit; a damper at rest shows its gas force, not more than a fifth of this.
        position_min_m: lower stroke limit (m).
        position_max_m: upper stroke limit (m).
        disagreement_m: how far host LVDT and controller position may be apart (m).
        range_N: the load cell's range.
        force_per_wire, displacement_per_wire: SI units per unit on the wire of load cell (N) and LVDT (m).
        force_offset_N, displacement_offset_m: what they show at zero.
    """

    force_N: float
    position_min_m: float
    position_max_m: float
    disagreement_m: float
    range_N: float
    force_per_wire: float = 1.0
    displacement_per_wire: float = 1e-3
    force_offset_N: float = 0.0
    displacement_offset_m: float = 0.0


@dataclass(frozen=True)
class AtRest:
    """Samples of the rest window.

    Attributes:
        force_N: of the load cell, (n,).
        displacement_m: of the LVDT, (m,).
        position_m: the controller's own position, (k,).
        controller_force_N: the controller's own coarse force input, (k,).
        force_flagged, displacement_flagged: how many samples the sensor itself says are overloaded, faulty or none.
    """

    force_N: NDArray[np.float64]
    displacement_m: NDArray[np.float64]
    position_m: NDArray[np.float64]
    controller_force_N: NDArray[np.float64]
    force_flagged: int = 0
    displacement_flagged: int = 0

    def exchanged(self, limits: RestLimits) -> AtRest:
        """What the same bytes mean when each port carries the other sensor."""
        force_wire = (self.force_N + limits.force_offset_N) / limits.force_per_wire
        displacement_wire = (self.displacement_m + limits.displacement_offset_m) / limits.displacement_per_wire
        return AtRest(
            displacement_wire * limits.force_per_wire - limits.force_offset_N,
            force_wire * limits.displacement_per_wire - limits.displacement_offset_m,
            self.position_m,
            self.controller_force_N,
        )


def judge_rest(seen: AtRest, limits: RestLimits) -> Cause | None:
    """The first thing that does not look like a tared rig at rest; None when all is well.

    Args:
        seen: the samples of the rest window.
        limits: the bench's limits.
    """
    for name, samples, fewest in (
        ("load cell", seen.force_N, FEWEST_SAMPLES),
        ("LVDT", seen.displacement_m, FEWEST_SAMPLES),
        ("controller position", seen.position_m, 1),
        ("controller force", seen.controller_force_N, 1),
    ):
        if len(samples) < fewest or not np.all(np.isfinite(samples)):
            return Cause("not-tared", f"{name}: {len(samples)} samples at rest, expected {fewest} or more, all finite")
    for name, flagged in (("load cell", seen.force_flagged), ("LVDT", seen.displacement_flagged)):
        if flagged:
            told = "samples at rest with the sensor's own overload or fault flag, expected none; check it and its cable"
            return Cause("not-tared", f"{name}: {flagged} {told}")
    cause = _first(seen, limits)
    if cause is None:
        return None
    for what, explained in (
        ("load cell and LVDT are exchanged: swap their plugs", _first(seen.exchanged(limits), limits) is None),
        (
            "the load cell's sign is wrong",
            _mirrored(seen.force_N, seen.controller_force_N, FORCE_DISAGREEMENT_SHARE * limits.range_N),
        ),
        ("the LVDT's sign is wrong", _mirrored(seen.displacement_m, seen.position_m, limits.disagreement_m)),
    ):
        if explained:
            return Cause("sensors-swapped", f"{cause.detail.partition(';')[0]}; {what}")
    return cause


def _mirrored(shown: NDArray[np.float64], expected: NDArray[np.float64], allowed: float) -> bool:
    """Whether more is apart than allowed, and the other sign would explain nearly all of it.

    What it explains less of may be a zero that was not taken; near zero, noise alone has either sign.
    """
    apart, mirrored = float(np.mean(shown) - np.mean(expected)), float(-np.mean(shown) - np.mean(expected))
    return abs(apart) > allowed and abs(mirrored) < MIRRORED_SHARE * abs(apart)


def _first(seen: AtRest, limits: RestLimits) -> Cause | None:
    force_N, displacement_m, position_m = seen.force_N, seen.displacement_m, seen.position_m
    found = (
        _over("load cell at rest", abs(float(np.mean(force_N))), REST_FORCE_SHARE * limits.force_N, "N"),
        _over(
            "load cell against the controller's force",
            abs(float(np.mean(force_N) - np.mean(seen.controller_force_N))),
            FORCE_DISAGREEMENT_SHARE * limits.range_N,
            "N",
        ),
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

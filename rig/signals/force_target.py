"""A force history that a signal is to follow, and the inverse of the expected damper with which it becomes a motion."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from rig.signals.arrays import FloatArray


@dataclass(frozen=True)
class SpeedOfForce:
    """Speed of the expected damper as a function of its force at a constant current.

    Attributes:
        force_N: (k,), rising.
        speed_m_s: (k,), rising.
    """

    force_N: FloatArray = field(repr=False, compare=False)
    speed_m_s: FloatArray = field(repr=False, compare=False)

    def speed(self, force_N: FloatArray) -> FloatArray:
        """Speed (m/s) at which the damper has these forces (n,); the last known speed beyond them."""
        return np.asarray(np.interp(force_N, self.force_N, self.speed_m_s), np.float64)

    @property
    def reach_N(self) -> tuple[float, float]:
        """Lowest and highest known force (N)."""
        return float(self.force_N[0]), float(self.force_N[-1])


@dataclass(frozen=True)
class ForceTarget:
    """The force that a signal is to follow, about a mean that a motion without drift can have.

    Attributes:
        mark: SHA-256 (hex) of the force.
        lowest_Hz: slower changes of the equivalent motion are removed (Hz).
        highest_Hz: faster changes of the equivalent motion are removed (Hz); None: none.
        offset_N: what was subtracted from the file's force, so that the motion does not drift (N).
        force_N: (n,) every `STEP_S`, as the samples of the record.
        inverse: of the expected damper.
        forecast_error: RMS deviation of the expected damper's force from this target in the target's motion, means
            removed, relative to the RMS of the target about its mean; NaN: not known.
    """

    mark: str
    lowest_Hz: float
    highest_Hz: float | None
    offset_N: float = field(compare=False)
    force_N: FloatArray = field(repr=False, compare=False)
    inverse: SpeedOfForce = field(repr=False, compare=False)
    forecast_error: float = field(default=float("nan"), compare=False)

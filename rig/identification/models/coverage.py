"""What tests covered, and in what another test lies beyond them: predicting it is extrapolation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.covered import SHARE, Covered, Ends
from rig.identification.models.measurement import Measurement

NEAR = 0.1
"""Share of a range by which a test may pass its ends and still be predicted rather than extrapolated."""


def covered_by(tests: Sequence[Measurement]) -> Covered:
    """Lowest and highest displacement, velocity, current and recorded temperature of tests, one at least."""
    motion = (_widest(pairs) for pairs in zip(*(test.reaches for test in tests), strict=True))
    displacement_m, velocity_m_s, current_A = motion
    return Covered(
        displacement_m=displacement_m,
        velocity_m_s=velocity_m_s,
        current_A=current_A,
        temperature_degC=recorded_degC(tests),
    )


def recorded_degC(tests: Sequence[Measurement]) -> Ends | None:
    """Lowest and highest recorded temperature (degC); None where none was."""
    known = [test.temperature_degC for test in tests if test.temperature_degC is not None]
    finite = [part for values in known if (part := values[np.isfinite(values)]).size]
    return _widest([(float(np.min(values)), float(np.max(values))) for values in finite]) if finite else None


def _widest(pairs: Sequence[Ends]) -> Ends:
    return min(low for low, _ in pairs), max(high for _, high in pairs)


def beyond(covered: Covered, test: Measurement) -> tuple[str, ...]:
    """In which quantities a test lies beyond what others covered: with more than `SHARE` of its samples, by `NEAR`."""
    values: Mapping[str, FloatArray | None] = {
        "displacement_m": test.u_m, "velocity_m_s": test.v_m_s, "current_A": test.current_A,
        "temperature_degC": test.temperature_degC if recorded_degC([test]) else None,
    }  # fmt: skip
    return tuple(name for name, where in covered.outside(values, NEAR).items() if np.mean(where) > SHARE)

"""What the tests covered, and how far the model was off there: what makes a prediction one, and not a guess."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.dampers.covered import Covered, Ends, ranges_of
from rig.identification.application.law import Law
from rig.identification.application.motion_table import Motion
from rig.identification.models.coverage import beyond, covered_by
from rig.identification.models.measurement import Measurement, first_cycle
from rig.identification.models.undetermined import only_at
from rig.signals.test_set import LEAST_CURRENT_A, current_levels

BAND = 0.95  # share of samples within the band
LEVELS = 16  # of the current, over which the band is told apart
FEWEST = 20  # samples of a level
UNKNOWN = "range not known"


@dataclass(frozen=True)
class Band:
    """Within how much of the modelled force 95 % of the measured samples lay.

    Attributes:
        current_A: currents (A), rising.
        half_width_N: half width at each (N).
        source: which tests say so.
    """

    current_A: tuple[float, ...]
    half_width_N: tuple[float, ...]
    source: str

    def at(self, current_A: FloatArray) -> FloatArray:
        """Half width (N) at currents (A), shape (n,); as at the nearest tested current beyond them."""
        return np.asarray(np.interp(current_A, self.current_A, self.half_width_N))


@dataclass(frozen=True, kw_only=True)
class TestedRange(Covered):
    """What the fitted tests covered, and how far measured forces were from modelled ones there.

    Attributes:
        band: within how much of the modelled force 95 % of the measured samples lay.
    """

    __test__ = False  # pytest takes classes called Test for its own

    band: Band

    def to_json(self) -> dict[str, Any]:
        """Key `tested` of `rig identify --json`."""
        ends = {name: None if value is None else list(value) for name, value in self.ranges()}
        band = {key: list(value) if isinstance(value, tuple) else value for key, value in vars(self.band).items()}
        return ends | {"only_at_A": list(self.only_at_A), "band": band}

    @classmethod
    def from_json(cls, entry: Mapping[str, Any]) -> TestedRange:
        """The inverse of `to_json`.

        Raises:
            KeyError, TypeError, ValueError: the entry is not what `to_json` gives.
        """
        band = entry["band"]
        widths = tuple(map(float, band["half_width_N"]))
        known = Band(tuple(map(float, band["current_A"])), widths, str(band["source"]))
        return cls(**ranges_of(entry), band=known)

    def beyond(self, motion: Motion) -> dict[str, BoolArray]:
        """Quantity -> which samples lie beyond what was tested, shape (n,); only those with such samples."""
        return self.outside({
            "displacement_m": motion.u_m, "velocity_m_s": motion.v_m_s, "current_A": motion.current_A,
            "temperature_degC": motion.temperature_degC,
        })  # fmt: skip


def tested_range(
    law: Law,
    fitted: Sequence[Measurement],
    held_out: Sequence[Measurement],
    temperature_degC: Ends | None,
    widened: float,
) -> TestedRange:
    """What tests covered, and the band of the force that their errors give.

    Args:
        law: the fitted model.
        fitted: tests it was fitted to.
        held_out: tests it has not seen; if there are any within what the fitted ones covered, they alone give the band.
        temperature_degC: lowest and highest recorded; None where nothing was.
        widened: factor on the band of fitted tests, 1 or more: how much larger the error on left-out tests was.
    """
    levels = only_at(law.model, fitted) if law.current is None else ()
    covered = replace(covered_by(fitted), temperature_degC=temperature_degC, only_at_A=levels)
    within = [test for test in held_out if not beyond(covered, test)]
    factor = 1.0 if within else max(1.0, widened)
    source = "held-out tests" if within else f"fitted tests x {factor:.3g}" if factor > 1.0 else "fitted tests"
    return TestedRange(**vars(covered), band=_band(law, within or fitted, factor, source))


def _band(law: Law, tests: Sequence[Measurement], factor: float, source: str) -> Band:
    errors, currents, numbers = [], [], []
    tested_levels = current_levels([test.current for test in tests])
    for number, test in enumerate(map(first_cycle, tests)):
        off = np.abs(test.force_N - law.force_of(test))
        errors.append(off[test.scored])
        currents.append(test.current_A[test.scored])
        numbers.append(np.full(errors[-1].size, tested_levels.of_test[number] or 0))
    error_N, current_A, level = np.concatenate(errors), np.concatenate(currents), np.concatenate(numbers)
    if tested_levels.changing or len(tested_levels) > LEVELS:
        width_A = max(LEAST_CURRENT_A, float(np.ptp(current_A)) / LEVELS)
        level = np.round(current_A / width_A).astype(np.int64)
    known = [one for one in np.unique(level) if np.count_nonzero(level == one) >= FEWEST]
    groups = [level == one for one in known] or [np.ones(level.size, dtype=bool)]
    means = tuple(float(np.mean(current_A[group])) for group in groups)
    widths = tuple(factor * float(np.quantile(error_N[group], BAND)) for group in groups)
    return Band(means, tuple(0.0 if math.isnan(width) else width for width in widths), source)

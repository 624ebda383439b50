"""What the tests covered, and how far the model was off there: what makes a prediction one, and not a guess."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rig.dampers.arrays import BoolArray
from rig.dampers.covered import Ends
from rig.fits.entries import Band, TestedRange
from rig.identification.application.law import Law
from rig.identification.application.motion_table import Motion
from rig.identification.models.coverage import beyond, covered_by
from rig.identification.models.measurement import Measurement, first_cycle, recorded_errors
from rig.identification.models.undetermined import only_at
from rig.signals.test_set import LEAST_CURRENT_A, current_levels

BAND = 0.95  # share of samples within the band
LEVELS = 16  # of the current, over which the band is told apart
FEWEST = 20  # samples of a level
UNKNOWN = "tested range unknown"


def beyond_tested(tested: TestedRange, motion: Motion) -> dict[str, BoolArray]:
    """Quantity -> which samples lie beyond what was tested, shape (n,); only those with such samples."""
    return tested.outside({
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
    source = "validation tests" if within else f"fitted tests x {factor:.3g}" if factor > 1.0 else "fitted tests"
    return TestedRange(**vars(covered), band=_band(law, within or fitted, factor, source))


def _band(law: Law, tests: Sequence[Measurement], factor: float, source: str) -> Band:
    errors, currents, numbers = [], [], []
    tested_levels = current_levels([test.current for test in tests])
    for number, test in enumerate(map(first_cycle, tests)):
        errors.append(np.abs(recorded_errors(test, test.force_N - law.force_of(test))[test.scored]))
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

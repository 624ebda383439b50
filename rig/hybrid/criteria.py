"""The benchmark's nine criteria, as the authors' `F4_evaluation.m` computes them."""

from __future__ import annotations

import numpy as np

from rig.hybrid.published import CRITERIA
from rig.signals.arrays import FloatArray

LONGEST_DELAY_S = 0.05


def criteria(target_m: FloatArray, measured_m: FloatArray, reference_m: FloatArray, step_s: float) -> dict[str, float]:
    """J1 to J9.

    J1: delay of the measured first floor behind its target (ms), where their correlation is largest. J2, J3: tracking
    error, RMS and peak. J4, J5: first floor as measured against the reference, RMS and peak. J6, J7: second and third
    floor, RMS. J8, J9: the same, peak. RMS without the mean; all but J1 in % of the target's or the reference's.

    Args:
        target_m: displacements of the floors as computed (n, 3), m; the first is the target.
        measured_m: displacement of the specimen (n,), m.
        reference_m: displacements of the floors of the whole structure (n, 3), m.
        step_s: between samples, s.
    """
    target, second, third = target_m.T
    first_r, second_r, third_r = reference_m.T
    values = (
        1e3 * step_s * delay_samples(target, measured_m, round(LONGEST_DELAY_S / step_s)),
        rms_percent(measured_m, target),
        peak_percent(measured_m, target),
        rms_percent(measured_m, first_r),
        peak_percent(measured_m, first_r),
        rms_percent(second, second_r),
        rms_percent(third, third_r),
        peak_percent(second, second_r),
        peak_percent(third, third_r),
    )
    return dict(zip(CRITERIA, values, strict=True))


def delay_samples(target: FloatArray, measured: FloatArray, longest: int) -> int:
    """By how many samples (0 to `longest`) the measured signal is behind its target: where they correlate best."""
    n = len(target)
    return int(np.argmax([np.corrcoef(measured[late:], target[: n - late])[0, 1] for late in range(longest + 1)]))


def rms_percent(values: FloatArray, target: FloatArray) -> float:
    """RMS of the difference, without its mean, in % of the asked signal's."""
    return float(100.0 * np.std(values - target) / np.std(target))


def peak_percent(values: FloatArray, target: FloatArray) -> float:
    """Largest difference in % of the asked signal's largest value."""
    return float(100.0 * np.max(np.abs(values - target)) / np.max(np.abs(target)))

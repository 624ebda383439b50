"""Steady change of the force during a test: a warming damper, falling gas pressure, a drifting load cell.

The residual of each cycle has a mean (N) and a part that is proportional to the force (1). A straight line is fitted to
each of the two over the cycles of a test. Its slope is tested with Student's t, converted to a normal deviate (Wallace
1959): z = (8 n + 1)/(8 n + 3) sqrt(n ln(1 + t^2/n)) for n degrees of freedom.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import some
from rig.identification.models.measurement import Measurement, samples_a_cycle
from rig.identification.remarks import Remark, say
from rig.signals.waveform import WAVEFORMS

FEWEST_CYCLES = 6
FALSE_ALARM = 0.01  # probability of a false remark in a fit
NEGLIGIBLE_OF_PEAK = 0.002  # change of the force, relative to its peak, that is not worth a remark


def drifting(tests: Sequence[Measurement], residuals_N: Sequence[FloatArray]) -> list[Remark]:
    """A remark if the force of some tests changes steadily from their first to their last cycle.

    Args:
        tests: the fitted tests.
        residuals_N: measured minus modelled force of each test (N), shape (n,).
    """
    level = NormalDist().inv_cdf(1.0 - FALSE_ALARM / (4.0 * max(1, len(tests))))
    changes = [_change(test, residual_N, level) for test, residual_N in zip(tests, residuals_N, strict=True)]
    names = [test.id for test, change in zip(tests, changes, strict=True) if change > NEGLIGIBLE_OF_PEAK]
    if not names:
        return []
    worst = tests[int(np.argmax(changes))].id
    return [say("drifting-tests", tests=some(names), percent=100.0 * max(changes), worst=worst)]


def _change(test: Measurement, residual_N: FloatArray, level: float) -> float:
    """Significant steady change from the first to the last cycle, relative to the peak force; 0 if there is none."""
    period = samples_a_cycle(test.u_m)
    count = int(test.u_m.size / period + 1e-6) if test.waveform in WAVEFORMS and period > 1.0 else 0
    if count < FEWEST_CYCLES or test.peak_force_N <= 0.0:
        return 0.0
    cycle = np.minimum((np.arange(test.u_m.size) / period).astype(np.int64), count)
    force_N = np.where(test.scored, test.force_N - np.mean(test.force_N[test.scored]), 0.0)
    error_N = np.where(test.scored, residual_N, 0.0)
    samples, power, product, total = (
        np.bincount(cycle, weights, count + 1)[:count]
        for weights in (test.scored.astype(float), force_N**2, force_N * error_N, error_N)
    )
    known = (samples > 0.5 * np.median(samples)) & (power > 0.0)
    if np.count_nonzero(known) < FEWEST_CYCLES:
        return 0.0
    numbers = np.flatnonzero(known).astype(float)
    gain_change, of_gain = _line(numbers, product[known] / power[known])
    zero_change_N, of_zero = _line(numbers, total[known] / samples[known])
    significant = [change for change, z in ((gain_change, of_gain), (zero_change_N / test.peak_force_N, of_zero))
                   if z > level]  # fmt: skip
    return max(map(abs, significant), default=0.0)


def _line(places: FloatArray, values: FloatArray) -> tuple[float, float]:
    """Change of a straight line from the first to the last place, and the normal deviate of its slope."""
    apart = places - np.mean(places)
    slope = float(apart @ values) / float(apart @ apart)
    left = values - np.mean(values) - slope * apart
    freedom = values.size - 2
    variance = float(left @ left) / freedom / float(apart @ apart)
    if variance == 0.0:
        return 0.0, 0.0
    squared_t = slope**2 / variance
    deviate = (8.0 * freedom + 1.0) / (8.0 * freedom + 3.0) * math.sqrt(freedom * math.log1p(squared_t / freedom))
    return slope * float(places[-1] - places[0]), deviate

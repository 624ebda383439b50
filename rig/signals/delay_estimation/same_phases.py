"""What a lag is worth where every cycle is sampled at the same few phases.

A force that jumps at each reversal, sampled at 250 Hz and polled at 100 Hz in cycles of 0.4 s: every cycle gives the
same phases, so no number of cycles tells where between two of them the jump lies. The sensor's series goes through all
samples, its residual is small, its harmonics beyond half the rate are folded into the others, and the lag comes out
wrong by up to half the time between polls with a small error stated. Measured: `docs/decisions/skew-by-signals.md`.
"""

from __future__ import annotations

import math

import numpy as np

from rig.signals.arrays import FloatArray, TimeSeries
from rig.signals.delay_estimation.cycle_match import CycleStretch
from rig.signals.delay_estimation.sample_match import Match
from rig.signals.fourier import Series

LOCKED = 0.5
"""Length of the samples' mean direction about the nearest of equal phases; 0 where the phases are spread evenly."""
TOP, HIGHEST = 1.0 / 3.0, 0.45
"""Between these shares of the sampling rate harmonics tell what lies beyond, and is folded into all of them."""
WITHIN = 1.0 / math.sqrt(12.0)


def doubted(
    laid: Match, reference: TimeSeries, series: Series, sensor_s: FloatArray, cycles: CycleStretch
) -> Match:
    """The match with what jumps between equal phases leave open of its lag.

    Args:
        laid: all cycles together.
        reference: the controller's record (m,).
        series: the sensor's, of `cycle_series`.
        sensor_s: times of its samples (n,), s.
        cycles: where the motion repeats.
    """
    sampled_s = _shared_s(sensor_s, cycles)
    sharp = 0.0 if sampled_s == 0.0 else _sharpness(series, 1.0 / sampled_s)
    if sharp == 0.0:
        return laid
    apart_s = math.hypot(sampled_s, _shared_s(reference.time_s, cycles))
    return laid.widened(math.hypot(laid.lag_std_s, WITHIN * sharp * apart_s))


def _shared_s(time_s: FloatArray, cycles: CycleStretch) -> float:
    """Time between phases that all cycles share (s); 0 where each has phases of its own."""
    at_s = time_s[(time_s >= cycles.start_s) & (time_s < cycles.end_s)]
    if len(at_s) < 2:
        return 0.0
    count = max(1, round(cycles.period_s / float(np.median(np.diff(at_s)))))
    place = (at_s - cycles.start_s) / cycles.period_s * count
    locked = abs(complex(np.mean(np.exp(2j * math.pi * place)))) > LOCKED
    return cycles.period_s / count if locked else 0.0


def _sharpness(series: Series, rate_Hz: float) -> float:
    """How much of the motion's jumps lies between two samples: 0 of a smooth course, 1 of steps.

    A step's harmonics fall with their order k: k |c_k| is then at the top what it is below. A flank of width w has
    k |c_k| fall the faster beyond 1 / w, and the lag is wrong by the square of what is left of it.
    """
    per_cycle = rate_Hz * math.tau / series.omega_rad_s
    orders, heights = series.orders, np.abs(series.coefficients)
    at_top = (orders > TOP * per_cycle) & (orders < HIGHEST * per_cycle)
    count = math.floor(HIGHEST * per_cycle) - math.floor(TOP * per_cycle)
    if not at_top.any():
        return 0.0
    beyond = np.maximum(heights[at_top] ** 2 - series.coefficient_std**2, 0.0) * orders[at_top] ** 2
    # A cycle whose halves mirror each other has every other order only.
    strongest = np.sort(beyond)[::-1][: max(1, count // 2)]
    return float(min(1.0, np.sum(strongest) / max(1, count // 2) / np.max(orders * heights) ** 2))

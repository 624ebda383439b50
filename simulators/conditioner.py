"""A sensor's analogue side, compiled: second-order low-pass at the plant's rate, then sampling at given instants.

`y'' = w^2 (x - y) - 2 zeta w y'` with zeta = 1/sqrt(2), integrated by the trapezoidal rule, which keeps the group delay
at low frequency exact: `2 zeta / w`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
DAMPING = 1.0 / math.sqrt(2.0)


def group_delay_s(bandwidth_Hz: float) -> float:
    """Group delay of the filter at low frequency (s) for its corner frequency (Hz)."""
    return 2.0 * DAMPING / (2.0 * math.pi * bandwidth_Hz)


def _condition(
    signal: FloatArray, dt_s: float, corner_rad_s: float, state: FloatArray, start_s: float, times_s: FloatArray
) -> FloatArray:
    values = np.empty(len(times_s))
    h = dt_s
    reach = h * h * corner_rad_s * corner_rad_s / 4.0
    damp = h * DAMPING * corner_rad_s
    taken = 0
    while taken < len(times_s) and times_s[taken] <= start_s:
        share = (times_s[taken] - start_s) / h + 1.0
        values[taken] = state[3] + share * (state[0] - state[3])
        taken += 1
    for k in range(len(signal)):
        before = state[0]
        state[3] = before
        mean = 0.5 * (state[2] + signal[k])
        rate = state[1] * (1.0 - damp - reach) + h * corner_rad_s * corner_rad_s * (mean - before)
        rate /= 1.0 + damp + reach
        state[0] = before + 0.5 * h * (state[1] + rate)
        state[1] = rate
        state[2] = signal[k]
        end_s = start_s + (k + 1) * h
        while taken < len(times_s) and times_s[taken] <= end_s:
            share = (times_s[taken] - end_s) / h + 1.0
            values[taken] = before + share * (state[0] - before)
            taken += 1
    while taken < len(times_s):
        values[taken] = state[0]
        taken += 1
    return values


condition: Any = njit(cache=True, error_model="numpy")(_condition)
"""`condition(signal (n,), dt_s, corner_rad_s, state (4,), start_s, times_s (m,)) -> filtered values (m,)`.

`signal` holds the plant's values at `start_s + dt_s ... start_s + n dt_s`; `state` (filtered value, its rate, last
input, filtered value one step earlier) is moved along; `times_s` ascend, from one step before the slice to its end.
"""

"""A sensor's analogue side, compiled: when it samples, second-order low-pass at the plant's rate, what it makes of it.

`y'' = w^2 (x - y) - 2 zeta w y'` with zeta = 1/sqrt(2), integrated by the trapezoidal rule, which keeps the group delay
at low frequency exact: `2 zeta / w`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.dampers.compiled_cache import njit

FloatArray = NDArray[np.float64]
DAMPING = 1.0 / math.sqrt(2.0)
LARGEST_JITTER = 4.0


def group_delay_s(bandwidth_Hz: float) -> float:
    """Group delay of the filter at low frequency (s) for its corner frequency (Hz)."""
    return 2.0 * DAMPING / (2.0 * math.pi * bandwidth_Hz)


def _sampling(
    first: int, period_us: float, offset_us: float, rate_us_s: float, jitter_s: float, draws: FloatArray,
    clocks: FloatArray,
) -> None:
    latest_s = -math.inf
    for i in range(len(draws)):
        device_us = float(first + i) * period_us
        nominal_s = (device_us - offset_us) / rate_us_s
        latest_s = max(latest_s, nominal_s + jitter_s * max(-LARGEST_JITTER, min(LARGEST_JITTER, draws[i, 1])))
        clocks[0, i], clocks[1, i], clocks[2, i] = device_us, nominal_s, latest_s


sampling: Any = njit(cache=True, error_model="numpy")(_sampling)
"""`sampling(first, period_us, offset_us, rate_us_s, jitter_s, draws (m, 2), clocks (3, m))`, which fills `clocks`.

Ticks `first`, `first + 1` ... of a clock that reads `offset_us + rate_us_s t`: its readings (us), the simulated times
(s) of them, and the times (s) at which the samples are taken, moved by `jitter_s` times the second column of unit
`draws`, never back in time. What a compiled function returns costs more than what it fills.
"""


def _condition(
    signal: FloatArray, dt_s: float, corner_rad_s: float, state: FloatArray, start_s: float, times_s: FloatArray,
    values: FloatArray,
) -> None:
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


condition: Any = njit(cache=True, error_model="numpy")(_condition)
"""`condition(signal (n,), dt_s, corner_rad_s, state (4,), start_s, times_s (m,), values (m,))`, which fills `values`.

These are filtered. `signal` holds the plant's values at `start_s + dt_s ... start_s + n dt_s`; `state` (filtered value,
its rate, last input, filtered value one step earlier) is moved along; `times_s` ascend, from one step before the slice
to its end.
"""


def _amplify(
    values: FloatArray,
    draws: FloatArray,
    disturbance: FloatArray,
    scale: float,
    noise: float,
    bias: float,
    resolution: float,
    clip: float,
) -> None:
    for i in range(len(values)):
        value = values[i] * scale + noise * draws[i, 0]
        value += bias + (disturbance[i] if len(disturbance) else 0.0)
        if resolution > 0.0:
            value = np.rint(value / resolution) * resolution
        if value < -clip:
            value = -clip
        elif value > clip:
            value = clip
        values[i] = value


amplify: Any = njit(cache=True, error_model="numpy")(_amplify)
"""`amplify(values (m,), draws (m, 2), disturbance (m,) or (0,), scale, noise, bias, resolution, clip)`, in place.

Wire values of filtered SI values: gain, noise by the first column of unit `draws`, zero, disturbance (wire unit; empty
for none), resolution (0: none), clipping.
"""


def _limit(values: FloatArray, largest: float, overload: int, others: int) -> NDArray[np.uint8]:
    status = np.empty(len(values), np.uint8)
    for i in range(len(values)):
        status[i] = others | overload if abs(values[i]) >= largest else others
        if values[i] < -largest:
            values[i] = -largest
        elif values[i] > largest:
            values[i] = largest
    return status


limit: Any = njit(cache=True)(_limit)
"""`limit(values (m,), largest, overload, others) -> status (m,)`: values clipped to the range in place.

`overload` is the status bit of those at or beyond it, `others` the bits that all have.
"""

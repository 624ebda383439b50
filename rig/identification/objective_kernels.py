"""Compiled weighted sums of squares, equation (12): populations of candidates against one recording.

The tanh models share one general form with 12 coefficients,
F = m a + F0 + (Fya + Fyb I) tanh(beta v + delta sgn u) + C(I, sgn v) v + (Ka + Kb I) u,
so one vectorised loop serves them all; its tanh is branch-free (exponential by range reduction and a polynomial of
degree 10, error below 2e-13), because the library's stops the compiler from vectorising.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.dampers.series import force_series

FloatArray = NDArray[np.float64]

BLOCK = 2048  # samples kept in cache while every candidate of a population passes over them


@njit(fastmath=True, error_model="numpy", inline="always", cache=True)
def fast_tanh(y: float) -> float:
    """Hyperbolic tangent without branches, absolute error below 2e-13."""
    x = min(max(2.0 * y, -60.0), 60.0)
    n = np.floor(x * 1.4426950408889634 + 0.5)
    r = x - n * 0.6931471805599453
    tail = 1 / 720 + r * (1 / 5040 + r * (1 / 40320 + r * (1 / 362880 + r * (1 / 3628800))))
    power = 1.0 + r * (1.0 + r * (0.5 + r * (1 / 6 + r * (1 / 24 + r * (1 / 120 + r * tail)))))
    scale = np.int64((np.int64(n) + 1023) << 52).view(np.float64)
    return float(1.0 - 2.0 / (power * scale + 1.0))


@njit(fastmath=True, error_model="numpy", cache=True, nogil=True)
def _tanh_squares(
    p: FloatArray,
    u: FloatArray,
    v: FloatArray,
    a: FloatArray,
    current: FloatArray,
    force: FloatArray,
    weight_squared: FloatArray,
) -> float:
    """Weighted sum of squares of one candidate in the general form, shape (12,); viscous terms by v and |v|."""
    m, f0, beta, delta, fya, fyb, ka, kb = p[0], p[1], p[2], p[3], p[4], p[5], p[10], p[11]
    ca_mean, ca_half = 0.5 * (p[6] + p[7]), 0.5 * (p[6] - p[7])
    cb_mean, cb_half = 0.5 * (p[8] + p[9]), 0.5 * (p[8] - p[9])
    total = 0.0
    for i in range(u.size):
        shift = delta if u[i] > 0.0 else (-delta if u[i] < 0.0 else 0.0)
        yielding = fast_tanh(beta * v[i] + shift)
        speed = abs(v[i])
        steady = m * a[i] + f0 + fya * yielding + ca_mean * v[i] + ca_half * speed + ka * u[i]
        error = force[i] - steady - current[i] * (fyb * yielding + cb_mean * v[i] + cb_half * speed + kb * u[i])
        total += error * error * weight_squared[i]
    return total


@njit(fastmath=True, error_model="numpy", cache=True, nogil=True)
def tanh_objective(
    population: FloatArray,
    u: FloatArray,
    v: FloatArray,
    a: FloatArray,
    current: FloatArray,
    force: FloatArray,
    weight_squared: FloatArray,
) -> FloatArray:
    """Weighted sum of squares, shape (N,), of candidates in the general form, shape (N, 12); data of shape (n,)."""
    total = np.zeros(population.shape[0])
    for start in range(0, u.size, BLOCK):
        rows = slice(start, min(start + BLOCK, u.size))
        data = u[rows], v[rows], a[rows], current[rows], force[rows], weight_squared[rows]
        for j in range(population.shape[0]):
            total[j] += _tanh_squares(population[j], *data)
    return total


@njit(error_model="numpy", cache=True, nogil=True)
def hysteretic_objective(
    kind: int,
    population: FloatArray,
    states: FloatArray,
    u: FloatArray,
    v: FloatArray,
    a: FloatArray,
    current: FloatArray,
    force: FloatArray,
    weight_squared: FloatArray,
    dt: float,
    warm: int,
) -> FloatArray:
    """Weighted sum of squares, shape (N,), of one test for models with internal states.

    `population` has shape (N, p) in the model's order, `states` (s,) the state at rest; the first `warm` samples, one
    whole cycle, are run once before the scored pass, so that the state has forgotten its start. A candidate whose
    force is not finite scores infinity.
    """
    total = np.empty(population.shape[0])
    for j in range(population.shape[0]):
        model = force_series(kind, population[j], states, u, v, a, current, dt, warm)
        subtotal = 0.0
        for i in range(u.size):
            error = force[i] - model[i]
            subtotal += error * error * weight_squared[i]
        total[j] = subtotal if math.isfinite(subtotal) else math.inf
    return total


@njit(cache=True, nogil=True)
def lagged_current(commanded: FloatArray, start: float, eta: float, dt: float) -> FloatArray:
    """Coil current (A), shape (n,), of equation (9) solved exactly for a command held over each interval `dt` (s)."""
    current = np.empty(commanded.size)
    decay = math.exp(-eta * dt)
    value = start
    for i in range(commanded.size):
        if i > 0:
            value = commanded[i - 1] + (value - commanded[i - 1]) * decay
        current[i] = value
    return current

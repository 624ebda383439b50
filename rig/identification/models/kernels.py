"""Compiled weighted sums of squares, equation (12): populations of candidates against one recording.

The tanh models share one general form with 12 coefficients,
F = m a + F0 + (Fya + Fyb I) tanh(beta v + delta sgn u) + C(I, sgn v) v + (Ka + Kb I) u,
so one vectorised loop serves them all; its tanh is branch-free (exponential by range reduction and a polynomial of
degree 10, error below 2e-13), because the library's stops the compiler from vectorising. Arrays are filled and added
by loops: of an assignment between slices numba also compiles the message that their shapes differ, for two seconds.

The moments of the tanh models' yield shape, which `tanh_projection` sums in numpy, take 1.3 to 2.2 ns a sample here:
loops over blocks that stay in the first-level cache, without branches, so that the compiler vectorises each of them.
"""

from __future__ import annotations

import math

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray, IntArray
from rig.dampers.compiled_cache import njit

BLOCK = 2048  # samples kept in cache while every candidate of a population passes over them


@njit(fastmath=True, error_model="numpy", inline="always")
def fast_tanh(y: float) -> float:
    """Hyperbolic tangent without branches, absolute error below 2e-13."""
    x = min(max(2.0 * y, -60.0), 60.0)
    n = np.floor(x * 1.4426950408889634 + 0.5)
    r = x - n * 0.6931471805599453
    tail = 1 / 720 + r * (1 / 5040 + r * (1 / 40320 + r * (1 / 362880 + r * (1 / 3628800))))
    power = 1.0 + r * (1.0 + r * (0.5 + r * (1 / 6 + r * (1 / 24 + r * (1 / 120 + r * tail)))))
    scale = np.int64((np.int64(n) + 1023) << 52).view(np.float64)
    return float(1.0 - 2.0 / (power * scale + 1.0))


@njit(fastmath=True, error_model="numpy")
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
def weighted_squares(force: FloatArray, modelled: FloatArray, weight_squared: FloatArray) -> float:
    """Weighted sum of squares of one test, arrays of shape (n,); infinity where a modelled force is not finite."""
    total = 0.0
    for i in range(force.size):
        error = force[i] - modelled[i]
        total += error * error * weight_squared[i]
    return total if math.isfinite(total) else math.inf


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


@njit(fastmath=True, error_model="numpy")
def _yield_shape(y: FloatArray, beta: float, delta: float, u: FloatArray, v: FloatArray) -> None:
    for i in range(u.size):
        shift = delta if u[i] > 0.0 else (-delta if u[i] < 0.0 else 0.0)
        y[i] = fast_tanh(beta * v[i] + shift)


@njit(fastmath=True, error_model="numpy")
def _add_shape(
    into: FloatArray, y: FloatArray, u: FloatArray, v: FloatArray, a: FloatArray, force: FloatArray, weight: FloatArray
) -> None:
    """Adds to `into` (9,) the sums of y times each of a, 1, v, |v|, u, force, y."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = 0.0
    for i in range(u.size):
        x = y[i] * weight[i]
        s0 += x * a[i]
        s1 += x
        s2 += x * v[i]
        s3 += x * abs(v[i])
        s4 += x * u[i]
        s5 += x * force[i]
        s6 += x * y[i]
    for k, total in enumerate((s0, s1, s2, s3, s4, s5, s6)):
        into[k] += total


@njit(fastmath=True, error_model="numpy")
def _add_slopes(
    into: FloatArray, y: FloatArray, u: FloatArray, v: FloatArray, a: FloatArray, force: FloatArray, weight: FloatArray
) -> None:
    """Adds to `into` (3, 9) the sums with dy/dbeta (second row) and dy/ddelta (third row), and their mirror images."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    r0 = r1 = r2 = r3 = r4 = r5 = r6 = r7 = r8 = 0.0
    for i in range(u.size):
        rate = 1.0 - y[i] * y[i]
        side = 1.0 if u[i] > 0.0 else (-1.0 if u[i] < 0.0 else 0.0)
        x = rate * weight[i] * v[i]
        s0 += x * a[i]
        s1 += x
        s2 += x * v[i]
        s3 += x * abs(v[i])
        s4 += x * u[i]
        s5 += x * force[i]
        s6 += x * y[i]
        s7 += x * rate * v[i]
        z = rate * weight[i] * side
        r0 += z * a[i]
        r1 += z
        r2 += z * v[i]
        r3 += z * abs(v[i])
        r4 += z * u[i]
        r5 += z * force[i]
        r6 += z * y[i]
        r7 += z * rate * v[i]
        r8 += z * rate * side
    for k, total in enumerate((s0, s1, s2, s3, s4, s5, s6, s7, r7)):
        into[1, k] += total
    for k, total in enumerate((r0, r1, r2, r3, r4, r5, r6, r7, r8)):
        into[2, k] += total
    into[0, 7] += s6
    into[0, 8] += r6


@njit(fastmath=True, error_model="numpy")
def _add_rows(
    into: FloatArray,
    slope: bool,
    y: FloatArray,
    u: FloatArray,
    v: FloatArray,
    a: FloatArray,
    force: FloatArray,
    weight: FloatArray,
) -> None:
    _add_shape(into[0], y, u, v, a, force, weight)
    if slope:
        _add_slopes(into, y, u, v, a, force, weight)


@njit(fastmath=True, error_model="numpy")
def _add_products(
    into: FloatArray, u: FloatArray, v: FloatArray, a: FloatArray, force: FloatArray, weight: FloatArray
) -> None:
    """Adds to the upper half of `into` (6, 6) the products of a, 1, v, |v|, u, force with each other."""
    a0 = a1 = a2 = a3 = a4 = a5 = 0.0
    n1 = n2 = n3 = n4 = n5 = 0.0
    v2 = v3 = v4 = v5 = 0.0
    s4 = s5 = u4 = u5 = f5 = 0.0
    for i in range(u.size):
        speed, w = abs(v[i]), weight[i]
        x = w * a[i]
        a0 += x * a[i]
        a1 += x
        a2 += x * v[i]
        a3 += x * speed
        a4 += x * u[i]
        a5 += x * force[i]
        n1 += w
        n2 += w * v[i]
        n3 += w * speed
        n4 += w * u[i]
        n5 += w * force[i]
        v2 += w * v[i] * v[i]
        v3 += w * v[i] * speed
        v4 += w * v[i] * u[i]
        v5 += w * v[i] * force[i]
        s4 += w * speed * u[i]
        s5 += w * speed * force[i]
        u4 += w * u[i] * u[i]
        u5 += w * u[i] * force[i]
        f5 += w * force[i] * force[i]
    rows = (a0, a1, a2, a3, a4, a5, n1, n2, n3, n4, n5, v2, v3, v4, v5, v2, s4, s5, u4, u5, f5)
    at = 0
    for i in range(6):
        for j in range(i, 6):
            into[i, j] += rows[at]
            at += 1


@njit(fastmath=True, error_model="numpy")
def _fill(into: FloatArray, values: FloatArray) -> None:
    for i in range(into.size):
        into[i] = values[i]


@njit(fastmath=True, error_model="numpy")
def _multiply(values: FloatArray, factors: FloatArray) -> None:
    for i in range(values.size):
        values[i] *= factors[i]


@njit(fastmath=True, error_model="numpy")
def _add_times(into: FloatArray, sums: FloatArray, factor: float) -> None:
    """Adds sums, of two dimensions, times a factor."""
    for i in range(into.shape[0]):
        for j in range(into.shape[1]):
            into[i, j] += sums[i, j] * factor


@njit(fastmath=True, error_model="numpy", cache=True, nogil=True)
def gram(
    u: FloatArray,
    v: FloatArray,
    a: FloatArray,
    current: FloatArray,
    force: FloatArray,
    weight_squared: FloatArray,
    ends: IntArray,
    steady: BoolArray,
) -> FloatArray:
    """Moments of a, 1, v, |v|, u, force with each other, shape (3, 6, 6); arguments as in `add_moments`."""
    total, part, weight = np.zeros((3, 6, 6)), np.empty((6, 6)), np.empty(BLOCK)
    first = 0
    for test in range(ends.size):
        for start in range(first, ends[test], BLOCK):
            stop = min(start + BLOCK, ends[test])
            rows = u[start:stop], v[start:stop], a[start:stop], force[start:stop]
            powered = weight[: stop - start]
            _fill(powered, weight_squared[start:stop])
            for power in range(1 if steady[test] else 3):
                part[:] = 0.0
                _add_products(part, *rows, powered)
                _add_times(total[power], part, 1.0)
                if steady[test]:
                    _add_times(total[1], part, current[first])
                    _add_times(total[2], part, current[first] ** 2)
                _multiply(powered, current[start:stop])
        first = ends[test]
    for power in range(3):
        for i in range(6):
            for j in range(i):
                total[power, i, j] = total[power, j, i]
    return total


@njit(fastmath=True, error_model="numpy", cache=True, nogil=True)
def add_moments(
    total: FloatArray,
    shapes: FloatArray,
    slope: bool,
    u: FloatArray,
    v: FloatArray,
    a: FloatArray,
    current: FloatArray,
    force: FloatArray,
    weight_squared: FloatArray,
    ends: IntArray,
    steady: BoolArray,
) -> None:
    """Adds the moments of `tanh_projection.add_moments` of samples of shape (n,) to `total` (S, 3, 3, 9).

    Args:
        total: moments by shape, power of the current, yield shape or slope, and column.
        shapes: (beta, delta) pairs, shape (S, 2).
        slope: whether the slopes' rows are wanted.
        u: extension (m).
        v: velocity (m/s).
        a: acceleration (m/s^2).
        current: coil current (A).
        force: measured force (N).
        weight_squared: squared weight.
        ends: where each test ends, shape (t,).
        steady: whether its current is constant, shape (t,): then one power of it gives the others.
    """
    y, weight, part = np.empty(BLOCK), np.empty(BLOCK), np.empty((3, 9))
    for k in range(shapes.shape[0]):
        first = 0
        for test in range(ends.size):
            part[:] = 0.0
            for start in range(first, ends[test], BLOCK):
                stop = min(start + BLOCK, ends[test])
                rows = y[: stop - start], u[start:stop], v[start:stop], a[start:stop], force[start:stop]
                _yield_shape(rows[0], shapes[k, 0], shapes[k, 1], rows[1], rows[2])
                if steady[test]:
                    _add_rows(part, slope, *rows, weight_squared[start:stop])
                    continue
                powered = weight[: stop - start]
                _fill(powered, weight_squared[start:stop])
                for power in range(3):
                    _add_rows(total[k, power], slope, *rows, powered)
                    _multiply(powered, current[start:stop])
            if steady[test]:
                for power in range(3):
                    _add_times(total[k, power], part, current[first] ** power)
            first = ends[test]

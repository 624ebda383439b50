"""Derivatives of the Bouc-Wen hysteresis with respect to its shape, exact, in one pass along the recording.

On one branch x = X(s; sigma, n) with s = e + rho D, D the way since the last reversal, so
dx/dln(rho) = f (de/dln(rho) + rho D), dx/dsigma = f (de/dsigma - S_sigma), dx/dn = f (de/dn - S_n) (`loop_curve`).
A reversal goes from x to -x at once: there de/dtheta = S_theta(-x) - (dx/dtheta) / f(-x).
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from rig.dampers.arrays import FloatArray
from rig.dampers.loop_curve import (
    LAST,
    NODES,
    cell_of,
    closing_m,
    curve_slopes,
    loop_curve,
    place,
    travel_along,
    turning_point,
)

Place = tuple[float, float, int, float]


@njit(cache=True)
def _rate(curve: FloatArray, n: float, s: float, x: float, cell: int) -> float:
    """f(x) as the slope of the curve."""
    if cell == LAST:
        return n * (1.0 - x)
    t = s - curve[cell, 0]
    return float(curve[cell, 1] + t * (2.0 * curve[cell, 2] + t * 3.0 * curve[cell, 3]))


@njit(cache=True)
def _slope_at(curve: FloatArray, slopes: FloatArray, n: float, s: float, x: float, cell: int, k: int) -> float:
    """S_sigma (k = 0) or S_n (k = 1) at a place, linear inside a cell."""
    if cell == LAST:
        beyond = math.log(max(1.0 - x, 1e-300) / (1.0 - NODES[LAST])) / (n * n) if k == 1 else 0.0
        return float(slopes[LAST, k] + beyond)
    share = (s - curve[cell, 0]) / (curve[cell + 1, 0] - curve[cell, 0])
    return float(slopes[cell, k] + share * (slopes[cell + 1, k] - slopes[cell, k]))


@njit(cache=True)
def _turned(curve: FloatArray, slopes: FloatArray, n: float, at: Place, moving: FloatArray, distance: float) -> Place:
    """Reverse, if the motion does, and carry the derivatives over; `moving` is de/dln(rho), de/dsigma, de/dn."""
    s, x, cell, direction = at
    if distance * direction >= 0.0:
        return at
    before = _rate(curve, n, s, x, cell)
    there = (0.0, _slope_at(curve, slopes, n, s, x, cell, 0), _slope_at(curve, slopes, n, s, x, cell, 1))
    x, direction = -x, -direction
    cell = cell_of(x)
    s = place(curve, n, x, cell)
    after = _rate(curve, n, s, x, cell)
    here = (0.0, _slope_at(curve, slopes, n, s, x, cell, 0), _slope_at(curve, slopes, n, s, x, cell, 1))
    for k in range(3):
        moving[k] = here[k] - before / after * (moving[k] - there[k])
    return s, x, cell, direction


@njit(cache=True)
def _move(curve: FloatArray, slopes: FloatArray, n: float, at: Place, moving: FloatArray, distance: float) -> Place:
    """Move by a signed distance (in 1/rho), reversing first where its sign says so."""
    at = _turned(curve, slopes, n, at, moving, distance)
    moving[0] += abs(distance)
    return travel_along(curve, n, at, distance)


@njit(cache=True)
def _pass(
    curve: FloatArray,
    slopes: FloatArray,
    rho: float,
    n: float,
    at: Place,
    moving: FloatArray,
    u: FloatArray,
    v: FloatArray,
    dt: float,
    out: FloatArray,
) -> Place:
    """Follow the samples of a motion; rows of `out`, where it has any: w and its three derivatives."""
    for k in range(u.size):
        if k > 0:
            if v[k - 1] * v[k] < 0.0:
                turn = turning_point(u[k - 1], v[k - 1], u[k], v[k], dt)
                at = _move(curve, slopes, n, at, moving, rho * (turn - u[k - 1]))
                at = _move(curve, slopes, n, at, moving, rho * (u[k] - turn))
            else:
                at = _move(curve, slopes, n, at, moving, rho * (u[k] - u[k - 1]))
        if out.shape[1] > 0:
            s, x, cell, direction = at
            out[0, k] = direction * x
            if x == 1.0:
                out[1, k] = out[2, k] = out[3, k] = 0.0
                continue
            rate = direction * _rate(curve, n, s, x, cell)
            out[1, k] = rate * moving[0] / rho
            out[2, k] = rate * (moving[1] - _slope_at(curve, slopes, n, s, x, cell, 0))
            out[3, k] = rate * (moving[2] - _slope_at(curve, slopes, n, s, x, cell, 1))
    return at


@njit(cache=True, nogil=True)
def hysteresis_with_slopes(
    rho: float, sigma: float, n: float, u: FloatArray, v: FloatArray, dt: float, warm: int
) -> FloatArray:
    """Normalised hysteretic variable and its derivatives with respect to rho, sigma and n, shape (4, samples).

    Args:
        rho: inverse of the yield displacement (1/m); the shape must be one that `has_curve` accepts.
        sigma: shape of the loop (1).
        n: sharpness of the bend (1).
        u: extension (m), shape (samples,).
        v: velocity (m/s), shape (samples,).
        dt: sampling interval (s).
        warm: samples of one whole cycle that is run once before, from w = 0; 0 for none.
    """
    curve, slopes = loop_curve(sigma, n), curve_slopes(sigma, n)
    cell = cell_of(0.0)
    start = place(curve, n, 0.0, cell)
    at, moving = (start, 0.0, cell, 1.0), np.zeros(3)
    moving[1] = _slope_at(curve, slopes, n, start, 0.0, cell, 0)
    moving[2] = _slope_at(curve, slopes, n, start, 0.0, cell, 1)
    if warm > 1:
        at = _pass(curve, slopes, rho, n, at, moving, u[:warm], v[:warm], dt, np.empty((4, 0)))
        at = _move(curve, slopes, n, at, moving, rho * closing_m(u, v, warm))
    out = np.empty((4, u.size))
    _pass(curve, slopes, rho, n, at, moving, u, v, dt, out)
    return out

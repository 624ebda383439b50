"""The Bouc-Wen hysteresis along a whole recording, by the one curve that every branch of its loops is a part of.

With x = w sgn(v) and s = rho |du| the hysteresis is dx/ds = f(x), f = 1 - x^n for x >= 0 (loading) and
f = 1 + (2 sigma - 1) |x|^n for x < 0 (unloading): see `kernel.travel`. f depends on x alone, so between reversals x
always moves along the same curve S(x) = integral of dx/f from -1, and a reversal only jumps from x to -x on it. The
curve is integrated once for a pair of shape parameters (three-point Gauss on cells fixed in x), and a sample then costs
one cubic. Beyond the last node 1 - x closes up as exp(-n s).

Its derivatives with respect to its shape are exact, in one pass along the recording. On one branch
x = X(s; sigma, n) with s = e + rho D, D the way since the last reversal, so dx/dln(rho) = f (de/dln(rho) + rho D),
dx/dsigma = f (de/dsigma - S_sigma), dx/dn = f (de/dn - S_n). A reversal goes from x to -x at once: there
de/dtheta = S_theta(-x) - (dx/dtheta) / f(-x).
"""

from __future__ import annotations

import math

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.compiled_cache import njit
from rig.dampers.separation import JoinedMotions, Motion

CELLS_A_UNIT = 48
CLOSING = 0.8  # ratio of successive distances from saturation
NEAR_SATURATION, SATURATED = 0.1, 1e-3  # those distances: from here on cells shrink; the last node
CLOSED = 30.0  # exponent from which saturation is complete in double precision
SLOWEST_RATE = 1e-6  # of f at x = -1; below it a reversed loop would never leave its end


def _nodes() -> FloatArray:
    even = np.arange(-CELLS_A_UNIT, round((1.0 - NEAR_SATURATION) * CELLS_A_UNIT)) / CELLS_A_UNIT
    count = math.ceil(math.log(SATURATED / NEAR_SATURATION) / math.log(CLOSING))
    return np.concatenate((even, 1.0 - np.geomspace(NEAR_SATURATION, SATURATED, count + 1)))


def _gauss_logarithms() -> FloatArray:
    """log|x| at the Gauss points of each cell, shape (cells, 3)."""
    middle, half = 0.5 * (NODES[1:] + NODES[:-1]), 0.5 * np.diff(NODES)
    return np.asarray(np.log(np.abs(middle[:, None] + half[:, None] * GAUSS)))


GAUSS = np.array([-math.sqrt(0.6), 0.0, math.sqrt(0.6)])
GAUSS_WEIGHTS = np.array([5.0, 8.0, 5.0]) / 18.0
NODES = _nodes()
LOGARITHMS = _gauss_logarithms()
POWERS_END = np.log(np.maximum(np.abs(NODES), 1e-300))
LAST = NODES.size - 1
FIRST_LOADING = CELLS_A_UNIT  # the node at x = 0


def has_curve(rho: float, sigma: float, n: float) -> bool:
    """Whether the loop is one that the curve describes: finite, dissipating or nearly so, n >= 1."""
    return 0.0 < rho < math.inf and SLOWEST_RATE <= 2.0 * sigma < math.inf and 1.0 <= n < math.inf


@njit()
def loop_curve(sigma: float, n: float) -> FloatArray:
    """S at each node and the cubic x(s) of the cell behind it, shape (nodes, 4): s, then coefficients of s - s_node."""
    curve = np.empty((LAST + 1, 4))
    unloading = 2.0 * sigma - 1.0
    curve[0, 0] = 0.0
    for j in range(LAST):
        slope = -1.0 if j >= FIRST_LOADING else unloading
        length = 0.0
        for k in range(3):
            length += GAUSS_WEIGHTS[k] / (1.0 + slope * math.exp(n * LOGARITHMS[j, k]))
        step = NODES[j + 1] - NODES[j]
        h = step * length
        left = 1.0 + slope * math.exp(n * POWERS_END[j])
        right = 1.0 + slope * math.exp(n * POWERS_END[j + 1])
        curve[j, 1] = left
        curve[j, 2] = (3.0 * step / h - 2.0 * left - right) / h
        curve[j, 3] = (left + right - 2.0 * step / h) / (h * h)
        curve[j + 1, 0] = curve[j, 0] + h
    return curve


@njit()
def curve_slopes(sigma: float, n: float) -> FloatArray:
    """Derivatives of S at the nodes with respect to sigma and n, shape (nodes, 2)."""
    slopes = np.zeros((LAST + 1, 2))
    unloading = 2.0 * sigma - 1.0
    for j in range(LAST):
        loading = j >= FIRST_LOADING
        slope = -1.0 if loading else unloading
        by_sigma = by_n = 0.0
        for k in range(3):
            power = math.exp(n * LOGARITHMS[j, k])
            rate = 1.0 + slope * power
            by_sigma -= 0.0 if loading else GAUSS_WEIGHTS[k] * 2.0 * power / (rate * rate)
            by_n -= GAUSS_WEIGHTS[k] * slope * power * LOGARITHMS[j, k] / (rate * rate)
        step = NODES[j + 1] - NODES[j]
        slopes[j + 1, 0] = slopes[j, 0] + step * by_sigma
        slopes[j + 1, 1] = slopes[j, 1] + step * by_n
    return slopes


@njit()
def cell_of(x: float) -> int:
    """The cell of a value from -1 on; `LAST` beyond the last node."""
    if x >= NODES[LAST]:
        return LAST
    low, high = 0, LAST
    while high - low > 1:
        middle = (low + high) // 2
        if x >= NODES[middle]:
            low = middle
        else:
            high = middle
    return low


@njit()
def place(curve: FloatArray, n: float, x: float, cell: int) -> float:
    """S(x): Newton's method on the cubic of its cell."""
    if cell == LAST:
        return float(curve[LAST, 0] - math.log(max(1.0 - x, 1e-300) / SATURATED) / n)
    height = NODES[cell + 1] - NODES[cell]
    t = (x - NODES[cell]) / height * (curve[cell + 1, 0] - curve[cell, 0])
    for _ in range(4):
        value = NODES[cell] + t * (curve[cell, 1] + t * (curve[cell, 2] + t * curve[cell, 3]))
        rate = curve[cell, 1] + t * (2.0 * curve[cell, 2] + t * 3.0 * curve[cell, 3])
        t -= (value - x) / rate
    return float(curve[cell, 0] + t)


@njit()
def travel_along(
    curve: FloatArray, n: float, at: tuple[float, float, int, float], distance: float
) -> tuple[float, float, int, float]:
    """Move by a signed distance (in 1/rho) without reversal inside.

    A place is (s, x, cell, direction of the motion that led there).
    """
    s, x, cell, direction = at
    if distance * direction < 0.0:
        x, direction = -x, -direction
        cell = cell_of(x)
        s = place(curve, n, x, cell)
    s += abs(distance)
    while cell < LAST and s > curve[cell + 1, 0]:
        cell += 1
    if cell == LAST:
        beyond = n * (s - curve[LAST, 0])
        x = 1.0 - SATURATED * math.exp(-beyond) if beyond < CLOSED else 1.0
    else:
        t = s - curve[cell, 0]
        x = NODES[cell] + t * (curve[cell, 1] + t * (curve[cell, 2] + t * curve[cell, 3]))
    return s, x, cell, direction


@njit()
def turning_point(u0: float, v0: float, u1: float, v1: float, dt: float) -> float:
    """Extension (m) where a step from (u0, v0) to (u1, v1) turns: a straight line through both speeds crosses zero."""
    before = dt * v0 / (v0 - v1)
    return 0.5 * (u0 + 0.5 * v0 * before + u1 - 0.5 * v1 * (dt - before))


@njit()
def closing_m(u: FloatArray, v: FloatArray, first: int, warm: int) -> float:
    """Way (m) from the last sample of a cycle to its first; none where whole samples already overlap the cycle."""
    way = u[first] - u[first + warm - 1]
    return float(way) if way * v[first] > 0.0 else 0.0


Place = tuple[float, float, int, float]


@njit()
def _rate(curve: FloatArray, n: float, s: float, x: float, cell: int) -> float:
    """f(x) as the slope of the curve."""
    if cell == LAST:
        return n * (1.0 - x)
    t = s - curve[cell, 0]
    return float(curve[cell, 1] + t * (2.0 * curve[cell, 2] + t * 3.0 * curve[cell, 3]))


@njit()
def _slopes_at(curve: FloatArray, slopes: FloatArray, n: float, at: Place) -> tuple[float, float]:
    """S_sigma and S_n at a position, interpolated linearly within a cell."""
    s, x, cell, _ = at
    if cell == LAST:
        beyond = math.log(max(1.0 - x, 1e-300) / (1.0 - NODES[LAST])) / (n * n)
        return float(slopes[LAST, 0]), float(slopes[LAST, 1] + beyond)
    share = (s - curve[cell, 0]) / (curve[cell + 1, 0] - curve[cell, 0])
    by_sigma = slopes[cell, 0] + share * (slopes[cell + 1, 0] - slopes[cell, 0])
    return float(by_sigma), float(slopes[cell, 1] + share * (slopes[cell + 1, 1] - slopes[cell, 1]))


@njit()
def _turned(curve: FloatArray, slopes: FloatArray, n: float, at: Place, moving: FloatArray) -> Place:
    """Reverse the motion and convert the derivatives; `moving` is de/dln(rho), de/dsigma, de/dn."""
    s, x, cell, direction = at
    before, there = _rate(curve, n, s, x, cell), _slopes_at(curve, slopes, n, at)
    x, direction = -x, -direction
    cell = cell_of(x)
    s = place(curve, n, x, cell)
    at = (s, x, cell, direction)
    ratio, here = before / _rate(curve, n, s, x, cell), _slopes_at(curve, slopes, n, at)
    moving[0] = 0.0 - ratio * moving[0]
    moving[1] = here[0] - ratio * (moving[1] - there[0])
    moving[2] = here[1] - ratio * (moving[2] - there[1])
    return at


@njit()
def _move(curve: FloatArray, slopes: FloatArray, n: float, at: Place, moving: FloatArray, distance: float) -> Place:
    """Move by a signed distance (in 1/rho), reversing first if its sign changed; `moving` may be empty."""
    if moving.size > 0:
        if distance * at[3] < 0.0:
            at = _turned(curve, slopes, n, at, moving)
        moving[0] += abs(distance)
    return travel_along(curve, n, at, distance)


@njit(cache=True, nogil=True)
def _along(
    w: float,
    shape: tuple[float, float, float],
    u: FloatArray,
    v: FloatArray,
    stretches: FloatArray,
    moving: FloatArray,
    out: FloatArray,
) -> None:
    """Fill `out` with w at each sample and, if `moving` has shape (3,), its three derivatives.

    One loop serves both, and the warm-up, because numba would compile all called functions again for a second loop.
    `stretches` (k, 3) has the first sample, the sampling interval (s) and the warm-up of each motion, then the end.
    """
    rho, sigma, n = shape
    curve = loop_curve(sigma, n)
    slopes, cell, stretch, first, warm, dt = curve, cell_of(w), 0, 0, 0, 0.0
    start = (place(curve, n, w, cell), w, cell, 1.0)
    at, step, by_start = start, 0, (0.0, 0.0)
    if moving.size > 0:
        slopes = curve_slopes(sigma, n)
        by_start = _slopes_at(curve, slopes, n, start)
    while stretch < stretches.shape[0] - 1 and u.size > 0:
        if step == 0:
            first, dt, warm, at = int(stretches[stretch, 0]), stretches[stretch, 1], int(stretches[stretch, 2]), start
            if moving.size > 0:
                moving[0], (moving[1], moving[2]) = 0.0, by_start
        k = first + (step - warm if step >= warm else step)
        if step > 0:
            way = closing_m(u, v, first, warm) if k == first else u[k] - u[k - 1]
            if k > first and v[k - 1] * v[k] < 0.0:
                turn = turning_point(u[k - 1], v[k - 1], u[k], v[k], dt)
                at = _move(curve, slopes, n, at, moving, rho * (turn - u[k - 1]))
                way = u[k] - turn
            at = _move(curve, slopes, n, at, moving, rho * way)
        if step >= warm:
            s, x, cell, direction = at
            out[0, k] = x * direction
            if moving.size > 0:
                rate = direction * _rate(curve, n, s, x, cell) if x != 1.0 else 0.0
                by_sigma, by_n = _slopes_at(curve, slopes, n, at)
                out[1, k] = rate * moving[0] / rho
                out[2, k] = rate * (moving[1] - by_sigma)
                out[3, k] = rate * (moving[2] - by_n)
        step += 1
        if first + step - warm >= stretches[stretch + 1, 0]:
            stretch, step = stretch + 1, 0


def _stretches(u: FloatArray, dt: float, warm: int) -> FloatArray:
    """One motion as `_along` takes it."""
    return np.array([(0.0, dt, float(warm if warm > 1 else 0)), (float(u.size), 0.0, 0.0)])


def hysteresis_series(
    w: float, rho: float, sigma: float, n: float, u: FloatArray, v: FloatArray, dt: float, warm: int
) -> FloatArray:
    """Normalised hysteretic variable at each sample, shape (n,), between -1 and 1.

    Args:
        w: value at the first sample, or before the warm-up.
        rho: inverse of the yield displacement (1/m); see `has_curve` for what the parameters may be.
        sigma: shape of the loop (1).
        n: sharpness of the bend (1).
        u: extension (m), shape (n,).
        v: velocity (m/s), shape (n,).
        dt: sampling interval (s).
        warm: number of samples of one whole cycle that is run first, so the start has no effect; 0: no warm-up.
    """
    out: FloatArray = np.empty((1, u.size))
    _along(float(w), (float(rho), float(sigma), float(n)), u, v, _stretches(u, dt, warm), np.empty(0), out)
    return out.reshape(u.size)


def hysteresis_of(
    rho: float, sigma: float, n: float, motion: Motion | JoinedMotions, *, slope: bool
) -> FloatArray:
    """Normalised hysteretic variable along one motion or several, from w = 0 and warmed up by a cycle of each.

    Args:
        rho: inverse of the yield displacement (1/m); the shape must be one that `has_curve` accepts.
        sigma: shape of the loop (1).
        n: sharpness of the bend (1).
        motion: the motion.
        slope: whether the derivatives with respect to rho, sigma and n follow.

    Returns:
        Shape (1, samples), with the derivatives (4, samples).
    """
    out = np.empty((4 if slope else 1, motion.u_m.size))
    if isinstance(motion, JoinedMotions):
        stretches = motion.stretches
    else:
        stretches = _stretches(motion.u_m, motion.dt_s, motion.samples_per_cycle)
    moving = np.zeros(3 if slope else 0)
    _along(0.0, (float(rho), float(sigma), float(n)), motion.u_m, motion.v_m_s, stretches, moving, out)
    return out

"""Compiled force along whole recordings, after a cycle of warm-up, for every model.

The Bouc-Wen models without further states follow their loop's one curve (`loop_curve`); the others are integrated step
by step (`kernels.integrate`), with the same equations as the plant.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from rig.dampers.arrays import FloatArray
from rig.dampers.kernels import algebraic_force, hysteretic_force, integrate, loop_shape
from rig.dampers.kinds import KIND_MODIFIED_BOUC_WEN, KIND_VISCOELASTIC_PLASTIC
from rig.dampers.loop_curve import has_curve, hysteresis_series


@njit(cache=True)
def _step(
    kind: int,
    p: FloatArray,
    state: FloatArray,
    u: FloatArray,
    v: FloatArray,
    a: FloatArray,
    current: FloatArray,
    dt: float,
    start: int,
    stop: int,
) -> float:
    """Advance `state` from sample `start` to sample `stop`, `dt` (s) apart; where the motion then is, in m.

    Inside, velocity is the cubic that meets speed and acceleration at both ends.
    """
    slope = (v[stop] - v[start]) / dt
    c2 = (3.0 * slope - 2.0 * a[start] - a[stop]) / dt
    c3 = (a[start] + a[stop] - 2.0 * slope) / (dt * dt)
    motion = (u[start], v[start], a[start], c2, c3)
    integrate(kind, p, state, motion, v[stop], 0.5 * (current[start] + current[stop]), dt)
    return float(u[start] + dt * (v[start] + dt * (a[start] / 2.0 + dt * (c2 / 3.0 + dt * c3 / 4.0))))


@njit(cache=True)
def _warm_up(
    kind: int,
    p: FloatArray,
    state: FloatArray,
    u: FloatArray,
    v: FloatArray,
    a: FloatArray,
    current: FloatArray,
    dt: float,
    warm: int,
) -> None:
    """Run the first `warm` samples, one whole cycle, and on to the first again.

    A cycle is no whole number of samples, so the last step ends a fraction of a sample beside the first one: states
    that are positions move with it, or they would meet the first sample with a jump.
    """
    for k in range(1, warm):
        _step(kind, p, state, u, v, a, current, dt, k - 1, k)
    beside = u[0] - _step(kind, p, state, u, v, a, current, dt, warm - 1, 0)
    if kind in (KIND_MODIFIED_BOUC_WEN, KIND_VISCOELASTIC_PLASTIC):
        state[0] += beside
    if kind == KIND_VISCOELASTIC_PLASTIC:
        state[1] += beside


@njit(cache=True, nogil=True)
def force_series(
    kind: int,
    p: FloatArray,
    start: FloatArray,
    u: FloatArray,
    v: FloatArray,
    a: FloatArray,
    current: FloatArray,
    dt: float,
    warm: int,
) -> FloatArray:
    """Force (N), shape (n,), along a motion sampled every `dt` (s).

    Args:
        kind: `DamperModel.kind`.
        p: `DamperModel.vector(values)`.
        start: state at the first sample, or before the warm-up; not changed.
        u: extension about mid-stroke (m), shape (n,).
        v: velocity (m/s), shape (n,).
        a: acceleration (m/s^2), shape (n,).
        current: coil current after its lag (A), shape (n,).
        dt: sampling interval (s).
        warm: samples of one whole cycle that is run once before, so that the start is forgotten; 0 for none.
    """
    n = u.size
    force = np.empty(n)
    if kind < KIND_VISCOELASTIC_PLASTIC:
        for k in range(n):
            force[k] = algebraic_force(kind, p, u[k], v[k], a[k], current[k])
        return force
    rho, sigma, exponent, scale = loop_shape(kind, p)
    if has_curve(rho, sigma, exponent) and abs(start[0]) <= scale:
        w = hysteresis_series(start[0] / scale, rho, sigma, exponent, u, v, dt, warm)
        for k in range(n):
            force[k] = hysteretic_force(kind, p, scale * w[k], 0.0, u[k], v[k], current[k])
        return force
    state = start.copy()
    if warm > 1:
        _warm_up(kind, p, state, u, v, a, current, dt, warm)
    for k in range(n):
        if k > 0:
            _step(kind, p, state, u, v, a, current, dt, k - 1, k)
        force[k] = hysteretic_force(kind, p, state[0], state[1] if state.size > 1 else 0.0, u[k], v[k], current[k])
    return force

"""Compiled force kernels: one plant step for every model; `series` runs them along whole recordings.

The motion inside a step is the cubic of velocity that meets speed and acceleration at both ends, so the internal states
are integrated (classical Runge-Kutta, substeps by the state's own rate) much finer than the recording is sampled.
Parameters come as vectors in the order of `DamperModel.parameters`;
eta is carried but belongs to the coil (`lag_step`).
"""

from __future__ import annotations

import math

from numba import njit

from rig.dampers.arrays import FloatArray
from rig.dampers.kinds import (
    KIND_ASYMMETRIC,
    KIND_ASYMMETRIC_PRINTED,
    KIND_BINGHAM,
    KIND_BOUC_WEN,
    KIND_KWOK,
    KIND_MODIFIED_BOUC_WEN,
    KIND_NORMALIZED_BOUC_WEN,
    KIND_SYMMETRIC,
    KIND_THINNING_BOUC_WEN,
    KIND_VISCOELASTIC_PLASTIC,
)
from rig.dampers.rate_independent import travel_between

SATURATED = 0.999  # share of its limit from which the hysteretic variable only closes up
SUBSTEP_RATE = 0.5  # rate x substep: RK4 is then within 3e-4 of a relaxing state
MAXIMUM_SUBSTEPS = 400  # a sample; stiffer states (50,000 1/s at 250 Hz) belong to no damper


@njit(cache=True)
def _sign(x: float) -> float:
    if x > 0.0:
        return 1.0
    return -1.0 if x < 0.0 else 0.0


@njit(cache=True)
def lag_step(current: float, commanded: float, eta: float, dt: float) -> float:
    """Coil current (A) after `dt` (s) under a constant command (A): exact solution of equation (9), eta in 1/s."""
    return commanded + (current - commanded) * math.exp(-eta * dt)


@njit(cache=True)
def algebraic_force(kind: int, p: FloatArray, u: float, v: float, a: float, current: float) -> float:
    """Force (N) of a model without states at one instant; arguments as in `advance`."""
    if kind == KIND_BINGHAM:
        return float((p[0] + p[1] * current) * _sign(v) + (p[2] + p[3] * current) * v + p[4])
    if kind == KIND_KWOK:
        z = math.tanh(p[6] * v + p[7] * _sign(u))
        return float((p[0] + p[1] * current) * v + (p[2] + p[3] * current) * u + (p[4] + p[5] * current) * z + p[8])
    loop = p[3] if kind in (KIND_ASYMMETRIC, KIND_SYMMETRIC) else p[2] * p[3]
    y = p[2] * v + loop * _sign(u)
    if kind in (KIND_ASYMMETRIC, KIND_ASYMMETRIC_PRINTED):
        viscous = p[6] + p[8] * current if v >= 0.0 else p[7] + p[9] * current
        stiffness = p[10] + p[11] * current
    else:
        viscous = p[6] + p[7] * current
        stiffness = p[8] + p[9] * current
    return float(p[0] * a + p[1] + (p[4] + p[5] * current) * math.tanh(y) + viscous * v + stiffness * u)


@njit(cache=True)
def hysteretic_force(kind: int, p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> float:
    """Force (N) of a model with the states `s0` and `s1` at one instant; other arguments as in `advance`."""
    if kind == KIND_BOUC_WEN:
        return float((p[0] + p[1] * current) * v + p[2] * (u - p[3]) + (p[4] + p[5] * current) * s0)
    if kind == KIND_NORMALIZED_BOUC_WEN:
        return float(p[0] * u + (p[1] + p[2] * current) * v + (p[3] + p[4] * current) * s0 + p[5])
    if kind == KIND_THINNING_BOUC_WEN:
        yielding = p[3] + current * (p[4] + current * (p[9] + current * p[10]))
        thinning = p[11] + current * (p[12] + current * (p[13] + current * p[14]))
        viscous = (p[1] + p[2] * current) * v + thinning * math.tanh(v / p[15])
        return float(p[0] * u + viscous + yielding * s0 + p[5])
    if kind == KIND_MODIFIED_BOUC_WEN:
        alpha, c0, c1 = p[0] + p[1] * current, p[2] + p[3] * current, p[4] + p[5] * current
        y_rate = (alpha * s1 + c0 * v + p[6] * (u - s0)) / (c0 + c1)
        return float(c1 * y_rate + p[7] * (u - p[8]))
    return float(p[2] * (u - s1) + p[7])


@njit(cache=True)
def _bouc_wen_rate(z: float, v: float, gamma: float, beta: float, A: float, n: float) -> float:
    power = abs(z) ** (n - 1.0) if z != 0.0 else 0.0
    return -gamma * abs(v) * z * power - beta * v * abs(z) * power + A * v


@njit(cache=True)
def _rates(kind: int, p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
    if kind == KIND_BOUC_WEN:
        return _bouc_wen_rate(s0, v, p[6], p[7], p[8], p[9]), 0.0
    if kind in (KIND_NORMALIZED_BOUC_WEN, KIND_THINNING_BOUC_WEN):
        rho, sigma = p[6], p[7]
        return _bouc_wen_rate(s0, v, rho * sigma, rho * (1.0 - sigma), rho, p[8]), 0.0
    if kind == KIND_MODIFIED_BOUC_WEN:
        alpha, c0, c1 = p[0] + p[1] * current, p[2] + p[3] * current, p[4] + p[5] * current
        y_rate = (alpha * s1 + c0 * v + p[6] * (u - s0)) / (c0 + c1)
        return y_rate, _bouc_wen_rate(s1, v - y_rate, p[9], p[10], p[11], p[12])
    spring = p[2] * (u - s1)
    coulomb = p[4] + p[5] * current
    slip = (spring - coulomb * _sign(spring)) / (p[3] + p[6] * current) if abs(spring) > coulomb else 0.0
    return slip, slip + (spring - p[0] * (s1 - s0)) / p[1]


@njit(cache=True)
def _fastest_rate(kind: int, p: FloatArray, v: float, current: float) -> float:
    """Upper estimate (1/s) of how fast the internal state relaxes at speed `v`."""
    if kind == KIND_BOUC_WEN:
        total = p[6] + p[7]
        if total <= 0.0 or p[8] <= 0.0:
            return float(abs(p[8]))
        return float(p[8] * p[9] * abs(v) / (p[8] / total) ** (1.0 / p[9]))
    if kind in (KIND_NORMALIZED_BOUC_WEN, KIND_THINNING_BOUC_WEN):
        return float(p[6] * p[8] * abs(v) * max(1.0, abs(2.0 * p[7] - 1.0)))
    if kind == KIND_MODIFIED_BOUC_WEN:
        alpha, c0, c1 = p[0] + p[1] * current, p[2] + p[3] * current, p[4] + p[5] * current
        relax = (abs(alpha * p[11]) + abs(p[6])) / (c0 + c1)
        total = p[9] + p[10]
        if total <= 0.0 or p[11] <= 0.0:
            return float(relax)
        return float(relax + p[11] * p[12] * abs(v) / (p[11] / total) ** (1.0 / p[12]))
    return float(p[2] * (1.0 / p[1] + 1.0 / (p[3] + p[6] * current)) + p[0] / p[1])


@njit(cache=True)
def loop_shape(kind: int, p: FloatArray) -> tuple[float, float, float, float]:
    """The rate-independent hysteresis: rho (1/m; 0 where there is none), sigma, n, and the limit of its variable."""
    if kind in (KIND_NORMALIZED_BOUC_WEN, KIND_THINNING_BOUC_WEN):
        return p[6], p[7], p[8], 1.0
    if kind == KIND_BOUC_WEN and p[6] + p[7] > 0.0 and p[8] > 0.0:
        scale = (p[8] / (p[6] + p[7])) ** (1.0 / p[9])
        return p[8] / scale, p[6] / (p[6] + p[7]), p[9], scale
    return 0.0, 0.0, 0.0, 1.0


@njit(cache=True)
def _travel(kind: int, p: FloatArray, state: FloatArray, u0: float, v0: float, u1: float, v1: float, dt: float) -> bool:
    """Advance a rate-independent state along the path; False where the model or its parameters do not allow it."""
    rho, sigma, n, scale = loop_shape(kind, p)
    if not (rho > 0.0 and sigma >= 0.0 and n >= 1.0):
        return False
    state[0] = scale * travel_between(state[0] / scale, u0, v0, u1, v1, dt, rho, sigma, n)
    return True


@njit(cache=True)
def _modified_step(
    p: FloatArray, state: FloatArray, motion: tuple[float, float, float, float, float], current: float, dt: float
) -> None:
    """Advance (y, z) of the modified Bouc-Wen model over one step, in steps as long as the loop's bend allows.

    With z saturated, only y moves, and z closes up as exp(-n rho s) with the distance s; a step then ends at the next
    reversal of u' - y' at the latest. Elsewhere classical Runge-Kutta, by the fastest rate of the state as it is.
    """
    u0, v0, c1, c2, c3 = motion
    alpha, c_sum = p[0] + p[1] * current, p[2] + p[3] * current + p[4] + p[5] * current
    c0, n, z0 = p[2] + p[3] * current, p[12], (p[11] / (p[9] + p[10])) ** (1.0 / p[12])
    steepness = p[11] / z0 * n * max(1.0, abs(p[9] - p[10]) / (p[9] + p[10]))
    relaxing = (abs(alpha * p[11]) + abs(p[6])) / c_sum
    shortest = dt / MAXIMUM_SUBSTEPS
    t = 0.0
    while t < dt:
        y, z, left = state[0], state[1], dt - t
        u = u0 + t * (v0 + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0)))
        v = v0 + t * (c1 + t * (c2 + t * c3))
        slip = v - (alpha * z + c0 * v + p[6] * (u - y)) / c_sum
        direction = 1.0 if slip >= 0.0 else -1.0
        if direction * z / z0 > SATURATED:
            smooth = min(left, SUBSTEP_RATE * c_sum / max(abs(p[6]), 1e-30))
            h = min(left, max(_until_reversal(p, state, motion, current, t, smooth, slip), shortest))
            middle = t + 0.5 * h
            u_b = u0 + middle * (v0 + middle * (c1 / 2.0 + middle * (c2 / 3.0 + middle * c3 / 4.0)))
            v_b = v0 + middle * (c1 + middle * (c2 + middle * c3))
            y_b = y + 0.5 * h * (v - slip)
            rate = (alpha * z + c0 * v_b + p[6] * (u_b - y_b)) / c_sum
            state[0] = y + h * rate
            close = math.exp(-n * p[11] / z0 * abs(v_b - rate) * h)
            state[1] = direction * z0 * (1.0 - (1.0 - direction * z / z0) * close)
            t += h
            continue
        end = t + left
        fastest = max(abs(slip), abs(v0 + end * (c1 + end * (c2 + end * c3)) - v + slip))
        h = min(left, max(SUBSTEP_RATE / (relaxing + steepness * fastest), shortest))
        _runge_kutta(KIND_MODIFIED_BOUC_WEN, p, state, motion, current, t, h)
        t += h


@njit(cache=True)
def _until_reversal(
    p: FloatArray,
    state: FloatArray,
    motion: tuple[float, float, float, float, float],
    current: float,
    t: float,
    h: float,
    slip: float,
) -> float:
    """Time (s) until u' - y' reverses with z held, `h` if it does not; by one chord."""
    u0, v0, c1, c2, c3 = motion
    end = t + h
    u = u0 + end * (v0 + end * (c1 / 2.0 + end * (c2 / 3.0 + end * c3 / 4.0)))
    v = v0 + end * (c1 + end * (c2 + end * c3))
    c0, c_sum = p[2] + p[3] * current, p[2] + p[3] * current + p[4] + p[5] * current
    later = v - ((p[0] + p[1] * current) * state[1] + c0 * v + p[6] * (u - state[0])) / c_sum
    return h if later * slip > 0.0 else h * slip / (slip - later)


@njit(cache=True)
def _runge_kutta(
    kind: int,
    p: FloatArray,
    state: FloatArray,
    motion: tuple[float, float, float, float, float],
    current: float,
    t: float,
    h: float,
) -> None:
    """One classical Runge-Kutta step of `h` (s) from `t` (s) into the motion's step, in place."""
    u0, v0, c1, c2, c3 = motion
    s0 = state[0]
    s1 = state[1] if state.size > 1 else 0.0
    u_a = u0 + t * (v0 + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0)))
    v_a = v0 + t * (c1 + t * (c2 + t * c3))
    t += 0.5 * h
    u_b = u0 + t * (v0 + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0)))
    v_b = v0 + t * (c1 + t * (c2 + t * c3))
    t += 0.5 * h
    u_c = u0 + t * (v0 + t * (c1 / 2.0 + t * (c2 / 3.0 + t * c3 / 4.0)))
    v_c = v0 + t * (c1 + t * (c2 + t * c3))
    a0, a1 = _rates(kind, p, s0, s1, u_a, v_a, current)
    b0, b1 = _rates(kind, p, s0 + 0.5 * h * a0, s1 + 0.5 * h * a1, u_b, v_b, current)
    d0, d1 = _rates(kind, p, s0 + 0.5 * h * b0, s1 + 0.5 * h * b1, u_b, v_b, current)
    e0, e1 = _rates(kind, p, s0 + h * d0, s1 + h * d1, u_c, v_c, current)
    state[0] = s0 + h / 6.0 * (a0 + 2.0 * b0 + 2.0 * d0 + e0)
    if state.size > 1:
        state[1] = s1 + h / 6.0 * (a1 + 2.0 * b1 + 2.0 * d1 + e1)


@njit(cache=True)
def integrate(
    kind: int,
    p: FloatArray,
    state: FloatArray,
    motion: tuple[float, float, float, float, float],
    v_end: float,
    current: float,
    dt: float,
) -> None:
    """Advance `state` over one step; `motion` is u0, v0 and the coefficients of v(t) = v0 + c1 t + c2 t^2 + c3 t^3."""
    u0, v0, c1, c2, c3 = motion
    u_end = u0 + dt * (v0 + dt * (c1 / 2.0 + dt * (c2 / 3.0 + dt * c3 / 4.0)))
    if _travel(kind, p, state, u0, v0, u_end, v_end, dt):
        return
    if kind == KIND_MODIFIED_BOUC_WEN and p[9] + p[10] > 0.0 and p[11] > 0.0 and p[12] >= 1.0:
        _modified_step(p, state, motion, current, dt)
        return
    rate = _fastest_rate(kind, p, max(abs(v0), abs(v_end)), current)
    substeps = int(min(float(MAXIMUM_SUBSTEPS), max(1.0, math.ceil(rate * dt / SUBSTEP_RATE))))
    h = dt / substeps
    for k in range(substeps):
        _runge_kutta(kind, p, state, motion, current, k * h, h)


@njit(cache=True)
def advance(
    kind: int, p: FloatArray, state: FloatArray, u: float, v: float, a: float, current: float, dt: float
) -> float:
    """Force (N) at the end of one step of `dt` (s); `state` is moved along in place.

    Args:
        kind: `DamperModel.kind`.
        p: `DamperModel.vector(values)`.
        state: `DamperModel.initial_state()`, kept by the caller between steps.
        u: extension about mid-stroke (m) at the end of the step.
        v: velocity (m/s) at the end of the step.
        a: acceleration (m/s^2), taken as constant over the step.
        current: coil current after its lag (A).
        dt: step (s); 0 returns the force without moving the state.
    """
    if kind < KIND_VISCOELASTIC_PLASTIC:
        return algebraic_force(kind, p, u, v, a, current)
    if dt > 0.0:
        v0 = v - a * dt
        integrate(kind, p, state, (u - v * dt + 0.5 * a * dt * dt, v0, a, 0.0, 0.0), v, current, dt)
    return hysteretic_force(kind, p, state[0], state[1] if state.size > 1 else 0.0, u, v, current)

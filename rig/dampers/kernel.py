"""The models compiled: one plant step, and the force along whole recordings after a cycle of warm-up.

A model gives a `Kernel`, the functions of one instant; here they are integrated. The motion inside a step is the cubic
of velocity that meets speed and acceleration at both ends (`motion_between`), so the internal states are integrated
(classical Runge-Kutta, substeps by the state's own rate) much finer than the recording is sampled. A rate-independent
hysteresis needs no time: it depends on the distance travelled; along whole recordings it follows its loop's one curve
(`loop_curve`). Parameters come as vectors in the order of `DamperModel.parameters`; eta is carried but belongs to the
coil.

Numba does not notice when a function that a cached one calls has changed, so only whole loops are `cached`, one for
each model, each a closure over this room's `fingerprint`: another fingerprint, another cache entry. What a cached loop
calls is not cached itself but part of it (see `compiled_cache.njit`).
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, Literal

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.compiled_cache import njit
from rig.dampers.integrable import Integrable
from rig.dampers.loop_curve import has_curve, hysteresis_series
from rig.dampers.sampled_motion import Motion, between_samples

SUBSTEP_RATE = 0.5  # rate x substep: RK4 is then within 3e-4 of a relaxing state
MAXIMUM_SUBSTEPS = 400  # a sample; stiffer states (50,000 1/s at 250 Hz) belong to no damper
LONGEST_STEP = 0.1  # of a loop's path, in 1/rho
STEP_OF_EXPONENT = 0.3  # the same, times the exponent
SATURATED = 0.999  # share of its limit from which the hysteretic variable only closes up

Compiled = Callable[..., Any]
"""A function compiled by numba."""
Instant = tuple[float, float, float]
"""Extension (m about mid-stroke), velocity (m/s) and acceleration (m/s^2) at one instant."""
ForceTarget = tuple[float, float]
"""A force (N) and its rate (N/s)."""


@njit()
def sign(x: float) -> float:
    """-1, 0 or 1."""
    if x > 0.0:
        return 1.0
    return -1.0 if x < 0.0 else 0.0


@njit()
def bouc_wen_rate(z: float, v: float, gamma: float, beta: float, A: float, n: float) -> float:
    """Rate of the Bouc-Wen hysteresis, z' = -gamma |v| z |z|^(n-1) - beta v |z|^n + A v."""
    power = abs(z) ** (n - 1.0) if z != 0.0 else 0.0
    return -gamma * abs(v) * z * power - beta * v * abs(z) * power + A * v


@njit()
def _no_rates(p: FloatArray, s0: float, s1: float, u: float, v: float, current: float) -> tuple[float, float]:
    return 0.0, 0.0


@njit()
def _no_fastest_rate(p: FloatArray, v: float, current: float) -> float:
    return 0.0


@njit()
def _no_loop(p: FloatArray) -> tuple[float, float, float, float]:
    return 0.0, 0.0, 0.0, 1.0


@njit()
def _no_step(p: FloatArray, state: FloatArray, motion: Motion, current: float, dt: float) -> bool:
    return False


@dataclass(frozen=True)
class Kernel:
    """A model's equation, compiled: p are its parameters, s0 and s1 its internal states, u, v, a, current one instant.

    Attributes:
        force: (p, s0, s1, u, v, a, current) -> force (N).
        rates: (p, s0, s1, u, v, current) -> rates of s0 and s1 (1/s of their units).
        fastest_rate: (p, v, current) -> upper estimate (1/s) of how fast the internal state relaxes.
        loop: (p) -> the rate-independent hysteresis of s0: rho (1/m; 0 where there is none), sigma, n, and its limit.
        step: (p, state, motion, current, dt) -> whether it has advanced the state by an integrator of its own.
        held: (p, state, instant, current, wanted) -> the force (N) that the current upholds while a wanted one, force
            (N) and its rate (N/s), acts: for models whose current changes the force only after a while, through the
            states. None: `force` says it.
        whole: (p, state, u, v, a, current) -> force (N), for a model whose force needs more than two states; None:
            `force` says it.
    """

    force: Compiled
    rates: Compiled = _no_rates
    fastest_rate: Compiled = _no_fastest_rate
    loop: Compiled = _no_loop
    step: Compiled = _no_step
    held: Compiled | None = None
    whole: Compiled | None = None


@njit()
def _loop_slope(x: float, unloading: float, n: float) -> float:
    if x >= 0.0:
        return float(1.0 - x**n)
    return float(1.0 + unloading * (-x) ** n)


@njit()
def travel(w: float, distance: float, sigma: float, n: float) -> float:
    """Normalised hysteretic variable after a path without reversal.

    With x = w sgn(v) and s = rho |du| the Bouc-Wen hysteresis is dx/ds = 1 - x^n for x >= 0 (loading) and
    dx/ds = 1 + (2 sigma - 1) |x|^n for x < 0 (unloading). Only the bend of the loop needs small steps; once saturated,
    1 - x decays as exp(-n s). So the cost of a sample does not grow with its speed.

    Args:
        w: value before, between -1 and 1.
        distance: rho times the change of extension, with its sign (1).
        sigma: shape of the loop (1).
        n: sharpness of the bend (1).
    """
    direction = 1.0 if distance >= 0.0 else -1.0
    x, left = w * direction, abs(distance)
    unloading = 2.0 * sigma - 1.0
    longest = min(LONGEST_STEP, STEP_OF_EXPONENT / n)
    steep = longest / max(1.0, 1.0 + unloading)
    while left > 0.0:
        if x > SATURATED:
            return direction * (1.0 - (1.0 - x) * math.exp(-n * left))
        h = min(left, longest if x >= 0.0 else steep)
        a = _loop_slope(x, unloading, n)
        b = _loop_slope(x + 0.5 * h * a, unloading, n)
        c = _loop_slope(x + 0.5 * h * b, unloading, n)
        d = _loop_slope(x + h * c, unloading, n)
        x += h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        left -= h
    return direction * x


@njit()
def travel_between(
    w: float, u0: float, v0: float, u1: float, v1: float, dt: float, rho: float, sigma: float, n: float
) -> float:
    """Normalised hysteretic variable at the end of a step of `dt` (s) from (u0, v0) to (u1, v1), in m and m/s.

    Where the speed changes its sign, the path turns where a straight line through both speeds crosses zero.
    """
    if v0 * v1 >= 0.0:
        return travel(w, rho * (u1 - u0), sigma, n)
    before = dt * v0 / (v0 - v1)
    turn = 0.5 * (u0 + 0.5 * v0 * before + u1 - 0.5 * v1 * (dt - before))
    return travel(travel(w, rho * (turn - u0), sigma, n), rho * (u1 - turn), sigma, n)


@cache
def runge_kutta(rates: Compiled) -> Compiled:
    """One classical Runge-Kutta step, compiled: (p, state, motion, current, t, h) moves `state` by `h` (s) from `t`."""

    @njit()
    def step(p: FloatArray, state: FloatArray, motion: Motion, current: float, t: float, h: float) -> None:
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
        a0, a1 = rates(p, s0, s1, u_a, v_a, current)
        b0, b1 = rates(p, s0 + 0.5 * h * a0, s1 + 0.5 * h * a1, u_b, v_b, current)
        d0, d1 = rates(p, s0 + 0.5 * h * b0, s1 + 0.5 * h * b1, u_b, v_b, current)
        e0, e1 = rates(p, s0 + h * d0, s1 + h * d1, u_c, v_c, current)
        state[0] = s0 + h / 6.0 * (a0 + 2.0 * b0 + 2.0 * d0 + e0)
        if state.size > 1:
            state[1] = s1 + h / 6.0 * (a1 + 2.0 * b1 + 2.0 * d1 + e1)

    return step


@cache
def kernel_of(model: Integrable) -> Kernel:
    """A model's functions, made once: every loop that calls one calls the same one, compiled once in a process."""
    kernel: Kernel = model.kernel()
    return kernel


@cache
def of_state(kernel: Kernel, states: int) -> Compiled:
    """A model's force of its whole state, compiled: (p, state, u, v, a, current) -> force (N).

    Args:
        kernel: of the model.
        states: number of its internal states; `state` may be longer.
    """
    force = kernel.force
    if kernel.whole is not None:
        return kernel.whole

    @njit()
    def without(p: FloatArray, state: FloatArray, u: float, v: float, a: float, current: float) -> float:
        return float(force(p, 0.0, 0.0, u, v, a, current))

    @njit()
    def of_one(p: FloatArray, state: FloatArray, u: float, v: float, a: float, current: float) -> float:
        return float(force(p, state[0], 0.0, u, v, a, current))

    @njit()
    def of_two(p: FloatArray, state: FloatArray, u: float, v: float, a: float, current: float) -> float:
        return float(force(p, state[0], state[1], u, v, a, current))

    return (without, of_one, of_two)[min(states, 2)]


@cache
def mover(kernel: Kernel) -> Compiled:
    """Advance of a model's state over one step of a motion, compiled: (p, state, motion, v_end, current, dt).

    Parts that the model does not have are omitted, because compiling them would also take time.
    """
    loop, own_step, fastest_rate = kernel.loop, kernel.step, kernel.fastest_rate
    if kernel.loop is _no_loop and kernel.rates is _no_rates:

        @njit()
        def own(p: FloatArray, state: FloatArray, motion: Motion, v_end: float, current: float, dt: float) -> None:
            own_step(p, state, motion, current, dt)

        return own
    integrate = runge_kutta(kernel.rates)

    @njit()
    def integrated(p: FloatArray, state: FloatArray, motion: Motion, v_end: float, current: float, dt: float) -> None:
        if own_step(p, state, motion, current, dt):
            return
        rate = fastest_rate(p, max(abs(motion[1]), abs(v_end)), current)
        substeps = int(min(float(MAXIMUM_SUBSTEPS), max(1.0, math.ceil(rate * dt / SUBSTEP_RATE))))
        h = dt / substeps
        for k in range(substeps):
            integrate(p, state, motion, current, k * h, h)

    if kernel.loop is _no_loop:
        return integrated

    @njit()
    def move(p: FloatArray, state: FloatArray, motion: Motion, v_end: float, current: float, dt: float) -> None:
        u0, v0, c1, c2, c3 = motion
        rho, sigma, n, scale = loop(p)
        if rho > 0.0 and sigma >= 0.0 and n >= 1.0:
            u_end = u0 + dt * (v0 + dt * (c1 / 2.0 + dt * (c2 / 3.0 + dt * c3 / 4.0)))
            state[0] = scale * travel_between(state[0] / scale, u0, v0, u_end, v_end, dt, rho, sigma, n)
            return
        integrated(p, state, motion, v_end, current, dt)

    return move


@cache
def advance_of(model: Integrable) -> Compiled:
    """One plant step of a model, compiled: (p, state, u, v, a, current, dt) -> force (N) at the end of the step.

    p is `DamperModel.vector(values)`; `state` is `DamperModel.initial_state()`, kept by the caller between steps and
    moved along in place; u (m about mid-stroke), v (m/s) are those at the end of the step; a (m/s^2) is taken as
    constant over it; current (A) is the coil's after its lag; dt (s): 0 returns the force without moving the state.
    """
    kernel = kernel_of(model)
    force, move, has_states = of_state(kernel, model.states), mover(kernel), model.states > 0

    @njit()
    def advance(p: FloatArray, state: FloatArray, u: float, v: float, a: float, current: float, dt: float) -> float:
        if has_states and dt > 0.0:
            v0 = v - a * dt
            move(p, state, (u - v * dt + 0.5 * a * dt * dt, v0, a, 0.0, 0.0), v, current, dt)
        return float(force(p, state, u, v, a, current))

    return advance


@cache
def _sampled(move: Compiled) -> Compiled:
    """Advance of `state` between two samples, compiled: (p, state, u, v, a, current, dt, start, stop) -> place (m)."""

    @njit()
    def step(
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
        """Where the motion then is."""
        motion = between_samples(u, v, a, dt, start, stop)
        move(p, state, motion, v[stop], 0.5 * (current[start] + current[stop]), dt)
        u0, v0, c1, c2, c3 = motion
        return float(u0 + dt * (v0 + dt * (c1 / 2.0 + dt * (c2 / 3.0 + dt * c3 / 4.0))))

    return step


def sampled_step(model: Integrable) -> Compiled:
    """Advance of a model's state between two samples, compiled: (p, state, u, v, a, current, dt, start, stop)."""
    return _sampled(mover(kernel_of(model)))


ROOM = Path(__file__).parent


@cache
def fingerprint(room: Path = ROOM) -> int:
    """CRC-32 over a room's sources, by default this one's: what compiled loops that call its functions depend on."""
    crc = 0
    for source in sorted(room.glob("*.py")):
        crc = zlib.crc32(source.read_bytes(), crc)
    return crc


def key_of(model: Integrable) -> str:
    """What distinguishes compiled loops of a model from those of other models and other sources."""
    return f"{fingerprint()} {model.name} {model.hysteresis}"


def cached(loop: Compiled, error_model: Literal["python", "numpy"] = "python", **functions: Compiled) -> Compiled:
    """A whole loop compiled, and kept for the next process.

    Args:
        loop: a closure over what tells its versions apart, such as `key_of` a model, as plain values.
        error_model: numba's: what a division by zero does.
        functions: compiled functions that it calls by these global names; they are not part of what tells it apart.
    """
    named = FunctionType(loop.__code__, {**loop.__globals__, **functions}, loop.__name__, None, loop.__closure__)
    named.__qualname__ = loop.__qualname__
    return njit(cache=True, nogil=True, error_model=error_model)(named)


@cache
def series_of(model: Integrable) -> Compiled:
    """`force_series` of one model: (p, start, u, v, a, current, dt, warm).

    Only the required code is compiled: a model without states, or whose hysteresis follows the single curve, needs only
    its force.
    """
    loop = getattr(kernel_of(model).loop, "py_func", kernel_of(model).loop)
    states, positions = model.states, model.positions
    first_memory, memories = model.first_memory, model.memories

    def series(
        p: FloatArray,
        start: FloatArray,
        u: FloatArray,
        v: FloatArray,
        a: FloatArray,
        current: FloatArray,
        dt: float,
        warm: int,
    ) -> FloatArray:
        force = np.empty(u.size)
        rho, sigma, exponent, scale = loop(p)
        if states == 0:
            _pointwise_of(model)(p, start[:0], u, v, a, current, force)
        elif has_curve(rho, sigma, exponent) and abs(start[0]) <= scale:
            w = hysteresis_series(start[0] / scale, rho, sigma, exponent, u, v, dt, warm)
            _pointwise_of(model)(p, scale * w, u, v, a, current, force)
        else:
            state = start.copy()
            if warm > 1:
                state[first_memory : first_memory + memories] = np.mean(np.abs(v[:warm]))
            _stepwise_of(model)(p, state, u, v, a, current, dt, warm if warm > 1 else 0, positions, force)
        return force

    return series


@cache
def _pointwise_of(model: Integrable) -> Compiled:
    """Compiled force at samples with known states: (p, state, u, v, a, current, force); fills `force`."""
    return cached(_pointwise(key_of(model)), _force=of_state(kernel_of(model), model.states))


@cache
def _stepwise_of(model: Integrable) -> Compiled:
    """Compiled force along a motion, integrated step by step; see `_stepwise`."""
    force = of_state(kernel_of(model), model.states)
    return cached(_stepwise(key_of(model)), _force=force, _step=sampled_step(model))


_force: Compiled = _no_rates
_step: Compiled = _no_step
"""Compiled step of the model in the loop."""


def _pointwise(key: str) -> Compiled:
    def pointwise(
        p: FloatArray, s: FloatArray, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray, out: FloatArray
    ) -> None:
        state = np.zeros(1)
        for k in range(u.size + 0 * len(key)):
            if s.size > 0:
                state[0] = s[k]
            out[k] = _force(p, state, u[k], v[k], a[k], current[k])

    return pointwise


def _stepwise(key: str) -> Compiled:
    def stepwise(
        p: FloatArray,
        state: FloatArray,
        u: FloatArray,
        v: FloatArray,
        a: FloatArray,
        current: FloatArray,
        dt: float,
        warm: int,
        positions: int,
        force: FloatArray,
    ) -> None:
        for step in range(warm + u.size + 0 * len(key)):
            k = step - warm if step >= warm else step
            if step > 0:
                there = _step(p, state, u, v, a, current, dt, k - 1 if k > 0 else warm - 1, k)
                if k == 0:
                    # A cycle is not a whole number of samples: its last step ends a fraction of a sample from the first
                    # one: states that are positions move with it, or they would meet the first sample with a jump.
                    for place in range(positions):
                        state[place] += u[0] - there
            if step >= warm:
                force[k] = _force(p, state, u[k], v[k], a[k], current[k])

    return stepwise


def force_series(
    model: Integrable,
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
        model: the damper model.
        p: `DamperModel.vector(values)`.
        start: state at the first sample, or before the warm-up; not changed.
        u: extension about mid-stroke (m), shape (n,).
        v: velocity (m/s), shape (n,).
        a: acceleration (m/s^2), shape (n,).
        current: coil current after its lag (A), shape (n,).
        dt: sampling interval (s).
        warm: samples of one whole cycle that is run once before, so that the start is forgotten; 0 for none. A memory
            of the speed, which may last for several cycles, begins with the cycle's mean.
    """
    force: FloatArray = series_of(model)(p, start, u, v, a, current, dt, warm)
    return force

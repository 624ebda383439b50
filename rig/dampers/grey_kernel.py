"""The equation of a grey-box model, compiled: the physical model's kernel, the elements of the residual, its force."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.compiled_cache import njit
from rig.dampers.grey_regressors import BENDS, ELEMENTS, FADES, POWERS, RANGE, REGRESSORS, SLIP, SPEED, STROKE
from rig.dampers.kernel import Compiled, ForceTarget, Instant, Kernel, cached, fingerprint, kernel_of, mover, of_state
from rig.dampers.model import DamperModel
from rig.dampers.sampled_motion import Motion

SHARP, MIDDLE, ROUND = BENDS


@njit()
def fade(position: float) -> float:
    """1 inside the tested range, 0 from `FADES` beyond its end."""
    return float(min(1.0, max(0.0, (1.0 + FADES - abs(position)) / FADES)))


@njit()
def weight(p: FloatArray, place: float, y: float) -> float:
    """A weight (N) at a current y: the coefficients of 1, y, y^2 and ((1 - y) / 2)^4 begin at `place` of p."""
    k, low = int(place), 0.5 * (1.0 - y)
    return float(p[k] + y * (p[k + 1] + y * p[k + 2]) + p[k + 3] * low * low * low * low)


@njit()
def _nothing(p: FloatArray, state: FloatArray, x: float, y: float) -> float:
    return 0.0


def _slip(first: int, states: int) -> Compiled:
    @njit()
    def slip(p: FloatArray, state: FloatArray, x: float, y: float) -> float:
        total = 0.0
        for k in range(ELEMENTS):
            z = state[states + k]
            place = first + 2 * POWERS * k
            total += z * (weight(p, place, y) + weight(p, place + POWERS, y) * z * z)
        return total

    return slip


def _speed(first: int) -> Compiled:
    @njit()
    def speed(p: FloatArray, state: FloatArray, x: float, y: float) -> float:
        total = x * (weight(p, first, y) + weight(p, first + POWERS, y) * x * x)
        total += x * weight(p, first + 2 * POWERS, y) / math.hypot(x, SHARP)
        total += x * weight(p, first + 3 * POWERS, y) / math.hypot(x, MIDDLE)
        return float(total + x * weight(p, first + 4 * POWERS, y) / math.hypot(x, ROUND))

    return speed


def _stroke(first: int) -> Compiled:
    @njit()
    def stroke(p: FloatArray, state: FloatArray, x: float, y: float) -> float:
        high = weight(p, first + 3 * POWERS, y) + x * weight(p, first + 4 * POWERS, y)
        low = weight(p, first + POWERS, y) + x * (weight(p, first + 2 * POWERS, y) + x * high)
        return float(weight(p, first, y) + x * low)

    return stroke


def _elements(key: int) -> Compiled:
    def elements(u: FloatArray, travels: FloatArray, warm: int) -> FloatArray:
        state, out = np.zeros(travels.size + 0 * key), np.empty((u.size, travels.size))
        last = u[warm - 1] if warm > 1 else u[0]
        for step in range(warm + u.size):
            k = step - warm if step >= warm else step
            for j in range(travels.size):
                if step > 0:
                    state[j] = min(1.0, max(-1.0, state[j] + (u[k] - last) / travels[j]))
                if step >= warm:
                    out[k, j] = state[j]
            last = u[k]
        return out

    return elements


def elements_along(u: FloatArray, travels: FloatArray, warm: int) -> FloatArray:
    """States of the elements along a sampled motion, shape (n, elements).

    Args:
        u: extension (m), shape (n,).
        travels: of the elements (m), shape (elements,).
        warm: samples of one whole cycle that is run once before; up to 1 for none.
    """
    states: FloatArray = _compiled_elements()(u, travels, warm if warm > 1 else 0)
    return states


@cache
def _compiled_elements() -> Compiled:
    return cached(_elements(fingerprint()))


def _residual(parts_used: Sequence[str], first: int, states: int) -> Compiled:
    """(p, state, u, v, current) -> the residual force (N)."""
    middle, ends = first, first + len(RANGE)
    place, parts = ends + (ELEMENTS if SLIP in parts_used else 0), dict.fromkeys((SLIP, SPEED, STROKE), _nothing)
    for part in parts_used:
        made = {SLIP: lambda k: _slip(k, states), SPEED: _speed, STROKE: _stroke}[part]
        parts[part] = made(place)
        place += POWERS * len(REGRESSORS[part])
    slip, speed, stroke = parts[SLIP], parts[SPEED], parts[STROKE]

    @njit()
    def residual(p: FloatArray, state: FloatArray, u: float, v: float, current: float) -> float:
        r = (u - p[middle]) / p[middle + 1]
        s = v / p[middle + 2]
        y = (current - p[middle + 3]) / p[middle + 4]
        inside = fade(r) * fade(s) * fade(y)
        if inside <= 0.0:
            return 0.0
        y = min(1.0, max(-1.0, y))
        return float(inside * (slip(p, state, 0.0, y) + speed(p, state, s, y) + stroke(p, state, r, y)))

    return residual


def grey_kernel(base: DamperModel, parts: Sequence[str], first: int, states: int) -> Kernel:
    """The kernel of a grey-box model; its states are the physical model's, then those of the elements.

    Args:
        base: the physical model.
        parts: parts of the residual.
        first: place of the residual's first parameter in the kernel's vector.
        states: number of all states.
    """
    inner, own, elements = kernel_of(base), base.states, states - base.states
    residual, inner_force, move = _residual(parts, first, own), of_state(inner, own), mover(inner)
    travel = first + len(RANGE)

    @njit()
    def whole(p: FloatArray, state: FloatArray, u: float, v: float, a: float, current: float) -> float:
        return float(inner_force(p, state, u, v, a, current) + residual(p, state, u, v, current))

    @njit()
    def slipped(p: FloatArray, state: FloatArray, motion: Motion, dt: float) -> None:
        way = dt * (motion[1] + dt * (motion[2] / 2.0 + dt * (motion[3] / 3.0 + dt * motion[4] / 4.0)))
        for k in range(elements):
            state[own + k] = min(1.0, max(-1.0, state[own + k] + way / p[travel + k]))

    @njit()
    def only_slipped(p: FloatArray, state: FloatArray, motion: Motion, current: float, dt: float) -> bool:
        slipped(p, state, motion, dt)
        return True

    @njit()
    def step(p: FloatArray, state: FloatArray, motion: Motion, current: float, dt: float) -> bool:
        v_end = motion[1] + dt * (motion[2] + dt * (motion[3] + dt * motion[4]))
        move(p, state[:own], motion, v_end, current, dt)
        slipped(p, state, motion, dt)
        return True

    made = Kernel(inner.force, whole=whole)
    if states:
        made = replace(made, step=step if own else only_slipped)
    inner_held = inner.held
    if inner_held is None:
        return made

    @njit()
    def held(p: FloatArray, state: FloatArray, motion: Instant, current: float, target: ForceTarget) -> float:
        left = residual(p, state, motion[0], motion[1], current)
        # The spring of the physical model is stretched by its own force, not by the residual.
        own_target = (target[0] - left, target[1])
        return float(inner_held(p, state[:own], motion, current, own_target) + left)

    return replace(made, held=held)

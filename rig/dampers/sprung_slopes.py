"""Force of `sprung_bouc_wen` or `thixotropic_bouc_wen` with its slopes over every parameter, in one pass, compiled.

Each parameter's slope is carried through the same steps as the states (see `sprung_flow`): a stage solves law(v_p) =
k (rod - place), so the slope of v_p is what the parameter and the states' slopes do to that balance, over the balance's
slope in v_p. That is the parameter's column behind a low-pass of time constant (dF/dv_p)/k. What the fluid remembers
is the rod's speed, which no parameter changes.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.compiled_cache import njit
from rig.dampers.kernel import Compiled, cached, fingerprint
from rig.dampers.sampled_motion import between_samples
from rig.dampers.sprung_flow import (
    BEND,
    CURVED,
    EXPLICIT,
    FIRST_ENDS,
    MASS,
    OFFSET,
    RHO,
    SPRING,
    AtCurrent,
    Motion,
    Numbers,
    Stage,
    at_current,
    at_once,
    first_stage,
    kept,
    law,
    piston_speed,
    remember,
    remembered,
    remembering,
    rod_speed,
    second_stage,
    steps_in,
    turned,
)


@njit()
def balance_slopes(
    p: FloatArray, at: AtCurrent, now: tuple[float, float], stage: Stage, v: float, own: FloatArray
) -> Numbers:
    """What parameters by themselves do to law - k (rod - place) at a stage's end, into `own`, as long as p.

    Args:
        p: parameters.
        at: `at_current`.
        now: coil current (A) and remembered speed (m/s).
        stage: the stage.
        v: the piston's speed there (m/s).
        own: filled.

    Returns:
        Its slopes over the place before the stage, over w and over where the step began, and over v_p.
    """
    rod, base, part, began, w = stage
    current, speed = now
    share = kept(speed)
    u = base + part * v
    loop, by_start, by_path = turned(w, p[RHO] * (u - began))
    _, by_u, by_v, by_w = law(p, at, u, v, loop)
    viscous = 1.0 if at[0] > 0.0 else 0.0
    bend = math.asinh(v / p[BEND]) if at[3] > 0.0 else 0.0
    own[0], own[1], own[2], own[OFFSET] = u, share * viscous * v, viscous * v * current, 0.0
    own[4], own[5], own[6] = share * loop, loop * current, loop * current * current
    own[7], own[8] = u * loop, u * loop * current
    own[9], own[10] = bend, bend * current
    own[11], own[12] = bend * current * current, bend * current * current * current
    own[RHO] = by_w * by_path * (u - began)
    own[BEND] = -at[3] * v / (p[BEND] * math.hypot(v, p[BEND]))
    own[SPRING], own[MASS] = u - rod, 0.0
    if speed >= 0.0:
        own[CURVED] = u * u
    along = by_w * by_path * p[RHO]
    return by_u + p[SPRING] + along, by_w * by_start, -along, by_v + part * (by_u + p[SPRING] + along)


@njit()
def carried(
    p: FloatArray, state: FloatArray, slopes: FloatArray, room: FloatArray, motion: Motion, current: float, dt: float
) -> None:
    """`sprung_flow.moved`, also updating the slopes (2, parameters) of the piston position and of w.

    `room` (3, parameters) is scratch memory.
    """
    speed, own, by_last, by_first = remembered(state), room[0], room[1], room[2]
    at = at_current(p, current, speed)
    count = steps_in(p, at, state[1], motion, dt)
    h, begins = dt / count, at_once(state, motion)
    v = piston_speed(p, at, begins, motion[1])
    by_base, by_w, by_began, by_v = balance_slopes(p, at, (current, speed), begins, v, own)
    for q in range(p.size):
        by_last[q] = -(own[q] + (by_base + by_began) * slopes[0, q] + by_w * slopes[1, q]) / by_v
    for k in range(count):
        t = k * h
        rods = rod_speed(motion, t), rod_speed(motion, t + FIRST_ENDS * h), rod_speed(motion, t + h)
        speeds = remembering(state, motion, t, h)
        at = at_current(p, current, speeds[0])
        early = first_stage(state, motion, t, h, v)
        first = piston_speed(p, at, early, v + rods[1] - rods[0])
        by_base, by_w, by_began, by_v = balance_slopes(p, at, (current, speeds[0]), early, first, own)
        for q in range(p.size):
            of_base = slopes[0, q] + early[2] * by_last[q]
            by_first[q] = -(own[q] + by_base * of_base + by_began * slopes[0, q] + by_w * slopes[1, q]) / by_v
        at = at_current(p, current, speeds[1])
        late = second_stage(early, motion, t, h, v + first)
        v = piston_speed(p, at, late, first + rods[2] - rods[1])
        by_base, by_w, by_began, by_v = balance_slopes(p, at, (current, speeds[1]), late, v, own)
        rod, base, part, began, w = late
        now = base + part * v
        end, by_start, by_path = turned(w, p[RHO] * (now - began))
        for q in range(p.size):
            before = EXPLICIT * h * (by_last[q] + by_first[q])
            of_base = slopes[0, q] + before
            by_last[q] = -(own[q] + by_base * of_base + by_began * slopes[0, q] + by_w * slopes[1, q]) / by_v
            way = before + part * by_last[q]
            slopes[0, q] += way
            slopes[1, q] = by_start * slopes[1, q] + by_path * p[RHO] * way
        slopes[1, RHO] += by_path * (now - began)
        state[0], state[1] = rod - now, end
        remember(state, speeds[1])


@cache
def slopes_along() -> Compiled:
    """Force (N), (n,), and its slopes over the parameters, (n, parameters), along a sampled motion.

    The arguments are those of `rig.dampers.kernel.series_of`: (p, start, u, v, a, current, dt, warm).
    """
    compiled = compiled_pass()

    def along(
        p: FloatArray,
        start: FloatArray,
        u: FloatArray,
        v: FloatArray,
        a: FloatArray,
        current: FloatArray,
        dt: float,
        warm: int,
    ) -> tuple[FloatArray, FloatArray]:
        state, slopes, room = start.copy(), np.zeros((2, p.size)), np.empty((3, p.size))
        if state.size > 2 and warm > 0:
            state[2] = np.mean(np.abs(v[:warm]))
        force, columns = np.empty(u.size), np.empty((u.size, p.size))
        compiled(p, state, slopes, room, u, v, a, current, dt, warm, force, columns)
        return force, columns

    return along


@cache
def compiled_pass() -> Compiled:
    """The compiled pass; fills `force` and `columns`. Compiling the allocation of arrays would take seconds."""
    return cached(_pass(f"{fingerprint()} sprung_bouc_wen"))


def _pass(key: str) -> Compiled:
    def slopes_along(
        p: FloatArray,
        state: FloatArray,
        slopes: FloatArray,
        room: FloatArray,
        u: FloatArray,
        v: FloatArray,
        a: FloatArray,
        current: FloatArray,
        dt: float,
        warm: int,
        force: FloatArray,
        columns: FloatArray,
    ) -> None:
        for step in range(u.size + warm + 0 * len(key)):
            k = step - warm if step >= warm else step
            if step > 0:
                last = k - 1 if k > 0 else warm - 1
                motion = between_samples(u, v, a, dt, last, k)
                carried(p, state, slopes, room, motion, 0.5 * (current[last] + current[k]), dt)
            if step >= warm:
                force[k] = p[OFFSET] + p[SPRING] * state[0] + p[MASS] * a[k]
                for q in range(p.size):
                    columns[k, q] = -p[SPRING] * slopes[0, q]
                columns[k, OFFSET] += 1.0
                columns[k, SPRING] += state[0]
                columns[k, MASS] += a[k]

    return slopes_along

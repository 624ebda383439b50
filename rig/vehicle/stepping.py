"""A car's motion over a road, compiled: TR-BDF2 in fixed steps, dampers solved for at the end of each stage.

Bank, Coughran, Fichtner et al. 1985 (IEEE Trans. Electron Devices 32, 1992-2007): a trapezoidal stage to t + g h and a
BDF2 stage to t + h, g = 2 - sqrt(2); second order, and stiff parts die out (L-stable), so a damper whose force all but
jumps with the sign of its speed comes to rest instead of ringing. Both stages are the same equations: with b = g h / 2

    q1 = qa + b v1,   M v1 = M va + b f1,   S v1 = M va + b (P - K qa - sum_i w_i T_i),   S = M + b C + b^2 K

In the dampers' speeds s = W v1 only as many unknowns are left as there are corners: s = s0 - b H T(s), H = W S^-1 W'
(`corner_speeds`). Stops and lifted tyres are soft beside a step and taken from where the step begins.
"""

from __future__ import annotations

import math
import zlib
from functools import cache
from pathlib import Path

import numpy as np

from rig.dampers import DamperModel
from rig.dampers.arrays import FloatArray
from rig.dampers.compiled_cache import njit
from rig.dampers.kernel import Compiled, cached, fingerprint
from rig.vehicle.corner_speeds import (
    ACCELERATION,
    BESIDE_N,
    COIL_SHARE,
    CURRENT_A,
    DAMPER,
    DAMPING,
    EXTENSION,
    FORCE_N,
    FREE,
    FREE_SPEED,
    FROM_EXTENSION,
    FROM_PLACE,
    FROM_VELOCITY,
    HEIGHT,
    JOUNCE,
    MASS,
    MASS_INVERSE,
    PLACE,
    REBOUND,
    REST_N,
    RIGHT,
    ROAD_M,
    ROAD_M_S,
    SPEED,
    SPEED_BEFORE,
    STAGE_INVERSE,
    STAGE_PLACE,
    STAGE_VELOCITY,
    STATIC_N,
    STIFFNESS,
    STOP_N_M,
    TOTAL_N,
    TYRE_N_M,
    TYRE_N_S_M,
    VELOCITY,
    Corners,
    Equations,
    Motion,
    halving_of,
    newton_of,
    pull_of,
)
from rig.vehicle.laws import requested_current

GAMMA = 2.0 - math.sqrt(2.0)
BEGUN = 1.0 / (GAMMA * (2.0 - GAMMA))
BEFORE = -((1.0 - GAMMA) ** 2) / (GAMMA * (2.0 - GAMMA))
"""Weights of the BDF2 stage: of the first stage's end and of the step's beginning."""


@njit()
def _times(matrix: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    """Out = matrix @ vector, for a few rows."""
    for i in range(matrix.shape[0]):
        total = 0.0
        for j in range(matrix.shape[1]):
            total += matrix[i, j] * vector[j]
        out[i] = total


@njit()
def _road_force(car: Equations, x: Motion, i: int) -> float:
    """What the road gives a tyre whose wheel stands still (N)."""
    force: float = car.wheels[TYRE_N_M, i] * x.corners[ROAD_M, i]
    force += car.wheels[TYRE_N_S_M, i] * x.corners[ROAD_M_S, i]
    return force


@njit()
def _pressed(car: Equations, x: Motion, i: int) -> float:
    """Load (N) on a tyre beyond that at rest, if it could pull as well."""
    wheel = x.degrees.shape[1] - car.wheels.shape[1] + i
    load: float = _road_force(car, x, i) - car.wheels[TYRE_N_M, i] * x.degrees[PLACE, wheel]
    load -= car.wheels[TYRE_N_S_M, i] * x.degrees[VELOCITY, wheel]
    return load


@njit()
def _stop_and_lift(car: Equations, x: Motion) -> None:
    """Generalised force of stops, and of tyres that would pull: what the linear equations have too much of."""
    c = car.wheels.shape[1]
    first = x.degrees.shape[1] - c
    for j in range(x.degrees.shape[1]):
        x.degrees[BESIDE_N, j] = 0.0
    for i in range(c):
        wheel = first + i
        jounce = x.degrees[PLACE, wheel]
        for j in range(first):
            jounce -= car.levers[HEIGHT, i, j] * x.degrees[PLACE, j]
        push = 0.0
        if jounce > car.wheels[JOUNCE, i]:
            push = car.wheels[STOP_N_M, i] * (jounce - car.wheels[JOUNCE, i])
        elif jounce < -car.wheels[REBOUND, i]:
            push = car.wheels[STOP_N_M, i] * (jounce + car.wheels[REBOUND, i])
        if push != 0.0:
            for j in range(first):
                x.degrees[BESIDE_N, j] += car.levers[HEIGHT, i, j] * push
            x.degrees[BESIDE_N, wheel] -= push
        pulled = -car.wheels[STATIC_N, i] - _pressed(car, x, i)
        if pulled > 0.0:
            x.degrees[BESIDE_N, wheel] += pulled


@njit()
def _balance(car: Equations, x: Motion) -> None:
    """Forces and accelerations at the end of a step."""
    c = car.wheels.shape[1]
    first = x.degrees.shape[1] - c
    _stop_and_lift(car, x)
    _times(car.square[STIFFNESS], x.degrees[PLACE], x.degrees[RIGHT])
    _times(car.square[DAMPING], x.degrees[VELOCITY], x.degrees[FREE])
    for j in range(x.degrees.shape[1]):
        x.degrees[TOTAL_N, j] = x.degrees[BESIDE_N, j] - x.degrees[RIGHT, j] - x.degrees[FREE, j]
        for i in range(c):
            x.degrees[TOTAL_N, j] -= car.levers[DAMPER, i, j] * x.corners[FORCE_N, i]
    for i in range(c):
        x.degrees[TOTAL_N, first + i] += _road_force(car, x, i)
    _times(car.square[MASS_INVERSE], x.degrees[TOTAL_N], x.degrees[ACCELERATION])


@njit()
def _free_motion(car: Equations, x: Motion, b: float, ending: bool) -> None:
    """Where a stage would end if the dampers pulled nothing, in `free`, `free_speed` and `from_extension`."""
    c = car.wheels.shape[1]
    place, velocity = x.degrees[PLACE], x.degrees[VELOCITY]
    for j in range(x.degrees.shape[1]):
        if ending:
            x.degrees[FROM_PLACE, j] = BEGUN * x.degrees[STAGE_PLACE, j] + BEFORE * place[j]
            x.degrees[FROM_VELOCITY, j] = BEGUN * x.degrees[STAGE_VELOCITY, j] + BEFORE * velocity[j]
        else:
            x.degrees[FROM_PLACE, j], x.degrees[FROM_VELOCITY, j] = place[j] + b * velocity[j], velocity[j]
    _times(car.square[MASS], x.degrees[FROM_VELOCITY], x.degrees[FREE])
    _times(car.square[STIFFNESS], x.degrees[FROM_PLACE], x.degrees[RIGHT])
    for j in range(x.degrees.shape[1]):
        begun = 0.0 if ending else x.degrees[TOTAL_N, j]
        x.degrees[RIGHT, j] = x.degrees[FREE, j] + b * (x.degrees[BESIDE_N, j] - x.degrees[RIGHT, j] + begun)
    for i in range(c):
        x.degrees[RIGHT, x.degrees.shape[1] - c + i] += b * _road_force(car, x, i)
    _times(car.square[STAGE_INVERSE], x.degrees[RIGHT], x.degrees[FREE])
    _times(car.levers[DAMPER], x.degrees[FREE], x.corners[FREE_SPEED])
    _times(car.levers[DAMPER], x.degrees[FROM_PLACE], x.corners[FROM_EXTENSION])


@njit()
def _end_stage(car: Equations, x: Motion, b: float, ending: bool) -> None:
    """Place and velocity at the end of a stage, the dampers' forces being known."""
    velocity, place = (VELOCITY, PLACE) if ending else (STAGE_VELOCITY, STAGE_PLACE)
    for j in range(x.degrees.shape[1]):
        for i in range(car.wheels.shape[1]):
            x.degrees[FREE, j] -= car.damper_answer[j, i] * x.corners[FORCE_N, i]
        x.degrees[velocity, j] = x.degrees[FREE, j]
        x.degrees[place, j] = x.degrees[FROM_PLACE, j] + b * x.degrees[FREE, j]


def _command(pull: Compiled) -> Compiled:
    """The coils' currents for the next step, compiled: a law's, behind the coil's lag."""

    @njit()
    def command(car: Equations, d: Corners, x: Motion) -> None:
        c = car.wheels.shape[1]
        for i in range(c):
            body = 0.0
            for j in range(x.degrees.shape[1] - c):
                body += car.levers[HEIGHT, i, j] * x.degrees[VELOCITY, j]
            passed, at_zero, at_most = d.coils[CURRENT_A, i], 0.0, 0.0
            if d.law[0] == 4.0:
                d.coils[CURRENT_A, i] = 0.0
                for tried in range(2):
                    at_zero = at_most
                    d.coils[CURRENT_A, i] = tried * d.law[1]
                    at_most = pull(d, i, x.corners[EXTENSION, i], x.corners[SPEED, i], 0.0, 0.0)
            wheel = x.degrees[VELOCITY, x.degrees.shape[1] - c + i]
            current_A = _current(d.law, body, wheel, car.levers[DAMPER, i, 0], at_zero, at_most)
            d.coils[CURRENT_A, i] = passed + d.coils[COIL_SHARE, i] * (current_A - passed)

    return command


_pulled: Compiled = math.sin
_current: Compiled = njit()(requested_current)
_newtons: Compiled = math.sin
_halves: Compiled = math.sin
_commands: Compiled = math.sin
"""Of the loop's dampers and laws, once `loop_of` has made it."""


@cache
def _sources() -> int:
    """CRC-32 over what the loop is made of in this room: another one, another entry of the compiled cache."""
    crc = 0
    for name in ("corner_speeds.py", "laws.py", "stepping.py"):
        crc = zlib.crc32(Path(__file__).with_name(name).read_bytes(), crc)
    return crc


@cache
def loop_of(front: DamperModel, rear: DamperModel) -> Compiled:
    """The loop over a whole road for these models, compiled: (Equations, Corners, Motion, road, dt) -> one row a step.

    road (k, 2 c): heights (m), then how fast they rise (m/s). A row: q, q', q'' (n each), then of every corner the
    damper's force beyond that at rest, extension, speed, current, and the tyre's load (c each).
    """
    key = f"{_sources()} {fingerprint()} {front.name} {front.hysteresis} {rear.name} {rear.hysteresis}"
    pull = pull_of(front, rear)
    return cached(
        _loop(key), error_model="numpy", _pulled=pull, _newtons=newton_of(pull), _halves=halving_of(pull),
        _commands=_command(pull), _free_motion=_free_motion, _end_stage=_end_stage, _balance=_balance, _times=_times,
        _write=_write,
    )  # fmt: skip


@njit()
def _write(car: Equations, d: Corners, x: Motion, row: FloatArray) -> None:
    """One row of the answer."""
    n, c = x.degrees.shape[1], car.wheels.shape[1]
    for j in range(n):
        row[j], row[n + j], row[2 * n + j] = x.degrees[PLACE, j], x.degrees[VELOCITY, j], x.degrees[ACCELERATION, j]
    for i in range(c):
        at = 3 * n + i
        row[at], row[at + c], row[at + 2 * c] = x.corners[FORCE_N, i], x.corners[EXTENSION, i], x.corners[SPEED, i]
        row[at + 3 * c] = d.coils[CURRENT_A, i]
        row[at + 4 * c] = max(0.0, car.wheels[STATIC_N, i] + _pressed(car, x, i))


def _loop(key: str) -> Compiled:
    def run(car: Equations, d: Corners, x: Motion, road: FloatArray, dt: float) -> FloatArray:
        n, c = x.degrees.shape[1], car.wheels.shape[1]
        b = 0.5 * GAMMA * dt + 0.0 * len(key)
        out = np.zeros((road.shape[0], 3 * n + 5 * c))
        for i in range(c):
            d.coils[CURRENT_A, i] = d.law[2]
            d.coils[REST_N, i] = 0.0
            d.coils[REST_N, i] = _pulled(d, i, 0.0, 0.0, 0.0, 0.0)
        for k in range(road.shape[0]):
            for i in range(c):
                x.corners[SPEED_BEFORE, i] = x.corners[SPEED, i]
            for stage in range(2 if k > 0 else 0):
                ending = stage == 1
                part = 1.0 if ending else GAMMA
                for i in range(c):
                    x.corners[ROAD_M, i] = road[k - 1, i] + part * (road[k, i] - road[k - 1, i])
                    x.corners[ROAD_M_S, i] = road[k - 1, c + i] + part * (road[k, c + i] - road[k - 1, c + i])
                _free_motion(car, x, b, ending)
                if not _newtons(car, d, x, b, part * dt):
                    _halves(car, d, x, b, part * dt)
                _end_stage(car, x, b, ending)
            if k > 0:
                for i in range(c):
                    for j in range(d.states.shape[1]):
                        d.states[i, j] = d.trial[i, j]
                _times(car.levers[DAMPER], x.degrees[PLACE], x.corners[EXTENSION])
                _times(car.levers[DAMPER], x.degrees[VELOCITY], x.corners[SPEED])
            _balance(car, x)
            _write(car, d, x, out[k])
            _commands(car, d, x)
        return out

    return run

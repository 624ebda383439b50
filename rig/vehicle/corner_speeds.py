"""Speeds and forces of a car's dampers at the end of a stage, compiled: s = s0 - b H T(s), as many unknowns as corners.

Newton's method; where that does not come to an end (a curve with a sharp bend or a jump), one corner after the other by
halving intervals. T rises with s, so a balance is between any two speeds of which one is too low and one too high.
"""

from __future__ import annotations

from typing import NamedTuple

from rig.dampers import DamperModel
from rig.dampers.arrays import FloatArray
from rig.dampers.compiled_cache import njit
from rig.dampers.kernel import Compiled, advance_of

NEWTON_STEPS = 12
SWEEPS = 60
TRIALS = 200
REACH_M_S = 1e-3
CLOSE_M_S = 1e-10
"""Residual of a damper's speed that is left."""
MASS, DAMPING, STIFFNESS, MASS_INVERSE, STAGE_INVERSE = range(5)
"""Matrices (n, n) of `Equations.square`: M, C, K and the inverses of M and S."""
HEIGHT, DAMPER = range(2)
"""Of `Equations.levers` (c, n): wheel heights B, dampers W."""
TYRE_N_M, TYRE_N_S_M, STATIC_N, JOUNCE, REBOUND, STOP_N_M = range(6)
"""Of `Equations.wheels` (c,): tyre, its load at rest, travel to both stops (m), their stiffness."""
REST_N, CURRENT_A, COIL_SHARE = range(3)
"""Of `Corners.coils` (c,): what a damper pulls at rest, its current, and its coil's way to the command in one step."""
PLACE, VELOCITY, ACCELERATION, TOTAL_N, BESIDE_N, STAGE_PLACE, STAGE_VELOCITY = range(7)
FROM_PLACE, FROM_VELOCITY, RIGHT, FREE = range(7, 11)
"""Of `Motion.degrees` (n,)."""
ROAD_M, ROAD_M_S, SPEED, SPEED_BEFORE, FREE_SPEED, EXTENSION, FROM_EXTENSION = range(7)
FORCE_N, SLOPE, RESIDUAL, CHANGE = range(7, 11)
"""Of `Motion.corners` (c,)."""


class Equations(NamedTuple):
    """A car with n degrees of freedom and c corners; in few arrays, of which the rows have names: it compiles faster.

    `corner_answer` is H (c, c), `damper_answer` b S^-1 W' (n, c).
    """

    square: FloatArray
    levers: FloatArray
    wheels: FloatArray
    corner_answer: FloatArray
    damper_answer: FloatArray


class Corners(NamedTuple):
    """The dampers: parameters in front and at the rear, states (c, s) and their trial, coils, `Control.vector`."""

    front: FloatArray
    rear: FloatArray
    states: FloatArray
    trial: FloatArray
    coils: FloatArray
    law: FloatArray


class Motion(NamedTuple):
    """What moves, and room to compute in: (11, n), (11, c), and the Jacobian (c, c)."""

    degrees: FloatArray
    corners: FloatArray
    jacobian: FloatArray


@njit()
def _eliminate(a: FloatArray, b: FloatArray, x: FloatArray) -> None:
    """Solve a x = b for a few unknowns by elimination; a (diagonal near 1 or above) and b are used up."""
    c = b.size
    for i in range(c):
        for j in range(i + 1, c):
            share = a[j, i] / a[i, i]
            for k in range(i, c):
                a[j, k] -= share * a[i, k]
            b[j] -= share * b[i]
    for i in range(c - 1, -1, -1):
        x[i] = b[i]
        for j in range(i + 1, c):
            x[i] -= a[i, j] * x[j]
        x[i] /= a[i, i]


def pull_of(front: DamperModel, rear: DamperModel) -> Compiled:
    """Force (N) of a damper beyond that at rest, from its state into its trial state, compiled.

    A row of states is as long as that of the damper with more of them; each damper gets its own, because models of one
    family tell by its length whether they have a memory.
    """
    same, in_front, at_rear = front is rear, max(1, front.states), max(1, rear.states)
    front_force, rear_force = advance_of(front), advance_of(rear)

    @njit()
    def pull(d: Corners, i: int, e: float, s: float, a: float, dt: float) -> float:
        for j in range(d.states.shape[1]):
            d.trial[i, j] = d.states[i, j]
        if same or i < (d.states.shape[0] + 1) // 2:
            force = front_force(d.front, d.trial[i, :in_front], e, s, a, d.coils[CURRENT_A, i], dt)
        else:
            force = rear_force(d.rear, d.trial[i, :at_rear], e, s, a, d.coils[CURRENT_A, i], dt)
        return float(force) - float(d.coils[REST_N, i])

    return pull


@njit()
def _residual(car: Equations, x: Motion, b: float) -> float:
    """How far (m/s) speeds and forces are from a balance, of each corner and the largest."""
    worst = 0.0
    for i in range(x.corners.shape[1]):
        x.corners[RESIDUAL, i] = x.corners[SPEED, i] - x.corners[FREE_SPEED, i]
        for j in range(x.corners.shape[1]):
            x.corners[RESIDUAL, i] += b * car.corner_answer[i, j] * x.corners[FORCE_N, j]
        worst = max(worst, abs(x.corners[RESIDUAL, i]))
    return worst


def newton_of(pull: Compiled) -> Compiled:
    """Damper speeds and forces at the end of a stage of `dt` (s) by Newton's method, compiled; whether it got there."""

    @njit()
    def newton(car: Equations, d: Corners, x: Motion, b: float, dt: float) -> bool:
        c = x.corners.shape[1]
        least, share = 1e300, 1.0
        for _ in range(NEWTON_STEPS):
            for i in range(c):
                s, a = x.corners[SPEED, i], (x.corners[SPEED, i] - x.corners[SPEED_BEFORE, i]) / dt
                x.corners[FORCE_N, i] = pull(d, i, x.corners[FROM_EXTENSION, i] + b * s, s, a, dt)
            worst = _residual(car, x, b)
            if worst < CLOSE_M_S:
                return True
            if worst > least:
                share *= 0.5
                for i in range(c):
                    x.corners[SPEED, i] += share * x.corners[CHANGE, i]
                continue
            least, share = worst, 1.0
            for i in range(c):
                off = 1e-7 + 1e-5 * abs(x.corners[SPEED, i])
                s = x.corners[SPEED, i] + off
                there = pull(d, i, x.corners[FROM_EXTENSION, i] + b * s, s, (s - x.corners[SPEED_BEFORE, i]) / dt, dt)
                x.corners[SLOPE, i] = (there - x.corners[FORCE_N, i]) / off
            for i in range(c):
                for j in range(c):
                    x.jacobian[i, j] = b * car.corner_answer[i, j] * x.corners[SLOPE, j]
                x.jacobian[i, i] += 1.0
            _eliminate(x.jacobian, x.corners[RESIDUAL], x.corners[CHANGE])
            for i in range(c):
                x.corners[SPEED, i] -= x.corners[CHANGE, i]
        return False

    return newton


def halving_of(pull: Compiled) -> Compiled:
    """The same by halving intervals, corner after corner, compiled: for curves that jump."""

    @njit()
    def halve(car: Equations, d: Corners, x: Motion, b: float, dt: float) -> None:
        c = x.corners.shape[1]
        for _ in range(SWEEPS):
            moved = 0.0
            for i in range(c):
                others, own = x.corners[FREE_SPEED, i], b * car.corner_answer[i, i]
                for j in range(c):
                    if j != i:
                        others -= b * car.corner_answer[i, j] * x.corners[FORCE_N, j]
                low, high, reach = x.corners[SPEED, i] - REACH_M_S, x.corners[SPEED, i] + REACH_M_S, REACH_M_S
                below, above = False, False
                for _trial in range(TRIALS):
                    s = 0.5 * (low + high) if below and above else (high if below else low)
                    a = (s - x.corners[SPEED_BEFORE, i]) / dt
                    force = pull(d, i, x.corners[FROM_EXTENSION, i] + b * s, s, a, dt)
                    too_fast = s - others + own * force > 0.0
                    if below and above:
                        low, high = (low, s) if too_fast else (s, high)
                        if high - low < 0.1 * CLOSE_M_S:
                            break
                        continue
                    reach *= 4.0
                    if too_fast:
                        high, above, low = s, True, low if below else s - reach
                    else:
                        low, below, high = s, True, high if above else s + reach
                moved = max(moved, abs(0.5 * (low + high) - x.corners[SPEED, i]))
                x.corners[SPEED, i] = 0.5 * (low + high)
                # Of a force that jumps, the one that leaves exactly this speed.
                x.corners[FORCE_N, i] = (others - x.corners[SPEED, i]) / own
            if moved < CLOSE_M_S:
                return

    return halve

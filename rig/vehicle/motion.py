"""A car's motion over a road, compiled: TR-BDF2 in fixed steps, dampers solved for at the end of each stage.

Bank, Coughran, Fichtner et al. 1985 (IEEE Trans. Electron Devices 32, 1992-2007): a trapezoidal stage to t + g h and a
BDF2 stage to t + h, g = 2 - sqrt(2); second order, and stiff parts die out (L-stable), so a damper whose force all but
jumps with the sign of its speed comes to rest instead of ringing. Both stages are the same equations: with b = g h / 2

    q1 = qa + b v1,   M v1 = M va + b f1,   S v1 = M va + b (P - K qa - sum_i w_i T_i),   S = M + b C + b^2 K

In the dampers' speeds s = W v1 only as many unknowns are left as there are corners: s = s0 - b H T(s), H = W S^-1 W'.
Newton's method solves that; where it does not come to an end (a curve with a sharp bend), one corner after the other by
halving intervals. Stops and lifted tyres are soft beside a step and taken from where the step begins.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from rig.dampers import DamperModel
from rig.dampers.arrays import FloatArray
from rig.dampers.compiled_cache import njit
from rig.dampers.kernel import advance_of, cached, fingerprint
from rig.vehicle.control import CONTROL, Control, wanted_current
from rig.vehicle.structure import Structure

GAMMA = 2.0 - math.sqrt(2.0)
NEWTON_STEPS = 12
SWEEPS = 60
HALVINGS = 60
CLOSE_M_S = 1e-10
"""Residual of a damper's speed that is left."""


@dataclass(frozen=True)
class CornerDamper:
    """A damper as one corner of a car has it.

    Attributes:
        model: the same object as plant and identifier use.
        values: complete parameters, SI.
    """

    model: DamperModel
    values: dict[str, float]

    @property
    def inertia_kg(self) -> float:
        """The rod's inertia, which becomes part of the car's mass matrix (kg)."""
        return sum(self.values[name] for name in self.model.of_term("inertia"))

    @property
    def vector(self) -> FloatArray:
        """Parameters in the kernel's order, without that inertia."""
        own = self.model.of_term("inertia")
        return self.model.vector({name: 0.0 if name in own else value for name, value in self.values.items()})

    @property
    def lag_1_s(self) -> float:
        """Rate of the coil's lag (1/s); infinite for a damper without one."""
        return self.values.get("eta", math.inf) or math.inf


@dataclass(frozen=True)
class Ride:
    """What a car did; time along the first axis, c corners, n degrees of freedom.

    Attributes:
        time_s: (k,).
        place: q (k, n), m and rad about rest.
        velocity: q' (k, n).
        acceleration: q'' (k, n).
        force_N: of the dampers, without what they pull at rest (k, c).
        extension_m: of the dampers (k, c).
        speed_m_s: of the dampers (k, c).
        current_A: in the coils (k, c).
        tyre_N: vertical load of the tyres (k, c); 0 where a tyre has left the road.
    """

    time_s: FloatArray
    place: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    force_N: FloatArray
    extension_m: FloatArray
    speed_m_s: FloatArray
    current_A: FloatArray
    tyre_N: FloatArray


@dataclass(frozen=True)
class DrivenCar:
    """A car with its dampers, ready to drive.

    Attributes:
        structure: its equations.
        front: damper of the front wheels, of a quarter car its only one.
        rear: of the rear wheels; None: the same as in front.
        control: what commands the coils.
    """

    structure: Structure
    front: CornerDamper
    rear: CornerDamper | None = None
    control: Control = CONTROL

    @property
    def dampers(self) -> tuple[CornerDamper, ...]:
        """The damper of each corner, (c,)."""
        in_front = -(-self.structure.corners // 2)
        rear = self.rear or self.front
        return tuple(self.front if corner < in_front else rear for corner in range(self.structure.corners))

    def drive(self, road_m: FloatArray, road_m_s: FloatArray, step_s: float) -> Ride:
        """Drive over a road from rest.

        Args:
            road_m: height under each wheel at t = 0, h, 2 h ... (k, c).
            road_m_s: how fast it rises there (k, c).
            step_s: h.

        Raises:
            ValueError: the road has another number of wheels, or is no finite numbers.
        """
        own = self.structure
        if road_m.shape != road_m_s.shape or road_m.ndim != 2 or road_m.shape[1] != own.corners:
            raise ValueError(f"a road under {own.corners} wheels is wanted, got arrays {road_m.shape}, {road_m_s.shape}")
        if not (np.all(np.isfinite(road_m)) and np.all(np.isfinite(road_m_s))):
            raise ValueError("the road is not all finite numbers")
        run = loop_of(self.front.model, (self.rear or self.front).model)
        front, rear = self.front, self.rear or self.front
        states = np.zeros((own.corners, max(1, front.model.states, rear.model.states)))
        rates = np.array([damper.lag_1_s for damper in self.dampers])
        out = run(
            *_matrices(own, self.dampers, step_s), own.stops, own.damper, own.static_load_N, front.vector, rear.vector,
            states, 1.0 - np.exp(-rates * step_s), self.control.vector, np.ascontiguousarray(road_m),
            np.ascontiguousarray(road_m_s), step_s,
        )
        n, c = len(own.mass), own.corners
        parts = np.split(out, np.cumsum([n, n, n, c, c, c, c]), axis=1)
        return Ride(np.arange(len(out)) * step_s, *parts)


def _matrices(own: Structure, dampers: tuple[CornerDamper, ...], step_s: float) -> tuple[FloatArray, ...]:
    """M, C, K, the inverse of S and of M, tyres and wheel heights as the loop takes them."""
    b = 0.5 * GAMMA * step_s
    mass = own.with_inerters(np.array([damper.inertia_kg for damper in dampers]))
    inverse = np.linalg.inv(mass + b * own.damping + b * b * own.stiffness)
    return (
        mass, own.damping, own.stiffness, np.linalg.inv(mass), inverse,
        own.damper @ inverse @ own.damper.T, own.corner_height, own.tyre_stiffness, own.tyre_damping,
    )


_front: Callable[..., Any] = math.sin
_rear: Callable[..., Any] = math.sin
_current: Callable[..., Any] = math.sin
"""Of the loop's dampers and laws, once `loop_of` has made it."""


@cache
def _sources() -> int:
    """CRC-32 over what the loop is made of in this room: another one, another entry of the compiled cache."""
    crc = 0
    for name in ("control.py", "motion.py"):
        crc = zlib.crc32(Path(__file__).with_name(name).read_bytes(), crc)
    return crc


@cache
def loop_of(front: DamperModel, rear: DamperModel) -> Callable[..., Any]:
    """The loop over a whole road for these models, compiled."""
    key = f"{_sources()} {fingerprint()} {front.name} {front.hysteresis} {rear.name} {rear.hysteresis}"
    return cached(
        _loop(key), error_model="numpy", _front=advance_of(front), _rear=advance_of(rear), _current=wanted_current,
        _solved=_solver(advance_of(front), advance_of(rear)), _beside=_beside, _times=_times,
    )


@njit()
def _times(matrix: FloatArray, vector: FloatArray, out: FloatArray) -> None:
    """Out = matrix @ vector, for a few rows."""
    for i in range(matrix.shape[0]):
        total = 0.0
        for j in range(matrix.shape[1]):
            total += matrix[i, j] * vector[j]
        out[i] = total


@njit()
def _beside(
    q: FloatArray, v: FloatArray, heights: FloatArray, stops: FloatArray, tyre_N_m: FloatArray, tyre_N_s_m: FloatArray,
    static_N: FloatArray, zr: FloatArray, vr: FloatArray, out: FloatArray,
) -> None:
    """Generalised force (n,) of stops, and of tyres that would pull: what the linear equations have too much of."""
    n, c = q.size, static_N.size
    out[:] = 0.0
    for i in range(c):
        wheel = n - c + i
        body = 0.0
        for j in range(n - c):
            body += heights[i, j] * q[j]
        jounce = q[wheel] - body
        push = 0.0
        if jounce > stops[i, 0]:
            push = stops[i, 2] * (jounce - stops[i, 0])
        elif jounce < -stops[i, 1]:
            push = stops[i, 2] * (jounce + stops[i, 1])
        if push != 0.0:
            for j in range(n - c):
                out[j] += heights[i, j] * push
            out[wheel] -= push
        pressed = tyre_N_m[i] * (zr[i] - q[wheel]) + tyre_N_s_m[i] * (vr[i] - v[wheel])
        if pressed < -static_N[i]:
            out[wheel] += -static_N[i] - pressed


@njit()
def _eliminated(a: FloatArray, b: FloatArray, x: FloatArray) -> None:
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


_solved: Callable[..., Any] = math.sin


def _solver(front: Callable[..., Any], rear: Callable[..., Any]) -> Callable[..., Any]:
    """Damper speeds and forces at the end of a stage, compiled."""

    @njit()
    def one(
        i: int, pf: FloatArray, pr: FloatArray, state: FloatArray, e: float, s: float, s_begin: float, current: float,
        dt: float,
    ) -> float:  # fmt: skip
        a = (s - s_begin) / dt if dt > 0.0 else 0.0
        if i < (state.shape[0] + 1) // 2:
            return float(front(pf, state[i], e, s, a, current, dt))
        return float(rear(pr, state[i], e, s, a, current, dt))

    @njit()
    def solved(
        pf: FloatArray, pr: FloatArray, states: FloatArray, moved: FloatArray, rest_N: FloatArray, h: FloatArray,
        b: float, ea: FloatArray, s0: FloatArray, s_begin: FloatArray, current: FloatArray, dt: float, s: FloatArray,
        force: FloatArray,
    ) -> None:  # fmt: skip
        c = s.size
        slope, residual = np.zeros(c), np.zeros(c)
        jacobian = np.zeros((c, c))
        scale = 1e300
        change = np.zeros(c)
        share = 1.0
        for _ in range(NEWTON_STEPS):
            for i in range(c):
                moved[i] = states[i]
                force[i] = one(i, pf, pr, moved, ea[i] + b * s[i], s[i], s_begin[i], current[i], dt) - rest_N[i]
            worst = 0.0
            for i in range(c):
                residual[i] = s[i] - s0[i]
                for j in range(c):
                    residual[i] += b * h[i, j] * force[j]
                worst = max(worst, abs(residual[i]))
            if worst < CLOSE_M_S:
                return
            if worst > scale:
                share *= 0.5
                for i in range(c):
                    s[i] += share * change[i]
                continue
            scale, share = worst, 1.0
            for i in range(c):
                off = 1e-7 + 1e-5 * abs(s[i])
                moved[i] = states[i]
                beside = one(
                    i, pf, pr, moved, ea[i] + b * (s[i] + off), s[i] + off, s_begin[i], current[i], dt
                ) - rest_N[i]
                slope[i] = (beside - force[i]) / off
            for i in range(c):
                for j in range(c):
                    jacobian[i, j] = b * h[i, j] * slope[j]
                jacobian[i, i] += 1.0
            _eliminated(jacobian, residual, change)
            for i in range(c):
                s[i] -= change[i]
        for _ in range(SWEEPS):
            moved_by = 0.0
            for i in range(c):
                others = s0[i]
                for j in range(c):
                    if j != i:
                        others -= b * h[i, j] * force[j]
                low, high = min(others, s[i]) - 1.0, max(others, s[i]) + 1.0
                for _widen in range(40):
                    moved[i] = states[i]
                    f = one(i, pf, pr, moved, ea[i] + b * low, low, s_begin[i], current[i], dt) - rest_N[i]
                    if low - others + b * h[i, i] * f < 0.0:
                        break
                    low -= 2.0 * (high - low)
                for _widen in range(40):
                    moved[i] = states[i]
                    f = one(i, pf, pr, moved, ea[i] + b * high, high, s_begin[i], current[i], dt) - rest_N[i]
                    if high - others + b * h[i, i] * f > 0.0:
                        break
                    high += 2.0 * (high - low)
                for _half in range(HALVINGS):
                    middle = 0.5 * (low + high)
                    moved[i] = states[i]
                    f = one(i, pf, pr, moved, ea[i] + b * middle, middle, s_begin[i], current[i], dt) - rest_N[i]
                    if middle - others + b * h[i, i] * f > 0.0:
                        high = middle
                    else:
                        low = middle
                before = s[i]
                s[i] = 0.5 * (low + high)
                # Of a force that jumps, the one that leaves exactly this speed.
                force[i] = (others - s[i]) / (b * h[i, i])
                moved_by = max(moved_by, abs(s[i] - before))
            if moved_by < CLOSE_M_S:
                return

    return solved


def _loop(key: str) -> Callable[..., Any]:
    def run(
        mass: FloatArray, damping: FloatArray, stiffness: FloatArray, mass_inverse: FloatArray, inverse: FloatArray,
        h: FloatArray, heights: FloatArray, tyre_N_m: FloatArray, tyre_N_s_m: FloatArray, stops: FloatArray,
        w: FloatArray, static_N: FloatArray, pf: FloatArray, pr: FloatArray, states: FloatArray, share: FloatArray,
        law: FloatArray, zr: FloatArray, vr: FloatArray, dt: float,
    ) -> FloatArray:  # fmt: skip
        n, c = mass.shape[0], static_N.size
        first = n - c
        half = (c + 1) // 2
        b = 0.5 * (2.0 - math.sqrt(2.0)) * dt + 0.0 * len(key)
        g = 2.0 - math.sqrt(2.0)
        c1, c0 = 1.0 / (g * (2.0 - g)), -((1.0 - g) ** 2) / (g * (2.0 - g))
        steps = zr.shape[0]
        out = np.zeros((steps, 3 * n + 5 * c))
        q, v = np.zeros(n), np.zeros(n)
        s, e = np.zeros(c), np.zeros(c)
        current, force, rest_N = np.zeros(c), np.zeros(c), np.zeros(c)
        moved, acceleration = np.zeros_like(states), np.zeros(n)
        extra, zg, vg = np.zeros(n), np.zeros(c), np.zeros(c)
        start = np.zeros(c)
        for i in range(c):
            current[i] = law[2]
            moved[i] = states[i]
            if i < half:
                rest_N[i] = _front(pf, moved[i], 0.0, 0.0, 0.0, current[i], 0.0)
            else:
                rest_N[i] = _rear(pr, moved[i], 0.0, 0.0, 0.0, current[i], 0.0)
        total, rhs, mva, free = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
        qa, vb, qg, vg_ = np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n)
        s0, ea = np.zeros(c), np.zeros(c)
        # What a damper's force takes from the velocity at the end of a stage: b S^-1 W'.
        given = b * (inverse @ w.T)
        for k in range(steps):
            if k > 0:
                start[:] = s
                for stage in range(2):
                    part = g if stage == 0 else 1.0
                    for i in range(c):
                        zg[i] = zr[k - 1, i] + part * (zr[k, i] - zr[k - 1, i])
                        vg[i] = vr[k - 1, i] + part * (vr[k, i] - vr[k - 1, i])
                    if stage == 0:
                        for j in range(n):
                            qa[j], vb[j] = q[j] + b * v[j], v[j]
                    else:
                        for j in range(n):
                            qa[j], vb[j] = c1 * qg[j] + c0 * q[j], c1 * vg_[j] + c0 * v[j]
                    _times(mass, vb, mva)
                    _times(stiffness, qa, rhs)
                    for j in range(n):
                        rhs[j] = mva[j] + b * (extra[j] - rhs[j] + (total[j] if stage == 0 else 0.0))
                    for i in range(c):
                        rhs[first + i] += b * (tyre_N_m[i] * zg[i] + tyre_N_s_m[i] * vg[i])
                    _times(inverse, rhs, free)
                    _times(w, free, s0)
                    _times(w, qa, ea)
                    _solved(pf, pr, states, moved, rest_N, h, b, ea, s0, start, current, part * dt, s, force)
                    for j in range(n):
                        for i in range(c):
                            free[j] -= given[j, i] * force[i]
                        if stage == 0:
                            vg_[j], qg[j] = free[j], qa[j] + b * free[j]
                        else:
                            v[j], q[j] = free[j], qa[j] + b * free[j]
                states[:, :] = moved
                _times(w, q, e)
                _times(w, v, s)
            _beside(q, v, heights, stops, tyre_N_m, tyre_N_s_m, static_N, zr[k], vr[k], extra)
            _times(stiffness, q, rhs)
            _times(damping, v, free)
            for j in range(n):
                total[j] = extra[j] - rhs[j] - free[j]
                for i in range(c):
                    total[j] -= w[i, j] * force[i]
            for i in range(c):
                total[first + i] += tyre_N_m[i] * zr[k, i] + tyre_N_s_m[i] * vr[k, i]
            _times(mass_inverse, total, acceleration)
            for j in range(n):
                out[k, j], out[k, n + j], out[k, 2 * n + j] = q[j], v[j], acceleration[j]
            for i in range(c):
                at = 3 * n + i
                out[k, at], out[k, at + c], out[k, at + 2 * c], out[k, at + 3 * c] = force[i], e[i], s[i], current[i]
                pressed = tyre_N_m[i] * (zr[k, i] - q[first + i]) + tyre_N_s_m[i] * (vr[k, i] - v[first + i])
                out[k, at + 4 * c] = max(0.0, static_N[i] + pressed)
                body = 0.0
                for j in range(first):
                    body += heights[i, j] * v[j]
                ratio = w[i, 0]
                at_zero, at_most = 0.0, 0.0
                if law[0] == 4.0:
                    moved[i] = states[i]
                    if i < half:
                        at_zero = _front(pf, moved[i], e[i], s[i], 0.0, 0.0, 0.0)
                        at_most = _front(pf, moved[i], e[i], s[i], 0.0, law[1], 0.0)
                    else:
                        at_zero = _rear(pr, moved[i], e[i], s[i], 0.0, 0.0, 0.0)
                        at_most = _rear(pr, moved[i], e[i], s[i], 0.0, law[1], 0.0)
                wanted = _current(law, body, v[first + i], ratio, at_zero - rest_N[i], at_most - rest_N[i])
                current[i] += share[i] * (wanted - current[i])
        return out

    return run

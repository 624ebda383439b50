"""How a sampled motion goes on between two of its samples, which internal states are integrated along."""

from __future__ import annotations

from rig.dampers.arrays import FloatArray
from rig.dampers.compiled_cache import njit

CORNER = 0.05  # of the speed: a mean speed that is missed by more, between two samples, is that of a corner
Motion = tuple[float, float, float, float, float]
"""u0, v0 and the coefficients of v(t) = v0 + c1 t + c2 t^2 + c3 t^3 inside a step."""


@njit()
def motion_between(
    u0: float, v0: float, a0: float, u1: float, v1: float, a1: float, dt: float, turns: bool
) -> Motion:
    """The motion from one sample to the next.

    Its velocity is the cubic that meets speed and acceleration at both. Where that does not lead to the next place,
    there is a corner between them, as in a triangle: `turns` asks for the parabola that meets both speeds and leads
    there.
    """
    slope = (v1 - v0) / dt
    c2 = (3.0 * slope - 2.0 * a0 - a1) / dt
    c3 = (a0 + a1 - 2.0 * slope) / (dt * dt)
    mean = (u1 - u0) / dt
    missed = mean - (v0 + dt * (a0 / 2.0 + dt * (c2 / 3.0 + dt * c3 / 4.0)))
    if not turns or abs(missed) <= CORNER * max(abs(v0), abs(v1)):
        return u0, v0, a0, c2, c3
    bend = 6.0 * (0.5 * (v0 + v1) - mean) / (dt * dt)
    return u0, v0, slope - bend * dt, bend, 0.0


@njit()
def between_samples(u: FloatArray, v: FloatArray, a: FloatArray, dt: float, start: int, stop: int) -> Motion:
    """The motion from a sample to the next, or from a cycle's last to its first, which is a part of a step away."""
    return motion_between(u[start], v[start], a[start], u[stop], v[stop], a[stop], dt, stop > start)

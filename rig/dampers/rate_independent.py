"""The Bouc-Wen hysteresis along a path: it depends on the distance travelled, not on time.

With x = w sgn(v) and s = rho |du|, w' = rho [v - sigma |v| |w|^(n-1) w + (sigma - 1) v |w|^n] becomes
dx/ds = 1 - x^n for x >= 0 (loading) and dx/ds = 1 + (2 sigma - 1) |x|^n for x < 0 (unloading).
Only the bend of the loop needs small steps; once saturated, 1 - x decays as exp(-n s). So the cost of a sample does not
grow with its speed, and a step may be as long as a sample.
"""

from __future__ import annotations

import math

from numba import njit

LONGEST_STEP = 0.1
STEP_OF_EXPONENT = 0.3
SATURATED = 0.999


@njit(cache=True)
def _slope(x: float, unloading: float, n: float) -> float:
    if x >= 0.0:
        return float(1.0 - x**n)
    return float(1.0 + unloading * (-x) ** n)


@njit(cache=True)
def travel(w: float, distance: float, sigma: float, n: float) -> float:
    """Normalised hysteretic variable after a path without reversal.

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
        a = _slope(x, unloading, n)
        b = _slope(x + 0.5 * h * a, unloading, n)
        c = _slope(x + 0.5 * h * b, unloading, n)
        d = _slope(x + h * c, unloading, n)
        x += h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
        left -= h
    return direction * x


@njit(cache=True)
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

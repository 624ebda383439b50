"""The generalised Bouc-Wen hysteresis over a path: it needs no time, and its cost does not grow with speed."""

from __future__ import annotations

import math

from rig.dampers.compiled_cache import njit

LONGEST_STEP = 0.1  # of the path, in 1/rho
STEP_OF_EXPONENT = 0.3  # the same, times the exponent
SATURATED = 0.99  # share of the end from which the hysteretic variable only closes up


@njit()
def _slope(x: float, unloading: float, ending: float, n: float) -> float:
    if x >= 0.0:
        return float(1.0 - ending * x**n)
    return float(1.0 + unloading * (-x) ** n)


@njit()
def leaning_travel(w: float, distance: float, sigma: float, n: float, phi: float) -> float:
    """Hysteretic variable after a path without reversal.

    With x = w sgn(v), d = sgn(v) and s = rho |du| the hysteresis is dx/ds = 1 - (1 + 2 phi d) x^n for x >= 0 and
    dx/ds = 1 + (2 sigma - 1) |x|^n for x < 0. It ends at x = (1 + 2 phi d)^(-1/n), to which it closes up as
    exp(-n s / end).

    Args:
        w: value before.
        distance: rho times the change of extension, with its sign (1).
        sigma: shape of the loop (1).
        n: sharpness of the bend (1).
        phi: by how much the loop leans to one side (1), between -1/2 and 1/2.
    """
    direction = 1.0 if distance >= 0.0 else -1.0
    x, left = w * direction, abs(distance)
    unloading, ending = 2.0 * sigma - 1.0, 1.0 + 2.0 * phi * direction
    end = ending ** (-1.0 / n)
    longest = min(LONGEST_STEP, STEP_OF_EXPONENT / n) * min(end, 1.0)
    steep = longest / max(1.0, 1.0 + unloading)
    while left > 0.0:
        if x > SATURATED * end:
            return float(direction * (end - (end - x) * math.exp(-n * left / end)))
        h = min(left, longest if x >= 0.0 else steep)
        a = _slope(x, unloading, ending, n)
        b = _slope(x + 0.5 * h * a, unloading, ending, n)
        c = _slope(x + 0.5 * h * b, unloading, ending, n)
        x += h / 6.0 * (a + 2.0 * b + 2.0 * c + _slope(x + h * c, unloading, ending, n))
        left -= h
    return float(direction * x)

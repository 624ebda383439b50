"""A kernel with its integration as two functions of one sample, in what the translation knows.

`start` takes the first sample, `step` each further one; both keep what they need in an array `d` and return the force:
no number where `step` is given none, and `d` then stays as it was.
They do what `rig.dampers.kernel.force_series` does: states follow the motion between two samples
(`rig.dampers.sampled_motion.motion_between`); a rate-independent hysteresis follows its loop's one curve.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rig.dampers.arrays import FloatArray
from rig.dampers.grey_box import physical
from rig.dampers.kernel import MAXIMUM_SUBSTEPS, SUBSTEP_RATE, Kernel, of_state, runge_kutta
from rig.dampers.kernel import _no_step as without_own_step  # the default, by which a model says that it has none
from rig.dampers.loop_curve import cell_of, has_curve, loop_curve, place, travel_along, turning_point
from rig.dampers.model import DamperModel
from rig.dampers.sampled_motion import motion_between


@dataclass(frozen=True)
class Program:
    """What is translated: `start(p, d, u, v, a, current)` and `step(p, d, u, v, a, current, dt)`.

    Attributes:
        length: of d.
        states: internal states, the first of d.
    """

    start: Callable[..., Any]
    step: Callable[..., Any]
    length: int
    states: int = 2


def program_of(model: DamperModel, p: FloatArray) -> Program:
    """The program of a model with these parameters, in the kernel's order."""
    kernel = model.kernel()
    if model.states == 0:
        return _algebraic(of_state(kernel, 0))
    rho, sigma, n, scale = _plain(kernel.loop)(p)
    if has_curve(rho, sigma, n):
        return _along_curve(kernel, rho, sigma, n, scale)
    return _integrated(model, kernel, p)


def known(u: float, v: float, a: float, current: float) -> bool:
    """Whether all of them are numbers."""
    return abs(u) + abs(v) + abs(a) + abs(current) < math.inf


def _plain(compiled: Callable[..., Any]) -> Callable[..., Any]:
    return getattr(compiled, "py_func", compiled)


def _algebraic(force: Callable[..., Any]) -> Program:
    def start(p: FloatArray, d: FloatArray, u: float, v: float, a: float, current: float) -> float:
        """Force (N) at the first sample."""
        d[0] = u
        return float(force(p, d, u, v, a, current))

    def step(p: FloatArray, d: FloatArray, u: float, v: float, a: float, current: float, dt: float) -> float:
        """Force (N) at the next sample; this model remembers nothing."""
        if not known(u, v, a, current):
            return math.inf - math.inf
        d[0] = u
        return float(force(p, d, u, v, a, current))

    return Program(start, step, 2)


def _along_curve(kernel: Kernel, rho: float, sigma: float, n: float, scale: float) -> Program:
    force, curve = kernel.force, _plain(loop_curve)(sigma, n)
    curve[-1, 1:] = 0.0  # behind the last node there is no cell
    cell_0 = int(_plain(cell_of)(0.0))
    place_0 = float(_plain(place)(curve, n, 0.0, cell_0))

    def start(p: FloatArray, d: FloatArray, u: float, v: float, a: float, current: float) -> float:
        """Force (N) at the first sample; the hysteresis starts from its middle."""
        d[0] = place_0
        d[1] = 0.0
        d[2] = cell_0
        d[3] = 1.0
        d[4] = u
        d[5] = v
        return float(force(p, 0.0, 0.0, u, v, a, current))

    def step(p: FloatArray, d: FloatArray, u: float, v: float, a: float, current: float, dt: float) -> float:
        """Force (N) at the next sample; d is the place on the loop's curve, then u and v of the sample before."""
        if not known(u, v, a, current):
            return math.inf - math.inf
        at = (d[0], d[1], d[2], d[3])
        if d[5] * v < 0.0:
            turn = turning_point(d[4], d[5], u, v, dt)
            at = travel_along(curve, n, at, rho * (turn - d[4]))
            at = travel_along(curve, n, at, rho * (u - turn))
        else:
            at = travel_along(curve, n, at, rho * (u - d[4]))
        d[0], d[1], d[2], d[3] = at
        d[4] = u
        d[5] = v
        return float(force(p, scale * (d[1] * d[3]), 0.0, u, v, a, current))

    return Program(start, step, 6)


def _integrated(model: DamperModel, kernel: Kernel, p: FloatArray) -> Program:
    force, positions, n = of_state(kernel, model.states), model.positions, max(3, model.states)

    def start(p: FloatArray, d: FloatArray, u: float, v: float, a: float, current: float) -> float:
        """Force (N) at the first sample, springs free."""
        for k in range(n):
            d[k] = u if k < positions else 0.0
        d[n] = u
        d[n + 1] = v
        d[n + 2] = a
        d[n + 3] = current
        return float(force(p, d, u, v, a, current))

    move = _mover(model, kernel, p)

    def step(p: FloatArray, d: FloatArray, u: float, v: float, a: float, current: float, dt: float) -> float:
        """Force (N) at the next sample; d is the internal state, then u, v, a and current of the sample before."""
        if not known(u, v, a, current):
            return math.inf - math.inf
        motion = motion_between(d[n], d[n + 1], d[n + 2], u, v, a, dt, True)
        move(p, d, motion, max(abs(d[n + 1]), abs(v)), 0.5 * (d[n + 3] + current), dt)
        d[n] = u
        d[n + 1] = v
        d[n + 2] = a
        d[n + 3] = current
        return float(force(p, d, u, v, a, current))

    return Program(start, step, n + 4, max(2, physical(model).states))


def _mover(model: DamperModel, kernel: Kernel, p: FloatArray) -> Callable[..., Any]:
    """(p, state, motion, top speed, current, dt): the state moved on, by the model's own steps where it has them."""
    own_step, fastest_rate = kernel.step, kernel.fastest_rate
    at_rest = (0.0, 0.0, 0.0, 0.0, 0.0)
    if own_step is not without_own_step and _plain(own_step)(p, model.initial_state(), at_rest, 0.0, 0.0):

        def own(p: FloatArray, state: FloatArray, motion: Any, top: float, current: float, dt: float) -> None:  # noqa: ANN401 - read as source
            """Move the internal state by a step of `dt` (s)."""
            own_step(p, state, motion, current, dt)

        return own
    integrate = runge_kutta(kernel.rates)

    def substeps(p: FloatArray, state: FloatArray, motion: Any, top: float, current: float, dt: float) -> None:  # noqa: ANN401 - read as source
        """Move the internal state by a step of `dt` (s), in substeps as short as its rate asks for."""
        rate = fastest_rate(p, top, current)
        count = int(min(float(MAXIMUM_SUBSTEPS), max(1.0, math.ceil(rate * dt / SUBSTEP_RATE))))
        h = dt / count
        for k in range(count):
            integrate(p, state, motion, current, k * h, h)

    return substeps

"""The models compiled along a motion whose start counts: force with every state, and the current that gives a force.

`kernel.force_series` runs a cycle first and forgets the start; here the first sample starts from a given state,
parameters may change from sample to sample, and states come back. Steps between samples are those of the kernel.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.compiled_cache import njit
from rig.dampers.integrable import Integrable
from rig.dampers.kernel import Compiled, ForceTarget, Instant, cached, kernel_of, key_of, of_state, sampled_step

SMOOTH_S = 3e-3  # time constant of the low-pass that takes the noise of a wanted force off its rate,
AROUND_S = 1e-3  # and where what comes after is known too
FORCE_STEP_N, RATE_STEP_N_S = 1e-2, 1.0  # for slopes of the force that a current upholds
REFINED = 8  # steps of false position inside the interval of currents that holds a force


def trajectory_of(model: Integrable) -> Compiled:
    """Force and states along a motion, compiled.

    Called with parameters (1 or n, P) in the order of `DamperModel.parameters`, the state at the first sample (S,),
    extension (m), velocity (m/s), acceleration (m/s^2) and coil current (A), (n,) each, and the sampling interval (s).
    Gives the force (N), (n,), and the states, (n, S).
    """
    return _for_any_layout(_trajectory_of(model))


def inverse_of(model: Integrable) -> Compiled:
    """The current that gives a wanted force at every sample, compiled.

    Called with parameters (1 or G, P), one row a current of the grid, the grid (A), (G,), rising, the currents that the
    model's equation sees there (G,), states (1 or n, S), extension, velocity, acceleration and wanted force (N), (n,)
    each, the wanted force's rate (N/s), (n,), and the sampling interval (s). With an interval above 0 the first state
    is the start, and the states follow with the currents that were found, straight from sample to sample, as in
    `trajectory_of`; with 0 every sample has a state of its own.
    Gives columns current (A), force there (N; see `Kernel.held`), dF/dI (N/A), whether the force is attainable (1 or
    0), least and greatest force over the grid (N), what the current has to make up of an error of the wanted force (1)
    and of its rate (s), in force, then the states, (n, 8 + S).
    """
    return _for_any_layout(_inverse_of(model))


@cache
def _trajectory_of(model: Integrable) -> Compiled:
    force = of_state(kernel_of(model), model.states)
    return cached(_trajectory(key_of(model), model.states), _force=force, _step=sampled_step(model))


@cache
def _inverse_of(model: Integrable) -> Compiled:
    kernel = kernel_of(model)
    held = kernel.held or _at_once(of_state(kernel, model.states))
    return cached(_inverse(key_of(model), model.states), _held=held, _step=sampled_step(model), _solve=_root(held))


def _for_any_layout(loop: Compiled) -> Compiled:
    """A compiled loop whose arrays may be of any layout, or read-only as those of data frames are.

    Numba compiles a loop again for each combination of such arrays: 1.5 to 5 s each.
    """

    def called(*arguments: FloatArray | float) -> Any:  # noqa: ANN401 - what the loop returns
        return loop(*map(_writable, arguments))

    return called


def _writable(argument: FloatArray | float) -> FloatArray | float:
    """The argument itself, or a contiguous copy of an array that is strided or read-only."""
    if not isinstance(argument, np.ndarray) or (argument.flags.c_contiguous and argument.flags.writeable):
        return argument
    return argument.copy()


def smoothed_rate(before: float, change: float, dt: float) -> float:
    """Rate (N/s) of a force that changed by `change` (N) in dt (s), through a low-pass of `SMOOTH_S`."""
    return before + (change / dt - before) * dt / (dt + SMOOTH_S)


def rates_N_s(force_N: FloatArray, dt_s: float) -> FloatArray:
    """Rate (N/s) of a sampled force, (n,): through a low-pass of `AROUND_S` along it and against it, and their mean.

    Args:
        force_N: the force, shape (n,).
        dt_s: sampling interval (s); with 0, or a single sample, nothing is known of a rate: 0.
    """
    if dt_s <= 0.0 or force_N.size < 2:
        return np.zeros_like(force_N)
    from scipy.signal import lfilter

    steps, share = np.diff(force_N) / dt_s, dt_s / (dt_s + AROUND_S)

    def passed(values: FloatArray, start: float) -> FloatArray:
        return np.asarray(lfilter([share], [1.0, share - 1.0], values, zi=[(1.0 - share) * start])[0])

    start = float(passed(steps[::-1], float(np.mean(steps)))[-1])
    along = np.concatenate(([start], passed(steps, start)))
    against = np.concatenate((passed(steps[::-1], float(along[-1]))[::-1], along[-1:]))
    return np.asarray(0.5 * (along + against))


def amplified(of_force: FloatArray, of_rate_s: FloatArray, dt_s: float, *, causal: bool) -> FloatArray:
    """How many times the error of a wanted force the current has to make up, shape (n,), if it is white.

    Args:
        of_force: what it makes up of an error of the force (1), shape (n,).
        of_rate_s: and of its rate (s), shape (n,).
        dt_s: sampling interval (s); 0 where no rate was taken.
        causal: whether the rate is `smoothed_rate`, else `rates_N_s`.
    """
    if dt_s <= 0.0:
        return np.abs(of_force)
    share = dt_s / (dt_s + (SMOOTH_S if causal else AROUND_S))
    now, tail = of_rate_s * share / dt_s, share / (2.0 - share)  # of a unit step's sequence, its first value apart
    if causal:
        return np.sqrt((of_force + now) ** 2 + now**2 * tail)
    return np.sqrt(of_force**2 + 0.5 * now**2 * tail)


def _unset(*arguments: object) -> float:
    raise NotImplementedError(arguments)


_force: Compiled = _unset
_held: Compiled = _unset
_step: Compiled = _unset
_solve: Compiled = _unset
"""Of the loop's model, once it is compiled."""


def _trajectory(key: str, states: int) -> Compiled:
    def trajectory(
        p: FloatArray, start: FloatArray, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray]:
        n = u.size + 0 * len(key)
        force, path = np.empty(n), np.empty((n, start.size))
        state, last = start.copy(), p.shape[0] - 1
        for k in range(n):
            row = p[min(k, last)]
            if states > 0 and k > 0:
                _step(row, state, u, v, a, current, dt, k - 1, k)
            force[k] = _force(row, state, u[k], v[k], a[k], current[k])
            for place in range(state.size):
                path[k, place] = state[place]
        return force, path

    return trajectory


@njit()
def _bracket(forces: FloatArray, target: float) -> tuple[int, int]:
    """The first interval of the grid that holds the force (-1: none), and the place of the nearest force."""
    low, nearest = -1, 0
    for g in range(forces.size):
        if abs(forces[g] - target) < abs(forces[nearest] - target):
            nearest = g
        if low < 0 and g + 1 < forces.size and (forces[g] - target) * (forces[g + 1] - target) <= 0.0:
            low = g
    return low, nearest


@njit()
def _span(forces: FloatArray) -> tuple[float, float]:
    """The least and the greatest force; neither is a number where one is none."""
    least = greatest = forces[0]
    for force in forces:
        if force < least or force != force:
            least = force
        if force > greatest or force != force:
            greatest = force
    return least, greatest


@njit()
def _blend(row: FloatArray, low: FloatArray, high: FloatArray, share: float) -> None:
    """Parameters at a share of the way from `low` to `high`, into `row`."""
    for place in range(row.size):
        row[place] = low[place] + share * (high[place] - low[place])


def _at_once(force: Compiled) -> Compiled:
    """`Kernel.held` of a model whose force follows the current at once, compiled."""

    @njit()
    def held(p: FloatArray, state: FloatArray, motion: Instant, current: float, target: ForceTarget) -> float:
        return float(force(p, state, motion[0], motion[1], motion[2], current))

    return held


def _root(held: Compiled) -> Compiled:
    """Where between two neighbours of the grid the force meets the wanted one, compiled: share of the way (1)."""

    @njit()
    def root(
        row: FloatArray,
        low: FloatArray,
        high: FloatArray,
        ends: tuple[float, float],
        state: FloatArray,
        motion: Instant,
        misses: tuple[float, float],
        target: ForceTarget,
    ) -> float:
        left, right, share = 0.0, 1.0, 0.0
        below, above = misses
        for _ in range(REFINED):
            if below == above:
                return left
            share = left - below * (right - left) / (above - below)
            _blend(row, low, high, share)
            current = ends[0] + share * (ends[1] - ends[0])
            miss = held(row, state, motion, current, target) - target[0]
            if miss == 0.0:
                return share
            if miss * below > 0.0:
                left, below, above = share, miss, 0.5 * above
            else:
                right, above, below = share, miss, 0.5 * below
        return share

    return root


def _inverse(key: str, states: int) -> Compiled:
    def inverse(
        p: FloatArray,
        grid: FloatArray,
        seen: FloatArray,
        start: FloatArray,
        u: FloatArray,
        v: FloatArray,
        a: FloatArray,
        target_N: FloatArray,
        rates: FloatArray,
        dt: float,
    ) -> FloatArray:
        n, count, last, size = u.size + 0 * len(key), grid.size, p.shape[0] - 1, start.shape[1]
        answer = np.empty((n, 8 + size))
        forces, state, used = np.empty(count), start[0].copy(), np.empty(n)
        row, before = p[0].copy(), start[0].copy()
        for k in range(n):
            follows = dt > 0.0 and k > 0 and states > 0
            if dt <= 0.0:
                for place in range(size):
                    state[place] = start[min(k, start.shape[0] - 1), place]
            elif follows:
                used[k] = used[k - 1]  # its value is not known yet
                for place in range(size):
                    before[place] = state[place]
                _step(row, state, u, v, a, used, dt, k - 1, k)
            motion, aim = (u[k], v[k], a[k]), (target_N[k], rates[k])
            for g in range(count):
                forces[g] = _held(p[min(g, last)], state, motion, seen[g], aim)
            low, nearest = _bracket(forces, target_N[k])
            attainable = low >= 0
            low = low if attainable else min(nearest, count - 2)
            share = 0.0 if nearest == low else 1.0
            below, above = p[min(low, last)], p[min(low + 1, last)]
            if attainable:
                misses = (forces[low] - target_N[k], forces[low + 1] - target_N[k])
                share = _solve(row, below, above, (seen[low], seen[low + 1]), state, motion, misses, aim)
            _blend(row, below, above, share)
            used[k] = seen[low] + share * (seen[low + 1] - seen[low])
            if follows:  # on the way that the current really takes
                for place in range(size):
                    state[place] = before[place]
                _step(row, state, u, v, a, used, dt, k - 1, k)
            answer[k, 0] = grid[low] + share * (grid[low + 1] - grid[low])
            answer[k, 1] = _held(row, state, motion, used[k], aim)
            answer[k, 2] = (forces[low + 1] - forces[low]) / (grid[low + 1] - grid[low])
            answer[k, 3] = 1.0 if attainable else 0.0
            answer[k, 4], answer[k, 5] = _span(forces)
            more, faster = (target_N[k] + FORCE_STEP_N, rates[k]), (target_N[k], rates[k] + RATE_STEP_N_S)
            answer[k, 6] = 1.0 - (_held(row, state, motion, used[k], more) - answer[k, 1]) / FORCE_STEP_N
            answer[k, 7] = -(_held(row, state, motion, used[k], faster) - answer[k, 1]) / RATE_STEP_N_S
            for place in range(size):
                answer[k, 8 + place] = state[place]
        return answer

    return inverse

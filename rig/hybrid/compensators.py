"""Compensation of the transfer system's delay, so that the specimen follows its target.

One step of each compensator, compiled, on plain arrays, for virtual and real tests.

Sources: polynomial extrapolation, Horiuchi et al. 1999; third-order inverse by backward differences, as in Galmez and
Fermandois 2022; adaptive time series (ATS), Chae, Kazemibidokhti and Ricles 2013; PI with phase lead, the benchmark's
sample (Silva et al. 2020, 5.2-5.3).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from rig.dampers.compiled_cache import njit
from rig.hybrid.discretisation import along_a_line, held, low_pass
from rig.signals.arrays import FloatArray

NAMES = ("none", "sample", "polynomial", "inverse", "ats", "adaptive-model")
"""Compensators by name; a name's place is its number in compiled code."""
NONE, SAMPLE, POLYNOMIAL, INVERSE, ATS, ADAPTIVE_MODEL = range(6)
OWN = "adaptive-model"
TERMS = 6
"""Coefficients of an inverse model: of the position and of its first five derivatives."""
LEAD_TERMS = 5
"""Of these, so many are commanded: the fifth derivative is noise."""
FILTER_Hz = 25.0
WINDOW_s = 1.0
LEAST_RMS_m = 1e-4
"""The ATS compensator keeps its coefficients while the specimen moves less than this, RMS over its window."""


class Model(NamedTuple):
    """What is known of the transfer system before the test.

    Attributes:
        inverse: command by position and derivatives (6,), the unit of term i is s^i.
        sensitivity: one standard deviation of each uncertain parameter in `inverse` (6, m).
        delay_s: of the position behind its command, s.
        noise_m: what is left between a command and the best inverse model, filtered, m RMS.
    """

    inverse: FloatArray
    sensitivity: FloatArray
    delay_s: float
    noise_m: float


class Settings(NamedTuple):
    """A compensator's numbers, fixed during a test."""

    kind: int
    step_s: float
    delay_steps: int
    inverse: FloatArray
    sensitivity: FloatArray
    variance: float
    transition: FloatArray
    held: FloatArray
    earlier: FloatArray
    later: FloatArray
    latency_steps: int


class Memory(NamedTuple):
    """What a compensator carries from step to step; `fresh` makes it.

    Attributes:
        past: earlier targets, the latest first.
        last: target, lead, error, integral, measured position, command.
        commanded, measured: states (6,) of the identification's filters: value and derivatives.
        shift: parameters found so far (m,), in standard deviations.
        covariance: of these (m, m).
        coefficients: the inverse model in use (6,).
        rows: filtered position, velocity, acceleration and command of the last second, in a ring.
        steps: so far, in its only place.
        sums: of products of `rows` (4, 4).
    """

    past: FloatArray
    last: FloatArray
    commanded: FloatArray
    measured: FloatArray
    shift: FloatArray
    covariance: FloatArray
    coefficients: FloatArray
    rows: FloatArray
    steps: FloatArray
    sums: FloatArray


def settings(name: str, model: Model, rate_Hz: float, latency_steps: int = 0) -> Settings:
    """A compensator for a transfer system at a rate, told how many steps pass before a command arrives."""
    step_s = 1.0 / rate_Hz
    state, inputs = low_pass(TERMS, FILTER_Hz)
    transition, first, last = along_a_line(state, inputs, step_s)
    whole = held(state, inputs, step_s)[1]
    latency_s = latency_steps * step_s
    delay_steps = max(1, round((model.delay_s + latency_s) / step_s))
    inverse = model.inverse
    if NAMES.index(name) == INVERSE:
        earlier = [latency_s**i / math.factorial(i) for i in range(4)]
        inverse = np.convolve(inverse, earlier)[:TERMS].copy()
    return Settings(
        NAMES.index(name), step_s, delay_steps, inverse, model.sensitivity, model.noise_m**2, transition,
        whole[:, 0].copy(), first[:, 0].copy(), last[:, 0].copy(), latency_steps,
    )  # fmt: skip


def fresh(chosen: Settings) -> Memory:
    """A compensator's memory before its first step: everything at rest, the model as it was before the test."""
    uncertain = chosen.sensitivity.shape[1]
    start = chosen.inverse.copy()
    if chosen.kind == ATS:
        delay_s = chosen.delay_steps * chosen.step_s
        start = np.array([1.0, delay_s, delay_s**2 / 2.0, 0.0, 0.0, 0.0])
    return Memory(
        np.zeros(3 * chosen.delay_steps + 3), np.zeros(6), np.zeros(TERMS), np.zeros(TERMS), np.zeros(uncertain),
        np.eye(uncertain), start, np.zeros((max(8, round(WINDOW_s / chosen.step_s)), 4)), np.zeros(1), np.zeros((4, 4)),
    )  # fmt: skip


@njit()
def _pi_with_lead(target: float, measured: float, chosen: Settings, memory: Memory) -> float:
    rate, last = 2.0 / chosen.step_s, memory.last
    lead = 50.8 * ((rate + 168.6) * target + (168.6 - rate) * last[0]) - (8570.0 - rate) * last[1]
    lead /= rate + 8570.0
    error = lead - measured
    last[3] += 0.5 * chosen.step_s * (error + last[2])
    last[1], last[2] = lead, error
    return float(2.0 * error + 95.0 * last[3])


@njit()
def _differences(target: float, chosen: Settings, memory: Memory, order: int) -> float:
    """Inverse model up to the second or third derivative, these by backward differences."""
    c, past, step = memory.coefficients, memory.past, chosen.step_s
    command = c[0] * target + c[1] * (target - past[0]) / step
    command += c[2] * (target - 2.0 * past[0] + past[1]) / step**2
    if order > 2:
        command += c[3] * (target - 3.0 * past[0] + 3.0 * past[1] - past[2]) / step**3
    return float(command)


@njit()
def _filter(measured: float, chosen: Settings, memory: Memory) -> None:
    """Measured position and last command through the same low-pass, each as it was between the samples."""
    m, c, last = memory.measured.copy(), memory.commanded.copy(), memory.last
    for i in range(TERMS):
        memory.measured[i] = chosen.earlier[i] * last[4] + chosen.later[i] * measured
        memory.commanded[i] = chosen.held[i] * last[5]
        for j in range(TERMS):
            memory.measured[i] += chosen.transition[i, j] * m[j]
            memory.commanded[i] += chosen.transition[i, j] * c[j]


@njit()
def _learn(chosen: Settings, memory: Memory) -> None:
    """One step of recursive least squares from what was known before: parameters in standard deviations, variance 1."""
    count = memory.shift.size
    left, change, weighted = memory.commanded[0], np.zeros(count), np.zeros(count)
    for i in range(TERMS):
        left -= chosen.inverse[i] * memory.measured[i]
        for j in range(count):
            change[j] += chosen.sensitivity[i, j] * memory.measured[i]
    variance = chosen.variance
    for j in range(count):
        left -= change[j] * memory.shift[j]
        for k in range(count):
            weighted[j] += memory.covariance[j, k] * change[k]
        variance += change[j] * weighted[j]
    for j in range(count):
        memory.shift[j] += weighted[j] * left / variance
        for k in range(count):
            memory.covariance[j, k] -= weighted[j] * weighted[k] / variance
    for i in range(TERMS):
        memory.coefficients[i] = chosen.inverse[i]
        for j in range(count):
            memory.coefficients[i] += chosen.sensitivity[i, j] * memory.shift[j]


@njit()
def _solve(matrix: FloatArray, right: FloatArray) -> None:
    """Solve for a few unknowns by elimination, into `right`; the matrix, of products, its diagonal 1, is used up."""
    for i in range(right.size):
        for j in range(i + 1, right.size):
            share = matrix[j, i] / matrix[i, i]
            for k in range(i, right.size):
                matrix[j, k] -= share * matrix[i, k]
            right[j] -= share * right[i]
    for i in range(right.size - 1, -1, -1):
        for j in range(i + 1, right.size):
            right[i] -= matrix[i, j] * right[j]
        right[i] /= matrix[i, i]


@njit()
def _adapt_time_series(memory: Memory) -> None:
    """Coefficients by least squares over the last second, within their bounds."""
    rows, sums = memory.rows, memory.sums
    place = int(memory.steps[0]) % rows.shape[0]
    new = np.empty(4)
    for i in range(3):
        new[i] = memory.measured[i]
    new[3] = memory.commanded[0]
    for i in range(4):
        for j in range(4):
            sums[i, j] += new[i] * new[j] - rows[place, i] * rows[place, j]
    for i in range(4):
        rows[place, i] = new[i]
    if memory.steps[0] < rows.shape[0] or sums[0, 0] < LEAST_RMS_m**2 * rows.shape[0]:
        return
    scale, matrix, right = np.empty(3), np.empty((3, 3)), np.empty(3)
    for i in range(3):
        scale[i] = math.sqrt(sums[i, i])
    for i in range(3):
        right[i] = sums[i, 3] / scale[i]
        for j in range(3):
            matrix[i, j] = sums[i, j] / (scale[i] * scale[j])
        matrix[i, i] += 1e-9
    _solve(matrix, right)
    memory.coefficients[0] = min(max(right[0] / scale[0], 0.9), 1.1)
    memory.coefficients[1] = min(max(right[1] / scale[1], 0.0), 0.06)
    memory.coefficients[2] = min(max(right[2] / scale[2], 0.0), 0.0032)


@njit()
def command(target: FloatArray, measured: float, chosen: Settings, memory: Memory) -> float:
    """The command of one step, m.

    Args:
        target: where the specimen should be now, m, and the derivatives of that (6,); only `adaptive-model` uses these.
        measured: where it is, m.
        chosen: the compensator.
        memory: changed in place; `said` has to follow with what was really commanded.
    """
    x, past, n = target[0], memory.past, chosen.delay_steps
    out = x
    if chosen.kind == SAMPLE:
        out = _pi_with_lead(x, measured, chosen, memory)
    elif chosen.kind == POLYNOMIAL:
        out = 4.0 * x - 6.0 * past[n - 1] + 4.0 * past[2 * n - 1] - past[3 * n - 1]
    elif chosen.kind == INVERSE:
        out = _differences(x, chosen, memory, 3)
    elif chosen.kind >= ATS:
        _filter(measured, chosen, memory)
        if chosen.kind == ATS:
            _adapt_time_series(memory)
            out = _differences(x, chosen, memory, 2)
        else:
            _learn(chosen, memory)
            out = 0.0
            for i in range(LEAD_TERMS):
                out += memory.coefficients[i] * target[i]
    for i in range(past.size - 1, 0, -1):
        past[i] = past[i - 1]
    past[0], memory.last[0], memory.last[4] = x, x, measured
    memory.steps[0] += 1.0
    return float(out)


@njit()
def said(commanded: float, memory: Memory) -> None:
    """Tell a compensator what was really commanded (rounded, limited) and is held until the next step, m.

    Where commands arrive late: `adaptive-model`, which knows the latency, is told the one that arrives now, the
    others the one that leaves now: to them it is part of the delay.
    """
    memory.last[5] = commanded


def ahead_by(rows: FloatArray, ahead_s: float) -> FloatArray:
    """Rows of derivatives (6, n) as they will be after a time (s), by Taylor's series up to the third order."""
    ahead = np.zeros((TERMS, TERMS))
    for i in range(TERMS):
        for j in range(i, min(TERMS, i + 4)):
            ahead[i, j] = ahead_s ** (j - i) / math.factorial(j - i)
    return np.ascontiguousarray(ahead @ rows)

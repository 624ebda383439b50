"""Linear systems from one sample to the next, exactly, for inputs that are held or change along a line."""

from __future__ import annotations

import math

import numpy as np

from rig.signals.arrays import FloatArray


def held(state: FloatArray, inputs: FloatArray, step_s: float) -> tuple[FloatArray, FloatArray]:
    """Transition (n, n) and input (n, m) over one step with the input held since its beginning."""
    from scipy.linalg import expm  # where it is wanted: a simulated rig loads this room without it

    n, m = inputs.shape
    block = np.zeros((n + m, n + m))
    block[:n, :n], block[:n, n:] = state * step_s, inputs * step_s
    exponential = expm(block)
    return _kept(exponential[:n, :n]), _kept(exponential[:n, n:])


def along_a_line(state: FloatArray, inputs: FloatArray, step_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Transition (n, n), weight (n, m) of the input at the step's beginning and at its end: linear between them."""
    from scipy.linalg import expm  # where it is wanted: a simulated rig loads this room without it

    n, m = inputs.shape
    block = np.zeros((n + 2 * m, n + 2 * m))
    block[:n, :n], block[:n, n : n + m] = state * step_s, inputs * step_s
    block[n : n + m, n + m :] = np.eye(m)
    exponential = expm(block)
    later = exponential[:n, n + m :]
    return _kept(exponential[:n, :n]), _kept(exponential[:n, n : n + m] - later), _kept(later)


def low_pass(order: int, corner_Hz: float) -> tuple[FloatArray, FloatArray]:
    """Butterworth low-pass whose states are its output and the output's derivatives.

    Args:
        order: number of states.
        corner_Hz: -3 dB.

    Returns:
        State matrix (order, order) and input matrix (order, 1).
    """
    corner = 2.0 * math.pi * corner_Hz
    angles = [math.pi * (2 * k + order + 1) / (2 * order) for k in range(order)]
    poles = [corner * complex(math.cos(angle), math.sin(angle)) for angle in angles]
    coefficients = np.real(np.poly(np.array(poles)))
    state = np.diag(np.ones(order - 1), 1)
    state[-1] = -coefficients[:0:-1]
    inputs = np.zeros((order, 1))
    inputs[-1, 0] = coefficients[-1]
    return state, inputs


def _kept(matrix: FloatArray) -> FloatArray:
    return np.ascontiguousarray(matrix)

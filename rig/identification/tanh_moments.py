"""Weighted moments of the tanh models' yield shape: all that a fit needs to know of the samples at one shape.

With y = tanh(beta v + delta sgn u) the model is linear in b I^i (b one of a, 1, v, |v|, u) and in y I^i, so its normal
equations consist of sums over samples of y b I^p, y F I^p, y y I^p (p = 0, 1, 2), and of the same with dy/dbeta and
dy/ddelta for their slope. Three matrices (3, 9), one for each power of the current, hold them:

    rows     y, dy/dbeta, dy/ddelta
    columns  a, 1, v, |v|, u, force, y, dy/dbeta, dy/ddelta

Where the current is constant one sum gives all three powers. `tanh_kernels` sums the same, compiled; importing it costs
more than one fit in numpy takes, so it is used where numba is loaded already, or many samples pay for it.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rig.identification.measurement import Measurement
from rig.identification.projection import Weighting

FloatArray = NDArray[np.float64]

COLUMNS = 6  # that do not depend on the shape: a, 1, v, |v|, u, force
PIECE = 65_536
KEEP_BELOW = 200_000  # samples up to which they are joined once; more are streamed, which also saves the copy
WORTH_COMPILING = 1_000_000  # samples from which a fit repays the import of numba


@dataclass(frozen=True, eq=False)
class Samples:
    """Samples of one or more tests end to end, each array of shape (n,).

    Attributes:
        u_m: extension about mid-stroke (m).
        v_m_s: velocity (m/s).
        a_m_s2: acceleration (m/s^2).
        current_A: coil current (A).
        force_N: measured force (N).
        weight_squared: square of the weight.
        ends: where each test ends, shape (t,).
        steady: whether its current is constant, shape (t,).
    """

    u_m: FloatArray
    v_m_s: FloatArray
    a_m_s2: FloatArray
    current_A: FloatArray
    force_N: FloatArray
    weight_squared: FloatArray
    ends: NDArray[np.int64]
    steady: NDArray[np.bool_]

    @cached_property
    def columns(self) -> FloatArray:
        """a, 1, v, |v|, u, force, shape (6, n)."""
        v = self.v_m_s
        return np.array((self.a_m_s2, np.ones_like(v), v, np.abs(v), self.u_m, self.force_N))

    @cached_property
    def side(self) -> FloatArray:
        """Sign of the extension, shape (n,)."""
        return np.sign(self.u_m)

    @property
    def arrays(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
        """u, v, a, current, force and squared weight, as the compiled loops take them."""
        return self.u_m, self.v_m_s, self.a_m_s2, self.current_A, self.force_N, self.weight_squared


def join(measurements: Sequence[Measurement], weighting: Weighting, every: int = 1) -> Samples:
    """Every `every`-th sample of all measurements end to end."""
    parts = [_of(each, weighting, k, slice(0, None, every)) for k, each in enumerate(measurements)]
    return Samples(
        u_m=np.concatenate([part.u_m for part in parts]),
        v_m_s=np.concatenate([part.v_m_s for part in parts]),
        a_m_s2=np.concatenate([part.a_m_s2 for part in parts]),
        current_A=np.concatenate([part.current_A for part in parts]),
        force_N=np.concatenate([part.force_N for part in parts]),
        weight_squared=np.concatenate([part.weight_squared for part in parts]),
        ends=np.cumsum([part.u_m.size for part in parts]),
        steady=np.concatenate([part.steady for part in parts]),
    )


def stream(measurements: Sequence[Measurement], weighting: Weighting) -> Iterator[Samples]:
    """All samples piece by piece, without copies of the motion."""
    for k, each in enumerate(measurements):
        for start in range(0, each.u_m.size, PIECE):
            yield _of(each, weighting, k, slice(start, min(start + PIECE, each.u_m.size)))


def _of(each: Measurement, weighting: Weighting, index: int, rows: slice) -> Samples:
    columns = (each.u_m, each.v_m_s, each.a_m_s2, each.current_A, each.force_N)
    u, v, a, current, force = (np.ascontiguousarray(column[rows], dtype=float) for column in columns)
    squared = weighting.of(each, index, rows) ** 2
    return Samples(
        u, v, a, current, force, squared, np.array([u.size]), np.array([bool(np.all(current == current[0]))])
    )


def gram(samples: Samples, *, compiled: bool) -> FloatArray:
    """Moments of a, 1, v, |v|, u and force with each other for each power of the current, shape (3, 6, 6)."""
    s = samples
    if compiled:
        from rig.identification import tanh_kernels

        products: FloatArray = tanh_kernels.gram(*s.arrays, s.ends, s.steady)
        return products
    total, first = np.zeros((3, COLUMNS, COLUMNS)), 0
    for end, steady in zip(s.ends, s.steady, strict=True):
        columns = s.columns[:, first:end]
        weighted = columns * s.weight_squared[first:end]
        if steady:
            total += (weighted @ columns.T) * np.power(s.current_A[first], np.arange(3.0))[:, None, None]
        else:
            for power in range(3):
                total[power] += weighted @ columns.T
                weighted *= s.current_A[first:end]
        first = end
    return total


def add_moments(total: FloatArray, shapes: FloatArray, samples: Samples, *, slope: bool, compiled: bool) -> None:
    """Add the moments of `samples` at each of the shapes.

    Args:
        total: what is added to, shape (S, 3, 3, 9).
        shapes: beta (s/m) and delta, shape (S, 2).
        samples: the samples.
        slope: whether the rows of the slopes are wanted; they stay as they are otherwise.
        compiled: whether the compiled loops do it.
    """
    s = samples
    if compiled:
        from rig.identification import tanh_kernels

        tanh_kernels.add_moments(total, shapes, slope, *s.arrays, s.ends, s.steady)
        return
    for k, (beta, delta) in enumerate(shapes):
        y = np.tanh(beta * s.v_m_s + delta * s.side)
        rate = 1.0 - y * y
        rows = np.array((y, rate * s.v_m_s, rate * s.side)) if slope else y[None, :]
        weighted, count = rows * s.weight_squared, rows.shape[0]
        for power in range(3):
            total[k, power, :count, :COLUMNS] += weighted @ s.columns.T
            total[k, power, :count, COLUMNS : COLUMNS + count] += weighted @ rows.T
            weighted *= s.current_A


def squares(samples: Samples, shape: FloatArray, values: FloatArray, *, compiled: bool) -> float:
    """The weighted sum of squared residuals, summed sample by sample.

    Args:
        samples: the samples.
        shape: beta (s/m) and delta.
        values: coefficients of a, 1, v, |v|, u and y, then of the same times the current, shape (2, 6).
        compiled: whether the compiled loop does it.
    """
    s = samples
    if compiled:
        from rig.identification.objective_kernels import tanh_objective

        (m, f0, ca, ca_half, ka, fya), (_, _, cb, cb_half, kb, fyb) = values
        viscous = ca + ca_half, ca - ca_half, cb + cb_half, cb - cb_half
        general = np.array([[m, f0, *shape, fya, fyb, *viscous, ka, kb]])
        return float(tanh_objective(general, *s.arrays)[0])
    steady, per_ampere = values[:, :-1] @ s.columns[:-1] + values[:, -1:] * np.tanh(
        shape[0] * s.v_m_s + shape[1] * s.side
    )
    residual = s.force_N - steady - per_ampere * s.current_A
    return float(residual**2 @ s.weight_squared)


def compiled_pays(samples: int) -> bool:
    """Whether a fit to so many samples is faster with the compiled loops, the import of numba included."""
    return "numba" in sys.modules or samples >= WORTH_COMPILING

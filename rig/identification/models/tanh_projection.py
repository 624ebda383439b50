"""Projected objective of the tanh models from moments of their yield shape: a few sums per sample.

The method and its names are those of `projection.Projection`, which handles any form with complete columns.

With y = tanh(beta v + delta sgn u) the model is linear in b I^i (b one of a, 1, v, |v|, u) and in y I^i, so its normal
equations consist of sums over samples of y b I^p, y F I^p, y y I^p (p = 0, 1, 2), and of the same with dy/dbeta and
dy/ddelta for their slope. Three matrices (3, 9), one for each power of the current, hold them:

    rows     y, dy/dbeta, dy/ddelta
    columns  a, 1, v, |v|, u, force, y, dy/dbeta, dy/ddelta

If the current is constant, one sum gives all three powers. The compiled module `kernels` computes the same sums.
Importing it takes longer than one fit with numpy, and compiling it much longer, so it is used only if it is already
loaded (by a search or a bootstrap) or if there are many samples.
"""

from __future__ import annotations

import copy
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rig.dampers.algebraic import AlgebraicSeparation, TanhModel
from rig.dampers.arrays import BoolArray, FloatArray, IntArray
from rig.identification.models.inner_least_squares import Inner, Reduction
from rig.identification.models.measurement import Measurement
from rig.identification.models.projection import Weighting

COLUMNS = 6  # that do not depend on the shape: a, 1, v, |v|, u, force
PIECE = 65_536
KEEP_BELOW = 200_000  # samples up to which they are joined once; more are streamed, which also saves the copy
WORTH_COMPILING = 1_000_000  # samples from which a fit repays the import of numba
KERNELS = "rig.identification.models.kernels"


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
    ends: IntArray
    steady: BoolArray

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
    parts = [_of(test, weighting, k, slice(0, None, every)) for k, test in enumerate(measurements)]
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


def thinned(samples: Samples, every: int) -> Samples:
    """Every `every`-th sample of each test, as `join` returns with `every`, without reading the tests again."""
    starts = np.concatenate(([0], samples.ends[:-1]))
    rows = np.concatenate(
        [np.arange(start, end, every) for start, end in zip(starts.tolist(), samples.ends.tolist(), strict=True)]
    )
    ends = np.cumsum((samples.ends - starts + every - 1) // every)
    u, v, a, current, force, weight_squared = (values[rows] for values in samples.arrays)
    return Samples(u, v, a, current, force, weight_squared, ends, samples.steady)


def stream(measurements: Sequence[Measurement], weighting: Weighting) -> Iterator[Samples]:
    """All samples piece by piece, without copies of the motion."""
    for k, test in enumerate(measurements):
        for start in range(0, test.u_m.size, PIECE):
            yield _of(test, weighting, k, slice(start, min(start + PIECE, test.u_m.size)))


def _of(test: Measurement, weighting: Weighting, index: int, rows: slice) -> Samples:
    columns = (test.u_m, test.v_m_s, test.a_m_s2, test.current_A, test.force_N)
    u, v, a, current, force = (np.ascontiguousarray(column[rows], dtype=float) for column in columns)
    squared = weighting.of(test, index, rows) ** 2
    return Samples(
        u, v, a, current, force, squared, np.array([u.size]), np.array([bool(np.all(current == current[0]))])
    )


def gram(samples: Samples, *, compiled: bool) -> FloatArray:
    """Moments of a, 1, v, |v|, u and force with each other for each power of the current, shape (3, 6, 6)."""
    s = samples
    if compiled:
        from rig.identification.models import kernels as tanh_kernels  # loads numba

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
        from rig.identification.models import kernels as tanh_kernels  # loads numba

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
        from rig.identification.models.kernels import tanh_objective  # loads numba

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
    """Whether a fit to this many samples is faster with the compiled loops, including their compilation."""
    return KERNELS in sys.modules or samples >= WORTH_COMPILING


#: Regressors of the general form as (combination of a, 1, v, |v|, u; power of the current).
REGRESSORS: dict[str, tuple[tuple[float, ...], int]] = {
    "m": ((1.0, 0.0, 0.0, 0.0, 0.0), 0),
    "F0": ((0.0, 1.0, 0.0, 0.0, 0.0), 0),
    "Ca_plus": ((0.0, 0.0, 0.5, 0.5, 0.0), 0),
    "Ca_minus": ((0.0, 0.0, 0.5, -0.5, 0.0), 0),
    "Cb_plus": ((0.0, 0.0, 0.5, 0.5, 0.0), 1),
    "Cb_minus": ((0.0, 0.0, 0.5, -0.5, 0.0), 1),
    "Ka": ((0.0, 0.0, 0.0, 0.0, 1.0), 0),
    "Kb": ((0.0, 0.0, 0.0, 0.0, 1.0), 1),
}
BASE = COLUMNS - 1  # regressors a, 1, v, |v|, u; the force is the sixth column
POWERS = np.array([[0, 1], [1, 2]])  # power of the current in the product of I^i and I^j
BENDS = (slice(0, 2), slice(0, 2))  # both shape parameters bend both yield columns, y and y I


class TanhProjection:
    """Equation (12) of a tanh model as a function of its two shape parameters; the linear ones are solved for.

    Attributes:
        form: the model, split.
        evaluations: how many passes over the samples were made, one counting as one evaluation of equation (12).
        samples: number of samples that count.
        power: weighted sum of the squared force.
    """

    def __init__(
        self,
        model: TanhModel,
        measurements: Sequence[Measurement],
        weighting: Weighting,
        *,
        every: int = 1,
        without: frozenset[str] = frozenset(),
        compiled: bool | None = None,
        kept: Samples | None = None,
    ) -> None:
        self.form = AlgebraicSeparation(model)
        self.evaluations = self.samples = 0
        self._printed = model.hysteresis == "printed"
        self._measurements, self._weighting = tuple(measurements), weighting
        size = sum(test.u_m.size for test in measurements) // every
        self._compiled = compiled_pays(size * every) if compiled is None else compiled
        self._kept = kept
        if kept is None and (size <= KEEP_BELOW or every > 1):
            self._kept = join(measurements, weighting, every)
        self._columns = _regressors(model)
        total = np.zeros((3, COLUMNS, COLUMNS))
        for samples in self._pieces():
            total += gram(samples, compiled=self._compiled)
            self.samples += int(np.count_nonzero(samples.weight_squared))
        products = total[POWERS].transpose(0, 2, 1, 3)
        base = products[:, :BASE, :, :BASE].reshape(2 * BASE, 2 * BASE)
        self._normal = self._columns.T @ base @ self._columns
        self._right = self._columns.T @ products[:, :BASE, 0, BASE].reshape(2 * BASE)
        self.power = float(total[0, BASE, BASE])
        self._reduction = self._reduced(without)

    def thin_samples(self, every: int) -> Samples | None:
        """Every `every`-th sample of each test if all samples are in memory; otherwise None."""
        return None if self._kept is None else thinned(self._kept, every)

    def without(self, names: frozenset[str]) -> TanhProjection:
        """The same samples with some linear parameters held at zero; counts its own evaluations."""
        other = copy.copy(self)
        other._reduction = other._reduced(names)  # noqa: SLF001 - of its own class
        other.evaluations = 0
        return other

    def solve(self, shape: FloatArray, *, slope: bool = True) -> Inner:
        """Linear values, objective and, with `slope`, its projected slope at this shape, in one pass."""
        moments = self._moments(shape[None, :], slope=slope)
        count = 3 if slope else 1
        if slope and self._printed:
            moments = _of_speed_offset(moments, shape)
        cross, right, own = self._sums(moments, count)
        return self._reduction.solve(cross[0], right[0], own[0], BENDS if slope else ())

    def objectives(self, shapes: FloatArray) -> FloatArray:
        """The least objective at each shape, shape (S,); `shapes` (S, 2) in the order of the model's `shape_names`."""
        return self._reduction.least(*self._sums(self._moments(shapes, slope=False), 1))

    def plain(self, shape: FloatArray, linear: FloatArray) -> float:
        """The objective at a shape and linear values (fixed, then yield), from each sample's own residual."""
        self.evaluations += 1
        fixed = (self._columns @ linear[:-2]).reshape(2, BASE)
        values = np.column_stack((fixed, linear[-2:]))
        kwok = np.array((shape[0], shape[0] * shape[1])) if self._printed else shape
        return sum(squares(samples, kwok, values, compiled=self._compiled) for samples in self._pieces())

    def _pieces(self) -> Iterator[Samples]:
        return iter((self._kept,)) if self._kept is not None else stream(self._measurements, self._weighting)

    def _reduced(self, without: frozenset[str]) -> Reduction:
        names = (*self.form.fixed_names, *self.form.yield_names)
        return Reduction(self._normal, self._right, self.power, np.array([name not in without for name in names]))

    def _moments(self, shapes: FloatArray, *, slope: bool) -> FloatArray:
        """Moments at each shape, shape (S, 3, 3, 9), in beta and delta whatever the form."""
        self.evaluations += shapes.shape[0]
        kwok = np.column_stack((shapes[:, 0], shapes[:, 0] * shapes[:, 1])) if self._printed else shapes
        total = np.zeros((shapes.shape[0], 3, 3, 9))
        for samples in self._pieces():
            add_moments(total, kwok, samples, slope=slope, compiled=self._compiled)
        return total

    def _sums(self, moments: FloatArray, count: int) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Y'X, Y'F and Y'Y of the yield columns (and their slopes, `count` 3), each times I^0 and I^1."""
        size = 2 * count
        products = moments[:, POWERS].transpose(0, 3, 1, 4, 2)[:, :count]  # shape, row, its power, column, its power
        cross = products[:, :, :, :BASE].transpose(0, 1, 2, 4, 3).reshape(-1, size, 2 * BASE) @ self._columns
        right = products[:, :, :, BASE, 0].reshape(-1, size)
        own = products[:, :, :, COLUMNS : COLUMNS + count].reshape(-1, size, size)
        return cross, right, own


def _regressors(model: TanhModel) -> FloatArray:
    """The model's fixed regressors as combinations of a, 1, v, |v|, u, then these times the current; shape (10, k)."""
    columns = np.zeros((2, BASE, len(model.fixed_names)))
    for k, name in enumerate(model.fixed_names):
        for general in model.general[name]:
            combination, power = REGRESSORS[general]
            columns[power, :, k] += combination
    return columns.reshape(2 * BASE, -1)


def _of_speed_offset(moments: FloatArray, shape: FloatArray) -> FloatArray:
    """Moments with slopes in beta and lambda of the printed form, where delta = beta lambda."""
    beta, speed = shape
    change = np.eye(3)
    change[1, 2], change[2, 2] = speed, beta
    moments = change @ moments
    moments[..., COLUMNS:] = moments[..., COLUMNS:] @ change.T
    return moments

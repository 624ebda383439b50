"""The projected objective of the tanh models, from moments of their yield shape: a few sums a sample, no matrix of it.

Projecting and its names are those of `projection.Projection`, which does the same for any form by whole columns.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from rig.dampers.algebraic import TanhModel
from rig.identification.measurement import Measurement
from rig.identification.problem import TO_GENERAL
from rig.identification.projection import AlgebraicForm, Weighting
from rig.identification.reduction import Inner, Reduction
from rig.identification.tanh_moments import (
    COLUMNS,
    KEEP_BELOW,
    Samples,
    add_moments,
    compiled_pays,
    gram,
    join,
    squares,
    stream,
)

FloatArray = NDArray[np.float64]

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
    ) -> None:
        self.form = AlgebraicForm(model)
        self.evaluations = self.samples = 0
        self._printed = model.hysteresis == "printed"
        self._measurements, self._weighting = tuple(measurements), weighting
        size = sum(each.u_m.size for each in measurements) // every
        self._compiled = compiled_pays(size * every) if compiled is None else compiled
        self._kept = join(measurements, weighting, every) if size <= KEEP_BELOW or every > 1 else None
        self._columns = _regressors(model)
        total = np.zeros((3, COLUMNS, COLUMNS))
        for each in self._pieces():
            total += gram(each, compiled=self._compiled)
            self.samples += int(np.count_nonzero(each.weight_squared))
        products = total[POWERS].transpose(0, 2, 1, 3)
        base = products[:, :BASE, :, :BASE].reshape(2 * BASE, 2 * BASE)
        self._normal = self._columns.T @ base @ self._columns
        self._right = self._columns.T @ products[:, :BASE, 0, BASE].reshape(2 * BASE)
        self.power = float(total[0, BASE, BASE])
        self._reduction = self._reduced(without)

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
        return sum(squares(each, kwok, values, compiled=self._compiled) for each in self._pieces())

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
        for each in self._pieces():
            add_moments(total, kwok, each, slope=slope, compiled=self._compiled)
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
        for general in TO_GENERAL[model.name][name]:
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

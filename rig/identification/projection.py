"""The weighted normal equations of an algebraic model, with everything that does not depend on its shape summed once.

For shape parameters theta the force is linear in c: F = X c_fixed + sum_j (c_j0 + c_j1 I + ...) y_j(theta). Solving for
c inside leaves a function of theta alone (variable projection, Golub and Pereyra 1973); its slope uses Kaufman's (1975)
simplification.
Only sums over samples are kept, so any number of samples is streamed in pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from rig.dampers.algebraic import AlgebraicModel, TanhModel
from rig.identification.measurement import Measurement

FloatArray = NDArray[np.float64]
Weight = Literal["v", "1"]

BETA_LIMITS = (1e-3, 1e9)  # s/m: from a straight line to a sign function
PIECE = 32768
KEEP_BELOW = 2_000_000  # samples up to which the regressors stay in memory
SINGULAR = 1e-11  # directions of the scaled normal matrix below this share of the largest carry no information


@dataclass(frozen=True)
class Weighting:
    """Which samples count, and how much.

    Attributes:
        weight: "v" weighs each sample by its speed (equation 12), "1" does not.
        guard_s: time (s) around u = 0 whose samples do not count: the sensor's filter and the clocks do not let one say
            on which side of the tanh models' jump they lie.
        reversal_guard_s: time (s) around v = 0 whose samples do not count, for models that jump there.
        extra: further weights, one array (n,) a measurement (robust losses).
    """

    weight: Weight = "1"
    guard_s: float = 0.0
    reversal_guard_s: float = 0.0
    extra: tuple[FloatArray, ...] | None = None

    def of(self, each: Measurement, index: int) -> FloatArray:
        """Weight of each sample of measurement number `index`, shape (n,), not negative."""
        weights = np.abs(each.v_m_s) if self.weight == "v" else np.ones_like(each.v_m_s)
        if self.guard_s > 0.0:
            weights[np.abs(each.u_m) < self.guard_s * np.abs(each.v_m_s)] = 0.0
        if self.reversal_guard_s > 0.0:
            weights[np.abs(each.v_m_s) < self.reversal_guard_s * np.abs(each.a_m_s2)] = 0.0
        if each.usable is not None:
            weights[~each.usable] = 0.0
        return weights if self.extra is None else weights * self.extra[index]


@dataclass(frozen=True)
class Piece:
    """Weighted samples: regressors X w (n, k), force F w, and the rows of the measurement they come from."""

    fixed: FloatArray
    force: FloatArray
    weight: FloatArray
    source: Measurement
    rows: slice

    @property
    def current_A(self) -> FloatArray:
        """Coil current (A) of the samples."""
        return self.source.current_A[self.rows]


class Form(Protocol):
    """A model split for projection: what is linear without the shape, and the yield shapes times powers of the current.

    Attributes:
        fixed_names: linear parameters whose regressors need no shape parameter.
        yield_names: linear parameters of the yield shapes, of each by rising powers of the current.
        powers: how many of `yield_names` belong to each yield shape.
        shape_names: the nonlinear parameters.
        bends: for each of them, which yield shape it bends.
        logarithmic: for each of them, whether it is positive and searched by its logarithm.
        limits: lowest and highest value of each shape parameter, shape (s, 2).
        pointwise: whether a sample's regressors need no other sample, so that samples may be left out.
    """

    @property
    def fixed_names(self) -> tuple[str, ...]: ...  # noqa: D102 - described above
    @property
    def yield_names(self) -> tuple[str, ...]: ...  # noqa: D102 - described above
    @property
    def powers(self) -> tuple[int, ...]: ...  # noqa: D102 - described above
    @property
    def bends(self) -> tuple[int, ...]: ...  # noqa: D102 - described above
    @property
    def shape_names(self) -> tuple[str, ...]: ...  # noqa: D102 - described above
    @property
    def logarithmic(self) -> tuple[bool, ...]: ...  # noqa: D102 - described above
    @property
    def limits(self) -> FloatArray: ...  # noqa: D102 - described above
    @property
    def pointwise(self) -> bool: ...  # noqa: D102 - described above

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """Regressors of `fixed_names`, shape (n, k), from extension (m), velocity, acceleration and current (A)."""

    def yielding(self, source: Measurement, rows: slice, shape: FloatArray, *, slope: bool) -> list[FloatArray]:
        """The yield shapes of some rows, each (n,), then with `slope` a derivative for each shape parameter."""


class AlgebraicForm:
    """An algebraic model split for projection."""

    pointwise = True
    powers: tuple[int, ...] = (2,)

    def __init__(self, model: AlgebraicModel) -> None:
        self.model = model
        self.fixed_names: tuple[str, ...] = model.fixed_names
        self.yield_names: tuple[str, ...] = model.yield_names
        self.shape_names = model.shape_names
        self.bends = (0,) * len(model.shape_names)
        self.logarithmic = tuple(name == "beta" for name in model.shape_names)
        self.limits = np.array([BETA_LIMITS if name == "beta" else (-np.inf, np.inf) for name in model.shape_names])

    def fixed_columns(self, u: FloatArray, v: FloatArray, a: FloatArray, current: FloatArray) -> FloatArray:
        """See `Form.fixed_columns`."""
        return self.model.fixed_columns(u, v, a, current)

    def yielding(self, source: Measurement, rows: slice, shape: FloatArray, *, slope: bool) -> list[FloatArray]:
        """See `Form.yielding`."""
        values = dict(zip(self.shape_names, shape, strict=True))
        u, v = source.u_m[rows], source.v_m_s[rows]
        yielding = self.model.yield_shape(values, u, v)
        if not slope or not isinstance(self.model, TanhModel):
            return [yielding]
        rate = 1.0 - yielding**2
        return [yielding, *(rate * each for each in self.model.argument_slopes(values, u, v))]


@dataclass(frozen=True)
class Inner:
    """The inner solution at one shape: objective, linear values (fixed, then yield), and the projected slope.

    `gradient` (s,) is J'r and `curvature` (s, s) is J'J of the projected residual r with respect to the shape.
    """

    objective: float
    linear: FloatArray
    gradient: FloatArray
    curvature: FloatArray


class Projection:
    """Equation (12) as a function of the shape parameters alone; the linear ones are solved for.

    Attributes:
        form: the model, split.
        evaluations: how many passes over the samples were made, one counting as one evaluation of equation (12).
        samples: number of samples that count.
    """

    def __init__(
        self,
        form: Form,
        measurements: Sequence[Measurement],
        weighting: Weighting,
        *,
        every: int = 1,
        without: frozenset[str] = frozenset(),
    ) -> None:
        self.form = form
        self._measurements = tuple(measurements)
        self._weighting = weighting
        self._every = every
        self.evaluations = 0
        self.samples = 0
        self._kept: list[Piece] | None = None
        if sum(each.u_m.size for each in measurements) // every <= KEEP_BELOW:
            self._kept = list(self._stream())
        width = len(form.fixed_names)
        self._normal, self._right, self._power = np.zeros((width, width)), np.zeros(width), 0.0
        for piece in self.pieces():
            self._normal += piece.fixed.T @ piece.fixed
            self._right += piece.fixed.T @ piece.force
            self._power += float(piece.force @ piece.force)
            self.samples += int(np.count_nonzero(piece.weight))
        names = (*form.fixed_names, *form.yield_names)
        self._free = np.array([name not in without for name in names])

    def pieces(self) -> Iterator[Piece]:
        """All weighted samples, piece by piece."""
        return iter(self._kept) if self._kept is not None else self._stream()

    def _stream(self) -> Iterator[Piece]:
        for index, each in enumerate(self._measurements):
            weights = self._weighting.of(each, index)
            length = PIECE * self._every if self.form.pointwise else each.u_m.size
            for start in range(0, each.u_m.size, length):
                rows = slice(start, min(start + length, each.u_m.size), self._every)
                u, v, a, current = each.u_m[rows], each.v_m_s[rows], each.a_m_s2[rows], each.current_A[rows]
                weight = weights[rows]
                fixed = self.form.fixed_columns(u, v, a, current) * weight[:, None]
                yield Piece(fixed, each.force_N[rows] * weight, weight, each, rows)

    def objective(self, shape: FloatArray) -> float:
        """The least objective at this shape; shape (s,) in the order of the model's `shape_names`."""
        return self.solve(shape, slope=False).objective

    def solve(self, shape: FloatArray, *, slope: bool = True) -> Inner:
        """Linear values, objective and, with `slope`, its projected slope at this shape, in one pass."""
        self.evaluations += 1
        fixed, powers = self._normal.shape[0], self.form.powers
        size = fixed + sum(powers) + (sum(powers[k] for k in self.form.bends) if slope else 0)
        normal, right = np.zeros((size, size)), np.zeros(size)
        normal[:fixed, :fixed], right[:fixed] = self._normal, self._right
        for piece in self.pieces():
            block = self._block(piece, shape, slope=slope)
            normal[fixed:, :fixed] += block.T @ piece.fixed
            normal[fixed:, fixed:] += block.T @ block
            right[fixed:] += block.T @ piece.force
        normal[:fixed, fixed:] = normal[fixed:, :fixed].T
        return self._reduce(normal, right, fixed + sum(powers))

    def _block(self, piece: Piece, shape: FloatArray, *, slope: bool) -> FloatArray:
        """Columns of the yield shapes, then of their slopes, each times the powers of the current."""
        powers = self.form.powers
        counts = (*powers, *(powers[k] for k in self.form.bends)) if slope else powers
        parts = []
        for column, count in zip(self.form.yielding(piece.source, piece.rows, shape, slope=slope), counts, strict=True):
            part = column * piece.weight
            for _ in range(count):
                parts.append(part)
                part = part * piece.current_A
        return np.column_stack(parts)

    def _reduce(self, normal: FloatArray, right: FloatArray, columns: int) -> Inner:
        active = np.flatnonzero(self._free)
        linear = np.zeros(columns)
        solver = scaled_inverse(normal[np.ix_(active, active)])
        linear[active] = solver(right[active])
        objective = max(self._power - float(linear @ right[:columns]), 0.0)
        powers, at = self.form.powers, columns
        first = [columns - sum(powers[k:]) for k in range(len(powers))]
        shapes = len(self.form.bends) if normal.shape[0] > columns else 0
        mix = np.zeros((normal.shape[0], shapes))
        for k, bent in enumerate(self.form.bends[:shapes]):
            mix[at : at + powers[bent], k] = linear[first[bent] : first[bent] + powers[bent]]
            at += powers[bent]
        padded = np.concatenate((linear, np.zeros(normal.shape[0] - columns)))
        gradient = mix.T @ (right - normal @ padded)
        cross = (normal @ mix)[active]
        curvature = (
            mix.T @ normal @ mix - cross.T @ np.column_stack([solver(cross[:, k]) for k in range(shapes)])
            if shapes
            else np.zeros((0, 0))
        )
        return Inner(objective, linear, gradient, np.asarray(curvature))


def scaled_inverse(normal: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """A solver of normal equations, for right sides (k,) or (k, m): directions without information stay at zero."""
    scale = np.sqrt(np.diag(normal))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    carrying = values > SINGULAR * values[-1]
    half = vectors[:, carrying] / scale[:, None]

    def solve(right: FloatArray) -> FloatArray:
        projected = half.T @ right
        result: FloatArray = half @ (projected.T / values[carrying]).T
        return result

    return solve

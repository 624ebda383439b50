"""The weighted normal equations of an algebraic model, with everything that does not depend on its shape summed once.

For shape parameters theta the force is linear in c: F = X c_fixed + (c_0 + c_1 I) y(theta). Solving for c inside leaves
a function of theta alone (variable projection, Golub and Pereyra 1973); its slope uses Kaufman's (1975) simplification.
Only sums over samples are kept, so any number of samples is streamed in pieces.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rig.dampers.algebraic import AlgebraicModel, TanhModel
from rig.identification.measurement import Measurement

FloatArray = NDArray[np.float64]
Weight = Literal["v", "1"]

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
        extra: further weights, one array (n,) a measurement (robust losses).
    """

    weight: Weight = "1"
    guard_s: float = 0.0
    extra: tuple[FloatArray, ...] | None = None

    def of(self, each: Measurement, index: int) -> FloatArray:
        """Weight of each sample of measurement number `index`, shape (n,), not negative."""
        weights = np.abs(each.v_m_s) if self.weight == "v" else np.ones_like(each.v_m_s)
        if self.guard_s > 0.0:
            weights[np.abs(each.u_m) < self.guard_s * np.abs(each.v_m_s)] = 0.0
        if each.usable is not None:
            weights[~each.usable] = 0.0
        return weights if self.extra is None else weights * self.extra[index]


@dataclass(frozen=True)
class Piece:
    """Weighted samples: regressors X w (n, k), force F w, and what the yield shape needs."""

    fixed: FloatArray
    force: FloatArray
    weight: FloatArray
    u_m: FloatArray
    v_m_s: FloatArray
    current_A: FloatArray


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
        model: the algebraic model.
        evaluations: how many passes over the samples were made, one counting as one evaluation of equation (12).
        samples: number of samples that count.
    """

    def __init__(
        self,
        model: AlgebraicModel,
        measurements: Sequence[Measurement],
        weighting: Weighting,
        *,
        every: int = 1,
        without: frozenset[str] = frozenset(),
    ) -> None:
        self.model = model
        self._measurements = tuple(measurements)
        self._weighting = weighting
        self._every = every
        self.evaluations = 0
        self.samples = 0
        self._kept: list[Piece] | None = None
        if sum(each.u_m.size for each in measurements) // every <= KEEP_BELOW:
            self._kept = list(self._stream())
        width = len(model.fixed_names)
        self._normal, self._right, self._power = np.zeros((width, width)), np.zeros(width), 0.0
        for piece in self.pieces():
            self._normal += piece.fixed.T @ piece.fixed
            self._right += piece.fixed.T @ piece.force
            self._power += float(piece.force @ piece.force)
            self.samples += int(np.count_nonzero(piece.weight))
        names = (*model.fixed_names, *model.yield_names)
        self._free = np.array([name not in without for name in names])

    def pieces(self) -> Iterator[Piece]:
        """All weighted samples, piece by piece."""
        return iter(self._kept) if self._kept is not None else self._stream()

    def _stream(self) -> Iterator[Piece]:
        for index, each in enumerate(self._measurements):
            weights = self._weighting.of(each, index)
            for start in range(0, each.u_m.size, PIECE * self._every):
                rows = slice(start, min(start + PIECE * self._every, each.u_m.size), self._every)
                u, v, a, current = each.u_m[rows], each.v_m_s[rows], each.a_m_s2[rows], each.current_A[rows]
                weight = weights[rows]
                fixed = self.model.fixed_columns(u, v, a, current) * weight[:, None]
                yield Piece(fixed, each.force_N[rows] * weight, weight, u, v, current)

    def objective(self, shape: FloatArray) -> float:
        """The least objective at this shape; shape (s,) in the order of the model's `shape_names`."""
        return self.solve(shape, slope=False).objective

    def solve(self, shape: FloatArray, *, slope: bool = True) -> Inner:
        """Linear values, objective and, with `slope`, its projected slope at this shape, in one pass."""
        self.evaluations += 1
        fixed = self._normal.shape[0]
        extra = 2 + (2 * shape.size if slope else 0)
        size = fixed + extra
        normal, right = np.zeros((size, size)), np.zeros(size)
        normal[:fixed, :fixed], right[:fixed] = self._normal, self._right
        for piece in self.pieces():
            block = self._block(piece, shape, slope=slope)
            normal[fixed:, :fixed] += block.T @ piece.fixed
            normal[fixed:, fixed:] += block.T @ block
            right[fixed:] += block.T @ piece.force
        normal[:fixed, fixed:] = normal[fixed:, :fixed].T
        return self._reduce(normal, right, fixed + 2)

    def _block(self, piece: Piece, shape: FloatArray, *, slope: bool) -> FloatArray:
        """Columns of the yield shape and of its slopes, each times 1 and times the current, shape (n, 2 + 2 s)."""
        values = dict(zip(self.model.shape_names, shape, strict=True))
        yielding = self.model.yield_shape(values, piece.u_m, piece.v_m_s)
        columns = [yielding * piece.weight]
        if slope and isinstance(self.model, TanhModel):
            rate = (1.0 - yielding**2) * piece.weight
            columns += [rate * each for each in self.model.argument_slopes(values, piece.u_m, piece.v_m_s)]
        return np.column_stack([part for column in columns for part in (column, column * piece.current_A)])

    def _reduce(self, normal: FloatArray, right: FloatArray, columns: int) -> Inner:
        active = np.flatnonzero(self._free)
        linear = np.zeros(columns)
        solver = scaled_inverse(normal[np.ix_(active, active)])
        linear[active] = solver(right[active])
        objective = max(self._power - float(linear @ right[:columns]), 0.0)
        shapes = (normal.shape[0] - columns) // 2
        mix = np.zeros((normal.shape[0], shapes))
        for k in range(shapes):
            mix[columns + 2 * k : columns + 2 * k + 2, k] = linear[columns - 2 : columns]
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

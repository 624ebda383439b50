"""The weighted normal equations of an algebraic model, with everything that does not depend on its shape summed once.

For shape parameters theta the force is linear in c: F = X c_fixed + sum_j (c_j0 + c_j1 I + ...) y_j(theta). Solving for
c inside leaves a function of theta alone (variable projection, Golub and Pereyra 1973).
Only sums over samples are kept, so any number of samples is streamed in pieces.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.dampers.separation import Joinable, JoinedMotions, Motion, Separation
from rig.identification.models.inner_least_squares import Inner, Reduction
from rig.identification.models.measurement import Measurement

Weight = Literal["v", "1", "relative"]

PIECE = 32768
JOINED = 4096  # samples up to which short tests are evaluated together: what is made of them stays in the cache
ALL = slice(None)
JUMP_REACH = 1.5  # intervals of mean cycles, within which a jump of the force changes their means
KEEP_BELOW = 2_000_000  # samples up to which the regressors stay in memory


@dataclass(frozen=True)
class Weighting:
    """Weights of the samples.

    Attributes:
        weight: "v" weights each recorded sample by its speed (equation 12), "1" equally; "relative" weights each test
            so that its part of the objective is the square of its relative error (% of peak), regardless of its number
            of samples.
        guard_s: time (s) around u = 0 whose samples are ignored, because the sensor's filter and the clocks leave it
            open on which side of the tanh models' jump they are.
        reversal_guard_s: time (s) around v = 0 whose samples are ignored, for models that jump there.
        extra: further weights, one array (n,) per measurement (robust losses, resampling).
    """

    weight: Weight = "1"
    guard_s: float = 0.0
    reversal_guard_s: float = 0.0
    extra: tuple[FloatArray, ...] | None = None

    def of(self, test: Measurement, index: int, rows: slice = ALL) -> FloatArray:
        """Weight of each sample of measurement number `index`, or of some of its rows, shape (n,), not negative."""
        speed = np.abs(test.v_m_s[rows])
        if self.weight == "relative":
            weights = np.full_like(speed, 100.0 / (max(test.peak_force_N, 1e-300) * math.sqrt(test.u_m.size)))
        else:
            weights = (speed if self.weight == "v" else np.ones_like(speed)) * math.sqrt(test.recorded_each)
        reach_s = 0.0 if test.means is None or not test.means.spread else JUMP_REACH * test.dt_s
        if self.guard_s > 0.0:
            weights[np.abs(test.u_m[rows]) < (self.guard_s + reach_s) * speed] = 0.0
        if self.reversal_guard_s > 0.0:
            weights[speed < (self.reversal_guard_s + reach_s) * np.abs(test.a_m_s2[rows])] = 0.0
        if test.usable is not None:
            weights[~test.usable[rows]] = 0.0
        if self.extra is None:
            return weights
        here = self.extra[index][: test.u_m.size]  # of a test's first cycle, the first of them
        return np.asarray(weights * here[rows])

    def counting(self, test: Measurement, index: int) -> BoolArray:
        """Which samples of measurement number `index` count, shape (n,)."""
        counts = np.empty(test.u_m.size, dtype=bool)
        for rows in test.pieces():
            counts[rows] = self.of(test, index, rows) > 0.0
        return counts


@dataclass(frozen=True)
class Piece:
    """Weighted samples: regressors X w (n, k), force F w, and the rows of the motion they come from."""

    fixed: FloatArray
    force: FloatArray
    weight: FloatArray
    source: Motion | JoinedMotions
    rows: slice

    @property
    def current_A(self) -> FloatArray:
        """Coil current (A) of the samples."""
        return self.source.current_A[self.rows]


class Projection:
    """Equation (12) as a function of the shape parameters alone; the linear ones are solved for.

    Attributes:
        form: the model, split.
        evaluations: how many passes over the samples were made, one counting as one evaluation of equation (12).
        samples: number of samples that count.
    """

    def __init__(
        self,
        form: Separation,
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
        if sum(test.u_m.size for test in measurements) // every <= KEEP_BELOW:
            self._kept = list(self._stream())
        width = len(form.fixed_names)
        normal, right, power = np.zeros((width, width)), np.zeros(width), 0.0
        for piece in self.pieces():
            normal += piece.fixed.T @ piece.fixed
            right += piece.fixed.T @ piece.force
            power += float(piece.force @ piece.force)
            self.samples += int(np.count_nonzero(piece.weight))
        names = (*form.fixed_names, *form.yield_names)
        self._reduction = Reduction(normal, right, power, np.array([name not in without for name in names]))
        self._bends = [slice(sum(form.powers[: bent[0]]), sum(form.powers[: bent[-1] + 1])) for bent in form.bends]

    def pieces(self) -> Iterator[Piece]:
        """All weighted samples, piece by piece."""
        return iter(self._kept) if self._kept is not None else self._stream()

    def _stream(self) -> Iterator[Piece]:
        for together in self._together():
            if len(together) > 1:
                yield self._joined(together)
                continue
            (index,) = together
            test = self._measurements[index]
            length = PIECE * self._every if self.form.pointwise else test.u_m.size
            for start in range(0, test.u_m.size, length):
                rows = slice(start, min(start + length, test.u_m.size), self._every)
                weight = self._weighting.of(test, index, rows)
                yield self._piece(test, rows, test.force_N[rows], weight)

    def _together(self) -> list[list[int]]:
        """Numbers of the tests that make one piece each, or several pieces if there is only one of them."""
        if not isinstance(self.form, Joinable):
            return [[index] for index in range(len(self._measurements))]
        groups: list[list[int]] = []
        room = 0
        for index, test in enumerate(self._measurements):
            room -= test.u_m.size
            if room < 0:
                groups.append([])
                room = JOINED - test.u_m.size
            groups[-1].append(index)
        return groups

    def _joined(self, together: Sequence[int]) -> Piece:
        """Several tests as one piece."""
        tests = [self._measurements[index] for index in together]
        weights = [self._weighting.of(test, index) for index, test in zip(together, tests, strict=True)]
        force_N = np.concatenate([test.force_N for test in tests])
        return self._piece(JoinedMotions.of(tests), ALL, force_N, np.concatenate(weights))

    def _piece(self, source: Motion | JoinedMotions, rows: slice, force_N: FloatArray, weight: FloatArray) -> Piece:
        """The rows of a motion with their regressors and force, weighted."""
        motion = (source.u_m[rows], source.v_m_s[rows], source.a_m_s2[rows], source.current_A[rows])
        return Piece(self.form.fixed_columns(*motion) * weight[:, None], force_N * weight, weight, source, rows)

    def objective(self, shape: FloatArray) -> float:
        """The least objective at this shape; shape (s,) in the order of the model's `shape_names`."""
        return self.solve(shape, slope=False).objective

    def solve(self, shape: FloatArray, *, slope: bool = True) -> Inner:
        """Linear values, objective and, with `slope`, its projected slope at this shape, in one pass."""
        self.evaluations += 1
        size = sum(self._counts(slope=slope))
        cross = np.zeros((size, len(self.form.fixed_names)))
        right, own = np.zeros(size), np.zeros((size, size))
        for piece in self.pieces():
            block = self._block(piece, shape, slope=slope)
            cross += block.T @ piece.fixed
            own += block.T @ block
            right += block.T @ piece.force
        return self._reduction.solve(cross, right, own, self._bends if slope else ())

    def _block(self, piece: Piece, shape: FloatArray, *, slope: bool) -> FloatArray:
        """Columns of the yield shapes, then of their slopes, each times the powers of the current."""
        source: Any = piece.source  # joined motions only if the form is `Joinable`
        columns, counts = self.form.yielding(source, piece.rows, shape, slope=slope), self._counts(slope=slope)
        block, place, current_A = np.empty((sum(counts), piece.weight.size)), 0, piece.current_A
        for column, count in zip(columns, counts, strict=True):
            np.multiply(column, piece.weight, out=block[place])
            for power in range(place + 1, place + count):
                np.multiply(block[power - 1], current_A, out=block[power])
            place += count
        return block.T

    def _counts(self, *, slope: bool) -> tuple[int, ...]:
        """How many powers of the current each column of `Separation.yielding` has."""
        powers = self.form.powers
        return (*powers, *(powers[k] for bent in self.form.bends for k in bent)) if slope else powers

"""The weighted normal equations of an algebraic model, with everything that does not depend on its shape summed once.

For shape parameters theta the force is linear in c: F = X c_fixed + sum_j (c_j0 + c_j1 I + ...) y_j(theta). Solving for
c inside leaves a function of theta alone (variable projection, Golub and Pereyra 1973).
Only sums over samples are kept, so any number of samples is streamed in pieces.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray, IntArray
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
    """Weighted samples of one or more tests, or of a part of one.

    Attributes:
        columns: regressors X w of the fixed parameters, then the force F w, shape (k + 1, n).
        weight: weight of each sample, shape (n,).
        source: the motion.
        rows: the rows of the motion.
        tests: numbers of the tests.
        ends: where in the piece each test ends.
        currents_A: constant current of each test; None if one of them changes.
    """

    columns: FloatArray
    weight: FloatArray
    source: Motion | JoinedMotions
    rows: slice
    tests: tuple[int, ...]
    ends: tuple[int, ...]
    currents_A: FloatArray | None


@dataclass(frozen=True)
class Sums:
    """Sums over the samples of each group of tests: the normal equations at one shape.

    Attributes:
        cross: Y'X of the weighted yield columns, then the columns of their slopes, shape (g, y, k).
        right: Y'F, shape (g, y).
        own: Y'Y, shape (g, y, y).
    """

    cross: FloatArray
    right: FloatArray
    own: FloatArray

    def over(self, groups: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The sums over some groups: Y'X (y, k), Y'F (y,) and Y'Y (y, y)."""
        return self.cross[groups].sum(axis=0), self.right[groups].sum(axis=0), self.own[groups].sum(axis=0)


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
        groups: Sequence[int] | None = None,
    ) -> None:
        """Sum what does not depend on the shape.

        Args:
            form: the model, split.
            measurements: the tests.
            weighting: weights of the samples.
            every: distance of the samples that are used; 1: all of them.
            without: linear parameters that are held at zero.
            groups: number of the group of each test, from 0, for `left_out`; by default, all tests are one group.
        """
        self.form = form
        self._measurements = tuple(measurements)
        self._weighting = weighting
        self._every = every
        self.evaluations = 0
        self.samples = 0
        self._group_of = np.zeros(len(self._measurements), dtype=int) if groups is None else np.array(groups)
        self._kept: list[Piece] | None = None
        if sum(test.u_m.size for test in measurements) // every <= KEEP_BELOW:
            self._kept = list(self._stream())
        count = int(np.max(self._group_of, initial=0)) + 1
        self._fixed = np.zeros((count, len(form.fixed_names) + 1, len(form.fixed_names) + 1))
        for piece in self.pieces():
            for number, part in self._parts(piece):
                columns = piece.columns[:, part]
                self._fixed[self._group_of[number]] += columns @ columns.T
            self.samples += int(np.count_nonzero(piece.weight))
        self._sums: dict[bytes, Sums] = {}
        self._counted = np.ones(count, dtype=bool)
        self._reduction = self._reduced(without)
        self._bends = [slice(sum(form.powers[: bent[0]]), sum(form.powers[: bent[-1] + 1])) for bent in form.bends]

    def left_out(self, group: int, form: Separation, without: frozenset[str]) -> Projection:
        """The same without one group of tests: shares the samples and the sums of `remember`.

        Args:
            group: number of the group.
            form: the same split, with limits that suit the remaining tests.
            without: linear parameters that are held at zero.
        """
        other = copy.copy(self)
        other.form, other.evaluations = form, 0
        other._counted = np.arange(self._counted.size) != group  # noqa: SLF001 - of its own class
        other._reduction = other._reduced(without)  # noqa: SLF001 - of its own class
        return other

    def remember(self, shape: FloatArray) -> None:
        """Compute the sums at a shape once for this projection and all those of `left_out`."""
        self._sums[shape.tobytes()] = self._pass(shape, slope=True)

    def _reduced(self, without: frozenset[str]) -> Reduction:
        names = (*self.form.fixed_names, *self.form.yield_names)
        fixed = self._fixed[self._counted].sum(axis=0)
        free = np.array([name not in without for name in names])
        return Reduction(fixed[:-1, :-1], fixed[:-1, -1], float(fixed[-1, -1]), free)

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
                yield self._piece(test, rows, test.force_N[rows], weight, (index,))

    def _together(self) -> list[list[int]]:
        """Numbers of the tests that make one piece each, or several pieces if there is only one of them."""
        if not isinstance(self.form, Joinable) or self._every > 1:
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
        return self._piece(JoinedMotions.of(tests), ALL, force_N, np.concatenate(weights), tuple(together))

    def _piece(
        self, source: Motion | JoinedMotions, rows: slice, force_N: FloatArray, weight: FloatArray,
        tests: tuple[int, ...],
    ) -> Piece:
        """The rows of a motion with their regressors and force, weighted."""
        motion = (source.u_m[rows], source.v_m_s[rows], source.a_m_s2[rows], source.current_A[rows])
        columns = np.vstack((self.form.fixed_columns(*motion).T, force_N)) * weight
        ends = np.cumsum([self._measurements[number].u_m.size for number in tests]) if len(tests) > 1 else [weight.size]
        levels = [(float(np.min(one)), float(np.max(one))) for one in np.split(motion[3], ends[:-1])]
        steady = all(low == high for low, high in levels)
        currents_A = np.array([low for low, _ in levels]) if steady else None
        return Piece(columns, weight, source, rows, tests, tuple(map(int, ends)), currents_A)

    def _parts(self, piece: Piece) -> Iterator[tuple[int, slice]]:
        """Each test of a piece, by its number, with its samples in the piece."""
        for number, first, end in zip(piece.tests, (0, *piece.ends), piece.ends, strict=False):
            yield number, slice(first, end)

    def objective(self, shape: FloatArray) -> float:
        """The least objective at this shape; shape (s,) in the order of the model's `shape_names`."""
        return self.solve(shape, slope=False).objective

    def solve(self, shape: FloatArray, *, slope: bool = True) -> Inner:
        """Linear values, objective and, with `slope`, its projected slope at this shape, in one pass."""
        known = self._sums.get(shape.tobytes()) if slope else None
        sums = known if known is not None else self._pass(shape, slope=slope)
        return self._reduction.solve(*sums.over(self._counted), self._bends if slope else ())

    def _pass(self, shape: FloatArray, *, slope: bool) -> Sums:
        """The sums over the samples of each group at this shape.

        If the current of a test is constant, the powers of the current are factors of the sums, not of the samples.
        """
        self.evaluations += 1
        counts, width = self._counts(slope=slope), self._fixed.shape[1]
        base = np.repeat(np.arange(len(counts)), counts)
        powers = np.concatenate([np.arange(count) for count in counts])
        total = np.zeros((self._counted.size, base.size, base.size + width))
        steady: list[tuple[tuple[int, ...], FloatArray, FloatArray]] = []
        for piece in self.pieces():
            source: Any = piece.source  # joined motions only if the form is `Joinable`
            yielding, currents_A = self.form.yielding(source, piece.rows, shape, slope=slope), piece.currents_A
            if currents_A is None:
                raised = np.vander(source.current_A[piece.rows], max(counts), increasing=True).T
                yielding = [yielding[k] * raised[power] for k, power in zip(base, powers, strict=True)]
            rows = np.empty((len(yielding) + width, piece.weight.size))
            for row, column in zip(rows, yielding, strict=False):
                np.multiply(column, piece.weight, out=row)
            rows[len(yielding) :] = piece.columns
            tables = np.empty((len(piece.tests), len(yielding), rows.shape[0]))
            for table, (_, part) in zip(tables, self._parts(piece), strict=True):
                np.matmul(rows[: len(yielding), part], rows[:, part].T, out=table)
            if currents_A is not None:
                steady.append((piece.tests, currents_A, tables))
                continue
            for number, table in zip(piece.tests, tables, strict=True):
                total[self._group_of[number]] += table
        if steady:
            tests, currents, products = zip(*steady, strict=True)
            groups = self._group_of[[number for numbers in tests for number in numbers]]
            factors = _factors(np.concatenate(currents), groups, total.shape[0], 2 * max(counts) - 1)
            total += _with_powers(factors, np.concatenate(products), base, powers)
        return Sums(total[:, :, base.size : -1], total[:, :, -1], total[:, :, : base.size])

    def _counts(self, *, slope: bool) -> tuple[int, ...]:
        """How many powers of the current each column of `Separation.yielding` has."""
        powers = self.form.powers
        return (*powers, *(powers[k] for bent in self.form.bends for k in bent)) if slope else powers


def _factors(currents_A: FloatArray, groups: IntArray, count: int, powers: int) -> FloatArray:
    """Powers of the current of each test (t,) in the group of the test, 0 in the other groups; shape (g, powers, t)."""
    factors = np.zeros((count, powers, currents_A.size))
    factors[groups, :, np.arange(currents_A.size)] = np.vander(currents_A, powers, increasing=True)
    return factors


def _with_powers(factors: FloatArray, tables: FloatArray, base: IntArray, powers: IntArray) -> FloatArray:
    """Sums over groups of tests for each yield column times each of its powers of the current.

    Args:
        factors: powers of the current of each test in its group, shape (g, p, t).
        tables: products of the yield columns (b) with each other and with the k + 1 columns that do not depend on the
            shape, for each test, shape (t, b, b + k + 1).
        base: yield column of each column of the result, shape (y,).
        powers: power of the current of each column of the result, shape (y,).

    Returns:
        Shape (g, y, y + k + 1).
    """
    width, more = tables.shape[1], tables.shape[2] - tables.shape[1]
    sums = (factors @ tables.reshape(tables.shape[0], -1)).reshape(*factors.shape[:2], *tables.shape[1:])
    columns = np.concatenate((base, np.arange(width, width + more)))
    together = powers[:, None] + np.concatenate((powers, np.zeros(more, dtype=int)))
    return np.asarray(sums[:, together, base[:, None], columns])

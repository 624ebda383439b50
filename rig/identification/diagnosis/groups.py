"""Are the tests of two dampers? Each test goes to the one of two fits that describes it better, until none moves.

The parting starts from runs, halves of the campaign, tests that are too strong and too weak, and at random; it is
found with the slopes at the common fit, and only the best one is fitted to the end.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.identification.diagnosis.descent import Damper, Explained, explain, slope_rows
from rig.identification.diagnosis.distortions import Distortion
from rig.identification.diagnosis.stretches import Stretch
from rig.optimisers.least_squares import unit_scale

RANDOM_STARTS = 12
ROUNDS = 15
FEWEST_TESTS = 2  # of a damper
RIDGE = 1e-6  # of the scaled normal matrix, so that few tests leave the rest of a damper as it is in the common fit


@dataclass(frozen=True)
class Parting:
    """The tests of two dampers.

    Attributes:
        second: which tests are the other damper's, shape (tests,).
        squares: weighted sum of squares of both fits.
        predicted: share of the misfit of held-out tests, each in turn, that is removed if the better of two dampers
            predicts them instead of one. Model error is split as well, but the two parts then predict little.
    """

    second: BoolArray
    squares: float
    predicted: float


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums of one test with the slopes at the common fit: products (p, p), with the residual (p,), and its square."""

    normal: FloatArray
    right: FloatArray
    squares: float
    gain: float


def two_groups(damper: Damper, common: Explained, parts: Sequence[Stretch]) -> Parting | None:
    """The best parting of the tests; None where there are too few of them.

    Args:
        damper: the damper; searches begin at the common fit.
        common: one fit to all tests.
        parts: the samples of all tests.
    """
    count = 1 + max(part.index for part in parts)
    if count < 2 * FEWEST_TESTS:
        return None
    sums = [_of_test(damper, common, [part for part in parts if part.index == k]) for k in range(count)]
    scale = unit_scale(np.sum([test.normal for test in sums], axis=0))
    best: tuple[float, BoolArray] | None = None
    for start in _starts(parts, sums):
        reached = _settled(start, sums, scale)
        if reached is not None and (best is None or reached[0] < best[0]):
            best = reached
    if best is None:
        return None
    squares = 0.0
    for side in (True, False):
        own = [part for part in parts if best[1][part.index] == side]
        squares += explain(damper, own, Distortion()).squares
    return Parting(best[1], squares, _predicted(best[1], sums, scale, sum(part.floor for part in parts)))


def _predicted(second: BoolArray, sums: Sequence[_Sums], scale: FloatArray, floor: float) -> float:
    one = two = 0.0
    for left_out, test in enumerate(sums):
        others = np.arange(second.size) != left_out
        errors = [_left(_step(sums, side & others, scale), [test])[0] for side in (second, ~second)]
        two += min(errors)
        one += _left(_step(sums, others, scale), [test])[0]
    return 1.0 - (two - floor) / max(one - floor, 1e-300)


def _of_test(damper: Damper, common: Explained, parts: Sequence[Stretch]) -> _Sums:
    count = len(damper.names)
    normal, right, squares, along, size = np.zeros((count, count)), np.zeros(count), 0.0, 0.0, 0.0
    for part in parts:
        rows, force = slope_rows(damper, common, part, Distortion())
        error, force = part.weights * (part.test.force_N - force), part.weights * force
        normal += rows.T @ rows
        right += rows.T @ error
        squares += float(error @ error)
        along += float(error @ force)
        size += float(force @ force)
    return _Sums(normal, right, squares, along / max(size, 1e-300))


def _starts(parts: Sequence[Stretch], sums: Sequence[_Sums]) -> Iterator[BoolArray]:
    count = len(sums)
    folders: Mapping[int, str] = {part.index: part.test.file.rpartition("/")[0] for part in parts}
    for folder in sorted(set(folders.values()))[1:]:
        yield np.array([folders[k] == folder for k in range(count)])
    for share in (0.5, 1.0 / 3.0, 2.0 / 3.0):
        yield np.arange(count) >= share * count
    gains = np.array([test.gain for test in sums])
    yield gains > float(np.median(gains))
    yield gains > float(0.5 * (np.min(gains) + np.max(gains)))
    random = np.random.default_rng(0)
    for _ in range(RANDOM_STARTS):
        yield random.random(count) < 0.5


def _settled(second: BoolArray, sums: Sequence[_Sums], scale: FloatArray) -> tuple[float, BoolArray] | None:
    """Sum of squares and parting after the last test has moved; None where a side has too few tests."""
    total = np.inf
    for _ in range(ROUNDS):
        if min(np.count_nonzero(second), np.count_nonzero(~second)) < FEWEST_TESTS:
            return None
        left = np.array([_left(_step(sums, side, scale), sums) for side in (~second, second)])
        moved, total = left[1] < left[0], float(np.sum(np.min(left, axis=0)))
        if np.array_equal(moved, second):
            break
        second = moved
    return total, second


def _step(sums: Sequence[_Sums], side: BoolArray, scale: FloatArray) -> FloatArray:
    chosen = [test for test, inside in zip(sums, side, strict=True) if inside]
    normal = np.sum([test.normal for test in chosen], axis=0) / np.outer(scale, scale)
    right = np.sum([test.right for test in chosen], axis=0) / scale
    return np.asarray(np.linalg.solve(normal + RIDGE * np.eye(scale.size), right) / scale)


def _left(step: FloatArray, sums: Sequence[_Sums]) -> list[float]:
    return [float(test.squares - 2.0 * step @ test.right + step @ test.normal @ step) for test in sums]

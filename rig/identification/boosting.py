"""Gradient boosting of regression trees for squared errors (Friedman 2001, algorithm 2; 2002 for the random halves).

Thresholds are quantiles of each input, so a tree counts rows by classes instead of sorting them. scikit-learn does the
same with every value as a threshold, and takes longer to load than all of this takes; the tests compare the two.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from rig.dampers.arrays import FloatArray

TREES, RATE, DEPTH, SHARE, SEED = 60, 0.2, 4, 0.5, 1
CLASSES = 256  # of each input
LEAVES = 2**DEPTH

Classes = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Tree:
    """One tree of `DEPTH` levels.

    Attributes:
        splits: of each level, for each of its nodes the input and the last class that goes left, shapes (nodes,).
        leaves: what each leaf adds, (`LEAVES`,).
    """

    splits: tuple[tuple[Classes, Classes], ...]
    leaves: FloatArray

    def leaf_of(self, classes: Classes) -> Classes:
        """The leaf of each row."""
        rows, node = np.arange(len(classes)), np.zeros(len(classes), dtype=np.intp)
        for inputs, lasts in self.splits:
            node = 2 * node + (classes[rows, inputs[node]] > lasts[node])
        return node


@dataclass(frozen=True)
class Boosted:
    """The sum of many trees.

    Attributes:
        limits: of each input, where its next class begins.
        mean: of the learnt values, in their unit.
        trees: their sum is what is added to the mean.
    """

    limits: tuple[FloatArray, ...]
    mean: float
    trees: tuple[Tree, ...]

    def predict(self, inputs: FloatArray) -> FloatArray:
        """The values (n,) of inputs (n, k)."""
        classes = _classes(inputs, self.limits)
        return np.asarray(self.mean + sum(tree.leaves[tree.leaf_of(classes)] for tree in self.trees))


def boosted(inputs: FloatArray, values: FloatArray, weights: FloatArray) -> Boosted:
    """Learn values (n,) from inputs (n, k), each row with its weight (n,); the same result each time."""
    random, shares = np.random.default_rng(SEED), np.linspace(0.0, 1.0, CLASSES + 1)[1:-1]
    limits = tuple(np.unique(np.quantile(column, shares)) for column in inputs.T)
    classes = _classes(inputs, limits)
    mean = float(np.average(values, weights=weights))
    left, trees = values - mean, []
    for _ in range(TREES):
        rows = random.permutation(len(values))[: max(1, round(SHARE * len(values)))]
        trees.append(_tree(classes[rows], left[rows], weights[rows]))
        left = left - trees[-1].leaves[trees[-1].leaf_of(classes)]
    return Boosted(limits, mean, tuple(trees))


def _classes(inputs: FloatArray, limits: tuple[FloatArray, ...]) -> Classes:
    columns = [np.searchsorted(limit, column, side="right") for limit, column in zip(limits, inputs.T, strict=True)]
    return np.column_stack(columns)


def _tree(classes: Classes, values: FloatArray, weights: FloatArray) -> Tree:
    """The tree whose leaves, `RATE` times their means, leave the least: split by split, without looking ahead."""
    count, width = classes.shape
    cells = (classes + CLASSES * np.arange(width)).ravel()
    weight, sum_ = np.repeat(weights, width), np.repeat(weights * values, width)
    rows, node, splits = np.arange(count), np.zeros(count, dtype=np.intp), []
    for level in range(DEPTH):
        places = cells + np.repeat(node * width * CLASSES, width)
        inputs, lasts = _best_splits(*(
            np.bincount(places, some, 2**level * width * CLASSES).reshape(2**level, width, CLASSES)
            for some in (weight, sum_)
        ))  # fmt: skip
        splits.append((inputs, lasts))
        node = 2 * node + (classes[rows, inputs[node]] > lasts[node])
    weight_of, sum_of = (np.bincount(node, some, LEAVES) for some in (weights, weights * values))
    return Tree(tuple(splits), RATE * sum_of / np.maximum(weight_of, np.finfo(float).tiny))


def _best_splits(weights: npt.NDArray[Any], sums: npt.NDArray[Any]) -> tuple[Classes, Classes]:
    """Of each node the input and the last class on the left that leave the least sum of squares.

    Args:
        weights: of the rows in each class, shape (nodes, k, `CLASSES`).
        sums: of weight times value, likewise.
    """
    left, left_sum = np.cumsum(weights, axis=2), np.cumsum(sums, axis=2)
    right, right_sum = left[:, :, -1:] - left, left_sum[:, :, -1:] - left_sum
    least = 1e-12 * left[:, :, -1:]  # of a side without rows, but for rounding
    with np.errstate(divide="ignore", invalid="ignore"):
        taken = np.where((left > least) & (right > least), left_sum**2 / left + right_sum**2 / right, -1.0)
    best = taken.reshape(len(taken), -1).argmax(axis=1)
    return best // CLASSES, best % CLASSES

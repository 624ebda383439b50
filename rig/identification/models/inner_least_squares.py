"""The inner least squares of variable projection: linear values solved for, from sums over samples.

Given the shape, F = X c_fixed + Y(shape) c_yield. The sums over X do not depend on the shape, so X is eliminated once;
what is left at each shape is a system of the few yield columns. The slope uses Kaufman's (1975) simplification.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray

SINGULAR = 1e-11  # directions of a scaled normal matrix below this share carry no information


@dataclass(frozen=True)
class Inner:
    """The inner solution at one shape: objective, linear values (fixed, then yield), and the projected slope.

    `gradient` (s,) is J'r and `curvature` (s, s) is J'J of the projected residual r with respect to the shape.
    """

    objective: float
    linear: FloatArray
    gradient: FloatArray
    curvature: FloatArray


class Reduction:
    """The inner least squares: fixed columns eliminated once, the few that depend on the shape at each shape.

    Args:
        normal: X'X of the weighted fixed columns, shape (k, k).
        right: X'F, shape (k,).
        power: F'F (N^2 where the weight is 1).
        free: which of the k fixed and q yield values are sought, shape (k + q,); the others stay at zero.
    """

    def __init__(self, normal: FloatArray, right: FloatArray, power: float, free: BoolArray) -> None:
        active, self._yielding = free[: right.size], free[right.size :]
        self._width = self._yielding.size
        self._white = np.zeros_like(normal)
        self._white[active] = white(normal[np.ix_(active, active)], right.size)
        self._known = self._white.T @ right
        self._left = power - float(self._known @ self._known)

    def solve(self, cross: FloatArray, right: FloatArray, own: FloatArray, bends: Sequence[slice] = ()) -> Inner:
        """The inner solution, with its projected slope where the columns of the slopes are given.

        Args:
            cross: Y'X of the weighted yield columns, then the columns of their slopes, shape (y, k).
            right: Y'F, shape (y,).
            own: Y'Y, shape (y, y).
            bends: for each shape parameter, the yield columns whose slopes follow, in turn.
        """
        table = self._swept(cross[None], right[None], own[None])[0]
        values = np.where(self._yielding, table[: self._width, -1], 0.0)
        fixed = self._white @ (self._known - values @ (cross[: self._width] @ self._white))
        mix, at = np.zeros((len(bends), own.shape[0] - self._width)), 0
        for k, bent in enumerate(bends):
            stop = at + bent.stop - bent.start
            mix[k, at:stop] = values[bent]
            at = stop
        slopes = slice(self._width, -1)
        gradient, curvature = mix @ table[slopes, -1], mix @ table[slopes, slopes] @ mix.T
        return Inner(max(float(table[-1, -1]), 0.0), np.concatenate((fixed, values)), gradient, curvature)

    def least(self, cross: FloatArray, right: FloatArray, own: FloatArray) -> FloatArray:
        """Objectives at many shapes, shape (S,), from the sums of `solve` without slopes, each with a first axis S."""
        return np.maximum(self._swept(cross, right, own)[:, -1, -1], 0.0)

    def _swept(self, cross: FloatArray, right: FloatArray, own: FloatArray) -> FloatArray:
        """The normal equations after elimination, shape (S, y + 1, y + 1), the force as the last column.

        Each yield column is swept (Goodnight 1979): then its place in the last column holds its value, the other
        places what is left of the products when it is projected out, the last corner the objective. A column that the
        others explain is passed over.
        """
        size = right.shape[1]
        projected = cross @ self._white
        table = np.empty((right.shape[0], size + 1, size + 1))
        table[:, :size, :size] = own - projected @ projected.transpose(0, 2, 1)
        table[:, :size, size] = table[:, size, :size] = right - projected @ self._known
        table[:, size, size] = self._left
        for k in np.flatnonzero(self._yielding):
            pivot = table[:, k, k]
            inverse = np.where(pivot > SINGULAR * own[:, k, k], 1.0 / np.where(pivot == 0.0, 1.0, pivot), 0.0)
            column = table[:, k].copy()
            scaled = column * inverse[:, None]
            table -= scaled[:, :, None] * column[:, None, :]
            table[:, k] = table[:, :, k] = scaled
            table[:, k, k] = -inverse
        return table


def white(normal: FloatArray, width: int) -> FloatArray:
    """H, shape (k, width), with H H' the inverse of `normal` (k, k) but for directions without information."""
    scale = np.sqrt(np.diag(normal))
    scale = np.where(scale > 0.0, scale, 1.0)
    values, vectors = np.linalg.eigh(normal / np.outer(scale, scale))
    carrying = values > SINGULAR * values[-1:]
    half = np.zeros((normal.shape[0], width))
    half[:, : int(np.count_nonzero(carrying))] = vectors[:, carrying] / scale[:, None] / np.sqrt(values[carrying])
    return half

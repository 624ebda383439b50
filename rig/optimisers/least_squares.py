"""Nonlinear least squares by damped Gauss-Newton steps (Levenberg 1944, Marquardt 1963): the descent of every fit."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from rig.optimisers.arrays import FloatArray

SINGULAR = 1e-10
"""Of a scaled normal matrix, below which a direction carries no information."""


class Squares(ABC):
    """A sum of squares of residuals r = measured - modelled, as a function of unknowns theta (p,).

    Bounds, logarithms and what is not admissible are its own matter: it moves its unknowns itself.
    """

    @abstractmethod
    def value(self, theta: FloatArray) -> float:
        """The sum of squares; infinite where the model is not finite."""

    @abstractmethod
    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """J'J (p, p) and J'r (p,), J the slope of the model; asked for where `value` was asked for last and taken."""

    def moved(self, theta: FloatArray, step: FloatArray) -> FloatArray:
        """Theta after a step (p,), inside its bounds."""
        return theta + step

    def admissible(self, theta: FloatArray) -> bool:
        """Whether a step may lead to theta; where a search starts is not asked."""
        del theta
        return True

    @property
    def spent(self) -> bool:
        """Whether no further evaluation is allowed."""
        return False


@dataclass(frozen=True)
class Descent:
    """How a descent is damped, and when it ends.

    Attributes:
        tolerance: it ends when a step promises less than this share of the sum of squares,
        absolute: or less than this besides.
        settled: it also ends after a step that reduced the sum of squares by less than this share of what is left.
        iterations: at most so many steps are tried,
        steps: and at most so many accepted; None for any number.
        damping: at the start, relative to the curvature of each unknown.
        less: factor on the damping after a step that led down.
        more: the same after one that did not.
        least_damping: that it has after such a step.
        smallest: damping never falls below this.
        most_damping: beyond it the descent ends.
        floor: least curvature of an unknown that the damping is relative to, as a share of the largest.
        longest: longest step of each unknown (p,); None for any length.
    """

    tolerance: float
    absolute: float = 0.0
    settled: float = 0.0
    iterations: int = 60
    steps: int | None = None
    damping: float = 1e-3
    less: float = 0.2
    more: float = 6.0
    least_damping: float = 0.0
    smallest: float = 0.0
    most_damping: float = 1e8
    floor: float = 0.0
    longest: FloatArray | None = None


def descend(squares: Squares, start: FloatArray, descent: Descent) -> tuple[FloatArray, float]:
    """Go down from a start.

    Args:
        squares: what is made small.
        start: where to begin, shape (p,).
        descent: how.

    Returns:
        The best unknowns (p,) and their sum of squares; infinite where the start is not admissible.
    """
    theta, value, damping = start, squares.value(start), descent.damping
    if not math.isfinite(value):
        return theta, value
    curvature, gradient = squares.slopes(theta)
    accepted = 0
    for _ in range(descent.iterations):
        if squares.spent:
            break
        step = damped_step(curvature, gradient, damping, descent.floor)
        if descent.longest is not None:
            step = np.minimum(np.maximum(step, -descent.longest), descent.longest)
        promised = float(step @ gradient)
        if not np.isfinite(step).all():
            break
        if promised <= descent.tolerance * value + descent.absolute:
            if promised >= 0.0 or damping > descent.most_damping:
                break
            damping = max(damping * descent.more, descent.least_damping)  # cut, it may lead up: the gradient does not
            continue
        trial = squares.moved(theta, step)
        reached = squares.value(trial) if squares.admissible(trial) else math.inf
        if reached < value:
            theta, value, gain = trial, reached, value - reached
            accepted += 1
            if accepted == descent.steps or gain < descent.settled * value:
                break
            damping = max(descent.smallest, damping * descent.less)
            curvature, gradient = squares.slopes(theta)
        else:
            damping = max(damping * descent.more, descent.least_damping)
            if damping > descent.most_damping:
                break
    return theta, value


def normal_equations(rows: Iterable[tuple[FloatArray, FloatArray]], size: int) -> tuple[FloatArray, FloatArray]:
    """J'J (size, size) and J'r (size,), summed over weighted slopes (n, size) and residuals (n,) of each test."""
    curvature, gradient = np.zeros((size, size)), np.zeros(size)
    for slopes, residual in rows:
        curvature += slopes.T @ slopes
        gradient += slopes.T @ residual
    return curvature, gradient


def unit_scale(normal: FloatArray, floor: float = 0.0) -> FloatArray:
    """Roots of a normal matrix's diagonal (p,), by which it is scaled to ones there; `floor` as in `Descent`."""
    own = np.abs(normal.diagonal())  # rounding makes it negative where a difference of large numbers is left
    return np.sqrt(np.maximum(own, max(1e-300, floor * float(np.max(own, initial=0.0)))))


@dataclass(frozen=True)
class Eliminated:
    """Normal equations of some unknowns, others eliminated (Golub and Pereyra 1973): those that follow them freely.

    Attributes:
        inverse: of the eliminated unknowns' own normal matrix, shape (e, e).
        cross: the others' products with them times that inverse, shape (k, e).
        normal: what is left of the others' normal matrix, shape (k, k).
    """

    inverse: FloatArray
    cross: FloatArray
    normal: FloatArray

    @classmethod
    def of(cls, normal: FloatArray, count: int) -> Eliminated:
        """Eliminate the first `count` unknowns of a normal matrix, shape (e + k, e + k)."""
        size = unit_scale(normal[:count, :count])
        scale = size[:, None] * size
        inverse = np.linalg.pinv(normal[:count, :count] / scale, rcond=SINGULAR, hermitian=True) / scale
        cross = normal[count:, :count] @ inverse
        return cls(inverse, cross, normal[count:, count:] - cross @ normal[:count, count:])

    def right(self, side: FloatArray) -> FloatArray:
        """What is left of a right side, shape (e + k,), for the others, shape (k,)."""
        count = self.inverse.shape[0]
        return np.asarray(side[count:] - self.cross @ side[:count])


def damped_step(curvature: FloatArray, gradient: FloatArray, damping: float, floor: float = 0.0) -> FloatArray:
    """The step (p,) of a damped normal equation, each unknown scaled by the root of its own curvature."""
    size = unit_scale(curvature, floor)
    scaled = curvature / (size[:, None] * size)
    scaled.flat[:: size.size + 1] += damping
    try:
        return np.asarray(np.linalg.solve(scaled, gradient / size) / size)
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.lstsq(scaled, gradient / size, rcond=None)[0] / size)

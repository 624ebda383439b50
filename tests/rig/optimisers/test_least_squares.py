"""Damped Gauss-Newton: what ends a descent, and what must not."""

from __future__ import annotations

import numpy as np
import pytest

from rig.optimisers.least_squares import Descent, Eliminated, Squares, damped_step, descend


class Line(Squares):
    """|target - slopes theta|^2, two unknowns that nearly do the same."""

    jacobian = np.array([[-0.1, -0.1], [-0.7, -1.3], [0.9, 1.8]])
    target = np.array([-2.8, -1.4, 0.7])

    def value(self, theta: np.ndarray) -> float:
        missed = self.target - self.jacobian @ theta
        return float(missed @ missed)

    def slopes(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.jacobian.T @ self.jacobian, self.jacobian.T @ (self.target - self.jacobian @ theta)


def test_a_step_that_leads_up_once_it_is_cut_does_not_end_the_descent() -> None:
    line, start, longest = Line(), np.zeros(2), np.ones(2)
    curvature, gradient = line.slopes(start)
    cut = np.clip(damped_step(curvature, gradient, 1e-3), -longest, longest)
    assert cut @ gradient < 0.0
    theta, left = descend(line, start, Descent(1e-9, longest=longest))
    assert left == line.value(theta)
    assert left < 0.9 * line.value(start)


class Counted(Line):
    """The same; `seen` are the unknowns whose slopes were taken."""

    def __init__(self) -> None:
        self.seen: list[np.ndarray] = []

    def slopes(self, theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        self.seen.append(theta)
        return super().slopes(theta)


def test_a_descent_ends_after_so_many_accepted_steps_or_one_that_gained_little_and_takes_no_slopes_there() -> None:
    longest = np.full(2, 0.1)
    for ends, descent in ((3, Descent(0.0, steps=3, longest=longest)), (1, Descent(0.0, settled=0.5, longest=longest))):
        line = Counted()
        theta, left = descend(line, np.zeros(2), descent)
        assert len(line.seen) == ends, "at the start and after every accepted step but the last"
        assert left == line.value(theta) < line.value(line.seen[-1])


def test_eliminated_unknowns_follow_the_others() -> None:
    columns = np.random.default_rng(0).normal(size=(20, 5))
    normal, right = columns.T @ columns, columns.T @ np.arange(20.0)
    left = Eliminated.of(normal, 3)
    assert np.linalg.solve(left.normal, left.right(right)) == pytest.approx(np.linalg.solve(normal, right)[3:])

"""Damped Gauss-Newton: what ends a descent, and what must not."""

from __future__ import annotations

import numpy as np

from rig.optimisers.least_squares import Descent, Squares, damped_step, descend


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

"""Small objectives with known optima."""

from __future__ import annotations

import numpy as np
import pytest


class Bowl:
    """Sum of squares about a point with negative coordinates: (x - target)' (x - target)."""

    def __init__(self, target: tuple[float, ...]) -> None:
        self.target = np.array(target)
        self.n_parameters = len(target)
        self.points: list[np.ndarray] = []

    def residuals(self, vector: np.ndarray) -> np.ndarray:
        return vector - self.target

    def batch(self, population: np.ndarray) -> np.ndarray:
        self.points.extend(population.copy())
        return np.sum((population - self.target) ** 2, axis=1)


@pytest.fixture
def bowl() -> Bowl:
    return Bowl((1.0, -2.0, 3.0, 0.5))


@pytest.fixture
def positive_bowl() -> Bowl:
    return Bowl((1.0, 2.0, 3.0, 0.5))

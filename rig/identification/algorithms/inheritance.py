"""What paper 2's three genetic algorithms share: rank weights, blending of parents, and the statistical stop.

Paper 2 is the novel GA for Bouc-Wen identification; its equations follow Haupt's continuous GA and Kwok et al. 2007.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from rig.identification.algorithms.search import Array, require


def rank_weights(kept: int) -> Array:
    """Probability of each survivor to be a parent, best first: P_k = (N_keep - k + 1) / sum(1..N_keep).

    Args:
        kept: N_keep.

    Returns:
        Shape (kept,), sums to 1.
    """
    ranks = np.arange(kept, 0, -1, dtype=np.float64)
    return np.asarray(ranks / ranks.sum())


def pick(weights: Array, draws: Array) -> npt.NDArray[np.int64]:
    """The first m whose cumulative probability reaches the draw.

    Args:
        weights: Shape (n,), sums to 1.
        draws: Any shape, uniform in [0, 1).

    Returns:
        Indices, the draws' shape.
    """
    return np.minimum(np.searchsorted(np.cumsum(weights), draws, side="left"), len(weights) - 1)


def blend(mothers: Array, fathers: Array, draws: Array) -> tuple[Array, Array]:
    """Two children of each couple: o1 = ma - r (ma - pa), o2 = pa + r (ma - pa).

    Args:
        mothers: Shape (n, p).
        fathers: Shape (n, p).
        draws: Shape (n, 1) or (n, p): r, uniform in [0, 1).

    Returns:
        First and second children, each shape (n, p).
    """
    difference = mothers - fathers
    return mothers - draws * difference, fathers + draws * difference


@dataclass
class StatisticalStop:
    """Stop when another 20 % improvement of the largest minimum error has become improbable.

    By maximum entropy the minimum error e of the generations is taken as exponentially distributed about its mean;
    the chance of an error above 0.2 e_max is exp(-0.2 e_max / mean e). Stop when q >= q_min and that chance is at
    most p.

    Attributes:
        q_min: Generations needed before the statistics count.
        p: Largest chance at which to stop.
        errors: Minimum error of every generation so far.
    """

    q_min: int
    p: float
    errors: list[float] = field(default_factory=list)

    def add(self, minimum_error: float) -> bool:
        """Add a generation.

        Args:
            minimum_error: Its smallest objective value, positive or zero.

        Returns:
            Whether to stop.
        """
        self.errors.append(minimum_error)
        if len(self.errors) < self.q_min:
            return False
        return self.chance() <= self.p

    def chance(self) -> float:
        """Chance exp(-0.2 e_max / mean e); 0 once every error is 0."""
        mean = math.fsum(self.errors) / len(self.errors)
        return math.exp(-0.2 * max(self.errors) / mean) if mean > 0.0 else 0.0


def require_stop(algorithm: str, q_min: int, p: float) -> None:
    """Refuse wrong settings of the statistical stop.

    Args:
        algorithm: Name, for the message.
        q_min: Generations, at least 1.
        p: Chance; 0 disables the stop.

    Raises:
        SearchError: A setting is out of range.
    """
    require(algorithm, "q_min", q_min, 1, 10**9)
    require(algorithm, "p", p, 0.0, 1.0)

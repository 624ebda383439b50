"""The original fruit fly optimisation algorithm (Pan 2012), reproduced as it is.

    X_i = X_0 + 2 rand - 1,  Y_i likewise,  D_i = sqrt(X_i^2 + Y_i^2),  S_i = 1 / D_i,  X_0 = 10 rand, Y_0 = 10 rand

S is a distance's inverse, so it is always positive: **no negative parameter can be reached**, and one of a thousand
only by a fly within a thousandth of the origin while steps stay +-1 wide. A preload of -270 N is out of reach
whatever the budget.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.identification.algorithms.search import Array, Search


@dataclass(frozen=True)
class FruitFly:
    """FOA has no settings. Positive values of a `start` place the swarm (X_0 = Y_0); other coordinates are drawn."""

    def run(self, search: Search) -> str:
        """Search until the budget is spent (the only stop).

        Args:
            search: Evaluates, counts and archives.

        Returns:
            Never: the search ends by its budget.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        centre = _centre(search)
        smell = np.inf
        while True:
            shape = (2, search.population, search.n_parameters)
            flies = swarm(centre, search.rng.random(shape))
            smells = search.evaluate(search.inside(parameters(flies)))
            best = int(np.argmin(smells))
            if smells[best] < smell:
                centre, smell = flies[:, best], float(smells[best])
            search.generation_done()


def _centre(search: Search) -> Array:
    drawn = 10.0 * search.rng.random((2, search.n_parameters))
    if search.start is None:
        return drawn
    reachable = search.start > 0.0
    inverse = 1.0 / (np.sqrt(2.0) * np.where(reachable, search.start, 1.0))
    return np.where(reachable, inverse, drawn)


def swarm(centre: Array, draws: Array) -> Array:
    """Flies around the swarm's place: X_0 + 2 rand - 1.

    Args:
        centre: Shape (2, p): X_0, Y_0.
        draws: Shape (2, N, p), uniform in [0, 1).

    Returns:
        Shape (2, N, p).
    """
    return centre[:, None, :] + 2.0 * draws - 1.0


def parameters(position: Array) -> Array:
    """Design vectors of positions: S = 1 / sqrt(X^2 + Y^2).

    Args:
        position: Shape (2, ..., p).

    Returns:
        Shape (..., p), always positive.
    """
    X, Y = position
    return np.asarray(1.0 / np.hypot(X, Y))

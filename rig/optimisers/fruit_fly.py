"""Fruit flies: contrast-based (c-FOA paper, section 3 and Fig. 6), as printed and as intended; and the original (FOA).

A fly has two coordinates for each parameter; the parameter is the signed inverse of its distance from the origin:

    X_ij = X_0j (1 + M (2 rand - 1))      Y_ij likewise          (13)
    D_ij = sqrt(X_ij^2 + Y_ij^2)                                 (14)
    s_ij = sign(X_ij) sign(Y_ij) / D_ij                          (15)

`rand` is `randi(1..N_res) / N_res`: taken literally, an integer from 1 to N_res would only ever shrink parameters.
With M < 1 the factor in (13) is positive, so no sign ever changes and a zero can never be left.

As printed:
    the swarm keeps the start's signs, so from all ones it never reaches a negative parameter (its preload F0 is -270
    N); it decides once t > kappa, comparing the swarm's best value with the attraction point's value kappa steps
    back: two floats that are never equal, so "visual contrast" never happens, and "casting" returns to where it
        already is.

As intended (default):
    the first swarm draws signs, so that its best fly settles them;
    it decides every kappa steps, comparing the attraction point's value with its own at the previous decision: a
    stagnation is seen as equality (18), and a contrast jump that did not pay within kappa steps is undone by the
    memory (19).
Either way K generations take N K + 1 evaluations, the start's and then those of N flies each time, and the true best is
archived apart by the search. What keeps both from the optimum: signs are settled before magnitudes, and M only ever
contracts.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.optimisers.arrays import FloatArray
from rig.optimisers.search import Search, SearchError, require


@dataclass(frozen=True)
class ContrastFruitFly:
    """Settings of c-FOA, with the paper's values.

    A search starts from `start`, or from all ones; a zero in the start is taken as one.

    Attributes:
        variant: `intended` or `printed`.
        kappa: Delay before a decision, generations.
        M: First search radius, a share of the attraction point's coordinates, below 1.
        resolution: N_res, steps of the discrete distribution in (13).
        c: Contraction of the radius when surging, (17).
    """

    variant: str = "intended"
    kappa: int = 5
    M: float = 0.95
    resolution: int = 100
    c: float = 0.9

    def __post_init__(self) -> None:
        if self.variant not in {"intended", "printed"}:
            raise SearchError(f"c_foa: variant: got {self.variant!r}, expected 'intended' or 'printed'")
        require("c_foa", "kappa", self.kappa, 1, 1000)
        require("c_foa", "M", self.M, 1e-12, 1 - 1e-12)
        require("c_foa", "resolution", self.resolution, 2, 10**9)
        require("c_foa", "c", self.c, 1e-12, 1.0)

    def run(self, search: Search) -> str:
        """Search until the budget is spent (the paper's only stop).

        Args:
            search: Evaluates, counts and archives.

        Returns:
            Never: the search ends by its budget.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        attraction = coordinates(np.ones(search.n_parameters) if search.start is None else search.start)
        smell = float(search.evaluate(search.inside(parameters(attraction))[None, :])[0])
        radius, age = self.M, 0
        trail = deque([(attraction, smell)], maxlen=self.kappa + 1)
        memory = trail[0]
        while True:
            flies = self._fly(search, attraction, radius, first=search.generations == 0)
            smells = search.evaluate(search.inside(parameters(flies)))
            best, worst = int(np.argmin(smells)), int(np.argmax(smells))
            if self.variant == "printed":
                memory = trail[0]
            if smells[best] < smell:
                attraction, smell = flies[:, best], float(smells[best])
            age += 1
            if age >= self.kappa + (self.variant == "printed"):
                compared = float(smells[best]) if self.variant == "printed" else smell
                decision = decide(compared, memory[1])
                held = (attraction, smell)
                if decision == "surge":
                    radius, memory = self.c * radius, held
                elif decision == "contrast":
                    attraction, smell, memory = flies[:, worst], float(smells[worst]), held
                else:
                    attraction, smell = memory
                age = 0
            trail.append((attraction, smell))
            search.generation_done()

    def _fly(self, search: Search, attraction: FloatArray, radius: float, *, first: bool) -> FloatArray:
        shape = (2, search.population, search.n_parameters)
        flies = swarm(
            attraction, radius, search.rng.integers(1, self.resolution, shape, endpoint=True), self.resolution
        )
        if first and self.variant == "intended":
            flies[0] *= search.rng.choice([-1.0, 1.0], shape[1:])
        return flies


def coordinates(point: FloatArray) -> FloatArray:
    """Coordinates of a design vector: (14) and (15) inverted with |X| = |Y|, the sign on X.

    Args:
        point: Shape (p,); a zero, which every fly near it would share for ever, is taken as one, the paper's start.

    Returns:
        Shape (2, p): X and Y.
    """
    usable = np.where(point == 0.0, 1.0, point)
    inverse = 1.0 / (np.sqrt(2.0) * np.abs(usable))
    return np.stack([np.sign(usable) * inverse, inverse])


def swarm(attraction: FloatArray, radius: float, draws: npt.NDArray[np.int64], resolution: int) -> FloatArray:
    """Flies near the attraction point, equation (13).

    Args:
        attraction: Shape (2, p): X_0, Y_0.
        radius: M.
        draws: Shape (2, N, p): integers from 1 to `resolution`.
        resolution: N_res.

    Returns:
        Shape (2, N, p).
    """
    return attraction[:, None, :] * (1.0 + radius * (2.0 * draws / resolution - 1.0))


def parameters(position: FloatArray) -> FloatArray:
    """Design vectors of positions, equations (14) and (15).

    Args:
        position: Shape (2, ..., p).

    Returns:
        Shape (..., p).
    """
    X, Y = position
    return np.asarray(np.sign(X) * np.sign(Y) / np.hypot(X, Y))


def decide(value: float, value_back: float) -> str:
    """What the swarm does after its delay, Fig. 6 lines 16-22 and (17)-(19).

    Args:
        value: Value compared (see the module's docstring for whose).
        value_back: The attraction point's value kappa steps back.

    Returns:
        `surge`, `contrast` or `cast`.
    """
    if value < value_back:
        return "surge"
    return "contrast" if value == value_back else "cast"


@dataclass(frozen=True)
class FruitFly:
    """The original fruit fly optimisation algorithm (Pan 2012), reproduced as it is.

        X_i = X_0 + 2 rand - 1,  Y_i likewise,  D_i = sqrt(X_i^2 + Y_i^2),  S_i = 1 / D_i,  X_0 = 10 rand, Y_0 = 10 rand

    S is a distance's inverse, so it is always positive: no negative parameter can be reached, and one of a thousand
    only by a fly within a thousandth of the origin while steps stay +-1 wide. A preload of -270 N is out of reach
    whatever the budget. It has no settings. Positive values of a `start` place the swarm (X_0 = Y_0); other coordinates
    are drawn.
    """

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
            flies = original_swarm(centre, search.rng.random(shape))
            smells = search.evaluate(search.inside(original_parameters(flies)))
            best = int(np.argmin(smells))
            if smells[best] < smell:
                centre, smell = flies[:, best], float(smells[best])
            search.generation_done()


def _centre(search: Search) -> FloatArray:
    drawn = 10.0 * search.rng.random((2, search.n_parameters))
    if search.start is None:
        return drawn
    reachable = search.start > 0.0
    inverse = 1.0 / (np.sqrt(2.0) * np.where(reachable, search.start, 1.0))
    return np.where(reachable, inverse, drawn)


def original_swarm(centre: FloatArray, draws: FloatArray) -> FloatArray:
    """Flies around the swarm's place: X_0 + 2 rand - 1.

    Args:
        centre: Shape (2, p): X_0, Y_0.
        draws: Shape (2, N, p), uniform in [0, 1).

    Returns:
        Shape (2, N, p).
    """
    return centre[:, None, :] + 2.0 * draws - 1.0


def original_parameters(position: FloatArray) -> FloatArray:
    """Design vectors of positions: S = 1 / sqrt(X^2 + Y^2).

    Args:
        position: Shape (2, ..., p).

    Returns:
        Shape (..., p), always positive.
    """
    X, Y = position
    return np.asarray(1.0 / np.hypot(X, Y))

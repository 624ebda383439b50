"""Differential evolution rand/1 with dither (Price, Storn, Lampinen 2005; dither as in Storn's `deopt`), Cr = 1.

    v_i = x_r1 + F_i (x_r2 - x_r3),  F_i uniform in [F, 1]: one for each vector (strategy 4) or for each generation
    (strategy 5)

r1, r2, r3 come from one random permutation and two rotations of it: mutually different, drawn afresh each generation.
In Storn's codes (`devec3`, `deopt`) the second rotation acts on the list that the first has rotated; here both act on
the permutation itself, by different turns. A trial replaces its target when it is not worse. With Cr = 1 every
component comes from the mutant.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from rig.optimisers.arrays import FloatArray
from rig.optimisers.search import Search, SearchError, require


@dataclass(frozen=True)
class DifferentialEvolution:
    """Settings of DE with the paper's values.

    The first population is uniform in the bounds (within +-`reach` where there are none), `start` its first member.

    Attributes:
        strategy: 4: a dither factor for each vector; 5: one for each generation.
        F: Lowest scale factor; the dither reaches from here to 1.
        crossover: Cr, share of components taken from the mutant.
        reach: Half width of the first population where unbounded.
        tolerance: Stop once the population's values differ by less than this share of their mean; 0 never (the paper).
    """

    strategy: int = 4
    F: float = 0.85
    crossover: float = 1.0
    reach: float = 10.0
    tolerance: float = 0.0

    def __post_init__(self) -> None:
        if self.strategy not in {4, 5}:
            raise SearchError(
                f"de: strategy: got {self.strategy!r}, expected 4 (dither per vector) or 5 (dither per generation)"
            )
        require("de", "F", self.F, 0.0, 1.0)
        require("de", "crossover", self.crossover, 0.0, 1.0)
        require("de", "reach", self.reach, 1e-300, 1e300)
        require("de", "tolerance", self.tolerance, 0.0, 1.0)

    def run(self, search: Search) -> str:
        """Search until the budget is spent or the population has collapsed.

        Args:
            search: Evaluates, counts and archives.

        Returns:
            `converged`.

        Raises:
            SearchEndedError: The budget is spent or the callback said stop.
        """
        members = search.draw(self.reach)
        values = search.evaluate(members)
        rng, (rows, size) = search.rng, members.shape
        while True:
            factors = rng.random((rows, 1) if self.strategy == 4 else (1, 1))
            base, difference_1, difference_2 = partners(rng.permutation(rows), turns(rng, rows))
            trials = mutants(members, base, difference_1, difference_2, self.F + (1.0 - self.F) * factors)
            kept = rng.random((rows, size)) >= self.crossover
            trials = np.where(kept, members, trials)
            trials = bounced(trials, members[base], search.low, search.high, rng.random((rows, size)))
            trial_values = search.evaluate(trials)
            better = trial_values <= values
            members[better], values[better] = trials[better], trial_values[better]
            search.generation_done()
            if np.ptp(values) < self.tolerance * abs(float(np.mean(values))):
                return "converged"


def turns(rng: np.random.Generator, rows: int) -> npt.NDArray[np.int64]:
    """Two different rotations of a permutation, 1 to 4 as in `devec3`.

    A whole turn, which `devec3` allows for four members, would pair a member with itself, so it is left out.

    Args:
        rng: Where they are drawn from.
        rows: Members N, at least 4.

    Returns:
        Shape (2,).
    """
    return np.asarray(rng.permutation(min(4, rows - 1))[:2] + 1)


def partners(
    order: npt.NDArray[np.int64], turns: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Indices r1, r2, r3 of every member: a permutation and two rotated copies, mutually different.

    Args:
        order: Shape (N,): a random permutation of 0..N-1.
        turns: Two different rotations between 1 and N - 1.

    Returns:
        Base vector and the two of the difference, each shape (N,).
    """
    return order, np.roll(order, -turns[0]), np.roll(order, -turns[1])


def mutants(
    members: FloatArray,
    base: npt.NDArray[np.int64],
    plus: npt.NDArray[np.int64],
    minus: npt.NDArray[np.int64],
    factor: FloatArray,
) -> FloatArray:
    """Mutant vectors rand/1: x_r1 + F (x_r2 - x_r3).

    Args:
        members: Shape (N, p).
        base: Shape (N,): r1.
        plus: Shape (N,): r2.
        minus: Shape (N,): r3.
        factor: Shape (N, 1) or (1, 1): dithered scale factors.

    Returns:
        Shape (N, p).
    """
    return members[base] + factor * (members[plus] - members[minus])


def bounced(trials: FloatArray, origin: FloatArray, low: FloatArray, high: FloatArray, draws: FloatArray) -> FloatArray:
    """Bring trials back inside as `devec3` does: somewhere between the bound they crossed and their base vector.

    Args:
        trials: Shape (N, p).
        origin: Shape (N, p): base vectors, inside the bounds.
        low: Shape (p,).
        high: Shape (p,).
        draws: Shape (N, p), uniform in [0, 1).

    Returns:
        Shape (N, p), inside the bounds.
    """
    bounded_low, bounded_high = np.where(np.isfinite(low), low, 0.0), np.where(np.isfinite(high), high, 0.0)
    below = np.where(trials < low, bounded_low + draws * (origin - bounded_low), trials)
    return np.where(below > high, bounded_high + draws * (origin - bounded_high), below)

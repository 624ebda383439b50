"""This lab's method: candidates drawn around the best so far, from an ever smaller box."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.optimisers.search import Search


@dataclass(frozen=True)
class Shrinking:
    """Random search in a shrinking box; `--method my_lab_shrinking`.

    Attributes:
        reach: half the box's width at first, where a parameter has no bounds.
        share: of the box's width that the next generation keeps.
        tolerance: the box's width, as a share of the first one, at which the search has converged.
    """

    reach: float = 1000.0
    share: float = 0.9
    tolerance: float = 1e-9

    def run(self, search: Search) -> str:
        """Search until the box is small; the search itself ends it when the budget is spent.

        Returns:
            Why it stopped by itself: `converged`.
        """
        low, high = search.box(self.reach)
        size = 1.0
        search.evaluate(search.draw(self.reach))
        while size > self.tolerance:
            shape = (search.population, search.n_parameters)
            around = search.best + size * (high - low) * (search.rng.random(shape) - 0.5)
            search.evaluate(np.clip(around, search.low, search.high))
            search.generation_done()
            size *= self.share
        return "converged"

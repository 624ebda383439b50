"""What a fit keeps of tests drawn again (`rig.identification.bootstrap`): intervals, and some of the draws."""

from __future__ import annotations

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.fits.entries import BootstrapInterval, BootstrapResult
from rig.identification.uncertainty.covariance import CONFIDENCE, quantile

PREDICTED = 200  # draws of which predictions are made, and that a file keeps
TAIL = 0.5 * (1.0 - CONFIDENCE)


def intervals_of(
    values: FloatArray, draws: FloatArray, tests: int, widening: float, bounds: FloatArray
) -> tuple[FloatArray, ...]:
    """Lower ends, upper ends and standard errors, (p,) each, about `values` (p,) of draws (count, p).

    The ends are within `bounds` (p, 2), the lowest and highest value of each parameter, as those of the intervals by
    covariance are.
    """
    low, middle, high = np.quantile(draws, [TAIL, 0.5, 1.0 - TAIL], axis=0)
    spread = np.std(draws, axis=0, ddof=1) * widening * quantile() / quantile(1, tests - 1.0)
    lowest, highest = np.minimum(bounds[:, 0], values), np.maximum(bounds[:, 1], values)
    ends = values - widening * (middle - low), values + widening * (high - middle)
    return np.maximum(ends[0], lowest), np.minimum(ends[1], highest), spread


def bootstrap_result(
    names: tuple[str, ...], values: FloatArray, draws: FloatArray, tests: int, widening: float, bounds: FloatArray
) -> BootstrapResult:
    """What a file keeps of draws (count, p) of the parameters `names` with the fitted `values` (p,)."""
    ends = np.column_stack(intervals_of(values, draws, tests, widening, bounds)).tolist()
    kept = draws[:PREDICTED].T.tolist()
    return BootstrapResult(
        draws.shape[0], tests, widening,
        {name: BootstrapInterval(*row) for name, row in zip(names, ends, strict=True)},
        {name: tuple(row) for name, row in zip(names, kept, strict=True)},
    )  # fmt: skip

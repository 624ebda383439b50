"""When each record of a step leaves its level."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import optimize

from rig.signals.arrays import FloatArray
from rig.signals.step_response.lag_fit import Group, fit_one_lag
from rig.signals.step_response.lags import Lags
from rig.signals.step_response.records import Record, Seen


def onsets(records: Sequence[Record]) -> tuple[FloatArray, float] | None:
    """When each record leaves its level, by one lag that is common to all of them.

    For a quantity with constant levels whose step was commanded at an unknown time.

    Args:
        records: one for each step; time 0 is near the step.

    Returns:
        The instants (n,), s, and their mean standard error (s); None where no lag describes the records, or the lag is
        shorter than the interval of the samples.
    """
    group = Group(records, Seen(drifts=False))
    first = fit_one_lag(group).theta
    count = len(records)
    start = np.concatenate((np.full(count, float(first[0])), [float(first[1])]))

    def residuals(theta: FloatArray) -> FloatArray:
        lag_s = math.exp(float(theta[-1]))
        return np.concatenate(group.rest([Lags(float(dead_s), lag_s) for dead_s in theta[:-1]]))

    scale = np.append(np.full(count, group.sample_s), 0.2)
    solved = optimize.least_squares(residuals, start, x_scale=scale, max_nfev=30)
    power = 2.0 * float(solved.cost) / max(1, group.count - 3 * count - 1)
    slopes = np.asarray(solved.jac, np.float64)
    covariance = power * np.linalg.pinv(slopes.T @ slopes)
    std_s = math.sqrt(float(np.mean(np.diag(covariance)[:-1])))
    # Between two samples, the instant and the lag cannot be distinguished.
    resolved = math.exp(float(solved.x[-1])) >= group.sample_s
    known = resolved and np.all(np.isfinite(solved.x)) and std_s < 0.5 * group.sample_s
    return (np.asarray(solved.x[:-1]), std_s) if known else None

"""Noise of the samples with its autocorrelation, and the scatter of the records beyond it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from rig.signals.arrays import FloatArray
from rig.signals.step_response.result import CONFIDENCE, NORMAL

MOST_ORDER, MOST_LAGS = 6, 200
HETEROGENEOUS = 0.05
"""Probability below which the scatter from record to record is more than the noise."""


@dataclass(frozen=True)
class Noise:
    """Autocovariance of the samples' noise.

    Attributes:
        variance: of a sample.
        correlation: (m,) at lags 0, 1, ...
    """

    variance: float
    correlation: FloatArray

    @property
    def next(self) -> float:
        """Correlation from one sample to the next."""
        return float(self.correlation[1]) if len(self.correlation) > 1 else 0.0

    def variance_of(self, weights: FloatArray) -> float:
        """Variance of a weighted sum of consecutive samples; weights (n,)."""
        total = float(weights @ weights)
        for lag in range(1, min(len(self.correlation), len(weights))):
            total += 2.0 * float(self.correlation[lag]) * float(weights[lag:] @ weights[:-lag])
        return self.variance * max(total, 0.0)

    def covariance_of(self, rows: FloatArray) -> FloatArray:
        """Covariance (p, p) of weighted sums of consecutive samples; rows (p, n)."""
        total = rows @ rows.T
        for lag in range(1, min(len(self.correlation), rows.shape[1])):
            shifted = rows[:, lag:] @ rows[:, :-lag].T
            total = total + float(self.correlation[lag]) * (shifted + shifted.T)
        return np.asarray(self.variance * total)


def noise_of(residuals: Sequence[FloatArray], spent: int) -> Noise:
    """Noise by an autoregression of the residuals (Yule and Walker; order by BIC).

    Args:
        residuals: of each record, (n,).
        spent: number of parameters that were fitted.
    """
    count = sum(map(len, residuals))
    power = sum(float(rest @ rest) for rest in residuals)
    variance = power / max(1, count - spent)
    if not power > 0.0:
        return Noise(0.0, np.ones(1))
    highest = min(MOST_ORDER, min(map(len, residuals)) // 4)
    rho = np.ones(MOST_ORDER + 1)
    for lag in range(1, highest + 1):
        rho[lag] = sum(float(rest[lag:] @ rest[:-lag]) for rest in residuals) / power
    best: tuple[float, FloatArray] = (0.0, np.zeros(0))
    for order in range(1, highest + 1):
        matrix = rho[np.abs(np.subtract.outer(np.arange(order), np.arange(order)))]
        terms = np.linalg.lstsq(matrix, rho[1 : order + 1], rcond=None)[0]
        left = 1.0 - float(terms @ rho[1 : order + 1])
        if left > 0.0 and count * math.log(left) + order * math.log(count) < best[0]:
            best = count * math.log(left) + order * math.log(count), np.asarray(terms, np.float64)
    terms = best[1]
    if not len(terms):
        return Noise(variance, np.ones(1))
    correlation = np.ones(MOST_LAGS)
    correlation[1 : len(terms) + 1] = rho[1 : len(terms) + 1]
    for lag in range(len(terms) + 1, MOST_LAGS):
        correlation[lag] = float(terms @ correlation[lag - len(terms) : lag][::-1])
    small = np.flatnonzero(np.abs(correlation) < 1e-3)
    return Noise(variance, correlation[: int(small[0]) if len(small) else MOST_LAGS])


def with_scatter(
    covariance: FloatArray, influences: FloatArray, variances: FloatArray
) -> tuple[FloatArray, bool, float]:
    """Covariance widened where records scatter by more than their noise, whether they do, and the 95 % quantile.

    The influence of a record on a parameter has the variance that its noise gives it; over n records the sum of the
    squares, each over its variance, is chi-square with n - 1 degrees of freedom (Birge 1932).

    Args:
        covariance: (p, p) by the noise.
        influences: (n, p) of each record on each parameter.
        variances: (n, p) of the influences by the noise.
    """
    count = len(influences)
    if count < 3:
        return covariance, False, NORMAL
    weights = variances / np.maximum(np.sum(variances, axis=0), 1e-300)
    apart = influences - weights * np.sum(influences, axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        chi = np.nansum(np.where(variances > 0.0, apart**2 / variances, 0.0), axis=0)
    worst = float(np.max(chi))
    if stats.chi2.sf(worst, count - 1) >= HETEROGENEOUS / influences.shape[1]:
        return covariance, False, NORMAL
    return covariance * worst / (count - 1), True, float(stats.t.ppf(0.5 + 0.5 * CONFIDENCE, count - 1))

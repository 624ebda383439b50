"""Huber's loss (1964): outliers count less in the fit, and not at all when it is judged whether the model fits.

rho(r) = r^2 / 2 up to a limit k, k |r| - k^2 / 2 beyond; k is `HUBER` standard deviations, which each test's median
absolute residual gives. Solved by reweighting: samples beyond k have weight k / |r|.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rig.dampers.model import DamperModel
from rig.identification.measurement import Measurement
from rig.identification.model_slope import modelled_force

FloatArray = NDArray[np.float64]

HUBER = 1.345  # standard deviations beyond which the loss grows linearly; 95 % efficient on normal noise
OUTLIER = 4.0  # standard deviations beyond which a sample is no noise
MEDIAN_OF_NORMAL = 0.6744897501960817  # median absolute value of standard normal noise


def huber_weights(
    model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]
) -> tuple[FloatArray, ...]:
    """Square roots of Huber's weights, one array (n,) a test; 1 within the limit.

    Raises:
        KeyError: a parameter is missing.
    """
    weights = []
    for each in measurements:
        error, deviation = _error_and_deviation_N(model, values, each)
        weights.append(np.sqrt(np.minimum(1.0, HUBER * deviation / np.maximum(error, 1e-300))))
    return tuple(weights)


def without_outliers(
    model: DamperModel, values: Mapping[str, float], measurements: Sequence[Measurement]
) -> list[Measurement]:
    """The tests with their outliers marked as samples that carry no measured force.

    Raises:
        KeyError: a parameter is missing.
    """
    kept = []
    for each in measurements:
        error, deviation = _error_and_deviation_N(model, values, each)
        kept.append(replace(each, usable=each.scored & (error <= OUTLIER * deviation)))
    return kept


def _error_and_deviation_N(
    model: DamperModel, values: Mapping[str, float], each: Measurement
) -> tuple[FloatArray, float]:
    """Absolute residual (n,), and its standard deviation but for outliers."""
    error: FloatArray = np.abs(each.force_N - modelled_force(model, values, each))
    return error, float(np.median(error[each.scored])) / MEDIAN_OF_NORMAL

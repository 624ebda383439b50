"""The band that the uncertainty of the parameters alone gives a prediction; `prediction_error` has the whole error.

Draws come from tests drawn again (`drawn`), which know of misfit; without them from the parameters' covariance, which
knows of the tests' noise and what repeats in it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import IdentificationFailed
from rig.fits.fit_record import FitRecord
from rig.identification.uncertainty.bootstrap_result import PREDICTED, TAIL

if TYPE_CHECKING:
    import pandas as pd


SEED = 0


def predict_with_band(
    predicted: Callable[[Mapping[str, float]], pd.DataFrame],
    names: tuple[str, ...],
    draws: FloatArray,
    widening: float,
) -> pd.DataFrame:
    """A fit's prediction with what the draws (k, p) of the parameters disagree about.

    `model_low_N` and `model_high_N` are the model's own force within 95 % of the draws. The prediction error of
    `low_N` and `high_N` is not widened: it is that of fits to some of the tests, whose parameters were as uncertain.

    Args:
        predicted: the prediction with some of the parameters' values (SI) in place of the fitted ones.
        names: the parameters that were drawn.
        draws: their values, shape (k, p).
        widening: factor on the spread of the draws.

    Raises:
        FileProblem: the table cannot be used.
        IdentificationFailed: the fit has no value of a parameter.
    """
    result = predicted({})
    forces = np.array([
        predicted(dict(zip(names, row, strict=True)))["force_N"].to_numpy() for row in draws.tolist()
    ])  # fmt: skip
    low, middle, high = np.quantile(forces, [TAIL, 0.5, 1.0 - TAIL], axis=0)
    force_N = result["force_N"].to_numpy()
    less, more = widening * (middle - low), widening * (high - middle)
    result["model_low_N"], result["model_high_N"] = force_N - less, force_N + more
    return result


def known_draws(fit: FitRecord) -> tuple[tuple[str, ...], FloatArray, float]:
    """Names, draws (k, p) and their widening: the fit's own, or draws of its covariance.

    Raises:
        IdentificationFailed: the fit has neither, or its parameters follow relations to the current.
    """
    if fit.current is not None:
        raise IdentificationFailed(
            "no uncertainty band: the parameters are functions of the current. Fix: fit with --current affine, or with "
            "a --current-law"
        )
    if fit.drawn is not None:
        names = tuple(fit.drawn.draws)
        return names, np.array([fit.drawn.draws[name] for name in names]).T, fit.drawn.widening
    names = tuple(
        name for name, estimate in fit.parameters.items()
        if estimate.determined and estimate.standard_error is not None and name in fit.correlation
    )  # fmt: skip
    if not names:
        raise IdentificationFailed("no uncertainty band: the fit has no covariance. Fix: fit again with --bootstrap")
    draws = fit.draws(names, PREDICTED, np.random.default_rng(SEED))
    return names, _inside(fit, names, draws), 1.0


def _inside(fit: FitRecord, names: tuple[str, ...], draws: FloatArray) -> FloatArray:
    """Draws within what the parameters' own intervals allow: a rate drawn below its limit is no rate."""
    for place, name in enumerate(names):
        estimate = fit.parameters[name]
        low, high = estimate.simultaneous_low, estimate.simultaneous_high
        draws[:, place] = np.clip(
            draws[:, place], -math.inf if low is None else low, math.inf if high is None else high
        )
    return draws

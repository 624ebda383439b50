"""The band that the uncertainty of the parameters gives a prediction.

Draws come from tests drawn again (`drawn`), which know of misfit; without them from the parameters' covariance, which
knows of the tests' noise and what repeats in it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import IdentificationFailed
from rig.identification.uncertainty.drawn import PREDICTED, TAIL

if TYPE_CHECKING:
    import pandas as pd

    from rig.identification.application.motion_table import Table

SEED = 0


def predict_with_band(
    fit: Any,  # noqa: ANN401 - a Fit, whose module imports this one
    names: tuple[str, ...],
    draws: FloatArray,
    widening: float,
    table: Table,
    mid_stroke_m: float,
) -> pd.DataFrame:
    """The fit's prediction, its band widened in squares by what the draws (k, p) of the parameters disagree about.

    `model_low_N` and `model_high_N` are the model's own force within 95 % of the draws.

    Raises:
        FileProblem: the table cannot be used.
        IdentificationFailed: the fit has no value of a parameter.
    """
    result: pd.DataFrame = fit.predict(table, mid_stroke_m=mid_stroke_m)
    forces = np.array([_force(fit, dict(zip(names, row, strict=True)), table, mid_stroke_m) for row in draws.tolist()])
    low, middle, high = np.quantile(forces, [TAIL, 0.5, 1.0 - TAIL], axis=0)
    force_N = result["force_N"].to_numpy()
    below, above = (force_N - result["low_N"].to_numpy(), result["high_N"].to_numpy() - force_N)
    less, more = widening * (middle - low), widening * (high - middle)
    result["low_N"], result["high_N"] = force_N - np.hypot(below, less), force_N + np.hypot(above, more)
    result["model_low_N"], result["model_high_N"] = force_N - less, force_N + more
    return result


def _force(
    fit: Any,  # noqa: ANN401 - as above
    values: Mapping[str, float],
    table: Table,
    mid_stroke_m: float,
) -> FloatArray:
    parameters = {
        name: replace(estimate, value=values[name]) if name in values else estimate
        for name, estimate in fit.parameters.items()
    }
    one = replace(fit, parameters=parameters, tested=None)
    force_N: FloatArray = one.predict(table, mid_stroke_m=mid_stroke_m)["force_N"].to_numpy()
    return force_N


def known_draws(
    fit: Any,  # noqa: ANN401 - as above
) -> tuple[tuple[str, ...], FloatArray, float]:
    """Names, draws (k, p) and their widening: the fit's own, or draws of its covariance.

    Raises:
        IdentificationFailed: the fit has neither, or its parameters follow relations to the current.
    """
    if fit.current is not None:
        raise IdentificationFailed(
            "no band of the parameters: they follow relations to the current; fit with --current affine, or with a "
            "--current-law"
        )
    if fit.drawn is not None:
        names = tuple(fit.drawn.draws)
        return names, np.array([fit.drawn.draws[name] for name in names]).T, fit.drawn.widening
    errors = {
        name: estimate.standard_error
        for name, estimate in fit.parameters.items()
        if estimate.identifiable and estimate.standard_error is not None and name in fit.correlation
    }
    names = tuple(errors)
    if not names:
        raise IdentificationFailed("no band of the parameters: the fit tells no covariance; fit again with --bootstrap")
    size = np.array([errors[name] for name in names], dtype=float)
    correlation = np.array([[fit.correlation[a].get(b) or 0.0 for b in names] for a in names], dtype=float)
    centre = np.array([fit.values[name] for name in names])
    random = np.random.default_rng(SEED)
    values, vectors = np.linalg.eigh(correlation)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    draws = centre + (random.standard_normal((PREDICTED, len(names))) @ root.T) * size
    return names, _inside(fit, names, draws), 1.0


def _inside(
    fit: Any,  # noqa: ANN401 - as above
    names: tuple[str, ...],
    draws: FloatArray,
) -> FloatArray:
    """Draws within what the parameters' own intervals allow: a rate drawn below its limit is no rate."""
    for place, name in enumerate(names):
        estimate = fit.parameters[name]
        low, high = estimate.simultaneous_low, estimate.simultaneous_high
        draws[:, place] = np.clip(
            draws[:, place], -math.inf if low is None else low, math.inf if high is None else high
        )
    return draws

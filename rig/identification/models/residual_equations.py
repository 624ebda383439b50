"""Normal equations of a residual: what a physical model leaves, over `rig.dampers.grey_regressors`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.grey_box import GreyBoxModel
from rig.dampers.grey_regressors import ELEMENTS, PARTS, regressors, weight_names
from rig.identification.models.measurement import Measurement
from rig.identification.models.model_slope import element_states, modelled_force

SHORTEST = 0.04  # travel of the first element, as a share of the smallest amplitude
LEAST_A, LEAST_V_M_S, LEAST_M = 0.05, 1e-6, 1e-9  # of half a tested range
ABSENT = 1e-12  # share of the greatest power of a regressor below which the tests do not excite it


def residual_values(
    model: GreyBoxModel, values: Mapping[str, float], tests: Sequence[Measurement], ridge: float
) -> dict[str, float]:
    """The residual's values (SI) for some tests, its parts and ridge given.

    Args:
        model: the grey-box model.
        values: of its physical model, fitted to these tests (SI).
        tests: the tests.
        ridge: the penalty (1).
    """
    ranges = ranges_of(tests)
    normal, right = summed([
        equations_of(ranges, test, test.force_N - modelled_force(model.base, values, test)) for test in tests
    ])
    weights = zip(weight_names(model.parts), weights_of(normal, right, model.parts, ridge).tolist(), strict=True)
    known = {**ranges, "ridge": ridge, **dict(weights)}
    return {name: known[name] for name in model.residual_names}


def ranges_of(tests: Sequence[Measurement]) -> dict[str, float]:
    """The residual's ranges and travels for some tests, by name (SI)."""
    (low_m, high_m), (low_v, high_v), (low_A, high_A) = (
        (min(low for low, _ in ends), max(high for _, high in ends))
        for ends in zip(*(test.reaches for test in tests), strict=True)
    )
    amplitudes = [0.5 * (test.reaches[0][1] - test.reaches[0][0]) for test in tests]
    travels = np.geomspace(max(SHORTEST * min(amplitudes), LEAST_M), max(*amplitudes, LEAST_M), ELEMENTS)
    return {
        "u_mid": 0.5 * (low_m + high_m), "u_half": max(0.5 * (high_m - low_m), LEAST_M),
        "v_top": max(abs(low_v), abs(high_v), LEAST_V_M_S),
        "i_mid": 0.5 * (low_A + high_A), "i_half": max(0.5 * (high_A - low_A), LEAST_A),
        **{f"travel_{k}": float(travel) for k, travel in enumerate(travels, start=1)},
    }  # fmt: skip


def columns_along(ranges: Mapping[str, float], test: Measurement) -> FloatArray:
    """All regressors along a test, (n, weights)."""
    z = element_states(ranges, test)
    return regressors(PARTS, ranges, test.u_m, test.v_m_s, test.current_A, z)


def equations_of(ranges: Mapping[str, float], test: Measurement, left_N: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normal matrix and right side of what a test leaves, (n,) N, in squares of its peak."""
    columns, left = columns_along(ranges, test)[test.scored], left_N[test.scored]
    counts = test.peak_force_N**2 * left.size
    return columns.T @ columns / counts, columns.T @ left / counts


def summed(equations: Sequence[tuple[FloatArray, FloatArray]]) -> tuple[FloatArray, FloatArray]:
    """Sum of the normal matrices and of the right sides."""
    return np.sum([one for one, _ in equations], axis=0), np.sum([one for _, one in equations], axis=0)


def places_of(parts: Sequence[str]) -> FloatArray:
    """Columns of all regressors that belong to some parts."""
    every = weight_names(PARTS)
    return np.array([every.index(name) for name in weight_names(parts)])


def weights_of(normal: FloatArray, right: FloatArray, parts: Sequence[str], ridge: float) -> FloatArray:
    """The weights (N) of some parts; 0 of what the tests do not excite."""
    places = places_of(parts)
    block, wanted = normal[np.ix_(places, places)], right[places]
    power = np.diag(block)
    excited = power > ABSENT * np.max(power, initial=1e-300)
    weights = np.zeros(places.size)
    rows = np.ix_(excited, excited)
    weights[excited] = np.linalg.solve(block[rows] + np.diag(ridge * power[excited]), wanted[excited])
    return weights

"""Separable identification of the algebraic models: global over their one or two shape parameters, linear in the rest.

Method (no start needed): a grid over steepness and loop width on thinned data, with ranges from the greatest speed;
Levenberg-Marquardt from the best few on the thinned data; then on all samples. The grid is what makes it global: from a
single start one fit in six stops in a false minimum, where the tanh has saturated to sgn(u).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.dampers.algebraic import AlgebraicModel
from rig.identification.measurement import Measurement
from rig.identification.projection import AlgebraicForm, Inner, Projection, Weighting

FloatArray = NDArray[np.float64]

THINNED_SAMPLES = 2500
STEEPNESS = np.geomspace(1.5, 1500.0, 11)  # beta times the greatest speed
WIDTHS = np.array([0.0, 0.004, 0.01, 0.02, 0.04, 0.08, 0.16, 0.3, 0.55, 0.9])  # loop half width over the greatest speed
STARTS = 4
ITERATIONS = 60
TOLERANCE = 1e-9


@dataclass(frozen=True)
class Solution:
    """A fit of an algebraic model.

    Attributes:
        values: parameter name to SI value, eta left out.
        objective: equation (12) at the solution, over the samples that count.
        evaluations: passes over all samples; those over thinned data count by their share.
        at_bound: names of parameters held at a bound by a constraint.
    """

    values: dict[str, float]
    objective: float
    evaluations: int
    at_bound: tuple[str, ...] = ()


def solve_separable(
    measurements: Sequence[Measurement],
    model: AlgebraicModel,
    weighting: Weighting | None = None,
    *,
    held: frozenset[str] = frozenset(),
    non_negative: frozenset[str] = frozenset({"m"}),
    start: FloatArray | None = None,
) -> Solution:
    """Fit an algebraic model.

    Args:
        measurements: the tests.
        model: an algebraic damper model.
        weighting: which samples count, and how much; all alike by default.
        held: linear parameters left out, held at zero.
        non_negative: parameters that must not be negative; one that would be is held at zero.
        start: shape parameters to start from instead of the grid, shape (s,).

    Returns:
        The best solution found; `values` in SI by name.
    """
    weighting = weighting or Weighting()
    form = AlgebraicForm(model)
    full = Projection(form, measurements, weighting, without=held)
    cost = 0.0
    if not model.shape_names:
        shape, inner = np.zeros(0), full.solve(np.zeros(0), slope=False)
    else:
        starts = [] if start is None else [start]
        if not starts:
            every = max(1, full.samples // THINNED_SAMPLES)
            thin = Projection(form, measurements, weighting, every=every, without=held)
            starts = _starts(thin, max(float(np.max(np.abs(each.v_m_s))) for each in measurements))
            cost = thin.evaluations / every
        found = [levenberg_marquardt(full, each) for each in starts]
        shape, inner = min(found, key=lambda each: each[1].objective)
    names = (*model.fixed_names, *model.yield_names)
    bound = tuple(name for name, value in zip(names, inner.linear, strict=True) if name in non_negative and value < 0.0)
    evaluations = full.evaluations + int(np.ceil(cost))
    if bound:
        rest = Projection(form, measurements, weighting, without=held | frozenset(bound))
        shape, inner = levenberg_marquardt(rest, shape) if shape.size else (shape, rest.solve(shape, slope=False))
        evaluations += rest.evaluations
    pairs = (*zip(names, inner.linear, strict=True), *zip(model.shape_names, shape, strict=True))
    return Solution({name: float(value) for name, value in pairs}, inner.objective, evaluations, bound)


def _starts(thin: Projection, top_speed_m_s: float) -> list[FloatArray]:
    """The two best distinct minima of the thinned data."""
    refined = [levenberg_marquardt(thin, each) for each in _best_of_grid(thin, top_speed_m_s)]
    kept: list[FloatArray] = []
    for shape, _ in sorted(refined, key=lambda found: found[1].objective):
        if not any(np.allclose(shape, other, rtol=0.02, atol=1e-3) for other in kept):
            kept.append(shape)
    return kept[:2]


def _best_of_grid(thin: Projection, top_speed_m_s: float) -> list[FloatArray]:
    """The best local minima of a grid over steepness and loop width."""
    printed = thin.form.shape_names[1] == "lambda"
    values = np.empty((STEEPNESS.size, WIDTHS.size))
    shapes = np.empty((STEEPNESS.size, WIDTHS.size, 2))
    for i, steepness in enumerate(STEEPNESS):
        for j, width in enumerate(WIDTHS):
            shapes[i, j] = steepness / top_speed_m_s, width * (top_speed_m_s if printed else steepness)
            values[i, j] = thin.objective(shapes[i, j])
    padded = np.pad(values, 1, constant_values=np.inf)
    neighbours = np.min(
        [padded[1 + i : padded.shape[0] - 1 + i, 1 + j : padded.shape[1] - 1 + j] for i, j in AROUND], axis=0
    )
    minima = np.argwhere(values <= neighbours)
    order = np.argsort(values[tuple(minima.T)])[:STARTS]
    return [shapes[tuple(minima[k])] for k in order]


AROUND = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]


def levenberg_marquardt(projection: Projection, start: FloatArray) -> tuple[FloatArray, Inner]:
    """Minimise the projected objective from `start` (s,); positive parameters are searched by their logarithms."""
    shape, inner = start, projection.solve(start)
    logarithmic = np.array(projection.form.logarithmic)
    damping = 1e-3
    for _ in range(ITERATIONS):
        chain = np.where(logarithmic, shape, 1.0)
        gradient, curvature = inner.gradient * chain, inner.curvature * np.outer(chain, chain)
        scale = np.maximum(np.diag(curvature), 1e-300)
        step = np.linalg.solve(curvature + damping * np.diag(scale), gradient)
        step = np.where(logarithmic, np.clip(step, -1.5, 1.5), step)
        promised = float(step @ gradient)
        if not np.all(np.isfinite(step)) or promised <= TOLERANCE * inner.objective:
            break
        trial = np.where(logarithmic, shape * np.exp(np.where(logarithmic, step, 0.0)), shape + step)
        trial = np.clip(trial, projection.form.limits[:, 0], projection.form.limits[:, 1])
        found = projection.solve(trial)
        if found.objective < inner.objective:
            shape, inner, damping = trial, found, damping * 0.2
        else:
            damping *= 6.0
            if damping > 1e8:
                break
    return shape, inner

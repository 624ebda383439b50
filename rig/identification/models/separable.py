"""Separable identification of the algebraic models: global over their one or two shape parameters, linear in the rest.

Method (no start needed): a grid over steepness and loop width on thinned data, with ranges from the greatest speed;
Levenberg-Marquardt from the best few on the thinned data; then on all samples. The grid is what makes it global: from a
single start one fit in six stops in a false minimum, where the tanh has saturated to sgn(u). What is returned as the
objective is summed from the residuals themselves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rig.dampers.algebraic import AlgebraicModel, TanhModel
from rig.dampers.arrays import FloatArray
from rig.errors import IdentificationFailed
from rig.identification.models.inner_least_squares import Inner
from rig.identification.models.measurement import Measurement
from rig.identification.models.projection import AlgebraicForm, Projection, Weighting
from rig.identification.models.tanh_projection import TanhProjection

THINNED_SAMPLES = 2500
STEEPNESS = np.geomspace(1.5, 1500.0, 11)  # beta times the greatest speed
WIDTHS = np.array([0.0, 0.004, 0.01, 0.02, 0.04, 0.08, 0.16, 0.3, 0.55, 0.9])  # loop half width over the greatest speed
STARTS = 4
ITERATIONS = 60
TOLERANCE = 1e-9
ROUGH = 1e-4  # tolerance on the thinned data, whose minimum is further than that from the one sought
RULED_OUT = 4.0  # times the best minimum's objective on the thinned data: not the best on all data either,
AT_LIMIT = 1e-3  # of a limit: a search that ends so near to it has met it
FEW_DECIDE = 1e-6  # unless both leave less than this share of the force, where few samples decide


class GivenUp(IdentificationFailed):
    """A model was not fitted to the end, because another one describes the tests far better already."""


@dataclass(frozen=True)
class Solution:
    """A fit of an algebraic model.

    Attributes:
        values: parameter name to SI value, eta left out.
        objective: equation (12) at the solution, over the samples that count.
        evaluations: passes over all samples; those over thinned data count by their share.
        at_bound: names of parameters that would be negative and are held at 0.
        at_limit: names of parameters at which the search ended at a limit, and that limit in the parameter's unit.
        extra: square roots of the weights that a robust loss ended with, one array (n,) a test; None without.
    """

    values: dict[str, float]
    objective: float
    evaluations: int
    at_bound: tuple[str, ...] = ()
    at_limit: Mapping[str, float] = field(default_factory=dict)
    extra: tuple[FloatArray, ...] | None = None


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
    names = (*model.fixed_names, *model.yield_names)
    if not isinstance(model, TanhModel):
        return _without_shape(measurements, model, weighting, held, non_negative)
    full, cost = TanhProjection(model, measurements, weighting, without=held), 0.0
    starts = [] if start is None else [start]
    if not starts:
        every = max(1, sum(each.u_m.size for each in measurements) // THINNED_SAMPLES)
        thin = TanhProjection(model, measurements, weighting, every=every, without=held)
        starts = _starts(thin, max(float(max(np.max(each.v_m_s), -np.min(each.v_m_s))) for each in measurements))
        cost = thin.evaluations / every
    found = [levenberg_marquardt(full, each) for each in starts]
    shape, inner = min(found, key=lambda each: each[1].objective)
    bound = _negative(names, inner, non_negative)
    if bound:
        rest = full.without(held | frozenset(bound))
        shape, inner = levenberg_marquardt(rest, shape)
        cost += rest.evaluations
    objective = full.plain(shape, inner.linear)
    pairs = (*zip(names, inner.linear, strict=True), *zip(model.shape_names, shape, strict=True))
    values = {name: float(value) for name, value in pairs}
    limits = limits_met(model.shape_names, shape, full.form.limits)
    return Solution(values, objective, full.evaluations + int(np.ceil(cost)), bound, limits)


def _without_shape(
    measurements: Sequence[Measurement],
    model: AlgebraicModel,
    weighting: Weighting,
    held: frozenset[str],
    non_negative: frozenset[str],
) -> Solution:
    """A model without shape parameters is one linear least squares."""
    names = (*model.fixed_names, *model.yield_names)
    form = AlgebraicForm(model)
    whole = Projection(form, measurements, weighting, without=held)
    inner = whole.solve(np.zeros(0), slope=False)
    bound = _negative(names, inner, non_negative)
    if bound:
        whole = Projection(form, measurements, weighting, without=held | frozenset(bound))
        inner = whole.solve(np.zeros(0), slope=False)
    values = {name: float(value) for name, value in zip(names, inner.linear, strict=True)}
    return Solution(values, inner.objective, 1 + bool(bound), bound)


def limits_met(names: Sequence[str], shape: FloatArray, limits: FloatArray) -> dict[str, float]:
    """The shape parameters that lie at a limit of their search, with that limit.

    Args:
        names: of the shape parameters.
        shape: where the search ended, shape (s,).
        limits: lowest and highest value of each, shape (s, 2).
    """
    met = {}
    for name, value, ends in zip(names, shape.tolist(), limits.tolist(), strict=True):
        for end in ends:
            if math.isfinite(end) and abs(value - end) <= AT_LIMIT * abs(end):
                met[name] = end
    return met


def _negative(names: Sequence[str], inner: Inner, non_negative: frozenset[str]) -> tuple[str, ...]:
    """Names of the values that are negative and must not be."""
    pairs = zip(names, inner.linear, strict=True)
    return tuple(name for name, value in pairs if name in non_negative and value < 0.0)


def _starts(thin: TanhProjection, top_speed_m_s: float) -> list[FloatArray]:
    """The best minimum of the thinned data, and the next one where those data do not rule it out."""
    refined = [levenberg_marquardt(thin, each, ROUGH) for each in _best_of_grid(thin, top_speed_m_s)]
    (best, inner), *others = sorted(refined, key=lambda found: found[1].objective)
    possible = RULED_OUT * inner.objective + FEW_DECIDE * thin.power
    for shape, rival in others:
        if rival.objective <= possible and not np.allclose(shape, best, rtol=0.1, atol=1e-3):
            return [best, shape]
    return [best]


def _best_of_grid(thin: TanhProjection, top_speed_m_s: float) -> list[FloatArray]:
    """The best local minima of a grid over steepness and loop width."""
    printed = thin.form.shape_names[1] == "lambda"
    beta, width = np.meshgrid(STEEPNESS / top_speed_m_s, WIDTHS * top_speed_m_s, indexing="ij")
    shapes = np.stack((beta, width if printed else beta * width), axis=-1)
    values = thin.objectives(shapes.reshape(-1, 2)).reshape(beta.shape)
    padded = np.pad(values, 1, constant_values=np.inf)
    neighbours = np.min(
        [padded[1 + i : padded.shape[0] - 1 + i, 1 + j : padded.shape[1] - 1 + j] for i, j in AROUND], axis=0
    )
    minima = np.argwhere(values <= neighbours)
    order = np.argsort(values[tuple(minima.T)])[:STARTS]
    return [shapes[tuple(minima[k])] for k in order]


AROUND = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]


def levenberg_marquardt(
    projection: Projection | TanhProjection, start: FloatArray, tolerance: float = TOLERANCE
) -> tuple[FloatArray, Inner]:
    """Minimise the projected objective; positive parameters are searched by their logarithms.

    Args:
        projection: the objective as a function of the shape.
        start: shape parameters, shape (s,).
        tolerance: it ends when a step promises less than this share of the objective.
    """
    shape, inner = start, projection.solve(start)
    logarithmic, limits = np.array(projection.form.logarithmic), projection.form.limits
    damping = 1e-3
    for _ in range(ITERATIONS):
        chain = np.where(logarithmic, shape, 1.0)
        gradient, curvature = inner.gradient * chain, inner.curvature * (chain[:, None] * chain)
        damped = curvature.copy()
        damped.flat[:: shape.size + 1] += damping * np.maximum(curvature.diagonal(), 1e-300)
        step = np.linalg.solve(damped, gradient)
        step[logarithmic] = np.minimum(np.maximum(step[logarithmic], -1.5), 1.5)
        promised = float(step @ gradient)
        if not np.isfinite(step).all() or promised <= tolerance * inner.objective:
            break
        trial = shape + step
        trial[logarithmic] = shape[logarithmic] * np.exp(step[logarithmic])
        trial = np.minimum(np.maximum(trial, limits[:, 0]), limits[:, 1])
        found = projection.solve(trial)
        if found.objective < inner.objective:
            shape, inner, damping = trial, found, damping * 0.2
        else:
            damping *= 6.0
            if damping > 1e8:
                break
    return shape, inner

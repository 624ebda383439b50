"""Separable fits: global over the few shape parameters of a model, linear in the rest.

Method (no start needed): a grid over the shape on thinned data or one cycle of each test, refined from the best few
there, then finished on all samples. The grid is what makes it global: from a single start one fit of a tanh model in
six stops in a false minimum, where the tanh has saturated to sgn(u). What a tanh model's fit returns as the objective
is summed from the residuals themselves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from rig.dampers.algebraic import AlgebraicSeparation, ColumnModel, TanhModel, needs_kernel_only
from rig.dampers.arrays import FloatArray
from rig.dampers.parameter import ModelProblem
from rig.dampers.separation import MotionScale, Separation
from rig.errors import IdentificationFailed
from rig.identification.models.inner_least_squares import Inner
from rig.identification.models.measurement import Measurement, all_but, first_cycle, spaced, spanning
from rig.identification.models.projection import Projection, Weighting
from rig.identification.models.tanh_projection import TanhProjection
from rig.identification.remarks import Remark, say
from rig.optimisers.least_squares import Descent, Squares, descend, unit_scale

THINNED_SAMPLES = 2500
SEARCHED = 125  # samples of a cycle that the search of a model with states sees
SCREENED = 30  # tests on which the starts of such a search are compared
STARTS = 4  # of a tanh model's grid, refined on thinned data
LOOP_STARTS = 3  # of a loop's grid, refined on one cycle of each test
TOLERANCE = 1e-9  # share of the objective that a step must promise
ROUGH = 1e-4  # the same on thinned data, whose minimum is further than that from the one sought
LOOP_ROUGH, LOOP_FINE = 1e-3, 1e-8  # the same for loops: among starts, at last
LONGEST_LOGARITHM = 1.5  # step of a shape parameter that is searched by its logarithm
RULED_OUT = 4.0  # times the best minimum's objective on the thinned data: not the best on all data either,
FEW_DECIDE = 1e-6  # unless both leave less than this share of the force, where few samples decide
ABANDON_RATIO = 2.0  # times a rival's root mean square error, after the descents; start values are not compared
LEAST_CURVATURE = 0.02  # least eigenvalue of the estimated curvature, each unknown scaled by its own J'J
FLAT = 1e-12  # share of the largest curvature below which the curvature of an unknown is not estimated
NON_NEGATIVE = frozenset({"m"})  # linear parameters of algebraic models
NEWTON_STEP = 1e-3  # share of a shape parameter by which it is moved to compute the curvature of folds
AT_LIMIT = 1e-3  # of a limit: a search that ends so near to it has met it
AROUND = [(i, j) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]


@dataclass(frozen=True)
class SearchState:
    """State of a search when it was compared with the error of another model.

    Attributes:
        rmse_N: root mean square error on one cycle of each test of `spanning` (N).
        evaluations: number of evaluations until then, on the same samples.
        selected: whether these are not all tests.
    """

    rmse_N: float
    evaluations: int
    selected: bool

    def abandon_reason(self, model: str, rival_N: float) -> Remark | None:
        """Reason to abandon the search; None to continue.

        Args:
            model: name of the searched model.
            rival_N: root mean square error of the best other model on the same tests (N).
        """
        if self.rmse_N <= ABANDON_RATIO * rival_N:
            return None
        return say(
            "given-up", model=model, evaluations=self.evaluations, reached_N=self.rmse_N,
            times=self.rmse_N / rival_N, rival_N=rival_N,
            tests=f"each of {SCREENED} selected tests" if self.selected else "each test",
        )  # fmt: skip


class SearchAbandoned(IdentificationFailed):
    """The fit of a model was abandoned, because another model already describes the tests far better.

    Attributes:
        reached: state of the search.
    """

    def __init__(self, reason: str, reached: SearchState) -> None:
        super().__init__(reason)
        self.reached = reached


@dataclass(frozen=True)
class Solution:
    """A fitted model.

    Attributes:
        values: parameter name to SI value, eta left out.
        objective: equation (12) at the solution, over the weighted samples.
        evaluations: number of passes over all samples; passes over thinned data count as fractions.
        at_bound: names of parameters that would be negative and are fixed at 0.
        at_limit: names of parameters that ended at a limit of the search, with the limit in the parameter's unit.
        extra: square roots of the final weights of a robust loss, one array (n,) per test; otherwise None.
        reached: state of the search when it was compared with a rival; None if it was not compared.
    """

    values: dict[str, float]
    objective: float
    evaluations: int
    at_bound: tuple[str, ...] = ()
    at_limit: Mapping[str, float] = field(default_factory=dict)
    extra: tuple[FloatArray, ...] | None = None
    reached: SearchState | None = None


def motion_scale(measurements: Sequence[Measurement]) -> MotionScale:
    """What the motion of these tests is like."""
    return MotionScale(
        smallest_amplitude_m=min(float(np.ptp(test.u_m)) / 2.0 for test in measurements),
        top_speed_m_s=max(float(np.max(np.abs(test.v_m_s))) for test in measurements),
        mean_current_A=float(np.mean([np.mean(test.current_A) for test in measurements])),
        low_current_A=min(float(np.min(test.current_A)) for test in measurements),
        high_current_A=max(float(np.max(test.current_A)) for test in measurements),
        interval_s=min(test.dt_s for test in measurements),
    )


def solve_separable(
    measurements: Sequence[Measurement],
    model: ColumnModel,
    weighting: Weighting | None = None,
    *,
    held: frozenset[str] = frozenset(),
    non_negative: frozenset[str] = NON_NEGATIVE,
    start: FloatArray | None = None,
) -> Solution:
    """Fit an algebraic model whose columns are known in closed form.

    Args:
        measurements: the tests.
        model: the damper model.
        weighting: which samples count, and how much; all alike by default.
        held: linear parameters left out, held at zero.
        non_negative: parameters that must not be negative; one that would be is held at zero.
        start: shape parameters to start from instead of the grid, shape (s,).

    Returns:
        The best solution found; `values` in SI by name.

    Raises:
        ModelProblem: the model has shape parameters and is not a tanh model.
    """
    weighting = weighting or Weighting()
    if not isinstance(model, TanhModel):
        if model.shape_names:
            raise ModelProblem(needs_kernel_only(model.name))
        return _without_shape(measurements, model, weighting, held, non_negative)
    full, cost = TanhProjection(model, measurements, weighting, without=held), 0.0
    starts = [] if start is None else [start]
    if not starts:
        every = max(1, sum(test.u_m.size for test in measurements) // THINNED_SAMPLES)
        few = full.thin_samples(every)
        thin = TanhProjection(model, measurements, weighting, every=every, without=held, kept=few)
        top_m_s = max(float(max(np.max(test.v_m_s), -np.min(test.v_m_s))) for test in measurements)
        starts = _starts(thin, model.start_grid(top_m_s))
        cost = thin.evaluations / every
    best = min((refine(full, shape) for shape in starts), key=lambda minimum: minimum.inner.objective)
    bound = _negative(full.form, best.inner, non_negative)
    if bound:
        rest = full.without(held | frozenset(bound))
        best = refine(rest, best.shape)
        cost += rest.evaluations
    shape, inner = best.shape, best.inner
    objective = full.plain(shape, inner.linear)
    limits = limits_met(full.form, shape)
    evaluations = full.evaluations + int(np.ceil(cost))
    return Solution(full.form.values(inner.linear, shape), objective, evaluations, bound, limits)


def _without_shape(
    measurements: Sequence[Measurement],
    model: ColumnModel,
    weighting: Weighting,
    held: frozenset[str],
    non_negative: frozenset[str],
) -> Solution:
    """A model without shape parameters is one linear least squares."""
    form, nothing = AlgebraicSeparation(model), np.zeros(0)
    whole = Projection(form, measurements, weighting, without=held)
    inner = whole.solve(nothing, slope=False)
    bound = _negative(form, inner, non_negative)
    if bound:
        whole = Projection(form, measurements, weighting, without=held | frozenset(bound))
        inner = whole.solve(nothing, slope=False)
    return Solution(form.values(inner.linear, nothing), inner.objective, 1 + bool(bound), bound)


def solve_loop(
    measurements: Sequence[Measurement],
    form: Separation,
    weighting: Weighting,
    held: frozenset[str],
    near: Mapping[str, float] | None = None,
) -> Solution:
    """Fit any model that splits: given its shape, the force is linear in the rest.

    Its starts are compared on one cycle of at most `SCREENED` tests; the best is refined on all samples.

    Args:
        measurements: the tests.
        form: how it splits.
        weighting: which samples count, and how much.
        held: linear parameters left out, held at zero.
        near: values to start from instead of the form's starts.
    """
    without = form.held_here(held)
    single, passes = [first_cycle(test) for test in measurements], 0.0
    if near is None:
        # weights of single samples, as a robust loss gives them, belong to all samples of a cycle, and each to its test
        few = single if weighting.extra is not None else [spaced(one, SEARCHED) for one in spanning(single, SCREENED)]
        thin = Projection(form, few, weighting, without=without)
        order = np.argsort([thin.objective(shape) for shape in form.starts])[:LOOP_STARTS]
        refined = [refine(thin, form.starts[k], LOOP_ROUGH, secant=True) for k in order]
        start = min(refined, key=lambda minimum: minimum.inner.objective).shape
        passes += thin.evaluations * _samples(few)
    else:
        start = form.shape_of(near)
    full, rest = Projection(form, measurements, weighting, without=without), None
    if not all(one is test for one, test in zip(single, measurements, strict=True)):
        short = Projection(form, single, weighting, without=without)
        of_short = refine(short, start, LOOP_FINE, secant=True)
        start, rest = of_short.shape, of_short.rest * (full.samples / max(1, short.samples))
        passes += short.evaluations * _samples(single)
    best = refine(full, start, LOOP_FINE, secant=True, rest=rest)
    evaluations = full.evaluations + int(np.ceil(passes / _samples(measurements)))
    values = form.values(best.inner.linear, best.shape)
    return Solution(values, best.inner.objective, evaluations, at_limit=limits_met(form, best.shape))


def solve_folds(
    measurements: Sequence[Measurement],
    split: Callable[[Sequence[Measurement]], Separation],
    weighting: Weighting,
    folds: Sequence[tuple[Sequence[int], frozenset[str]]],
    near: Mapping[str, float],
) -> list[dict[str, float]]:
    """Parameters (SI) of fits to all tests but one group, for each group.

    The model is fitted to all tests first. The sums over the samples there, and at a small step of each shape parameter
    from there, are computed once: they give the gradient and the curvature of each fit, whose first step is then a
    Newton step.

    Args:
        measurements: the tests.
        split: splits the model, with limits that suit the tests.
        weighting: which samples count, and how much.
        folds: indices of the tests of each group, with the linear parameters held at zero when it is left out.
        near: values to start from.
    """
    group_of = np.zeros(len(measurements), dtype=int)
    for number, (group, _) in enumerate(folds):
        group_of[list(group)] = number
    form = split(measurements)
    without = form.held_here(frozenset.intersection(*(held for _, held in folds)))
    whole = Projection(form, measurements, weighting, without=without, groups=group_of.tolist())
    start = refine(whole, form.shape_of(near), LOOP_FINE, secant=True).shape
    beside = _beside(form, start)
    for shape in (start, *beside):
        whole.remember(shape)
    solutions = []
    for number, (group, held) in enumerate(folds):
        own = split(all_but(measurements, group))
        projection = whole.left_out(number, own, own.held_here(held))
        inside = np.clip(start, own.limits[:, 0], own.limits[:, 1])
        rest = _rest(projection, start, beside) if beside else None
        best = refine(projection, inside, LOOP_FINE, secant=True, rest=rest)
        solutions.append(own.values(best.inner.linear, best.shape))
    return solutions


def _beside(form: Separation, shape: FloatArray) -> list[FloatArray]:
    """A small step of each shape parameter from a shape, within the limits; none if one of them cannot move."""
    shapes = []
    for k, (logarithmic, (_, high)) in enumerate(zip(form.logarithmic, form.limits.tolist(), strict=True)):
        step = NEWTON_STEP * float(shape[k] if logarithmic else max(abs(shape[k]), 1.0))
        moved = shape.copy()
        moved[k] += step if shape[k] + step <= high else -step
        if step <= 0.0:
            return []
        shapes.append(moved)
    return shapes


def _rest(projection: Projection, start: FloatArray, beside: Sequence[FloatArray]) -> FloatArray:
    """Curvature that J'J leaves out at `start`, shape (s, s), from the gradients at the shapes of `_beside`."""
    logarithmic = np.array(projection.form.logarithmic, dtype=bool)
    at, chain = projection.solve(start), np.where(logarithmic, start, 1.0)
    whole = np.empty((start.size, start.size))
    for k, shape in enumerate(beside):
        change = projection.solve(shape).gradient * np.where(logarithmic, shape, 1.0) - at.gradient * chain
        whole[k] = -change / (math.log(shape[k] / start[k]) if logarithmic[k] else shape[k] - start[k])
    return np.asarray(0.5 * (whole + whole.T) - at.curvature * (chain[:, None] * chain))


def _samples(measurements: Sequence[Measurement]) -> int:
    return sum(test.u_m.size for test in measurements)


def limits_met(form: Separation, shape: FloatArray) -> dict[str, float]:
    """The shape parameters that lie at a limit of their search, by the model's names, with that limit.

    Args:
        form: the model, split.
        shape: where the search ended, shape (s,).
    """
    met = {}
    for name, value, ends in zip(form.shape_names, shape.tolist(), form.limits.tolist(), strict=True):
        for end in ends:
            if math.isfinite(end) and abs(value - end) <= AT_LIMIT * abs(end):
                met[name] = end
    return form.at_limit(met)


def _negative(form: Separation, inner: Inner, non_negative: frozenset[str]) -> tuple[str, ...]:
    """Names of the linear values that are negative and must not be."""
    pairs = zip((*form.fixed_names, *form.yield_names), inner.linear, strict=True)
    return tuple(name for name, value in pairs if name in non_negative and value < 0.0)


def _starts(thin: TanhProjection, grid: FloatArray) -> list[FloatArray]:
    """The best minimum of the thinned data, and the next one where those data do not rule it out."""
    refined = [refine(thin, shape, ROUGH) for shape in _best_of_grid(thin, grid)]
    best, *others = sorted(refined, key=lambda minimum: minimum.inner.objective)
    possible = RULED_OUT * best.inner.objective + FEW_DECIDE * thin.power
    for other in others:
        if other.inner.objective <= possible and not np.allclose(other.shape, best.shape, rtol=0.1, atol=1e-3):
            return [best.shape, other.shape]
    return [best.shape]


def _best_of_grid(thin: TanhProjection, grid: FloatArray) -> list[FloatArray]:
    """The best local minima of a grid (b, w, 2) over steepness and loop width."""
    values = thin.objectives(grid.reshape(-1, 2)).reshape(grid.shape[:2])
    padded = np.pad(values, 1, constant_values=np.inf)
    neighbours = np.min(
        [padded[1 + i : padded.shape[0] - 1 + i, 1 + j : padded.shape[1] - 1 + j] for i, j in AROUND], axis=0
    )
    minima = np.argwhere(values <= neighbours)
    order = np.argsort(values[tuple(minima.T)])[:STARTS]
    return [grid[tuple(minima[k])] for k in order]


class Projected(Protocol):
    """An objective as a function of the shape alone, the linear parameters solved for."""

    @property
    def form(self) -> Separation:
        """The model, split."""

    def solve(self, shape: FloatArray, *, slope: bool = True) -> Inner:
        """The inner solution at a shape (s,), with its projected slope."""


class _ShapeSquares(Squares):
    """The projected sum of squares: one pass gives value and slopes; positive shapes move by their logarithms.

    J'J alone is not the curvature if the residual is misfit: the descent then converges slowly, in zigzag steps. With
    `secant`, the rest is estimated from the changes of the gradient (Powell's symmetric Broyden update; compare Dennis,
    Gay and Welsch 1981) and added as long as the sum is positive definite. A shape parameter at a limit stays there
    while the objective falls beyond it.
    """

    def __init__(self, projection: Projected, *, secant: bool, rest: FloatArray | None = None) -> None:
        self._projection = projection
        self.logarithmic, self._limits = np.array(projection.form.logarithmic, dtype=bool), projection.form.limits
        self._last: tuple[FloatArray, Inner] | None = None
        self._secant = secant
        self._before: tuple[FloatArray, FloatArray] | None = None
        self.rest = np.zeros((self.logarithmic.size, self.logarithmic.size)) if rest is None else rest

    def at(self, theta: FloatArray) -> Inner:
        """The inner solution; computed once for successive calls with the same shape."""
        if self._last is None or not np.array_equal(theta, self._last[0]):
            self._last = theta, self._projection.solve(theta)
        return self._last[1]

    def forget(self) -> None:
        """Return to J'J alone."""
        self._before, self.rest = None, np.zeros_like(self.rest)

    def value(self, theta: FloatArray) -> float:
        """See `Squares.value`."""
        return self.at(theta).objective

    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Squares.slopes`."""
        inner = self.at(theta)
        chain = np.where(self.logarithmic, theta, 1.0)
        curvature, gradient = inner.curvature * (chain[:, None] * chain), inner.gradient * chain
        if self._secant:
            moving = self.logarithmic & (theta > 0.0)
            self._learn(np.where(moving, np.log(np.where(moving, theta, 1.0)), theta), gradient, curvature)
            curvature = self._whole(curvature)
        low, high = self._limits[:, 0], self._limits[:, 1]
        fixed = ((theta <= low) & (gradient < 0.0)) | ((theta >= high) & (gradient > 0.0))
        if fixed.any():
            own = np.diag(curvature).copy()
            curvature[fixed] = curvature[:, fixed] = 0.0
            np.fill_diagonal(curvature, own)
            gradient[fixed] = 0.0
        return curvature, gradient

    def _whole(self, curvature: FloatArray) -> FloatArray:
        """J'J with the estimated rest; J'J alone if the sum is not positive definite or the shape has no effect."""
        if not np.max(np.abs(self.rest), initial=0.0) < np.max(np.diag(curvature), initial=0.0) / FLAT:
            return curvature
        whole, scale = curvature + self.rest, unit_scale(curvature, FLAT)
        definite = np.linalg.eigvalsh(whole / np.outer(scale, scale))[0] > LEAST_CURVATURE
        return whole if definite else curvature

    def _learn(self, place: FloatArray, gradient: FloatArray, curvature: FloatArray) -> None:
        """Update the rest of the curvature from the change of the gradient since the last accepted shape."""
        if self._before is not None:
            step, change = place - self._before[0], self._before[1] - gradient
            length = float(step @ step)
            if length > 0.0:
                missing = change - (curvature + self.rest) @ step
                self.rest += (np.outer(missing, step) + np.outer(step, missing)) / length
                self.rest -= float(step @ missing) / length**2 * np.outer(step, step)
        self._before = place, gradient.copy()

    def moved(self, theta: FloatArray, step: FloatArray) -> FloatArray:
        """See `Squares.moved`."""
        trial = theta + step
        trial[self.logarithmic] = theta[self.logarithmic] * np.exp(step[self.logarithmic])
        return np.asarray(np.minimum(np.maximum(trial, self._limits[:, 0]), self._limits[:, 1]))


@dataclass(frozen=True)
class Minimum:
    """Where a descent on a projected objective ended.

    Attributes:
        shape: shape parameters, shape (s,).
        inner: the inner solution there.
        rest: estimate of the curvature that J'J leaves out, by logarithms of positive parameters, shape (s, s).
    """

    shape: FloatArray
    inner: Inner
    rest: FloatArray


def refine(
    projection: Projected,
    start: FloatArray,
    tolerance: float = TOLERANCE,
    *,
    secant: bool = False,
    rest: FloatArray | None = None,
) -> Minimum:
    """Descend on the projected objective.

    Args:
        projection: the objective as a function of the shape.
        start: shape parameters, shape (s,).
        tolerance: it ends when a step promises less than this share of the objective.
        secant: whether the rest of the curvature is estimated, too; see `_ShapeSquares`. A search with a fine tolerance
            is then continued from J'J alone, because an estimate that is too large ends it too early.
        rest: that rest at the start, shape (s, s); unknown by default.
    """
    squares = _ShapeSquares(projection, secant=secant, rest=rest)
    descent = Descent(tolerance, longest=np.where(squares.logarithmic, LONGEST_LOGARITHM, np.inf))
    shape, _ = descend(squares, start, descent)
    estimate = squares.rest
    if secant and tolerance < LOOP_ROUGH:
        squares.forget()
        shape, _ = descend(squares, shape, descent)
    return Minimum(shape, squares.at(shape), estimate)

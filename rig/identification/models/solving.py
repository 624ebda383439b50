"""One model fitted to measurements by a named method: values and their cost, nothing judged yet.

Huber's loss (1964): rho(r) = r^2 / 2 up to a limit k, k |r| - k^2 / 2 beyond; k is `HUBER` standard deviations, which
each test's median absolute residual gives. Solved by reweighting: samples beyond k have weight k / |r|. Outliers count
less in the fit, and not at all when it is judged whether the model fits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from rig.dampers import MODELS
from rig.dampers.algebraic import AlgebraicSeparation, ColumnModel, TanhModel
from rig.dampers.arrays import FloatArray
from rig.dampers.current_law_model import CurrentLawModel, base_of
from rig.dampers.grey_box import GreyBoxModel
from rig.dampers.model import DamperModel
from rig.dampers.separation import Separation
from rig.errors import IdentificationFailed
from rig.identification.models.law_search import solve_with_current_law
from rig.identification.models.measurement import Measurement, all_but
from rig.identification.models.model_slope import modelled_force, without_residual
from rig.identification.models.problem import FixedParameters, Problem, unmirrored
from rig.identification.models.projection import Weight, Weighting
from rig.identification.models.residual_equations import residual_values
from rig.identification.models.separable import (
    NON_NEGATIVE,
    Solution,
    motion_scale,
    solve_loop,
    solve_separable,
)
from rig.identification.models.separable import solve_folds as split_folds
from rig.identification.models.three_steps import solve_three_steps
from rig.identification.models.undetermined import Undetermined, examine

if TYPE_CHECKING:  # it loads logging and threads, which a fit does not need
    from concurrent.futures import Executor

SEPARABLE = "separable"
SQUARES = "squares"
LOSSES = (SQUARES, "huber")
WEIGHTS = (None, "1", "v", "relative")
BOUNDS = ("model", "wide", "none")
WIDE = 1e4  # half of the papers' unknown range, in each parameter's own unit
THREE_STEPS = "zhu_three_step"
GUARD_S = 1e-3
ROBUST_ROUNDS = 8


@dataclass(frozen=True)
class Method:
    """How to fit.

    Attributes:
        name: "separable", one of the papers' algorithms, or "zhu_three_step".
        weight: "1", "v", "relative" (separable fits only; see `Weighting`), or None for the method's own (the papers'
            algorithms: v; the others: 1).
        loss: "squares", or "huber" (separable fits of models that are linear but for a few shape parameters).
        budget: evaluations of equation (12) for the papers' algorithms.
        population: candidates a generation.
        seed: of every random draw.
        bounds: where the papers' algorithms search: "model", each parameter's own range; "wide", +-10,000 in SI for
            all of them, or "none", as the papers do with parameters of which nothing is known. Without the model's
            ranges there is no start but the algorithm's own.
        callback: called with the progress after each generation.
        executor: evaluates parts of populations.
        chunks: parts a population is cut into for the executor; None: one for each processor of this machine.

    Raises:
        IdentificationFailed: an unknown weight, loss or bounds, or bounds of a method that searches none.
    """

    name: str = SEPARABLE
    weight: str | None = None
    loss: str = SQUARES
    budget: int = 16_000
    population: int = 50
    seed: int = 0
    bounds: str = "model"
    callback: Callable[[Any], bool | None] | None = None
    executor: Executor | None = None
    chunks: int | None = None

    def __post_init__(self) -> None:
        settings: tuple[tuple[str, str | None, tuple[str | None, ...]], ...] = (
            ("weight", self.weight, WEIGHTS), ("loss", self.loss, LOSSES), ("bounds", self.bounds, BOUNDS),
        )  # fmt: skip
        for setting, value, known in settings:
            if value not in known:
                raise IdentificationFailed(
                    f"method: got {setting} = {value!r}, expected one of {', '.join(map(repr, known))}"
                )
        if self.bounds != "model" and self.name in {SEPARABLE, THREE_STEPS}:
            raise IdentificationFailed(
                f"method: {self.name} does not use a search range; bounds {self.bounds!r} apply only to the papers' "
                "algorithms, such as 'c_foa'"
            )
        if self.weight == "relative" and self.name != SEPARABLE:
            raise IdentificationFailed(
                f"method: {self.name} minimises equation (12) of the c-FOA paper, which has weights '1' and 'v'; "
                f"'relative' is available only for {SEPARABLE}"
            )

    @property
    def without_executor(self) -> Method:
        """This method without an executor, for a job in a worker."""
        return replace(self, executor=None, chunks=None, callback=None)

    def weighting(self, model: DamperModel) -> Weighting:
        """Which samples count for a model, and how much; those at its jumps do not."""
        weight = cast("Weight", self.weight or ("1" if self.name in {SEPARABLE, THREE_STEPS} else "v"))
        guard_s = GUARD_S if self.name == SEPARABLE else 0.0
        return Weighting(
            weight,
            guard_s if model.jumps_at == "mid-stroke" else 0.0,
            guard_s if model.jumps_at == "reversal" else 0.0,
        )


def known_methods() -> tuple[str, ...]:
    """Names of all methods."""
    # loads all algorithms: only when needed
    from rig.optimisers import METHODS

    return (SEPARABLE, *METHODS, THREE_STEPS)


def solve(
    model: DamperModel,
    measurements: Sequence[Measurement],
    method: Method,
    findings: Undetermined,
    start: Mapping[str, float] | None = None,
    rival_N: float = math.inf,
    *,
    exact: bool = False,
) -> Solution:
    """Fit one model.

    Args:
        model: the damper model.
        measurements: the tests.
        method: how.
        findings: parameters the tests cannot determine are held, at zero or where the findings fix them.
        start: values of a fit to nearly the same tests; `separable` then needs no global search.
        rival_N: root mean square error of another model on the tests of `spanning` (N).
        exact: from a start, search a model with internal states to the end on all samples too.

    Raises:
        IdentificationFailed: the method is unknown, has not this loss for this model, or found nothing.
        SearchAbandoned: the rival is so much better that the model was not fitted to the end.
    """
    if method.loss != SQUARES and not (method.name == SEPARABLE and splits(model, measurements)):
        having = ", ".join(name for name, other in MODELS.items() if splits(other, measurements))
        raise IdentificationFailed(
            f"loss: got {method.loss!r} for {model.name} with method {method.name}, expected {SQUARES!r}; other losses "
            f"need separable least squares and a model that is linear except for a few shape parameters ({having})"
        )
    if method.name == SEPARABLE:
        held, weighting = frozenset(findings.held), method.weighting(model)
        solution = solve_weighted(model, measurements, weighting, held, start, rival_N, exact=exact)
        return solution if method.loss == SQUARES else _robust(model, measurements, weighting, held, solution)
    if method.name == THREE_STEPS:
        return solve_three_steps(model, measurements, method.weighting(model), frozenset(findings.held))
    if method.name not in known_methods():
        raise IdentificationFailed(f"method: got {method.name!r}, expected one of {', '.join(known_methods())}")
    return _search(model, measurements, method, findings)


def solve_folds(
    model: DamperModel,
    measurements: Sequence[Measurement],
    groups: Sequence[Sequence[int]],
    method: Method,
    near: Mapping[str, float] | None,
) -> list[dict[str, float]]:
    """Parameters (SI) of fits to all tests but one group, for each group.

    Args:
        model: the damper model.
        measurements: the tests.
        groups: indices of the tests of each group.
        method: how, as in `solve`.
        near: values of a fit to all tests, to start from.

    Raises:
        IdentificationFailed: as `solve`.
    """
    rests = [all_but(measurements, group) for group in groups]
    if isinstance(model, GreyBoxModel) and near is not None:
        physical = solve_folds(model.base, measurements, groups, method, model.of_base(near))
        return [
            {**values, **residual_values(model, values, rest, near["ridge"])}
            for values, rest in zip(physical, rests, strict=True)
        ]
    findings = [examine(model, rest) for rest in rests]
    split = _splitting(model, measurements) if method.name == SEPARABLE and method.loss == SQUARES else None
    if split is None or near is None:
        return [solve(model, rest, method, one, near).values for rest, one in zip(rests, findings, strict=True)]
    folds = [(group, frozenset(one.held)) for group, one in zip(groups, findings, strict=True)]
    fitted = split_folds(measurements, split, method.weighting(model), folds, near)
    for number, values in enumerate(fitted):
        if isinstance(model, ColumnModel) and any(values.get(name, 0.0) < 0.0 for name in NON_NEGATIVE):
            fitted[number] = solve(model, rests[number], method, findings[number], values).values
    return fitted


def _splitting(
    model: DamperModel, measurements: Sequence[Measurement]
) -> Callable[[Sequence[Measurement]], Separation] | None:
    """How a model with shape parameters splits for some tests; None if it does not, or is fitted otherwise."""
    if isinstance(model, TanhModel):
        form = AlgebraicSeparation(model)
        return lambda tests: form
    if isinstance(model, ColumnModel | CurrentLawModel) or not splits(model, measurements):
        return None
    return lambda tests: cast("Separation", model.separation(motion_scale(tests)))


@dataclass
class Refit:
    """One model fitted to changed versions of the same tests; each search starts from the previous solution.

    Attributes:
        model: the damper model.
        method: how, as in `solve`.
        findings: as in `solve`.
        values: of the last solution (SI); empty before the first.
    """

    model: DamperModel
    method: Method
    findings: Undetermined
    values: dict[str, float] = field(default_factory=dict)

    def __call__(self, tests: Sequence[Measurement]) -> Solution:
        """Fit the model to one version of the tests.

        Raises:
            IdentificationFailed: as `solve`.
        """
        solution = solve(self.model, tests, self.method, self.findings, self.values or None)
        self.values.update(solution.values)
        return solution


def splits(model: DamperModel, measurements: Sequence[Measurement]) -> bool:
    """Whether a model is linear but for a few shape parameters, so that weighted fits of it are quick and exact."""
    model = base_of(model)
    return isinstance(model, ColumnModel) or model.separation(motion_scale(measurements)) is not None


def solve_weighted(
    model: DamperModel,
    measurements: Sequence[Measurement],
    weighting: Weighting,
    held: frozenset[str],
    near: Mapping[str, float] | None = None,
    rival_N: float = math.inf,
    *,
    exact: bool = False,
) -> Solution:
    """The weighted least-squares fit of one model.

    Args:
        model: the damper model.
        measurements: the tests.
        weighting: which samples count, and how much.
        held: parameters held at zero.
        near: values of a fit to nearly the same tests.
        rival_N: as in `solve`.
        exact: as in `solve`.

    Raises:
        IdentificationFailed: as `solve`.
    """
    if isinstance(model, GreyBoxModel):
        return _behind_residual(model, measurements, weighting, held, near, rival_N, exact=exact)
    if isinstance(model, CurrentLawModel):
        base, own = model.base, frozenset(held & set(model.base.names))

        def inner(tests: list[Measurement], start: Mapping[str, float] | None) -> Solution:
            return solve_weighted(base, tests, weighting, own, start, rival_N)

        return solve_with_current_law(model, measurements, weighting, held, near, inner)
    if isinstance(model, ColumnModel):
        shape = None if near is None else np.array([near[name] for name in model.shape_names])
        return solve_separable(measurements, model, weighting, held=held, start=shape)
    form = model.separation(motion_scale(measurements))
    if form is not None:
        return solve_loop(measurements, form, weighting, held, near)
    from rig.identification.models.state_search import solve_states  # loads numba

    return solve_states(measurements, model, weighting, held, near, rival_N, exact=exact)


def _behind_residual(
    model: GreyBoxModel,
    measurements: Sequence[Measurement],
    weighting: Weighting,
    held: frozenset[str],
    near: Mapping[str, float] | None,
    rival_N: float,
    *,
    exact: bool,
) -> Solution:
    """The physical model fitted again, its residual kept.

    Raises:
        IdentificationFailed: no residual is known, or as `solve`.
    """
    if near is None:
        raise IdentificationFailed(
            f"{model.name}: this method cannot fit a residual. Fix: use separable with --model {model.base.name}+grey"
        )
    kept = {name: near[name] for name in model.residual_names}
    own = frozenset(held & set(model.base.names))
    tests = without_residual(model, kept, measurements)
    solution = solve_weighted(model.base, tests, weighting, own, model.of_base(near), rival_N, exact=exact)
    return replace(solution, values={**solution.values, **kept})


def _robust(
    model: DamperModel, measurements: Sequence[Measurement], weighting: Weighting, held: frozenset[str], first: Solution
) -> Solution:
    """The fit by Huber's loss, from the one by least squares."""
    solution, evaluations = first, first.evaluations
    for _ in range(ROBUST_ROUNDS):
        weighting = replace(weighting, extra=huber_weights(model, solution.values, measurements))
        previous, solution = solution, solve_weighted(model, measurements, weighting, held, solution.values)
        evaluations += solution.evaluations
        moved = max(
            abs(solution.values[name] - previous.values[name]) / (abs(previous.values[name]) + 1e-9)
            for name in solution.values
        )
        if moved < 1e-6:
            break
    return replace(solution, evaluations=evaluations, extra=weighting.extra)


def _search(
    model: DamperModel, measurements: Sequence[Measurement], method: Method, findings: Undetermined
) -> Solution:
    """One of the papers' algorithms on equation (12), over the parameters that are not held.

    Raises:
        IdentificationFailed: no candidate gave a finite force.
    """
    # loads all algorithms: only when needed
    from rig.optimisers import minimise

    problem = Problem(measurements, model, "1" if method.weight == "1" else "v")
    held = dict.fromkeys(findings.held, 0.0) | {name: model.parameter(name).start for name in findings.fixed}
    objective = FixedParameters(problem, held)
    own, wide = method.bounds == "model", np.tile([-WIDE, WIDE], (objective.n_parameters, 1))
    result = minimise(
        objective,
        method=method.name,
        start=objective.start if own else None,
        bounds=objective.bounds if own else wide if method.bounds == "wide" else None,
        population=method.population,
        budget=method.budget,
        seed=method.seed,
        callback=method.callback,
        executor=method.executor,
        chunks=method.chunks,
    )
    if not np.isfinite(result.value):
        raise IdentificationFailed(
            f"{method.name} found no candidate with a finite force within {method.budget} evaluations"
        )
    values = unmirrored(problem.values(objective.whole(result.best[None, :])[0]))
    return Solution(values, float(result.value), result.evaluations)


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
    for test in measurements:
        error, deviation = _error_and_deviation_N(model, values, test)
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
    for test in measurements:
        error, deviation = _error_and_deviation_N(model, values, test)
        kept.append(replace(test, usable=test.scored & (error <= OUTLIER * deviation)))
    return kept


def _error_and_deviation_N(
    model: DamperModel, values: Mapping[str, float], test: Measurement
) -> tuple[FloatArray, float]:
    """Absolute residual (n,), and its standard deviation but for outliers."""
    error: FloatArray = np.abs(test.force_N - modelled_force(model, values, test))
    return error, float(np.median(error[test.scored])) / MEDIAN_OF_NORMAL


@dataclass(frozen=True)
class Candidate:
    """One model with its solution on all fitted tests."""

    model: DamperModel
    findings: Undetermined
    solution: Solution

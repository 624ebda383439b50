"""Fit of a model behind a current law: the law searched about fits of the model itself.

For a given law the tests are as if their current were what the fluid feels, and the model is fitted to them by its own
search. So the law's few parameters are one more outer dimension. Its slopes are those of the projected residual: the
law's columns without what the model's own columns explain (variable projection, Golub and Pereyra 1973). First on one
cycle of each test, then on all samples.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.current_law import AFFINE, AT, FEWEST_LEVELS, KINDS, PER_CURRENT
from rig.dampers.current_law_model import PLUS, CurrentLawModel
from rig.errors import IdentificationFailed
from rig.identification.models.measurement import Measurement, first_cycle
from rig.identification.models.model_slope import law_columns, modelled_force, parameter_slopes
from rig.identification.models.projection import Weighting
from rig.identification.models.separable import Solution
from rig.optimisers.least_squares import Descent, Eliminated, Squares, descend, normal_equations
from rig.signals.test_set import current_levels, rounded_levels

Inner = Callable[[list[Measurement], Mapping[str, float] | None], Solution]
"""The base model fitted to tests, from values of a fit to nearly the same tests where there are any."""

ROUGH, FINE = 1e-5, 1e-8  # share of the objective that a step must promise: on one cycle, on all samples
ITERATIONS, LAST_ITERATIONS = 20, 8
EVEN_LEVELS = 5  # of the current, where it changes within tests


ALL_LAWS = "all"


def laws_over(tests: Sequence[Measurement], law: str) -> tuple[str, ...]:
    """The laws that are wanted, as they are written for these tests; of "all" those that the tests can tell.

    Raises:
        IdentificationFailed: one was named that these tests cannot tell.
    """
    if law != ALL_LAWS:
        return (law_over(tests, law),)
    return tuple(law_over(tests, kind) for kind in KINDS) if len(_levels(tests)) >= FEWEST_LEVELS else (AFFINE,)


def named_over(model: str, tests: Sequence[Measurement]) -> str:
    """A model's name whose law `per-current` has the currents of these tests.

    Raises:
        IdentificationFailed: they ran at fewer than three.
    """
    base, plus, law = model.partition(PLUS)
    return f"{base}{plus}{law_over(tests, law)}" if plus else model


def law_over(tests: Sequence[Measurement], kind: str) -> str:
    """The law as it is written for these tests: `per-current` gets the currents at which they ran.

    Raises:
        IdentificationFailed: they ran at fewer than three.
    """
    if kind != PER_CURRENT:
        return kind
    levels = _levels(tests)
    if len(levels) < FEWEST_LEVELS:
        raise IdentificationFailed(
            f"current law {PER_CURRENT}: got {len(levels)} different currents, expected {FEWEST_LEVELS} or more. Fix: "
            "add tests at another current"
        )
    return f"{PER_CURRENT}{AT}{','.join(f'{level:g}' for level in levels)}"


def _levels(tests: Sequence[Measurement]) -> list[float]:
    """Currents (A) at which tests ran, rising, as labels; evenly spaced ones where the current changes within tests."""
    levels = current_levels([test.current for test in tests])
    if not levels.changing:
        return list(rounded_levels(levels.values_A))
    low = min(float(np.min(test.current_A)) for test in tests)
    high = max(float(np.max(test.current_A)) for test in tests)
    return list(rounded_levels(np.linspace(low, high, EVEN_LEVELS).tolist()))


def felt(model: CurrentLawModel, values: Mapping[str, float], tests: Sequence[Measurement]) -> list[Measurement]:
    """The tests with what the fluid feels in place of the current."""
    return [replace(test, current_A=model.law.felt_A(values, test.current_A)) for test in tests]


def solve_with_current_law(
    model: CurrentLawModel,
    measurements: Sequence[Measurement],
    weighting: Weighting,
    held: frozenset[str],
    near: Mapping[str, float] | None,
    inner: Inner,
) -> Solution:
    """Fit a model behind a current law.

    Args:
        model: the model.
        measurements: the tests.
        weighting: which samples count, and how much.
        held: parameters held at zero; with all of the law's the current is felt as it is.
        near: values to start from.
        inner: fits the base model.
    """
    single = [first_cycle(test) for test in measurements]
    most_A = max(float(np.max(np.abs(test.current_A))) for test in measurements)
    zero = {name: 0.0 for name in model.law.names if name in held}
    free = tuple(name for name in model.law.names if name not in held)
    starts = model.law.starts(most_A) if near is None else [{name: near[name] for name in model.law.names}]
    starts = [start | zero for start in (starts if free else starts[:1])]
    own = None if near is None else model.of_base(near)
    short = _LawSquares(model, single, weighting, held, inner, own)
    best = min(starts, key=lambda start: short.objective(start))
    theta, _ = descend(short, short.theta(best), Descent(ROUGH, iterations=ITERATIONS if free else 0))
    full = _LawSquares(model, measurements, weighting, held, inner, short.solution.values)
    full.values = short.values
    theta, _ = descend(full, theta, Descent(FINE, iterations=LAST_ITERATIONS if free else 0))
    law, solution = full.law(theta), full.solution
    limits = {
        name: end
        for name in free
        for end in (model.parameter(name).low, model.parameter(name).high)
        if math.isclose(law[name], end, rel_tol=1e-3)
    }
    share = sum(test.u_m.size for test in single) / sum(test.u_m.size for test in measurements)
    evaluations = full.evaluations + int(np.ceil(short.evaluations * share))
    return replace(
        solution, values={**solution.values, **law}, evaluations=evaluations, at_limit={**solution.at_limit, **limits}
    )


class _LawSquares(Squares):
    """The least sum of squares of the base model, as a function of the law's free parameters.

    Attributes:
        values: the law's values that `theta` starts from.
        solution: of the base model, at the best law so far.
        evaluations: of the base model's own searches.
    """

    solution: Solution

    def __init__(
        self,
        model: CurrentLawModel,
        tests: Sequence[Measurement],
        weighting: Weighting,
        held: frozenset[str],
        inner: Inner,
        near: Mapping[str, float] | None,
    ) -> None:
        self._model, self._tests, self._weighting, self._inner = model, tests, weighting, inner
        self._held, self._near, self._best = held, near, math.inf
        self._free = tuple(name for name in model.law.names if name not in held)
        ends = [(model.parameter(name).low, model.parameter(name).high) for name in self._free]
        self._limits = np.array(ends).reshape(len(self._free), 2)
        self.values: dict[str, float] = {}
        self.evaluations = 0

    def theta(self, law: Mapping[str, float]) -> FloatArray:
        """The free parameters, the rest kept."""
        self.values = dict(law)
        return np.array([law[name] for name in self._free])

    def law(self, theta: FloatArray) -> dict[str, float]:
        """The law's values."""
        return {**self.values, **dict(zip(self._free, theta.tolist(), strict=True))}

    def objective(self, law: Mapping[str, float]) -> float:
        """The least sum of squares behind a law."""
        solution = self._inner(felt(self._model, law, self._tests), self._near)
        self.evaluations += solution.evaluations
        if solution.objective < self._best:
            self._best, self.solution, self._near = solution.objective, solution, solution.values
        return solution.objective

    def value(self, theta: FloatArray) -> float:
        """See `Squares.value`."""
        return self.objective(self.law(theta))

    def moved(self, theta: FloatArray, step: FloatArray) -> FloatArray:
        """See `Squares.moved`."""
        return np.asarray(np.clip(theta + step, self._limits[:, 0], self._limits[:, 1]))

    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Squares.slopes`: the law's columns without what the base model's explain."""
        law, base, own = self.law(theta), self._model.base, self.solution.values
        left_out = {*self._held, *base.redundant, *self.solution.at_bound}
        names = [name for name in base.names if name in own and name not in left_out]

        def rows() -> Iterator[tuple[FloatArray, FloatArray]]:
            for index, test in enumerate(self._tests):
                seen = felt(self._model, law, [test])[0]
                laws = law_columns(self._model, {**own, **law}, self._free, test)
                weight = self._weighting.of(test, index)
                columns = np.column_stack((parameter_slopes(base, own, names, seen), laws)) * weight[:, None]
                yield columns, (test.force_N - modelled_force(base, own, seen)) * weight

        normal, right = normal_equations(rows(), len(names) + len(self._free))
        left = Eliminated.of(normal, len(names))
        return left.normal, left.right(right)

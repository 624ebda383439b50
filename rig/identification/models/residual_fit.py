"""What a model leaves, as a ridge regression on states that the physics defines; the tests decide whether it is used.

Each group of tests of one motion (or one current, where there is one motion) is left out in turn: the physical model is
fitted to the others, and the residual to what it leaves there. Which parts of the residual are used, and the ridge,
are those that predict the tests left out best; none where the gain is small. Every test counts equally, by its error in
% of its peak, as models are ranked.

The normal equations of all regressors are summed once for each fold; a part is a block of them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.grey_box import with_residual
from rig.dampers.grey_regressors import PARTS, weight_names
from rig.dampers.model import DamperModel
from rig.identification.models.measurement import Measurement, all_but, first_cycle, set_of, spaced
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.residual_equations import (
    columns_along,
    equations_of,
    places_of,
    ranges_of,
    summed,
    weights_of,
)
from rig.identification.models.solving import Method, solve_folds

SAMPLES = 250  # of a cycle
FEWEST_GROUPS = 3  # of tests: of two, a fold would choose from one
NO_GAIN = "residual-no-gain"
GAIN = 0.02  # share of the physical model's error on tests left out by which the residual must lower it
RIDGES = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # share of each regressor's own power
CLOSED = (1.0, 0.6, 0.3, 0.1)  # share of the tested motions on which the energy of closed cycles is checked
SHRINK = (1.0, 0.75, 0.5, 0.25)


@dataclass(frozen=True)
class ResidualFit:
    """The residual of a physical model.

    Attributes:
        model: the physical model with the residual; the physical model alone where the residual is not used.
        values: of the residual's parameters (SI); empty where it is not used.
        ridge: the chosen ridge (1).
        physical: error of the physical model on each test left out (% of peak); empty if none could be.
        grey: the same with the residual.
        reason: slug of the remark why it is not used; empty if it is.
        shrunk: factor of the weights so that no closed cycle makes energy.
    """

    model: DamperModel
    values: Mapping[str, float]
    ridge: float = 0.0
    physical: tuple[float, ...] = ()
    grey: tuple[float, ...] = ()
    reason: str = ""
    shrunk: float = 1.0


Choice = tuple[tuple[str, ...], float]
"""Parts of a residual, and the ridge."""
CHOICES: tuple[Choice, ...] = tuple(
    (parts, ridge)
    for count in range(1, len(PARTS) + 1) for parts in combinations(PARTS, count) for ridge in RIDGES
)  # fmt: skip


def fit_residual(
    model: DamperModel, values: Mapping[str, float], tests: Sequence[Measurement], method: Method,
    parts: tuple[str, ...] = (),
) -> ResidualFit:
    """The residual of a physical model, if the tests' own cross-validation shows that it predicts better.

    Args:
        model: the physical model.
        values: its values, fitted to all tests (SI).
        tests: the tests.
        method: how the model is fitted to the tests of each fold.
        parts: parts that the residual must have; (): chosen by the cross-validation.

    Raises:
        IdentificationFailed: the physical model cannot be fitted to the tests of a fold.
    """
    tests = [spaced(first_cycle(test), SAMPLES) for test in tests]
    groups = set_of(tests).groups
    if len(groups) < FEWEST_GROUPS:
        return ResidualFit(model, {}, reason="residual-too-few")
    folds = solve_folds(model, tests, groups, method, values)
    choices = [one for one in CHOICES if not parts or one[0] == parts]
    order = [number for group in groups for number in group]
    physical, errors = _cross_validated(model, tests, groups, folds, choices)
    best = int(np.argmin(np.mean(errors, axis=1)))
    by_test = tuple(physical[order.index(number)] for number in range(len(tests)))
    with_it = tuple(float(errors[best, order.index(number)]) for number in range(len(tests)))
    if np.mean(with_it) > (1.0 - GAIN) * np.mean(by_test):
        return ResidualFit(model, {}, 0.0, by_test, with_it, NO_GAIN)
    chosen, ridge = choices[best]
    grey = with_residual(model, chosen)
    ranges, left = ranges_of(tests), [test.force_N - modelled_force(model, values, test) for test in tests]
    normal, right = summed([equations_of(ranges, test, left_N) for test, left_N in zip(tests, left, strict=True)])
    ranges, weights = {**ranges, "ridge": ridge}, weights_of(normal, right, chosen, ridge)
    for share in SHRINK:
        known = {**ranges, **dict(zip(weight_names(chosen), (share * weights).tolist(), strict=True))}
        own = {name: known[name] for name in grey.names[len(model.names) :]}
        if _dissipates(model, values, grey, own, tests):
            return ResidualFit(grey, own, ridge, by_test, with_it, "", share)
    return ResidualFit(model, {}, ridge, by_test, with_it, "residual-not-passive")


def _cross_validated(
    model: DamperModel,
    tests: Sequence[Measurement],
    groups: Sequence[Sequence[int]],
    folds: Sequence[Mapping[str, float]],
    choices: Sequence[Choice],
) -> tuple[list[float], FloatArray]:
    """Errors (% of peak) on tests left out, group by group: of the physical model, and with each choice."""
    physical: list[float] = []
    errors: list[list[float]] = [[] for _ in choices]
    for group, values in zip(groups, folds, strict=True):
        ranges = ranges_of(all_but(tests, group))
        left = [test.force_N - modelled_force(model, values, test) for test in tests]
        normal, right = summed([
            equations_of(ranges, test, left[number]) for number, test in enumerate(tests) if number not in group
        ])
        seen = [(tests[number], left[number], columns_along(ranges, tests[number])) for number in group]
        physical += [_percent(test, left_N) for test, left_N, _ in seen]
        for place, (parts, ridge) in enumerate(choices):
            weights = np.zeros(right.size)
            weights[places_of(parts)] = weights_of(normal, right, parts, ridge)
            errors[place] += [_percent(test, left_N - columns @ weights) for test, left_N, columns in seen]
    return physical, np.array(errors)


def _percent(test: Measurement, error_N: FloatArray) -> float:
    return 100.0 * float(np.sqrt(np.mean(error_N[test.scored] ** 2))) / test.peak_force_N


def _dissipates(
    model: DamperModel, values: Mapping[str, float], grey: DamperModel, residual: Mapping[str, float],
    tests: Sequence[Measurement],
) -> bool:
    """Whether no closed cycle of the tested motions or smaller ones makes energy where the physical model does not."""
    for test in tests:
        for share in CLOSED:
            smaller = test.moved(share * test.u_m, share * test.v_m_s, share * test.a_m_s2)
            own_W = float(np.mean(modelled_force(model, values, smaller) * smaller.v_m_s))
            whole_W = float(np.mean(modelled_force(grey, {**values, **residual}, smaller) * smaller.v_m_s))
            if whole_W < min(0.0, own_W):
                return False
    return True

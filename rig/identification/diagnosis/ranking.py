"""The causes of a misfit in the order of what they explain.

Each is fitted together with the damper. Its score is the logarithm of the sum of squares that it leaves, over that of
the noise, and a little for each amount it needs, so that of two that explain the same the simpler one is named. The
share that it explains is of what the fit leaves beyond the noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rig.fits.entries import Cause
from rig.identification.diagnosis import distortions as of
from rig.identification.diagnosis.descent import Damper, explain, first_step, residual_N
from rig.identification.diagnosis.force_channel import outliers
from rig.identification.diagnosis.outlier_tests import ODD_TEST, OutlierTest, outlier_tests
from rig.identification.diagnosis.plausibility import FROM_TESTS, UNITS, VELOCITY, corrected, units
from rig.identification.diagnosis.statement import Fitted, Statement
from rig.identification.diagnosis.stretches import Stretch, stretches
from rig.identification.diagnosis.trials import (
    FROM_FITS,
    MIXED,
    SKEW,
    SMALLEST_DRIFT,
    WORTH_PARTING,
    Start,
    Trial,
    left_N,
    near_reversals,
    numbers_of,
    trends,
    trials,
)
from rig.signals.plausibility import Doubt

AN_AMOUNT = 0.02  # of the logarithm of what is left, that each amount of a cause must be worth
WORTH_NAMING = 0.15  # share of the misfit from which a cause is listed
MISFIT_OF_NOISE = 0.02  # of the noise's sum of squares: less than this is no misfit
SMALLEST_SKEW_S, SKEW_ERRORS = 2e-4, 3.0  # a delay that is worth a word: so long, and so many of its stated errors
BEYOND_DOUBT = 10.0  # standard errors of white noise; noise of a filtered channel has a few times those
CORRECTED = 0.25  # of the squares that are missed, below which a unit is likelier than the one that was given
SLOW = 0.1  # of the greatest speed
OUTLIER_AMOUNTS = 2  # of a test that does not fit the others: which one, and by how much

OUTLIERS = Statement(
    "outliers",
    text=(
        "outliers in the measured force ({percent:.2g} % of the samples, {count} in all) explain "
        "{percent_explained:.0f} % of the misfit"
    ),
    next="fit with --loss huber; check the force channel for interference or lost bits",
)  # fmt: skip
UNEXPLAINED = Statement(
    "unexplained",
    text=(
        "none of the known causes explains {least:.0f} % of the misfit or more; {near:.0f} % of the misfit is within 1 "
        "mm after a reversal, {slow:.0f} % is below a tenth of the largest speed, and {of_worst:.0f} % is in {worst}, "
        "one of {count} tests"
    ),
    next=(
        "{untried}repeat {worst} and the first test, and repeat all tests with the currents in another order: a model "
        "cannot describe differences between repeats"
    ),
)  # fmt: skip
STATEMENTS: tuple[Statement, ...] = (
    *UNITS.values(), VELOCITY, ODD_TEST, *FROM_TESTS, OUTLIERS, *FROM_FITS, UNEXPLAINED,
)  # fmt: skip
"""All that a diagnosis can say."""
SEEN = frozenset(statement.slug for statement in STATEMENTS if statement.seen)
"""Slugs of what is visible in the tests themselves: the report shows no share of the misfit."""


def diagnose(fitted: Fitted, *, misfit: bool = True) -> tuple[Cause, ...]:
    """What probably explains the misfit of a fit, most first.

    Wrong units come alone, tests that do not fit the others and reversed signs before the rest, which is of the other
    tests, an offset of the force after it.

    Args:
        fitted: the fit.
        misfit: whether to look for causes of misfit; units, signs and a current law drawn from two currents are looked
            at in any case.
    """
    wrong = units(fitted.tests, partial(_likelier_corrected, fitted))
    if wrong:
        return tuple(wrong)
    outliers, rest = list[Cause](), fitted
    if misfit:
        outliers, explained, rest = _without_outliers(fitted)
    else:
        explained = _hidden(fitted)
    statements = [statement for statement in FROM_TESTS if misfit or not statement.of_misfit]
    first, last = (
        [cause for statement in statements if statement.last is late for cause in statement.find(rest, fitted.tests)]
        for late in (False, True)
    )
    return (*outliers, *first, *explained, *last)


def _likelier_corrected(fitted: Fitted, doubt: Doubt, ids: Sequence[str]) -> bool:
    """Whether a fit of the other tests predicts these with their unit corrected, each in shares of its own force."""
    parts = stretches(fitted.model, fitted.tests, fitted.weighting)
    apart = [part for part in parts if part.test.id in ids]
    others = [part for part in parts if part.test.id not in ids]
    if not others:
        return False
    reached = explain(Damper(fitted.model, fitted.values, fitted.names), others, of.Distortion())

    def left(part: Stretch) -> float:
        missed_N = residual_N(fitted.model, reached.values, part, of.Distortion(), np.zeros(0))
        force_N = part.test.force_N - np.mean(part.test.force_N)
        return float(np.sum(missed_N**2)) / max(float(np.sum(force_N**2)), 1e-300)

    as_they_are = [left(part) for part in apart]
    changed = [left(replace(part, test=corrected(part.test, doubt))) for part in apart]
    return float(np.median(changed)) < CORRECTED * float(np.median(as_they_are))


def _hidden(fitted: Fitted) -> list[Cause]:
    """A delay or a drift that the tests show beyond doubt though what it leaves is within their scatter.

    A drift from cycle to cycle is part of a scatter that two cycles show, and of none where a test has a single one.
    """
    model, tests = fitted.model, fitted.tests
    parts = stretches(model, tests, fitted.weighting)
    floor, damper = sum(part.floor for part in parts), Damper(model, fitted.values, fitted.names)
    left = sum(float(np.sum((part.weights * left_N(fitted, part)) ** 2)) for part in parts)
    count = sum(int(np.count_nonzero(part.weights)) for part in parts)
    least_s = max(SMALLEST_SKEW_S, SKEW_ERRORS * max(test.skew_std_s for test in tests))
    looked_for: list[tuple[Statement, of.Distortion, float]] = [(SKEW, of.Skew(), least_s)]
    looked_for += [(statement, of.Trend(trend), SMALLEST_DRIFT) for statement, trend in trends(tests)]
    trials = []
    for statement, distortion, least in looked_for:
        step = first_step(damper, parts, distortion)
        if floor > 0.0 and abs(step.amounts[0]) >= least and step.gain * count >= BEYOND_DOUBT**2 * max(floor, left):
            reached = explain(damper, parts, distortion)
            trials.append(Trial(statement, reached.squares, len(distortion.start), numbers_of(statement, reached)))
    if not trials:
        return []
    base = explain(damper, parts, of.Distortion())
    best = min(trials, key=lambda trial: _score(trial.squares, trial.amounts, floor))
    gain = base.squares - best.squares
    share = min(1.0, gain / max(base.squares - floor, gain)) if gain > 0.0 else 0.0
    return [best.cause(share)] if share >= WORTH_NAMING else []


@dataclass(frozen=True)
class _Misfit:
    """What a fit leaves beyond the noise, the causes, and the squares and the amounts of the best explanation."""

    excess: float
    causes: list[Cause]
    squares: float
    amounts: int


def _without_outliers(fitted: Fitted) -> tuple[list[Cause], list[Cause], Fitted]:
    """Tests that do not fit the others, causes of what is left, and the fit to the others.

    There are none where one cause explains all tests, outliers included, equally well: a current law that the
    model does not include makes the tests at one current outliers.
    """
    everything = stretches(fitted.model, fitted.tests, fitted.weighting)
    floor, damper = sum(part.floor for part in everything), Damper(fitted.model, fitted.values, fitted.names)
    whole = _of_misfit(fitted)
    outliers, values = outlier_tests(damper, everything) if whole.excess > 0.0 else ([], fitted.values)
    if not outliers:
        return [], whole.causes, fitted
    apart = {test.index: test for test in outliers}
    kept = [k for k in range(len(fitted.tests)) if k not in apart]
    reached = explain(damper, [part for part in everything if part.index in kept], of.Distortion(), values)
    weighting = fitted.weighting
    if weighting.extra is not None:
        weighting = replace(weighting, extra=tuple(weighting.extra[k] for k in kept))
    rest = replace(fitted, values=reached.values, tests=[fitted.tests[k] for k in kept], weighting=weighting)
    others = _of_misfit(rest, whole.excess)
    left = sum(apart[part.index].left * float(np.mean(part.weights**2)) for part in everything if part.index in apart)
    amounts = sum(OUTLIER_AMOUNTS if test.corrections else len(fitted.names) for test in outliers)
    if _score(others.squares + left, others.amounts + amounts, floor) > _score(whole.squares, whole.amounts, floor):
        return [], whole.causes, fitted
    share, errors = 1.0 - min(1.0, others.excess / whole.excess), sum(test.error**2 for test in outliers)
    causes = [_outlier(test, fitted.tests[test.index].id, share * test.error**2 / errors) for test in outliers]
    return causes, others.causes, rest


def _outlier(test: OutlierTest, name: str, share: float) -> Cause:
    corrections = ODD_TEST.say("apart")
    if test.corrections:
        corrections = ODD_TEST.say("corrected", corrections=" or ".join(test.corrections))
    return ODD_TEST.cause(share, test=name, percent_missed=100.0 * test.error, corrections=corrections)


def _of_misfit(fitted: Fitted, of_all: float | None = None) -> _Misfit:
    """Causes of what a fit leaves; their shares are of all misfit, in squares, where that is given."""
    model, tests, weighting = fitted.model, fitted.tests, fitted.weighting
    alone = outliers(model, fitted.values, tests, weighting)
    everything = stretches(model, tests, weighting)
    floor = sum(part.floor for part in everything)
    count = sum(int(np.count_nonzero(one)) for one in alone)
    damper = Damper(model, fitted.values, fitted.names)
    parts = stretches(model, tests, weighting, alone) if count else everything
    base = explain(damper, parts, of.Distortion())
    whole = explain(damper, everything, of.Distortion()) if count else base
    excess = whole.squares - floor
    if excess < MISFIT_OF_NOISE * floor:
        return _Misfit(0.0, [], whole.squares, 0)
    far = whole.squares - base.squares  # of samples that lie alone, which only their own cause explains
    damper = Damper(model, base.values, fitted.names)
    tried = [replace(trial, squares=trial.squares + far) for trial in trials(Start(fitted, parts, damper, base))]
    if count:
        percent = 100.0 * count / sum(test.u_m.size for test in tests)
        tried.append(Trial(OUTLIERS, base.squares, 1, {"count": count, "percent": percent}))
    tried.sort(key=lambda trial: _score(trial.squares, trial.amounts, floor))
    causes: list[Cause] = []
    for trial in tried:
        share = min(1.0, max(0.0, (whole.squares - trial.squares) / (excess if of_all is None else of_all)))
        if share >= _least_share(trial) and trial.statement.slug not in {cause.slug for cause in causes}:
            causes.append(trial.cause(share))
    if not causes and excess > floor:
        causes = [_unexplained(fitted, everything)]
    return _Misfit(excess, causes, tried[0].squares, tried[0].amounts)


def _unexplained(fitted: Fitted, parts: Sequence[Stretch]) -> Cause:
    """Where a misfit lies that no cause explains."""
    top_m_s = max(float(np.max(np.abs(part.test.v_m_s))) for part in parts)
    slow, by_test = 0.0, np.zeros(len(fitted.tests))
    for part in parts:
        squares = (part.weights * left_N(fitted, part)) ** 2
        slow += float(np.sum(squares[np.abs(part.test.v_m_s) < SLOW * top_m_s]))
        by_test[part.index] += float(np.sum(squares))
    worst, whole = int(np.argmax(by_test)), max(float(np.sum(by_test)), 1e-300)
    numbers: dict[str, object] = {"near": near_reversals(fitted, parts), "slow": 100.0 * slow / whole}
    numbers |= {"of_worst": 100.0 * float(by_test[worst]) / whole}
    numbers |= {"worst": fitted.tests[worst].id, "count": by_test.size, "least": 100.0 * WORTH_NAMING}
    return UNEXPLAINED.cause(0.0, "", **numbers, untried=fitted.untried)


def _least_share(trial: Trial) -> float:
    """Share of the misfit from which a cause is listed: many amounts explain some of it whatever they stand for."""
    share = max(WORTH_NAMING, 1.0 - math.exp(-AN_AMOUNT * trial.amounts))
    if trial.at_limit:
        return max(WORTH_PARTING, share)
    return min(WORTH_PARTING, share) if trial.statement is MIXED else share


def _score(squares: float, amounts: int, floor: float) -> float:
    return math.log(max(squares / max(floor, 1e-300), 0.5)) + AN_AMOUNT * amounts



"""How far predictions of motions that were not tested are off: the band of a fit, from cross-validation over motions.

Each motion is predicted by a fit to the others; errors count where the others had been. They are divided by the 95 %
residuals of the fitted tests at the same current, which tell how errors grow with the current, and pooled: every test
has the same weight whatever its number of samples, as a new motion is one draw of a motion and not of a sample (Dunn,
Wasserman and Ramdas 2023, two-layer hierarchical models). Two corrections: a motion that is left out is farther from
the remaining ones than a new one is from all, so that the fitted tests take part with the share of Efron's .632 rule
(1983); and the errors of few motions may be smaller than those of the next one by chance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.covered import Covered
from rig.errors import IdentificationFailed
from rig.fits.entries import FEW_MOTIONS, Band
from rig.identification.application.law import Law
from rig.identification.cross_validation import SAMPLES, folds_of
from rig.identification.models.coverage import beyond
from rig.identification.models.measurement import Measurement, first_cycle, recorded_errors, set_of
from rig.identification.models.model_slope import modelled_force
from rig.identification.models.solving import Candidate, Method
from rig.signals.test_set import LEAST_CURRENT_A, MotionReading, current_levels, motion_groups

BAND = 0.95  # share of samples within the band
LEVELS = 16  # of the current, over which the band is told apart
FEWEST = 20  # samples of a level
FEWEST_MOTIONS = 2  # one tells nothing about another
LEAST_OF_PEAK = 1e-6  # of the peak force: residuals of exact data are no scale for errors
FITTED_SHARE = 0.368  # 1/e, Efron's
BETWEEN_MOTIONS = 0.4  # standard deviation of the logarithm of the errors' size between motions; measured damper: 0.35
OF_FEW = 1.6  # times that for few motions: Student's 97.5 % at 3 degrees of freedom over the normal one
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(15)


@dataclass(frozen=True)
class PredictedTest:
    """A test and the errors of its force.

    Attributes:
        motion: its motion.
        current_A: current of its samples (A), shape (n,).
        error_N: measured minus predicted force (N), shape (n,).
    """

    motion: MotionReading
    current_A: FloatArray
    error_N: FloatArray

    def thinned(self) -> PredictedTest:
        """The same with about as few samples as left-out tests have."""
        every = max(1, self.error_N.size // SAMPLES)
        return PredictedTest(self.motion, self.current_A[::every], self.error_N[::every])


def left_out_tests(best: Candidate, fitted: Sequence[Measurement], weight: str) -> list[PredictedTest]:
    """Tests predicted by fits to the other motions, those within the others' range; none where that is not possible."""
    predicted: list[PredictedTest] = []
    if len(set_of(fitted).motions) < FEWEST_MOTIONS:
        return predicted
    try:
        for fold in folds_of(best.model, fitted, Method(weight=weight), best.solution.values):
            for test in fold.left_out:
                predicted += _within(test, modelled_force(best.model, fold.values, test), fold.covered)
    except IdentificationFailed:  # the others do not determine the model
        return []
    return predicted if all(np.all(np.isfinite(one.error_N)) for one in predicted) else []


def held_out_tests(law: Law, held_out: Sequence[Measurement], covered: Covered) -> list[PredictedTest]:
    """Held-out tests that lie within the range of the fitted ones."""
    return [one for test in map(first_cycle, held_out) for one in _within(test, law.force_of(test), covered)]


def _within(test: Measurement, modelled_N: FloatArray, covered: Covered) -> Iterator[PredictedTest]:
    """The errors of a test where it lies within what others covered; nothing if it lies beyond."""
    if beyond(covered, test):
        return
    kept = test.scored.copy()
    motion_of = {"displacement_m": test.u_m, "velocity_m_s": test.v_m_s, "current_A": test.current_A}
    for outside in covered.outside(motion_of).values():
        kept &= ~outside
    if np.any(kept):
        error_N = recorded_errors(test, test.force_N - modelled_N)
        yield PredictedTest(test.motion, test.current_A[kept], error_N[kept])


def error_band(
    law: Law, fitted: Sequence[Measurement], predicted: Sequence[PredictedTest], source: str, *, to_the_noise: bool
) -> Band:
    """The band of a fit; without predicted tests or with one motion that of the residuals.

    Args:
        law: the fitted model.
        fitted: the tests it was fitted to.
        predicted: tests that were predicted by fits to others.
        source: where those come from.
        to_the_noise: whether the model describes the tests to their noise: the next motion has the same.
    """
    errors = []
    for test in map(first_cycle, fitted):
        error_N = recorded_errors(test, test.force_N - law.force_of(test))
        errors.append(PredictedTest(test.motion, test.current_A[test.scored], error_N[test.scored]))
    band = _residual_band(fitted, errors)
    if not predicted or len(motion_groups([one.motion for one in (*errors, *predicted)])) < FEWEST_MOTIONS:
        return band
    errors = [one.thinned() for one in errors]
    count = len(motion_groups([one.motion for one in predicted]))
    wider = OF_FEW if count <= FEW_MOTIONS else 1.0
    spread = 0.0 if to_the_noise else wider * BETWEEN_MOTIONS * math.sqrt(2.0 / count)
    pools = ((errors, FITTED_SHARE), (predicted, 1.0 - FITTED_SHARE))
    scores = np.concatenate([np.abs(one.error_N) / band.at(one.current_A) for pool, _ in pools for one in pool])
    weights = np.concatenate([
        np.full(one.error_N.size, share / len(pool) / max(1, one.error_N.size)) for pool, share in pools for one in pool
    ])  # fmt: skip
    factor = max(1.0, _quantile(scores, weights, spread))
    widths = tuple(factor * width for width in band.half_width_N)
    return Band(band.current_A, widths, source, left_out=len(predicted), motions=count)


def _quantile(scores: FloatArray, weights: FloatArray, spread: float) -> float:
    """The value below which `BAND` of weighted scores (n,) lie whose size varies log-normally by `spread`."""
    if spread > 0.0:
        scores = np.outer(np.exp(spread * NODES), scores).ravel()
        weights = np.outer(WEIGHTS / np.sum(WEIGHTS), weights).ravel()
    order = np.argsort(scores)
    place = int(np.searchsorted(np.cumsum(weights[order]), BAND * float(np.sum(weights))))
    return float(scores[order[min(place, order.size - 1)]])


def _residual_band(fitted: Sequence[Measurement], errors: Sequence[PredictedTest]) -> Band:
    """Within how much of the modelled force 95 % of the fitted samples lie, for each current."""
    levels = current_levels([test.current for test in fitted])
    error_N = np.abs(np.concatenate([one.error_N for one in errors]))
    current_A = np.concatenate([one.current_A for one in errors])
    level = np.concatenate([
        np.full(one.error_N.size, levels.of_test[number] or 0) for number, one in enumerate(errors)
    ])  # fmt: skip
    if levels.changing or len(levels) > LEVELS:
        width_A = max(LEAST_CURRENT_A, float(np.ptp(current_A)) / LEVELS)
        level = np.round(current_A / width_A).astype(np.int64)
    known = [one for one in np.unique(level) if np.count_nonzero(level == one) >= FEWEST]
    groups = [level == one for one in known] or [np.ones(level.size, dtype=bool)]
    means = tuple(float(np.mean(current_A[group])) for group in groups)
    least_N = LEAST_OF_PEAK * max(test.peak_force_N for test in fitted)
    widths = tuple(max(least_N, float(np.quantile(error_N[group], BAND))) for group in groups)
    return Band(means, widths, "fitted tests")

"""Single tests that are inconsistent with the others: wrong gain, current, or motion of one file among good ones.

Such a test bends a fit to all of them, so the damper is fitted again with each test counting by its error, not by the
square of it (L1 over tests, by reweighting). Its predictions are compared with the measurements of every test,
and the scatter of the other tests shows the gain that model error alone causes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from rig.dampers.arrays import FloatArray
from rig.dampers.model import DamperModel
from rig.identification.diagnosis.descent import Damper, explain
from rig.identification.diagnosis.distortions import Distortion
from rig.identification.diagnosis.statement import Statement
from rig.identification.diagnosis.stretches import MEDIAN_OF_NORMAL, Stretch
from rig.identification.models.measurement import Measurement, set_of
from rig.identification.models.model_slope import modelled_force
from rig.identification.remarks import Remark

FEWEST_TESTS = 6
MOST_OUTLIERS, MOST_OUTLIER_TESTS = 0.25, 5  # of the tests; more are no mistakes with single files
ROUNDS, REFITS = 5, 4
SMALLEST_ERROR = 0.01  # of the force, below which tests fit alike
LEAST_OF_MEDIAN = 0.1  # of the median error, so that no test counts for all others
OF_SCATTER = 4.5  # robust standard deviations of the other tests' gains
LEAST_GAIN = 1.15
LEAST_GAIN_ALONE = 3.0  # where no other test has the same current, or the same motion: a model may lack that much
FITS = 1.1  # gain within which all tests are as predicted by the fit as it is: none is looked for
LEAST_SPEED = 2.0  # factor on the motion, which changes most forces little
MISSED, OF_MEDIAN = 0.15, 3.0  # of the force, and of the others' median error, from which an error is looked at
AS_OTHERS = 2.0  # times the others' median error, up to which a corrected test is like them
HALVED = 0.7  # of a test's error, which a correction must leave at most
APART = 0.5  # of the force: an error that is reported although no correction removes it
OTHER_CURRENT = 0.05  # of the tested span of currents, by which a current differs from the one that was reported
POWER_OF_TEN = 0.06  # of a decade
CURRENTS, SPEEDS = 41, np.geomspace(1e-3, 1e3, 61)

ODD_TEST = Statement(
    "odd-test",
    text=(
        "{test} is inconsistent with the other tests: a fit to the other tests misses {percent_missed:.0f} % of the "
        "force in this test; {corrections}"
    ),
    next=(
        "for that test, check the current, the units and ranges of both channels, and which damper was mounted, or fit "
        "without that test"
    ),
    parts={
        "corrected": "the test would be consistent if {corrections}",
        "apart": "neither a gain error in its force nor a different current or motion explains the difference",
        "force": "its force were multiplied by {factor:.3g}",
        "current": "its current were {likely_A:.2f} A instead of {stated_A:.2f} A",
        "motion": "its motion were multiplied by {factor:.3g}",
    },
)  # fmt: skip


@dataclass(frozen=True)
class OutlierTest:
    """A test that is inconsistent with the others.

    Attributes:
        index: its number.
        error: what was missed of its force, root mean square in parts of the larger of measured and predicted force.
        corrections: messages that state what would make it consistent, most probable first; empty if none does.
        left: sum of squares (N^2) that the best of them leaves; noise alone where there is none.
    """

    index: int
    error: float
    corrections: tuple[Remark, ...]
    left: float


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Forces of one test about their means (N), measured and predicted, each (n,), and the sum of squares of noise."""

    measured_N: FloatArray
    predicted_N: FloatArray
    noise: float

    @property
    def size(self) -> float:
        return max(float(np.linalg.norm(self.measured_N)), float(np.linalg.norm(self.predicted_N)), 1e-300)

    @property
    def missed(self) -> float:
        return float(np.sum((self.measured_N - self.predicted_N) ** 2))

    @property
    def error(self) -> float:
        """Of the larger of both, so that a force ten times too small is as wrong as one ten times too large."""
        return math.sqrt(max(self.missed - self.noise, 0.0)) / self.size

    @property
    def gain(self) -> float:
        """The measured force over the predicted one."""
        return float(self.measured_N @ self.predicted_N) / max(float(self.predicted_N @ self.predicted_N), 1e-300)


@dataclass(frozen=True)
class _Correction:
    """One possible error corrected: the prediction then, whether the size is usual for such errors, and the message."""

    then: _Prediction
    usual: bool
    remark: Remark


def outlier_tests(damper: Damper, parts: Sequence[Stretch]) -> tuple[list[OutlierTest], Mapping[str, float]]:
    """The tests that the others' fit misses by more than its own misfit, with what would make them fit; worst first.

    Args:
        damper: the damper; searches begin at its start.
        parts: the samples of all tests.

    Returns:
        The outliers, and the damper's values (SI) in a fit to the other tests.
    """
    by_test: list[list[Stretch]] = [[] for _ in range(1 + max(part.index for part in parts))]
    for part in parts:
        by_test[part.index].append(part)
    if len(by_test) < FEWEST_TESTS:
        return [], damper.start
    fit = [_predict(damper.model, damper.start, own) for own in by_test]
    if all(one.error < MISSED and abs(math.log(max(one.gain, 1e-6))) < math.log(FITS) for one in fit):
        return [], damper.start
    values, suspects, few = _robust(damper, by_test), np.zeros(0, dtype=np.intp), MOST_OUTLIERS * len(by_test)
    for _ in range(REFITS):
        predicted = [_predict(damper.model, values, own) for own in by_test]
        errors, gains = np.array([one.error for one in predicted]), np.array([one.gain for one in predicted])
        before, (suspects, usual) = suspects, _suspects(errors, gains)
        if np.array_equal(before, suspects) or suspects.size > few:
            break
        kept = [own for k, own in enumerate(by_test) if k not in suspects]
        values = _robust(Damper(damper.model, values, damper.names), kept)
    if suspects.size > min(few, MOST_OUTLIER_TESTS):
        return [], damper.start
    good = [own[0].test for k, own in enumerate(by_test) if k not in suspects]
    outliers, fitting = [], partial(_predict, damper.model, values)
    for k in suspects.tolist():
        enough = min(max(AS_OTHERS * usual, SMALLEST_ERROR), HALVED * float(errors[k]))
        candidates = _corrections(fitting, by_test[k], predicted[k], good)
        corrections = [one for one in candidates if one.then.error < enough]
        if corrections or (suspects.size == 1 and errors[k] > APART):
            corrections.sort(key=lambda one: (not one.usual, one.then.error))
            left = min((one.then.missed for one in corrections), default=predicted[k].noise)
            outliers.append(OutlierTest(k, float(errors[k]), tuple(one.remark for one in corrections), left))
    return sorted(outliers, key=lambda test: -test.error), values


def _suspects(errors: FloatArray, gains: FloatArray) -> tuple[NDArray[np.intp], float]:
    """Numbers of the tests that may be outliers, and the median error."""
    usual, logs = float(np.median(errors)), np.log(np.maximum(gains, 1e-6))
    logs -= float(np.median(logs))
    scatter = float(np.median(np.abs(logs))) / MEDIAN_OF_NORMAL
    other_gain = np.abs(logs) > max(OF_SCATTER * scatter, math.log(LEAST_GAIN))
    return np.flatnonzero(other_gain | (errors > max(MISSED, OF_MEDIAN * usual))), usual


def _corrections(
    fitting: Callable[[Sequence[Stretch]], _Prediction], own: Sequence[Stretch], here: _Prediction,
    good: Sequence[Measurement],
) -> Iterator[_Correction]:
    """The best correction of each kind: force, current, motion."""
    test, gain = own[0].test, here.gain
    groups = set_of([test, *good])
    level, motion = groups.currents.of_test[0], groups.motions.of_test[0]
    same = level is not None and level in groups.currents.of_test[1:]
    alone = not same or motion not in groups.motions.of_test[1:]
    if gain > 0.0 and abs(math.log(gain)) > math.log(LEAST_GAIN_ALONE if alone else LEAST_GAIN):
        then, remark = replace(here, predicted_N=gain * here.predicted_N), ODD_TEST.say("force", factor=1.0 / gain)
        yield _Correction(then, _is_power_of_ten(gain), remark)
    stated_A, tested = _current_A(test), [_current_A(other) for other in good]
    if same:
        between = np.linspace(min(tested), max(tested), CURRENTS).tolist()
        least_A = max(groups.currents.resolution_A[1], OTHER_CURRENT * (max(tested) - min(tested)))
        currents = [x for x in (*tested, *between) if abs(x - stated_A) > least_A]
        tried = [(fitting([replace(part, test=_at(part.test, x)) for part in own]), x) for x in currents]
        if tried:
            then, likely_A = min(tried, key=_error)
            usual = min(abs(likely_A - x) for x in tested) <= max(0.5 * least_A, groups.currents.resolution_A[1])
            yield _Correction(then, usual, ODD_TEST.say("current", likely_A=likely_A, stated_A=stated_A))
    speeds = [x for x in SPEEDS.tolist() if max(x, 1.0 / x) > LEAST_SPEED]
    then, times = min(
        ((fitting([replace(part, test=_slower(part.test, x)) for part in own]), x) for x in speeds), key=_error
    )
    yield _Correction(then, _is_power_of_ten(times), ODD_TEST.say("motion", factor=1.0 / times))


def _error(tried: tuple[_Prediction, float]) -> float:
    return tried[0].error


def _is_power_of_ten(factor: float) -> bool:
    return abs(math.log10(factor) - round(math.log10(factor))) < POWER_OF_TEN


def _robust(damper: Damper, by_test: Sequence[Sequence[Stretch]]) -> Mapping[str, float]:
    """The damper's values (SI) at the least sum of the tests' errors.

    Searched from the fit as it is, and from one in which large forces count most: tests that are too small hold the
    one, tests that are too large the other.
    """
    best: tuple[float, Mapping[str, float]] | None = None
    for equal in (True, False):
        values = damper.start
        for round_ in range(ROUNDS + 1):
            predicted = [_predict(damper.model, values, own) for own in by_test]
            errors = np.array([one.error for one in predicted])
            if best is None or float(np.sum(errors)) < best[0]:
                best = float(np.sum(errors)), values
            if round_ == ROUNDS:
                break
            sizes = np.array([one.size if equal or round_ else 1.0 for one in predicted])
            least = max(LEAST_OF_MEDIAN * float(np.median(errors)), SMALLEST_ERROR)
            count = 1.0 / (sizes * np.sqrt(np.maximum(errors, least)))
            weighted = [
                replace(part, weights=(part.weights > 0.0) * weight)
                for own, weight in zip(by_test, count.tolist(), strict=True) for part in own
            ]
            values = explain(damper, weighted, Distortion(), values).values
    return damper.start if best is None else best[1]


def _predict(model: DamperModel, values: Mapping[str, float], own: Sequence[Stretch]) -> _Prediction:
    measured, modelled, noise = [], [], 0.0
    for part in own:
        counts = part.weights > 0.0
        measured.append(part.test.force_N[counts])
        modelled.append(modelled_force(model, values, part.test)[counts])
        noise += float(np.count_nonzero(counts)) * part.noise_N**2
    measured_N, modelled_N = np.concatenate(measured), np.concatenate(modelled)
    return _Prediction(measured_N - np.mean(measured_N), modelled_N - np.mean(modelled_N), noise)


def _at(test: Measurement, current_A: float) -> Measurement:
    return replace(test, current_A=np.full(test.u_m.size, current_A))


def _slower(test: Measurement, times: float) -> Measurement:
    return test.moved(test.u_m / times, test.v_m_s / times, test.a_m_s2 / times)


def _current_A(test: Measurement) -> float:
    return float(np.mean(test.current_A))

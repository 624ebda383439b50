"""References that are no models: how far the best one is from what tests repeat, and from what a regression learns.

The mean cycle is the floor: each cycle of a test predicted by the mean of its others. The regression is gradient
boosting (`rig.identification.boosting`) on extension, speed, way since the last reversal and current; it knows no
physics, so it shows what motion and current tell where it has seen both, and how little of that goes on to motions it
has not seen. In motion without cycles it also gets speed and current at some times before, never a force.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.dampers.covered import Covered
from rig.fits.entries import Reference
from rig.identification.boosting import Boosted, boosted
from rig.identification.models.coverage import beyond, covered_by
from rig.identification.models.measurement import Measurement, first_cycle, samples_a_cycle, spaced, thinned
from rig.signals.waveform import WAVEFORMS

MOST_ROWS = 5000  # that the regression learns from
FEWEST_A_CYCLE = 20
MOST_FOLDS = 5
FARTHEST_M = 2e-3  # way since a reversal from which it says nothing more
LAGS_S = (0.002, 0.004, 0.008, 0.016, 0.032)  # before, at which motion without cycles is looked at too
MOST_FREE_ROWS = 20_000  # of a test without cycles


def references(
    fitted: Sequence[Measurement], held_out: Sequence[Measurement], groups: Sequence[Sequence[Measurement]]
) -> tuple[Reference, ...]:
    """The mean cycle and the regression, scored as the models are.

    Args:
        fitted: the tests that models were fitted to.
        held_out: tests they have not seen; without any, each of `groups` is left out in turn.
        groups: the fitted tests by motion.
    """
    return _mean_cycle(fitted, held_out), _regression(fitted, held_out, groups)


def _mean_cycle(fitted: Sequence[Measurement], held_out: Sequence[Measurement]) -> Reference:
    seen, unseen = (_mean([_apart(test) for test in tests]) for tests in (fitted, held_out or fitted))
    problem = "" if unseen is not None else "no test has two whole cycles"
    return Reference("mean_cycle", unseen, seen, problem, unseen)


def _apart(test: Measurement) -> float:
    """Error (% of peak) of each cycle predicted by the mean of the test's others; NaN with a single one."""
    if test.waveform not in WAVEFORMS:
        return math.nan
    length = samples_a_cycle(test.u_m)
    count = int((test.u_m.size - 1) / length + 1e-6) if length > 1.0 else 0
    if count < 2:
        return math.nan
    steps = round(length)
    places = np.arange(count)[:, None] * length + np.arange(steps) * (length / steps)
    cycles = np.interp(places, np.arange(test.u_m.size), test.force_N)
    errors = (cycles - cycles.mean(axis=0)) * count / (count - 1)
    return 100.0 * float(np.sqrt(np.mean(errors**2) + test.scatter_N**2)) / test.peak_force_N


def _regression(
    fitted: Sequence[Measurement], held_out: Sequence[Measurement], groups: Sequence[Sequence[Measurement]]
) -> Reference:
    if len({test.waveform in WAVEFORMS for test in (*fitted, *held_out)}) > 1:
        return Reference("regression", None, None, "tests with and without cycles cannot be used for training together")
    most = max(FEWEST_A_CYCLE, MOST_ROWS // len(fitted))
    whole = _learnt([_spaced(test, most) for test in fitted])
    seen = _mean(_errors(whole, fitted, most))
    if held_out:
        errors = _errors(whole, held_out, most)
        covered = covered_by(fitted)
        return _regressed(seen, [(error, test, covered) for error, test in zip(errors, held_out, strict=True)])
    folds = [[test for group in groups[k::MOST_FOLDS] for test in group] for k in range(min(MOST_FOLDS, len(groups)))]
    if len(folds) < 2:
        return Reference("regression", None, seen, "all tests have the same motion, so none can be held out")
    unseen: list[tuple[float, Measurement, Covered]] = []
    for fold in folds:
        rest = [test for other in folds if other is not fold for test in other]
        learnt = _learnt([_spaced(test, most) for test in rest])
        covered = covered_by(rest)
        unseen += [(error, test, covered) for error, test in zip(_errors(learnt, fold, most), fold, strict=True)]
    return _regressed(seen, unseen)


def _regressed(seen: float | None, errors: Sequence[tuple[float, Measurement, Covered]]) -> Reference:
    """The regression by its errors on fitted tests and on unseen ones, each with what it learnt from covers."""
    within = [error for error, test, covered in errors if not beyond(covered, test)]
    return Reference("regression", _mean([error for error, _, _ in errors]), seen, "", _mean(within))


def _spaced(test: Measurement, most: int) -> Measurement:
    """One cycle of so few samples; of motion without cycles all of the test."""
    if test.waveform in WAVEFORMS:
        return spaced(first_cycle(test), most)
    return thinned(test, max(1, test.u_m.size // MOST_FREE_ROWS))


def _learnt(tests: Sequence[Measurement]) -> Boosted:
    """The regression of the force, every test alike in % of its peak."""
    scored = [test.scored for test in tests]
    weights = [
        np.full(np.count_nonzero(some), 1.0 / (test.peak_force_N**2 * np.count_nonzero(some)))
        for test, some in zip(tests, scored, strict=True)
    ]
    joined = np.concatenate(weights)
    return boosted(
        np.vstack([_inputs(test)[some] for test, some in zip(tests, scored, strict=True)]),
        np.concatenate([test.force_N[some] for test, some in zip(tests, scored, strict=True)]),
        joined / joined.mean(),
    )


def _inputs(test: Measurement) -> FloatArray:
    """Extension, speed, current and way since the last reversal, shape (n, 4); the cycle is run once before.

    Without cycles nothing is run before, and speed and current at `LAGS_S` before are there too.
    """
    if test.waveform not in WAVEFORMS:
        return _free_inputs(test)
    way_m = _way_m(np.concatenate((test.u_m, test.u_m)))[test.u_m.size :]
    return np.column_stack((test.u_m, test.v_m_s, test.current_A, way_m))


def _free_inputs(test: Measurement) -> FloatArray:
    columns = [test.u_m, test.v_m_s, test.current_A, _way_m(test.u_m)]
    for lag_s in LAGS_S:
        earlier = np.maximum(np.arange(test.u_m.size) - max(1, round(lag_s / test.dt_s)), 0)
        columns += [test.v_m_s[earlier], test.current_A[earlier]]
    return np.column_stack(columns)


def _way_m(u_m: FloatArray) -> FloatArray:
    """Way (m) since the last reversal, (n,), at most `FARTHEST_M`."""
    moves = np.diff(u_m, prepend=u_m[0])
    turned = np.flatnonzero(moves[1:] * moves[:-1] < 0.0)
    last = np.zeros(u_m.size, dtype=int)
    last[turned + 1] = turned
    return np.asarray(np.minimum(np.abs(u_m - u_m[np.maximum.accumulate(last)]), FARTHEST_M))


def _errors(learnt: Boosted, tests: Sequence[Measurement], most: int) -> list[float]:
    """Error (% of peak) of each test, all predicted at once."""
    tests = [_spaced(test, most) for test in tests]
    ends = np.cumsum([test.u_m.size for test in tests])
    predicted = np.split(learnt.predict(np.vstack([_inputs(test) for test in tests])), ends[:-1])
    errors = []
    for force_N, test in zip(predicted, tests, strict=True):
        power_N2 = float(np.mean((force_N - test.force_N)[test.scored] ** 2)) + test.scatter_N**2
        errors.append(100.0 * math.sqrt(power_N2) / test.peak_force_N)
    return errors


def _mean(errors: Sequence[float]) -> float | None:
    known = [error for error in errors if math.isfinite(error)]
    return float(np.mean(known)) if known else None

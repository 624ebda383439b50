"""How sure a fit is when its model is not the damper's: the tests drawn again, many times, and fitted again each time.

A covariance from residuals knows noise, and misfit that repeats; it does not know that other tests of the same damper
would have given other values, because a wrong model bends towards what it is shown. Drawing whole tests anew does. The
draw is Rubin's (1981) Bayesian bootstrap: every test gets a weight from the exponential distribution, and so does every
cycle within its test. No test has weight zero, so what all tests together can tell, every draw can.

With few tests the spread of the draws is too small: it is widened by sqrt((T + 1)/(T - 1)) for T tests, and by
Student's t over the normal quantile.
"""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING

import numpy as np

import rig.dampers
from rig.dampers import Hysteresis
from rig.dampers.arrays import FloatArray
from rig.errors import IdentificationFailed, some
from rig.fits.entries import BootstrapResult
from rig.identification.models.measurement import Measurement, samples_a_cycle
from rig.identification.models.projection import Weighting
from rig.identification.models.solving import SQUARES, Method, huber_weights, solve_weighted, splits
from rig.identification.models.tanh_projection import WORTH_COMPILING
from rig.identification.models.undetermined import examine
from rig.identification.points.inputs import fit_inputs
from rig.identification.uncertainty.bootstrap_result import PREDICTED, bootstrap_result, intervals_of
from rig.identification.uncertainty.covariance import quantile
from rig.identification.uncertainty.fit import Fit
from rig.jobs.time_left import TimeLeft
from rig.jobs.workers import HERE, ExecutorWorkers, Job, Workers

if TYPE_CHECKING:
    from concurrent.futures import Executor

    import pandas as pd

    from rig.identification.application.motion_table import Table
    from rig.identification.points.inputs import Tests

FEWEST_TESTS = 3
LEAST_DRAWS = 20
PARTS, PART = 4, 10  # parts per worker, so that all finish at about the same time; minimum samples per part


@dataclass(frozen=True)
class Bootstrap:
    """Fits to tests drawn again.

    Attributes:
        fit: the fit itself.
        draws: parameter values (SI) of every draw, shape (count, p), in the order of `names`.
        names: the fitted parameters.
        tests: how many tests were drawn from.
        widening: factor on the spread of the draws, for so few tests.
    """

    fit: Fit
    draws: FloatArray
    names: tuple[str, ...]
    tests: int
    widening: float

    def to_pandas(self) -> pd.DataFrame:
        """One row a parameter: `value`, `low`, `high` (95 % interval) and `standard_error` in `unit`."""
        import pandas as pd

        values = self._values()
        low, high, spread = intervals_of(values, self.draws, self.tests, self.widening, self._bounds())
        columns = {
            "value": values,
            "low": low,
            "high": high,
            "standard_error": spread,
            "unit": [self.fit.parameters[name].unit for name in self.names],
        }
        return pd.DataFrame(columns, index=pd.Index(self.names, name="parameter"))

    def predict(self, table: Table, *, mid_stroke_m: float = 0.0) -> pd.DataFrame:
        """As `Fit.predict` with `band=True`, by all draws.

        Raises:
            FileProblem: the table cannot be used.
            IdentificationFailed: the fit has no value of a parameter.
        """
        draws = self.draws[:PREDICTED]
        return self.fit.predict_among(self.names, draws, self.widening, table, mid_stroke_m=mid_stroke_m)

    def kept(self) -> BootstrapResult:
        """What a fit keeps of it (`Fit.drawn`)."""
        return bootstrap_result(
            self.names, self._values(), self.draws, self.tests, self.widening, self._bounds()
        )

    def _values(self) -> FloatArray:
        return np.array([self.fit.values[name] for name in self.names])

    def _bounds(self) -> FloatArray:
        """Lowest and highest values of the parameters, (p, 2)."""
        own = [self.fit.damper.parameter(name) for name in self.names]
        return np.array([(one.low, one.high) for one in own])


@dataclass(frozen=True)
class _Task:
    """What a worker needs for some of the draws; sent once."""

    model: str
    hysteresis: Hysteresis
    tests: tuple[Measurement, ...]
    weighting: Weighting
    held: frozenset[str]
    near: Mapping[str, float]
    names: tuple[str, ...]
    seed: int
    compiled: bool


def bootstrap(
    fit: Fit,
    tests: Tests,
    *,
    count: int = 1000,
    seed: int = 0,
    executor: Executor | None = None,
    chunks: int | None = None,
    workers: Workers = HERE,
    on_progress: Callable[[str], None] | None = None,
) -> Bootstrap:
    """Resample the tests of a fit, and fit its model to each sample.

    Args:
        fit: fit of these tests with least squares or Huber's loss.
        tests: tests of the fit: a run, its points, or measurements.
        count: number of bootstrap samples.
        seed: random seed; the samples do not depend on the workers.
        executor: executor of `concurrent.futures` that fits parts of the samples; None: use the workers.
        chunks: number of parts for the executor; None: one per processor of this computer.
        workers: workers that fit parts of the samples.
        on_progress: called with a line of text after each part fitted by workers.

    Raises:
        IdentificationFailed: there are fewer than three tests, the tests are not those of the fit, or the fit has a
            model without fast weighted fits, relations to the current, or a series spring.
    """
    if count < LEAST_DRAWS:
        raise IdentificationFailed(f"bootstrap: got count = {count}, expected {LEAST_DRAWS} or more")
    measurements = tuple(fit_inputs(tests, None, (), every_sample=fit.loss != SQUARES).fitted)
    task = _task(fit, measurements, seed, count)
    _refuse_others([test.id for test in fit.error.per_test], [test.id for test in measurements])
    if executor is not None:
        workers = ExecutorWorkers(executor, chunks or os.cpu_count() or 1)
    parts = workers.count if executor is not None or workers is HERE else min(PARTS * workers.count, count // PART)
    shared, numbers = workers.share(task), np.array_split(np.arange(count), max(1, min(parts, count)))
    jobs = [Job(f"bootstrap draws from {part[0]}", _fitted, (shared, tuple(part.tolist()))) for part in numbers]
    clock, report = TimeLeft(len(jobs)), on_progress or (lambda line: None)
    quiet = len(jobs) == 1
    draws = np.concatenate(workers.in_order(
        jobs, lambda job, done: None if quiet else report(f"bootstrap: parts {clock.text(done)}")
    ))  # fmt: skip
    kept = draws[np.all(np.isfinite(draws), axis=1)]
    if kept.shape[0] < 0.9 * count:
        raise IdentificationFailed(f"bootstrap: {count - kept.shape[0]} of {count} samples could not be fitted")
    many = len(measurements)
    widening = math.sqrt((many + 1.0) / (many - 1.0)) * quantile(1, many - 1.0) / quantile()
    return Bootstrap(fit, kept, task.names, many, widening)


def _refuse_others(fitted: Sequence[str], drawn: Sequence[str]) -> None:
    """Refuse tests that the fit did not see, such as held-out ones, or a part of those it saw.

    Raises:
        IdentificationFailed: the ids are others.
    """
    more, fewer = Counter(drawn) - Counter(fitted), Counter(fitted) - Counter(drawn)
    both = (("not fitted:", more), ("missing:", fewer))
    differ = [f"{what} {some(list(ids.elements()))}" for what, ids in both if ids]
    if differ:
        raise IdentificationFailed(
            f"bootstrap: expected the tests of the fit, without validation tests ({'; '.join(differ)})"
        )


def _task(fit: Fit, measurements: tuple[Measurement, ...], seed: int, count: int) -> _Task:
    """What the workers need.

    Raises:
        IdentificationFailed: see `bootstrap`.
    """
    model = fit.damper
    problems = []
    if len(measurements) < FEWEST_TESTS:
        problems.append(f"got {len(measurements)} tests, expected {FEWEST_TESTS} or more")
    if fit.current is not None:
        problems.append("the parameters are functions of the current. Fix: fit with current='affine'")
    if fit.series is not None and fit.series.stiffness_N_m is not None:
        problems.append("the fit has a series spring. Fix: fit without the series spring")
    if not splits(model, measurements):
        problems.append(
            f"all parameters of {model.name} are searched simultaneously, which takes too long for many fits"
        )
    if problems:
        raise IdentificationFailed(f"no bootstrap: {'; '.join(problems)}")
    weight = None if fit.weight == "1" else fit.weight
    weighting = Method(weight=weight).weighting(model)
    if fit.loss == "huber":
        weighting = replace(weighting, extra=huber_weights(model, fit.values, measurements))
    findings = examine(model, measurements)
    names = tuple(name for name in findings.free(model.names) if name != "eta" and name in fit.values)
    held = frozenset(findings.held)
    compiled = count * sum(test.u_m.size for test in measurements) >= WORTH_COMPILING
    return _Task(fit.model, fit.hysteresis_form, measurements, weighting, held, fit.values, names, seed, compiled)


def _fitted(task: _Task, numbers: tuple[int, ...]) -> FloatArray:
    """In a worker: parameter values of some samples, shape (k, p); a row of NaN if a sample cannot be fitted."""
    model = rig.dampers.model(task.model, task.hysteresis)
    if task.compiled:
        import_module("rig.identification.models.kernels")  # loaded, it is used
    cycles = [_cycles(test) for test in task.tests]
    robust = task.weighting.extra
    rows = []
    for number in numbers:
        weights = _drawn_weights(cycles, np.random.default_rng([task.seed, number]))
        extra = weights if robust is None else tuple(a * b for a, b in zip(weights, robust, strict=True))
        try:
            drawn = solve_weighted(model, task.tests, replace(task.weighting, extra=extra), task.held, task.near)
        except IdentificationFailed:
            rows.append([math.nan] * len(task.names))
            continue
        rows.append([drawn.values.get(name, 0.0) for name in task.names])
    return np.array(rows)


def _cycles(test: Measurement) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """The number of the cycle that each sample is in, shape (n,)."""
    period = max(1.0, samples_a_cycle(test.u_m))
    return np.minimum(np.arange(test.u_m.size) / period, max(0.0, round(test.u_m.size / period) - 1.0)).astype(np.int64)


def _drawn_weights(
    cycles: Sequence[np.ndarray[tuple[int], np.dtype[np.int64]]], rng: np.random.Generator
) -> tuple[FloatArray, ...]:
    """Square roots of the weights of one draw, (n,) a test: exponential for tests, and for cycles within each."""
    of_tests = rng.exponential(size=len(cycles))
    weights = []
    for weight, cycle in zip(of_tests / np.mean(of_tests), cycles, strict=True):
        of_cycles = rng.exponential(size=int(cycle[-1]) + 1)
        weights.append(np.sqrt(weight * of_cycles / np.mean(of_cycles))[cycle])
    return tuple(weights)

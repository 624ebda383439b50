"""The coil's lag from current steps: `I' = -eta (I - Icmd)` (9) fitted to the measured current after every step.

The measured current carries the ECU's own clock, so its shape is exact at any speed of a simulated rig; when a command
took effect is fitted too, one instant a step, and never taken from the host's clock.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.errors import IdentificationFailed, RigError, evaluating
from rig.optimisers.least_squares import Descent, Squares, descend
from rig.recording.recorded_point import RecordedPoint
from rig.signals.estimate import Estimate, pooled
from rig.test_point import RESPONSE

if TYPE_CHECKING:
    from rig.identification.points.response_steps import ResponseTest

DESCENT = Descent(1e-14, iterations=60, more=4.0, most_damping=1e10)
LARGEST_LOGARITHM = 20.0  # of eta: beyond it a search has diverged
FEWEST_SAMPLES_A_STEP = 8
SMALLEST_STEP_A = 0.05
T_975_LARGE = 1.96
ETA_START = (5.0, 20.0, 80.0, 320.0)
MOST_LAGS_A_SAMPLE = 2.0
"""A response over within a sample or so shows only that it is faster than that."""
LARGEST_DETERMINED_SHARE = 0.5
"""An eta whose standard error is more than this share of it is not determined."""


@dataclass(frozen=True)
class CurrentLag:
    """The coil's lag.

    Attributes:
        eta_1_s: rate of the lag, 1/s; `std_1_s` its standard error.
        delay_s: from the command's leaving the host to its taking effect, median over the steps; None where host and
            device clocks do not run alike.
        rmse_A: root mean square of what the fit leaves over, A.
        steps: number of steps fitted.
        in_motion: how many of them were made while the rod moved (response tests).
        behind_s: mean delay of the force behind the measured current at these, and its standard error (s); None where
            it is not known.
    """

    eta_1_s: float
    std_1_s: float
    delay_s: float | None
    rmse_A: float
    steps: int
    in_motion: int = 0
    behind_s: tuple[float, float] | None = None

    @property
    def interval_1_s(self) -> tuple[float, float]:
        """Pointwise 95 % interval of eta, 1/s."""
        return self.eta_1_s - T_975_LARGE * self.std_1_s, self.eta_1_s + T_975_LARGE * self.std_1_s


def lag_of(
    points: Sequence[RecordedPoint], response: Sequence[ResponseTest] | None = None
) -> tuple[CurrentLag | None, list[str]]:
    """The lag pooled over current steps at rest and in motion, and one line for each point that cannot be used.

    None when there is no such point or none can be used. Where the points scatter more than their own standard errors
    say, the pooled one is widened by that (Birge 1932).

    Args:
        points: of any kind.
        response: results of the response points among them; None: they are made here.
    """
    if response is None:
        response = _response_of(points)
    lags, refused = [lag for test in response if (lag := _in_motion(test)) is not None], list[str]()
    for name in dict.fromkeys(test.id for test in response if test.current is not None and not test.current.fits):
        refused.append(f"{name}: steps whose measured current does not follow a lag are not used")
    for point in points:
        if not point.at_rest:
            continue
        if point.verdict == "invalid":
            refused.append(f"{point.id} not used because its recording is invalid")
            continue
        try:
            with evaluating("it"):
                lags.append(fit_lag(point))
        except RigError as error:
            refused.append(f"{point.id} not used: {error}")
    if not lags:
        return None, refused
    weights = np.array([1.0 / lag.std_1_s**2 for lag in lags])
    values = np.array([lag.eta_1_s for lag in lags])
    mean_1_s = float(np.sum(weights * values) / np.sum(weights))
    scatter = float(np.sum(weights * (values - mean_1_s) ** 2)) / max(1, len(lags) - 1)
    delays = [lag.delay_s for lag in lags if lag.delay_s is not None]
    behind = pooled(Estimate(*lag.behind_s) for lag in lags if lag.behind_s is not None)
    return CurrentLag(
        eta_1_s=mean_1_s,
        std_1_s=math.sqrt(max(1.0, scatter) / float(np.sum(weights))),
        delay_s=float(np.median(delays)) if delays else None,
        rmse_A=math.sqrt(float(np.mean([lag.rmse_A**2 for lag in lags]))),
        steps=sum(lag.steps for lag in lags), in_motion=sum(lag.in_motion for lag in lags),
        behind_s=None if behind is None else (behind.value, behind.std),
    ), refused


def _response_of(points: Sequence[RecordedPoint]) -> Sequence[ResponseTest]:
    if not any(point.kind == RESPONSE for point in points):
        return ()
    # loads scipy: other fits do not need it
    from rig.identification.points.response_steps import response_tests

    return response_tests(points)[0]


def _in_motion(test: ResponseTest) -> CurrentLag | None:
    """The lag of the measured current at the steps of a response test; None where it was not determined."""
    current = test.current
    if current is None or not current.lag.measured or not current.fits:
        return None
    lag_s, std_s = current.lag.value_s, current.lag.std_s
    known = math.isfinite(test.behind_s[0]) and math.isfinite(test.behind_s[1])
    return CurrentLag(
        1.0 / lag_s, std_s / lag_s**2, None, current.noise, test.steps, test.steps, test.behind_s if known else None
    )


def fit_lag(point: RecordedPoint) -> CurrentLag:
    """Fit the lag to one current-step point.

    Raises:
        IdentificationFailed: no steps, too few samples of the current, or a response that is no first-order lag.
    """
    levels_A = list(point.steps_A)
    raw = point.raw("coil_current")
    if len(levels_A) < 2 or raw is None or "time" not in raw:
        raise IdentificationFailed("the run does not contain current steps with a measured current")
    time_s, current_A = raw["time"].astype(np.float64), raw["value"].astype(np.float64)
    good = np.isfinite(current_A) & np.isfinite(time_s)
    time_s, current_A = time_s[good], current_A[good]
    starts_s = _step_times(time_s, current_A, levels_A)
    response = _Response(time_s, current_A, starts_s, levels_A)
    solutions = [response.solve(eta) for eta in ETA_START]
    best = min(
        (solution for solution in solutions if solution is not None), key=lambda entry: entry.rmse_A, default=None
    )
    fastest_1_s = MOST_LAGS_A_SAMPLE / float(np.median(np.diff(time_s)))
    known = best is not None and 0.0 < best.std_1_s < LARGEST_DETERMINED_SHARE * best.eta_1_s
    if best is None or not known or best.eta_1_s > fastest_1_s:
        raise IdentificationFailed(
            "the current does not follow the steps as a first-order lag that is slow compared with the ECU's status "
            "period; eta is not determined"
        )
    return CurrentLag(best.eta_1_s, best.std_1_s, _delay_s(point, best.starts_s, levels_A), best.rmse_A, len(starts_s))


@dataclass(frozen=True)
class _Solution:
    eta_1_s: float
    std_1_s: float
    rmse_A: float
    starts_s: FloatArray


class _Response(Squares):
    """Measured current (n,) and the model: exponential from level to level, each step from its own instant.

    Unknowns: ln eta, the instants (m,), the levels (m + 1,).
    """

    def __init__(
        self, time_s: FloatArray, current_A: FloatArray, starts_s: FloatArray, levels_A: Sequence[float]
    ) -> None:
        self.time_s, self.current_A = time_s, current_A
        self.starts_s, self.levels_A = starts_s, np.asarray(levels_A, np.float64)
        bounds_s = np.concatenate((starts_s, [np.inf]))
        shift_s = 0.5 * float(np.min(np.diff(time_s)))
        self.diverged = False
        self._model, self._slope = np.zeros(0), np.zeros((0, 0))
        self.step = np.searchsorted(bounds_s - shift_s, time_s, side="right") - 1

    def solve(self, eta_1_s: float) -> _Solution | None:
        """Least squares from a start; None where it does not converge to a finite result."""
        count = len(self.starts_s)
        start = np.concatenate(([math.log(eta_1_s)], self.starts_s, self.levels_A))
        self.diverged = False
        theta, total = descend(self, start, DESCENT)
        if self.diverged:
            return None
        slope = self.model(theta)[1]
        freedom = max(1, len(self.time_s) - len(theta))
        variance = total / freedom
        covariance = variance * np.linalg.pinv(slope.T @ slope)
        eta = math.exp(theta[0])
        std_1_s = eta * math.sqrt(max(0.0, float(covariance[0, 0])))
        return _Solution(eta, std_1_s, math.sqrt(variance), theta[1 : 1 + count])

    def admissible(self, theta: FloatArray) -> bool:
        """See `Squares.admissible`; a search that leaves every rate of a coil has diverged."""
        self.diverged = self.diverged or abs(float(theta[0])) > LARGEST_LOGARITHM
        return not self.diverged

    @property
    def spent(self) -> bool:
        """See `Squares.spent`."""
        return self.diverged

    def value(self, theta: FloatArray) -> float:
        """See `Squares.value`."""
        self._model, self._slope = self.model(theta)
        residual = self.current_A - self._model
        return float(residual @ residual)

    def slopes(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Squares.slopes`."""
        del theta
        return self._slope.T @ self._slope, self._slope.T @ (self.current_A - self._model)

    def model(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Modelled current (n,) and its slope (n, p) by the unknowns."""
        count = len(self.starts_s)
        eta = math.exp(float(theta[0]))
        starts, levels = theta[1 : 1 + count], theta[1 + count :]
        model, slope = np.empty(len(self.time_s)), np.zeros((len(self.time_s), len(theta)))
        before = self.step < 0
        model[before] = levels[0]
        slope[before, 1 + count] = 1.0
        for number in range(count):
            chosen = self.step == number
            since = np.maximum(self.time_s[chosen] - starts[number], 0.0)
            decay, jump = np.exp(-eta * since), levels[number] - levels[number + 1]
            model[chosen] = levels[number + 1] + jump * decay
            slope[chosen, 0] = -jump * since * eta * decay
            slope[chosen, 1 + number] = np.where(since > 0.0, jump * eta * decay, 0.0)
            slope[chosen, 1 + count + number] = decay
            slope[chosen, 2 + count + number] = 1.0 - decay
        return model, slope


def _step_times(time_s: FloatArray, current_A: FloatArray, levels_A: Sequence[float]) -> FloatArray:
    """First guess of the instants (m,) at which the steps took effect: just before the current leaves its level, s.

    Raises:
        IdentificationFailed: a step is too small, or the current never takes it.
    """
    starts, position = [], 0
    for before_A, after_A in itertools.pairwise(levels_A):
        if abs(after_A - before_A) < SMALLEST_STEP_A:
            raise IdentificationFailed(f"the step from {before_A:g} A to {after_A:g} A is too small to identify a lag")
        share = (current_A[position:] - before_A) / (after_A - before_A)
        half = np.flatnonzero(share >= 0.5)
        if len(half) == 0:
            raise IdentificationFailed(f"the measured current never changes from {before_A:g} A to {after_A:g} A")
        left = np.flatnonzero(share[: half[0]] < 0.05)
        first = position + (int(left[-1]) if len(left) else 0)
        starts.append(float(time_s[first]))
        arrived = np.flatnonzero(share[half[0] :] >= 0.95)
        if len(arrived) == 0:
            raise IdentificationFailed(
                f"the current has not settled at {after_A:g} A before the next step. Fix: hold the current longer"
            )
        position += int(half[0] + arrived[0])
        if len(starts) > 1 and np.count_nonzero((time_s >= starts[-2]) & (time_s < starts[-1])) < FEWEST_SAMPLES_A_STEP:
            raise IdentificationFailed(f"fewer than {FEWEST_SAMPLES_A_STEP} current samples per step")
    return np.array(starts)


def _delay_s(point: RecordedPoint, starts_s: FloatArray, levels_A: Sequence[float]) -> float | None:
    """Median time (s) from the command's record to the fitted instant; None where clocks do not run alike."""
    raw = point.raw("commanded_current")
    if float(point.test.get("device_rate", 1.0)) != 1.0 or raw is None or "time" not in raw:
        return None
    delays = []
    for start_s, level_A in zip(starts_s, levels_A[1:], strict=True):
        sent = raw["time"][np.isclose(raw["value"], level_A, atol=1e-3) & (raw["time"] <= start_s + 0.1)]
        if len(sent):
            nearest = sent[np.flatnonzero(np.diff(sent, prepend=-np.inf) > 0.1)[-1]]
            delays.append(float(start_s - nearest))
    return float(np.median(delays)) if delays else None

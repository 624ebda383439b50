"""The response to repeated steps of one size: the fit, the crossings, and what each result is."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.step_response.crossings import WIDER, Crossing, Crossings
from rig.signals.step_response.lag_fit import (
    COURSE_SHARE,
    FEWEST_AFTER,
    SETTLING_SHARE,
    Group,
    LagFit,
    describes,
    fit_one_lag,
    fit_two_lags,
    gain_of,
    step_size,
)
from rig.signals.step_response.lags import EQUAL
from rig.signals.step_response.records import UNFILTERED, Record, Seen
from rig.signals.step_response.result import LEVELS, NORMAL, NOT_KNOWN, State, StepResponse, TimeResult

FEWEST_BEFORE = 4
"""Samples of a record before its step."""
FEWEST_INSIDE = 2
"""Samples of all records on the course of the response; with fewer, the response lies between two samples."""
LEAST_STD_S = 1e-6
VISIBLE = 5.0
"""Standard errors that the step itself must be."""
KNOWN = 0.5
"""A time with a larger relative standard error is not determined."""
COARSEST = 0.1
"""Steps of the sensor's resolution, over the step: with less than ten of them, their errors are not noise."""
LEAST_CLEAR = 20.0
"""Step over noise, times the root of the number of samples on its course: the intervals hold for small errors only (at
14, a third of them missed the truth)."""
LEAST_GAIN = 6.6
"""See `gain_of`: two lags are used from there on (1 %)."""


def step_response(records: Sequence[Record], seen: Seen = UNFILTERED) -> StepResponse:
    """The response to repeated steps of one size.

    Standard errors contain the noise of the samples with its autocorrelation and, where the records scatter by more
    than that explains (5 % level), the scatter from record to record with Student's t of the number of records. What is
    common to all records, the uncertainty of the clock alignment, is added.

    Args:
        records: one for each step; those with too few samples on one side are not used.
        seen: how they were taken.
    """
    usable = [
        record for record in records
        if np.count_nonzero(record.time_s < 0.0) >= FEWEST_BEFORE
        and np.count_nonzero(record.time_s >= 0.0) >= FEWEST_AFTER
    ]
    if not usable:
        return StepResponse(0, why="too few samples before or after the step")
    group = Group(usable, seen)
    fit = fit_one_lag(group)
    size, size_std = step_size(group, fit)
    known = StepResponse(len(usable), size, size_std, math.sqrt(fit.noise.variance), fit.noise.next)
    if not abs(size) > VISIBLE * size_std:
        return replace(known, why="the step cannot be distinguished from the noise")
    two = fit_two_lags(group, fit)
    if two is not None and gain_of(fit, two) > LEAST_GAIN and (two.lags.product <= EQUAL or describes(group, two)):
        fit = two
        size, size_std = step_size(group, fit)
        known = replace(known, size=size, size_std=size_std, noise=math.sqrt(fit.noise.variance),
                        correlation=fit.noise.next, order=2)
    if group.resolution > COARSEST * abs(size):
        return replace(known, why="the resolution of the sensor is too coarse for the step")
    course = max(1, group.inside(fit.lags.dead_s, fit.lags.time_to_s(COURSE_SHARE)))
    if abs(size) * math.sqrt(course) < LEAST_CLEAR * known.noise:
        return replace(known, why="the noise is too high to show the shape of the response")
    return _Times(group, fit).of(known)


class _Times:
    """Results by a fit."""

    def __init__(self, group: Group, fit: LagFit) -> None:
        self._group, self._fit, self._lags = group, fit, fit.lags
        self._slow = self._lags.time_to_s(SETTLING_SHARE) > group.window_s
        end_s = self._lags.time_to_s(COURSE_SHARE)
        coarse = group.inside(self._lags.dead_s, end_s) < FEWEST_INSIDE
        self._gap_s = group.gap_s(self._lags.dead_s, end_s) if coarse else 0.0

    def of(self, known: StepResponse) -> StepResponse:
        """The results, added to what is known of step and noise."""
        fit, lags, group = self._fit, self._lags, self._group
        by_fit = tuple(
            self._of_fit(fit.level_gradient(level), lags.time_to_s(level), absolute=True) for level in LEVELS
        )
        known = replace(
            self._with_lags(known), scatters=fit.scatters, fit=by_fit,
            dead=self._of_fit(np.eye(len(fit.theta))[0], lags.dead_s, absolute=True),
            curve=lambda time_s: group.seen_of(lags, np.asarray(time_s, np.float64)),
        )
        if self._slow:
            return replace(known, crossing=tuple(replace(result, value_s=math.nan) for result in by_fit))
        fits = describes(group, fit)
        crossings = Crossings(group, lags, fit.noise)
        # The end is corrected by what the fit says is left of the step there.
        settled_s = crossings.settled_s
        others = [Crossings(group, fit.tail_shift(settled_s), fit.noise, settled_s)]
        delay_s, delay_std_s = crossings.area()
        if not fits:
            blind = Crossings(group, lags, fit.noise, settled_s, corrected=False)
            delay_std_s = math.hypot(delay_std_s, 0.5 * (blind.area()[0] - delay_s))
            others.append(blind)
        elif crossings.cut_short:
            delay_std_s = math.hypot(delay_std_s, others[0].area()[0] - delay_s)
        return replace(
            known, crossing=tuple(self._crossing(place, crossings, others) for place in range(len(LEVELS))),
            read=not (fits and crossings.cut_short), settling_s=(delay_s, delay_std_s), fits=fits,
            # Of a fit of another shape than the records', the dead time is no property of the response.
            dead=known.dead if fits or fit.scatters else NOT_KNOWN,
        )

    def _with_lags(self, known: StepResponse) -> StepResponse:
        """The lags, or that the response overshoots."""
        fit, lags = self._fit, self._lags
        if fit.order == 1:
            return replace(known, lag=self._of_fit(np.array([0.0, lags.total_s]), lags.total_s, absolute=False))
        std = fit.std(np.array([0.0, 0.0, 1.0]))
        if lags.product - fit.quantile * std > EQUAL:
            return replace(known, overshoots=True)
        # The lags are no smooth function of their product where they are equal: the interval is that of the product.
        ends = [replace(lags, product=min(max(lags.product + side * std, 0.0), EQUAL)).each_s for side in (-1.0, 1.0)]
        results = []
        for place in range(2):
            by_product_s = 0.5 * abs(ends[1][place] - ends[0][place])
            value_s = lags.each_s[place]
            by_total_s = value_s * fit.std(np.array([0.0, 1.0, 0.0]))
            results.append(self.result(value_s, math.hypot(by_product_s, by_total_s), fit.quantile, absolute=False))
        return replace(known, lag=results[0], second_lag=results[1])

    def _of_fit(self, gradient: FloatArray, value_s: float, *, absolute: bool) -> TimeResult:
        if self._gap_s and not absolute:
            return TimeResult(value_s, self._gap_s, 0.0, self._gap_s, State.FASTER, self._gap_s)
        std_s = math.hypot(self._fit.std(gradient), self._gap_s)
        return self.result(value_s, std_s, self._fit.quantile, absolute=absolute)

    def _crossing(self, place: int, crossings: Crossings, others: Sequence[Crossings]) -> TimeResult:
        """A time whose interval contains by how much it depends on the fit and on the width of the parabola."""
        crossing = crossings.crossing(place)
        if not isinstance(crossing, Crossing):
            return NOT_KNOWN if crossing is None else TimeResult(state=State.FASTER, limit_s=crossing)
        result = self.result(crossing.at_s, crossing.std_s, crossing.quantile, absolute=True)
        if not result.measured:
            return result
        compared = [*(other.crossing(place) for other in others), crossings.crossing(place, WIDER)]
        more_s = math.sqrt(sum((one.at_s - result.value_s) ** 2 for one in compared if isinstance(one, Crossing)))
        half_s = math.hypot(result.high_s - result.value_s, NORMAL * more_s)
        return replace(
            result, std_s=math.hypot(result.std_s, more_s), low_s=result.value_s - half_s,
            high_s=result.value_s + half_s,
        )

    def result(self, value_s: float, std_s: float, quantile: float, *, absolute: bool) -> TimeResult:
        """A time with its interval; `absolute`: it is counted from the origin of the times."""
        common_s, std_s = self._group.seen.time_std_s if absolute else 0.0, max(std_s, LEAST_STD_S)
        half_s = math.hypot(quantile * std_s, NORMAL * common_s)
        result = TimeResult(value_s, math.hypot(std_s, common_s), value_s - half_s, value_s + half_s, State.MEASURED)
        if self._slow:
            return replace(result, state=State.SLOWER, limit_s=self._group.window_s)
        if not absolute and (result.low_s <= 0.0 or std_s > KNOWN * value_s):
            limit_s = max(result.high_s, self._group.sample_s)
            return replace(result, low_s=0.0, state=State.FASTER, limit_s=limit_s)
        if not half_s < self._group.window_s:
            return replace(result, state=State.UNKNOWN)
        return result

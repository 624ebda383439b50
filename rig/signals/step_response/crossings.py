"""Times to the levels without a model, and the area between the response and its end.

The line through the baseline and the line through the settled end, each extrapolated to t, divide a sample:
r = (y - A) / (E - A). The time at which r reaches the level is read from a local parabola through the samples of all
records, laid over each other. The fit only says where the end begins, what little of the step is left there, and where
to look for the level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rig.signals.arrays import BoolArray, FloatArray
from rig.signals.step_response.lag_fit import Group
from rig.signals.step_response.lags import Lags
from rig.signals.step_response.lines import Lines
from rig.signals.step_response.noise import Noise, with_scatter
from rig.signals.step_response.result import LEVELS

SETTLED_SHARE = -math.expm1(-5.0)
"""Share of the step after which the settled end begins; 5 time constants of one lag. What is left, 0.7 %, is taken from
the fit."""
LEAST_TAIL = 0.3
"""Share of the window that the settled end takes at least."""
FEWEST_SETTLED = 4
REACHES = (0.5, 0.6, 0.8)
"""Half width of the parabola for each level, over the time constant of a lag with the same slope at the level."""
WIDER, TIMES_WIDER = 1.25, 4
"""It is widened by this factor, so many times at most, until there are enough samples in it."""
FEWEST_PLACES = 6
"""Different instants of samples within a parabola."""


@dataclass(frozen=True)
class Crossing:
    """Time to a level (s) with its standard error (s), and the standard errors of a half 95 % interval."""

    at_s: float
    std_s: float
    quantile: float


class Crossings:
    """Times to the levels without a model.

    Args (construction):
        group: the records.
        lags: of the fit.
        noise: of the samples.
        settled_s: when the settled end begins (s); None: by the fit.
        corrected: whether what is left of the step there is taken from the fit; else nothing is left.

    Attributes:
        settled_s: when the settled end begins (s).
        cut_short: whether it begins before `SETTLED_SHARE` is reached, because the window is short.
    """

    def __init__(
        self, group: Group, lags: Lags, noise: Noise, settled_s: float | None = None, *, corrected: bool = True
    ) -> None:
        self._group, self._noise, self._lags = group, noise, lags
        latest_s = (1.0 - LEAST_TAIL) * group.window_s
        own_s = min(max(lags.dead_s, 0.0) - lags.dead_s + lags.time_to_s(SETTLED_SHARE), latest_s)
        self.settled_s = own_s if settled_s is None else settled_s
        self.cut_short = own_s == latest_s
        self._lines = []
        for record in group.records:
            reached = group.seen_of(lags, record.time_s) if corrected else np.ones(len(record.time_s))
            self._lines.append(Lines(record, self.settled_s, reached, drifts=group.seen.drifts))

    @property
    def _settles(self) -> bool:
        """Whether every record has enough samples in its settled end."""
        return min(int(np.count_nonzero(lines.settled)) for lines in self._lines) >= FEWEST_SETTLED

    def crossing(self, place: int, wider: float = 1.0) -> Crossing | float | None:
        """Time to one of `LEVELS`, by a parabola that is wider than usual by this factor.

        Returns:
            The crossing; the time (s) below which it is where there are too few samples around it; None where it cannot
            be determined.
        """
        if not self._settles:
            return None
        level, lags = LEVELS[place], self._lags
        at_s = lags.time_to_s(level)
        # The parabola is laid once more about the time first found.
        half_s = wider * REACHES[place] * self._scale_s(level)
        for last in (False, True):
            samples = self._local(at_s, half_s)
            if samples is None:
                return max(at_s, 0.0) + self._group.sample_s
            chosen, time_s, share = samples
            columns = np.vander(time_s - at_s, 3, increasing=True)
            inverse = np.linalg.pinv(columns)
            height, slope, bend = inverse @ share
            if not slope > 0.0:
                return None
            move_s = _root(height - level, slope, bend)
            if abs(move_s) > half_s:
                return None
            if last:
                weights = np.array([1.0, move_s, move_s**2]) @ inverse / (slope + 2.0 * bend * move_s)
                return self._with_errors(at_s + move_s, chosen, weights, share - columns @ (inverse @ share))
            at_s += move_s
        return None

    def _scale_s(self, level: float) -> float:
        """Time constant (s) of the lag with the slope of the fit at a level."""
        lags, apart = self._lags, 0.01
        return (1.0 - level) / (2.0 * apart) * (lags.time_to_s(level + apart) - lags.time_to_s(level - apart))

    def _local(self, at_s: float, half_s: float) -> tuple[list[BoolArray], FloatArray, FloatArray] | None:
        """Samples around a time: which of each record, their times and shares; None where there are too few.

        No sample from before the end of the dead time is among them: there the response has a corner.
        """
        records = self._group.records
        for _ in range(TIMES_WIDER):
            low_s = max(at_s - half_s, self._lags.dead_s)
            chosen = [(record.time_s >= low_s) & (record.time_s <= at_s + half_s) for record in records]
            time_s = np.concatenate([one.time_s[rows] for one, rows in zip(records, chosen, strict=True)])
            if len(np.unique(np.round(time_s / (0.05 * self._group.sample_s)))) >= FEWEST_PLACES:
                share = np.concatenate([one.share[rows] for one, rows in zip(self._lines, chosen, strict=True)])
                return chosen, time_s, share
            half_s *= WIDER
        return None

    def _with_errors(
        self, at_s: float, chosen: Sequence[BoolArray], weights: FloatArray, rest: FloatArray
    ) -> Crossing:
        """The time with its standard error, and the correction for the sensor's filter.

        Args:
            at_s: the time (s).
            chosen: which samples of each record the parabola is laid through.
            weights: of their shares in the time, s (k,).
            rest: what the parabola leaves of their shares (k,).
        """
        first, influences, variances = 0, [], []
        for lines, rows in zip(self._lines, chosen, strict=True):
            count = int(np.count_nonzero(rows))
            own = np.zeros(len(rows))
            own[rows] = weights[first : first + count]
            influences.append([-float(own[rows] @ rest[first : first + count])])
            variances.append([self._noise.variance_of(lines.spread(own))])
            first += count
        total = np.array([[sum(variance[0] for variance in variances)]])
        widened, _, quantile = with_scatter(total, np.array(influences), np.array(variances))
        return Crossing(at_s - self._filter_s(at_s), math.sqrt(float(widened[0, 0])), quantile)

    def _filter_s(self, at_s: float) -> float:
        """By how much the sensor's filter moves the crossing at this time (s), for the fitted lags."""
        if self._group.seen.bandwidth_Hz is None:
            return 0.0
        reached = float(self._group.seen_of(self._lags, np.array([at_s]))[0])
        return at_s - self._lags.time_to_s(reached) if 0.0 < reached < 1.0 else 0.0

    def area(self) -> tuple[float, float]:
        """Mean delay: integral of 1 - r from the origin to the settled end (s), and its standard error.

        It is additive: the delay of a chain is the sum of the delays of its parts, whatever their shapes.
        """
        delays, variances = [], []
        if not self._settles:
            return math.nan, math.nan
        for record, lines in zip(self._group.records, self._lines, strict=True):
            inside = (record.time_s >= 0.0) & (record.time_s <= self.settled_s)
            if np.count_nonzero(inside) < FEWEST_SETTLED:
                return math.nan, math.nan
            time_s = record.time_s[inside]
            widths = np.zeros(len(time_s))
            gaps = np.diff(time_s)
            widths[:-1] += 0.5 * gaps
            widths[1:] += 0.5 * gaps
            widths[0] += 0.5 * time_s[0]
            own = np.zeros(len(record.time_s))
            own[inside] = widths
            delays.append(float(widths @ (1.0 - lines.share[inside])) + 0.5 * float(time_s[0]))
            variances.append(self._noise.variance_of(lines.spread(own)))
        count = len(delays)
        std_s = math.sqrt(sum(variances)) / count
        if count >= 4:
            std_s = max(std_s, float(np.std(delays, ddof=1)) / math.sqrt(count))
        # The trapezoid cuts the corner at the end of the dead time.
        return float(np.mean(delays)), math.hypot(std_s, self._group.sample_s**2 / (12.0 * self._lags.total_s))


def _root(height: float, slope: float, bend: float) -> float:
    """The root nearest to 0 of height + slope x + bend x^2; of the line where the parabola has none."""
    inside = slope**2 - 4.0 * bend * height
    if abs(bend) * abs(height) < 1e-12 * slope**2 or inside < 0.0:
        return -height / slope
    return -2.0 * height / (slope + math.sqrt(inside))

"""When the samples of a record were taken, from a column of time that is printed with few digits or jitters.

A column whose steps are a uniform rate plus rounding is that uniform rate: stamps t_i = round(a + p k_i, q) lie within
one printing step q of a line over their numbers k_i, so the line is fitted by least squares (the error of p is about
q / n^1.5) and the samples are put on it. The rounding repeats in every cycle of a motion that is commensurate with the
rate, so no average over cycles would take it off. Rows that are missing stay missing: k_i jumps over them.

Stamps that leave the line by more than their printing step either jitter about samples that were taken uniformly (a
program's clock beside a converter's) or are right (a loop that samples when it comes round). The signals decide: over
the right times they are smooth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from rig.signals.arrays import FloatArray

FEWEST = 16
GAP_STEPS = 1.5
"""Steps longer than so many periods, and than one and a printing step, are a gap."""
FINE = 1e-3
"""Of the period: stamps that are so near a line are left as they are."""
ROUNDED = 1.02
"""Printing steps that the stamps may span about their line; in one step only the arithmetic is added to that."""
EXACT = 16.0
"""Units in the last place of the greatest stamp (float64): what differs by less is equal."""
MOST_KINDS = 64
"""Different steps of which the printing step is found; a clock that is not printed coarsely has as many as samples."""
TAIL = 0.1
"""Share of the record at its end of which the printing step is found too: of a fixed number of digits it grows."""
SMOOTH_ORDER = 5
"""Divided differences of this order vanish for a smooth signal, and leave its noise."""
SMOOTHER = 0.8
"""Noise of a signal over one set of times as a share of that over another, from which the first is the right one."""
MOST_ROWS = 0.1
"""Share of the steps that missing or doubled rows are of at most."""
FEWEST_SLIPS = 5
"""So many of them are told from a rate that is a little beside the stamps' own: those come at equal distances."""
LATE_AND_EARLY = 0.5
"""So many short steps for each long one show a clock that jitters, and no missing rows."""
NEAR_A_LINE = 3.0
"""Periods by which jittering stamps may leave their line."""
WINDOWS = ENOUGH_STEPS = 20_000
ROUNDS = 4
LARGEST_STEP = 0.9
"""Printing steps over the period, up to which every stamp tells the number of its sample."""
SINGLE_UNITS = (1.0, 1e3, 1e6)
"""Units a second of stamps that may have been stored in single precision."""


class TimeBase(StrEnum):
    """How the times of a record were found."""

    AS_READ = "as-read"
    """They are uniform as they are read, or no better ones can be found."""
    ROUNDED = "rounded-uniform"
    """A uniform rate behind stamps with few digits."""
    JITTER = "jitter-uniform"
    """A uniform rate behind stamps that jitter: the signals are smooth over it, and not over the stamps."""
    IRREGULAR = "irregular"
    """The stamps are right, or at least not proved wrong; their errors are in `std_s`."""


@dataclass(frozen=True)
class SampleTimes:
    """Times of a record's samples.

    Attributes:
        time_s: times (s), shape (n,), increasing.
        base: how they were found.
        rate_Hz: of uniform samples; NaN for none.
        resolution_s: printing step of the stamps (s); 0 where they are as fine as their arithmetic.
        scatter_s: standard deviation of the stamps about a uniform rate (s).
        std_s: standard error of a single time that is left in `time_s` (s).
    """

    time_s: FloatArray
    base: TimeBase
    rate_Hz: float
    resolution_s: float = 0.0
    scatter_s: float = 0.0
    std_s: float = 0.0

    @property
    def uniform(self) -> bool:
        """Whether `time_s` is a uniform rate in place of the stamps."""
        return self.base in {TimeBase.ROUNDED, TimeBase.JITTER}

    @property
    def description(self) -> str:
        """The time base in words; empty where the times are uniform as they are read."""
        few = f"time stamps in steps of {1e3 * self.resolution_s:.4g} ms" if self.resolution_s > 0.0 else "time stamps"
        if self.base is TimeBase.ROUNDED:
            return f"{few}, read as a uniform rate of {self.rate_Hz:.5g} Hz"
        if self.base is TimeBase.JITTER:
            return (
                f"{few} with a jitter of {1e3 * self.scatter_s:.3g} ms (standard deviation), read as a uniform rate of "
                f"{self.rate_Hz:.5g} Hz, at which displacement and force are smooth"
            )
        if self.base is TimeBase.IRREGULAR:
            left = (
                f"an error of {1e3 * self.std_s:.3g} ms in each time stamp is included in the intervals"
            ) if self.std_s > 0.0 else (
                "displacement and force are smooth at these times"
            )
            return f"{few}, not uniform (standard deviation {1e3 * self.scatter_s:.3g} ms), used as read: {left}"
        return ""


def sample_times(stamps_s: FloatArray, signals: tuple[FloatArray, ...] = ()) -> SampleTimes:
    """The times of samples, from their stamps.

    Args:
        stamps_s: as read (n,), s, finite; equal neighbours are possible where few digits are printed.
        signals: what was sampled, each (n,), NaN where nothing was: they decide between a jittering clock and samples
            that were taken irregularly.

    Returns:
        Times that begin at 0. Times that do not increase are only left where no uniform rate is behind them.
    """
    stamps_s = np.asarray(stamps_s, np.float64)
    exact_s = EXACT * np.finfo(np.float64).eps * float(np.max(np.abs(stamps_s), initial=0.0))
    since_s = stamps_s - stamps_s[0] if stamps_s.size else stamps_s
    steps_s = np.diff(since_s)
    usual_s = float(np.median(steps_s)) if steps_s.size else math.nan
    if since_s.size < FEWEST or not np.all(np.isfinite(since_s)) or np.any(steps_s < 0.0) or not since_s[-1] > 0.0:
        return SampleTimes(since_s, TimeBase.AS_READ, math.nan)
    multiples_s = steps_s - usual_s * np.round(steps_s / usual_s) if usual_s > exact_s else steps_s
    others = int(np.count_nonzero(np.abs(steps_s - usual_s) > exact_s))
    # Uniform but for missing or doubled rows, or a rate beside the stamps' own, which slips by a stamp again and again.
    whole = float(np.max(np.abs(multiples_s))) <= exact_s
    of_rows = whole and others < MOST_ROWS * steps_s.size
    if of_rows and others < FEWEST_SLIPS:
        return SampleTimes(since_s, TimeBase.AS_READ, 1.0 / usual_s)
    step_s = _printing_step(stamps_s, steps_s, exact_s)
    lines = []
    for apart in (False, True):
        line_s, span_s, period_s = _line(since_s, steps_s, step_s, apart=apart)
        lines.append((line_s, span_s, period_s))
        if span_s <= max(exact_s, FINE * period_s):
            return SampleTimes(since_s, TimeBase.AS_READ, 1.0 / period_s, step_s if step_s > 2.0 * exact_s else 0.0)
        if span_s <= ROUNDED * step_s + exact_s:
            # Rows that are missing at equal distances leave the very stamps of a lower rate that is rounded.
            if whole and usual_s > exact_s and _smoother(since_s, line_s, signals):
                return SampleTimes(since_s, TimeBase.AS_READ, 1.0 / usual_s)
            scatter_s = float(np.std(since_s - line_s))
            return SampleTimes(line_s - line_s[0], TimeBase.ROUNDED, 1.0 / period_s, step_s, scatter_s)
        if of_rows:
            return SampleTimes(since_s, TimeBase.AS_READ, 1.0 / usual_s)
    numbers = np.arange(since_s.size, dtype=np.float64)
    period_s = _period(numbers, since_s, np.zeros(since_s.size, np.int64))
    left_s = since_s - period_s * numbers
    left_s -= np.mean(left_s)
    lines.append((since_s - left_s, float(np.ptp(left_s)), period_s))  # a jitter may look like a gap, and be none
    if _late_and_early(steps_s, usual_s):  # the stretches between late stamps lack long steps: too short a period
        lines[:-1] = [_line(since_s, steps_s, step_s, apart=apart, gap=NEAR_A_LINE) for apart in (False, True)]
    line_s, span_s, period_s = min(lines, key=lambda line: line[1])
    scatter_s = float(np.std(since_s - line_s))
    resolution_s = step_s if step_s > 2.0 * exact_s else 0.0
    of_stamps, of_line = (_roughness(times_s, signals) for times_s in (since_s, line_s))
    smooth_over_line = bool(signals) and all(
        line < SMOOTHER * stamps for line, stamps in zip(of_line, of_stamps, strict=True)
    )
    if smooth_over_line and span_s <= NEAR_A_LINE * period_s and np.all(np.diff(line_s) > 0.0):
        return SampleTimes(line_s - line_s[0], TimeBase.JITTER, 1.0 / period_s, resolution_s, scatter_s)
    right = any(stamps < SMOOTHER * line for line, stamps in zip(of_line, of_stamps, strict=True))
    std_s = resolution_s / math.sqrt(12.0) if right or span_s > NEAR_A_LINE * period_s else scatter_s
    return SampleTimes(since_s, TimeBase.IRREGULAR, math.nan, resolution_s, scatter_s, std_s)


def _printing_step(stamps_s: FloatArray, steps_s: FloatArray, exact_s: float) -> float:
    """The greatest step (s) in which the stamps are printed or stored; 0 where it is that of their arithmetic."""
    tail = steps_s[-max(FEWEST, int(TAIL * steps_s.size)) :][:ENOUGH_STEPS]
    stamps_s, steps_s = (values[:: max(1, values.size // ENOUGH_STEPS)] for values in (stamps_s, steps_s))
    step_s = max(_common_step(steps_s, exact_s), _common_step(tail, exact_s))
    for scale in SINGLE_UNITS:
        stored = stamps_s * scale
        if np.allclose(stored.astype(np.float32), stored, rtol=1e-14, atol=0.0):
            step_s = max(step_s, float(np.spacing(np.float32(np.max(np.abs(stored))))) / scale)
    return step_s


def _common_step(steps_s: FloatArray, exact_s: float) -> float:
    """What all steps are whole multiples of (s); 0 where there is nothing, or all steps are one."""
    ordered = np.sort(steps_s[steps_s > 2.0 * exact_s])
    kinds = ordered[np.concatenate(([True], np.diff(ordered) > 2.0 * exact_s))] if ordered.size else ordered
    if not 1 <= kinds.size <= MOST_KINDS or (kinds.size == 1 and not np.any(steps_s <= 2.0 * exact_s)):
        return 0.0
    step_s, error_s = float(kinds[0]), exact_s
    for kind in kinds[1:].tolist():
        one, other, one_error, other_error = kind, step_s, exact_s, error_s
        while other > 2.0 * other_error:  # Euclid; what a remainder is wrong by grows with the quotient
            times = round(one / other)
            rest, rest_error = abs(one - times * other), one_error + times * other_error
            one, other, one_error, other_error = other, rest, other_error, rest_error
        step_s, error_s = one, one_error
    if step_s <= 8.0 * error_s:
        return 0.0
    step_s = float(np.sum(kinds) / np.sum(np.round(kinds / step_s)))
    decimal_s = 10.0 ** round(math.log10(step_s))
    return decimal_s if abs(step_s - decimal_s) <= 2.0 * exact_s else step_s


def _line(
    since_s: FloatArray, steps_s: FloatArray, step_s: float, *, apart: bool, gap: float = GAP_STEPS
) -> tuple[FloatArray, float, float]:
    """Times on a line over the samples' numbers (n,), the span of the stamps about it and the period (s).

    Missing samples have numbers too. `apart`: the stretches between gaps have one period and each its own beginning, as
    after a pause of the recording. `gap`: periods, beyond which a step is one.
    """
    usual_s = float(np.median(steps_s))
    mean_s = float(np.mean(steps_s[steps_s <= gap * usual_s + step_s]))
    period_s = mean_s if mean_s > 0.0 else float(since_s[-1]) / (since_s.size - 1)
    for _ in range(ROUNDS):
        parted = steps_s > period_s + max((gap - 1.0) * period_s, ROUNDED * step_s)
        counts = np.where(parted, np.maximum(1.0, np.round(steps_s / period_s)), 1.0)
        numbers = np.concatenate(([0.0], np.cumsum(counts)))
        stretch = np.concatenate(([0], np.cumsum(parted)))
        period_s = _period(numbers, since_s, stretch)  # of the stretches: none of their numbers can be wrong
    if not apart:
        period_s = _period(numbers, since_s, np.zeros_like(stretch))
        stretch = np.zeros_like(stretch)
        for _ in range(ROUNDS if step_s < LARGEST_STEP * period_s else 0):  # a missing sample that no step shows
            begin_s = float(np.median(since_s - period_s * numbers))
            known = np.round((since_s - begin_s) / period_s)
            if np.array_equal(known, numbers) or np.any(np.diff(known) < 1.0):
                break
            numbers, period_s = known, _period(known, since_s, stretch)
    left_s = _about_mean(since_s, stretch) - period_s * _about_mean(numbers, stretch)
    first = np.flatnonzero(np.diff(stretch, prepend=-1))
    span_s = _span(left_s, first)
    if step_s < span_s < 2.0 * step_s:  # of m printing steps the least squares tilt by 1 / m^2 of the period
        k = _about_mean(numbers, stretch)
        tilt_s = _least_tilt(left_s, k, first, 2.0 * step_s / max(1.0, float(np.ptp(k))))
        left_s -= tilt_s * k
        period_s, span_s = period_s + tilt_s, _span(left_s, first)
    return since_s - left_s, span_s, period_s


def _about_mean(values: FloatArray, stretch: NDArray[np.int64]) -> FloatArray:
    """Values less the mean of their stretch (n,)."""
    return np.asarray(values - (np.bincount(stretch, values) / np.bincount(stretch))[stretch])


def _period(numbers: FloatArray, since_s: FloatArray, stretch: NDArray[np.int64]) -> float:
    """The one period (s) of all stretches, each with its own beginning, by least squares."""
    k = _about_mean(numbers, stretch)
    return float(k @ since_s) / max(float(k @ k), 1.0)


def _span(left_s: FloatArray, first: NDArray[np.int64]) -> float:
    """The widest span (s) of any stretch, each from its first sample on."""
    return float(np.max(np.maximum.reduceat(left_s, first) - np.minimum.reduceat(left_s, first)))


def _least_tilt(left_s: FloatArray, k: FloatArray, first: NDArray[np.int64], reach_s: float) -> float:
    """What to add to the period (s) for the least span of the stamps about their line; the span is convex in it."""
    low, high = -reach_s, reach_s
    for _ in range(40):
        one, other = low + 0.382 * (high - low), low + 0.618 * (high - low)
        low, high = (low, other) if _span(left_s - one * k, first) < _span(left_s - other * k, first) else (one, high)
    return 0.5 * (low + high)


def _late_and_early(steps_s: FloatArray, usual_s: float) -> bool:
    """Whether long steps are late stamps and no missing rows: about as many are short."""
    long = int(np.count_nonzero(steps_s > GAP_STEPS * usual_s))
    short = int(np.count_nonzero(steps_s < (2.0 - GAP_STEPS) * usual_s))
    return long > 0 and short >= LATE_AND_EARLY * long


def _smoother(one_s: FloatArray, other_s: FloatArray, signals: tuple[FloatArray, ...]) -> bool:
    """Whether a signal is smooth over one set of times, and not over the other."""
    of_one, of_other = (_roughness(times_s, signals) for times_s in (one_s, other_s))
    return any(one < SMOOTHER * other for one, other in zip(of_one, of_other, strict=True))


def _roughness(time_s: FloatArray, signals: tuple[FloatArray, ...]) -> list[float]:
    """Of each signal the noise, in its unit, that its neighbours show over these times: median over all windows.

    Infinite where no window has times one after the other: nothing is smooth over these.
    """
    width = SMOOTH_ORDER + 1
    starts = np.arange(0, time_s.size - width + 1)
    starts = starts[:: max(1, starts.size // WINDOWS)]
    rows = starts[:, None] + np.arange(width)
    times = time_s[rows]
    usual_s = float(np.median(np.diff(time_s)))
    steps_s = np.diff(times, axis=1)
    good = np.all(steps_s > 0.0, axis=1) & (np.max(steps_s, axis=1) <= 3.0 * max(usual_s, 1e-300))
    if not np.any(good):
        return [math.inf] * len(signals)
    times, rows = times[good] / max(usual_s, 1e-300), rows[good]
    apart = times[:, :, None] - times[:, None, :]
    apart[:, np.arange(width), np.arange(width)] = 1.0
    weights = 1.0 / np.prod(apart, axis=2)
    weights /= np.sqrt(np.sum(weights**2, axis=1))[:, None]
    left = [np.abs(np.sum(weights * signal[rows], axis=1)) for signal in signals]
    return [float(np.median(values[np.isfinite(values)])) if np.any(np.isfinite(values)) else 0.0 for values in left]

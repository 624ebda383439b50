"""Steady motions in one record: where amplitude, frequency or current are constant over some cycles.

A dynamometer's file often holds several: steps of frequency or amplitude, a burst before a slow motion, steps of the
current. Each cycle is measured by itself, between upward crossings of the middle of its own stroke, so that a small
motion is seen beside a large one; runs of like cycles are the motions. A sweep has no such runs: its cycles change
within every run as they do from one run to the next.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.signals.arrays import FloatArray
from rig.signals.loop_shape import noise_of

MOST_SAMPLES = 200_000
"""Looked at; of more the means of neighbours are."""
SMALLEST_STROKE = 0.02
"""Of the record's span: a smaller movement is none."""
STROKE_NOISES = 8.0
"""Standard deviations of the noise, which a smaller movement may be."""
SAME_PERIOD, SAME_AMPLITUDE = 0.025, 0.05
"""Relative differences within which cycles belong to one run."""
OTHER_PERIOD, OTHER_AMPLITUDE = 0.03, 0.08
"""Relative differences from which two runs are different motions."""
LIKE = 25
"""Cycles of a run with which a further one is compared."""
FEWEST_CYCLES = 3
MOST_OF_CYCLES = 0.5
"""Share of the record's cycles that its steady motions have at least: a few like cycles of a sweep are no motion."""
QUARTERS = 4
PAUSE = 0.1
"""Periods between two cycles, from which the rod was at rest between them."""
BESIDE = 2.5
"""Periods between two runs of one motion, up to which the second goes on with the first."""
DRIFT = 0.6
"""Share of the tolerance by which a run may change from its first to its last cycle and still be steady."""
MARGIN = 0.3
"""Periods, its own or its neighbour's, before the first crossing and after the last that belong to a motion."""
AT_REST = 0.25
"""Of the longest period of a steady motion: a rod that moves by less than the smallest stroke during it is at rest."""


@dataclass(frozen=True)
class SteadyMotion:
    """A motion with constant amplitude, frequency and current.

    Attributes:
        start_s: its first upward crossing; `end_s` its last (s).
        cycles: between them.
        amplitude_m: of a sine of as much power (m).
        frequency_Hz: cycles a second.
        current_A: mean current; 0 where there is none.
        lead_s: time before the first crossing, and `tail_s` after the last, that show the crossings and nothing else.
    """

    start_s: float
    end_s: float
    cycles: int
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    lead_s: float
    tail_s: float

    @property
    def stretch_s(self) -> tuple[float, float]:
        """From where to where the record is this motion (s), with what leads in and out."""
        return self.start_s - self.lead_s, self.end_s + self.tail_s

    def is_other(self, than: SteadyMotion, current_tolerance_A: float) -> bool:
        """Whether it differs from another motion in amplitude, frequency or current."""
        return (
            abs(math.log(self.frequency_Hz / than.frequency_Hz)) > OTHER_PERIOD
            or abs(math.log(self.amplitude_m / than.amplitude_m)) > OTHER_AMPLITUDE
            or abs(self.current_A - than.current_A) > current_tolerance_A
        )


@dataclass(frozen=True)
class _Cycles:
    """Single cycles (k,): their upward crossings (s), amplitudes of a sine of as much power (m).

    `current_A`: median of each quarter of each cycle (k, QUARTERS), A: a step inside a cycle belongs to no level.
    """

    start_s: FloatArray
    end_s: FloatArray
    amplitude_m: FloatArray
    current_A: FloatArray

    @property
    def period_s(self) -> FloatArray:
        return np.maximum(self.end_s - self.start_s, 1e-9)


@dataclass(frozen=True)
class Motions:
    """What moves in a record.

    Attributes:
        steady: its steady motions, in order; of less than two nothing is split.
        rest_s: time at rest (s).
    """

    steady: tuple[SteadyMotion, ...]
    rest_s: float


def motions_of(
    time_s: FloatArray, displacement_m: FloatArray, current_A: FloatArray | None = None, *,
    current_tolerance_A: float = math.inf,
) -> Motions:
    """The steady motions of a record.

    Args:
        time_s: (n,) s, increasing.
        displacement_m: (n,) m; NaN where nothing was measured.
        current_A: coil current or its command (n,), A; None: constant.
        current_tolerance_A: differences of current up to this one are none (A).
    """
    known = np.isfinite(displacement_m) & np.isfinite(time_s)
    t, x = time_s[known], displacement_m[known]
    current = np.zeros(t.size) if current_A is None else np.asarray(current_A)[known]
    every = max(1, t.size // MOST_SAMPLES)
    if every > 1:
        t, x, current = (values[: values.size // every * every].reshape(-1, every).mean(axis=1) for values in
                         (t, x, current))  # fmt: skip
    if t.size < FEWEST_CYCLES:
        return Motions((), 0.0)
    stroke_m = max(SMALLEST_STROKE * float(np.ptp(x)), STROKE_NOISES * noise_of(x))
    cycles = _cycles(t, x, current, stroke_m) if stroke_m > 0.0 else None
    if cycles is None:
        return Motions((), float(t[-1] - t[0]))
    runs = [run for run in _runs(cycles, current_tolerance_A) if run.stop - run.start >= FEWEST_CYCLES]
    steady = _joined([_motion(cycles, run) for run in runs if _is_steady(cycles, run)], current_tolerance_A)
    if sum(motion.cycles for motion in steady) < MOST_OF_CYCLES * cycles.period_s.size:
        steady = []
    steady = [_within_its_own(motion, t, x) for motion in steady]
    longest_s = max((1.0 / motion.frequency_Hz for motion in steady), default=float(np.median(cycles.period_s)))
    return Motions(tuple(steady), _rest_s(t, x, stroke_m, AT_REST * longest_s))


def _turns(x: FloatArray, stroke: float) -> NDArray[np.int64]:
    """Indices of the reversals between which the signal goes at least one stroke, lows and highs in turn."""
    slope = np.sign(np.diff(x))
    candidates = [0, *(np.flatnonzero(slope[:-1] * slope[1:] <= 0.0) + 1).tolist(), x.size - 1]
    values = x[candidates].tolist()
    turns: list[int] = []
    low = high = 0
    rising: bool | None = None
    for at, value in enumerate(values):
        if value > values[high]:
            high = at
        if value < values[low]:
            low = at
        if rising is not False and value <= values[high] - stroke:
            turns.append(candidates[high])
            rising, low = False, at
        elif rising is not True and value >= values[low] + stroke:
            turns.append(candidates[low])
            rising, high = True, at
    turns.append(candidates[high] if rising else candidates[low])
    return np.array(turns, np.int64)


def _cycles(t: FloatArray, x: FloatArray, current_A: FloatArray, stroke_m: float) -> _Cycles | None:
    """Every cycle between two upward strokes, over the middle of its own travel; None without one.

    A rest in the middle of an upward stroke belongs to no cycle: one ends where it is reached, the next begins where it
    is left.
    """
    turns = _turns(x, stroke_m).tolist()
    first = 0 if len(turns) > 1 and x[turns[1]] > x[turns[0]] else 1
    begin_s, end_s, amplitude_m = [], [], []
    current: list[list[float]] = []
    for low, high, next_low, next_high in zip(
        turns[first::2], turns[first + 1 :: 2], turns[first + 2 :: 2], turns[first + 3 :: 2], strict=False
    ):
        middle = 0.5 * (x[high] + x[next_low])
        begin, started_s = _crossing(t, x, low, high, middle, last=True)
        end, ended_s = _crossing(t, x, next_low, next_high, middle, last=False)
        part = slice(begin, max(end, begin + 1))
        begin_s.append(started_s)
        end_s.append(ended_s)
        amplitude_m.append(max(math.sqrt(2.0) * float(np.std(x[part])), 1e-300))
        known_A = current_A[part][np.isfinite(current_A[part])]
        usual_A = float(np.median(known_A)) if known_A.size else 0.0
        quarters = np.array_split(known_A, QUARTERS)
        current.append([float(np.median(quarter)) if quarter.size else usual_A for quarter in quarters])
    if not begin_s:
        return None
    return _Cycles(np.array(begin_s), np.array(end_s), np.array(amplitude_m), np.array(current))


def _crossing(t: FloatArray, x: FloatArray, low: int, high: int, level: float, *, last: bool) -> tuple[int, float]:
    """The first sample above a level on the way up, or that after the last below it, and when the level is crossed."""
    below = x[low : high + 1] < level
    at = low + (below.size - int(np.argmax(below[::-1])) if last else int(np.argmin(below)))
    at = min(max(at, low + 1), high)
    rise = float(x[at] - x[at - 1])
    share = min(max((level - float(x[at - 1])) / rise, 0.0), 1.0) if rise > 0.0 else 0.0
    return at, float(t[at - 1] + share * (t[at] - t[at - 1]))


def _runs(cycles: _Cycles, current_tolerance_A: float) -> list[range]:
    """Stretches of cycles that are like the middle one of the first in the stretch."""
    period, amplitude, current = np.log(cycles.period_s), np.log(cycles.amplitude_m), cycles.current_A
    runs, first = [], 0
    for at in range(1, period.size + 1):
        if at < period.size and cycles.start_s[at] - cycles.end_s[at - 1] <= PAUSE * cycles.period_s[at - 1] and all(
            np.all(np.abs(values[at] - np.median(values[first : min(at, first + LIKE)], axis=0)) <= tolerance)
            for values, tolerance in
            ((period, SAME_PERIOD), (amplitude, SAME_AMPLITUDE), (current, current_tolerance_A))
        ):
            continue
        runs.append(range(first, at))
        first = at
    return runs


def _is_steady(cycles: _Cycles, run: range) -> bool:
    """Whether the run's cycles do not change all the way, as those of a sweep do."""
    number = np.arange(len(run)) - 0.5 * (len(run) - 1)
    for values, tolerance in ((cycles.period_s, SAME_PERIOD), (cycles.amplitude_m, SAME_AMPLITUDE)):
        logs = np.log(values[run.start : run.stop])
        trend = float(number @ logs) / float(number @ number) * (len(run) - 1)
        left = float(np.std(logs - np.mean(logs) - trend / max(1, len(run) - 1) * number))
        if abs(trend) > max(DRIFT * tolerance, 3.0 * left):
            return False
    return True


def _motion(cycles: _Cycles, run: range) -> SteadyMotion:
    start_s, end_s = float(cycles.start_s[run.start]), float(cycles.end_s[run.stop - 1])
    inside, period_s = slice(run.start, run.stop), cycles.period_s
    usual_s = float(np.median(period_s[inside]))
    lead_s = tail_s = MARGIN * usual_s
    if run.start > 0:  # of a faster motion right before it no more than its last low
        lead_s = min(lead_s, max(MARGIN * float(period_s[run.start - 1]), start_s - float(cycles.end_s[run.start - 1])))
    if run.stop < period_s.size:
        tail_s = min(tail_s, max(MARGIN * float(period_s[run.stop]), float(cycles.start_s[run.stop]) - end_s))
    return SteadyMotion(
        start_s, end_s, len(run), float(np.median(cycles.amplitude_m[inside])), len(run) / (end_s - start_s),
        float(np.median(cycles.current_A[inside])), lead_s, tail_s,
    )


def _joined(motions: Sequence[SteadyMotion], current_tolerance_A: float) -> list[SteadyMotion]:
    """The motions, those that go on after an odd cycle as one."""
    joined: list[SteadyMotion] = []
    for motion in motions:
        before = joined[-1] if joined else None
        if (
            before is None or motion.is_other(before, current_tolerance_A)
            or motion.start_s - before.end_s > BESIDE / motion.frequency_Hz
        ):
            joined.append(motion)
            continue
        joined[-1] = replace(
            before, end_s=motion.end_s, cycles=before.cycles + motion.cycles, tail_s=motion.tail_s
        )
    return joined


def _within_its_own(motion: SteadyMotion, t: FloatArray, x: FloatArray) -> SteadyMotion:
    """The motion without what of its neighbours goes beyond its own travel: it would move the middle of all of it."""
    first, last = np.searchsorted(t, [motion.start_s, motion.end_s]).tolist()
    low, high = float(np.min(x[first:last])), float(np.max(x[first:last]))
    before = np.flatnonzero((t >= motion.start_s - motion.lead_s) & (t < motion.start_s) & ((x < low) | (x > high)))
    after = np.flatnonzero((t <= motion.end_s + motion.tail_s) & (t >= motion.end_s) & ((x < low) | (x > high)))
    return replace(
        motion, lead_s=motion.start_s - float(t[before[-1] + 1]) if before.size else motion.lead_s,
        tail_s=float(t[after[0] - 1]) - motion.end_s if after.size else motion.tail_s,
    )


def _rest_s(t: FloatArray, x: FloatArray, stroke_m: float, window_s: float) -> float:
    """Time (s) during which the rod is at rest."""
    edges = np.searchsorted(t, np.arange(t[0], t[-1], window_s))
    edges = np.unique(edges[edges < t.size])
    span = np.maximum.reduceat(x, edges) - np.minimum.reduceat(x, edges)
    lasting = np.diff(np.append(t[edges], t[-1]))
    # A window about a reversal moves little: only windows whose neighbours are at rest too count.
    still = span < stroke_m
    beside = still & (np.append(still[1:], True) | np.insert(still[:-1], 0, True))
    return float(np.sum(lasting[beside]))

"""Deviation of the measured current from its set-point: worst stretch of a loop, end of a step, levels of a program."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rig.signals.arrays import FloatArray

QUARTERS = 4
SHORT_S, FEWEST_SHORT = 0.15, 5
"""Half of such a stretch is the shortest deviation that counts: shorter ones are the coil's answer to the motion."""
SETTLING = 0.3
"""Share of a hold from which its current is looked at: commands take some time to take effect."""
FEWEST_SETTLING = 3
"""Samples of a hold that two numbers are fitted to."""
LAGS_A_HOLD, LAGS_TRIED = (1.5, 200.0), 50
"""Holds of so many time constants of the coil; shorter ones do not determine the level."""
SETTLED = 1e-6
"""Of the level: a remainder of the lag that is smaller is none."""
MOST_HOLDS = 200
"""A program with more holds is checked by its mean."""
SHORTEST_HOLD = 0.25
"""Of the wanted one: a rig that outruns its host is given its steps unevenly."""


def loop_error_A(time_s: FloatArray, current_A: FloatArray, target_A: float, starts_s: FloatArray) -> float | None:
    """The largest median deviation over `SHORT_S`, one cycle, or one quarter of phase of all cycles (A).

    The median keeps the noise of the measurement out; a short stretch shows a current that was off for a part of a
    cycle, a cycle a smaller deviation, a quarter one that recurs in every cycle.

    Args:
        time_s: (n,) s, increasing.
        current_A: measured current (n,), A; NaN where unknown.
        target_A: the loop's current, A.
        starts_s: beginnings of the kept cycles and the end of the last (k + 1,), s.

    Returns:
        None where no current was measured.
    """
    error_A = np.abs(current_A - target_A)
    bounds = np.searchsorted(time_s, starts_s)
    phase = QUARTERS * (time_s - starts_s[0]) / (starts_s[1] - starts_s[0])
    quarter = np.floor(phase).astype(np.int64) % QUARTERS
    inside = slice(bounds[0], bounds[-1])
    stretches = [error_A[first:last] for first, last in pairwise(bounds)]
    stretches += [error_A[inside][quarter[inside] == number] for number in range(QUARTERS)]
    begins_s = np.arange(starts_s[0], starts_s[-1] - SHORT_S, 0.5 * SHORT_S)
    first, last = np.searchsorted(time_s, begins_s), np.searchsorted(time_s, begins_s + SHORT_S)
    short = [current_A[begin:end] for begin, end in zip(first, last, strict=True) if end - begin >= FEWEST_SHORT]
    # Of few samples the deviation of the median is the less noisy estimate.
    off_A = [abs(median_A - target_A) for median_A in _medians(short)]
    return max([*_medians(stretches), *off_A], default=None)


def law_error_A(
    time_s: FloatArray, current_A: FloatArray, commanded_s: FloatArray, commanded_A: FloatArray
) -> float | None:
    """By how much the mean of the measured current missed that of the commands (A).

    A current that follows late has the same mean: what is late at a rise is late at a fall.

    Args:
        time_s: (n,) s, increasing.
        current_A: measured current (n,), A; NaN where unknown.
        commanded_s: when commands were sent (m,), s, increasing.
        commanded_A: what they asked for (m,), A.

    Returns:
        None where no current was measured, or none was commanded.
    """
    if not len(commanded_s):
        return None
    held = np.clip(np.searchsorted(commanded_s, time_s, side="right") - 1, 0, None)
    known = np.isfinite(current_A) & (time_s >= commanded_s[0])
    return abs(float(np.mean(current_A[known] - commanded_A[held][known]))) if known.any() else None


def steps_error_A(
    time_s: FloatArray, current_A: FloatArray, levels_A: Sequence[float], hold_s: float,
) -> float | None:
    """The largest deviation of a hold's settled current from its own level (A).

    A hold that ended before the current had settled is judged by the level it was on its way to. Where the holds lie is
    told by the current itself: commands are dated by the host, which a fast rig outruns.

    Args:
        time_s: (n,) s, increasing.
        current_A: measured current (n,), A; NaN where unknown.
        levels_A: currents of the steps in turn, A.
        hold_s: how long each was to be held, s.

    Returns:
        None where a hold's current was not measured, or the record is too short for them.
    """
    known = np.isfinite(current_A)
    time_s, current_A = time_s[known], current_A[known]
    bounds = _holds(time_s, current_A, levels_A, SHORTEST_HOLD * hold_s)
    if bounds is None:
        return None
    settled_A = _settled_A(time_s, current_A, bounds)
    if settled_A is None:
        return None
    return max(abs(settled - level) for settled, level in zip(settled_A, levels_A, strict=True))


def program_error_A(
    time_s: FloatArray, current_A: FloatArray, levels_A: Sequence[float], levels_s: Sequence[float]
) -> float | None:
    """The largest deviation (A) of a level of a current program, over all its holds, from the current measured in them.

    Each level is checked by the median over the longer half of its holds: the settled current of a short hold is
    extrapolated, and its noise with it.

    Args:
        time_s: (n,) s, increasing.
        current_A: measured current (n,), A; NaN where unknown.
        levels_A: currents in turn (k,), A.
        levels_s: when each was to begin (k,), s since the start of the motion.

    Returns:
        None where a hold's current was not measured, or there are too many holds.
    """
    if not 1 <= len(levels_A) <= MOST_HOLDS:
        return None
    known = np.isfinite(current_A)
    time_s, current_A = time_s[known], current_A[known]
    shortest_s = float(np.min(np.diff(levels_s), initial=np.inf))
    bounds = _holds(time_s, current_A, levels_A, SHORTEST_HOLD * min(shortest_s, 1.0))
    settled_A = None if bounds is None else _settled_A(time_s, current_A, bounds)
    if bounds is None or settled_A is None:
        return None
    lasted_s = np.diff(np.append(time_s, time_s[-1])[np.asarray(bounds)])
    levels, settled, worst_A = np.asarray(levels_A), np.asarray(settled_A), 0.0
    for level_A in np.unique(levels):
        at_level = levels == level_A
        long_enough = at_level & (lasted_s >= np.median(lasted_s[at_level]))
        worst_A = max(worst_A, abs(float(np.median(settled[long_enough])) - float(level_A)))
    return worst_A


def _settled_A(time_s: FloatArray, current_A: FloatArray, bounds: Sequence[int]) -> list[float] | None:
    """Where the current is at the end of each hold, or would settle had it been held on; None: not measured.

    A coil follows all steps with one lag: I = L + B exp(-eta t) in each hold, with eta common to all of them. The
    division into holds lies where the current is half-way, ln 2 / eta after a step; a hold's level is fitted up to the
    step itself, since what follows is already on its way to the next level.
    """
    ends_s = np.append(time_s, time_s[-1])[np.asarray(bounds)]
    best: tuple[float, list[float]] | None = None
    for eta_1_s in np.geomspace(*LAGS_A_HOLD, LAGS_TRIED) / float(np.median(np.diff(ends_s))):
        steps_s = ends_s - np.log(2.0) / eta_1_s
        steps_s[[0, -1]] = ends_s[[0, -1]]
        levels_A, spent = [], 0.0
        for begin_s, end_s in pairwise(steps_s):
            first, last = np.searchsorted(time_s, (begin_s + SETTLING * (end_s - begin_s), end_s))
            if last - first < FEWEST_SETTLING:
                break
            columns = np.column_stack((np.ones(last - first), np.exp(-eta_1_s * (time_s[first:last] - begin_s))))
            fitted, *_ = np.linalg.lstsq(columns, current_A[first:last], rcond=SETTLED)
            spent += float(np.mean((current_A[first:last] - columns @ fitted) ** 2))
            levels_A.append(float(fitted[0]))
        if len(levels_A) == len(bounds) - 1 and (best is None or spent < best[0]):
            best = spent, levels_A
    return None if best is None else best[1]


def _holds(
    time_s: FloatArray, current_A: FloatArray, levels_A: Sequence[float], shortest_s: float,
) -> list[int] | None:
    """Rows (k + 1,) that divide the record into the holds by which the levels fit it best; None: too short a record.

    Dynamic programming over the least sum of deviations, each hold at least `shortest_s` long.
    """
    before = np.searchsorted(time_s, time_s - shortest_s, side="right")
    best = np.where(np.arange(len(time_s) + 1) == 0, 0.0, np.inf)
    chosen = []
    for level_A in levels_A:
        spent = np.concatenate(([0.0], np.cumsum(np.abs(current_A - level_A))))
        least = np.minimum.accumulate(best - spent)
        begins = np.maximum.accumulate(np.where(best - spent <= least, np.arange(len(best)), 0))
        latest = np.concatenate(([0], before - 1))
        allowed = latest >= 0
        chosen.append(np.where(allowed, begins[latest], 0))
        best = np.where(allowed, least[latest] + spent, np.inf)
        best[0] = np.inf
    if not levels_A or not np.isfinite(best[-1]):
        return None
    bounds = [len(time_s)]
    for begin in reversed(chosen):
        bounds.insert(0, int(begin[bounds[0]]))
    return bounds


def _medians(stretches: Iterable[NDArray[np.float64]]) -> Iterator[float]:
    for stretch in stretches:
        known = stretch[np.isfinite(stretch)]
        if len(known):
            yield float(np.median(known))

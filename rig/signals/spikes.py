"""Single samples that are no part of a smooth signal: interference, a lost bit, a line that was printed wrongly.

A spike of height s at sample i changes the differences e_i = x_i - (x_(i-1) + x_(i+1)) / 2 about it to -s/2, s, -s/2.
It is told from what the signal does itself (a corner, a step, a sharp knee in every cycle) by that pattern, and by
being far larger than the largest difference anywhere else in the record.
"""

from __future__ import annotations

import numpy as np

from rig.signals.arrays import FloatArray

MOST = 10
"""So many are looked for; more are a property of the signal."""
PATTERN = (0.3, 0.7)
"""Ends of -e_(i-1) / e_i and of -e_(i+1) / e_i about a half."""
LARGER = 3.0
"""Times the largest difference elsewhere."""
SHARE = 0.02
"""Of the span of the other samples: a smaller spike changes no result."""


def spikes(values: FloatArray) -> list[int]:
    """Indices of the single samples (at most `MOST`) that leave the signal (n,) and return to it; NaN is skipped."""
    known = np.flatnonzero(np.isfinite(values))
    x = values[known]
    if x.size < 16:
        return []
    e = np.zeros(x.size)
    e[1:-1] = x[1:-1] - 0.5 * (x[:-2] + x[2:])
    size = np.abs(e)
    taken = np.zeros(x.size, bool)
    singles: list[int] = []
    best: list[int] = []
    for _ in range(MOST):
        at = int(np.argmax(np.where(taken, 0.0, size)))
        if size[at] == 0.0 or not _is_single(e, at):
            break
        taken[max(0, at - 1) : at + 2] = True
        singles.append(at)
        if size[at] > LARGER * float(np.max(size[~taken], initial=0.0)):
            best = list(singles)
    if not best:
        return []
    rest = np.delete(x, best)
    return sorted(int(known[at]) for at in best) if min(size[best]) > SHARE * float(np.ptp(rest)) else []


def median_of_three(values: FloatArray) -> FloatArray:
    """Running median of three samples (n,): a single sample is no peak; the first and the last stay as they are."""
    if values.size < 3:
        return values
    middle = values.copy()
    before, at, after = values[:-2], values[1:-1], values[2:]
    middle[1:-1] = np.maximum(np.minimum(before, at), np.minimum(np.maximum(before, at), after))
    return middle


def _is_single(e: FloatArray, at: int) -> bool:
    """Whether the differences about a sample are those of a spike of one sample."""
    if not 1 <= at < e.size - 1:
        return False
    return all(PATTERN[0] <= -float(beside) / float(e[at]) <= PATTERN[1] for beside in (e[at - 1], e[at + 1]))

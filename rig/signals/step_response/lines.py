"""The lines through baseline and settled end of a record."""

from __future__ import annotations

import numpy as np

from rig.signals.arrays import BoolArray, FloatArray
from rig.signals.step_response.records import Record, drift_columns


class Lines:
    """The lines through baseline and settled end of a record, as weights on its samples.

    Args (construction):
        record: the samples.
        settled_s: when the settled end begins.
        reached: (n,) share of the step that has been reached by then, nearly 1.
        drifts: whether the lines are inclined.

    Attributes:
        baseline, settled: (n,) which samples are in each.
        before, change: (n,) the baseline at each sample, and the distance of the end from it.
        share: (n,) share of the step at each sample.
    """

    def __init__(self, record: Record, settled_s: float, reached: FloatArray, *, drifts: bool) -> None:
        self._columns = drift_columns(record.time_s, drifts=drifts)
        self.baseline = record.time_s < 0.0
        self.settled = record.time_s >= settled_s
        there = reached[self.settled]
        self._before, self._end = self._fit(self.baseline), self._fit(self.settled)
        self.before = self._columns @ (self._before @ record.value[self.baseline])
        settled = (record.value[self.settled] - (1.0 - there) * self.before[self.settled]) / there
        self.change = self._columns @ (self._end @ settled) - self.before
        self.share = (record.value - self.before) / self.change

    def _fit(self, chosen: BoolArray) -> FloatArray:
        return np.asarray(np.linalg.pinv(self._columns[chosen]))

    def spread(self, weights: FloatArray) -> FloatArray:
        """Weights on the samples (n,) of a weighted sum of shares, baseline and end included.

        dr = dy / (E - A) - (1 - r) dA / (E - A) - r dE / (E - A).
        """
        scaled = weights / self.change
        total = scaled.copy()
        total[self.baseline] -= (scaled * (1.0 - self.share)) @ self._columns @ self._before
        total[self.settled] -= (scaled * self.share) @ self._columns @ self._end
        return np.asarray(total)

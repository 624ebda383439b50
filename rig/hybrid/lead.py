"""Set-points ahead of the target, so that the rod reaches the target in time after the actuator's delay; pure numbers.

The same compensators as in the benchmark (`rig.hybrid.compensators`, sources there) for a real rig, where the delay is
measured and the computed part gives the target's speed and acceleration:

none        u = x
polynomial  u = 4 x(t) - 6 x(t - d) + 4 x(t - 2 d) - x(t - 3 d)        Horiuchi et al. 1999
inverse     u = x + d (x - x before) / h                                first order, by the last step
ats         u = a0 x + a1 x' + a2 x'', a by least squares over the last second    Chae et al. 2013
model       u = x(t + d), computed ahead with the known road and the assumed damper's change of force
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from rig.hybrid.substructure import Sent, Target

COMPENSATORS = ("model", "ats", "inverse", "polynomial", "none")
WINDOW_s = 1.0
LEAST_RMS_m = 1e-4
"""ATS keeps its coefficients while the rod moves less, RMS over its window."""
BOUNDS = ((0.9, 1.1), (0.0, 0.06), (0.0, 0.0032))
"""Of its coefficients, as published."""
Ahead = Callable[[float], Target]
"""Where the specimen will be after a time (s), by the computed part."""


class Lead:
    """One compensator during one test.

    Args (construction):
        name: one of `COMPENSATORS`.
        delay_s: of the rod behind its set-points, as measured.
        step_s: between two set-points.
    """

    def __init__(self, name: str, delay_s: float, step_s: float) -> None:
        self.coefficients = [1.0, delay_s, 0.5 * delay_s**2]
        self._name = name
        self._delay_s = delay_s
        self._step_s = step_s
        self._past: deque[tuple[float, Target]] = deque(maxlen=int(3.0 * delay_s / step_s) + 4)
        self._rows: deque[tuple[float, float, float, float]] = deque()
        self._sums = [[0.0] * 4 for _ in range(4)]
        self._seen: deque[tuple[float, float]] = deque(maxlen=3)
        self._most_rows = max(20, round(WINDOW_s / step_s))

    def command(self, t_s: float, target: Target, measured_m: float, ahead: Ahead) -> Sent:
        """What is sent now.

        Args:
            t_s: time of the test, ascending.
            target: where the specimen should be now.
            measured_m: where it is.
            ahead: the computed part's forecast.
        """
        self._past.append((t_s, target))
        out = self._setpoint(t_s, target, ahead)
        if self._name == "ats":
            self._learn(out.position_m, measured_m)
        return out

    def _setpoint(self, t_s: float, target: Target, ahead: Ahead) -> Sent:
        x, v, a = target
        if self._name == "model":
            # The device goes on at the set-point's speed until the next one: the mean speed of that time.
            later = ahead(self._delay_s)
            return Sent(later.extension_m, later.speed_m_s + 0.5 * self._step_s * later.acceleration_m_s2)
        if self._name == "ats":
            first, second, third = self.coefficients
            return Sent(first * x + second * v + third * a, first * v + second * a)
        if self._name == "polynomial":
            one, two, three = (self._at(t_s - times * self._delay_s) for times in (1.0, 2.0, 3.0))
            return Sent(
                4.0 * x - 6.0 * one.extension_m + 4.0 * two.extension_m - three.extension_m,
                4.0 * v - 6.0 * one.speed_m_s + 4.0 * two.speed_m_s - three.speed_m_s,
            )
        if self._name == "inverse":
            before = self._at(t_s - self._step_s)
            lead = self._delay_s / self._step_s
            return Sent(
                x + lead * (x - before.extension_m), v + lead * (v - before.speed_m_s),
            )
        return Sent(x, v)

    def _at(self, t_s: float) -> Target:
        """The target of an earlier time, from the nearest one kept."""
        then_s, target = min(self._past, key=lambda kept: abs(kept[0] - t_s))
        return target.after(t_s - then_s)

    def _learn(self, commanded_m: float, measured_m: float) -> None:
        """One more row of the last second: position, speed and acceleration as measured, and what was commanded."""
        self._seen.append((measured_m, commanded_m))
        if len(self._seen) < 3:
            return
        (before_m, _), (now_m, sent_m), (after_m, _) = self._seen
        h = self._step_s
        row = (now_m, (after_m - before_m) / (2.0 * h), (after_m - 2.0 * now_m + before_m) / h**2, sent_m)
        self._rows.append(row)
        old = self._rows.popleft() if len(self._rows) > self._most_rows else (0.0, 0.0, 0.0, 0.0)
        for i in range(4):
            for j in range(4):
                self._sums[i][j] += row[i] * row[j] - old[i] * old[j]
        if len(self._rows) == self._most_rows and self._sums[0][0] > LEAST_RMS_m**2 * self._most_rows:
            numbers = _least_squares(self._sums)
            self.coefficients = [
                min(max(value, low), high) for value, (low, high) in zip(numbers, BOUNDS, strict=True)
            ]


def _least_squares(sums: list[list[float]]) -> list[float]:
    """Coefficients (3,) from the sums of products (4, 4), scaled and kept from ill conditions; Gauss elimination."""
    scale = [max(sums[i][i], 1e-30) ** 0.5 for i in range(3)]
    rows = [
        [sums[i][j] / (scale[i] * scale[j]) + (1e-6 if i == j else 0.0) for j in range(3)] + [sums[i][3] / scale[i]]
        for i in range(3)
    ]
    for i in range(3):
        for j in range(i + 1, 3):
            share = rows[j][i] / rows[i][i]
            rows[j] = [below - share * above for below, above in zip(rows[j], rows[i], strict=True)]
    out = [0.0, 0.0, 0.0]
    for i in (2, 1, 0):
        out[i] = (rows[i][3] - sum(rows[i][j] * out[j] for j in range(i + 1, 3))) / rows[i][i]
    return [value / unit for value, unit in zip(out, scale, strict=True)]

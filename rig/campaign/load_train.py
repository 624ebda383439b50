"""Watches the load train: a crack or a loose joint changes a cycle against the ones before it.

Cycles are cut by the controller's cycle pulse, which every sensor latches in its own clock; each full cycle is compared
with the median of up to three before it. Slow changes (a warming damper) pass, a sudden one does not. Cycles of another
amplitude or duration (ramps), with lost samples, or beside a change of the current are not compared.
"""

from __future__ import annotations

from collections import deque
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel

REFERENCES = 3
FEWEST_SAMPLES = 24
"""A cycle with fewer samples says too little."""
SAME_SHAPE = 0.02
WORK_SHARE = 0.06
PEAK_SHARE = 0.12
QUIET_SHARE = 0.04
QUIET_SAMPLES = 3
"""So many samples more or less fall near zero from cycle to cycle, by where in the cycle they are taken."""
QUIET_OF_PEAK = 0.05
SERVO_SHARE = 0.5
SERVO_FLOOR_M = 1e-4
CURRENT_APART_A = 0.1
CYCLES_AFTER_CURRENT = 2
_EDGES = {Channel.FORCE_EDGE: Channel.FORCE, Channel.DISPLACEMENT_EDGE: Channel.DISPLACEMENT}
_EDGE_MODULUS = 256
_MOST_KEPT = 200_000


@dataclass(frozen=True)
class Cycle:
    """What is compared of one cycle.

    Attributes:
        stroke_m: peak to peak displacement.
        duration_us: on the displacement sensor's clock.
        peak_N: half of the force's peak to peak.
        work_J: dissipated, the area of the force-displacement loop.
        quiet: share of the cycle in which the force is below `QUIET_OF_PEAK` of the peak.
        servo_error_m: RMS of the controller's servo error; NaN with too few statuses.
        sample: share of the cycle that one force sample stands for.
    """

    stroke_m: float
    duration_us: float
    peak_N: float
    work_J: float
    quiet: float
    servo_error_m: float
    sample: float = 0.0


class _Track:
    """Samples of one channel, and the cycle edges on the same clock."""

    def __init__(self) -> None:
        self.times = np.empty(0)
        self.values = np.empty(0)
        self.edges: dict[int, float] = {}

    def take(self, records: NDArray[Any]) -> None:
        good = np.isfinite(records["value"]) & (records["flags"] == 0)
        self.times = np.concatenate((self.times, records["device_us"][good].astype(float)))[-_MOST_KEPT:]
        self.values = np.concatenate((self.values, records["value"][good]))[-_MOST_KEPT:]

    def forget_before(self, first: int) -> None:
        """Drop what lies before the edge `first`."""
        begin = self.edges.get(first % _EDGE_MODULUS)
        if begin is not None:
            kept = self.times >= begin
            self.times, self.values = self.times[kept], self.values[kept]

    def mark(self, count: int, at_us: float) -> None:
        self.edges[count % _EDGE_MODULUS] = at_us
        while len(self.edges) > REFERENCES + 1:
            del self.edges[next(iter(self.edges))]

    def between(self, first: int) -> tuple[NDArray[np.float64], NDArray[np.float64]] | None:
        """Times since the edge `first` (us) and values up to the next edge; None until that cycle is complete."""
        begin, end = self.edges.get(first % _EDGE_MODULUS), self.edges.get((first + 1) % _EDGE_MODULUS)
        if begin is None or end is None or end <= begin or len(self.times) == 0 or self.times[-1] < end:
            return None
        inside = (self.times >= begin) & (self.times < end)
        return self.times[inside] - begin, self.values[inside]


class LoadTrainWatch:
    """Follows the ring's records; says once when a cycle differs."""

    def __init__(self) -> None:
        self._tracks = {channel: _Track() for channel in (Channel.FORCE, Channel.DISPLACEMENT, Channel.SERVO_ERROR)}
        self._before: deque[Cycle] = deque(maxlen=REFERENCES)
        self._next: int | None = None
        self._skip = 0
        self._current_A = np.nan

    def watch(self, records: NDArray[Any]) -> str | None:
        """Take new records of the ring.

        Args:
            records: (n,) of the ring's record type, oldest first.

        Returns:
            What changed, when a cycle differs from those before it.
        """
        self._sort(records)
        while self._next is not None:
            parts = [self._tracks[channel].between(self._next) for channel in _EDGES.values()]
            if any(part is None for part in parts):
                if not self._overtaken():
                    return None
                self._before.clear()
                self._next += 1
                continue
            cycle = self._measure(*[part for part in parts if part is not None])
            self._next += 1
            for track in self._tracks.values():
                track.forget_before(self._next)
            found = None if cycle is None else self._compare(cycle)
            if found is not None:
                return found
        return None

    def _sort(self, records: NDArray[Any]) -> None:
        channels = records["channel"]
        for channel, track in self._tracks.items():
            chosen = records[channels == channel]
            track.take(chosen[chosen["device_us"] >= 0])
        for edge, channel in _EDGES.items():
            for record in records[channels == edge]:
                self._tracks[channel].mark(int(record["sequence"]), float(record["device_us"]))
                if self._next is None:
                    self._next = int(record["sequence"]) % _EDGE_MODULUS
        for record in records[channels == Channel.PULSE]:
            self._tracks[Channel.SERVO_ERROR].mark(int(record["value"]), float(record["device_us"]))
        commanded = records["value"][channels == Channel.COMMANDED_CURRENT]
        if len(commanded) and (np.ptp(commanded) > 0 or commanded[-1] != self._current_A):
            self._current_A = float(commanded[-1])
            self._begin_anew()
        measured = records["value"][channels == Channel.COIL_CURRENT]
        if np.any(np.abs(measured - self._current_A) > CURRENT_APART_A):
            # Another current is another damper; that row has a detector of its own.
            self._begin_anew()

    def _begin_anew(self) -> None:
        self._before.clear()
        self._skip = CYCLES_AFTER_CURRENT

    def _overtaken(self) -> bool:
        """The cycle waited for will not be completed: every channel is already at a later one."""
        newest = [next(reversed(self._tracks[channel].edges), None) for channel in _EDGES.values()]
        ahead = [0 if edge is None else (edge - (self._next or 0)) % _EDGE_MODULUS for edge in newest]
        return all(1 < each < _EDGE_MODULUS // 2 for each in ahead)

    def _measure(
        self, force: tuple[NDArray[np.float64], NDArray[np.float64]],
        displacement: tuple[NDArray[np.float64], NDArray[np.float64]],
    ) -> Cycle | None:
        (force_us, force_N), (displacement_us, displacement_m) = force, displacement
        if min(len(force_N), len(displacement_m)) < FEWEST_SAMPLES:
            return None
        at_force_m = np.interp(force_us, displacement_us, displacement_m)
        closed_N, closed_m = np.append(force_N, force_N[0]), np.append(at_force_m, at_force_m[0])
        peak_N = 0.5 * float(np.ptp(force_N))
        servo = self._tracks[Channel.SERVO_ERROR].between(self._next or 0)
        few = servo is None or len(servo[1]) < FEWEST_SAMPLES
        return Cycle(
            stroke_m=float(np.ptp(displacement_m)),
            duration_us=float(displacement_us[-1]),
            peak_N=peak_N,
            work_J=abs(float(np.trapezoid(closed_N, closed_m))),
            quiet=float(np.mean(np.abs(force_N) < QUIET_OF_PEAK * peak_N)),
            servo_error_m=np.nan if few or servo is None else float(np.sqrt(np.mean(servo[1] ** 2))),
            sample=1.0 / len(force_N),
        )

    def _compare(self, cycle: Cycle) -> str | None:
        if self._skip > 0:
            self._skip -= 1
            return None
        if self._before:
            usual = Cycle(*np.median([astuple(each) for each in self._before], axis=0).tolist())
            alike = abs(cycle.stroke_m - usual.stroke_m) <= SAME_SHAPE * usual.stroke_m
            alike = alike and abs(cycle.duration_us - usual.duration_us) <= SAME_SHAPE * usual.duration_us
            if not alike:
                self._before.clear()
            elif found := difference(cycle, usual):
                return found
        self._before.append(cycle)
        return None


def difference(cycle: Cycle, usual: Cycle) -> str | None:
    """What of a cycle differs from the usual one by more than cycles do; None when nothing does."""
    if abs(cycle.work_J - usual.work_J) > WORK_SHARE * usual.work_J:
        return f"work of a cycle went from {usual.work_J:.4g} J to {cycle.work_J:.4g} J"
    if abs(cycle.peak_N - usual.peak_N) > PEAK_SHARE * usual.peak_N:
        return f"peak force of a cycle went from {usual.peak_N:.4g} N to {cycle.peak_N:.4g} N"
    if cycle.quiet - usual.quiet > QUIET_SHARE + QUIET_SAMPLES * cycle.sample:
        return f"force near zero went from {100 * usual.quiet:.2g} % to {100 * cycle.quiet:.2g} % of a cycle"
    allowed_m = SERVO_FLOOR_M + SERVO_SHARE * usual.servo_error_m
    if abs(cycle.servo_error_m - usual.servo_error_m) > allowed_m:
        was_mm, is_mm = 1e3 * usual.servo_error_m, 1e3 * cycle.servo_error_m
        return f"servo error of a cycle went from {was_mm:.3g} mm to {is_mm:.3g} mm"
    return None

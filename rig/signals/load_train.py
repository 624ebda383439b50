"""What changes in the load train, cycle against cycle: a crack or a loose joint, told from two signals of one motion.

Each full cycle is compared with the median of up to three before it: slow changes (a warming damper) pass, a sudden one
does not. Cycles of another amplitude or duration (ramps), with a sensor that stands still, or beside a change of the
current are not compared. What a cycle may differ by is a share of it and several times what the sensors' own noise
makes of it.

Beyond a motion's beginning, where there is nothing to compare with, two things are known from the motions before:
whether the force rested at zero after its changes of sign (free play, whatever the current), and the least force that a
damper shows which showed more of it at no higher current, on no longer stroke and at no higher speed.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import astuple, dataclass
from typing import NamedTuple

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.loop_shape import noise_of, resting_travel_m

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
NOISES = 6.0
"""So many standard deviations of what noise makes of a cycle are no change."""
SETTLING_NOISES = 3.0
"""The same of the first two cycles: a first cycle that is given up without need costs no more than this cycle."""
STANDING_SHARE = 0.02
STANDING_SAMPLES = 6
"""Of a cycle, and at least so many samples, for which one value repeats where the others do not: a sensor's fault."""
REPEATED_SHARE = 0.3
"""Where so many neighbours are equal the resolution is coarse, and repeated values say nothing."""
PHASES = 400
PLAY_CYCLES = 2
NEW_PLAY_M = 0.2e-3
MORE_PLAY = 3.0
"""Travel at rest is measured to a factor of two: a loose joint is looser when it rests over so many times more."""
KEPT_FORCE = 0.5
"""Heat and remanence change a damper's force by less."""
CURRENT_APART_A = 0.1
CYCLES_AFTER_CURRENT = 1
EDGE_MODULUS = 256
_MOST_KEPT = 200_000
_MOST_ASIDE_BYTES = 1 << 16
_MOST_KNOWN = 500


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
        noise_N: standard deviation of the force's noise.
        noise_m: standard deviation of the displacement's noise.
        work_noise_J: standard deviation that both make of the work.
        work_steps_J: what the work may be off because the loop is known at its samples only.
        spread_m: standard deviation of the displacement.
    """

    stroke_m: float
    duration_us: float
    peak_N: float
    work_J: float
    quiet: float
    servo_error_m: float
    sample: float = 0.0
    noise_N: float = 0.0
    noise_m: float = 0.0
    work_noise_J: float = 0.0
    work_steps_J: float = 0.0
    spread_m: float = 0.0

    @property
    def mean_N(self) -> float:
        """The constant friction that would dissipate as much."""
        return self.work_J / (2.0 * self.stroke_m) if self.stroke_m > 0.0 else 0.0

    @property
    def speed(self) -> float:
        """Strokes a microsecond times their length: of one waveform in proportion to its peak speed."""
        return self.stroke_m / self.duration_us


@dataclass(frozen=True)
class Known:
    """What the damper showed in an earlier point: current, motion and the friction that would dissipate as much."""

    current_A: float
    stroke_m: float
    speed: float
    mean_N: float


class Samples(NamedTuple):
    """One channel in one cycle: phases (n,) from 0 to 1, values (n,), the cycle's duration on the channel's clock."""

    phases: FloatArray
    values: FloatArray
    duration_us: float

    def at(self, phases: FloatArray) -> FloatArray:
        """Values at these phases (n,); the cycle's end is its beginning."""
        return np.interp(phases, self.phases, self.values, period=1.0)


class CycleTrack:
    """Samples of one channel, and the cycle edges on the same clock.

    What arrives is put aside as it is; a cycle's end, or enough of it, makes samples of it.

    Args:
        samples_of: times (n,), us, and values (n,) of what was put aside.
    """

    def __init__(self, samples_of: Callable[[bytearray], tuple[FloatArray, FloatArray]]) -> None:
        self._samples_of = samples_of
        self.times = np.empty(0)
        self.values = np.empty(0)
        self.edges: dict[int, float] = {}
        self._aside = bytearray()

    def take(self, raw: bytes) -> None:
        """Put aside what has arrived."""
        self._aside += raw
        if len(self._aside) > _MOST_ASIDE_BYTES:
            self.gather()

    def gather(self) -> None:
        """Make samples of what was put aside."""
        if not self._aside:
            return
        times, values = self._samples_of(self._aside)
        self._aside = bytearray()
        self.times = np.concatenate((self.times, times))[-_MOST_KEPT:]
        self.values = np.concatenate((self.values, values))[-_MOST_KEPT:]

    def forget_before(self, first: int) -> None:
        """Drop what lies before the edge `first`."""
        begin = self.edges.get(first % EDGE_MODULUS)
        if begin is not None:
            self.gather()
            kept = self.times >= begin
            self.times, self.values = self.times[kept], self.values[kept]

    def mark(self, count: int, at_us: float) -> None:
        """The cycle edge `count` came at this time."""
        self.edges[count % EDGE_MODULUS] = at_us
        while len(self.edges) > REFERENCES + 1:
            del self.edges[next(iter(self.edges))]

    def between(self, first: int) -> Samples | None:
        """What came from the edge `first` up to the next one; None until that cycle is complete."""
        begin, end = self.edges.get(first % EDGE_MODULUS), self.edges.get((first + 1) % EDGE_MODULUS)
        if begin is None or end is None or end <= begin:
            return None
        self.gather()
        if len(self.times) == 0 or self.times[-1] < end:
            return None
        inside = (self.times >= begin) & (self.times < end)
        return Samples((self.times[inside] - begin) / (end - begin), self.values[inside], end - begin)


class LoadTrain:
    """The cycles of one session's motions, compared as they come."""

    def __init__(self) -> None:
        self._before: deque[Cycle] = deque(maxlen=REFERENCES)
        self._skip = 0
        self._current_A = self._before_A = np.nan
        self._phases: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=PLAY_CYCLES)
        self._usual_play_m: float | None = None
        self._known: deque[Known] = deque(maxlen=_MOST_KNOWN)

    def current_changed(self, current_A: float) -> None:
        """Another current (A), commanded or measured, is another damper: comparing begins anew."""
        self._current_A = current_A
        self.forget()
        self._skip = CYCLES_AFTER_CURRENT

    def forget(self) -> None:
        """Another motion or another current begins: what the last one showed is kept as known."""
        if len(self._before) == REFERENCES:
            cycle = _usual(self._before)
            self._known.append(Known(abs(self._before_A), cycle.stroke_m, cycle.speed, cycle.mean_N))
            # A campaign whose first motion was too weak to tell began with a joint that was taken for tight.
            self._usual_play_m = self._usual_play_m or 0.0
        self._before.clear()
        self._phases.clear()

    def change(self, force: Samples, displacement: Samples, servo_error: Samples | None) -> str | None:
        """What has changed when this cycle differs from those before it (N, m, m); None otherwise."""
        cycle = measured_cycle(force, displacement, servo_error)
        return None if cycle is None else self._compare(cycle) or self._rests(cycle, force, displacement)

    def _compare(self, cycle: Cycle) -> str | None:
        if self._skip > 0:
            self._skip -= 1
            return None
        if self._before:
            usual = _usual(self._before)
            if not _similar(cycle, usual) or (len(self._before) == 1 and _settles(cycle, usual)):
                self.forget()
            elif change := difference(cycle, usual) or self._weaker(usual):
                return change
        self._before.append(cycle)
        self._before_A = self._current_A
        return None

    def _weaker(self, usual: Cycle) -> str | None:
        """Whether the motion that goes on now shows far less force than a weaker one did before."""
        if len(self._before) < REFERENCES:
            return None
        slack = 1.0 + SAME_SHAPE
        before = [
            known for known in self._known
            if known.current_A <= abs(self._current_A) + CURRENT_APART_A
            and known.stroke_m <= slack * usual.stroke_m and known.speed <= slack * usual.speed
        ]
        most = max(before, key=lambda known: known.mean_N, default=None)
        noise_N = NOISES * usual.work_noise_J / (2.0 * usual.stroke_m)
        if most is None or usual.mean_N + noise_N >= KEPT_FORCE * most.mean_N:
            return None
        return (
            f"the mean force per cycle is {usual.mean_N:.4g} N, but at the same or lower current and speed it "
            f"was {most.mean_N:.4g} N"
        )

    def _rests(self, cycle: Cycle, force: Samples, displacement: Samples) -> str | None:
        """Whether the force has begun to rest at zero after its changes of sign, in two cycles of one motion."""
        if not self._before:
            return None
        grid = np.arange(PHASES) / PHASES
        self._phases.append((force.at(grid), displacement.at(grid)))
        if len(self._phases) < PLAY_CYCLES:
            return None
        forces_N, moves_m = (np.array(rows) for rows in zip(*self._phases, strict=True))
        play_m = resting_travel_m(forces_N, moves_m, cycle.noise_N)
        if play_m is None:
            return None
        if self._usual_play_m is None:
            # A rest that noise hides today may show tomorrow: that is no change of the joint.
            self._usual_play_m = resting_travel_m(forces_N, moves_m, cycle.noise_N, at_most=True) or 0.0
        if play_m <= MORE_PLAY * self._usual_play_m + NEW_PLAY_M:
            return None
        was_mm, is_mm = 1e3 * self._usual_play_m, 1e3 * play_m
        return (
            f"the force now remains at zero over {is_mm:.2g} mm after each change of sign; previously it was "
            f"{was_mm:.2g} mm"
        )


def measured_cycle(force: Samples, displacement: Samples, servo: Samples | None) -> Cycle | None:
    """A cycle's force (N), displacement (m) and servo error (m) in numbers; None where they are too few or stand."""
    force_N, displacement_m = force.values, displacement.values
    if min(len(force_N), len(displacement_m)) < FEWEST_SAMPLES or _is_constant(force_N) or _is_constant(displacement_m):
        return None
    at_force_m = displacement.at(force.phases)
    closed_N, closed_m = np.append(force_N, force_N[0]), np.append(at_force_m, at_force_m[0])
    noise_N, noise_m = _noise(force_N), _noise(displacement_m)
    by_force_J = noise_N * float(np.sqrt(np.sum((0.5 * (closed_m[2:] - closed_m[:-2])) ** 2)))
    by_move_J = noise_m * float(np.sqrt(np.sum((0.5 * (closed_N[2:] - closed_N[:-2])) ** 2)))
    peak_N = 0.5 * float(np.ptp(force_N))
    few = servo is None or len(servo.values) < FEWEST_SAMPLES
    return Cycle(
        stroke_m=float(np.ptp(displacement_m)),
        duration_us=displacement.duration_us,
        peak_N=peak_N,
        work_J=abs(float(np.trapezoid(closed_N, closed_m))),
        quiet=float(np.mean(np.abs(force_N) < QUIET_OF_PEAK * peak_N)),
        servo_error_m=np.nan if few or servo is None else float(np.sqrt(np.mean(servo.values**2))),
        sample=1.0 / len(force_N),
        noise_N=noise_N,
        noise_m=noise_m,
        work_noise_J=float(np.hypot(by_force_J, by_move_J)),
        work_steps_J=float(np.sqrt(np.sum((np.diff(closed_N) * np.diff(closed_m)) ** 2))),
        spread_m=float(np.std(displacement_m)),
    )


def _usual(before: deque[Cycle]) -> Cycle:
    return Cycle(*np.median([astuple(cycle) for cycle in before], axis=0).tolist())


def _similar(cycle: Cycle, usual: Cycle) -> bool:
    """Both are cycles of one motion."""
    apart_m = SAME_SHAPE * usual.stroke_m + NOISES * usual.noise_m
    same_stroke = abs(cycle.stroke_m - usual.stroke_m) <= apart_m
    return same_stroke and abs(cycle.duration_us - usual.duration_us) <= SAME_SHAPE * usual.duration_us


def _settles(cycle: Cycle, first: Cycle) -> bool:
    """The first cycle after the ramp, although of the same stroke, was not yet the motion: a servo takes some 50 ms.

    At 25 Hz and 0.2 mm it had 95 % of the fundamental, and its work was 15 % less.
    """
    apart_m = SAME_SHAPE * first.spread_m + SETTLING_NOISES * first.noise_m * math.sqrt(first.sample)
    return abs(cycle.spread_m - first.spread_m) > apart_m


def _noise(values: FloatArray) -> float:
    """Standard deviation of a sensor's noise in one cycle; at least what its resolution makes where values repeat."""
    steps = np.diff(np.unique(values))
    coarse = np.mean(np.diff(values) == 0.0) > REPEATED_SHARE
    return max(noise_of(values), 0.5 * float(np.min(steps)) if coarse and len(steps) else 0.0)


def _is_constant(values: FloatArray) -> bool:
    """One value repeats for a part of the cycle, of a sensor whose values do not."""
    equal = np.diff(values) == 0.0
    ends = np.flatnonzero(np.diff(np.concatenate(([False], equal, [False])).astype(np.int8)))
    runs = ends[1::2] - ends[::2]
    longest = int(np.max(runs, initial=0))
    others = (np.count_nonzero(equal) - longest) / max(1, len(equal) - longest)
    return longest > max(STANDING_SAMPLES, STANDING_SHARE * len(values)) and bool(others <= REPEATED_SHARE)


def difference(cycle: Cycle, usual: Cycle) -> str | None:
    """What of a cycle differs from the usual one by more than cycles and their noise do; None when nothing does."""
    work_J = WORK_SHARE * usual.work_J + NOISES * usual.work_noise_J + usual.work_steps_J
    if abs(cycle.work_J - usual.work_J) > work_J:
        return f"the work per cycle changed from {usual.work_J:.4g} J to {cycle.work_J:.4g} J"
    if abs(cycle.peak_N - usual.peak_N) > PEAK_SHARE * usual.peak_N + NOISES * usual.noise_N:
        return f"the peak force per cycle changed from {usual.peak_N:.4g} N to {cycle.peak_N:.4g} N"
    few = NOISES * float(np.sqrt(usual.quiet * (1.0 - usual.quiet) * cycle.sample)) if usual.noise_N > 0.0 else 0.0
    if cycle.quiet - usual.quiet > QUIET_SHARE + QUIET_SAMPLES * cycle.sample + few:
        return (
            f"the share of force near zero changed from {100 * usual.quiet:.2g} % to {100 * cycle.quiet:.2g} % of "
            "a cycle"
        )
    allowed_m = SERVO_FLOOR_M + SERVO_SHARE * usual.servo_error_m
    if abs(cycle.servo_error_m - usual.servo_error_m) > allowed_m:
        was_mm, is_mm = 1e3 * usual.servo_error_m, 1e3 * cycle.servo_error_m
        return f"the servo error per cycle changed from {was_mm:.3g} mm to {is_mm:.3g} mm"
    return None

"""A prescribed motion that does not repeat: a sweep, a road, a file's record, as samples that begin and end at rest.

A `Record` holds the shape for an amplitude of 1, the largest distance from the centre; a test point multiplies it. At
both ends it is faded by a raised cosine over `ramp_s`: what lies there is moved, but neither judged nor fitted.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from rig.signals.arrays import BoolArray, FloatArray
from rig.signals.force_target import ForceTarget
from rig.signals.free_motion import mean_rate_Hz

STEP_S = 1e-3
"""Between two samples of a record."""
LEAST_KEPT_S = 1.0
"""Between the ramps: less tells no fit anything."""
LONGEST_S = 600.0
POWER_BELOW = 0.95
"""Of the velocity's power, which lies below a record's highest frequency."""
LARGEST_GAP = 20.0
"""Between two rows, in median intervals: a curve through more would be invented."""
CLOSEST_S = 1e-9
FINEST_Hz = 100.0
"""What rows closer than `STEP_S` tell above this is taken off before they are thinned."""
FILTER_ORDER = 4
LEAST_MOTION = 0.01
"""Between the ramps, of the largest distance from the centre: what moves less there stands, or has moved in a ramp."""


class NoRecord(ValueError):
    """These samples are no motion; the message says why."""


@dataclass(frozen=True)
class RecordFacts:
    """What a recording keeps of a record: all but its samples.

    Attributes:
        name: for people: of the road or the file; `sweep`.
        duration_s: ramps included (s).
        ramp_s: over which each end is faded (s).
        highest_Hz: highest frequency of the motion, which set-points and sensors must carry.
        sha256: of the file it was read from; empty where there is none.
        of_force: a force is to be followed; the motion is the one with which the expected damper gives it.
    """

    name: str
    duration_s: float
    ramp_s: float
    highest_Hz: float
    sha256: str = ""
    of_force: bool = False


@dataclass(frozen=True)
class Record(RecordFacts):
    """A motion of unit amplitude about its centre.

    Attributes:
        amplitude_m: largest distance from the centre as it was requested (m).
        mark: SHA-256 (hex) of the samples.
        shape: (n,) every `STEP_S`, the first and the last 0.
        force: the force to follow; None: the motion itself is followed.
    """

    amplitude_m: float = field(kw_only=True)
    mark: str = field(kw_only=True)
    shape: FloatArray = field(kw_only=True, repr=False, compare=False)
    force: ForceTarget | None = field(default=None, kw_only=True)

    @cached_property
    def mean_rate_Hz(self) -> float:
        """How often a second it crosses its mean upwards; once in its duration where it never does."""
        time_s = STEP_S * np.arange(len(self.shape), dtype=np.float64)
        return max(mean_rate_Hz(time_s, self.shape), 1.0 / self.duration_s)

    @cached_property
    def _unit(self) -> tuple[FloatArray, FloatArray]:
        velocity = np.asarray(np.gradient(self.shape, STEP_S), np.float64)
        velocity[[0, -1]] = 0.0  # where it is faded out, the fade has no slope
        acceleration = np.diff(self.shape, 2, prepend=0.0, append=0.0) / STEP_S**2
        return velocity, np.asarray(acceleration, np.float64)

    @property
    def peak_velocity(self) -> float:
        """Largest speed of unit amplitude (1/s)."""
        return float(np.max(np.abs(self._unit[0])))

    @property
    def peak_acceleration(self) -> float:
        """Largest acceleration of unit amplitude (1/s^2)."""
        return float(np.max(np.abs(self._unit[1])))

    @property
    def fastest_s(self) -> tuple[float, float]:
        """When (s) speed and acceleration are largest."""
        velocity, acceleration = self._unit
        return STEP_S * int(np.argmax(np.abs(velocity))), STEP_S * int(np.argmax(np.abs(acceleration)))

    def motion(self, amplitude_m: float, every: int = 1) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position (m), velocity (m/s) and acceleration (m/s^2) about the centre, each (k,).

        Args:
            amplitude_m: amplitude (m).
            every: only every so many samples.
        """
        velocity, acceleration = self._unit
        return amplitude_m * self.shape[::every], amplitude_m * velocity[::every], amplitude_m * acceleration[::every]


@dataclass(frozen=True)
class SweepMotion:
    """A sine whose frequency and amplitude change from first to last.

    Attributes:
        duration_s: s.
        first_Hz, last_Hz: frequency at its beginning and end.
        first_m, last_m: amplitude there (m).
        logarithmic: both change by equal factors in equal times; else by equal amounts.
    """

    duration_s: float
    first_Hz: float
    last_Hz: float
    first_m: float
    last_m: float
    logarithmic: bool = False

    def at(self, time_s: FloatArray) -> FloatArray:
        """Position (m) about the centre at times (s) from its beginning."""
        share = time_s / self.duration_s
        if not self.logarithmic:
            change = self.last_Hz - self.first_Hz
            cycles = self.first_Hz * time_s + 0.5 * change * time_s * share
            return (self.first_m + (self.last_m - self.first_m) * share) * np.sin(math.tau * cycles)
        growth = math.log(self.last_Hz / self.first_Hz)
        cycles = self.first_Hz * self.duration_s / growth * np.expm1(growth * share)
        return self.first_m * (self.last_m / self.first_m) ** share * np.sin(math.tau * cycles)


def sweep_record(sweep: SweepMotion, ramp_s: float) -> Record:
    """A sweep as a record.

    Raises:
        NoRecord: it is shorter than its ramps and a second between them.
    """
    time_s = _times(sweep.duration_s)
    highest_Hz = max(sweep.first_Hz, sweep.last_Hz)
    return _faded("sweep", sweep.at(time_s), ramp_s, highest_Hz=highest_Hz)


def record_of(
    name: str, position_m: FloatArray, ramp_s: float, *, amplitude_m: float | None = None,
    highest_Hz: float | None = None, sha256: str = "",
) -> Record:
    """Samples as a record.

    Args:
        name: for people.
        position_m: (n,) about the centre, every `STEP_S`, m.
        ramp_s: over which each end is faded (s).
        amplitude_m: scaled so that this is the largest distance from the centre (m); None: as it is.
        highest_Hz: what is faster is taken off without phase (fourth-order Butterworth, there and back); None: nothing.
        sha256: of the file it was read from.

    Raises:
        NoRecord: too short, or no motion is left.
    """
    passed = position_m if highest_Hz is None else low_passed(position_m, highest_Hz)
    return _faded(name, passed, ramp_s, amplitude_m=amplitude_m, highest_Hz=highest_Hz, sha256=sha256)


def through_rows(time_s: FloatArray, position_m: FloatArray) -> FloatArray:
    """A cubic spline (not-a-knot) through rows, every `STEP_S` from the first row to the last, (n,) m.

    Args:
        time_s: (k,) s, increasing; at least four rows.
        position_m: (k,) m.

    Raises:
        NoRecord: it is too long, two rows are at one time, or a gap is so wide that the curve across it would be
            invented.
    """
    from scipy.interpolate import CubicSpline

    if time_s[-1] - time_s[0] > LONGEST_S + STEP_S:
        raise NoRecord(f"{time_s[-1] - time_s[0]:.4g} s long; allowed: at most {LONGEST_S:g} s")
    closest = int(np.argmin(np.diff(time_s)))
    if not time_s[closest + 1] - time_s[closest] >= CLOSEST_S:
        raise NoRecord(f"rows {closest + 1} and {closest + 2} are less than {CLOSEST_S:g} s apart")
    apart_s = np.diff(time_s)
    usual_s, widest = float(np.median(apart_s)), int(np.argmax(apart_s))
    if apart_s[widest] > LARGEST_GAP * usual_s:
        raise NoRecord(
            f"no rows between {time_s[widest]:.6g} s and {time_s[widest + 1]:.6g} s: this gap of "
            f"{apart_s[widest]:.3g} s exceeds {LARGEST_GAP:g} times the usual step of {usual_s:.3g} s"
        )
    spline = CubicSpline(time_s, position_m)
    fine_s = STEP_S / max(1, math.ceil(STEP_S / usual_s - 1e-6))
    fine_m = np.asarray(spline(time_s[0] + _times(float(time_s[-1] - time_s[0]), fine_s)), np.float64)
    every = round(STEP_S / fine_s)
    return fine_m if every == 1 else low_passed(fine_m, FINEST_Hz, fine_s)[::every]


def _times(duration_s: float, step_s: float = STEP_S) -> FloatArray:
    return step_s * np.arange(math.floor(duration_s / step_s + 1e-6) + 1, dtype=np.float64)


def _faded(
    name: str, position_m: FloatArray, ramp_s: float, *, amplitude_m: float | None = None,
    highest_Hz: float | None = None, sha256: str = "",
) -> Record:
    """Both ends faded, the rest as it is, brought to unit amplitude.

    Raises:
        NoRecord: too short, or no motion is left.
    """
    duration_s, needed_s = (len(position_m) - 1) * STEP_S, 2.0 * ramp_s + LEAST_KEPT_S
    if not needed_s - 1e-9 <= duration_s <= LONGEST_S + 1e-9:
        raise NoRecord(
            f"{duration_s:.4g} s long; allowed {needed_s:g} s (two ramps of {ramp_s:g} s and {LEAST_KEPT_S:g} s "
            f"between them) to {LONGEST_S:g} s"
        )
    left_s, faded = _left_s(len(position_m)), with_faded_ends(position_m, ramp_s)
    largest_m = float(np.max(np.abs(faded)))
    if not largest_m > 0.0:
        raise NoRecord("no motion")
    moved = float(np.ptp(faded[left_s >= ramp_s - 0.5 * STEP_S])) / largest_m
    if not moved >= LEAST_MOTION:
        raise NoRecord(
            f"too little motion between the ramps, where the signal is evaluated and fitted: {100 * moved:.2g} % of "
            f"the largest distance from the centre, expected at least {100 * LEAST_MOTION:g} %; the motion may be "
            f"within a ramp of {ramp_s:g} s"
        )
    shape = np.asarray(faded / largest_m, np.float64)
    mark = hashlib.sha256(shape.tobytes()).hexdigest()
    own_Hz = _highest_Hz(shape) if highest_Hz is None else highest_Hz
    return Record(
        name, duration_s, ramp_s, own_Hz, sha256, amplitude_m=largest_m if amplitude_m is None else amplitude_m,
        mark=mark, shape=shape,
    )


def with_faded_ends(values: FloatArray, fade_s: float) -> FloatArray:
    """Samples (n,) that begin and end at 0: half a cosine over so long (s) at both ends."""
    share = np.clip(_left_s(len(values)) / fade_s, 0.0, 1.0)
    return np.asarray(values * 0.5 * (1.0 - np.cos(math.pi * share)), np.float64)


def _left_s(count: int) -> FloatArray:
    """Time (s) from each of so many samples to the nearer end (n,)."""
    return np.asarray(STEP_S * np.minimum(np.arange(count), np.arange(count)[::-1]), np.float64)


def between_ramps(record: RecordFacts, count: int) -> BoolArray:
    """Which of so many samples of a record lie between its ramps (n,)."""
    time_s = STEP_S * np.arange(count, dtype=np.float64)
    return np.asarray((time_s >= record.ramp_s) & (time_s <= time_s[-1] - record.ramp_s))


def low_passed(values: FloatArray, highest_Hz: float, step_s: float = STEP_S) -> FloatArray:
    """Samples (n,) without what is faster than a frequency (Hz), without phase."""
    from scipy.signal import butter, sosfiltfilt

    sections = butter(FILTER_ORDER, highest_Hz, fs=1.0 / step_s, output="sos")
    reach = min(len(values) - 1, round(2.0 / (highest_Hz * step_s)))
    return np.asarray(sosfiltfilt(sections, values, padtype="odd", padlen=reach), np.float64)


def _highest_Hz(shape: FloatArray) -> float:
    """The frequency below which nearly all of the velocity's power lies."""
    power = np.abs(np.fft.rfft(np.diff(shape))) ** 2
    below = np.cumsum(power) / np.sum(power)
    frequency_Hz = np.fft.rfftfreq(len(shape) - 1, STEP_S)
    return max(float(frequency_Hz[int(np.searchsorted(below, POWER_BELOW))]), 1.0 / (STEP_S * len(shape)))

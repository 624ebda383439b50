"""Which tests belong together: the currents and the motions of a set of tests, and how finely these can be separated.

Two tests have the same current when the measurement of the current cannot separate them: each test states its mean, its
scatter within the test and the step of its numbers. A requested current that was recorded decides, unless the
measurement contradicts it. Motions are treated in the same way, by waveform, amplitude and frequency. Every room that
needs "tests at one current" or "tests of one motion" takes them from here.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.fourier import quantisation_step
from rig.signals.loop_shape import noise_of

LEAST_CURRENT_A = 1e-3
"""Finest separation of two measured currents: offsets of good shunts and instruments are of this order."""
OF_SCATTER = 2.0
"""Standard deviations of a test's current samples within which two tests' means are one current (95 %)."""
CURRENT_SHARE = 0.02
"""Of a measured current, by which a source misses the same set-point from test to test."""
REQUEST_A = 1e-4
"""Requested currents are exact numbers; what differs by less is the rounding of a file."""
TRACKING_A, TRACKING_SHARE = 0.02, 0.05
"""A measured current may be so far off its request (the larger of both) before it contradicts it: 20 mA is the
tolerance with which recorded points are verified."""
STEADY_A = 0.02
"""A current that scatters by less is constant: ripple and noise. A larger scatter is a change, unless it is white."""
WHITE = 1.5
"""Scatter over the noise between neighbouring samples up to which it is noise."""
ZERO_A, ZERO_SHARE = 0.01, 0.01
"""Offset of a current measurement without current: absolute, and of the greatest current of the set."""
MOTION_SHARE = 0.02
"""Relative difference of measured amplitude or frequency within which a machine repeated one motion."""
TESTED_SHARE = 0.003
"""Smallest relative difference of two measured frequencies that were tested as different ones, if each was repeated."""
CLEAR_GAP, LEAST_REPEATS = 8.0, 2
"""Gap between two tested frequencies, in widths of the repeats and in standard uncertainties; and tests of each."""
SINGLE_SHARE, EXACT_GAP = 0.01, 100.0
"""Smallest relative difference, and gap in standard uncertainties, of two tested frequencies that were not repeated."""
REQUEST_SHARE = 1e-4
"""The same of requested ones, which are exact numbers."""
MISSED_SHARE = 0.5
"""A measured amplitude or frequency that is so far off its request contradicts it; droop of servos is within."""
NOMINAL_SHARE = 0.05
"""A user's number for a motion (`25 mm`) matches a measured one (24.6 mm) within this share."""
SAME = 1.0 + 1e-9  # so that a difference of exactly the resolution is within it
OF_GAP = 0.02  # of the least distance of two levels, by which a level's label may be rounded
LEAST_PLACES, MOST_PLACES = 2, 6  # of a level's label
OUTER = 2.0  # times the resolution that a chain of neighbours may span and still be one level


@dataclass(frozen=True)
class CurrentReading:
    """The constant current of one test.

    Attributes:
        mean_A: mean of the measured samples; the requested current where none was measured.
        scatter_A: standard deviation of the samples; NaN where none was measured.
        step_A: step of the numbers in which it was measured; 0 where there is none.
        requested_A: the requested current; NaN where none was recorded.
    """

    mean_A: float
    scatter_A: float = math.nan
    step_A: float = 0.0
    requested_A: float = math.nan

    @property
    def requested(self) -> bool:
        """Whether a requested current was recorded."""
        return math.isfinite(self.requested_A)

    @property
    def as_measured(self) -> CurrentReading:
        """The same without what was requested."""
        return replace(self, requested_A=math.nan)

    @property
    def resolution_A(self) -> float:
        """Difference (A) up to which another test's measured mean is the same current."""
        scatter_A = OF_SCATTER * self.scatter_A if math.isfinite(self.scatter_A) else 0.0
        return max(LEAST_CURRENT_A, self.step_A, scatter_A, CURRENT_SHARE * abs(self.mean_A))


@dataclass(frozen=True)
class MotionReading:
    """The motion of one test: waveform, measured amplitude and frequency with standard uncertainties.

    Attributes:
        waveform: its name.
        amplitude_m: measured; NaN where there is none.
        frequency_Hz: measured; NaN where there is none.
        amplitude_std_m: standard uncertainty of the amplitude (m).
        frequency_std_Hz: standard uncertainty of the frequency (Hz).
        requested: requested amplitude (m) and frequency (Hz); None where none were recorded, or where the measured
            ones contradict them.
    """

    waveform: str
    amplitude_m: float
    frequency_Hz: float
    amplitude_std_m: float = 0.0
    frequency_std_Hz: float = 0.0
    requested: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        measured = (self.amplitude_m, self.frequency_Hz)
        if self.requested is not None and not all(
            math.isfinite(given) and (not math.isfinite(one) or abs(one - given) <= MISSED_SHARE * abs(given))
            for one, given in zip(measured, self.requested, strict=True)
        ):
            object.__setattr__(self, "requested", None)

    @property
    def as_measured(self) -> MotionReading:
        """The same without what was requested."""
        return replace(self, requested=None)

    @property
    def nominal(self) -> tuple[float, float]:
        """Amplitude (m) and frequency (Hz): requested where they were recorded, else measured."""
        return (self.amplitude_m, self.frequency_Hz) if self.requested is None else self.requested


def is_steady(current_A: FloatArray) -> bool:
    """Whether a measured current (n,), A, is constant within its ripple and noise."""
    known = current_A[np.isfinite(current_A)]
    scatter_A = float(np.std(known)) if known.size else 0.0
    return scatter_A < STEADY_A or scatter_A <= WHITE * noise_of(known)


def read_current(current_A: FloatArray, requested_A: float = math.nan) -> CurrentReading | None:
    """The constant current of a test; None where it changes within the test.

    Args:
        current_A: measured samples (n,), A, NaN where there is none.
        requested_A: the requested current, NaN where none was recorded.
    """
    known = current_A[np.isfinite(current_A)]
    if not known.size:
        return CurrentReading(requested_A, requested_A=requested_A)
    if not is_steady(known):
        return None
    scatter_A = float(np.std(known))
    step_A = quantisation_step(known) if scatter_A > 0.0 else 0.0
    return CurrentReading(float(np.mean(known)), scatter_A, step_A, requested_A)


def names_current(nominal_A: float, reading: CurrentReading) -> bool:
    """Whether a user's number for a current (A) means this test: exact where it was requested, else near it."""
    if reading.requested:
        return abs(nominal_A - reading.requested_A) <= REQUEST_A
    return abs(nominal_A - reading.mean_A) <= max(TRACKING_A, TRACKING_SHARE * abs(nominal_A), reading.resolution_A)


def same_current(one: CurrentReading, other: CurrentReading) -> bool:
    """Whether two tests ran at one current: requested ones where both are known, else by what was measured."""
    if one.requested and other.requested:
        return abs(one.requested_A - other.requested_A) <= REQUEST_A
    return abs(one.mean_A - other.mean_A) <= SAME * max(one.resolution_A, other.resolution_A)


def same_motion(one: MotionReading, other: MotionReading) -> bool:
    """Whether two tests have one motion: requested ones where both are known, else by what was measured."""
    if one.waveform != other.waveform:
        return False
    if one.requested is not None and other.requested is not None:
        return all(_within(a, b, REQUEST_SHARE * abs(b)) for a, b in zip(one.requested, other.requested, strict=True))
    return _within(
        one.amplitude_m, other.amplitude_m, max(_amplitude_width_m(one), _amplitude_width_m(other))
    ) and _within(one.frequency_Hz, other.frequency_Hz, max(_frequency_width_Hz(one), _frequency_width_Hz(other)))


def _within(one: float, other: float, width: float) -> bool:
    return one == other or abs(one - other) <= SAME * width or (math.isnan(one) and math.isnan(other))


def _amplitude_width_m(reading: MotionReading) -> float:
    return max(MOTION_SHARE * reading.amplitude_m, OF_SCATTER * reading.amplitude_std_m)


def _frequency_width_Hz(reading: MotionReading) -> float:
    return max(MOTION_SHARE * reading.frequency_Hz, OF_SCATTER * reading.frequency_std_Hz)


@dataclass(frozen=True)
class CurrentLevels:
    """The different currents of a set of tests.

    Attributes:
        values_A: mean measured current of each level, rising.
        names_A: what each level is called: the requested current where its tests share one, else the mean, rounded as
            far as the distances of the levels allow.
        of_test: each test's level; None where its current changes within the test.
        resolution_A: smallest and largest resolution of the tests; NaN without any.
        merged: levels (their numbers) within which neighbours cannot be separated but the outermost tests can.
        contradicting: tests (their numbers) whose measured current contradicts the requested one.
    """

    values_A: tuple[float, ...]
    names_A: tuple[float, ...]
    of_test: tuple[int | None, ...]
    resolution_A: tuple[float, float]
    merged: tuple[int, ...] = ()
    contradicting: tuple[int, ...] = ()

    def __len__(self) -> int:
        return len(self.values_A)

    @property
    def zero(self) -> int | None:
        """The level without current; None where there is none."""
        if not self.values_A:
            return None
        least = min(range(len(self)), key=lambda level: abs(self.values_A[level]))
        offset_A = max(ZERO_A, ZERO_SHARE * max(map(abs, self.values_A)))
        return least if self.names_A[least] == 0.0 or abs(self.values_A[least]) <= offset_A else None

    @property
    def changing(self) -> tuple[int, ...]:
        """Tests (their numbers) whose current changes within the test."""
        return tuple(number for number, level in enumerate(self.of_test) if level is None)

    def members(self, level: int) -> list[int]:
        """The tests (their numbers) of a level."""
        return [number for number, own in enumerate(self.of_test) if own == level]

    def name_A(self, number: int) -> float:
        """What the current of a test is called; NaN where it changes."""
        level = self.of_test[number]
        return math.nan if level is None else self.names_A[level]

    def named(self, current_A: float) -> int | None:
        """The level that a current (A) means: the nearest that is called so, or within half of a distance of levels."""
        if not self.names_A:
            return None
        level = min(range(len(self)), key=lambda one: abs(self.names_A[one] - current_A))
        gap_A = min((b - a for a, b in itertools.pairwise(sorted(self.names_A))), default=math.inf)
        room_A = max(REQUEST_A, min(max(TRACKING_A, TRACKING_SHARE * abs(current_A)), 0.5 * gap_A))
        return level if abs(self.names_A[level] - current_A) < room_A else None

    @property
    def statement(self) -> str:
        """The levels and the resolution in words: `currents 0, 25, 50 mA distinguished; resolution 3 mA`."""
        if not self.values_A:
            return "no test has a constant current"
        scale, unit = (1e3, "mA") if max(map(abs, self.names_A)) < 0.5 else (1.0, "A")
        levels = ", ".join(f"{scale * name + 0.0:.6g}" for name in self.names_A)
        fine, coarse = (f"{1e3 * one:.2g}" for one in self.resolution_A)
        resolution = fine if fine == coarse else f"{fine} to {coarse}"
        plural = "currents" if len(self) > 1 else "current"
        return f"{plural} {levels} {unit}{' distinguished' if len(self) > 1 else ''}; resolution {resolution} mA"


@dataclass(frozen=True)
class MotionGroups:
    """The different motions of a set of tests.

    Attributes:
        motions: each motion by the means of its tests, by amplitude, then frequency.
        of_test: each test's motion.
        frequencies_Hz: the different frequencies, rising.
        frequency_of: each motion's frequency (its number).
        amplitudes_m: the different amplitudes, rising, whatever the waveform and frequency.
        amplitude_of: each motion's amplitude (its number).
    """

    motions: tuple[MotionReading, ...]
    of_test: tuple[int, ...]
    frequencies_Hz: tuple[float, ...]
    frequency_of: tuple[int, ...]
    amplitudes_m: tuple[float, ...]
    amplitude_of: tuple[int, ...]

    def __len__(self) -> int:
        return len(self.motions)

    def frequency_Hz(self, number: int) -> float:
        """The frequency to which a test belongs (Hz)."""
        return self.frequencies_Hz[self.frequency_of[self.of_test[number]]]

    def amplitude_m(self, number: int) -> float:
        """The amplitude to which a test belongs (m)."""
        return self.amplitudes_m[self.amplitude_of[self.of_test[number]]]

    def members(self, motion: int) -> list[int]:
        """The tests (their numbers) of a motion."""
        return [number for number, own in enumerate(self.of_test) if own == motion]


@dataclass(frozen=True)
class TestSet:
    """A set of tests in its levels of current and its motions."""

    __test__ = False  # pytest takes classes called Test for its own

    currents: CurrentLevels
    motions: MotionGroups

    @classmethod
    def of(cls, currents: Sequence[CurrentReading | None], motions: Sequence[MotionReading]) -> TestSet:
        """Group tests, one reading of each kind a test; None where the current changes within the test."""
        return cls(current_levels(currents), motion_groups(motions))

    @property
    def identical(self) -> list[list[int]]:
        """Tests (their numbers) of one motion and one current together; those whose current changes are left out."""
        groups: dict[tuple[int, int], list[int]] = {}
        for number, (motion, level) in enumerate(zip(self.motions.of_test, self.currents.of_test, strict=True)):
            if level is not None:
                groups.setdefault((motion, level), []).append(number)
        return list(groups.values())

    @property
    def groups(self) -> list[list[int]]:
        """Tests (their numbers) of one motion together; where all have one motion, those of one current."""
        numbers = self.motions.of_test if len(self.motions) > 1 else self.currents.of_test
        groups: dict[int | None, list[int]] = {}
        for number, group in enumerate(numbers):
            groups.setdefault(group, []).append(number)
        return list(groups.values())

    @property
    def summary(self) -> TestSetSummary:
        """The groups without the tests, as a fit and the characteristics state them."""
        levels, groups = self.currents, self.motions
        fine, coarse = (None if math.isnan(one) else one for one in levels.resolution_A)
        motions = tuple(
            MotionSummary(motion.waveform, *motion.nominal, len(groups.members(number)))
            for number, motion in enumerate(groups.motions)
        )
        return TestSetSummary(levels.names_A, (fine, coarse), levels.statement, motions)


@dataclass(frozen=True)
class MotionSummary:
    """One motion of a set of tests: waveform, amplitude (m), frequency (Hz), NaN without; number of tests."""

    waveform: str
    amplitude_m: float = math.nan
    frequency_Hz: float = math.nan
    tests: int = 0


@dataclass(frozen=True)
class TestSetSummary:
    """How a set of tests is grouped.

    Attributes:
        currents_A: what the levels of current are called (A), rising.
        current_resolution_A: smallest and largest difference (A) up to which two tests have one current; None without.
        statement: levels and resolution in words.
        motions: the motions, by amplitude, then frequency.
    """

    __test__ = False  # pytest takes classes called Test for its own

    currents_A: tuple[float, ...] = ()
    current_resolution_A: tuple[float | None, ...] = ()
    statement: str = ""
    motions: tuple[MotionSummary, ...] = ()


def current_levels(readings: Sequence[CurrentReading | None]) -> CurrentLevels:
    """Group tests by current.

    Tests with a recorded request are grouped by it. Tests without one, and tests whose measurement contradicts their
    request, are joined to the level whose measured mean is within their resolution, or form levels of their own.

    Args:
        readings: one a test; None where its current changes within the test.
    """
    known = {number: reading for number, reading in enumerate(readings) if reading is not None}
    contradicting = _contradicting(known)
    nominal = [number for number, one in known.items() if one.requested and number not in contradicting]
    groups = _grouped(nominal, [known[k].requested_A for k in nominal], [REQUEST_A] * len(nominal))[0]
    others = [number for number in known if number not in nominal]
    left = []
    for number in others:
        near = [group for group in groups if _belongs(known[number], [known[k] for k in group if k in nominal])]
        if near:
            mean_A = known[number].mean_A
            min(near, key=lambda group: abs(_mean_A(known, group) - mean_A)).append(number)
        else:
            left.append(number)
    measured, wide = _grouped(left, [known[k].mean_A for k in left], [known[k].resolution_A for k in left])
    wide_groups = [id(group) for group in wide]
    ordered = sorted([*groups, *measured], key=lambda group: _mean_A(known, group))
    level_of = {number: level for level, group in enumerate(ordered) for number in group}
    values_A = tuple(_mean_A(known, group) for group in ordered)
    widths_A = [one.resolution_A for one in known.values()]
    return CurrentLevels(
        values_A, _names_A(known, ordered, values_A, set(nominal)),
        tuple(level_of.get(number) for number in range(len(readings))),
        (min(widths_A), max(widths_A)) if widths_A else (math.nan, math.nan),
        tuple(level for level, group in enumerate(ordered) if id(group) in wide_groups), tuple(sorted(contradicting)),
    )  # fmt: skip


def _contradicting(known: dict[int, CurrentReading]) -> set[int]:
    """Tests whose measured current is further off its request than a source misses it, or nearer to another request."""
    requests = sorted({one.requested_A for one in known.values() if one.requested})
    gaps = [b - a for a, b in itertools.pairwise(requests) if b - a > REQUEST_A]
    half_gap_A = 0.5 * min(gaps, default=math.inf)
    return {
        number for number, one in known.items()
        if one.requested and math.isfinite(one.mean_A) and abs(one.mean_A - one.requested_A) > SAME * max(
            one.resolution_A, min(max(TRACKING_A, TRACKING_SHARE * abs(one.requested_A)), half_gap_A)
        )
    }  # fmt: skip


def _belongs(one: CurrentReading, group: Sequence[CurrentReading]) -> bool:
    """Whether a measured current is that of a level of requested ones."""
    mean_A = float(np.mean([other.mean_A for other in group]))
    return abs(one.mean_A - mean_A) <= SAME * max(one.resolution_A, *(other.resolution_A for other in group))


def _mean_A(known: dict[int, CurrentReading], group: Sequence[int]) -> float:
    return float(np.mean([known[number].mean_A for number in group]))


def _names_A(
    known: dict[int, CurrentReading], groups: Sequence[Sequence[int]], values_A: Sequence[float], nominal: set[int]
) -> tuple[float, ...]:
    """What the levels are called; the rounded means where two levels would have one name."""
    names = list(rounded_levels(values_A))
    requested = list(names)
    for level, group in enumerate(groups):
        if shared := [known[number].requested_A for number in group if number in nominal]:
            requested[level] = shared[0] + 0.0
    return tuple(requested if len(set(requested)) == len(requested) else names)


def rounded_levels(values_A: Sequence[float]) -> tuple[float, ...]:
    """Currents (A) rounded for labels: to 10 mA, or as fine as their least distance needs."""
    ordered = sorted(values_A)
    gap_A = min((b - a for a, b in itertools.pairwise(ordered)), default=math.inf)
    for places in range(LEAST_PLACES, MOST_PLACES):
        rounded = tuple(round(float(value), places) + 0.0 for value in values_A)
        if all(abs(a - b) <= OF_GAP * gap_A for a, b in zip(rounded, values_A, strict=True)):
            return rounded
    return tuple(round(float(value), MOST_PLACES) + 0.0 for value in values_A)


def motion_groups(readings: Sequence[MotionReading]) -> MotionGroups:
    """Group tests by motion: requested amplitude and frequency where they were recorded, else the measured ones.

    Args:
        readings: one a test.
    """
    groups: list[list[int]] = []
    for waveform in dict.fromkeys(reading.waveform for reading in readings):
        own = [number for number, reading in enumerate(readings) if reading.waveform == waveform]
        groups += _of_waveform(readings, own)
    means = [mean_motion([readings[number] for number in group]) for group in groups]
    amplitudes_m, amplitude_of = _values(
        means, [one.nominal[0] for one in means], [_amplitude_width_m(one) for one in means]
    )
    frequencies_Hz, frequency_of = _values(
        means, [one.nominal[1] for one in means], [_frequency_width_Hz(one) for one in means]
    )
    order = sorted(range(len(groups)), key=lambda k: (amplitude_of[k], frequency_of[k], means[k].waveform))
    of_test = {number: place for place, k in enumerate(order) for number in groups[k]}
    return MotionGroups(
        tuple(means[k] for k in order), tuple(of_test[number] for number in range(len(readings))),
        frequencies_Hz, tuple(frequency_of[k] for k in order), amplitudes_m, tuple(amplitude_of[k] for k in order),
    )  # fmt: skip


def _values(
    motions: Sequence[MotionReading], values: Sequence[float], widths: Sequence[float]
) -> tuple[tuple[float, ...], tuple[int, ...]]:
    """The different values of some motions, rising, and which of them is each motion's."""
    exact = [
        width if motion.requested is None else REQUEST_SHARE * abs(value)
        for value, width, motion in zip(values, widths, motions, strict=True)
    ]
    groups = _grouped(range(len(values)), values, exact)[0]
    place_of = {number: place for place, group in enumerate(groups) for number in group}
    means = tuple(float(np.mean([values[number] for number in group])) for group in groups)
    return means, tuple(place_of[number] for number in range(len(values)))


def _of_waveform(readings: Sequence[MotionReading], own: Sequence[int]) -> list[list[int]]:
    groups: list[list[int]] = []
    left = []
    for number in own:
        if readings[number].requested is None:
            left.append(number)
        elif (there := next((one for one in groups if same_motion(readings[one[0]], readings[number])), None)) is None:
            groups.append([number])
        else:
            there.append(number)
    without = []
    for number in left:
        near = [group for group in groups if same_motion(mean_motion([readings[k] for k in group]), readings[number])]
        if near:
            near[0].append(number)
        else:
            without.append(number)
    frequencies = _grouped(
        without, [readings[k].frequency_Hz for k in without], [_frequency_width_Hz(readings[k]) for k in without]
    )[0]
    for one in (piece for chain in frequencies for piece in _tight(chain, readings)):
        groups += _grouped(
            one, [readings[k].amplitude_m for k in one], [_amplitude_width_m(readings[k]) for k in one]
        )[0]  # fmt: skip
    return groups


def are_separable(low_Hz: float, high_Hz: float, noise_Hz: float) -> bool:
    """Whether two measured frequencies with this standard uncertainty were tested as different ones, if repeated."""
    return high_Hz - low_Hz > max(TESTED_SHARE * high_Hz, CLEAR_GAP * noise_Hz)


def _are_far_apart(gap_Hz: float, frequency_Hz: float, noise_Hz: float) -> bool:
    """Whether two measured frequencies were tested as different ones although they were not repeated.

    The uncertainty must be known: it shows how exactly the machine holds its frequency.
    """
    return noise_Hz > 0.0 and gap_Hz > max(SINGLE_SHARE * frequency_Hz, EXACT_GAP * noise_Hz)


def _tight(group: Sequence[int], readings: Sequence[MotionReading]) -> list[Sequence[int]]:
    """Tests of near frequencies, apart where several frequencies were tested.

    A generator repeats a frequency exactly, whatever the force; so two clusters of repeats that are far narrower than
    the gap between them are two tested frequencies. Without repeats, as at a single current, the gap must be wider than
    a motor drifts between tests, and very wide compared with what the frequency varies within each test. Amplitudes
    droop with the force and are not separated like this.
    """
    order = sorted(group, key=lambda k: readings[k].frequency_Hz)
    values = [readings[k].frequency_Hz for k in order]
    noise_Hz = max(readings[k].frequency_std_Hz for k in order)
    for place in sorted(range(1, len(order)), key=lambda at: values[at - 1] - values[at]):  # the widest gap first
        gap_Hz = values[place] - values[place - 1]
        if not are_separable(values[place - 1], values[place], noise_Hz):
            break
        repeated = LEAST_REPEATS <= place <= len(order) - LEAST_REPEATS
        if not repeated and not _are_far_apart(gap_Hz, values[place], noise_Hz):
            continue
        low, high = _tight(order[:place], readings), _tight(order[place:], readings)
        spans_Hz = [readings[part[-1]].frequency_Hz - readings[part[0]].frequency_Hz for part in (*low, *high)]
        if gap_Hz > CLEAR_GAP * max(spans_Hz):
            return [*low, *high]
    return [order]


def mean_current(group: Sequence[CurrentReading]) -> CurrentReading:
    """The common current of tests of one level."""
    requested_A = [reading.requested_A for reading in group if reading.requested]
    scatters_A = [reading.scatter_A for reading in group if math.isfinite(reading.scatter_A)]
    return CurrentReading(
        float(np.mean([reading.mean_A for reading in group])), max(scatters_A, default=math.nan),
        max(reading.step_A for reading in group), requested_A[0] if requested_A else math.nan,
    )


def mean_motion(group: Sequence[MotionReading]) -> MotionReading:
    """The common motion of tests of one motion."""
    requested = [reading.requested for reading in group if reading.requested is not None]
    return MotionReading(
        group[0].waveform,
        float(np.mean([reading.amplitude_m for reading in group])),
        float(np.mean([reading.frequency_Hz for reading in group])),
        max(reading.amplitude_std_m for reading in group),
        max(reading.frequency_std_Hz for reading in group),
        requested[0] if requested else None,
    )


def _grouped(
    numbers: Sequence[int], values: Sequence[float], widths: Sequence[float]
) -> tuple[list[list[int]], list[list[int]]]:
    """Tests whose values are one within their widths, by rising value; and those groups that span more than a width.

    Neighbours further apart than the larger of their widths are different. A chain of near neighbours is one group up
    to twice the width; a longer one is cut at its widest gaps into groups of at most one width.

    Args:
        numbers: of the tests (k,).
        values: (k,); those that are NaN are one group.
        widths: (k,), in the unit of the values.
    """
    order = sorted((k for k in range(len(numbers)) if not math.isnan(values[k])), key=lambda k: values[k])
    blank = [numbers[k] for k in range(len(numbers)) if math.isnan(values[k])]
    chains: list[list[int]] = []
    for k in order:
        if chains and values[k] - values[chains[-1][-1]] <= SAME * max(widths[k], widths[chains[-1][-1]]):
            chains[-1].append(k)
        else:
            chains.append([k])
    groups, wide = [], []
    for chain in chains:
        width = max(widths[k] for k in chain)
        span = values[chain[-1]] - values[chain[0]]
        pieces = [chain] if span <= OUTER * SAME * width else _cut(chain, values, width)
        for piece in pieces:
            group = [numbers[k] for k in piece]
            groups.append(group)
            if len(pieces) > 1 or span > SAME * width:
                wide.append(group)
    return [*groups, *([blank] if blank else [])], wide


def _cut(chain: Sequence[int], values: Sequence[float], width: float) -> list[Sequence[int]]:
    """Pieces of at most one width, cut at the widest gap, of equal ones at that nearest to the middle."""
    if values[chain[-1]] - values[chain[0]] <= SAME * width:
        return [chain]
    gaps = [values[b] - values[a] for a, b in itertools.pairwise(chain)]
    widest = max(gaps)
    places = [place for place, gap in enumerate(gaps) if gap * SAME >= widest]
    place = min(places, key=lambda place: abs(place + 1 - 0.5 * len(chain)))
    return [*_cut(chain[: place + 1], values, width), *_cut(chain[place + 1 :], values, width)]

"""A test ready for fitting: whole cycles of motion, force and current on one time base.

Shorter ones serve searches: one cycle says nearly what many say.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from rig.dampers.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from rig.identification.remarks import Remark
from rig.signals.test_set import CurrentReading, MotionReading, TestSet, read_current

PIECE = 32768  # samples that are looked at together: what is made of them stays in the processor's cache
FEWEST_OF_A_CYCLE = 16
READINGS = ("current", "motion", "cycles_last_s", "reaches")  # of the samples, kept once they were needed
ARRAYS = (
    "u_m", "v_m_s", "a_m_s2", "force_N", "current_A", "usable", "commanded_A", "unseen_v_m_s", "unseen_a_m_s2",
    "temperature_degC",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class MotionError:
    """Standard errors of a motion that was found as a Fourier series.

    Attributes:
        rates_rad_s: angular frequencies of its harmonics (rad/s), shape (K,).
        errors_m: standard error (m) of the cosine and of the sine of each, shape (K,).
        mean_error_m: standard error of the mean (m).
        together_m: errors that several harmonics have in common, one standard deviation of each in a row (q, K), m:
            the displacement Re(sum over k of together_m[:, k] exp(i rate_k t)), t from the first sample. None: none.
    """

    rates_rad_s: FloatArray
    errors_m: FloatArray
    mean_error_m: float
    together_m: ComplexArray | None = None

    @property
    def common_m(self) -> ComplexArray:
        """`together_m`, (0, K) where there is none."""
        return np.zeros((0, self.errors_m.size), np.complex128) if self.together_m is None else self.together_m


@dataclass(frozen=True)
class MeanCycles:
    """Recorded samples behind mean cycles: each mean is over forces at the same phase of successive cycles.

    Attributes:
        samples: number of recorded samples in each mean.
        scatter_N: standard deviation of the recorded forces about the means (N).
        noise_N: standard deviation of the means from one mean cycle to the next (N); NaN if unknown.
        peak_force_N: largest deviation of the recorded force from its mean (N).
        spread: whether the samples of a mean are spread over a phase interval; otherwise all have the same phase.
        cycles: number of recorded cycles in each mean cycle.
    """

    samples: float
    scatter_N: float
    noise_N: float
    peak_force_N: float
    spread: bool = True
    cycles: float = 1.0


@dataclass(frozen=True, eq=False)
class Measurement:
    """Whole cycles of one test, motion about mid-stroke; all arrays have shape (n,) and are kept contiguous.

    Attributes:
        id: the test point's id.
        file: where it was recorded; empty for synthetic data.
        u_m: extension about mid-stroke (m).
        v_m_s: velocity (m/s).
        a_m_s2: acceleration (m/s^2).
        force_N: measured force (N), not filtered.
        current_A: measured coil current (A); the commanded one where none was measured.
        dt_s: sampling interval (s).
        waveform: name of the waveform.
        amplitude_m: nominal amplitude (m).
        frequency_Hz: nominal frequency (Hz).
        nominal_current_A: commanded current (A).
        motion_requested: whether `amplitude_m` and `frequency_Hz` were requested; else they were measured.
        current_requested: whether `nominal_current_A` was requested; else it was measured.
        samples_per_cycle: samples in the first whole cycle; it also warms up models with internal states.
        usable: which samples carry a measured force, shape (n,); None when all do.
        current_std_A: standard error (A) of a steady measured current, the same all through the test; 0 where none.
        current_scatter_A: standard deviation (A) of the samples of a steady measured current; nan where none.
        current_step_A: quantisation step (A) of the measured current; 0 where there is none.
        commanded_A: commanded current (A) where it changes and the coil current was not measured; None otherwise.
        commanded_before_A: the command at the same interval before the first sample, shape (k,); None when unknown.
        skew_std_s: standard uncertainty of the force-to-displacement skew left after correction (s).
        unseen_v_m_s: velocity (m/s) that sharp reversals may have beyond what the samples resolve; None when none.
        unseen_a_m_s2: acceleration (m/s^2) that goes with it.
        motion_error: how well the motion is known; None where it is exact, or where that is unknown.
        force_zero_std_N: standard uncertainty of the force sensor's zero, the same error in all tests (N).
        force_step_N: quantisation step of the force (N); 0 where there is none.
        temperature_degC: recorded temperature of coil or body (degC), shape (n,); None where none was recorded.
        noise_N: standard deviation of the recorded force from cycle to cycle (N); nan when it cannot be told.
        time_noise_N: part of `noise_N` due to errors in the sample times (N), which averaging over cycles does not
            reduce.
        means: the recorded samples behind mean cycles; None if the samples are the recorded ones.
        warnings: what the preparation found.

    Raises:
        ValueError: an array has another shape than `u_m` or holds what is no number, `dt_s` is not positive, a cycle
            is longer than the test, or the noise is negative.
    """

    id: str
    u_m: FloatArray
    v_m_s: FloatArray
    a_m_s2: FloatArray
    force_N: FloatArray
    current_A: FloatArray
    dt_s: float
    file: str = ""
    waveform: str = "sine"
    amplitude_m: float = float("nan")
    frequency_Hz: float = float("nan")
    nominal_current_A: float = float("nan")
    samples_per_cycle: int = 0
    usable: BoolArray | None = None
    commanded_A: FloatArray | None = None
    commanded_before_A: FloatArray | None = None
    motion_requested: bool = True
    current_requested: bool = True
    current_std_A: float = 0.0
    current_scatter_A: float = float("nan")
    current_step_A: float = 0.0
    skew_std_s: float = 0.0
    unseen_v_m_s: FloatArray | None = None
    unseen_a_m_s2: FloatArray | None = None
    motion_error: MotionError | None = None
    force_zero_std_N: float = 0.0
    force_step_N: float = 0.0
    noise_N: float = float("nan")
    temperature_degC: FloatArray | None = None
    time_noise_N: float = 0.0
    means: MeanCycles | None = None
    warnings: tuple[Remark, ...] = field(default=())

    def __post_init__(self) -> None:
        n = self.u_m.shape[0]
        for name in ("v_m_s", "a_m_s2", "force_N", "current_A"):
            shape = getattr(self, name).shape
            if shape != (n,):
                raise ValueError(f"{self.id}: {name} has shape {shape}, expected ({n},), the shape of u_m")
        if self.usable is not None and self.usable.shape != (n,):
            raise ValueError(f"{self.id}: usable has shape {self.usable.shape}, expected ({n},), the shape of u_m")
        if self.temperature_degC is not None and self.temperature_degC.shape != (n,):
            shape = self.temperature_degC.shape
            raise ValueError(f"{self.id}: temperature_degC has shape {shape}, expected ({n},), the shape of u_m")
        if not (math.isfinite(self.dt_s) and self.dt_s > 0.0):
            raise ValueError(f"{self.id}: dt_s = {self.dt_s:g}, expected a positive time in seconds")
        if not 0 <= self.samples_per_cycle <= n:
            raise ValueError(
                f"{self.id}: samples_per_cycle = {self.samples_per_cycle}, expected 0 (no whole cycle) to {n}, the "
                "number of samples"
            )
        if self.noise_N < 0.0:
            raise ValueError(f"{self.id}: noise_N = {self.noise_N:g}, expected 0 or more newtons, or nan if unknown")
        for name in ("u_m", "v_m_s", "a_m_s2", "force_N", "current_A"):
            values = getattr(self, name)
            broken = np.flatnonzero(~np.isfinite(values))
            if broken.size:
                raise ValueError(
                    f"{self.id}: {name}[{broken[0]}] = {values[broken[0]]:g} ({broken.size} such samples), expected "
                    "finite numbers. Fix: for samples of unknown force, set the force to 0 and `usable` to False"
                )
        for name in ARRAYS:  # a model is compiled again for arrays that are not contiguous: seconds for each
            values = getattr(self, name)
            if values is not None and not values.flags.c_contiguous:
                object.__setattr__(self, name, np.ascontiguousarray(values))

    @property
    def scored(self) -> BoolArray:
        """The samples that carry a measured force, shape (n,)."""
        return np.ones(self.u_m.size, dtype=bool) if self.usable is None else self.usable

    @property
    def recorded_each(self) -> float:
        """Number of recorded samples that each sample represents."""
        return 1.0 if self.means is None else self.means.samples

    @property
    def cycles_each(self) -> float:
        """Number of recorded cycles that each cycle represents."""
        return 1.0 if self.means is None else self.means.cycles

    @property
    def scatter_N(self) -> float:
        """Standard deviation (N) of the recorded forces about the samples that represent them."""
        return 0.0 if self.means is None else self.means.scatter_N

    @property
    def sample_noise_N(self) -> float:
        """Standard deviation of the force samples from cycle to cycle (N); NaN if unknown."""
        return self.noise_N if self.means is None else self.means.noise_N

    @property
    def peak_force_N(self) -> float:
        """Largest deviation of the recorded force from its mean (N): the reference for relative errors."""
        if self.means is not None:
            return self.means.peak_force_N
        force = self.force_N if self.usable is None else self.force_N[self.usable]
        mean_N = float(np.mean(force))
        return max(float(np.max(force)) - mean_N, mean_N - float(np.min(force)))

    @cached_property
    def current(self) -> CurrentReading | None:
        """The current of the test as one level; None where it changes within the test."""
        requested_A = self.nominal_current_A if self.current_requested else math.nan
        if float(np.ptp(self.current_A)) > 0.0:
            return read_current(self.current_A, requested_A)
        return CurrentReading(float(self.current_A[0]), self.current_scatter_A, self.current_step_A, requested_A)

    @cached_property
    def motion(self) -> MotionReading:
        """The measured motion, with the requested one where that is known."""
        nominal = (self.amplitude_m, self.frequency_Hz)
        known = all(map(math.isfinite, nominal))
        frequency_Hz = 1.0 / (samples_a_cycle(self.u_m) * self.dt_s)
        times_s = cycle_times_s(self)
        scatter = float(np.std(times_s)) / math.sqrt(times_s.size) * frequency_Hz if times_s.size > 1 else 0.0
        error_m = 0.0 if self.motion_error is None or not self.motion_error.errors_m.size else float(
            self.motion_error.errors_m[0]
        )
        measured = nominal if known and not self.motion_requested else (0.5 * float(np.ptp(self.u_m)), frequency_Hz)
        requested = nominal if known and self.motion_requested else None
        return MotionReading(self.waveform, *measured, error_m, scatter * frequency_Hz, requested)

    @cached_property
    def cycles_last_s(self) -> tuple[float, float]:
        """How long the shortest and the longest cycles last (s): the 5 % and 95 % quantiles; NaN without a cycle.

        A test of which a single cycle is left shows no two crossings; its cycle lasts as long as it does.
        """
        times_s = cycle_times_s(self)
        if not times_s.size:
            only_s = self.samples_per_cycle * self.dt_s if self.samples_per_cycle > 0 else math.nan
            return only_s, only_s
        low_s, high_s = np.quantile(times_s, (0.05, 0.95)).tolist()
        return low_s, high_s

    @cached_property
    def reaches(self) -> tuple[tuple[float, float], ...]:
        """Lowest and highest extension (m), velocity (m/s) and current (A)."""
        return tuple((float(np.min(one)), float(np.max(one))) for one in (self.u_m, self.v_m_s, self.current_A))

    def rows(self, part: slice) -> Measurement:
        """Some of the samples, next to each other, without a copy of them."""
        piece = self._without_readings()
        piece.__dict__.update({name: values[part] for name in ARRAYS if (values := getattr(self, name)) is not None})
        return piece

    def moved(self, u_m: FloatArray, v_m_s: FloatArray, a_m_s2: FloatArray) -> Measurement:
        """The same with another motion, shape (n,) each."""
        other = self._without_readings()
        u_m, v_m_s, a_m_s2 = map(np.ascontiguousarray, (u_m, v_m_s, a_m_s2))
        other.__dict__.update(u_m=u_m, v_m_s=v_m_s, a_m_s2=a_m_s2)
        return other

    def _without_readings(self) -> Measurement:
        """A copy whose current and motion are read again: its samples will be others."""
        other = copy(self)
        for name in READINGS:
            other.__dict__.pop(name, None)
        return other

    def pieces(self) -> Iterator[slice]:
        """Stretches of at most `PIECE` samples, one after the other."""
        edges = np.linspace(0, self.u_m.size, max(1, math.ceil(self.u_m.size / PIECE)) + 1).astype(int).tolist()
        for start, stop in pairwise(edges):
            yield slice(start, stop)


def recorded_errors(test: Measurement, error_N: FloatArray) -> FloatArray:
    """Errors of the samples (n,), N, with reproducible random scatter of the recorded samples added."""
    if test.scatter_N == 0.0:
        return error_N
    return error_N + test.scatter_N * np.random.default_rng(0).standard_normal(error_N.size)


def set_of(tests: Sequence[Measurement]) -> TestSet:
    """The tests in their levels of current and their motions."""
    return TestSet.of([test.current for test in tests], [test.motion for test in tests])


def all_but(tests: Sequence[Measurement], numbers: Sequence[int]) -> list[Measurement]:
    """The tests without those with these indices."""
    return [test for number, test in enumerate(tests) if number not in numbers]


def closed_cycle(test: Measurement) -> IntArray:
    """Indices (k,) of the samples that draw one cycle from the middle of a measurement: it ends where it begins.

    The last is the first sample of the next cycle, of the only cycle its own first; all samples where none repeat.
    """
    count, per_cycle = test.u_m.size, test.samples_per_cycle
    if per_cycle <= 0:
        return np.arange(count)
    if count < 2 * per_cycle:
        return np.append(np.arange(min(count, per_cycle + 1)), 0)  # a thinned cycle can have a sample more
    start = (count // per_cycle - 1) // 2 * per_cycle
    places = np.arange(start, start + per_cycle + 1)
    return np.where(places < count, places, start)


def first_cycle(test: Measurement) -> Measurement:
    """The first whole cycle of a measurement; the measurement itself when it has no more."""
    stop = test.samples_per_cycle
    if not 1 < stop < test.u_m.size:
        return test
    return replace(
        test,
        u_m=test.u_m[:stop],
        v_m_s=test.v_m_s[:stop],
        a_m_s2=test.a_m_s2[:stop],
        force_N=test.force_N[:stop],
        current_A=test.current_A[:stop],
        usable=None if test.usable is None else test.usable[:stop],
        commanded_A=None if test.commanded_A is None else test.commanded_A[:stop],
        temperature_degC=None if test.temperature_degC is None else test.temperature_degC[:stop],
    )


def thinned(test: Measurement, every: int) -> Measurement:
    """Every `every`-th sample of a measurement, from the first."""
    if every == 1:
        return test
    part = test.rows(slice(0, test.u_m.size, every))
    return replace(part, dt_s=test.dt_s * every, samples_per_cycle=test.samples_per_cycle // every)


def spaced(test: Measurement, most: int) -> Measurement:
    """A measurement with so few of its samples that a cycle has at most about `most`."""
    return thinned(test, max(1, test.samples_per_cycle // most))


def spanning(tests: Sequence[Measurement], most: int) -> list[Measurement]:
    """At most so many of the tests, as different as possible in amplitude, top speed and current, in their order.

    The first is the fastest; each next one is the test farthest from those already taken.
    """
    if len(tests) <= most:
        return list(tests)
    features = np.array([
        (float(np.ptp(test.u_m)), float(np.max(np.abs(test.v_m_s))), float(np.mean(test.current_A))) for test in tests
    ])  # fmt: skip
    features /= np.maximum(np.ptp(features, axis=0), 1e-300)
    taken = [int(np.argmax(features[:, 1]))]
    distance = np.full(len(tests), np.inf)
    while len(taken) < most:
        distance = np.minimum(distance, np.sum((features - features[taken[-1]]) ** 2, axis=1))
        distance[taken] = -1.0
        taken.append(int(np.argmax(distance)))
    return [tests[number] for number in sorted(taken)]


def samples_a_cycle(u_m: FloatArray) -> float:
    """Mean distance of the crossings of the mean position in one direction, in samples, not rounded.

    The direction that has more of them counts: whole cycles cut at their upward crossings have none at their ends. A
    single cycle, which has not two, lasts from the crossing before its first sample to that after its last; the length
    where it does not begin and end so.
    """
    exact = _crossings(u_m)
    if exact.size > 1:
        return float((exact[-1] - exact[0]) / (exact.size - 1))
    mean_m, size = float(np.mean(u_m)), float(u_m.size)
    if u_m.size < FEWEST_OF_A_CYCLE or not (u_m[0] >= mean_m > u_m[-1] and u_m[1] > u_m[0] and u_m[-1] > u_m[-2]):
        return size
    outside = (u_m[0] - mean_m) / (u_m[1] - u_m[0]) + (mean_m - u_m[-1]) / (u_m[-1] - u_m[-2])
    return float(min(max(size - 1.0 + outside, size - 1.0), size + 1.0))


def cycle_times_s(test: Measurement) -> FloatArray:
    """How long each whole cycle of a test lasts (s), from the crossings that `samples_a_cycle` counts, shape (k,)."""
    return np.asarray(np.diff(_crossings(test.u_m)) * test.dt_s)


def _crossings(u_m: FloatArray) -> FloatArray:
    """Where (in samples, not rounded) the mean is crossed upwards, or downwards where that is more often."""
    mean_m = float(np.mean(u_m))
    above = u_m > mean_m
    upwards = np.flatnonzero(~above[:-1] & above[1:])
    downwards = np.flatnonzero(above[:-1] & ~above[1:])
    before = upwards if upwards.size >= downwards.size else downwards
    low, high = u_m[before] - mean_m, u_m[before + 1] - mean_m
    return np.asarray(before + low / (low - high))

"""Long tests as mean cycles: samples with the same phase are averaged, which limits the cost of a fit.

If a motion repeats at a constant current, every recorded force is a value at a phase of the cycle plus noise. The mean
and number of the samples at a phase contain their information on the model parameters; their scatter, which is stored
in `MeanCycles`, describes the noise. Successive cycles are averaged in groups, so drift, heating of the damper and
scatter from cycle to cycle remain visible. In a finely sampled cycle, adjacent samples are averaged, too.

The mean over a phase interval differs from the value at its midpoint. With d, the distance of a sample from the
midpoint, `F(middle) = mean F - F' mean d - F''/2 mean d^2`, the derivatives from the mean of all cycles.
A force that changes faster within an interval (a jump or a knee, or few samples per cycle) would bias the means; if the
residuals within the intervals show this, the test is not averaged (`_IntervalResiduals`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rig.dampers.arrays import FloatArray
from rig.identification.models.measurement import MeanCycles, Measurement, samples_a_cycle
from rig.identification.points.preparation import MEDIAN_OF_NORMAL, repeat_scatter_N
from rig.identification.remarks import say
from rig.signals.fourier import MEDIAN_OF_EXPONENTIAL
from rig.signals.waveform import WAVEFORMS

LONG = 65_536
"""Largest number of samples of a test that is fitted without averaging."""
KEPT = 32_768
"""Approximate number of means of a long test: more cost time, fewer make the phase intervals wide."""
MOST_PHASES = 2048
FEWEST_GROUPS = 16
FEWEST_AVERAGED = 1.5
"""Minimum number of recorded samples per mean; averaging fewer is not worthwhile."""
SAME_PERIOD = 0.01
"""Tolerance for the relative difference between the measured and the known period."""
TIE_FRACTION = 0.01
"""Fraction of the interval within which samples near a boundary are always assigned to the lower interval."""
MIDPOINT_ITERATIONS = 3
"""Number of iterations to compute midpoint values from the means."""
MOTION = ("u_m", "v_m_s", "a_m_s2", "unseen_v_m_s", "unseen_a_m_s2")
OUT_OF_NOISE = 6.0
"""Power relative to the noise below which a force harmonic is not used to correct means to midpoint values."""
REPEATS = {"u_m": 1e-4, "v_m_s": 1e-3, "a_m_s2": 3e-2}
"""Maximum deviation of a repeating motion from its mean cycle, relative to the root mean square."""
FEWEST_SPREAD_PHASES = 64
"""Minimum number of intervals per cycle, unless all samples are at the midpoints: fewer lose too many beside a jump."""
MOST_DEVIATIONS = 5.0
"""Maximum deviation of the chi-square statistic of the residuals within the intervals (standard deviations)."""
LEAST_SPREAD = 0.1
"""Minimum standard deviation of the distances from the midpoint (intervals) for a mean to be checked.

Below it, a slow drift between the clocks would correlate with a drift of the force."""
FEWEST_OF_MEAN = 0.5
"""Fraction of the usual number of samples below which a mean is ignored."""


def mean_cycles(test: Measurement) -> Measurement:
    """Convert a long test with a repeating motion to mean cycles; return any other test unchanged."""
    if test.u_m.size <= LONG or test.waveform not in WAVEFORMS or test.samples_per_cycle < 1:
        return test
    if test.commanded_A is not None or float(np.ptp(test.current_A)) > 0.0:
        return test
    places = _Places.of(test)
    known = abs(places.period - test.samples_per_cycle) <= SAME_PERIOD * places.period
    if not known or test.u_m.size < FEWEST_AVERAGED * places.groups * places.phases:
        return test
    motion = _motion(test, places)
    averaged = None if motion is None else _averaged(test, places, motion)
    return test if averaged is None else averaged


def _averaged(test: Measurement, places: _Places, motion: Mapping[str, FloatArray]) -> Measurement | None:
    """The averaged test, with the motion of the mean cycle; None if the means do not resolve the force."""
    sums, scored = _Sums(places.groups, places.phases, 1), test.scored
    for rows, group, phase, apart in _pieces(test, places):
        some = scored[rows]
        sums.add(group[some], phase[some], apart[some], (test.force_N[rows][some],))
    (curve,), (apart_mean, square, means_N) = sums.curves(noisy=True), sums.means()
    known = sums.counts >= FEWEST_OF_MEAN * float(np.median(sums.counts[sums.counts > 0.0]))
    force_N = np.where(known, means_N - curve.slope * apart_mean - 0.5 * curve.bend * square, 0.0)
    squares_N2, count = 0.0, float(np.sum(sums.counts[known]))
    spread = math.sqrt(float(np.sum((square * sums.counts)[known])) / count) > TIE_FRACTION
    if spread and places.phases < FEWEST_SPREAD_PHASES:
        return None
    within = _IntervalResiduals(places)
    for rows, group, phase, apart in _pieces(test, places):
        some = scored[rows] & known[group, phase]
        expected_N = force_N[group, phase] + curve.beside(phase, apart)
        residual_N = (test.force_N[rows] - expected_N)[some]
        squares_N2 += float(np.sum(residual_N**2))
        if spread:
            within.add(group[some], phase[some], apart[some], residual_N)
    if spread and not within.are_random(math.sqrt(squares_N2 / count)):
        return None
    both, noise_N = known[:-1] & known[1:], math.nan
    if np.any(both):
        noise_N = repeat_scatter_N(force_N[:-1][both], force_N[1:][both], math.sqrt(2.0))
    samples = count / np.count_nonzero(known)
    numbers = {"cycles": places.cycles, "groups": places.groups, "phases": places.phases, "each": samples}
    noise_N = math.hypot(noise_N, test.time_noise_N)
    whole: dict[str, Any] = {name: np.tile(values, places.groups) for name, values in motion.items()}
    return replace(
        test, **whole,
        force_N=force_N.ravel(), current_A=np.full(force_N.size, float(test.current_A[0])),
        dt_s=test.dt_s * places.period / places.phases, samples_per_cycle=places.phases,
        usable=None if bool(np.all(known)) else known.ravel(), temperature_degC=_temperature_degC(test, places),
        means=MeanCycles(
            samples, math.sqrt(squares_N2 / count), noise_N, test.peak_force_N, spread, places.cycles / places.groups
        ),
        warnings=(*test.warnings, say("mean-cycles", samples=test.u_m.size, **numbers)),
    )  # fmt: skip


def _temperature_degC(test: Measurement, places: _Places) -> FloatArray | None:
    """Mean recorded temperature (degC) for each mean; None if it was not recorded."""
    if test.temperature_degC is None:
        return None
    sums = _Sums(places.groups, places.phases, 1)
    for rows, group, phase, apart in _pieces(test, places):
        sums.add(group, phase, apart, (test.temperature_degC[rows],))
    return np.ravel(sums.means()[2])


@dataclass(frozen=True)
class _Places:
    """Assignment of samples to groups of successive cycles and to phase intervals.

    Attributes:
        period: samples in a cycle, not rounded.
        cycles: whole cycles of the test.
        phases: intervals of a cycle.
        groups: groups of cycles.
    """

    period: float
    cycles: int
    phases: int
    groups: int

    @classmethod
    def of(cls, test: Measurement) -> _Places:
        """Assignment for a test; as many intervals as possible have the same number of samples."""
        period = samples_a_cycle(test.u_m)
        cycles = max(1, int(test.u_m.size / period + TIE_FRACTION))
        phases = max(1, round(period / math.ceil(period / MOST_PHASES)))
        together = max(1, cycles // max(FEWEST_GROUPS, KEPT // phases))
        return cls(period, cycles, phases, max(1, cycles // together))

    def at(self, rows: slice) -> tuple[NDArray[np.int64], NDArray[np.int64], FloatArray]:
        """Group and interval of samples, and their distance from its midpoint (in intervals), shape (n,) each."""
        place = np.arange(rows.start, rows.stop) * (self.phases / self.period)
        whole = np.floor(place + 0.5 - TIE_FRACTION).astype(np.int64)
        cycle = np.minimum(whole // self.phases, self.cycles - 1)
        return cycle * self.groups // self.cycles, whole % self.phases, place - whole


class _Sums:
    """Sums over the samples in each group and interval: count, distances from the midpoint, columns of values."""

    def __init__(self, groups: int, phases: int, columns: int) -> None:
        self._sums = np.zeros((columns + 3, groups, phases))

    def add(
        self, group: NDArray[np.int64], phase: NDArray[np.int64], apart: FloatArray, columns: Sequence[FloatArray]
    ) -> None:
        """Add samples, (n,) each."""
        _, groups, phases = self._sums.shape
        cell = group * phases + phase
        for sums, values in zip(self._sums, (None, apart, apart**2, *columns), strict=True):
            sums += np.bincount(cell, values, groups * phases).reshape(groups, phases)

    @property
    def counts(self) -> FloatArray:
        """Number of samples in each group and interval, (groups, phases)."""
        counts: FloatArray = self._sums[0]
        return counts

    @property
    def columns(self) -> FloatArray:
        """Sums of the columns in each group and interval, (columns, groups, phases)."""
        return np.asarray(self._sums[3:])

    def means(self) -> FloatArray:
        """Mean distance, square distance and columns, (columns + 2, groups, phases); 0 without samples."""
        return np.asarray(self._sums[1:] / np.maximum(self.counts, 1.0))

    def curves(self, *, noisy: bool) -> list[_Curve]:
        """Each column over the cycle, for all groups; with `noisy`, curvature from significant harmonics only."""
        total = self._sums.sum(axis=1)
        seen = np.flatnonzero(total[0])
        apart, square, *columns = (
            np.interp(np.arange(total.shape[1]), seen, row[seen] / total[0][seen], period=total.shape[1])
            for row in total[1:]
        )
        return [_Curve.through(values, apart, square, noisy=noisy) for values in columns]


@dataclass(frozen=True)
class _Curve:
    """A value over the cycle, (phases,): at the midpoint of each interval, with slope and curvature (per interval)."""

    values: FloatArray
    slope: FloatArray
    bend: FloatArray

    @classmethod
    def through(cls, means: FloatArray, apart: FloatArray, square: FloatArray, *, noisy: bool) -> _Curve:
        """The curve with these means, for samples with these mean distances and mean square distances."""
        curve = cls._of(means, noisy=noisy)
        for _ in range(MIDPOINT_ITERATIONS):
            curve = cls._of(means - curve.slope * apart - 0.5 * curve.bend * square, noisy=noisy)
        return curve

    @classmethod
    def _of(cls, values: FloatArray, *, noisy: bool) -> _Curve:
        smooth = _significant_harmonics(values) if noisy else values
        before2, before, after, after2 = (np.roll(smooth, by) for by in (2, 1, -1, -2))
        slope = (8.0 * (after - before) - (after2 - before2)) / 12.0
        return cls(values, slope, (16.0 * (after + before) - (after2 + before2) - 30.0 * smooth) / 12.0)

    def at(self, phase: NDArray[np.int64], apart: FloatArray) -> FloatArray:
        """The value at distances (n,) from the midpoints of intervals (n,)."""
        return np.asarray(self.values[phase] + self.beside(phase, apart))

    def beside(self, phase: NDArray[np.int64], apart: FloatArray) -> FloatArray:
        """Difference between the value at distances (n,) and that at the midpoints of intervals (n,)."""
        return np.asarray((self.slope[phase] + 0.5 * self.bend[phase] * apart) * apart)


class _IntervalResiduals:
    """Residuals of the samples within the phase intervals, tested for structure that the means do not resolve.

    Each residual is multiplied by the side of the midpoint on which the sample is, and by its squared distance from
    the midpoint. For a resolved force, the sums of these products over all groups are random.
    """

    def __init__(self, places: _Places) -> None:
        self._sums = [_Sums(places.groups, places.phases, 3) for _ in range(2)]

    def add(
        self, group: NDArray[np.int64], phase: NDArray[np.int64], apart: FloatArray, residual_N: FloatArray
    ) -> None:
        """Add samples and their residuals (N), shape (n,) each."""
        for sums, shape in zip(self._sums, (np.sign(apart), apart**2), strict=True):
            sums.add(group, phase, apart, (residual_N * shape, shape, shape**2))

    def are_random(self, scatter_N: float) -> bool:
        """Whether the residuals are random, that is, whether the means resolve the force.

        The variance of a product is estimated by the median over single groups, because correlated noise increases it.

        Args:
            scatter_N: standard deviation of the samples about the means (N).
        """
        for sums in self._sums:
            products, total, squares = sums.columns
            apart, square, *_ = sums.means()
            power = squares - total**2 / np.maximum(sums.counts, 1.0)
            checked = (square - apart**2 > LEAST_SPREAD**2) & (power > 1e-6)
            if not np.any(checked):
                continue
            power = np.where(checked, power, 0.0) * scatter_N**2
            single = float(np.median(products[checked] ** 2 / power[checked])) / MEDIAN_OF_NORMAL**2
            products, power = np.where(checked, products, 0.0).sum(axis=0), power.sum(axis=0)
            seen = power > 0.0
            together = products[seen] ** 2 / (max(single, 1.0) * power[seen])
            if float(np.sum(together)) > together.size + MOST_DEVIATIONS * math.sqrt(2.0 * together.size):
                return False
        return True


def _significant_harmonics(values: FloatArray) -> FloatArray:
    """Harmonics of a curve above its noise; noise would bend the curve of all groups, like a misfit."""
    spectrum = np.fft.rfft(values)
    power = np.abs(spectrum) ** 2
    noise = float(np.median(power[power.size // 2 :])) / MEDIAN_OF_EXPONENTIAL
    return np.fft.irfft(np.where(power > OUT_OF_NOISE * noise, spectrum, 0.0), values.size)


def _pieces(
    test: Measurement, places: _Places
) -> Iterator[tuple[slice, NDArray[np.int64], NDArray[np.int64], FloatArray]]:
    """Iterate over the samples in pieces: rows, group, interval, distance."""
    for rows in test.pieces():
        yield rows, *places.at(rows)


def _motion(test: Measurement, places: _Places) -> dict[str, FloatArray] | None:
    """Motion of the mean cycle, (phases,) each; None if the motion does not repeat."""
    names = [name for name in MOTION if getattr(test, name) is not None]
    sums = _Sums(1, places.phases, len(names))
    for rows, group, phase, apart in _pieces(test, places):
        sums.add(np.zeros_like(group), phase, apart, [getattr(test, name)[rows] for name in names])
    curves = dict(zip(names, sums.curves(noisy=False), strict=True))
    for name, share in REPEATS.items():
        left = size = 0.0
        for rows, _, phase, apart in _pieces(test, places):
            values = getattr(test, name)[rows]
            left += float(np.sum((values - curves[name].at(phase, apart)) ** 2))
            size += float(np.sum(values**2))
        if left > share**2 * size:
            return None
    return {name: curve.values for name, curve in curves.items()}

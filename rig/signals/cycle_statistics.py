"""Statistics of every cycle of a long cyclic test: peak forces, energy, stiffness, friction, mean force, temperature.

All cycles are computed at once (`numpy.add.reduceat`), a few microseconds each: an endurance test has millions. Force
is described cycle by cycle as `F = c v + f sign(v) + k x + m` by least squares over the samples that move faster than
`SLOW_SHARE` of the cycle's peak speed: slower ones show how the friction reverses, not its level. Where the speed is
constant between the corners (a triangle), `c` and `f` cannot be distinguished, and both are not-a-number.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from rig.signals.arrays import BoolArray, FloatArray, IntArray
from rig.signals.cycles import CROSSING_HYSTERESIS, at_full_amplitude
from rig.signals.spikes import median_of_three

SLOW_SHARE = 0.3
"""Of a cycle's peak speed, below which a sample says nothing of the friction."""
SPEED_SCATTER = 0.05
"""Least standard deviation of the speed of these samples, of their mean; below it viscous force looks like friction."""
FEWEST_SAMPLES = 12
"""In a cycle; with fewer its force is not described."""
COMPLETE_SHARE = 0.9
"""Of the usual number of samples in a cycle: a cycle with fewer was not recorded."""
STEPS_A_CYCLE = 40
"""Steps of the differences that speed is computed from, in a period of the motion's highest frequency."""
EXTREME_SHARE = 1e-3
"""Of the samples that may be extreme at each end without moving the mean displacement."""
ONE_CYCLE = 1.5
"""Periods from which two crossings are more than one cycle apart: samples between them are missing."""

MIDDLE_PERIODS = 2.0
"""Over which the middle of the motion is taken where it drifts."""
DRIFTED = 0.3
"""Of the amplitude: a larger difference of the middles is a drift; ramps and noise are less."""

UNITS: Mapping[str, tuple[str, str]] = {
    "start": ("s", "Start of the cycle"),
    "period": ("s", "Duration"),
    "displacement_max": ("m", "Largest displacement"),
    "displacement_min": ("m", "Smallest displacement"),
    "force_max": ("N", "Largest force (rebound)"),
    "force_min": ("N", "Smallest force (compression)"),
    "energy": ("J", "Energy dissipated"),
    "stiffness": ("N/m", "Stiffness: force per displacement"),
    "damping": ("N s/m", "Viscous damping: force per speed"),
    "friction": ("N", "Friction: force that reverses with the direction"),
    "mean_force": ("N", "Mean force at mid-travel (gas force where rebound and compression are symmetric)"),
    "current": ("A", "Mean coil current"),
    "temperature": ("degC", "Mean coil temperature"),
}
"""Statistic -> unit and one line for people."""


class CycleSamples(NamedTuple):
    """Aligned samples (n,), SI; not-a-number where nothing was measured."""

    time_s: FloatArray
    displacement_m: FloatArray
    force_N: FloatArray
    current_A: FloatArray
    temperature_degC: FloatArray


class CycleBounds(NamedTuple):
    """Where cycles lie.

    Attributes:
        start_s: starts of the cycles and the end of the last, (k + 1,), s.
        cycles: number of cycles between two of them, (k,): 1; more where samples are missing.
    """

    start_s: FloatArray
    cycles: IntArray

    @property
    def run(self) -> int:
        """Cycles that were run."""
        return int(np.sum(self.cycles))


NO_CYCLES = CycleBounds(np.zeros(0), np.zeros(0, np.int64))


def cycle_bounds(time_s: FloatArray, displacement_m: FloatArray, frequency_Hz: float) -> CycleBounds:
    """The cycles at full amplitude, by the upward crossings of the mean displacement; ramps are left out.

    Args:
        time_s: (n,) s, increasing.
        displacement_m: (n,) m; not-a-number where nothing was measured.
        frequency_Hz: of the motion.

    Returns:
        `NO_CYCLES` where the motion never reached full amplitude.
    """
    usable = np.isfinite(displacement_m)
    # A spike of one sample trips no interlock; it must not hide the cycles of a block of ten minutes.
    t, u = time_s[usable], median_of_three(displacement_m[usable])
    if t.size < FEWEST_SAMPLES:
        return NO_CYCLES
    middle_m, half_m = _middle(t, u, MIDDLE_PERIODS / frequency_Hz)
    starts_s, indices = _rising(t, u - middle_m, CROSSING_HYSTERESIS * half_m)
    if starts_s.size < 2:
        return NO_CYCLES
    highest, lowest = np.maximum.reduceat(u, indices)[:-1], np.minimum.reduceat(u, indices)[:-1]
    amplitude_m = 0.5 * (highest - lowest)
    full = np.flatnonzero(at_full_amplitude(amplitude_m, float(np.max(median_of_three(amplitude_m)))))
    if full.size == 0:
        return NO_CYCLES
    bounds_s = starts_s[full[0] : full[-1] + 2]
    spans = np.diff(bounds_s) * frequency_Hz
    return CycleBounds(bounds_s, np.where(spans > ONE_CYCLE, np.round(spans), 1.0).astype(np.int64))


def _middle(t: FloatArray, u: FloatArray, span_s: float) -> tuple[FloatArray, float]:
    """Middle of the motion at each sample (n,), and half its height: of the whole, or of spans where its mean drifts.

    A position loop that loses its zero moves away until the limit of the stroke stops it: its last cycles no longer
    cross the middle of the whole.
    """
    low, high = np.quantile(u, (EXTREME_SHARE, 1.0 - EXTREME_SHARE))
    middle, half = np.full(t.size, 0.5 * (low + high)), 0.5 * float(high - low)
    edges = np.searchsorted(t, np.arange(t[0], t[-1] - 0.5 * span_s, span_s))
    if edges.size < 2:
        return middle, half
    filled = np.unique(edges)
    highs, lows = np.maximum.reduceat(u, filled), np.minimum.reduceat(u, filled)
    middles, height = 0.5 * (highs + lows), float(np.median(0.5 * (highs - lows)))
    if np.ptp(middles) <= DRIFTED * height:
        return middle, half
    centres_s = 0.5 * (t[filled] + t[np.append(filled[1:], t.size) - 1])
    ends_s = np.array([2.0 * centres_s[0] - centres_s[1], *centres_s, 2.0 * centres_s[-1] - centres_s[-2]])
    ends = np.array([2.0 * middles[0] - middles[1], *middles, 2.0 * middles[-1] - middles[-2]])
    return np.interp(t, ends_s, ends), height


def _rising(t: FloatArray, x: FloatArray, band: float) -> tuple[FloatArray, IntArray]:
    """Upward zero crossings (s), by the line through the samples beside the hysteresis, and the sample after each."""
    marked = np.flatnonzero(np.abs(x) > band)
    up = x[marked] > 0.0
    rising = np.flatnonzero(~up[:-1] & up[1:])
    low, high = marked[rising], marked[rising + 1]
    share = -x[low] / (x[high] - x[low])
    starts_s = t[low] + share * (t[high] - t[low])
    return starts_s, np.searchsorted(t, starts_s, side="left").astype(np.int64)


def repeated_bounds(first_s: float, period_s: float, end_s: float, most: int) -> CycleBounds:
    """Cycles of a signal that is repeated: each one `period_s` long.

    Args:
        first_s: start of the first cycle (s).
        period_s: duration of a cycle (s).
        end_s: when the motion ended (s): a cycle that goes beyond was not completed.
        most: cycles at most.
    """
    whole = int(min(most, max(0.0, np.floor((end_s - first_s) / period_s + 1e-3))))
    if whole == 0:
        return NO_CYCLES
    return CycleBounds(first_s + period_s * np.arange(whole + 1.0), np.ones(whole, np.int64))


def cycle_statistics(
    samples: CycleSamples, bounds: CycleBounds, usual_samples: float, *, fastest_samples: float | None = None,
    speed_varies: bool = True,
) -> dict[str, FloatArray]:
    """The statistics of each cycle, arrays (k,) by the names of `UNITS`, not-a-number where they cannot be determined.

    Args:
        samples: those from the first cycle's start to the last one's end, or more.
        bounds: of the cycles.
        usual_samples: in a cycle; a cycle in which more than a tenth of them is missing has no statistics.
        fastest_samples: in a period of the motion's highest frequency, from which speed is computed; None: in a cycle.
        speed_varies: within a half cycle, so that friction can be distinguished from viscous force.
    """
    if len(bounds.cycles) == 0:
        return {name: np.zeros(0) for name in UNITS}
    edges = np.searchsorted(samples.time_s, bounds.start_s, side="left")
    inside = slice(int(edges[0]), int(edges[-1]))
    sums = _Sums(edges[:-1] - edges[0], inside.stop - inside.start)
    speed_m_s = _speed(samples.time_s, samples.displacement_m, fastest_samples or usual_samples)[inside]
    x, force_N, current_A, temperature_degC = (values[inside] for values in samples[1:])
    good = np.isfinite(x) & np.isfinite(force_N)
    complete = (sums.of(good.astype(np.float64)) >= max(FEWEST_SAMPLES, COMPLETE_SHARE * usual_samples)) & (
        bounds.cycles == 1
    )
    known = good & np.isfinite(speed_m_s)
    force, displacement, speed = (np.where(known, column, 0.0) for column in (force_N, x, speed_m_s))
    smooth_N = median_of_three(force_N)
    values = {
        "start": bounds.start_s[:-1], "period": np.diff(bounds.start_s),
        "displacement_max": sums.greatest(np.where(good, x, -np.inf)),
        "displacement_min": -sums.greatest(np.where(good, -x, -np.inf)),
        "force_max": sums.greatest(np.where(good, smooth_N, -np.inf)),
        "force_min": -sums.greatest(np.where(good, -smooth_N, -np.inf)),
        "energy": _energy_J(samples, bounds.start_s),
        **_described(sums, known, displacement, speed, force, speed_varies=speed_varies),
        "current": sums.mean(current_A), "temperature": sums.mean(temperature_degC),
    }
    return {
        name: value if name in {"start", "period"} else np.where(complete & np.isfinite(value), value, np.nan)
        for name, value in values.items()
    }


def _speed(time_s: FloatArray, displacement_m: FloatArray, period_samples: float) -> FloatArray:
    """Speed of each sample (n,), m/s: five-point difference, whose step grows with the samples in a period.

    Of a sine it loses (2 pi step / samples in a cycle)^4 / 30, at most 0.02 %; not-a-number beside missing samples.
    """
    speed = np.full(time_s.size, np.nan)
    step = max(1, round(period_samples / STEPS_A_CYCLE))
    if time_s.size <= 4 * step:
        return speed
    x, middle = displacement_m, slice(2 * step, -2 * step)
    near = x[3 * step : -step] - x[step : -3 * step]
    far = x[4 * step :] - x[: -4 * step]
    wide_s = time_s[4 * step :] - time_s[: -4 * step]
    usual_s = float(np.median(wide_s))
    speed[middle] = np.where(wide_s < 1.2 * usual_s, (8.0 * near - far) / (3.0 * wide_s), np.nan)
    return speed


def _energy_J(samples: CycleSamples, start_s: FloatArray) -> FloatArray:
    """Energy of each cycle (k,), the integral of force over displacement; over missing samples a straight line."""
    good = np.isfinite(samples.displacement_m) & np.isfinite(samples.force_N)
    time_s, x, force_N = samples.time_s[good], samples.displacement_m[good], samples.force_N[good]
    if time_s.size < 2:
        return np.full(start_s.size - 1, np.nan)
    work_J = np.concatenate(([0.0], np.cumsum(0.5 * (force_N[1:] + force_N[:-1]) * np.diff(x))))
    return np.diff(np.interp(start_s, time_s, work_J))


class _Sums:
    """Sums over the samples of each cycle; cycles lie end to end."""

    def __init__(self, first: IntArray, samples: int) -> None:
        lengths = np.diff(first, append=samples)
        self._empty = lengths == 0
        self._first = np.minimum(first, max(0, samples - 1))
        self._lengths = lengths

    def of(self, values: FloatArray) -> FloatArray:
        """Sum of values (n,) over each cycle (k,)."""
        return self._without(np.add.reduceat(values, self._first), 0.0) if values.size else self._none()

    def greatest(self, values: FloatArray) -> FloatArray:
        """Greatest value of each cycle."""
        return self._without(np.maximum.reduceat(values, self._first), -np.inf) if values.size else self._none()

    def mean(self, values: FloatArray) -> FloatArray:
        """Mean of the known values of each cycle; not-a-number without any."""
        known = np.isfinite(values)
        with np.errstate(invalid="ignore"):
            return self.of(np.where(known, values, 0.0)) / self.of(known.astype(np.float64))

    def spread(self, values: FloatArray) -> FloatArray:
        """A value of each cycle (k,) at each of its samples (n,)."""
        return np.repeat(values, self._lengths)

    def _without(self, values: FloatArray, nothing: float) -> FloatArray:
        return np.where(self._empty, nothing, values)

    def _none(self) -> FloatArray:
        return np.full(self._first.size, np.nan)


def _described(
    sums: _Sums, good: BoolArray, x: FloatArray, v: FloatArray, force: FloatArray, *, speed_varies: bool
) -> dict[str, FloatArray]:
    """`damping`, `friction`, `stiffness` and `mean_force` of each cycle, by least squares."""
    top = sums.greatest(np.abs(v))
    highest, lowest = sums.greatest(np.where(good, x, -np.inf)), -sums.greatest(np.where(good, -x, -np.inf))
    known = np.isfinite(highest) & np.isfinite(lowest)
    middle = 0.5 * (np.where(known, highest, 0.0) + np.where(known, lowest, 0.0))
    fast = (good & (np.abs(v) >= SLOW_SHARE * sums.spread(top))).astype(np.float64)
    count = sums.of(fast)
    scale_v = np.where(top > 0.0, top, 1.0)
    half = np.maximum(highest - middle, 1e-12)
    columns = [
        v / sums.spread(scale_v), np.sign(v), (x - sums.spread(middle)) / sums.spread(half), np.ones(x.size),
    ]  # of the order of 1, so that the equations are well conditioned
    normal = np.empty((count.size, 4, 4))
    right = np.empty((count.size, 4))
    for row, first in enumerate(columns):
        weighted = first * fast
        right[:, row] = sums.of(weighted * force)
        for column in range(row, 4):
            normal[:, row, column] = normal[:, column, row] = sums.of(weighted * columns[column])
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_speed = sums.of(fast * np.abs(columns[0])) / count
        scatter = np.sqrt(np.maximum(normal[:, 0, 0] / count - mean_speed**2, 0.0)) / mean_speed
    enough = count >= FEWEST_SAMPLES // 2
    apart = enough & (scatter > SPEED_SCATTER) & speed_varies
    four = _solved(normal, right, apart)
    three = _solved(normal[:, 1:, 1:], right[:, 1:], enough & ~apart)  # friction and damping together first
    stiffness = np.where(apart, four[:, 2], three[:, 1]) / half
    return {
        "stiffness": stiffness, "damping": four[:, 0] / scale_v, "friction": four[:, 1],
        "mean_force": np.where(apart, four[:, 3], three[:, 2]),
    }


def _solved(normal: FloatArray, right: FloatArray, usable: BoolArray) -> FloatArray:
    """Solutions of the cycles' normal equations (k, m); not-a-number where they are not to be solved."""
    solution = np.full(right.shape, np.nan)
    trace = np.trace(normal, axis1=1, axis2=2)
    usable = usable & (trace > 0.0) & np.all(np.isfinite(normal), axis=(1, 2))
    if np.any(usable):
        size = normal.shape[1]
        lifted = normal[usable] + 1e-12 * trace[usable, None, None] * np.eye(size)
        solution[usable] = np.linalg.solve(lifted, right[usable][:, :, None])[:, :, 0]
    return solution

"""Cycles as they were measured: crossings of the mean, amplitude, phase and distortion, cycle by cycle.

Nothing here trusts nominal times: ramps, rests and the rig's own lag are told from the measured displacement. The
recording's file and the campaign's amplitude compensation measure with the same functions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigError
from rig.signals.arrays import BoolArray, FloatArray
from rig.signals.derivatives import harmonic_columns
from rig.signals.waveform import SINE, TRIANGLE, Waveform, waveform_named

CROSSING_HYSTERESIS = 0.2  # of the amplitude: noise around the mean makes no crossing
FEWEST_OF_A_SIDE = 3
OWN_ROUNDS = 3
KINK, KINK_ERRORS = 0.1, 4.0
"""Relative difference of the slopes on both sides of a crossing, and its standard errors, from which it is a kink."""
EVEN_SLOPE = 0.7
"""Minimum ratio of the slopes at a crossing for which a record counts as cut there (the motion did not start at
rest)."""
CUT_SAMPLES, CUT_SHARE = 1.25, 0.1
"""A record counts as cut at a crossing if the crossing is at most this number of samples, or this fraction of the
hysteresis, outside."""
FULL_AMPLITUDE = 0.97  # of the typical greatest amplitude: below it a cycle belongs to a ramp
HARMONICS = 9
PEAK_SHARE = 0.04
"""Half width, as a share of the period, of the parabola that finds a sine's peak."""
MOST_FOLDED = 8000
MOST_ORDERS = 100
SERIES_SHARE = 0.4
"""Of the orders that the widest gap between the phases of all samples would resolve."""
LAST_ORDERS = 6
GRID = 4000
WORST_CONDITION = 5.0
"""Samples that fall on few phases of the period (1.4 when evenly spread) leave the phase open."""
FEWEST_SAMPLES = 2 * HARMONICS + 4
WIDEST_GAP = 2.5
"""Between samples of a cycle, of their mean distance."""
SAMPLES_OF_NORMAL_EQUATIONS = 60
"""Of a cycle without gaps, from which its harmonics are well conditioned and need no singular values."""


class NoCycles(RigError):
    """The displacement holds fewer whole cycles than were asked for."""


@dataclass(frozen=True)
class Cycles:
    """Whole measured cycles, end to end.

    Attributes:
        start_s: upward crossings of the mean (s), shape (k + 1,); cycle i lies between i and i + 1.
        amplitude_m: half of the peak-to-peak displacement of each cycle (m), shape (k,).
        mean_m: the level that was crossed (m).
    """

    start_s: FloatArray
    amplitude_m: FloatArray
    mean_m: float

    @property
    def frequency_Hz(self) -> FloatArray:
        """Frequency of each cycle (Hz), shape (k,)."""
        return 1.0 / np.diff(self.start_s)

    def __len__(self) -> int:
        return self.amplitude_m.size

    def between(self, first: int, last: int) -> Cycles:
        """Cycles `first` up to, not including, `last`."""
        return Cycles(self.start_s[first : last + 1], self.amplitude_m[first:last], self.mean_m)


def find_cycles(time_s: FloatArray, displacement_m: FloatArray, *, mean_m: float | None = None) -> Cycles:
    """Every whole cycle of a recording.

    Args:
        time_s: sample times (s), increasing, shape (n,).
        displacement_m: displacement (m), shape (n,); not-a-number samples are skipped.
        mean_m: level to cross (m); by default the mean over the whole full-amplitude cycles.

    Raises:
        NoCycles: the displacement crosses its mean upwards less than twice.
    """
    usable = np.isfinite(displacement_m) & np.isfinite(time_s)
    t, u = np.asarray(time_s)[usable], np.asarray(displacement_m)[usable]
    if t.size < 8:
        raise NoCycles(f"{t.size} usable displacement samples; at least 8 are required to find a cycle")
    level = float(np.max(u) + np.min(u)) / 2.0 if mean_m is None else mean_m
    cycles = _cycles_about(t, u, level)
    if mean_m is not None:
        return cycles
    full = full_cycles(cycles)
    whole = (t >= full.start_s[0]) & (t < full.start_s[-1])
    return _cycles_about(t, u, float(np.mean(u[whole])))


def full_cycles(cycles: Cycles) -> Cycles:
    """The longest unbroken stretch of cycles at full amplitude: ramps and stray movements left out.

    Raises:
        NoCycles: no two cycles agree on an amplitude, as in a test stopped while it ramped in.
    """
    full = at_full_amplitude(cycles.amplitude_m, float(np.max(cycles.amplitude_m)))
    edges = np.diff(np.concatenate(([0], full.astype(np.int8), [0])))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if starts.size == 0:
        raise NoCycles(f"none of {len(cycles)} cycles reaches full amplitude: the motion was still ramping")
    longest = int(np.argmax(stops - starts))
    return cycles.between(int(starts[longest]), int(stops[longest]))


def at_full_amplitude(amplitude_m: FloatArray, largest_m: float) -> BoolArray:
    """Which cycles (k,) are at full amplitude: near the typical one of those that are nearly as large as the largest.

    Args:
        amplitude_m: of each cycle (k,), m.
        largest_m: the largest one, or what counts as that (m).
    """
    typical = float(np.median(amplitude_m[amplitude_m >= 0.8 * largest_m]))
    return np.asarray(np.abs(amplitude_m - typical) <= (1.0 - FULL_AMPLITUDE) * typical)


def kept_cycles(cycles: Cycles, *, drop_first: int = 1, drop_last: int = 1) -> Cycles:
    """The full-amplitude cycles a fit uses: the first and the last are dropped, as in the c-FOA paper, section 2.1.

    Raises:
        NoCycles: nothing is left after dropping.
    """
    full = full_cycles(cycles)
    if len(full) <= drop_first + drop_last:
        raise NoCycles(
            f"{len(full)} cycles at full amplitude; more than {drop_first + drop_last} are required, because the first "
            f"{drop_first} and the last {drop_last} are discarded"
        )
    return full.between(drop_first, len(full) - drop_last)


def _cycles_about(t: FloatArray, u: FloatArray, level: float) -> Cycles:
    crossings, indices = _upward_crossings(t, u - level)
    if crossings.size < 2:
        raise NoCycles(
            f"the displacement crosses its mean ({level * 1e3:.3f} mm) upwards {crossings.size} time(s); at least 2 "
            "crossings (one whole cycle) are required"
        )
    parts = [u[a:b] for a, b in pairwise(indices)]
    amplitude = np.array([(part.max() - part.min()) / 2.0 for part in parts])
    return Cycles(crossings, amplitude, level)


def _upward_crossings(t: FloatArray, x: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Times of upward zero crossings (s) and the index after each; x exceeds the hysteresis on both sides between.

    A record that was cut at a crossing has a crossing there, too: a record of exactly three cycles has four crossings.
    """
    band = CROSSING_HYSTERESIS * float(np.max(np.abs(x)))
    side = np.where(x > band, 1, np.where(x < -band, -1, 0))
    marked = np.flatnonzero(side)
    rising = np.flatnonzero(np.diff(side[marked]) > 0)
    times, indices = [], []
    for k in rising:
        low, high = int(marked[k]), int(marked[k + 1])
        root = _root(t[low : high + 1], x[low : high + 1])
        if k in {rising[0], rising[-1]}:  # another motion may lie beyond it
            root = _own_root(t[low : high + 1], x[low : high + 1], root, after=k == rising[0])
        times.append(min(max(float(root), float(t[low])), float(t[high])))
        indices.append(low + int(np.searchsorted(t[low : high + 1], times[-1], side="left")))
    if marked.size and side[marked[0]] > 0:
        first_s = _root_at_end(t[: marked[0] + 1], x[: marked[0] + 1])
        if first_s is not None:
            times.insert(0, first_s)
            indices.insert(0, int(np.searchsorted(t, first_s, side="left")))
    if marked.size and side[marked[-1]] < 0:
        last_s = _root_at_end(-t[: marked[-1] - 1 : -1], -x[: marked[-1] - 1 : -1])
        if last_s is not None:
            times.append(-last_s)
            indices.append(int(np.searchsorted(t, -last_s, side="left")))
    return np.array(times), np.array(indices, dtype=np.int64)


def _root_at_end(t: FloatArray, x: FloatArray) -> float | None:
    """Time of the zero crossing (s) at which a record was cut; None if it started at rest or was cut elsewhere.

    Args:
        t: times (s) from the cut until the motion is well above zero, shape (n,).
        x: distance from the crossed level (m), shape (n,).
    """
    if t.size < 2:
        return None
    middle = t.size // 2
    slopes = list(np.diff(x) / np.diff(t))
    if middle >= FEWEST_OF_A_SIDE:
        slopes = [float(np.polyfit(t[part] - t[0], x[part], 1)[0]) for part in (slice(middle), slice(middle, None))]
    if min(slopes) < EVEN_SLOPE * max(slopes):
        return None
    root_s = _root(t, x)
    near_s = max(CUT_SAMPLES * float(t[1] - t[0]), CUT_SHARE * float(t[-1] - t[0]))
    return root_s if root_s >= t[0] - near_s else None


def _root(t: FloatArray, x: FloatArray) -> float:
    """Where a line through rising samples is zero (s)."""
    slope, offset = np.polyfit(t - t[0], x, 1)
    return float(t[0] - offset / slope)


def _own_root(t: FloatArray, x: FloatArray, root_s: float, *, after: bool) -> float:
    """A record's first or last crossing by the cycle's own samples alone, where the slope changes at the crossing.

    A faster or slower motion before (or after) it bends the path there, and a line through both is off: by 0.5 % of a
    period between 1 and 2 Hz.
    """
    sides = [t >= root_s, t <= root_s]
    if min(map(np.count_nonzero, sides)) < FEWEST_OF_A_SIDE:
        return root_s
    slopes, variances = [], []
    for side in sides:
        slope, offset = np.polyfit(t[side] - root_s, x[side], 1)
        left = x[side] - slope * (t[side] - root_s) - offset
        spread = float(np.sum((t[side] - np.mean(t[side])) ** 2))
        slopes.append(float(slope))
        variances.append(float(np.sum(left**2)) / max(1, left.size - 2) / spread)
    apart = abs(slopes[0] - slopes[1])
    if apart <= max(KINK * 0.5 * abs(sum(slopes)), KINK_ERRORS * math.sqrt(sum(variances))):
        return root_s
    found_s = root_s
    for _ in range(OWN_ROUNDS):
        own = t >= found_s if after else t <= found_s
        if np.count_nonzero(own) < FEWEST_OF_A_SIDE or np.ptp(x[own]) == 0.0:
            return root_s
        found_s = min(max(_root(t[own], x[own]), float(t[0])), float(t[-1]))
    return found_s


@dataclass(frozen=True)
class CycleShapes:
    """Each full cycle's shape, arrays (k,).

    Attributes:
        amplitude_m: half of peak to valley, m: of a sine each found by a parabola through the samples around it; of a
            triangle, whose corners fall between samples, the cycle's fundamental times what peak to valley is of it
            over all cycles (`peak_of_fundamental`).
        mean_m: the cycle's mean (its zeroth harmonic), m.
        frequency_Hz: of each cycle.
        phase_rad: phase of the fundamental as a sine that begins at time 0 with the mean frequency, rad.
        distortion: root of the summed squares of what harmonics 2 to 9 have beyond the ideal waveform's, relative to
            the fundamental.
    """

    amplitude_m: FloatArray
    mean_m: FloatArray
    frequency_Hz: FloatArray
    phase_rad: FloatArray
    distortion: FloatArray


@dataclass(frozen=True)
class MeasuredMotion:
    """Measured motion over the full cycles.

    Attributes:
        cycles: number of full cycles.
        start_s: time of their first upward crossing of the mean; `end_s` of their last, s.
        amplitude_m: mean over the cycles of half of peak to valley; `amplitude_std_m` its scatter from cycle to cycle.
        mean_m: mean displacement over the cycles.
        frequency_Hz: cycles per second.
        waveform: the single cycles.
        fundamental_amplitude_m: amplitude of the ideal triangle with the measured fundamental, m; None of a sine.
            Corners rounded by a servo make `amplitude_m` smaller and hardly change this.
    """

    cycles: int
    start_s: float
    end_s: float
    amplitude_m: float
    amplitude_std_m: float
    mean_m: float
    frequency_Hz: float
    waveform: CycleShapes
    fundamental_amplitude_m: float | None = None


def cycle_rate_Hz(time_s: FloatArray, displacement_m: FloatArray) -> float | None:
    """Full cycles a second; None when there is not one.

    Args:
        time_s: (n,) s, increasing.
        displacement_m: (n,) m; NaN where nothing was measured.
    """
    try:
        full = full_cycles(find_cycles(time_s, displacement_m))
    except NoCycles:
        return None
    return len(full) / float(full.start_s[-1] - full.start_s[0])


def measured_motion(
    time_s: FloatArray, displacement_m: FloatArray, waveform: str = SINE.name
) -> MeasuredMotion | None:
    """Measure the motion of one point.

    Args:
        time_s: (n,) s, increasing.
        displacement_m: (n,) m; NaN where nothing was measured.
        waveform: the wanted one's name: its own harmonics are no distortion.

    Returns:
        None when there is not one full cycle.
    """
    try:
        full = full_cycles(find_cycles(time_s, displacement_m))
    except NoCycles:
        return None
    shape = waveform_named(waveform)
    start_s, end_s = float(full.start_s[0]), float(full.start_s[-1])
    frequency_Hz = len(full) / (end_s - start_s)
    usable = np.isfinite(displacement_m)
    t, u = time_s[usable], displacement_m[usable]
    bounds = np.searchsorted(t, full.start_s)
    shapes = [
        _cycle(t[a:b], u[a:b], 1.0 / (end - start), shape, frequency_Hz)
        for a, b, start, end in zip(bounds, bounds[1:], full.start_s, full.start_s[1:], strict=False)
    ]
    columns = np.array(shapes, np.float64).reshape(len(shapes), 5).T
    cycles = CycleShapes(*columns)
    fundamental_m = None
    if shape.corner_share is not None and np.any(np.isfinite(cycles.amplitude_m)):
        fundamental_m = float(np.nanmean(cycles.amplitude_m))
        phase = np.interp(t, full.start_s, np.arange(len(full) + 1.0), left=-1.0, right=-1.0)
        inside = (t >= start_s) & (t < end_s)
        rounded = shape.fundamental * peak_of_fundamental(phase[inside] % 1.0, u[inside], shape)
        cycles = replace(cycles, amplitude_m=cycles.amplitude_m * rounded)
    known = cycles.amplitude_m[np.isfinite(cycles.amplitude_m)]
    amplitude_m = known if len(known) else full.amplitude_m
    return MeasuredMotion(
        cycles=len(full), start_s=start_s, end_s=end_s, amplitude_m=float(np.mean(amplitude_m)),
        amplitude_std_m=float(np.std(amplitude_m)), mean_m=full.mean_m, frequency_Hz=frequency_Hz, waveform=cycles,
        fundamental_amplitude_m=fundamental_m,
    )


def peak_of_fundamental(phase: FloatArray, values: FloatArray, shape: Waveform = TRIANGLE) -> float:
    """Half of peak to valley of a waveform with corners over its fundamental's amplitude; of a triangle pi^2/8 (2).

    The cycles together are one Fourier series, as long as the phases they were sampled at allow. With sharp corners the
    harmonics beyond its end (of a triangle 1/k^2 of the fundamental each) are missing at the corner: they are added in
    the proportion in which the series' last ones are those of the ideal waveform; of rounded corners none are left.

    Args:
        phase: of the samples in their cycle (n,), 0 to 1.
        values: samples (n,), any unit.
        shape: the waveform.
    """
    every = -(-len(phase) // MOST_FOLDED)
    phase, values = phase[::every], values[::every]
    known = np.sort(phase)
    widest = float(np.max(np.diff(known, append=known[0] + 1.0)))
    orders = np.arange(1, max(HARMONICS, min(MOST_ORDERS, int(SERIES_SHARE / widest))) + 1)
    if len(phase) < 2 * len(orders) + 4:
        return 1.0 / shape.fundamental
    design = harmonic_columns(phase, math.tau, orders)
    # The orders are as many as the widest gap between the phases allows, so the normal equations are well conditioned.
    coefficients = np.linalg.solve(design.T @ design, design.T @ values)
    harmonics = coefficients[2::2] + 1j * coefficients[1::2]
    first = complex(harmonics[0])
    shown = np.fft.irfft(np.concatenate(([0.0], -0.5j * GRID * harmonics)), GRID)
    odd = orders[orders % 2 == 1]
    turned = np.real(harmonics[odd - 1] * np.exp(-1j * odd * math.atan2(first.imag, first.real))) / abs(first)
    ideal = np.array([shape.harmonic(order) for order in odd.tolist()])
    at_peak = np.where((odd - 1) // 2 % 2 == 0, 1.0, -1.0)
    last = slice(-LAST_ORDERS, None)
    sharp = float(np.clip(np.sum(turned[last] * ideal[last]) / np.sum(ideal[last] ** 2), 0.0, 1.0))
    missing = sharp * (1.0 / shape.fundamental - float(np.sum(at_peak * ideal)))
    return float(0.5 * np.ptp(shown)) / abs(first) + missing


def fundamental_phase(time_s: FloatArray, values: FloatArray, frequency_Hz: float) -> float | None:
    """Phase (rad) of `sin(2 pi f t + phase)` in values sampled anyhow; None where the samples do not determine it.

    Args:
        time_s: (n,) s.
        values: (n,), any unit.
        frequency_Hz: known frequency.
    """
    usable = np.isfinite(values)
    t, x = time_s[usable], values[usable]
    design = harmonic_columns(t, math.tau * frequency_Hz, np.array([1]))
    if len(t) < 8 or np.linalg.cond(design) > WORST_CONDITION:
        return None
    (_, cosine, sine), *_ = np.linalg.lstsq(design, x, rcond=None)
    return math.atan2(float(cosine), float(sine))


def wrapped(angle_rad: float) -> float:
    """An angle brought to -pi .. pi."""
    return (angle_rad + math.pi) % math.tau - math.pi


def _cycle(
    t: FloatArray, u: FloatArray, frequency_Hz: float, shape: Waveform, mean_frequency_Hz: float,
) -> tuple[float, float, float, float, float]:
    """Amplitude, mean, frequency, phase and distortion of one cycle; NaN where samples are missing."""
    expected = len(t)
    gap = float(np.max(np.diff(t))) if expected > 1 else math.inf
    widest = WIDEST_GAP / (frequency_Hz * expected) if expected else 0.0
    if expected < FEWEST_SAMPLES or gap > widest:
        return (math.nan, math.nan, frequency_Hz, math.nan, math.nan)
    orders = np.arange(1, HARMONICS + 1)
    design = harmonic_columns(t - t[0], math.tau * frequency_Hz, orders)
    whole = 1.0 / frequency_Hz - float(t[-1] - t[0]) <= widest  # none missing at the ends either
    if expected >= SAMPLES_OF_NORMAL_EQUATIONS and whole:
        coefficients = np.linalg.solve(design.T @ design, design.T @ u)
    else:
        coefficients, *_ = np.linalg.lstsq(design, u, rcond=None)
    harmonics = coefficients[2::2] + 1j * coefficients[1::2]
    first = complex(harmonics[0])
    phase = math.atan2(first.imag, first.real)
    if shape.corner_share is not None:
        amplitude_m = abs(first) / shape.fundamental
    else:
        amplitude_m = 0.5 * (_peak(t, u, frequency_Hz) + _peak(t, -u, frequency_Hz))
    turned = harmonics * np.exp(-1j * orders * phase)
    ideal = abs(first) * np.array([shape.harmonic(order) for order in orders.tolist()])
    distortion = float(np.sqrt(np.sum(np.abs(turned - ideal)[1:] ** 2))) / abs(first)
    phase = wrapped(phase - math.tau * mean_frequency_Hz * float(t[0]))
    return (amplitude_m, float(coefficients[0]), frequency_Hz, phase, distortion)


def _peak(t: FloatArray, u: FloatArray, frequency_Hz: float) -> float:
    """Height of the highest peak: vertex of a parabola through the samples around the largest one."""
    top = int(np.argmax(u))
    half = max(1, int(PEAK_SHARE * len(t)))
    low, high = top - half, top + half + 1
    if low < 0 or high > len(t):
        return float(u[top])
    x = (t[low:high] - t[top]) * frequency_Hz
    curve, slope, height = np.polyfit(x, u[low:high], 2)
    if curve >= 0.0:
        return float(u[top])
    return float(height - 0.25 * slope * slope / curve)

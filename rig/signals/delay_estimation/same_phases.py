"""What a lag is worth where every cycle is sampled at the same few phases.

A force that jumps at each reversal, sampled at 250 Hz and polled at 100 Hz in cycles of 0.4 s: every cycle gives the
same phases, so no number of cycles tells where between two of them the jump lies. The sensor's series goes through all
samples, its residual is small, its harmonics beyond half the rate are folded into the others, and the lag comes out
wrong by up to half the time between polls with a small error stated. Measured:
`docs/maintainers/decisions/skew-by-signals.md`.

So where flanks are sharp the lag is sought a second time, by phase: each sample's mean over all cycles, a cubic between
four of them, and what such a cubic is wrong by as it shows where every other sample is left out. That error belongs to
the stretch between two samples, however often the reference was read in it. How far the lags that this allows lie from
the match's is stated.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from rig.signals.arrays import FloatArray, TimeSeries
from rig.signals.delay_estimation.cycle_match import CycleStretch
from rig.signals.delay_estimation.sample_match import Match
from rig.signals.fourier import Series

LOCKED = 0.5
"""Length of the samples' mean direction about the nearest of equal phases; 0 where the phases are spread evenly."""
TOP, HIGHEST = 1.0 / 3.0, 0.45
"""Between these shares of the sampling rate harmonics tell what lies beyond, and is folded into all of them."""
RESOLVED = 0.01
"""A flank less sharp than this is known between the samples too: a damper's under a sine has half of it."""
WITHIN = 1.0 / math.sqrt(12.0)
FEWEST_PHASES, FEWEST_A_PHASE, FEWEST_REFERENCES = 8, 2, 8
CUBIC_NOISE = 1.0 + (2.0 * 9.0**2 + 2.0) / 16.0**2
"""Variance of a sample less that of the cubic between its neighbours, in variances of one."""
REACH, MOST_OF_CYCLE, MOST_S, LAGS = 4.0, 0.2, 0.03, 201
"""Lags are tried within so many times what lies between the phases, but no further than this share of a cycle, or s."""


def doubted(laid: Match, reference: TimeSeries, series: Series, sensor: TimeSeries, cycles: CycleStretch) -> Match:
    """The match with what jumps between equal phases leave open of its lag.

    Args:
        laid: all cycles together.
        reference: the controller's record (m,).
        series: the sensor's, of `cycle_series`.
        sensor: its samples (n,), NaN where there is none.
        cycles: where the motion repeats.
    """
    sampled_s, polled_s = _shared_s(sensor.time_s, cycles), _shared_s(reference.time_s, cycles)
    if sampled_s == 0.0:
        return laid
    sharp = max(_sharpness(series, 1.0 / shared_s) for shared_s in (sampled_s, polled_s) if shared_s > 0.0)
    if sharp == 0.0:
        return laid
    apart_s = math.hypot(sampled_s, polled_s)
    by_phase = laid.compliance is None and sharp > RESOLVED
    phase_s = _by_phase(laid, reference, sensor, cycles, apart_s) if by_phase else None
    # It is an error of the lag alone: how it goes with a compliance stays as it is.
    open_s = WITHIN * sharp * apart_s if phase_s is None else phase_s
    return replace(laid, lag_std_s=math.hypot(laid.lag_std_s, open_s))


@dataclass(frozen=True)
class _Phases:
    """A signal's means at equal phases of the cycle.

    Attributes:
        first: where in the cycle the first one lies, as a share of the time between two.
        means: (count,) in the signal's unit.
        noise: standard deviation of one mean.
        doubts: what a cubic is wrong by between each and the next (count,).
    """

    first: float
    means: FloatArray
    noise: float
    doubts: FloatArray

    def at(self, places: FloatArray) -> FloatArray:
        """The cubic through the four nearest at places (n,), counted in phases from the first."""
        low = np.floor(places).astype(np.int64)
        x = places - low
        before, here, after, beyond = (self.means[(low + step) % len(self.means)] for step in (-1, 0, 1, 2))
        return np.asarray(
            before * (-x * (x - 1.0) * (x - 2.0) / 6.0) + here * ((x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0)
            + after * (-(x + 1.0) * x * (x - 2.0) / 2.0) + beyond * ((x + 1.0) * x * (x - 1.0) / 6.0)
        )


def _phases(sensor: TimeSeries, cycles: CycleStretch) -> _Phases | None:
    """The sensor's samples by phase; None where a phase has too few of them."""
    inside = np.isfinite(sensor.values) & (sensor.time_s >= cycles.start_s) & (sensor.time_s < cycles.end_s)
    at_s, values = sensor.time_s[inside] - cycles.start_s, sensor.values[inside]
    count = max(1, round(cycles.period_s / float(np.median(np.diff(at_s)))))
    place = at_s / cycles.period_s * count
    first = float(np.angle(np.mean(np.exp(2j * math.pi * place)))) / math.tau
    number = np.round(place - first).astype(np.int64) % count
    many = np.bincount(number, minlength=count)
    if count < FEWEST_PHASES or many.min() < FEWEST_A_PHASE:
        return None
    means = np.bincount(number, values, count) / many
    variance = float(np.sum((values - means[number]) ** 2)) / (len(values) - count) / float(np.mean(many))
    # Of every other sample: what the cubic between them says of the one that was left out.
    near, far = np.roll(means, 1) + np.roll(means, -1), np.roll(means, 3) + np.roll(means, -3)
    missed = np.sqrt(np.maximum((means - (9.0 * near - far) / 16.0) ** 2 - CUBIC_NOISE * variance, 0.0))
    return _Phases(first, means, math.sqrt(variance), np.sqrt(missed * np.roll(missed, -1)))


def _by_phase(
    laid: Match, reference: TimeSeries, sensor: TimeSeries, cycles: CycleStretch, apart_s: float
) -> float | None:
    """How far the match's lag is from those that the sensor's phases allow (s, rms); None where they are too few."""
    phases = _phases(sensor, cycles)
    inside = np.isfinite(reference.values) & (reference.time_s >= cycles.start_s) & (reference.time_s < cycles.end_s)
    target = reference.values[inside]
    if phases is None or len(target) < FEWEST_REFERENCES:
        return None
    count = len(phases.means)
    place = (reference.time_s[inside] - cycles.start_s) / cycles.period_s * count - phases.first
    reach_s = min(REACH * apart_s, MOST_OF_CYCLE * cycles.period_s, MOST_S)
    lags_s = laid.lag_s + np.linspace(-reach_s, reach_s, LAGS)
    own = _noise(np.mod(place, count) / count, target)
    steps = lags_s / cycles.period_s * count
    squares, freedom = np.array([_misfit(phases, place + step, target, own, laid.gain) for step in steps]).T
    best = int(np.argmin(squares))
    # Two instruments never agree to their noise alone.
    lag_s, std_s = _likely(lags_s, squares / max(1.0, squares[best] / max(1.0, freedom[best])))
    return math.hypot(lag_s - laid.lag_s, std_s)


def _likely(lags_s: FloatArray, squares: FloatArray) -> tuple[float, float]:
    """Mean and standard deviation (s) of lags (n,) by what each leaves, in squares over variances."""
    weights = np.exp(-0.5 * (squares - np.min(squares)))
    weights /= weights.sum()
    lag_s = float(weights @ lags_s)
    return lag_s, math.sqrt(float(weights @ (lags_s - lag_s) ** 2))


def _noise(phase: FloatArray, values: FloatArray) -> float:
    """Standard deviation of the reference's single values, by neighbours in the order of phase (of 1)."""
    steps = np.diff(values[np.argsort(phase)])
    return max(float(np.median(np.abs(steps))) / (0.6745 * math.sqrt(2.0)), 1e-9 * float(np.ptp(values)))


def _misfit(
    phases: _Phases, place: FloatArray, target: FloatArray, own: float, gain: float
) -> tuple[float, float]:
    """What is left of the reference at one lag: sum of squares over their variances, and degrees of freedom.

    Args:
        phases: of the sensor.
        place: where the reference's values (m,) lie among them.
        target: these values.
        own: their noise.
        gain: of the sensor over the reference, about.
    """
    between = np.floor(place).astype(np.int64) % len(phases.means)
    many = np.bincount(between, minlength=len(phases.means))
    used = many > 0
    shown, seen = (
        np.bincount(between, values, len(phases.means))[used] / many[used] for values in (phases.at(place), target)
    )
    variance = own**2 / many[used] + (phases.doubts[used] ** 2 + phases.noise**2) / gain**2
    weight = 1.0 / variance
    shown -= weight @ shown / weight.sum()
    seen -= weight @ seen / weight.sum()
    slope = max(0.0, float(weight * shown @ seen) / max(float(weight * shown @ shown), 1e-300))
    return float(weight @ (seen - slope * shown) ** 2), float(len(seen) - 2)


def _shared_s(time_s: FloatArray, cycles: CycleStretch) -> float:
    """Time between phases that all cycles share (s); 0 where each has phases of its own."""
    at_s = time_s[(time_s >= cycles.start_s) & (time_s < cycles.end_s)]
    if len(at_s) < 2:
        return 0.0
    count = max(1, round(cycles.period_s / float(np.median(np.diff(at_s)))))
    place = (at_s - cycles.start_s) / cycles.period_s * count
    locked = abs(complex(np.mean(np.exp(2j * math.pi * place)))) > LOCKED
    return cycles.period_s / count if locked else 0.0


def _sharpness(series: Series, rate_Hz: float) -> float:
    """How much of the motion's jumps lies between two samples: 0 of a smooth course, 1 of steps.

    A step's harmonics fall with their order k: k |c_k| is then at the top what it is below. A flank of width w has
    k |c_k| fall the faster beyond 1 / w, and the lag is wrong by the square of what is left of it.
    """
    per_cycle = rate_Hz * math.tau / series.omega_rad_s
    orders, heights = series.orders, np.abs(series.coefficients)
    at_top = (orders > TOP * per_cycle) & (orders < HIGHEST * per_cycle)
    count = math.floor(HIGHEST * per_cycle) - math.floor(TOP * per_cycle)
    if not at_top.any():
        return 0.0
    beyond = np.maximum(heights[at_top] ** 2 - series.coefficient_std**2, 0.0) * orders[at_top] ** 2
    # A cycle whose halves mirror each other has every other order only.
    strongest = np.sort(beyond)[::-1][: max(1, count // 2)]
    return float(min(1.0, np.sum(strongest) / max(1, count // 2) / np.max(orders * heights) ** 2))

"""A sensor's samples laid over the controller's own record of the same quantity, all cycles together.

    reference(t) = a + g s(t + lag + drift (t - mean t)) + b force(t) + slow change

`s` is the sensor's own Fourier series over whole cycles (`rig.signals.fourier`), so its noise is averaged and noise
makes no slope of its own. Harmonics that only the sensor shows (hum, a line of its own) would be taken for knowledge of
the lag: the highest octaves are left out where the reference is certainly explained better without them at some lag,
and so is any order that stands out of what is left of the reference. `force` is there for the displacement alone: a
load train that gives way moves the sensor against the controller's position in proportion to the force, a delay in
proportion to the speed.

Standard deviations: of the reference's residual (white; by phase where it repeats with the cycle; by stretches where
neighbours share it: the largest that is certainly larger), of the series, and of what its harmonics beyond the last one
would add. The likelihood's profile over the reach widens them where it has further maxima.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from rig.signals.arrays import FloatArray, IntArray, TimeSeries
from rig.signals.delay_estimation.sample_match import Match, student
from rig.signals.fourier import FALSE_ALARM, FIRST_LINE, GRID, HIGHEST_SHARE, Series, series_of
from rig.signals.loop_shape import noise_of
from rig.signals.phase_sums import normal_sums

FEWEST_CYCLES = 2
FEWEST_REFERENCES = 8
FEWEST_SAMPLES = 40
NOT_REPEATING = 4.0
"""A residual of so many times the sensor's own noise means that the cycles differ."""
COARSE = 0.3
"""Noise of a resolution, as a share of its step."""
MARGIN_CYCLES = 0.1
ENOUGH_FOR_CHANGE = 60
"""Reference values from which slow changes of offset and amplitude are fitted too."""
CERTAIN = 8.0
"""By so much must leaving octaves out raise twice the logarithm of the likelihood."""
ROUNDS_OF_LINES = 3
ALONE = 0.3
"""Of an order's own amplitude is left of the reference where the reference does not have it."""
ENOUGH_A_WAVE = 3
"""Values of the reference for each wave of the highest order, from which one that stands alone is told."""
LAGS = 121
MOST_FOR_SEARCH = 1200
ROUNDS = 20
CONVERGED_S = 1e-8
LARGEST_STEP = 0.02
PHASE_BINS = 40
STRETCHES_A_CYCLE = 10
OUTLIER = 6.0
HARMONICS = 9
"""Of the motion, beside its frequency."""
SINGULAR = 1e-12
"""Of the columns' products, below which they tell nothing."""
LARGEST_CHANGE = 0.03
"""Relative: beyond it what the samples show of the period is not the program's."""
LARGEST_COMPLIANCE_m_N = 1e-5
"""m/N: of no load train; keeps compliance and lag apart where force and speed are proportional."""


@dataclass(frozen=True)
class CycleStretch:
    """The stretch of full amplitude: its beginning and end on the reference's clock (s), and the cycle's period (s)."""

    start_s: float
    end_s: float
    period_s: float


@dataclass(frozen=True)
class _Fit:
    """One linear step.

    Attributes:
        values: the columns' estimates (p,).
        scale: root mean square of the columns (p,); `inverse` (p, p) and `influence` (p, m) are those of columns of 1.
        rest: what is left of the reference (m,).
        shifted_s: where the series was taken (m,), s.
    """

    values: FloatArray
    scale: FloatArray
    inverse: FloatArray
    influence: FloatArray
    rest: FloatArray
    shifted_s: FloatArray


def cycle_series(time_s: FloatArray, values: FloatArray, cycles: CycleStretch) -> Series | None:
    """A sensor's samples over whole cycles as a series; None where there are too few, or the cycles differ.

    Args:
        time_s: sample times on the reference's clock (n,), s, increasing.
        values: samples (n,), NaN where there is none.
        cycles: where the motion repeats.
    """
    whole = math.floor((cycles.end_s - cycles.start_s) / cycles.period_s + 1e-6)
    inside = np.isfinite(values) & (time_s >= cycles.start_s)
    inside &= time_s < cycles.start_s + whole * cycles.period_s
    t, y = time_s[inside], values[inside]
    if whole < FEWEST_CYCLES or len(t) < FEWEST_SAMPLES or float(np.max(np.diff(t))) > 0.5 * cycles.period_s:
        return None
    series = series_of(t, y, 1.0 / cycles.period_s)
    steps = np.abs(np.diff(y))
    noise = max(noise_of(y), COARSE * float(np.min(steps[steps > 0.0], initial=np.ptp(y))))
    if series is None or series.noise > NOT_REPEATING * noise:
        return None
    return series


def refined(cycles: CycleStretch, time_s: FloatArray, values: FloatArray) -> CycleStretch:
    """The same stretch with the period that a sensor's samples (n,) show: the program's, on another clock.

    The motion's harmonics are fitted beside its frequency: what a triangle has of them is no change of the period.
    """
    inside = np.isfinite(values) & (time_s >= cycles.start_s) & (time_s < cycles.end_s)
    middle_s, half_s = 0.5 * (cycles.start_s + cycles.end_s), 0.5 * (cycles.end_s - cycles.start_s)
    t, y = (time_s[inside] - middle_s) / half_s, values[inside]
    if len(t) < FEWEST_SAMPLES or np.ptp(y) == 0.0:
        return cycles
    y = (y - np.mean(y)) / np.ptp(y)
    omega, per_cycle = math.tau / cycles.period_s, cycles.period_s / (half_s * float(np.median(np.diff(t))))
    count = max(1, min(HARMONICS, int(HIGHEST_SHARE * per_cycle)))
    orders = np.arange(1, count + 1)
    for _ in range(2):
        products, columns = normal_sums(t * (half_s * omega / math.tau), y, orders)
        (gram, with_turns, with_squares), (right, right_with_turns) = products, columns
        amplitudes = np.linalg.lstsq(gram, right, rcond=SINGULAR)[0]
        slope = np.zeros(len(right))  # of the columns times the phase: the change along the frequency
        slope[1::2], slope[2::2] = orders * amplitudes[2::2], -orders * amplitudes[1::2]
        cross = with_turns @ slope
        normal = np.block([[gram, cross[:, None]], [cross, slope @ with_squares @ slope]])
        solution = np.linalg.lstsq(normal, np.append(right, slope @ right_with_turns), rcond=SINGULAR)[0]
        omega *= 1.0 + float(solution[-1]) / math.tau
    period_s = math.tau / omega
    if not abs(period_s / cycles.period_s - 1.0) < LARGEST_CHANGE:
        return cycles
    return CycleStretch(cycles.start_s, cycles.end_s, period_s)


def match_cycles(
    reference: TimeSeries, series: Series, cycles: CycleStretch, *, reach_s: float,
    force: Series | None = None, with_drift: bool = False,
) -> Match | None:
    """Lay a sensor's series over the controller's record of the same quantity.

    Args:
        reference: the reference (m,), any unit.
        series: the sensor's, of `cycle_series`.
        cycles: where the motion repeats.
        reach_s: the lag is searched within plus and minus this (s); less than a fifth of a cycle is.
        force: the force's series, where the sensor may move against the reference in proportion to it.
        with_drift: the sensor's clock may still drift against the controller's.

    Returns:
        None when nothing is known of the lag: too few values, or no harmonic stands out of the noise.
    """
    margin_s = MARGIN_CYCLES * cycles.period_s
    inside = np.isfinite(reference.values) & (reference.time_s >= cycles.start_s + margin_s)
    inside &= reference.time_s < cycles.end_s - margin_s
    at_s, target = reference.time_s[inside], reference.values[inside]
    if len(at_s) < FEWEST_REFERENCES or len(series.orders) == 0 or series.orders[0] != 1 or np.ptp(target) == 0.0:
        return None
    reach_s = min(reach_s, 0.2 * cycles.period_s)
    nuisance = [np.ones(len(at_s))]
    if force is not None and len(force.orders):
        nuisance.append(force.at(at_s)[0])
    match, spread_s = None, 0.0
    for _ in range(ROUNDS_OF_LINES):
        chosen, lag_s, spread_s = _searched(at_s, target, series, np.column_stack(nuisance), reach_s)
        laid = _Laid(at_s, target, chosen, cycles, force, with_drift=with_drift)
        match = laid.fit(lag_s)
        alone = laid.standing_alone()
        if match is None or len(alone) == 0:
            break
        series = series.without(alone)
    if match is None:
        return None
    if spread_s > match.lag_std_s and match.lag_std_s < reach_s:
        return match.widened(spread_s)
    return match


def _searched(
    at_s: FloatArray, target: FloatArray, series: Series, nuisance: FloatArray, reach_s: float,
) -> tuple[Series, float, float]:
    """The harmonics that explain the reference, the best lag, and how far the likelihood spreads over the reach (s)."""
    thin = slice(None, None, -(-len(at_s) // MOST_FOR_SEARCH))
    basis, _ = np.linalg.qr(nuisance[thin])
    lags_s = np.linspace(-reach_s, reach_s, LAGS)
    best, best_rest = series, _rests(at_s[thin], target[thin], series, basis, lags_s)
    highest, count = int(series.orders[-1]), len(at_s[thin])
    while highest > 1:
        highest = highest // 2
        tried = series.up_to(highest)
        rest = _rests(at_s[thin], target[thin], tried, basis, lags_s)
        if count * math.log(best_rest.min() / rest.min()) > CERTAIN:
            best, best_rest = tried, rest
    likelihood = -0.5 * len(target) * np.log(best_rest / best_rest.min())
    weight = np.exp(likelihood - likelihood.max())
    weight /= weight.sum()
    lag_s = float(lags_s[int(np.argmin(best_rest))])
    spread_s = math.sqrt(float(weight @ (lags_s - lag_s) ** 2))
    return best, lag_s, spread_s


def _rests(
    at_s: FloatArray, target: FloatArray, series: Series, basis: FloatArray, lags_s: FloatArray,
) -> FloatArray:
    """Sum of squares that gain and nuisance leave of the reference, at each lag; a negative gain explains nothing."""
    table, period_s = series.table(), math.tau / series.omega_rad_s
    phase = (at_s - series.origin_s) / period_s
    places = np.mod(phase[None, :] + (lags_s / period_s)[:, None], 1.0) * GRID
    low = np.minimum(places.astype(np.int64), GRID - 1)  # the remainder of a small negative number is 1.0
    shown = table[low] + (places - low) * (table[low + 1] - table[low])
    shown -= (shown @ basis) @ basis.T
    centred = target - basis @ (basis.T @ target)
    gain = np.maximum(shown @ centred / np.maximum(np.sum(shown**2, axis=1), 1e-300), 0.0)
    return np.asarray(np.sum((centred[None, :] - gain[:, None] * shown) ** 2, axis=1) + 1e-300)


class _Laid:
    """The least-squares problem near its solution."""

    def __init__(
        self, at_s: FloatArray, target: FloatArray, series: Series, cycles: CycleStretch, force: Series | None,
        *, with_drift: bool,
    ) -> None:
        self.at_s, self.target, self.series, self.cycles = at_s, target, series, cycles
        self.force = None if force is None or len(force.orders) == 0 else force.at(at_s)[0] + force.mean
        self.with_drift = with_drift
        self.middle_s = float(np.mean(at_s))
        self.keep = np.ones(len(at_s), bool)
        self.rest = np.zeros(len(at_s))
        self.gain = 1.0

    def fit(self, lag_s: float) -> Match | None:
        """Gauss-Newton from a lag (s); None where the columns cannot be told apart."""
        drift = 0.0
        longest_s = LARGEST_STEP * self.cycles.period_s
        step = None
        for number in range(ROUNDS):
            step = self._step(lag_s, drift)
            if step is None:
                return None
            gain = step.values[1]
            if not gain > 0.0:
                return None
            move_s = float(np.clip(step.values[2] / gain, -longest_s, longest_s))
            lag_s += move_s
            if self.with_drift:
                drift += float(step.values[3] / gain)
            if number == 1:
                self.keep = np.abs(step.rest) <= OUTLIER * 1.4826 * float(np.median(np.abs(step.rest))) + 1e-300
                if np.count_nonzero(self.keep) < FEWEST_REFERENCES:
                    return None
            elif abs(move_s) < CONVERGED_S:
                break
        if step is None:
            return None
        self.rest, self.gain = step.rest, float(step.values[1])
        return self._match(step, lag_s, drift)

    def standing_alone(self) -> IntArray:
        """Orders of the series that stand out of what is left of the reference: only the sensor shows them.

        Told only where the reference's values are many for the orders.
        """
        orders = self.series.orders
        counted = orders[orders >= FIRST_LINE]
        at_s, rest = self.at_s[self.keep], self.rest
        if len(counted) == 0 or len(rest) < ENOUGH_A_WAVE * int(orders[-1]):
            return counted[:0]
        waves = np.exp(1j * np.outer(at_s - self.series.origin_s, counted * self.series.omega_rad_s))
        left = np.abs(rest @ waves) / len(rest)
        certain = left**2 > float(rest @ rest) / len(rest) ** 2 * math.log(len(counted) / FALSE_ALARM)
        return counted[
            certain & (2.0 * left > ALONE * self.gain * np.abs(self.series.coefficients[orders >= FIRST_LINE]))
        ]

    def _columns(self, shifted_s: FloatArray) -> list[FloatArray]:
        shown, slope = self.series.at(shifted_s)
        centred = (self.at_s - self.middle_s) / max(float(np.ptp(self.at_s)), 1e-9)
        columns = [np.ones(len(self.at_s)), shown + self.series.mean, slope]
        if self.with_drift:
            columns.append(slope * (self.at_s - self.middle_s))
        if self.force is not None:
            columns.append(self.force)
        if len(self.at_s) >= ENOUGH_FOR_CHANGE:
            columns += [centred, centred * shown]
        return columns

    def _step(self, lag_s: float, drift: float) -> _Fit | None:
        keep = self.keep
        shifted_s = self.at_s + lag_s + drift * (self.at_s - self.middle_s)
        design = np.column_stack(self._columns(shifted_s))[keep]
        target = self.target[keep]
        scale = np.sqrt(np.mean(design**2, axis=0))
        if np.any(scale == 0.0) or len(design) < design.shape[1] + 3:
            return None
        scaled = design / scale
        normal = scaled.T @ scaled
        if self.force is not None:
            at = 4 if self.with_drift else 3
            rest = target - scaled @ np.linalg.lstsq(scaled, target, rcond=None)[0]
            normal[at, at] += float(rest @ rest) / len(rest) / (LARGEST_COMPLIANCE_m_N * scale[at]) ** 2
        try:
            inverse = np.linalg.inv(normal)
        except np.linalg.LinAlgError:
            return None
        influence = inverse @ scaled.T
        solution = influence @ target
        return _Fit(solution / scale, scale, inverse, influence, target - scaled @ solution, shifted_s[keep])

    def _covariance(self, step: _Fit) -> FloatArray:
        """Covariance (p, p) of the columns' estimates."""
        at_s = self.at_s[self.keep]
        phase = np.mod((at_s - self.middle_s) / self.cycles.period_s, 1.0)
        covariance = self._reference_part(step, at_s, phase) + self._series_part(step, phase)
        return np.asarray(covariance / np.outer(step.scale, step.scale))

    def _reference_part(self, step: _Fit, at_s: FloatArray, phase: FloatArray) -> FloatArray:
        """Covariance by the reference's residual: white, or shared by phase or stretch where that is certainly more."""
        rest = step.rest
        white = step.inverse * (float(rest @ rest) / (len(rest) - len(step.values)))
        errors = step.influence * rest
        bins = np.floor(PHASE_BINS * phase).astype(np.int64)
        stretch = np.floor((at_s - at_s[0]) * (STRETCHES_A_CYCLE / self.cycles.period_s)).astype(np.int64)
        widest = np.ones(len(white))
        for cluster in (bins, stretch):
            used = np.count_nonzero(np.bincount(cluster))
            if used < 2 * len(white) or used > 0.7 * len(rest):
                continue
            sums = np.array([np.bincount(cluster, row) for row in errors])
            ratio = np.sum(sums**2, axis=1) * (used / (used - len(white))) / np.maximum(np.diag(white), 1e-300)
            certain = ratio > 1.0 + 2.5 * math.sqrt(2.0 / used)
            widest = np.maximum(widest, np.where(certain, ratio, 1.0))
        factor = np.sqrt(widest)
        return np.asarray(white * np.outer(factor, factor))

    def _series_part(self, step: _Fit, phase: FloatArray) -> FloatArray:
        """Covariance by the sensor's own noise in the series, and by what its harmonics beyond the last would add."""
        influence, gain = step.influence, float(step.values[1])
        waves = self.series.waves(step.shifted_s)
        passed = influence @ np.hstack((waves.real, -waves.imag)) * (gain * self.series.coefficient_std)
        mean = influence.sum(axis=1) * (gain * self.series.noise / math.sqrt(self.series.samples))
        covariance = passed @ passed.T + np.outer(mean, mean)
        tail = self.series.tail()
        if len(tail.orders):
            unseen = influence * (gain * tail.at(step.shifted_s)[0])
            bins = np.floor(PHASE_BINS * phase).astype(np.int64)
            sums = np.array([np.bincount(bins, row, PHASE_BINS) for row in unseen])
            covariance = covariance + sums @ sums.T
        return np.asarray(covariance)

    def _match(self, step: _Fit, lag_s: float, drift: float) -> Match:
        values, used = step.values, int(np.count_nonzero(self.keep))
        covariance = self._covariance(step) * student(used - len(values)) ** 2
        gain = float(values[1])
        # From reference = a + g s + b F + g lag s' to sensor = reference / g - a / g - (b / g) F: first order in all.
        jacobian = np.zeros((5, len(values)))
        jacobian[0, 2] = 1.0 / gain
        jacobian[1, 3 if self.with_drift else 2] = 1.0 / gain if self.with_drift else 0.0
        jacobian[2, 1] = -1.0 / gain**2
        jacobian[3, :2] = -1.0 / gain, values[0] / gain**2
        compliance = 0.0
        if self.force is not None:
            at = 4 if self.with_drift else 3
            compliance = -float(values[at]) / gain
            jacobian[4, (1, at)] = float(values[at]) / gain**2, -1.0 / gain
        propagated = jacobian @ covariance @ jacobian.T
        std = np.sqrt(np.maximum(np.diag(propagated), 0.0))
        rest = step.rest
        power = float(np.sum((self.target[self.keep] - np.mean(self.target[self.keep])) ** 2))
        return Match(
            lag_s, float(std[0]), drift, float(std[1]), self.middle_s,
            math.sqrt(max(0.0, 1.0 - float(rest @ rest) / power)) if power > 0.0 else 0.0, used,
            gain=1.0 / gain, gain_std=float(std[2]), offset=-float(values[0]) / gain, offset_std=float(std[3]),
            compliance=None if self.force is None else compliance,
            compliance_std=float(std[4]), coupling=float(propagated[0, 4]),
        )

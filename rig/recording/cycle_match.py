"""The time shift between two records of a motion that repeats: `signal_match` with all cycles together.

Over whole cycles of full amplitude the sensor's samples become one Fourier series, up to nearly half their rate. Every
value of the controller's own record is then laid over it: `reference(t) = offset + gain series(t + lag + drift (t -
mean t))`. The series averages the sensor's noise over the cycles and follows the force's jumps at the reversals, where
nearly all knowledge of the lag lies and where a local polynomial through four samples fails.

What the samples do not resolve of a jump lies beyond the series. Its last half octave foretells how much that is, and
it enters the standard deviation as an error that repeats with the cycle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.recording.differentiation import HarmonicFit, NotDifferentiable, harmonic, with_orders
from rig.recording.layout import FloatArray
from rig.recording.loop_shape import noise_of
from rig.recording.signal_match import FEWEST_SAMPLES, Match

FEWEST_CYCLES = 2
HIGHEST_SHARE = 0.49
"""The series ends at this share of the sampling rate."""
BEYOND_FOUND = 1.5
"""... or at so many times the highest harmonic that stands out of the noise."""
NOT_REPEATING = 1.5
"""A residual of so many times the sensor's own noise means that the cycles differ."""
PHASE_BINS = 50
COARSE_STEPS = 61
MOST_COARSE = 300
LARGEST_STEP = 0.01
"""Of a cycle: longest step of one iteration."""
ROUNDS = 30
CONVERGED_S = 1e-8
MARGIN_CYCLES = 0.1
SMALLEST_CORRELATION = 0.9
UNKNOWNS = 4
"""Offset, gain, lag and drift."""


@dataclass(frozen=True)
class Cycles:
    """The stretch of full amplitude: its beginning and end on the reference's clock (s), and the cycle's period (s)."""

    start_s: float
    end_s: float
    period_s: float


@dataclass(frozen=True)
class _Shift:
    lag_s: float
    drift: float
    lag_std_s: float
    drift_std: float
    correlation: float
    samples: int


def match_cycles(
    reference_s: FloatArray, reference: FloatArray, time_s: FloatArray, values: FloatArray, cycles: Cycles,
    *, reach_s: float, start: Match | None = None,
) -> Match | None:
    """Lay a sensor's samples over the controller's record of the same quantity, all cycles together.

    Args:
        reference_s: times of the reference (m,), s, increasing.
        reference: the reference (m,), any unit.
        time_s: times of the sensor's samples on the reference's clock as far as it is known (n,), s, increasing.
        values: samples (n,), NaN where there is none.
        cycles: where the motion repeats.
        reach_s: the lag is searched within plus and minus this (s); less than half a cycle is.
        start: a match to begin with, whose drift is fitted again; None: the lag is searched, and there is no drift.

    Returns:
        None when the two cannot be laid over each other so: too few cycles or samples, cycles that differ, no likeness.
    """
    lag_s, drift = (0.0, 0.0) if start is None else (start.lag_s, start.drift)
    series = _series(time_s, values, cycles, lag_s)
    if series is None:
        return None
    margin_s = MARGIN_CYCLES * cycles.period_s
    inside = np.isfinite(reference) & (reference_s >= cycles.start_s + margin_s)
    inside &= reference_s < cycles.end_s - margin_s
    at_s, wanted = reference_s[inside], reference[inside]
    if len(at_s) < FEWEST_SAMPLES or np.ptp(wanted) == 0.0:
        return None
    middle_s = float(np.mean(at_s))
    if start is None:
        lag_s = _coarse(at_s, wanted, series, min(reach_s, 0.4 * cycles.period_s))
    found: _Shift | None = None
    for _ in range(ROUNDS):
        found = _step(at_s, wanted, series, cycles, lag_s, drift, middle_s, with_drift=start is not None)
        if found is None:
            return None
        longest_s = LARGEST_STEP * cycles.period_s
        lag_s += float(np.clip(found.lag_s, -longest_s, longest_s))
        drift += found.drift
        if abs(found.lag_s) < CONVERGED_S:
            break
    if found is None or found.correlation < SMALLEST_CORRELATION or abs(lag_s) > 1.5 * reach_s:
        return None
    freedom = found.samples - UNKNOWNS
    # Student's t of a variance estimated from the same samples; there are at least `FEWEST_SAMPLES`.
    widening = float(np.sqrt(freedom / (freedom - 2.0)))
    return Match(
        lag_s, widening * found.lag_std_s, drift, widening * found.drift_std, middle_s, found.correlation,
        found.samples,
    )


def _series(time_s: FloatArray, values: FloatArray, cycles: Cycles, lag_s: float) -> HarmonicFit | None:
    """The sensor's samples over whole cycles as a Fourier series; None where the cycles differ or are too few."""
    whole = int((cycles.end_s - cycles.start_s) / cycles.period_s)
    first_s = cycles.start_s + lag_s
    inside = np.isfinite(values) & (time_s >= first_s) & (time_s < first_s + whole * cycles.period_s)
    t, y = time_s[inside], values[inside]
    if whole < FEWEST_CYCLES or len(t) < FEWEST_SAMPLES:
        return None
    spacing_s = float(np.median(np.diff(t)))
    most = min(int(HIGHEST_SHARE * cycles.period_s / spacing_s), len(t) // 4)
    try:
        found = harmonic(t, y, 1.0 / cycles.period_s)
        highest = min(most, int(BEYOND_FOUND * found.orders[-1]) + 4)
        if highest < found.orders[-1]:
            return None
        fit = with_orders(found, t, y, np.arange(1, highest + 1))
    except (NotDifferentiable, np.linalg.LinAlgError):
        return None
    return fit if fit.residual_m <= NOT_REPEATING * noise_of(y) else None


def _coarse(at_s: FloatArray, wanted: FloatArray, series: HarmonicFit, reach_s: float) -> float:
    """The lag (s) within reach at which the two correlate best."""
    thin = slice(None, None, -(-len(at_s) // MOST_COARSE))
    lags_s = np.linspace(-reach_s, reach_s, COARSE_STEPS)
    likeness = [np.corrcoef(series.at(at_s[thin] + lag_s)[0], wanted[thin])[0, 1] for lag_s in lags_s]
    return float(lags_s[int(np.argmax(likeness))])


def _step(
    at_s: FloatArray, wanted: FloatArray, series: HarmonicFit, cycles: Cycles, lag_s: float, drift: float,
    middle_s: float, *, with_drift: bool,
) -> _Shift | None:
    """One Gauss-Newton step about (lag, drift), with what it says about itself; None when they are not alike."""
    shifted_s = at_s + lag_s + drift * (at_s - middle_s)
    shown, slope, _ = series.at(shifted_s)
    unresolved = series.last_half_octave_at(shifted_s)
    columns = [np.ones(len(at_s)), shown, slope]
    if with_drift:
        columns.append(slope * (at_s - middle_s))
    design = np.column_stack(columns)
    scale = np.sqrt(np.mean(design**2, axis=0))
    if np.any(scale == 0.0):
        return None
    design /= scale
    solution, _, rank, _ = np.linalg.lstsq(design, wanted, rcond=None)
    gain = float(solution[1] / scale[1])
    if rank < design.shape[1] or gain <= 0.0:
        return None
    rest = wanted - design @ solution
    variance = float(rest @ rest) / max(len(at_s) - design.shape[1], 1)
    inverse = np.linalg.inv(design.T @ design)
    sensor = (gain * series.residual_m) ** 2 * len(at_s) / series.samples
    phase = np.floor(PHASE_BINS * ((at_s - middle_s) / cycles.period_s % 1.0)).astype(np.int64)
    covariance = inverse * (variance + sensor) + _repeated(inverse @ (design * (gain * unresolved)[:, None]).T, phase)
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0)) / scale / gain
    power = float(np.sum((wanted - np.mean(wanted)) ** 2))
    found = solution / scale / gain
    return _Shift(
        float(found[2]), float(found[3]) if with_drift else 0.0, float(spread[2]),
        float(spread[3]) if with_drift else 0.0, float(np.sqrt(max(0.0, 1.0 - float(rest @ rest) / power))), len(at_s),
    )


def _repeated(influence: FloatArray, phase: NDArray[np.int64]) -> FloatArray:
    """Covariance (p, p) of errors whose influences (p, m) are shared by all values of one phase, and only by those."""
    sums = np.array([np.bincount(phase, row, PHASE_BINS) for row in influence])
    return np.asarray(sums @ sums.T, np.float64)

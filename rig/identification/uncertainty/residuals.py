"""What a fit leaves over of one test: noise, and misfit that repeats with every cycle.

Autocovariances separate the two. What repeats is as large one, two, three cycles later as at once; noise is not.
gamma_r(k) = mean over j of gamma(j P + k), P samples a cycle, is the repeating part, gamma(k) - gamma_r(k) the noise.
More cycles average the noise away, and never the misfit: the variance that counts for the parameters,
V = (sum of the noise's autocovariances) + cycles x (sum of the repeating ones), therefore grows with the cycles.

Whiteness is tested on the residual thinned to the noise's own rate, because a sensor that is sampled faster than its
bandwidth has correlated noise under a perfect model too: Ljung and Box (1978), Wald and Wolfowitz (1940).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from statistics import NormalDist

import numpy as np

from rig.dampers.arrays import BoolArray, FloatArray
from rig.fits.entries import Residual
from rig.identification.models.measurement import PIECE, samples_a_cycle

MOST_CYCLES = 50  # recorded cycles by which a residual is shifted at most to find what repeats
REACH = 0.25  # of a test: beyond it, the autocovariances of a drift are negative and cancel those of near cycles
FEWEST_REACHED = 5  # recorded cycles, where a quarter of the test is less
MOST_LAGS = 20
FEWEST_SAMPLES = 30
LONGEST_PART = 1 << 16  # samples whose autocovariance is found at once
FEWEST_CYCLES_A_PART = 8
MOST_TESTED = 1 << 15  # samples on which whiteness is tested
SIGNIFICANT = 3.0  # standard errors beyond which something repeats
FALSE_ALARM = 0.01  # of all tests of a fit together
WORTH_WARNING = 1.25  # by which intervals must be widened before it is worth a warning


def assess_residual(
    residual_N: FloatArray,
    counting: BoolArray,
    u_m: FloatArray,
    dt_s: float,
    *,
    known_power: float = 0.0,
    cycles_each: float = 1.0,
) -> Residual:
    """Judge one test.

    Args:
        residual_N: measured minus modelled force, shape (n,).
        counting: which samples count, shape (n,).
        u_m: extension about mid-stroke (m), whose crossings show the cycles, shape (n,).
        dt_s: sampling interval (s).
        known_power: mean square (N^2) of what repeats and is counted elsewhere, such as errors of the motion.
        cycles_each: number of recorded cycles that each cycle represents (mean cycles).
    """
    count, whole = int(np.count_nonzero(counting)), residual_N.size
    power = sum_of_squares(residual_N, counting) / max(1, count)
    if count < FEWEST_SAMPLES or power == 0.0:
        return Residual(math.sqrt(power), 0.0, dt_s, math.nan, math.nan, 1.0)
    period = samples_a_cycle(u_m)
    gamma, pairs = _autocovariance_of_parts(residual_N, counting, period)
    repeating, error = _repeating(gamma, pairs, period, _reach(whole / period * cycles_each) / cycles_each)
    half = repeating.size
    noise = gamma[:half] - repeating
    limit = 2.0 / math.sqrt(count)
    memory = _memory(noise, limit)
    rest = noise[0] + 2.0 * float(np.sum(noise[1:memory]))
    if repeating[0] - known_power > SIGNIFICANT * error:
        repeating *= 1.0 - known_power / repeating[0]
        misfit = repeating[0] + 2.0 * float(np.sum(repeating[1 : _memory(repeating, limit)]))
        cycles = whole / period
    else:
        misfit, cycles, repeating = 0.0, 0.0, np.zeros(half)
    stride = max(1, min(memory, round(half / 4)))
    thinned = residual_N[::stride][counting[::stride]][:MOST_TESTED]
    return Residual(
        noise_N=math.sqrt(max(float(noise[0]), 0.0)),
        repeating_N=math.sqrt(float(repeating[0])),
        memory_s=stride * dt_s,
        portmanteau_p=_portmanteau(thinned),
        runs_p=_runs(thinned),
        widening=max(1.0, float(max(rest, 0.0) + cycles * max(misfit, 0.0)) / power),
    )


def _reach(cycles: float) -> float:
    """Recorded cycles by which the residual of a test of so many is shifted at most."""
    return min(MOST_CYCLES, max(FEWEST_REACHED, REACH * cycles))


def sum_of_squares(values: FloatArray, counting: BoolArray) -> float:
    """Sum of the squares of the values that count, both of shape (n,)."""
    total = 0.0
    for start in range(0, values.size, PIECE):
        kept = np.where(counting[start : start + PIECE], values[start : start + PIECE], 0.0).astype(np.float64)
        total += float(kept @ kept)
    return total


def _autocovariance_of_parts(
    residual_N: FloatArray, counting: BoolArray, period: float
) -> tuple[FloatArray, FloatArray]:
    """Autocovariance and number of pairs, averaged over parts of a long test of at least a few cycles each."""
    whole = residual_N.size
    parts = max(1, min(whole // LONGEST_PART, int(whole / (FEWEST_CYCLES_A_PART * period))))
    size = whole // parts
    products, pairs = np.zeros(size), np.zeros(size)
    for start in range(0, parts * size, size):
        inside = counting[start : start + size]
        share = float(np.mean(inside))
        if share > 0.0:
            kept = np.where(inside, residual_N[start : start + size], 0.0).astype(np.float64)
            gamma, weight = autocovariance(kept, share)
            products += gamma * weight
            pairs += weight
    return products / np.maximum(pairs, 1.0), pairs


def autocovariance(values: FloatArray, share: float) -> tuple[FloatArray, FloatArray]:
    """Autocovariance and number of pairs at each lag, each (n,); absent values are 0, and `share` of them is there."""
    n = values.size
    size = min(odd << max(0, math.ceil(math.log2(2 * n / odd))) for odd in (1, 3, 5, 9, 15))
    spectrum = np.fft.rfft(values, size)
    products = np.fft.irfft(np.abs(spectrum) ** 2, size)[:n]
    pairs: FloatArray = (n - np.arange(n, dtype=np.float64)) * share**2
    gamma: FloatArray = products / np.maximum(pairs, 1.0)
    return gamma, pairs


def _repeating(gamma: FloatArray, pairs: FloatArray, period: float, most: float) -> tuple[FloatArray, float]:
    """Autocovariance (half a cycle of lags) of what repeats within `most` cycles, and the first value's standard error.

    A drift repeats in neighbouring cycles. Over the whole test its autocovariances add up to nearly zero, because
    the fit has removed its mean: more cycles would hide it.
    """
    half = max(2, min(int(period / 2.0), gamma.size // 2))
    reach = np.arange(-half + 1, half)
    count = min(max(1, round(most)), int((gamma.size - half) / period))
    lags = np.rint(period * np.arange(1, count + 1)).astype(np.int64)
    if count < 1:
        return np.zeros(half), math.inf
    at = lags[:, None] + reach
    weights = pairs[at]
    both_sides = np.sum(gamma[at] * weights, axis=0) / np.sum(weights, axis=0)
    folded = 0.5 * (both_sides[half - 1 :] + both_sides[half - 1 :: -1])
    rho = np.clip(gamma[:half] / gamma[0], -1.0, 1.0)
    spread = math.sqrt(1.0 + 2.0 * float(np.sum(rho[1 : _memory(gamma[:half], 2.0 / math.sqrt(gamma.size))] ** 2)))
    return np.asarray(folded), float(gamma[0]) * spread / math.sqrt(float(np.sum(pairs[lags])))


def _memory(gamma: FloatArray, limit: float) -> int:
    """First lag whose autocorrelation is within noise."""
    small = np.flatnonzero(gamma[1:] < limit * gamma[0])
    return int(small[0]) + 1 if small.size else gamma.size


def _portmanteau(values: FloatArray) -> float:
    """Ljung and Box's probability; the chi-square distribution by Wilson and Hilferty (1931)."""
    n = values.size
    lags = min(MOST_LAGS, n // 5)
    if lags < 3:
        return math.nan
    centred = values - float(np.mean(values))
    gamma, pairs = autocovariance(centred, 1.0)
    rho = gamma[1 : lags + 1] * pairs[1 : lags + 1] / (gamma[0] * pairs[0])
    q = n * (n + 2.0) * float(np.sum(rho**2 / (n - np.arange(1, lags + 1))))
    spread = 2.0 / (9.0 * lags)
    return 1.0 - NormalDist().cdf(((q / lags) ** (1.0 / 3.0) - (1.0 - spread)) / math.sqrt(spread))


def _runs(values: FloatArray) -> float:
    """Wald and Wolfowitz's probability, two-sided, of the number of runs above and below zero."""
    above = values > 0.0
    ups, n = int(np.count_nonzero(above)), above.size
    if min(ups, n - ups) < 10:
        return math.nan
    runs = 1 + int(np.count_nonzero(np.diff(above)))
    mean = 1.0 + 2.0 * ups * (n - ups) / n
    spread = math.sqrt((mean - 1.0) * (mean - 2.0) / (n - 1.0))
    return 2.0 * NormalDist().cdf(-abs(runs - mean) / spread)


def correlated(residuals: Sequence[Residual]) -> list[int]:
    """Indices of the tests whose residual is not white; one false alarm in `FALSE_ALARM` of the fits."""
    level = FALSE_ALARM / (2.0 * max(1, len(residuals)))
    return [k for k, residual in enumerate(residuals) if residual.least_p < level or residual.repeating_N > 0.0]

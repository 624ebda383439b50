"""Which harmonics of a cycle stand out of a recording's own noise: a test of all orders together.

A harmonic's power is compared with the powers between the harmonics near it, where a motion that repeats puts nothing:
white or coloured noise, and an amplitude that changes slowly from cycle to cycle, put there what they put at the
harmonic itself. With a power B averaged over m such frequencies and P at the harmonic, P/B follows Fisher's F(2, 2m)
where there is nothing but noise, so P(P/B > x) = (1 + x/m)^-m. The limit holds for all tested orders together
(Bonferroni). Quantisation without noise to dither it repeats with the motion and is no noise: its power is known from
the step (Bennett 1948: step^2/12, spread over the orders that a cycle's samples resolve; it fades as
exp(-4 pi^2 s^2/step^2) with noise of standard deviation s).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

FALSE_ALARM = 0.002  # probability that noise alone gives any order of a record, each time it is looked at
PHASES = 4096  # places of a cycle: ten times the highest order
MOST_CYCLES = 64  # of a group
WIDEST = 30  # orders above the highest one in which noise is looked for
NEAR_BINS = 48  # frequencies between harmonics, nearest to an order, whose median is its noise
MEDIAN_COUNTS = 0.48  # a median of so many is as sure as a mean of this share of them
MEDIAN_OF_EXPONENTIAL = math.log(2.0)
SYMMETRIC = 2.0  # the rounding of a cycle whose halves mirror each other lies in half of the orders, twice as strong
GRID = 0.01  # of a step, within which all values of a quantised signal lie on its grid
MOST_GAPS = 400  # differences of neighbouring values from which the step is found
FEWEST_STORED = 4.0  # a step is at least so many steps of the stored numbers
RESOLVED = 1e-3  # share of the strongest harmonic that folding tells from its own rounding


def significant_orders(
    time_s: FloatArray, residual: FloatArray, omega_rad_s: float, count: int, step: float
) -> NDArray[np.int64]:
    """Orders from 2 to `count` that stand out of the noise of a residual.

    Args:
        time_s: sample times (s), shape (n,), nearly even.
        residual: what the orders already known leave, shape (n,), in any unit.
        omega_rad_s: fundamental angular frequency (rad/s).
        count: highest order.
        step: quantisation step of the measured signal in that unit; 0 where there is none.

    Returns:
        The orders, rising. Those a thousand times weaker than the strongest are left for another look.
    """
    if count < 2 or residual.size < 2:
        return np.zeros(0, dtype=np.int64)
    power, noise, counts, _ = _lines_and_noise(time_s, residual, omega_rad_s, count)
    level = np.maximum(noise, _quantisation_power(time_s, residual, omega_rad_s, step))
    limit = counts * ((FALSE_ALARM / count) ** (-1.0 / counts) - 1.0)
    standing = (power > limit * level) & (power > RESOLVED**2 * float(np.max(power)))
    return np.asarray(np.flatnonzero(standing) + 2, np.int64)


def coefficient_errors(
    time_s: FloatArray, residual: FloatArray, omega_rad_s: float, orders: NDArray[np.int64], step: float
) -> FloatArray:
    """Standard errors of a series' mean and of the cosine (or sine) of each order, in the residual's unit.

    Args:
        time_s: sample times (s), shape (n,), nearly even.
        residual: what the series leaves, shape (n,).
        omega_rad_s: fundamental angular frequency (rad/s).
        orders: orders of the series, rising, shape (K,).
        step: quantisation step of the measured signal; 0 where there is none.

    Returns:
        The mean's, then the orders', shape (K + 1,), from the noise between the harmonics near each.
    """
    if residual.size < 2:
        return np.zeros(orders.size + 1)
    highest = max(2, int(orders[-1]))
    noise = _lines_and_noise(time_s, residual, omega_rad_s, highest)[3]
    level = np.maximum(noise, _quantisation_power(time_s, residual, omega_rad_s, step))
    power = np.concatenate((level[:1] / 2.0, level[np.maximum(orders, 2) - 2]))
    return np.asarray(np.sqrt(2.0 * power) / residual.size)


def quantisation_step(values: FloatArray) -> float:
    """The step of the grid that a signal's values lie on, in its unit: their greatest common divisor.

    Where there is none, the resolution of the single-precision numbers in which signals are stored.
    """
    levels = np.unique(values)
    if levels.size < 2:
        return 0.0
    stored = 2.0**-23 * float(np.max(np.abs(levels)))
    gaps = np.diff(levels)
    gaps = np.unique(gaps[gaps > 2.0 * stored])
    if gaps.size == 0:
        return stored
    step = float(gaps[0])
    for gap in gaps[:MOST_GAPS].tolist():
        step = _common_divisor(gap, step, stored)
        if step < FEWEST_STORED * stored:
            return stored
    offset = (gaps / step + 0.5) % 1.0 - 0.5
    return step if float(np.max(np.abs(offset) * step)) < GRID * step + 2.0 * stored else stored


def _common_divisor(one: float, other: float, tolerance: float) -> float:
    """Greatest common divisor of two positive numbers that are known to within a tolerance (Euclid)."""
    while other > FEWEST_STORED * tolerance:
        one, other = other, abs(one - round(one / other) * other)
    return one


def _lines_and_noise(
    time_s: FloatArray, residual: FloatArray, omega_rad_s: float, count: int
) -> tuple[FloatArray, FloatArray, float, FloatArray]:
    """|sum r exp(-i k w t)|^2 of orders 2 to `count`, what noise makes it at most, how many powers tell that, its mean.

    The samples are shared between neighbouring places of a fine grid over a group of cycles, whose transform has the
    harmonics at every so-many-th frequency and noise between them. Groups add up, harmonics in phase.
    """
    turns = time_s * (omega_rad_s / (2.0 * np.pi))
    turns = turns - turns[0]
    cycles = max(1, round(float(turns[-1])))
    together = math.ceil(cycles / math.ceil(cycles / MOST_CYCLES))
    edges = np.searchsorted(turns, np.arange(0.0, turns[-1], together))
    size = together * PHASES
    last = min(size // 2, (count + WIDEST) * together) + 1
    lines, power = np.zeros(count - 1, complex), np.zeros(last)
    for start, stop in zip(edges, [*edges[1:], turns.size], strict=True):
        spectrum = np.fft.rfft(_shared(turns[start:stop], residual[start:stop], size))[:last]
        lines += spectrum[2 * together : (count + 1) * together : together]
        power += np.abs(spectrum) ** 2
    fading = np.sinc(np.arange(last) / size) ** 4  # of sharing between neighbours
    power /= fading
    line_power = np.abs(lines) ** 2 / fading[2 * together : (count + 1) * together : together]
    between = np.flatnonzero(np.arange(last) % together) if together > 1 else np.arange(last)
    middle = np.searchsorted(between, np.arange(2, count + 1) * together)
    noise = power[between]
    width = min(NEAR_BINS, noise.size)
    near = _mean_near(noise, middle, min(2 * max(1, together - 1), noise.size))
    counts = len(edges) * max(1.0, MEDIAN_COUNTS * width)
    return line_power, np.maximum(_median_near(noise, middle, width), near), counts, _mean_near(noise, middle, width)


def _shared(turns: FloatArray, values: FloatArray, size: int) -> FloatArray:
    """Values at times (cycles) put onto a grid of `size` places, `PHASES` a cycle, by linear sharing."""
    place = turns * PHASES
    low = np.floor(place)
    share = place - low
    index = low.astype(np.int64)
    grid = np.bincount(index % size, values * (1.0 - share), size)
    return np.asarray(grid + np.bincount((index + 1) % size, values * share, size))


def _median_near(power: FloatArray, middle: NDArray[np.int64], width: int) -> FloatArray:
    """Mean of the powers of noise around each place, from the median of `width` of them."""
    first = np.clip(middle - width // 2, 0, power.size - width)
    nearest = power[first[:, None] + np.arange(width)]
    return np.asarray(np.median(nearest, axis=1) / MEDIAN_OF_EXPONENTIAL)


def _mean_near(power: FloatArray, middle: NDArray[np.int64], width: int) -> FloatArray:
    """Mean of the `width` powers nearest to each place."""
    total = np.concatenate(([0.0], np.cumsum(power)))
    first = np.clip(middle - width // 2, 0, power.size - width)
    return np.asarray((total[first + width] - total[first]) / width)


def _quantisation_power(time_s: FloatArray, residual: FloatArray, omega_rad_s: float, step: float) -> float:
    """Expected |sum r exp(-i k w t)|^2 of quantisation that repeats every cycle."""
    if step <= 0.0:
        return 0.0
    n = residual.size
    a_cycle = n / max(1.0, omega_rad_s / (2.0 * np.pi) * float(time_s[-1] - time_s[0]))
    noise_power = max(0.0, float(np.mean(residual**2)) - step**2 / 12.0)
    faded = math.exp(-min(700.0, 4.0 * math.pi**2 * noise_power / step**2))
    return SYMMETRIC * n**2 * step**2 / (12.0 * max(2.0, a_cycle)) * faded

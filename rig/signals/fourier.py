"""A motion that repeats as a Fourier series of those harmonics only that certainly stand out of the noise.

The cycle's frequency is the program's own, on the controller's clock. A harmonic is kept where its power exceeds what
noise alone would show in any of all orders once in a hundred series; one that is far away from all others, or towers
above its neighbours, is not the motion's but a line of its own and is left out; so is what lies at the mains' own
frequencies. `significant_orders` tells by one test of all orders together which stand out of a recording's own noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.signals.arrays import FloatArray

HIGHEST_SHARE = 0.45
"""The series ends at this share of the sampling rate."""
MOST_ORDERS = 400
FALSE_ALARM = 0.01
"""Probability that noise alone makes any order of a series."""
ROUNDS = 12
CONVERGED = 1e-7
"""Of the values' span: no harmonic changes by more in the last turn."""
FOLDED = 4000
"""Samples a cycle from which on they are averaged by phase."""
GRID = 4096
LARGEST_GAP = 0.35
"""Orders further apart than this share of their own, and than `SMALLEST_GAP`, belong together no more."""
SMALLEST_GAP = 6
TOWERS = 6.0
"""Times its neighbours' amplitude, above which an order is a line of its own."""
FIRST_LINE = 5
"""Lowest order that can be such a line."""
MAINS_Hz = (50.0, 60.0)
TAIL_ORDERS = 4
ORDER_FALSE_ALARM = 0.002  # probability that noise alone gives any order of a record, each time it is looked at
PHASES = 4096  # places of a cycle: ten times the highest order
MOST_CYCLES = 64  # of a group
WIDEST = 30  # orders above the highest one in which noise is looked for
NEAR_BINS = 48  # frequencies between harmonics, nearest to an order, whose median is its noise
MEDIAN_COUNTS = 0.48  # a median of so many is as sure as a mean of this share of them
MEDIAN_OF_EXPONENTIAL = math.log(2.0)
SYMMETRIC = 2.0  # the rounding of a cycle whose halves mirror each other lies in half of the orders, twice as strong
OFF_GRID, FEWEST_SINGLE = 0.02, 8
"""Share of a step by which levels may be off their grid, and how many gaps of a single step tell it."""
STEP_TOLERANCE = 0.01  # of a step, within which all values of a quantised signal lie on its grid
MOST_VALUES = 250_000  # of a signal, from which its levels are found
MOST_GAPS = 400  # differences of neighbouring values from which the step is found
FEWEST_STORED = 4.0  # a step is at least so many steps of the stored numbers
RESOLVED = 1e-3  # share of the strongest harmonic that folding tells from its own rounding


@dataclass(frozen=True)
class Series:
    """`mean + Re sum c_k exp(-i k w (t - origin))` over the orders k that were kept.

    Attributes:
        origin_s: where the phase is 0 (s).
        omega_rad_s: of the cycle (rad/s).
        mean: of the series, any unit.
        orders: k, ascending (K,); none where nothing stands out.
        coefficients: c_k (K,), complex.
        noise: standard deviation of what the series leaves of one sample.
        samples: how many were fitted.
    """

    origin_s: float
    omega_rad_s: float
    mean: float
    orders: NDArray[np.int64]
    coefficients: NDArray[np.complex128]
    noise: float
    samples: int

    @property
    def coefficient_std(self) -> float:
        """Standard deviation of a harmonic's cosine, and of its sine."""
        return self.noise * math.sqrt(2.0 / self.samples)

    def up_to(self, highest: int) -> Series:
        """The series without the orders above `highest`."""
        return self.without(self.orders[self.orders > highest])

    def without(self, orders: NDArray[np.int64]) -> Series:
        """The series without these orders."""
        keep = ~np.isin(self.orders, orders)
        return replace(self, orders=self.orders[keep], coefficients=self.coefficients[keep])

    def waves(self, time_s: FloatArray) -> NDArray[np.complex128]:
        """`exp(-i k w t)` at any times (n,) s: (n, K)."""
        return np.exp(-1j * np.outer(time_s - self.origin_s, self.orders * self.omega_rad_s))

    def at(self, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Value about the mean and slope (1/s) at any times (n,) s."""
        waves = self.waves(time_s) * self.coefficients
        return np.real(waves.sum(axis=1)), np.real(waves @ (-1j * self.orders * self.omega_rad_s))

    def table(self) -> FloatArray:
        """Values about the mean over one period from the origin, on `GRID` equal steps and once more the first."""
        spectrum = np.zeros(GRID // 2 + 1, np.complex128)
        spectrum[self.orders] = np.conj(self.coefficients)
        values = np.fft.irfft(spectrum, GRID) * (GRID / 2.0)
        return np.append(values, values[0])

    def tail(self) -> Series:
        """The half octave below the highest order, where the harmonics go on so far; none where they end by themselves.

        Of a series that falls as k^-2 or faster this is at least what the orders beyond it would add.
        """
        last = int(self.orders[-1]) if len(self.orders) else 0
        keep = self.orders > last / math.sqrt(2.0)
        if np.count_nonzero(keep) < TAIL_ORDERS:
            keep[:] = False
        return replace(self, mean=0.0, orders=self.orders[keep], coefficients=self.coefficients[keep])


def series_of(time_s: FloatArray, values: FloatArray, frequency_Hz: float) -> Series | None:
    """The series of samples over whole cycles.

    Over whole cycles harmonics are nearly orthogonal: each is projected out of what the others leave, in turns, until
    none changes any more. Many samples are first averaged at nearly equal phases.

    Args:
        time_s: (n,) s, increasing, over whole cycles.
        values: (n,), none missing.
        frequency_Hz: of the cycle.

    Returns:
        None for too few samples to tell harmonics from noise.
    """
    spacing_s = float(np.median(np.diff(time_s)))
    most = int(min(MOST_ORDERS, HIGHEST_SHARE / (spacing_s * frequency_Hz), len(time_s) // 4))
    if most < 1:
        return None
    origin_s = 0.5 * float(time_s[0] + time_s[-1])
    phase = (time_s - origin_s) * frequency_Hz
    angle, y = _folded(phase, values)
    mean, spectrum, chosen = float(np.mean(y)), np.zeros(most, np.complex128), np.zeros(most, bool)
    residual = y - mean
    for _ in range(ROUNDS):
        left = _projected(angle, residual, most)
        before = chosen.copy()
        chosen |= _standing_out(left, residual)
        spectrum[chosen] += left[chosen]
        mean += float(np.mean(residual))
        residual = y - mean - _summed(angle, spectrum)
        if np.array_equal(before, chosen) and np.max(np.abs(left[chosen]), initial=0.0) < CONVERGED * np.ptp(y):
            break
    orders = 1 + np.flatnonzero(chosen)
    whole = Series(origin_s, math.tau * frequency_Hz, mean, orders, spectrum[chosen], 0.0, len(time_s))
    rest = values - mean - np.interp(np.mod(phase, 1.0) * GRID, np.arange(GRID + 1), whole.table())
    noise = math.sqrt(float(rest @ rest) / max(1, len(rest) - 2 * len(orders) - 1))
    alone = ~_belonging(orders, np.abs(spectrum[chosen])) | _of_the_mains(orders, frequency_Hz)
    return replace(whole.without(orders[alone]), noise=noise)


def _folded(phase: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Angles (rad) and values of the samples; of many, means over `FOLDED` stretches of the cycle."""
    if len(phase) <= FOLDED:
        return math.tau * phase, values
    part = np.mod(phase, 1.0)
    at = np.minimum((part * FOLDED).astype(np.int64), FOLDED - 1)
    count = np.bincount(at, minlength=FOLDED)
    filled = count > 0
    means = [np.bincount(at, column, FOLDED)[filled] / count[filled] for column in (part, values)]
    return math.tau * means[0], means[1]


def _standing_out(projected: NDArray[np.complex128], residual: FloatArray) -> NDArray[np.bool_]:
    """Which orders' power stands out of the noise about them."""
    power, most = np.abs(projected) ** 2, len(projected)
    white = 4.0 * float(np.mean(residual**2)) / len(residual)
    noise = max(min(white, float(np.median(power)) / math.log(2.0)), 0.01 * white) if most > 20 else white
    return np.asarray(power > noise * math.log(most / FALSE_ALARM))


def _projected(angle: FloatArray, values: FloatArray, most: int) -> NDArray[np.complex128]:
    """`2/n sum values exp(i k angle)` for the orders 1 to `most` (most,)."""
    turn, rotated = np.exp(1j * angle), values.astype(np.complex128)
    total = np.empty(most, np.complex128)
    for at in range(most):
        rotated *= turn
        total[at] = rotated.sum()
    return total * (2.0 / len(values))


def _summed(angle: FloatArray, spectrum: NDArray[np.complex128]) -> FloatArray:
    """`Re sum c_k exp(-i k angle)` (n,), by Horner's rule."""
    turn = np.exp(-1j * angle)
    total = np.zeros(len(angle), np.complex128)
    for coefficient in spectrum[::-1]:
        total = (total + coefficient) * turn
    return np.asarray(total.real)


def _of_the_mains(orders: NDArray[np.int64], frequency_Hz: float) -> NDArray[np.bool_]:
    """Which orders (K,) lie at a frequency at which every amplifier hums, whatever else may be there."""
    lines_Hz = np.array([multiple * mains_Hz for mains_Hz in MAINS_Hz for multiple in (1, 2, 3)])
    near = np.abs(orders[:, None] * frequency_Hz - lines_Hz[None, :]) < frequency_Hz
    return np.asarray(np.any(near, axis=1) & (orders >= FIRST_LINE))


def _belonging(orders: NDArray[np.int64], amplitude: FloatArray) -> NDArray[np.bool_]:
    """Which orders (K,) are the motion's: from the lowest on without a wide gap, none towering above its neighbours."""
    keep = np.ones(len(orders), bool)
    for at in range(len(orders)):
        order = int(orders[at])
        near = (np.abs(orders - order) <= max(SMALLEST_GAP, LARGEST_GAP * order)) & (orders != order)
        if order >= FIRST_LINE and (not np.any(near) or amplitude[at] > TOWERS * float(np.max(amplitude[near]))):
            keep[at] = False
    kept = orders[keep]
    gaps = np.flatnonzero(np.diff(kept) > np.maximum(SMALLEST_GAP, LARGEST_GAP * kept[:-1]))
    if len(gaps):
        keep &= orders <= kept[gaps[0]]
    return keep


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
    limit = counts * ((ORDER_FALSE_ALARM / count) ** (-1.0 / counts) - 1.0)
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
    levels = np.unique(values[:: 1 + values.size // MOST_VALUES])
    if levels.size < 2:
        return 0.0
    stored = 2.0**-23 * float(np.max(np.abs(levels)))
    gaps = np.diff(levels)
    gaps = gaps[gaps > 2.0 * stored]
    if gaps.size == 0:
        return stored
    if (even := _even_step(gaps)) > 0.0:
        return even
    gaps = np.unique(gaps)
    step = float(gaps[0])
    for gap in gaps[:MOST_GAPS].tolist():
        step = _common_divisor(gap, step, stored)
        if step < FEWEST_STORED * stored:
            return stored
    offset = (gaps / step + 0.5) % 1.0 - 0.5
    return step if float(np.max(np.abs(offset) * step)) < STEP_TOLERANCE * step + 2.0 * stored else stored


def _even_step(gaps: FloatArray) -> float:
    """The step of levels that lie on a grid to within a small share of it, by the gaps (n,) between them; 0 otherwise.

    A coarse converter's values, scaled and printed with few digits, are on its grid to within a printing step only:
    their common divisor is the printing step, but no value between two steps ever occurs.
    """
    single = gaps[gaps < (1.0 + 2.0 * OFF_GRID) * float(np.min(gaps))]
    if single.size < FEWEST_SINGLE:
        return 0.0
    places = np.concatenate(([0.0], np.cumsum(np.round(gaps / np.median(single)))))
    levels = np.concatenate(([0.0], np.cumsum(gaps)))
    step, first = np.polyfit(places, levels, 1)
    return float(step) if float(np.max(np.abs(levels - first - step * places))) <= OFF_GRID * step else 0.0


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

"""A motion that repeats as a Fourier series of those harmonics only that certainly stand out of the noise.

The cycle's frequency is the program's own, on the controller's clock. A harmonic is kept where its power exceeds what
noise alone would show in any of all orders once in a hundred series; one that is far away from all others, or towers
above its neighbours, is not the motion's but a line of its own and is left out; so is
what lies at the mains' own frequencies.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.recording.layout import FloatArray

HIGHEST_SHARE = 0.45
"""The series ends at this share of the sampling rate."""
MOST_ORDERS = 400
FALSE_ALARM = 0.01
"""Probability that noise alone makes any order of a series."""
ROUNDS = 4
CHUNK = 8192
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
        return Series(
            self.origin_s, self.omega_rad_s, self.mean, self.orders[keep], self.coefficients[keep], self.noise,
            self.samples,
        )

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
        return Series(
            self.origin_s, self.omega_rad_s, 0.0, self.orders[keep], self.coefficients[keep], self.noise, self.samples,
        )


def series_of(time_s: FloatArray, values: FloatArray, frequency_Hz: float) -> Series | None:
    """The series of samples over whole cycles.

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
    omega, origin_s = math.tau * frequency_Hz, 0.5 * float(time_s[0] + time_s[-1])
    t = time_s - origin_s
    orders = np.zeros(0, np.int64)
    mean, coefficients = float(np.mean(values)), np.zeros(0, np.complex128)
    residual = values - mean
    for _ in range(ROUNDS):
        seen = np.setdiff1d(_standing_out(t, residual, omega, most), orders)
        if len(seen) == 0:
            break
        orders = np.union1d(orders, seen)
        mean, coefficients, residual = _solved(t, values, omega, orders)
    kept = orders[_belonging(orders, np.abs(coefficients)) & ~_of_the_mains(orders, frequency_Hz)]
    if len(kept) < len(orders):
        mean, coefficients, _ = _solved(t, values, omega, kept)
    noise = math.sqrt(float(residual @ residual) / max(1, len(t) - 2 * len(orders) - 1))
    return Series(origin_s, omega, mean, kept, coefficients, noise, len(t))


def _standing_out(t: FloatArray, residual: FloatArray, omega: float, most: int) -> NDArray[np.int64]:
    """Orders whose power stands out of the noise about them."""
    power = np.abs(_spectrum(t, residual, omega, most)) ** 2
    white = 4.0 * float(np.mean(residual**2)) / len(t)
    noise = max(min(white, float(np.median(power)) / math.log(2.0)), 0.01 * white) if most > 20 else white
    return 1 + np.flatnonzero(power > noise * math.log(most / FALSE_ALARM))


def _spectrum(t: FloatArray, values: FloatArray, omega: float, most: int) -> NDArray[np.complex128]:
    """`2/n sum values exp(i k w t)` for the orders 1 to `most` (most,)."""
    total = np.zeros(most, np.complex128)
    for start in range(0, len(t), CHUNK):
        turn = np.exp(1j * omega * t[start : start + CHUNK])
        rotated = values[start : start + CHUNK].astype(np.complex128)
        for k in range(most):
            rotated = rotated * turn
            total[k] += rotated.sum()
    return total * (2.0 / len(t))


def _solved(
    t: FloatArray, values: FloatArray, omega: float, orders: NDArray[np.int64],
) -> tuple[float, NDArray[np.complex128], FloatArray]:
    """Mean, coefficients and residual of the least-squares series of these orders."""
    size = 2 * len(orders) + 1
    normal, right = np.zeros((size, size)), np.zeros(size)
    for part in _chunks(len(t)):
        design = _design(t[part], omega, orders)
        normal += design.T @ design
        right += design.T @ values[part]
    solution = np.linalg.solve(normal, right)
    residual = np.concatenate([values[part] - _design(t[part], omega, orders) @ solution for part in _chunks(len(t))])
    cosine, sine = solution[1 : len(orders) + 1], solution[len(orders) + 1 :]
    return float(solution[0]), cosine + 1j * sine, residual


def _design(t: FloatArray, omega: float, orders: NDArray[np.int64]) -> FloatArray:
    phase = np.outer(t, orders * omega)
    return np.hstack((np.ones((len(t), 1)), np.cos(phase), np.sin(phase)))


def _chunks(count: int) -> list[slice]:
    return [slice(start, min(start + CHUNK, count)) for start in range(0, count, CHUNK)]


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

"""Step response of one or two lags with dead time, also as it is seen through a sensor's filter."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy import optimize

from rig.signals.arrays import FloatArray
from rig.signals.sensor_filter import FILTER_DELAY

EQUAL = 0.25
"""`product` of two equal lags; above it the response overshoots."""
SINGLE = 1e-9
"""Product up to which there is one lag: of the other one, only rounding is left."""
APART = 1e-6
"""Least difference of four times the product from 1: the terms of two equal lags would each be infinite."""
SEARCHED, SEARCH_PLACES = 12.0, 2401
"""Sums of the lags within which a share is looked for, at so many places."""


@dataclass(frozen=True)
class Lags:
    """Dead time d and a chain 1 / (1 + T s + p T^2 s^2) behind it.

    Attributes:
        dead_s: d (s).
        total_s: T, sum of the lags (s), > 0; d + T is the mean delay.
        product: p, product of the lags over T^2: 0 is one lag, 1/4 are two equal ones; beyond that, the damping ratio
            is 1 / (2 sqrt(p)) and the response overshoots.
    """

    dead_s: float
    total_s: float
    product: float = 0.0

    def reached(self, time_s: FloatArray, bandwidth_Hz: float | None = None) -> FloatArray:
        """Share of the step at these times, (n,) s after the step; 1 - sum A_i exp(-t / T_i).

        Args:
            time_s: (n,).
            bandwidth_Hz: cut-off frequency of the second-order Butterworth filter through which the response is seen,
                whose delay at low frequencies, sqrt(2) / omega, is removed from the times; None: no filter.
        """
        since_s = time_s - self.dead_s
        if bandwidth_Hz is not None:
            since_s = since_s + FILTER_DELAY / (math.tau * bandwidth_Hz)
        since_s = np.maximum(since_s, 0.0)
        if bandwidth_Hz is None and self.product <= SINGLE:
            return np.asarray(-np.expm1(-since_s / self.total_s))
        chain = self._chain_s(bandwidth_Hz)
        left = np.zeros(len(since_s))
        for place, lag_s in enumerate(chain):
            if lag_s.imag < 0.0:
                continue  # of a conjugate pair, twice the real part of one
            weight = np.prod([lag_s / (lag_s - other_s) for k, other_s in enumerate(chain) if k != place])
            if lag_s.imag == 0.0:
                left += weight.real * np.exp(-since_s / lag_s.real)
            else:
                left += 2.0 * np.real(weight * np.exp(-since_s / lag_s))
        return np.asarray(1.0 - left)

    def _chain_s(self, bandwidth_Hz: float | None) -> list[complex]:
        """The lags, those of the filter included, complex where they ring (s)."""
        chain_s = [complex(self.total_s)]
        if self.product > SINGLE:
            inside = 1.0 - 4.0 * self.product
            root = complex(math.copysign(max(abs(inside), APART), inside)) ** 0.5
            chain_s = [0.5 * self.total_s * (1.0 + root), 0.5 * self.total_s * (1.0 - root)]
        if bandwidth_Hz is not None:
            own_s = complex(1.0, 1.0) / (math.sqrt(2.0) * math.tau * bandwidth_Hz)
            chain_s += [own_s, own_s.conjugate()]
        return chain_s

    @property
    def each_s(self) -> tuple[float, float]:
        """The longer and the shorter lag (s); the mean of both, twice, where the response overshoots."""
        root = math.sqrt(max(0.0, 1.0 - 4.0 * self.product))
        longer_s = 0.5 * self.total_s * (1.0 + root)
        return longer_s, self.total_s - longer_s

    def time_to_s(self, share: float) -> float:
        """First time at which this share of the step is reached without filter (s); inf beyond 12 T."""
        return self.dead_s + self.total_s * lags_to(share, self.product)


@lru_cache(maxsize=4096)
def lags_to(share: float, product: float) -> float:
    """First time at which a share is reached, from the end of the dead time, in sums of the lags."""
    if product <= SINGLE:
        return -math.log1p(-share) if share < 1.0 else math.inf
    unit = Lags(0.0, 1.0, product)
    places = np.linspace(0.0, SEARCHED, SEARCH_PLACES)
    beyond = np.flatnonzero(unit.reached(places) >= share)
    if not len(beyond):
        return math.inf
    last = int(beyond[0])
    if last == 0:
        return 0.0

    def off(at: float) -> float:
        return float(unit.reached(np.array([at]))[0]) - share

    return float(optimize.brentq(off, places[last - 1], places[last], xtol=1e-12))

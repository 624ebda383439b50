"""Roads as heights over time or distance: the paper's sine sweep, ISO 8608 classes, obstacles, recorded drives.

A road says how high the ground is on its left and its right track at a time t after the front axle has come to its
beginning; the rear axle comes there L / v later. Before its beginning every road is flat, so a car starts at rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from rig.dampers.arrays import FloatArray
from rig.vehicle.car import Car

Heights = Callable[[FloatArray, float], FloatArray]
"""(time s (k,), side +1 left or -1 right) -> height m (k,)."""

REFERENCE_1_M = 0.1
CLASSES = dict(zip("ABCDEFGH", 16e-6 * 4.0 ** np.arange(8), strict=True))
"""Geometric mean of the displacement's spectral density at 0.1 cycles/m of each class (m^3), ISO 8608 table C.1."""
LOWEST_1_M, HIGHEST_1_M = 0.011, 2.83
"""Spatial frequencies (cycles/m) for which ISO 8608 gives the classes."""


@dataclass(frozen=True)
class Road:
    """A road as a car meets it.

    Attributes:
        name: for people.
        duration_s: time until the front axle is at its end.
        speed_m_s: of the car; 0: a rig with posts, all axles at once.
        heights: the ground.
        sweep: it is a sine sweep, whose sides may be given another phase.
        of_wheel: heights for each wheel of its own, (time s, place in `Car.places`); None: from left and right track.
    """

    name: str
    duration_s: float
    speed_m_s: float
    heights: Heights
    sweep: Sweep | None = None
    of_wheel: Callable[[FloatArray, int], FloatArray] | None = None

    def under(self, car: Car, step_s: float) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Time (k,), height and its rate (k, c) under each wheel, every `step_s`, until the rear axle is over."""
        lag_s = [
            (car.lever_m[0] - lever) / self.speed_m_s if self.speed_m_s > 0.0 else 0.0 for lever in car.lever_m
        ]
        time_s = np.arange(round((self.duration_s + max(lag_s)) / step_s) + 1, dtype=np.float64) * step_s
        if self.of_wheel is not None:
            columns = [self.of_wheel(time_s, place) for place in car.places]
        else:
            columns = [
                self.heights(time_s - late, side) * (time_s >= late)
                for late, side in zip(lag_s, car.sides, strict=True)
            ]
        height_m = np.stack(columns, axis=1)
        rate_m_s: FloatArray = np.gradient(height_m, step_s, axis=0)
        return time_s, height_m, rate_m_s

    def with_phase(self, phase_deg: float) -> Road:
        """The same sweep with another phase of the right side behind the left one.

        Raises:
            ValueError: it is no sweep.
        """
        if self.sweep is None:
            raise ValueError(f"{self.name} has no phase difference between its sides; only a sweep has one")
        return sweep_road(replace(self.sweep, phase_deg=phase_deg), self.name, self.speed_m_s)


@dataclass(frozen=True)
class Sweep:
    """A sine whose frequency rises linearly in time; its peak-to-peak height changes linearly.

    The c-FOA paper's (section 4.2, Figure 13d): 4 mm to 1 mm, to 18 Hz, at 25 m/s, left and right out of phase.

    Attributes:
        duration_s: of the sweep; the paper does not print it.
        phase_deg: of the right side behind the left one.
    """

    duration_s: float = 60.0
    first_Hz: float = 0.0
    last_Hz: float = 18.0
    first_m: float = 4e-3
    last_m: float = 1e-3
    phase_deg: float = 90.0

    def at(self, time_s: FloatArray, side: float) -> FloatArray:
        """Height (m) of a side."""
        inside = np.clip(time_s, 0.0, self.duration_s)
        rise = (self.last_Hz - self.first_Hz) / self.duration_s
        angle = 2.0 * np.pi * (self.first_Hz * inside + 0.5 * rise * inside**2)
        half_m = 0.5 * (self.first_m + (self.last_m - self.first_m) * inside / self.duration_s)
        behind = math.radians(self.phase_deg) if side < 0.0 else 0.0
        # From the ground at rest: a side that is behind would begin with a jump.
        eased = np.minimum(1.0, inside / (0.02 * self.duration_s))
        height: FloatArray = half_m * eased * np.sin(angle - behind) * (time_s <= self.duration_s)
        return height


def sweep_road(sweep: Sweep, name: str = "sine sweep", speed_m_s: float = 25.0) -> Road:
    """A sweep under a car at a speed."""
    return Road(name, sweep.duration_s, speed_m_s, sweep.at, sweep)


@dataclass(frozen=True)
class RandomRoad:
    """An ISO 8608 road: G(n) = G(n0) (n / n0)^-2, phases by chance.

    Attributes:
        roughness_m3: G(n0) at n0 = 0.1 cycles/m.
        length_m: after which it repeats.
        coherence: of left and right track: "isotropic" (Kamash and Robson 1978: g(n) = 2 pi n b K1(2 pi n b) for a
            surface that is the same in every direction), "equal" or "independent".
        track_m: b, between left and right track.
        seed: of the phases.
    """

    roughness_m3: float
    length_m: float
    coherence: str = "isotropic"
    track_m: float = 1.6
    seed: int = 0

    def tracks(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Distance (m) (k,), left and right height (m) (k,) of one period."""
        spacing_m = 0.25 / HIGHEST_1_M / 2.0
        count = 2 * math.ceil(self.length_m / spacing_m / 2.0)
        spacing_m = self.length_m / count
        n = np.asarray(np.fft.rfftfreq(count, spacing_m), np.float64)
        kept = (n >= LOWEST_1_M) & (n <= HIGHEST_1_M)
        density = np.zeros_like(n)
        density[kept] = self.roughness_m3 * (n[kept] / REFERENCE_1_M) ** -2
        random = np.random.default_rng(self.seed)
        one, other = (np.exp(2j * np.pi * random.random(len(n))) for _ in range(2))
        # A line of the one-sided spectrum stands for a cosine of amplitude sqrt(2 G dn); irfft takes count / 2 of it.
        amplitude = np.sqrt(2.0 * density / self.length_m) * count / 2.0
        common = self._shared(n)
        left = np.fft.irfft(amplitude * one, count)
        right = np.fft.irfft(amplitude * (common * one + np.sqrt(1.0 - common**2) * other), count)
        return np.arange(count, dtype=np.float64) * spacing_m, left, right

    def _shared(self, n: FloatArray) -> FloatArray:
        """Coherent share of the right track's amplitude at each spatial frequency."""
        if self.coherence == "equal":
            return np.ones_like(n)
        if self.coherence == "independent":
            return np.zeros_like(n)
        from scipy.special import k1  # a file with a road in it is read without it

        x = 2.0 * np.pi * n * self.track_m
        shared: FloatArray = np.where(x > 0.0, x * k1(np.where(x > 0.0, x, 1.0)), 1.0)
        return np.clip(shared, 0.0, 1.0)


def random_road(road: RandomRoad, duration_s: float, speed_m_s: float, name: str) -> Road:
    """An ISO 8608 road under a car at a speed; it rises from the flat within the first two seconds."""
    distance_m, *sides = road.tracks()
    begin = [side - side[0] for side in sides]

    def heights(time_s: FloatArray, side: float) -> FloatArray:
        eased = np.clip(time_s / 2.0, 0.0, 1.0)
        ground = begin[0] if side > 0.0 else begin[1]
        height: FloatArray = eased * np.interp(time_s * speed_m_s, distance_m, ground, period=road.length_m)
        return height

    return Road(name, duration_s, speed_m_s, heights)


@dataclass(frozen=True)
class Obstacle:
    """A bump (1 - cos) or a pothole (flat, with edges) on one or both tracks.

    Attributes:
        height_m: of a bump; of a pothole its depth, positive.
        length_m: along the road.
        edge_m: length over which a pothole falls and rises; 0 for a bump.
        start_m: where it begins.
        sides: "both", "left" or "right".
        hole: it is a pothole.
    """

    height_m: float
    length_m: float
    edge_m: float
    start_m: float
    sides: str
    hole: bool

    def at(self, distance_m: FloatArray, side: float) -> FloatArray:
        """Height (m) at a distance (m)."""
        if (self.sides == "left" and side < 0.0) or (self.sides == "right" and side > 0.0):
            return np.zeros_like(distance_m)
        x = distance_m - self.start_m
        inside = (x > 0.0) & (x < self.length_m)
        if not self.hole:
            bump: FloatArray = inside * 0.5 * self.height_m * (1.0 - np.cos(2.0 * np.pi * x / self.length_m))
            return bump
        from_edge = np.minimum(x, self.length_m - x)
        falls = 0.5 * (1.0 - np.cos(np.pi * np.clip(from_edge / self.edge_m, 0.0, 1.0)))
        hole: FloatArray = -self.height_m * inside * falls
        return hole


def obstacle_road(obstacle: Obstacle, duration_s: float, speed_m_s: float, name: str) -> Road:
    """An obstacle on a flat road."""
    return Road(name, duration_s, speed_m_s, lambda time_s, side: obstacle.at(time_s * speed_m_s, side))


def recorded_road(distance_or_time: FloatArray, columns: FloatArray, speed_m_s: float, name: str) -> Road:
    """A recorded profile (distance m, left, right) or a drive file (time s, a column a wheel; speed 0).

    Args:
        distance_or_time: ascending, (k,).
        columns: heights (m), (k, 1) for all wheels the same, (k, 2) left and right, (k, 4) each wheel of a full car.
        speed_m_s: of the car; 0 for a drive file.
        name: for people.
    """
    ground = columns - columns[0]
    rate = speed_m_s if speed_m_s > 0.0 else 1.0
    duration_s = float(distance_or_time[-1] - distance_or_time[0]) / rate

    def column(time_s: FloatArray, index: int) -> FloatArray:
        at = distance_or_time[0] + np.clip(time_s, 0.0, duration_s) * rate
        height: FloatArray = np.interp(at, distance_or_time, ground[:, min(index, ground.shape[1] - 1)])
        return height

    def of_side(time_s: FloatArray, side: float) -> FloatArray:
        return column(time_s, 0 if side > 0.0 else 1)

    return Road(name, duration_s, speed_m_s, of_side, None, column if ground.shape[1] > 2 else None)

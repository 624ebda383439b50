"""From a ride to what the body answered: responses over frequency in dB, differences between two, load and travel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import csd, welch

from rig.dampers.arrays import FloatArray
from rig.vehicle.comfort import OF_MOTION, weighted_rms
from rig.vehicle.motion import Ride
from rig.vehicle.structure import Structure

BANDS = {"4-8 Hz": (4.0, 8.0), "0-18 Hz": (0.0, 18.0)}
LOWEST_HZ = 0.5
"""Below that a sweep of a minute has hardly one cycle."""
WINDOW_S = 4.0
COHERENT = 0.5
"""Coherence of motion and road below which no response is told: what moves there is not what the road does there."""
MOST_OF_BAND = 0.5
"""Of a band's frequencies, at which both have to follow the road."""
SILENT = 1e-9
"""RMS (m/s^2, rad/s^2) of a motion that the road does not excite: a symmetric car does not roll on it."""


@dataclass(frozen=True)
class Response:
    """What a car's body answered to a road.

    Attributes:
        frequency_Hz: (f,).
        level_dB: of each motion's acceleration for the height under the front left wheel, dB of 1 (m/s^2)/m or
            (rad/s^2)/m, (f,), NaN where it does not follow the road; None for a motion that was not excited. (On
            opposite sides of a symmetric car the dampers' asymmetry alone lifts the body, at twice the frequency.)
    """

    frequency_Hz: FloatArray
    level_dB: dict[str, FloatArray | None]


def response(ride: Ride, body: tuple[str, ...], road_m: FloatArray) -> Response:
    """H1 = S_xy / S_xx of the body's accelerations against the road's height.

    Args:
        ride: what the car did.
        body: names of its motions.
        road_m: height under the front left wheel, (k,).
    """
    step_s = float(ride.time_s[1] - ride.time_s[0])
    length = min(len(road_m), round(WINDOW_S / step_s))
    frequency_Hz, power = welch(road_m, 1.0 / step_s, nperseg=length)
    kept = (frequency_Hz >= LOWEST_HZ) & (frequency_Hz <= max(high for _, high in BANDS.values()))
    levels: dict[str, FloatArray | None] = {}
    for column, name in enumerate(body):
        motion = ride.acceleration[:, column]
        if np.sqrt(np.mean(motion**2)) < SILENT:
            levels[name] = None
            continue
        _, cross = csd(road_m, motion, 1.0 / step_s, nperseg=length)
        _, answered = welch(motion, 1.0 / step_s, nperseg=length)
        follows = np.abs(cross) ** 2 >= COHERENT * power * answered
        level = 20.0 * np.log10(np.abs(cross[kept]) / power[kept])
        levels[name] = np.where(follows[kept], level, np.nan) if np.any(follows[kept]) else None
    return Response(frequency_Hz[kept], levels)


def difference_dB(one: Response, other: Response, motion: str, band: tuple[float, float]) -> float | None:
    """Largest difference (dB) of two responses within a band (Hz); None where one has none in most of it."""
    a, b = one.level_dB.get(motion), other.level_dB.get(motion)
    if a is None or b is None:
        return None
    inside = (one.frequency_Hz >= band[0]) & (one.frequency_Hz <= band[1])
    apart = np.abs(a[inside] - b[inside])
    known = np.isfinite(apart)
    return float(np.max(apart[known])) if np.mean(known) > MOST_OF_BAND else None


def figures(ride: Ride, own: Structure) -> dict[str, float]:
    """Single numbers of a ride: weighted RMS of each motion, tyre load variation, travel, power and heat.

    `weighted_rms NAME` (m/s^2, rad/s^2; ISO 2631-1), `tyre_load_variation` (largest over the wheels: RMS of the load
    about rest over the load at rest), `travel_m` (largest between wheel and body), `damper_power_W` (mean over time,
    all dampers), `damper_heat_J` (all dampers), `tyre_off_share` (of the time with a wheel off the road).
    """
    step_s = float(ride.time_s[1] - ride.time_s[0])
    numbers = {
        f"weighted_rms {name}": weighted_rms(ride.acceleration[:, column], step_s, OF_MOTION[name])
        for column, name in enumerate(own.body)
    }
    load = ride.tyre_N / own.static_load_N - 1.0
    power = np.sum(ride.force_N * ride.speed_m_s, axis=1)
    ratio = own.damper[:, 0]
    return numbers | {
        "tyre_load_variation": float(np.max(np.sqrt(np.mean(load**2, axis=0)))),
        "travel_m": float(np.max(np.abs(ride.extension_m / ratio))),
        "damper_power_W": float(np.mean(power)),
        "damper_heat_J": float(np.sum(power) * step_s),
        "tyre_off_share": float(np.mean(np.any(ride.tyre_N <= 0.0, axis=1))),
    }

"""The quantities in the table `characteristics`: name, unit, subject and meaning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rig.comparison.readings import QUANTITIES as COMPARED
from rig.recording.quality.point_quality import PointQuality

SPECIMEN, BENCH = "specimen", "bench"
"""What a value or a verdict is about."""


@dataclass(frozen=True)
class StoredQuantity:
    """A quantity: its name in the database, title, SI unit, and what it is about."""

    name: str
    title: str
    unit: str
    subject: str = SPECIMEN


QUANTITIES = {one.name: one for one in (
    *(StoredQuantity(one.key, one.title, one.unit) for one in COMPARED.values()),
    StoredQuantity("gas_spring_stiffness", "Stiffness of the gas spring", "N/m"),
    StoredQuantity("coil_rate", "Rate of the coil's lag (1 / time constant)", "1/s"),
    StoredQuantity("peak_force_rebound", "Largest force in rebound", "N"),
    StoredQuantity("peak_force_compression", "Largest force in compression (negative)", "N"),
    StoredQuantity("coil_temperature", "Mean of the lowest and the highest coil temperature", "degC"),
    StoredQuantity("measured_amplitude", "Measured amplitude", "m", BENCH),
    StoredQuantity("measured_frequency", "Measured frequency", "Hz", BENCH),
    StoredQuantity("measured_current", "Measured mean current", "A", BENCH),
    StoredQuantity("force_at_rest", "Force at rest before the first motion", "N", BENCH),
    StoredQuantity("force_difference_at_rest", "Load cell minus force input of the controller, at rest", "N", BENCH),
    StoredQuantity("current_at_rest", "Reported current while the output stage is off", "A", BENCH),
    StoredQuantity("force_gain", "Sensitivity of the load cell relative to the controller's force input", "1", BENCH),
    StoredQuantity("force_offset", "Offset of the load cell from the controller's force input", "N", BENCH),
    StoredQuantity(
        "displacement_gain", "Sensitivity of the LVDT relative to the controller's position input", "1", BENCH
    ),
    StoredQuantity("displacement_offset", "Offset of the LVDT from the controller's position input", "m", BENCH),
    StoredQuantity("force_noise", "Noise of a force sample", "N", BENCH),
    StoredQuantity("harmonic_distortion", "Harmonic distortion of the motion, relative to the fundamental", "1", BENCH),
)}  # fmt: skip
"""Name -> quantity; those that `rig compare` knows have its names."""


def quantity_named(name: str) -> StoredQuantity:
    """The quantity with a name."""
    return QUANTITIES[name]


Estimate = tuple[float | None, float | None]


def _temperature(quality: PointQuality) -> Estimate:
    low, high = quality.coil_low_degC, quality.coil_high_degC
    return (None if low is None or high is None else 0.5 * (low + high)), None


STORED_WITH_POINT: dict[str, Callable[[PointQuality], Estimate]] = {
    "peak_force_rebound": lambda quality: (quality.loop.rebound_N, None),
    "peak_force_compression": lambda quality: (quality.loop.compression_N, None),
    "coil_temperature": _temperature,
    "measured_amplitude": lambda quality: (quality.motion.amplitude_m, quality.motion.amplitude_std_m),
    "measured_frequency": lambda quality: (quality.motion.frequency_Hz, None),
    "measured_current": lambda quality: (quality.current.mean_A, None),
    "force_at_rest": lambda quality: (quality.rest.force_N, quality.rest.force_zero_std_N),
    "force_difference_at_rest": lambda quality: (
        quality.rest.force_difference_N, quality.rest.force_difference_std_N
    ),
    "current_at_rest": lambda quality: (quality.rest.current_A, quality.rest.current_std_A),
    "force_gain": lambda quality: (quality.force.reference_gain, quality.force.reference_gain_std),
    "force_offset": lambda quality: (quality.force.reference_offset, quality.force.reference_offset_std),
    "displacement_gain": lambda quality: (quality.displacement.reference_gain, quality.displacement.reference_gain_std),
    "displacement_offset": lambda quality: (
        quality.displacement.reference_offset, quality.displacement.reference_offset_std
    ),
    "force_noise": lambda quality: (quality.loop.noise_N, None),
    "harmonic_distortion": lambda quality: (quality.motion.distortion, None),
}
"""Quantities that are stored with the point: name -> value and its standard uncertainty, None where unknown."""

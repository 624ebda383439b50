"""The quantities in the table `characteristics`: name, unit, subject and meaning."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product

from rig.comparison.readings import QUANTITIES as COMPARED
from rig.recording.quality.point_quality import PointQuality
from rig.signals.wear_trend import RULES

SPECIMEN, BENCH = "specimen", "bench"
"""What a value or a verdict is about."""


@dataclass(frozen=True)
class StoredQuantity:
    """A quantity: its name in the database, title, SI unit, and what it is about."""

    name: str
    title: str
    unit: str
    subject: str = SPECIMEN


ENDURANCE_CYCLES, ENDURANCE_PROGRESS = "endurance_cycles", "endurance_progress"


def response_time(name: str, *, switched: str, direction: str) -> str:
    """Quantity of a response time: its name, the current switched `on` or `off`, in `rebound` or `compression`."""
    return f"response_{name}_{switched}_{direction}"


def cycles_to(rule: str) -> str:
    """Quantity of the cycles after which a stop rule ended an endurance test."""
    return f"endurance_cycles_to_{rule}"


def wear(rule: str) -> str:
    """Quantity of the value that a stop rule watches, at the end of an endurance test."""
    return f"endurance_end_{rule}"


RESPONSE_TIMES = {
    "dead_time": "Dead time of the force", "t63": "Time to 63 % of the force step",
    "t90": "Time to 90 % of the force step", "t95": "Time to 95 % of the force step",
    "coil_t63": "Time to 63 % of the step of the coil current",
}
HYBRID = (
    StoredQuantity("hybrid_tracking_error", "Hybrid test: RMS error of the rod, relative to its target", "1", BENCH),
    StoredQuantity("hybrid_reference_error", "Hybrid test: RMS error of the body's motion, relative", "1", BENCH),
    StoredQuantity("hybrid_hop_error", "Hybrid test: RMS error of the wheel's motion, relative", "1", BENCH),
    StoredQuantity("hybrid_delay", "Hybrid test: delay of the rod behind its set-point", "s", BENCH),
    StoredQuantity("hybrid_energy_error", "Hybrid test: largest energy error, relative to the work", "1", BENCH),
)
SPECIAL = (
    *(StoredQuantity(response_time(name, switched=switched, direction=direction),
                     f"{title}, current switched {switched}, {direction}", "s")
      for (name, title), switched, direction in product(RESPONSE_TIMES.items(), ("on", "off"),
                                                        ("rebound", "compression"))),
    StoredQuantity(ENDURANCE_CYCLES, "Endurance test: cycles run", "1"),
    StoredQuantity(ENDURANCE_PROGRESS, "Endurance test: cycles run, relative to those planned", "1"),
    *(StoredQuantity(cycles_to(name), f"Endurance test: cycles until a stop rule ended it ({rule.words})", "1")
      for name, rule in RULES.items()),
    *(StoredQuantity(wear(name), f"Endurance test: {rule.words} at its end" + (", relative" if rule.relative else ""),
                     "1" if rule.relative else "degC") for name, rule in RULES.items()),
    *HYBRID,
)  # fmt: skip
"""Quantities of the tests that are not loops: response, endurance and hybrid tests."""

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
    StoredQuantity("force_offset", "Offset of the load cell relative to the controller's force input", "N", BENCH),
    StoredQuantity(
        "displacement_gain", "Sensitivity of the LVDT relative to the controller's position input", "1", BENCH
    ),
    StoredQuantity(
        "displacement_offset", "Offset of the LVDT relative to the controller's position input", "m", BENCH
    ),
    StoredQuantity("force_noise", "Noise of a force sample", "N", BENCH),
    StoredQuantity("harmonic_distortion", "Harmonic distortion of the motion, relative to the fundamental", "1", BENCH),
    *SPECIAL,
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

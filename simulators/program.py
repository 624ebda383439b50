"""A START command as the function generator's order: does it make sense, and does it stay within the limits?"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from drivers.roles import ActuatorLimits, Waveform

FLOAT_SLACK = 1.0 + 1e-6
"""Registers are float32: a value exactly at its limit may come back a rounding step above it."""

Values = Mapping[str, float | str]
Program = dict[str, float]
FloatArray = NDArray[np.float64]


def read_program(values: Values, table: FloatArray) -> Program | None:
    """The plant's order for the values of the command block; None when one of them makes no sense.

    Args:
        values: what the command wrote, by name (SI).
        table: the table waveform as loaded so far (m about the centre), shape (n,).
    """
    waveform = int(values["waveform"])
    if waveform not in set(Waveform):
        return None
    frequency_Hz = float(values["frequency"])
    if waveform == Waveform.TABLE:
        length, interval_s = int(values["table_length"]), float(values["table_interval"])
        if not (2 <= length <= len(table) and 0 < interval_s < math.inf):
            return None
        frequency_Hz = 1.0 / (length * interval_s)
    program = {
        "waveform": float(waveform),
        "amplitude_m": float(values["amplitude"]),
        "frequency_Hz": frequency_Hz,
        "centre_m": float(values["centre"]),
        "full_cycles": float(values["cycles"]),
        "ramp_in_cycles": float(values["ramp_in_cycles"]),
        "ramp_out_cycles": float(values["ramp_out_cycles"]),
    }
    finite = all(math.isfinite(value) for value in program.values())
    positive = program["frequency_Hz"] > 0 and program["full_cycles"] > 0 and program["amplitude_m"] >= 0
    ramps = program["ramp_in_cycles"] >= 0 and program["ramp_out_cycles"] >= 0
    return program if finite and positive and ramps else None


def peaks(program: Program, table: FloatArray) -> tuple[float, float, float]:
    """Largest excursion (m), speed (m/s) and acceleration (m/s^2) a program asks for (PHYSICS section 1).

    Sine: `A`, `2 pi f A`, `(2 pi f)^2 A`. Triangle: `A`, `4 f A`; its corners are rounded by the servo's own limit, as
    are those of a table.
    """
    amplitude_m, frequency_Hz = program["amplitude_m"], program["frequency_Hz"]
    omega = 2.0 * math.pi * frequency_Hz
    if program["waveform"] == Waveform.SINE:
        return amplitude_m, omega * amplitude_m, omega**2 * amplitude_m
    if program["waveform"] == Waveform.TRIANGLE:
        return amplitude_m, 4.0 * frequency_Hz * amplitude_m, 0.0
    steps_m = np.abs(np.diff(table, append=table[:1]))
    return float(np.abs(table).max()), float(steps_m.max()) * len(table) * frequency_Hz, 0.0


def within_limits(program: Program, table: FloatArray, limits: ActuatorLimits) -> bool:
    """Whether travel, peak speed and peak acceleration stay within the controller's limits."""
    amplitude_m, speed_m_s, acceleration_m_s2 = peaks(program, table)
    return (
        program["centre_m"] - amplitude_m >= limits.position_min_m
        and program["centre_m"] + amplitude_m <= limits.position_max_m
        and speed_m_s <= limits.speed_max_m_s * FLOAT_SLACK
        and acceleration_m_s2 <= limits.acceleration_max_m_s2 * FLOAT_SLACK
    )

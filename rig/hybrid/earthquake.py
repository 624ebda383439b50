"""Ground motion: synthesised, identical for a seed, or a user's record.

The benchmark's own records (El Centro 1940, Kobe 1995, Morgan Hill 1984) are not included: their files name no licence.
A record from a file replaces the synthesised one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rig.errors import FileProblem
from rig.signals.arrays import FloatArray
from rig.text_file import read_text

LIMIT_BYTES = 20_000_000
SEED = 1940
PEAK_m_s2 = 0.9
"""The specimen is loaded as by El Centro at the benchmark's intensity of 0.4: up to 7 kN in case 3."""
GROUND_Hz, GROUND_DAMPING = 2.5, 0.6
"""Kanai's and Tajimi's firm ground."""
SLOWEST_Hz, SLOWEST_DAMPING = 0.25, 0.6
"""Clough's and Penzien's second filter: no displacement that stays."""
STEP_s, SHAKING_s, QUIET_s = 0.01, 31.0, 10.0
RISE_s, DECAY_FROM_s, DECAY_1_s = 2.0, 11.0, 0.25
LARGEST_m_s2 = 30.0


@dataclass(frozen=True)
class Earthquake:
    """Ground acceleration at equal steps, linear between them.

    Attributes:
        name: for tables: what it is and how strong.
        step_s: between samples, s.
        acceleration_m_s2: (n,).
    """

    name: str
    step_s: float
    acceleration_m_s2: FloatArray

    @property
    def duration_s(self) -> float:
        """Between the first and the last sample, s."""
        return (len(self.acceleration_m_s2) - 1) * self.step_s

    def at(self, rate_Hz: float) -> FloatArray:
        """Acceleration (n,), m/s^2, at another rate."""
        times = np.arange(int(self.duration_s * rate_Hz)) / rate_Hz
        return np.interp(times, np.arange(len(self.acceleration_m_s2)) * self.step_s, self.acceleration_m_s2)


def synthesised(seed: int = SEED) -> Earthquake:
    """White noise through the ground's filters, with a beginning and an end, and ten quiet seconds after it."""
    from scipy.signal import bilinear, lfilter  # only this needs it, and it takes a second to load

    count = round(SHAKING_s / STEP_s)
    ground, damping = 2.0 * math.pi * GROUND_Hz, GROUND_DAMPING
    slow, slow_damping = 2.0 * math.pi * SLOWEST_Hz, SLOWEST_DAMPING
    shaken = np.random.default_rng(seed).standard_normal(count)
    filters = (
        ([2 * damping * ground, ground**2], [1.0, 2 * damping * ground, ground**2]),
        ([1.0, 0.0, 0.0], [1.0, 2 * slow_damping * slow, slow**2]),
    )
    for numerator, denominator in filters:
        b, a = bilinear(numerator, denominator, 1.0 / STEP_s)
        shaken = lfilter(b, a, shaken)
    time_s = np.arange(count) * STEP_s
    envelope = np.minimum((time_s / RISE_s) ** 2, 1.0) * np.exp(-DECAY_1_s * np.maximum(time_s - DECAY_FROM_s, 0.0))
    shaken = shaken * envelope
    shaken *= PEAK_m_s2 / np.max(np.abs(shaken))
    name = f"synthesised (Kanai-Tajimi, seed {seed}, {PEAK_m_s2:g} m/s^2)"
    return Earthquake(name, STEP_s, np.concatenate([shaken, np.zeros(round(QUIET_s / STEP_s))]))


def read(path: Path, intensity: float) -> Earthquake:
    """A record from a CSV file: lines of time (s) and acceleration (m/s^2); `#` and headings are skipped.

    Args:
        path: the file.
        intensity: factor on the acceleration.

    Raises:
        FileProblem: what cannot be read, every line of it; fewer than two lines, unequal steps, more than 30 m/s^2.
    """
    rows: list[list[float]] = []
    problems: list[str] = []
    for number, line in enumerate(read_text(path, LIMIT_BYTES).splitlines(), 1):
        parts = line.split("#")[0].replace(",", " ").replace(";", " ").split()
        values = [value for value in map(_number, parts) if value is not None]
        if len(values) == len(parts) == 2:
            rows.append(values)
        elif parts and (rows or problems or values):
            problems.append(f"line {number}: {line.strip()[:40]!r}: expected time (s) and acceleration (m/s^2)")
    if not problems:
        problems = _implausible(np.array(rows).reshape(-1, 2), intensity)
    if problems:
        raise FileProblem(str(path), problems)
    table = np.array(rows)
    step_s = float((table[-1, 0] - table[0, 0]) / (len(table) - 1))
    return Earthquake(f"{path.name} x {intensity:g}", step_s, table[:, 1] * intensity)


def _number(text: str) -> float | None:
    try:
        value = float(text)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _implausible(table: FloatArray, intensity: float) -> list[str]:
    if len(table) < 2:
        return [f"got {len(table)} lines of numbers, expected at least 2"]
    steps = np.diff(table[:, 0])
    step_s = float((table[-1, 0] - table[0, 0]) / (len(table) - 1))
    problems = []
    uneven = np.flatnonzero(~(np.abs(steps - step_s) <= 0.01 * step_s))
    if step_s <= 0.0 or len(uneven):
        at = table[uneven[0], 0] if len(uneven) else table[0, 0]
        problems.append(
            f"the time steps are not equal: {step_s:g} s on average; a different step begins at {at:g} s. Fix: "
            "resample the record"
        )
    elif step_s * (len(table) - 1) < 1.0:
        problems.append(f"got a record of {step_s * (len(table) - 1):g} s, expected at least 1 s")
    peak = float(np.max(np.abs(table[:, 1]))) * intensity
    if not 0.0 < peak <= LARGEST_m_s2:
        at = f"at intensity {intensity:g}; expected more than 0 and at most {LARGEST_m_s2:g} m/s^2"
        problems.append(f"peak acceleration {peak:g} m/s^2 {at}")
    return problems

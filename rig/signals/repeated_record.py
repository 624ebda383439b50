"""A record that repeats a cycle: the motion of a block of an endurance test that no generator's waveform has.

A cycle is a sum of sines (`SineSum`), or a whole signal that begins and ends at rest (`SignalCycle`). A sum of sines is
moving at the ends of its cycles: the motion is continued over `ramp_s` before the first and after the last of them, and
faded there. A signal is faded within each of its cycles, so that a block needs no ramps.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Protocol

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.record import LONGEST_S, STEP_S, NoRecord, Record, with_faded_ends

LARGEST_RATIO = 1000
"""Frequencies whose ratio needs larger whole numbers have no common period that a test could use."""
RATIO_TOLERANCE = 1e-9
SIMPLE = 4
"""Largest denominator of a ratio that is proposed."""


class Cycle(Protocol):
    """A motion that repeats itself."""

    @property
    def name(self) -> str:
        """For people."""

    @property
    def period_s(self) -> float:
        """After which it repeats itself (s)."""

    @property
    def ramp_s(self) -> float:
        """Over which it is faded before the first and after the last cycle (s)."""

    @property
    def highest_Hz(self) -> float:
        """Highest frequency (Hz)."""

    @property
    def sha256(self) -> str:
        """Of the file it was read from; empty where there is none."""

    def at(self, time_s: FloatArray) -> FloatArray:
        """Position (n,) about the centre, m, at times (s) since the start of a cycle, of either sign."""


@dataclass(frozen=True)
class SineSum:
    """Sines that are added, each zero and rising at the start of a cycle.

    Attributes:
        sines: amplitude (m) and frequency (Hz) of each, the base sine first.
        periods: of the base sine in a cycle.
        ramp_s: s.
    """

    sines: tuple[tuple[float, float], ...]
    periods: int
    ramp_s: float

    @property
    def name(self) -> str:
        """For people."""
        return " + ".join(f"{frequency_Hz:.4g} Hz" for _, frequency_Hz in self.sines)

    @property
    def period_s(self) -> float:
        """See `Cycle`."""
        return self.periods / self.sines[0][1]

    @property
    def highest_Hz(self) -> float:
        """See `Cycle`."""
        return max(frequency_Hz for _, frequency_Hz in self.sines)

    @property
    def sha256(self) -> str:
        """See `Cycle`."""
        return ""

    def at(self, time_s: FloatArray) -> FloatArray:
        """See `Cycle`."""
        parts = [size_m * np.sin(math.tau * frequency_Hz * time_s) for size_m, frequency_Hz in self.sines]
        return np.asarray(np.sum(parts, axis=0), np.float64)


def common_periods(frequencies_Hz: tuple[float, ...]) -> int | None:
    """Periods of the first frequency after which all of them repeat themselves together; None: too many.

    Args:
        frequencies_Hz: at least one.
    """
    periods = 1
    for frequency_Hz in frequencies_Hz[1:]:
        ratio = Fraction(frequency_Hz / frequencies_Hz[0]).limit_denominator(LARGEST_RATIO)
        if abs(float(ratio) * frequencies_Hz[0] / frequency_Hz - 1.0) > RATIO_TOLERANCE:
            return None
        periods = math.lcm(periods, ratio.denominator)
    return periods if periods <= LARGEST_RATIO else None


def simple_ratio(ratio: float) -> float:
    """A ratio of frequencies near another one, but not 1; several of them have a short common period.

    Args:
        ratio: positive.
    """
    below = 2.0 ** round(math.log2(ratio))
    near = float(Fraction(ratio).limit_denominator(SIMPLE)) if ratio > 1.0 / SIMPLE else below
    return near if near != 1.0 else 1.5 if ratio > 1.0 else 0.5


@dataclass(frozen=True)
class SignalCycle:
    """A whole signal: each repetition begins and ends at rest at the centre.

    Attributes:
        record: the signal, faded at both ends.
    """

    record: Record

    @property
    def name(self) -> str:
        """For people."""
        return self.record.name

    @property
    def period_s(self) -> float:
        """See `Cycle`."""
        return self.record.duration_s

    @property
    def ramp_s(self) -> float:
        """No ramp is needed between cycles that begin and end at rest."""
        return 0.0

    @property
    def highest_Hz(self) -> float:
        """See `Cycle`."""
        return self.record.highest_Hz

    @property
    def sha256(self) -> str:
        """See `Cycle`."""
        return self.record.sha256

    def at(self, time_s: FloatArray) -> FloatArray:
        """See `Cycle`; at the times of the signal's samples."""
        places = np.round(time_s / STEP_S).astype(np.int64) % (len(self.record.shape) - 1)
        return np.asarray(self.record.amplitude_m * self.record.shape[places], np.float64)


@dataclass(frozen=True)
class RepeatedRecord(Record):
    """A record of some cycles.

    Attributes:
        cycle: what is repeated.
    """

    cycle: Cycle = field(kw_only=True, repr=False)

    def of_cycles(self, cycles: int) -> RepeatedRecord:
        """The same with another number of cycles."""
        return repeated_record(self.cycle, cycles)


def most_cycles(cycle: Cycle) -> int:
    """Cycles that a record can have at most; 0 where one is too long."""
    return max(0, math.floor((LONGEST_S - 2.0 * cycle.ramp_s) / cycle.period_s + 1e-9))


def repeated_record(cycle: Cycle, cycles: int) -> RepeatedRecord:
    """A cycle so many times, between its ramps.

    The ramps are lengthened by less than `STEP_S`, so that what lies between them is a whole number of cycles.

    Args:
        cycle: what is repeated.
        cycles: 1 to `most_cycles`.

    Raises:
        NoRecord: the record would be too long.
    """
    if not 1 <= cycles <= most_cycles(cycle):
        raise NoRecord(
            f"{cycles} cycles of {cycle.period_s:.4g} s do not fit into a motion of at most {LONGEST_S:g} s"
        )
    between_s = cycles * cycle.period_s
    steps = math.ceil((between_s + 2.0 * cycle.ramp_s) / STEP_S - 1e-6)
    ramp_s = max(0.0, 0.5 * (steps * STEP_S - between_s)) if cycle.ramp_s else 0.0
    position_m = cycle.at(STEP_S * np.arange(steps + 1, dtype=np.float64) - ramp_s)
    if ramp_s:
        position_m = with_faded_ends(position_m, ramp_s)
    largest_m = float(np.max(np.abs(position_m)))
    shape = np.asarray(position_m / largest_m, np.float64)
    mark = hashlib.sha256(shape.tobytes()).hexdigest()
    return RepeatedRecord(
        cycle.name, steps * STEP_S, ramp_s, cycle.highest_Hz, cycle.sha256, amplitude_m=largest_m, mark=mark,
        shape=shape, cycle=cycle,
    )  # fmt: skip

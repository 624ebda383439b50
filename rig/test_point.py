"""One test point as a value, the same from matrix to recording to report (PHYSICS: waveforms (1) and (2))."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from rig.display import SI, Display
from rig.signals.program_cycles import RepeatedProgram
from rig.signals.record import Record, RecordFacts
from rig.signals.waveform import WAVEFORMS, Waveform, waveform_named

LOOP, FRICTION, CURRENT_STEP, HYBRID, SIGNAL = "loop", "friction", "current_step", "hybrid", "signal"
RESPONSE = "response"
ENDURANCE = "endurance"
"""The kinds of test points."""
PASSIVE = "passive"
"""The law of a hybrid test at constant current."""
LARGEST_SKEW_PERIODS = 0.003
"""Largest standard deviation of the delay between force and displacement of a valid point, in periods of its motion."""
AMPLITUDE_SUSPECT, AMPLITUDE_INVALID = 0.05, 0.10
"""Relative errors of the amplitude beyond which a point is suspect or invalid, if the amplitude is not adapted."""


class Forecast(NamedTuple):
    """What a motion that is no waveform is forecast to reach: m/s, m/s^2, N, and the energy turned to heat, J."""

    peak_speed_m_s: float
    peak_acceleration_m_s2: float
    force_N: float
    energy_J: float


class EnduranceStep(NamedTuple):
    """The position of a point in an endurance test: of a block of its cycles, or of a performance point between blocks.

    Attributes:
        test: id of the endurance test.
        cycles_before: cycles of the test planned before this point; of a resumed block, and after a stop rule, those
            that were run.
        total: cycles of the whole test.
        block: number of the block, from 1; 0 of a performance point.
        block_cycles: cycles of the whole block; a resumed block has fewer `cycles` left.
        keep_every: interval, in cycles of the test, at which full samples are stored; 0 for a performance point.
        unseen_cycles: cycles that can run at most after the recording of a block was cut off.
        program_cycles: cycles after which the current program of a block repeats itself; 0 at a constant current.
    """

    test: str
    cycles_before: int
    total: int
    block: int = 0
    block_cycles: int = 0
    keep_every: int = 0
    unseen_cycles: int = 0
    program_cycles: int = 0


def peak_speed_m_s(waveform: str, amplitude_m: float, frequency_Hz: float) -> float:
    """Peak speed of a cyclic motion, m/s.

    Raises:
        UnknownWaveform: there is no such waveform.
    """
    return waveform_named(waveform).peak_velocity * amplitude_m * frequency_Hz


def rate_text(waveform: str, amplitude_m: float, frequency_Hz: float, shown: Display, *, by_speed: bool) -> str:
    """The rate of a cyclic motion as every screen, page and report states it: its frequency or its peak speed.

    Args:
        waveform: its name.
        amplitude_m: amplitude, m.
        frequency_Hz: frequency, Hz.
        shown: units of the speed.
        by_speed: the motion is stated by its speed.
    """
    if by_speed and waveform in WAVEFORMS:
        return shown.speed.text(peak_speed_m_s(waveform, amplitude_m, frequency_Hz))
    return f"{frequency_Hz:.4g} Hz"


@dataclass(frozen=True)
class TestPoint:
    """A waveform about a centre at a constant or stepped coil current, or current steps while the rod is at rest.

    Attributes:
        id: name of the point.
        waveform: name of the waveform; `hold` where the rod is at rest or follows a simulated car.
        amplitude_m: of a signal the largest distance from the centre, of a hybrid test the largest extension forecast.
        frequency_Hz: of a signal how often it crosses its mean upwards; of a record that is repeated, of its cycles.
        current_A: of stepped currents the largest of them; of a current that a law commands the highest it may command.
        cycles: at full amplitude, in addition to both ramps; the whole of a signal or of a hybrid test is one cycle.
        ramp_in_cycles, ramp_out_cycles: fade in and fade out.
        centre_m: centre of the motion in the displacement sensor's coordinate.
        repeat: counts from 1.
        rest_s: rest before the point.
        kind: `loop`, `friction` (a slow triangle at 0 A, for gas force and friction), `current_step`, `hybrid`,
            `signal`, `response` (a triangle during which the current is stepped) or `endurance` (a block of an
            endurance test).
        steps_A: of stepped currents the currents in turn; of a current that a law commands the first one.
        steps_s: of a current program, which runs during a motion, when each of `steps_A` is commanded (s since the
            start of the motion, ramp included; 0 first); each current is held until the next. Empty at any other point.
        law: what commands the current of a hybrid test; else empty.
        record: the motion of a signal; a recorded point keeps only its facts, without samples.
        target: what the rod is to follow where `record` is the iterated command for it; not recorded.
        forecast: peaks of a hybrid test; not recorded.
        endurance: position in an endurance test; None of a point outside one, and of the points before its first cycle.
        by_speed: whether the matrix states a speed at this amplitude, so that the frequency follows.
        compensator: leads the set-points of a hybrid test; not recorded.
    """

    __test__ = False  # not a test class, whatever its name

    id: str
    waveform: str
    amplitude_m: float
    frequency_Hz: float
    current_A: float
    cycles: float = 10
    ramp_in_cycles: float = 1.0
    ramp_out_cycles: float = 1.0
    centre_m: float = 0.0
    repeat: int = 1
    rest_s: float = 0.0
    kind: str = LOOP
    steps_A: tuple[float, ...] = ()
    steps_s: tuple[float, ...] = ()
    law: str = ""
    record: RecordFacts | None = None
    target: Record | None = None
    forecast: Forecast | None = None
    compensator: str = ""
    endurance: EnduranceStep | None = None
    by_speed: bool = field(default=False, compare=False)

    @property
    def shape(self) -> Waveform:
        """The waveform as a value.

        Raises:
            UnknownWaveform: a recorded point, of a test from elsewhere, may have another one.
        """
        return waveform_named(self.waveform)

    @property
    def record_samples(self) -> Record | None:
        """The record of a signal with its samples; None of any other point, and of a recorded one."""
        return self.record if isinstance(self.record, Record) else None

    @property
    def at_rest(self) -> bool:
        """Whether the rod is at rest while the current is stepped."""
        return self.kind == CURRENT_STEP

    @property
    def cyclic(self) -> bool:
        """Whether the motion repeats itself, so that its cycles can be counted and compared."""
        return self.kind not in {CURRENT_STEP, HYBRID, SIGNAL} and not self.repeats_record

    @property
    def adapts(self) -> bool:
        """Whether the commanded amplitude is compensated where the matrix asks for that."""
        motion = self.kind == LOOP or (self.kind == ENDURANCE and self.cyclic)
        return motion and not self.current_programmed

    @property
    def has_frequency(self) -> bool:
        """Whether `frequency_Hz` is a frequency that people know the point by."""
        return self.kind not in {SIGNAL, HYBRID} and not self.repeats_record

    @property
    def repeats_record(self) -> bool:
        """Whether this is a block of an endurance test whose cycle is a record."""
        return self.kind == ENDURANCE and self.record is not None

    @property
    def current_by_law(self) -> bool:
        """Whether a law commands the current anew at each step of a hybrid test."""
        return self.kind == HYBRID and self.law not in {"", PASSIVE}

    @property
    def current_programmed(self) -> bool:
        """Whether the station steps the current during the motion."""
        return bool(self.steps_s)

    @property
    def steps_in_motion(self) -> tuple[tuple[float, float], ...]:
        """Time (s) and current (A) of the steps that the station makes; what is left of a block makes only some."""
        count = sum(at_s < self.motion_s for at_s in self.steps_s)
        return tuple(zip(self.steps_s[:count], self.steps_A[:count], strict=True))

    @property
    def repeated_program(self) -> RepeatedProgram | None:
        """The current program that a block of an endurance test repeats; None at a constant current."""
        if self.endurance is None or not self.endurance.program_cycles or not self.current_programmed:
            return None
        return RepeatedProgram.of_steps(
            self.steps_s, self.steps_A, self.frequency_Hz, self.first_cycle_s, self.endurance.program_cycles
        )

    @property
    def first_cycle_s(self) -> float:
        """Start of the first cycle at full amplitude that begins at mid-travel (s since the start of the motion)."""
        if self.record is not None:
            return self.record.ramp_s
        return math.ceil(self.ramp_in_cycles) / self.frequency_Hz

    @property
    def after_cycles(self) -> bool:
        """Whether this point shows the specimen after cycles of an endurance test."""
        return self.endurance is not None

    @property
    def without_name(self) -> TestPoint:
        """The same motion without id, repeat and position in an endurance test: equal for points with equal motions."""
        return replace(self, id="", repeat=1, endurance=None)

    @property
    def first_current_A(self) -> float:
        """The current that must have settled before the point begins (A)."""
        return self.steps_A[0] if self.steps_A else self.current_A

    @property
    def peak_speed_m_s(self) -> float:
        """Largest speed (m/s)."""
        if self.forecast is not None:
            return self.forecast.peak_speed_m_s
        if self.record_samples is not None:
            return self.record_samples.peak_velocity * self.amplitude_m
        return self.shape.peak_velocity * self.frequency_Hz * self.amplitude_m

    @property
    def peak_acceleration_m_s2(self) -> float:
        """Largest acceleration (m/s2), corners as the controller rounds them."""
        if self.forecast is not None:
            return self.forecast.peak_acceleration_m_s2
        if self.record_samples is not None:
            return self.record_samples.peak_acceleration * self.amplitude_m
        return self.shape.peak_acceleration * self.frequency_Hz**2 * self.amplitude_m

    @property
    def highest_Hz(self) -> float:
        """Highest frequency of the motion (Hz): of a signal where it is known, else `frequency_Hz`; 0 at rest."""
        if self.at_rest:  # its `frequency_Hz` is how often the current changes
            return 0.0
        return (0.0 if self.record is None else self.record.highest_Hz) or self.frequency_Hz

    @property
    def motion_s(self) -> float:
        """Duration of the programme, ramps included (s)."""
        if self.record is not None:
            return self.record.duration_s
        return (self.ramp_in_cycles + self.cycles + self.ramp_out_cycles) / self.frequency_Hz

    @property
    def motion(self) -> str:
        """What moves, by name: "sine", "road iso8608-c", "hybrid test", "current steps"."""
        name = {HYBRID: "hybrid test", CURRENT_STEP: "current steps"}.get(self.kind, self.waveform)
        if self.record is None:
            return name
        named = name if self.record.name in {"", name} else f"{name} {self.record.name}"
        return f"{named} (force)" if self.record.of_force else named

    def rate(self, shown: Display) -> str:
        """How fast the motion is, in the terms of the matrix: "1.5 Hz", of a point stated by its speed "0.131 m/s"."""
        return rate_text(self.waveform, self.amplitude_m, self.frequency_Hz, shown, by_speed=self.by_speed)

    @property
    def described(self) -> str:
        """In one phrase, in SI units: "sine 50 mm 1.5 Hz 1 A"; of what does not repeat itself, how far and how long."""
        return self.phrase(SI)

    def phrase(self, shown: Display) -> str:
        """`described` in the units of a display."""
        if self.kind == CURRENT_STEP:
            return f"{self.motion} for {self.motion_s:.3g} s, up to {self.current_A:.3g} A"
        current = f"{self.current_A:.3g} A"
        if self.current_programmed:
            current = f"{min(self.steps_A):.3g} to {max(self.steps_A):.3g} A"
        if self.has_frequency and self.frequency_Hz == 0.0:  # only of a record
            return f"{self.motion}, no whole cycle, {current}"
        if self.has_frequency:
            size = shown.displacement.text(self.amplitude_m)
            return f"{self.motion} {size} {self.rate(shown)} {current}"
        if self.repeats_record:
            size = shown.displacement.text(self.amplitude_m, 3)
            return f"{self.motion} up to {size}, {1.0 / self.frequency_Hz:.4g} s per cycle, {current}"
        if self.current_by_law:
            current = f"up to {current} by {self.law}"
        size = shown.displacement.text(self.amplitude_m, 3)
        return f"{self.motion} up to {size} for {self.motion_s:.3g} s, {current}"

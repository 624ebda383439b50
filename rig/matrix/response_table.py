"""Tests of the response time: `[[response]]`, a triangle during which the current is stepped in the straight parts.

Each half stroke moves at constant speed. In a cycle of six half strokes the current is stepped once in each direction
of the motion upwards and once downwards; two half strokes without a step lie between, so that the step that follows has
the other sign:

    compression  rebound  compression  rebound  compression  rebound
        up        down        -          up        down         -

A step waits until the rod has its constant speed after the reversal (`run_in`) and a baseline has been recorded, and
leaves the rest of the half stroke, at least `window`, for the force to settle. The instants of repeated steps are
staggered, so that they fall between samples at different places: a response of a few milliseconds is sampled finely
over the repeats although the rig samples coarsely.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Annotated, ClassVar

from pydantic import Field, field_validator

from protocols.descriptions import Problem
from rig.files.quantity import Quantity
from rig.files.section import Section
from rig.matrix.motion_size import OTHER_NAMES, Amplitude, PeakSpeed, Stroke
from rig.matrix.sections import CoilCurrent, Identifier, no_value_twice
from rig.signals.waveform import TRIANGLE
from rig.test_point import RESPONSE, TestPoint
from rig.units import show

RAMP_CYCLES = 1.0
FIRST_CORNER = RAMP_CYCLES + 0.25
"""Cycles until the first reversal at full amplitude, after which the rod moves in compression."""
HALF_STROKES = 6
STEPS = ((0, True), (1, False), (3, True), (4, False))
"""Half stroke of each step in a cycle of six, and whether the current rises."""
BASELINE_S = 0.030
"""Shortest time at constant speed before a step, from which the drift of the force is read."""
BASELINE_SHARE = 1.0 / 3.0
"""Of the time that a half stroke leaves over."""
START_S = 0.010
"""A motion may start so much earlier or later than the station knows."""
STAGGER_S = 0.010
"""Over which the instants of repeated steps are spread: the status period of an ECU, the slowest of the samples."""
GOLDEN = 0.5 * (math.sqrt(5.0) - 1.0)
SMALLEST_STEP_A = 0.05


class ResponseTable(Section):
    """Steps of the current at constant velocity, from which dead time and response time are measured."""

    other_names: ClassVar[Mapping[str, str]] = {
        **{name: key for name, key in OTHER_NAMES.items() if "frequency" not in key}, "low": "from", "base": "from",
        "repeat": "repeats", "currents": "current", "high": "current",
    }

    id: Identifier | None = None
    amplitude_m: Amplitude | None = Field(default=None, alias="amplitude")
    stroke_m: Stroke | None = Field(
        default=None, alias="stroke", description="peak-to-peak displacement of the triangle; replaces amplitude"
    )
    speed_m_s: tuple[PeakSpeed, ...] = Field(
        alias="speed", min_length=1, description="constant speeds at which the current is stepped, in both directions",
        examples=[["0.05 m/s", "0.1 m/s"]],
    )
    current_A: tuple[CoilCurrent, ...] = Field(
        alias="current", min_length=1, description="currents to which the current is stepped from the value of from",
        examples=[["1 A", "2 A"]],
    )
    from_A: CoilCurrent = Field(default=0.0, alias="from", description="current before and after each step")
    repeats: int = Field(
        default=5, ge=1, le=100, description="number of repeats of each step; in each repeat, the current rises once "
            "and falls once in each direction of the motion"
    )
    window_s: Annotated[float, Quantity("time", "5 ms", "60 s")] = Field(
        default=0.1, alias="window", description="time at constant speed after a step; the force must settle within it"
    )
    run_in_s: Annotated[float, Quantity("time", "5 ms", "60 s")] = Field(
        default=0.05, alias="run_in", description="time from a reversal until speed and force are steady"
    )

    @field_validator("speed_m_s")
    @classmethod
    def _no_speed_twice(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        return no_value_twice(values, lambda value: show(value, "m/s", 10))

    @field_validator("current_A")
    @classmethod
    def _no_current_twice(cls, values: tuple[float, ...]) -> tuple[float, ...]:
        return no_value_twice(values, lambda value: show(value, "A", 10))

    @property
    def half_stroke_m(self) -> float:
        """Amplitude of the triangle (m)."""
        return self.amplitude_m or 0.5 * (self.stroke_m or 0.0)

    @property
    def needed_s(self) -> float:
        """Shortest half stroke that holds a step and its window (s)."""
        return self.run_in_s + BASELINE_S + self.window_s + STAGGER_S + 2.0 * START_S

    @property
    def count(self) -> int:
        """Number of test points."""
        return len(self.speed_m_s) * len(self.current_A)

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        if (self.amplitude_m is None) is (self.stroke_m is None):
            yield ("amplitude",), 'specify amplitude or stroke. Fix: write, for example, stroke = "40 mm"'
            return
        for place, speed_m_s in enumerate(self.speed_m_s):
            half_s = 2.0 * self.half_stroke_m / speed_m_s
            if half_s < self.needed_s:
                yield ("speed", place), self._too_short(speed_m_s, half_s)
        for place, high_A in enumerate(self.current_A):
            if abs(high_A - self.from_A) < SMALLEST_STEP_A:
                yield ("current", place), (
                    f"the step from {self.from_A:g} A to {high_A:g} A is too small; required: at least "
                    f"{SMALLEST_STEP_A:g} A"
                )

    def _too_short(self, speed_m_s: float, half_s: float) -> str:
        stroke_m = 2.0 * self.half_stroke_m
        fits_m_s = math.floor(1e4 * stroke_m / self.needed_s + 1e-6) / 1e4
        fits_m = math.ceil(1e4 * speed_m_s * self.needed_s - 1e-6) / 1e4
        # The parts of a half stroke add up to what is required: a reader sees which of them to shorten.
        return (
            f"at {show(speed_m_s, 'm/s')}, a stroke of {show(stroke_m, 'mm')} lasts {show(half_s, 'ms', 3)}; required: "
            f"{show(self.needed_s, 'ms', 3)} (run_in {show(self.run_in_s, 'ms')}, baseline {show(BASELINE_S, 'ms')}, "
            f"window {show(self.window_s, 'ms')}, start tolerance {show(STAGGER_S + 2.0 * START_S, 'ms')}). "
            f"Fix: use a speed of at most {show(fits_m_s, 'm/s')}, a stroke of at least {show(fits_m, 'mm')}, or a "
            "shorter window"
        )

    def points(self, number: int, centre_m: float, rest_s: float) -> list[TestPoint]:
        """One point for each speed and current.

        Args:
            number: of the table in the file, from 1.
            centre_m: of the motion.
            rest_s: rest before each point.
        """
        name, points = self.id or f"response{number}", list[TestPoint]()
        for speed_m_s in self.speed_m_s:
            for high_A in self.current_A:
                frequency_Hz = speed_m_s / (TRIANGLE.peak_velocity * self.half_stroke_m)
                times_s, currents_A = self._steps(frequency_Hz, high_A)
                points.append(TestPoint(
                    id=name if self.count == 1 else f"{name}-{len(points) + 1}", waveform=TRIANGLE.name,
                    amplitude_m=self.half_stroke_m, frequency_Hz=frequency_Hz, current_A=max(high_A, self.from_A),
                    cycles=HALF_STROKES // 2 * self.repeats + 1, ramp_in_cycles=RAMP_CYCLES,
                    ramp_out_cycles=RAMP_CYCLES, centre_m=centre_m, rest_s=rest_s, kind=RESPONSE,
                    steps_A=currents_A, steps_s=times_s, by_speed=True,
                ))  # fmt: skip
        return points

    def _steps(self, frequency_Hz: float, high_A: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Times (s since the start of the motion) and currents (A) of a point's program."""
        half_s = 0.5 / frequency_Hz
        after_corner_s = START_S + self.run_in_s + BASELINE_S + BASELINE_SHARE * max(0.0, half_s - self.needed_s)
        times_s, currents_A = [0.0], [self.from_A]
        for repeat in range(self.repeats):
            stagger_s = STAGGER_S * (repeat * GOLDEN % 1.0)
            for half, rises in STEPS:
                corner_s = FIRST_CORNER / frequency_Hz + (HALF_STROKES * repeat + half) * half_s
                times_s.append(round(corner_s + after_corner_s + stagger_s, 6))
                currents_A.append(high_A if rises else self.from_A)
        return tuple(times_s), tuple(currents_A)

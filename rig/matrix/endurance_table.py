"""`[[endurance]]` of a matrix file: blocks of cycles between the matrix's own points, and the rules that end them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Annotated, ClassVar

from pydantic import Field

from protocols.descriptions import Problem
from rig.files.quantity import Quantity
from rig.files.section import Section
from rig.matrix.motion_size import SPEED, STROKE, Amplitude, Frequency, PeakSpeed, Stroke
from rig.matrix.sections import CoilCurrent, Identifier, OneMotion, RampCycles, WaveformName
from rig.signals.program_cycles import RepeatedProgram
from rig.signals.program_limits import MOST_STEPS
from rig.signals.waveform import SINE, waveform_named
from rig.signals.wear_trend import StopRule
from rig.test_point import ENDURANCE, HYBRID, EnduranceStep, TestPoint

LONGEST_BLOCK_S = 600.0
"""A block that the matrix file does not size; statistics and stop rules are evaluated after each block."""
MOST_BLOCK_CYCLES = 10_000
FEWEST_BLOCK_CYCLES = 10
WHOLE_CYCLES = 1e-6
"""Relative deviation of the program's period from a whole number of cycles."""
END = "end"
"""In the ids of the performance points after the last cycle."""

Cycles = Annotated[int, Field(ge=FEWEST_BLOCK_CYCLES, le=100_000_000)]
Decrease = Annotated[float, Quantity("ratio", "0.1 %", "99 %")]
Increase = Annotated[float, Quantity("ratio", "0.1 %", "1000 %")]


class EnduranceStop(Section):
    """`[endurance.stop]`: limits at which the test ends; changes are relative to the baseline."""

    force_down: Decrease | None = Field(
        default=None, description="decrease of the peak force in rebound or compression", examples=["20 %"],
    )
    energy_down: Decrease | None = Field(default=None, description="decrease of the energy per cycle")
    stiffness_down: Decrease | None = Field(default=None, description="decrease of the stiffness")
    friction_up: Increase | None = Field(default=None, description="increase of the friction", examples=["50 %"])
    gas_force_down: Decrease | None = Field(
        default=None, description="decrease of the mean force, which shows a gas leak", examples=["30 %"],
    )
    temperature: Annotated[float, Quantity("temperature", "-40 degC", "250 degC")] | None = Field(
        default=None, description="highest coil temperature", examples=["90 degC"],
    )

    @property
    def rules(self) -> tuple[StopRule, ...]:
        """The rules that are stated."""
        stated = ((name, getattr(self, name)) for name in type(self).model_fields)
        return tuple(StopRule(name, limit) for name, limit in stated if limit is not None)


class Endurance(OneMotion):
    """Cycles in blocks; the matrix's points are run before the first, every `performance_every`, and at the end."""

    later: ClassVar[frozenset[str]] = OneMotion.later | {"current_program", "current_period_s"}

    id: Identifier | None = None
    waveform: WaveformName = SINE.name
    amplitude_m: Amplitude | None = Field(default=None, alias="amplitude")
    stroke_m: Stroke | None = Field(default=None, alias="stroke", description=STROKE)
    frequency_Hz: Frequency | None = Field(default=None, alias="frequency")
    speed_m_s: PeakSpeed | None = Field(default=None, alias="speed", description=SPEED)
    current_A: CoilCurrent | None = Field(
        default=None, alias="current", description="constant current of the blocks; replaces current_program"
    )
    current_program: tuple[tuple[Annotated[float, Quantity("time", "0 s", "24 h")], CoilCurrent], ...] = Field(
        default=(), max_length=MOST_STEPS, description="time and current of each step of a program, which is repeated "
            "through each block after current_period", examples=[[["0 s", "0 A"], ["2 s", "1 A"]]],
    )
    current_period_s: Annotated[float, Quantity("time", "2 ms", "24 h")] | None = Field(
        default=None, alias="current_period", description="duration of current_program; a whole number of cycles"
    )
    cycles: Cycles = Field(description="number of cycles of the whole test, at full amplitude")
    block: Annotated[int, Field(ge=FEWEST_BLOCK_CYCLES, le=MOST_BLOCK_CYCLES)] | None = Field(
        default=None, description=f"most cycles in one block; default: as many as run in {LONGEST_BLOCK_S:g} s"
    )
    performance_every: Cycles | None = Field(
        default=None, description="cycles between repetitions of the matrix's points; default: only before and after"
    )
    full_samples_every: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=100, description="full samples are kept of every so many cycles; statistics are kept of each cycle"
    )
    run_in: Annotated[int, Field(ge=0, le=100_000_000)] = Field(
        default=0, description="cycles of the running-in; the baseline is the first block after them"
    )
    ramp_in_cycles: RampCycles = 1.0
    ramp_out_cycles: RampCycles = 1.0
    rest_s: Annotated[float, Quantity("time", "0 s", "24 h")] = Field(
        default=0.0, alias="rest", description="rest after each block"
    )
    stop: EnduranceStop = Field(default_factory=EnduranceStop)

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        yield from (known := tuple(super().problems()))
        yield from self._program_problems(motion_known=not known)
        if self.performance_every is not None and self.performance_every > self.cycles:
            yield ("performance_every",), (
                f"{self.performance_every} cycles is more than the test has, {self.cycles}. Fix: reduce it, or remove "
                "it to run the points only before and after the test"
            )
        if self.run_in >= self.cycles:
            text = f"{self.run_in} cycles leaves no cycle for the baseline; the test has {self.cycles} cycles"
            yield ("run_in",), f"{text}. Fix: reduce run_in"

        if self.stop.friction_up is not None and waveform_named(self.waveform).corner_share is not None:
            text = f"friction cannot be separated from viscous force in a {self.waveform}, whose speed is constant"
            yield ("stop", "friction_up"), f'{text}. Fix: waveform = "sine", or remove friction_up'

    def _program_problems(self, *, motion_known: bool) -> Iterator[Problem]:
        steps, period_s = self.current_program, self.current_period_s
        if not steps:
            if self.current_A is None:
                yield ("current",), 'specify current or current_program. Fix: write, for example, current = "1 A"'
            if period_s is not None:
                yield ("current_period",), "current_program is missing. Fix: add it, or remove current_period"
            return
        if self.current_A is not None:
            yield ("current",), "current_program is also specified. Fix: remove one of them"
        yield from self._step_problems()
        if period_s is None:
            yield ("current_period",), 'missing; current_program repeats after it. Fix: write, for example, "4 s"'
            return
        if steps[-1][0] >= period_s:
            yield ("current_period",), f"{period_s:g} s is not later than the last step, {steps[-1][0]:g} s"
        if motion_known:
            yield from self._period_problems(period_s)

    def _step_problems(self) -> Iterator[Problem]:
        steps = self.current_program
        if steps[0][0] != 0.0:
            yield ("current_program", 0), f"the program starts at {steps[0][0]:g} s; required: 0 s"
        for place, ((before_s, before_A), (at_s, at_A)) in enumerate(pairwise(steps), start=1):
            if at_s <= before_s:
                yield ("current_program", place), f"{at_s:g} s is not later than the step before, {before_s:g} s"
            if at_A == before_A:
                yield ("current_program", place), f"{at_A:g} A is the current of the step before. Fix: remove the step"
        if len({level_A for _, level_A in steps}) < 2:
            yield ("current_program",), f'the program has only one current. Fix: current = "{steps[0][1]:g} A"'

    def _period_problems(self, period_s: float) -> Iterator[Problem]:
        """Whether the program's period fits the cycles, and a block its steps."""
        frequency_Hz = self.motion[1]
        cycles = max(1, round(period_s * frequency_Hz))
        if abs(period_s * frequency_Hz - cycles) > WHOLE_CYCLES * cycles:
            yield ("current_period",), (
                f"{period_s:g} s is {period_s * frequency_Hz:.4g} cycles at {frequency_Hz:.4g} Hz; cycles of the same "
                f'current are compared, so that a whole number is required. Fix: "{cycles / frequency_Hz:.9g} s"'
            )
            return
        most = cycles * ((MOST_STEPS - 1) // len(self.current_program))
        if most < FEWEST_BLOCK_CYCLES or cycles > (self.block or MOST_BLOCK_CYCLES):
            yield ("current_period",), (
                f"{cycles} cycles with {len(self.current_program)} steps do not fit a block; allowed: at most "
                f"{self.block or MOST_BLOCK_CYCLES} cycles, and {MOST_STEPS - 1} steps in {FEWEST_BLOCK_CYCLES} cycles"
            )
        elif self.block is not None and self.block > most:
            yield ("block",), (
                f"{self.block} cycles contain more than {MOST_STEPS - 1} steps of the current program. Fix: block = "
                f"{most}"
            )

    @property
    def program(self) -> RepeatedProgram | None:
        """The current program; None at a constant current."""
        if not self.current_program or self.current_period_s is None:
            return None
        frequency_Hz = self.motion[1]
        times_s, currents_A = zip(*self.current_program, strict=True)
        return RepeatedProgram(times_s, currents_A, frequency_Hz, max(1, round(self.current_period_s * frequency_Hz)))

    @property
    def most_in_a_block(self) -> int:
        """Cycles that a block has at most."""
        if self.block is not None:
            return self.block
        in_time = math.floor(LONGEST_BLOCK_S * self.motion[1])
        most, program = max(FEWEST_BLOCK_CYCLES, min(MOST_BLOCK_CYCLES, in_time)), self.program
        if program is None:
            return most
        steps = (MOST_STEPS - 1) // len(self.current_program)
        return max(program.cycles, program.cycles * min(steps, most // program.cycles))

    @property
    def stretches(self) -> tuple[int, ...]:
        """Cycles between performance points, in order."""
        every = self.performance_every or self.cycles
        whole, left = divmod(self.cycles, every)
        return (*[every] * whole, *([left] if left else []))

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return sum(math.ceil(stretch / self.most_in_a_block) for stretch in self.stretches)

    @property
    def rounds(self) -> int:
        """How often the points of the matrix are repeated."""
        return len(self.stretches)

    def points(self, name: str, performance: tuple[TestPoint, ...], centre_m: float) -> list[TestPoint]:
        """The blocks with the performance points between them.

        Args:
            name: id of the test.
            performance: the matrix's points; hybrid tests are not repeated.
            centre_m: centre of the motion.
        """
        amplitude_m, frequency_Hz = self.motion
        program = self.program
        highest_A = max((level_A for _, level_A in self.current_program), default=self.current_A or 0.0)
        block = TestPoint(
            id="", waveform=self.waveform, amplitude_m=amplitude_m, frequency_Hz=frequency_Hz,
            current_A=highest_A, ramp_in_cycles=self.ramp_in_cycles, ramp_out_cycles=self.ramp_out_cycles,
            centre_m=centre_m, rest_s=self.rest_s, kind=ENDURANCE, by_speed=self.size.by_speed,
        )  # fmt: skip
        points: list[TestPoint] = []
        number = done = 0
        width = len(str(self.blocks))
        programs: dict[int, TestPoint] = {}
        for stretch in self.stretches:
            count = math.ceil(stretch / self.most_in_a_block)
            for place in range(count):
                size = stretch * (place + 1) // count - stretch * place // count
                number += 1
                step = EnduranceStep(
                    name, done, self.cycles, number, size, self.full_samples_every,
                    program_cycles=0 if program is None else program.cycles,
                )
                if program is not None and size not in programs:
                    times_s, currents_A = program.steps(self.ramp_in_cycles, max(size, program.cycles))
                    programs[size] = replace(block, steps_s=times_s, steps_A=currents_A)
                chosen = programs.get(size, block)
                points.append(replace(chosen, id=f"{name}-b{number:0{width}d}", cycles=size, endurance=step))
                done += size
            step = EnduranceStep(name, done, self.cycles)
            after = done if done < self.cycles else END  # a stop rule may bring the end forward
            points += [
                replace(point, id=f"{point.id}-{name}-{after}", endurance=step)
                for point in performance if point.kind != HYBRID
            ]
        return points

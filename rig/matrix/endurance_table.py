"""`[[endurance]]` of a matrix file: blocks of cycles between the matrix's own points, and the rules that end them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Annotated

from pydantic import Field

from protocols.descriptions import Problem
from rig.files.quantity import Quantity
from rig.files.section import Section
from rig.matrix.motion_size import SPEED, STROKE, Amplitude, Frequency, PeakSpeed, Stroke
from rig.matrix.sections import CoilCurrent, Identifier, OneMotion, RampCycles, WaveformName
from rig.signals.waveform import SINE, waveform_named
from rig.signals.wear_trend import StopRule, stop_rule
from rig.test_point import ENDURANCE, HYBRID, EnduranceStep, TestPoint

LONGEST_BLOCK_S = 600.0
"""A block that the matrix file does not size; statistics and stop rules are evaluated after each block."""
MOST_BLOCK_CYCLES = 10_000
FEWEST_BLOCK_CYCLES = 10
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
        return tuple(stop_rule(name, limit) for name, limit in stated if limit is not None)


class Endurance(OneMotion):
    """Cycles in blocks; the matrix's points are run before the first, every `performance_every`, and at the end."""

    id: Identifier | None = None
    waveform: WaveformName = SINE.name
    amplitude_m: Amplitude | None = Field(default=None, alias="amplitude")
    stroke_m: Stroke | None = Field(default=None, alias="stroke", description=STROKE)
    frequency_Hz: Frequency | None = Field(default=None, alias="frequency")
    speed_m_s: PeakSpeed | None = Field(default=None, alias="speed", description=SPEED)
    current_A: CoilCurrent = Field(alias="current")
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
        yield from super().problems()
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

    @property
    def most_in_a_block(self) -> int:
        """Cycles that a block has at most."""
        if self.block is not None:
            return self.block
        in_time = math.floor(LONGEST_BLOCK_S * self.motion[1])
        return max(FEWEST_BLOCK_CYCLES, min(MOST_BLOCK_CYCLES, in_time))

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
        block = TestPoint(
            id="", waveform=self.waveform, amplitude_m=amplitude_m, frequency_Hz=frequency_Hz,
            current_A=self.current_A, ramp_in_cycles=self.ramp_in_cycles, ramp_out_cycles=self.ramp_out_cycles,
            centre_m=centre_m, rest_s=self.rest_s, kind=ENDURANCE, by_speed=self.size.by_speed,
        )  # fmt: skip
        points: list[TestPoint] = []
        number = done = 0
        width = len(str(self.blocks))
        for stretch in self.stretches:
            count = math.ceil(stretch / self.most_in_a_block)
            for place in range(count):
                size = stretch * (place + 1) // count - stretch * place // count
                number += 1
                step = EnduranceStep(name, done, self.cycles, number, size, self.full_samples_every)
                points.append(replace(block, id=f"{name}-b{number:0{width}d}", cycles=size, endurance=step))
                done += size
            step = EnduranceStep(name, done, self.cycles)
            after = done if done < self.cycles else END  # a stop rule may bring the end forward
            points += [
                replace(point, id=f"{point.id}-{name}-{after}", endurance=step)
                for point in performance if point.kind != HYBRID
            ]
        return points

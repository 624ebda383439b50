"""`[[endurance]]` of a matrix file: blocks of cycles between the matrix's own points, and the rules that end them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field, PrivateAttr

from protocols.descriptions import Problem
from rig.errors import FileProblem
from rig.files.quantity import Quantity
from rig.files.section import Section
from rig.matrix.motion_size import SPEED, STROKE, Amplitude, Frequency, PeakSpeed, Stroke
from rig.matrix.record_file import read_record
from rig.matrix.sections import CoilCurrent, Identifier, OneMotion, RampCycles, WaveformName
from rig.matrix.signal_tables import Name, Ramp
from rig.signals.arrays import FloatArray
from rig.signals.program_cycles import SETTLED_S, RepeatedProgram
from rig.signals.program_limits import MOST_STEPS
from rig.signals.record import LONGEST_S, NoRecord, record_of, through_rows
from rig.signals.repeated_record import (
    Cycle,
    SignalCycle,
    SineSum,
    common_periods,
    most_cycles,
    repeated_record,
    simple_ratio,
)
from rig.signals.waveform import SIGNAL_NAMES, SINE, SINE_ON_SINE, waveform_named
from rig.signals.wear_trend import StopRule
from rig.test_point import ENDURANCE, HYBRID, EnduranceStep, TestPoint

LONGEST_BLOCK_S = 600.0
"""A block that the matrix file does not size; statistics and stop rules are evaluated after each block."""
LONG_BLOCK_S, SHORT_BLOCK_S = 120.0, 60.0
"""Blocks longer than the first are warned of if the test has stop rules; the second is recommended."""
MOST_BLOCK_CYCLES = 10_000
FEWEST_BLOCK_CYCLES = 10
"""Of a waveform; of a record, whose cycles can take minutes, 1."""
MOST_ADDED = 10
WHOLE_CYCLES = 1e-6
"""Relative deviation of the program's period from a whole number of cycles."""
SIZED_BY_FILE = frozenset({
    "waveform", "stroke_m", "frequency_Hz", "speed_m_s", "add", "ramp_in_cycles", "ramp_out_cycles",
})
"""Entries that describe the motion, as a signal file does."""
ONLY_WITH_FILE = frozenset({"highest_Hz", "ramp_s"})
END = "end"
"""In the ids of the performance points after the last cycle."""

Cycles = Annotated[int, Field(ge=1, le=100_000_000)]
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
        default=None, examples=["30 %"],
        description="decrease of the mean of rebound and compression force (gas force of a symmetric damper)",
    )
    temperature: Annotated[float, Quantity("temperature", "-40 degC", "250 degC")] | None = Field(
        default=None, description="highest coil temperature", examples=["90 degC"],
    )

    @property
    def rules(self) -> tuple[StopRule, ...]:
        """The rules that are stated."""
        stated = ((name, getattr(self, name)) for name in type(self).model_fields)
        return tuple(StopRule(name, limit) for name, limit in stated if limit is not None)


class AddedSine(Section):
    """`add` of `[[endurance]]`: a sine that is added to the base sine; both start at mid-travel."""

    amplitude_m: Amplitude = Field(alias="amplitude")
    frequency_Hz: Frequency = Field(alias="frequency")


class Endurance(OneMotion):
    """Cycles in blocks; the matrix's points are run before the first, every `performance_every`, and at the end."""

    later: ClassVar[frozenset[str]] = OneMotion.later | {
        "current_program", "current_period_s", "add", "file", "highest_Hz", "ramp_s",
    }

    id: Identifier | None = None
    waveform: WaveformName = SINE.name
    amplitude_m: Amplitude | None = Field(default=None, alias="amplitude")
    stroke_m: Stroke | None = Field(default=None, alias="stroke", description=STROKE)
    frequency_Hz: Frequency | None = Field(default=None, alias="frequency")
    speed_m_s: PeakSpeed | None = Field(default=None, alias="speed", description=SPEED)
    add: tuple[AddedSine, ...] = Field(
        default=(), max_length=MOST_ADDED, description="sines that are added to this one; the cycle is then the common "
            "period of all sines", examples=[[{"amplitude": "2 mm", "frequency": "12 Hz"}]],
    )
    file: Name | None = Field(
        default=None, description="CSV file of a motion that is repeated, with columns such as time_s and "
            "displacement_mm, as in [matrix.file]; replaces waveform and frequency. A cycle is one repetition of the "
            "file", examples=["road.csv"],
    )
    highest_Hz: Frequency | None = Field(
        default=None, alias="highest_frequency", description="with file: cut-off frequency of a zero-phase low-pass "
            "filter; default: no filter"
    )
    ramp_s: Ramp = Field(
        default=1.0, alias="ramp", description="with file: duration over which each repetition is faded in from the "
            "centre at its start and out at its end"
    )
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
    block: Annotated[int, Field(ge=1, le=MOST_BLOCK_CYCLES)] | None = Field(
        default=None, description=f"most cycles in one block; default: as many as run in {LONGEST_BLOCK_S:g} s"
    )
    performance_every: Cycles | None = Field(
        default=None, description="cycles between repetitions of the matrix's points; default: only before and after"
    )
    full_samples_every: Annotated[int, Field(ge=1, le=1_000_000)] = Field(
        default=100, description="interval, in cycles, at which full samples are stored; statistics are stored for "
            "every cycle"
    )
    run_in: Annotated[int, Field(ge=0, le=100_000_000)] = Field(
        default=0, description="cycles of the running-in; the baseline is the first block after them"
    )
    ramp_in_cycles: RampCycles = 1.0
    ramp_out_cycles: RampCycles = 1.0
    rest_s: Annotated[float, Quantity("time", "0 s", "24 h")] = Field(
        default=0.0, alias="rest", description="duration of rest after each block"
    )
    stop: EnduranceStop = Field(default_factory=EnduranceStop)

    _cycle: Cycle | None = PrivateAttr(default=None)
    _hashes: dict[str, str] = PrivateAttr(default_factory=dict)

    @property
    def hashes(self) -> Mapping[str, str]:
        """The path of the signal file as the table holds it, and the SHA-256 (hex) of its content."""
        return self._hashes

    @property
    def cycle_Hz(self) -> float:
        """Cycles a second (Hz)."""
        return self.motion[1] if self._cycle is None else 1.0 / self._cycle.period_s

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`; a signal file is read here."""
        known = tuple(super().problems() if self.file is None else self._beside_file())
        known = known or tuple(self._cycle_problems())
        yield from known
        yield from self._program_problems(motion_known=not known)
        yield from self._count_problems()
        if self.stop.friction_up is not None and waveform_named(self.waveform).corner_share is not None:
            text = f"friction cannot be separated from viscous force in a {self.waveform}, whose speed is constant"
            yield ("stop", "friction_up"), f'{text}. Fix: set waveform = "sine", or remove friction_up'

    def _beside_file(self) -> Iterator[Problem]:
        """Entries that contradict a signal file."""
        for key in self._stated(SIZED_BY_FILE):
            yield (key,), "file is also specified, which already defines the motion. Fix: remove one of them"

    def _stated(self, entries: frozenset[str]) -> Iterator[str]:
        """Keys of those of these entries that the matrix file states, in order."""
        fields = type(self).model_fields
        return (fields[name].alias or name for name in sorted(self.model_fields_set & entries))

    def _cycle_problems(self) -> Iterator[Problem]:
        """Make the cycle of a record, or state why there is none."""
        if self.file is None:
            for key in self._stated(ONLY_WITH_FILE):
                yield (key,), f"applies only with file. Fix: remove {key}"
        if not self.is_record:
            return
        key = "add" if self.file is None else "file"
        try:
            self._cycle = self._sines() if self.file is None else self._signal(self.file)
            repeated_record(self._cycle, 1)
        except NoRecord as error:
            yield (key,), str(error)
        except FileProblem as error:
            yield from (((key,), problem) for problem in error.problems)

    def _signal(self, file: str) -> SignalCycle:
        """The signal of a file.

        Raises:
            FileProblem: the file cannot be used.
            NoRecord: it contains no motion.
        """
        time_s, position_m, self._hashes[file] = read_record(Path(file))
        even_m = through_rows(time_s, position_m)
        return SignalCycle(record_of(
            Path(file).stem, even_m, self.ramp_s, amplitude_m=self.amplitude_m, highest_Hz=self.highest_Hz,
            sha256=self._hashes[file],
        ))

    def _sines(self) -> SineSum:
        """The sum of the base sine and the added ones.

        Raises:
            NoRecord: they are no sines, or have no common period.
        """
        if self.waveform != SINE.name:
            raise NoRecord(f'sines can be added only to a sine, not to a {self.waveform}. Fix: set waveform = "sine"')
        base_m, base_Hz = self.motion
        for place, sine in enumerate(self.add):
            if sine.frequency_Hz in {base_Hz, *(other.frequency_Hz for other in self.add[:place])}:
                which = "the base sine" if sine.frequency_Hz == base_Hz else "another added sine"
                raise NoRecord(
                    f"{sine.frequency_Hz:.4g} Hz is already the frequency of {which}. Fix: use another frequency"
                )
        periods = common_periods((base_Hz, *(sine.frequency_Hz for sine in self.add)))
        ramp_s = max(self.ramp_in_cycles, self.ramp_out_cycles) / base_Hz
        longest_s = LONGEST_S - 2.0 * ramp_s
        if periods is None or periods / base_Hz > longest_s:
            fits = ", ".join(f"{simple_ratio(sine.frequency_Hz / base_Hz) * base_Hz:.9g} Hz" for sine in self.add)
            raise NoRecord(
                f"the sum of the sines does not repeat within {longest_s:.4g} s; its cycles cannot be compared. "
                f"Fix: use simple ratios to {base_Hz:.6g} Hz, for example {fits}"
            )
        sines = ((base_m, base_Hz), *((sine.amplitude_m, sine.frequency_Hz) for sine in self.add))
        return SineSum(sines, periods, ramp_s)

    def _count_problems(self) -> Iterator[Problem]:
        """Numbers of cycles that do not fit each other."""
        stated = {"cycles": self.cycles, "performance_every": self.performance_every, "block": self.block}
        for key, number in stated.items():
            if number is not None and number < self.fewest_in_a_block:
                yield (key,), f"got {number}; allowed: at least {self.fewest_in_a_block} cycles of a waveform"
        if self._cycle is not None and self.block is not None and self.block > most_cycles(self._cycle):
            yield ("block",), (
                f"{self.block} cycles of {self._cycle.period_s:.4g} s exceed {LONGEST_S:g} s, the longest motion with "
                f"streamed set-points. Fix: set block = {most_cycles(self._cycle)}"
            )
        if self.performance_every is not None and self.performance_every > self.cycles:
            yield ("performance_every",), (
                f"{self.performance_every} cycles exceeds the length of the test, {self.cycles} cycles. Fix: reduce "
                "it, or remove it to run the points only before and after the test"
            )
        if self.run_in >= self.cycles:
            text = f"{self.run_in} cycles leaves no cycles for the baseline; the test has {self.cycles} cycles"
            yield ("run_in",), f"{text}. Fix: reduce run_in"

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
                yield ("current_program", place), f"{at_s:g} s is not later than the previous step, {before_s:g} s"
            if at_A == before_A:
                yield ("current_program", place), (
                    f"{at_A:g} A is already the current of the previous step. Fix: remove this step"
                )
        if len({level_A for _, level_A in steps}) < 2:
            yield ("current_program",), (
                f'the program has only one current. Fix: replace it by current = "{steps[0][1]:g} A"'
            )

    def _period_problems(self, period_s: float) -> Iterator[Problem]:
        """Whether the program's period fits the cycles, and a block its steps."""
        frequency_Hz = self.cycle_Hz
        cycles = max(1, round(period_s * frequency_Hz))
        if abs(period_s * frequency_Hz - cycles) > WHOLE_CYCLES * cycles:
            yield ("current_period",), (
                f"{period_s:g} s is {period_s * frequency_Hz:.4g} cycles at {frequency_Hz:.4g} Hz; cycles at the same "
                f'current are compared, so a whole number is required. Fix: write "{cycles / frequency_Hz:.9g} s"'
            )
            return
        most = cycles * ((MOST_STEPS - 1) // len(self.current_program))
        fewest, longest = self.fewest_in_a_block, self.block or self._longest_block
        if most < fewest or cycles > longest:
            yield ("current_period",), (
                f"{cycles} cycles with {len(self.current_program)} steps do not fit into a block; allowed: at most "
                f"{longest} cycles, and {MOST_STEPS - 1} steps in {fewest} cycles"
            )
        elif self.block is not None and self.block > most:
            yield ("block",), (
                f"{self.block} cycles contain more than {MOST_STEPS - 1} steps of the current program. Fix: set block "
                f"= {most}"
            )
        yield from self._comparison_problems()

    @property
    def _fewest_held(self) -> int:
        """Cycles for which a current must be held so that it is constant in one of them, wherever the steps are."""
        return 3 + math.ceil(SETTLED_S * self.cycle_Hz)

    def _comparison_problems(self) -> Iterator[Problem]:
        """Rules that compare cycles, with a program of which no two cycles can be compared."""
        program, position = self.program, None if self._cycle is None else self._cycle.at
        if position is None and self.waveform == SINE.name:
            position = self._sine
        if program is None or program.held or (position is not None and program.steps_while_slow(position)):
            return
        for rule in self.stop.rules:
            if rule.kind.relative:
                yield ("stop", rule.name), (
                    "the current changes in, or just before or after, every cycle of the program while the rod moves "
                    "fast, so a delay of a few milliseconds looks like wear. Fix: hold each current for at least "
                    f"{self._fewest_held} cycles, or remove {rule.name}"
                )

    def _sine(self, time_s: FloatArray) -> FloatArray:
        """Position (n,) of a sine of amplitude 1 at times (s) since the start of a cycle."""
        return np.asarray(np.sin(math.tau * self.cycle_Hz * time_s), np.float64)

    @property
    def program(self) -> RepeatedProgram | None:
        """The current program; None at a constant current."""
        if not self.current_program or self.current_period_s is None:
            return None
        frequency_Hz = self.cycle_Hz
        times_s, currents_A = zip(*self.current_program, strict=True)
        return RepeatedProgram(times_s, currents_A, frequency_Hz, max(1, round(self.current_period_s * frequency_Hz)))

    @property
    def is_record(self) -> bool:
        """Whether the cycle is a record, which only an actuator with streamed set-points can follow."""
        return self.file is not None or bool(self.add)

    @property
    def fewest_in_a_block(self) -> int:
        """Cycles that a block must be allowed to have."""
        return 1 if self.is_record else FEWEST_BLOCK_CYCLES

    @property
    def _longest_block(self) -> int:
        """Cycles that a block can have at most, whatever the matrix file states."""
        return MOST_BLOCK_CYCLES if self._cycle is None else min(MOST_BLOCK_CYCLES, most_cycles(self._cycle))

    @property
    def most_in_a_block(self) -> int:
        """Cycles that a block has at most."""
        if self.block is not None:
            return self.block
        in_time = math.floor(LONGEST_BLOCK_S * self.cycle_Hz + 1e-9)
        most, program = max(self.fewest_in_a_block, min(self._longest_block, in_time)), self.program
        if program is None:
            return most
        steps = (MOST_STEPS - 1) // len(self.current_program)
        return max(program.cycles, program.cycles * min(steps, most // program.cycles))

    def hints(self, name: str) -> Iterator[str]:
        """Warnings for the plan.

        Args:
            name: id of the test.
        """
        longest_s = self.most_in_a_block / self.cycle_Hz
        if self.stop.rules and longest_s > LONG_BLOCK_S and self.most_in_a_block > self.fewest_in_a_block:
            fits = max(self.fewest_in_a_block, math.floor(SHORT_BLOCK_S * self.cycle_Hz))
            yield (
                f"endurance test {name}: stop rules are evaluated only after a block, so the specimen can run for up "
                f"to {self.most_in_a_block:,} further cycles ({longest_s:.0f} s) after it has exceeded a limit; only "
                f"the interlocks of the bench act within a block. Fix: set block = {fits}"
            )
        program = self.program
        if self.stop.rules and program is not None and program.unwatched_A.size:
            levels = ", ".join(f"{level_A:g} A" for level_A in program.unwatched_A)
            yield (
                f"endurance test {name}: stop rules do not use the cycles at {levels}, because no cycle has this "
                f"constant current. Fix: hold each current for at least {self._fewest_held} cycles"
            )

    @property
    def stretches(self) -> tuple[int, ...]:
        """Cycles between performance points, in order."""
        whole, left = divmod(self.cycles, self._every)
        return (*[self._every] * whole, *([left] if left else []))

    @property
    def _every(self) -> int:
        """Cycles between performance points."""
        return self.performance_every or self.cycles

    @property
    def blocks(self) -> int:
        """Number of blocks; computed without `stretches`, of which a wrong entry makes millions."""
        (whole, left), most = divmod(self.cycles, self._every), self.most_in_a_block
        return whole * math.ceil(self._every / most) + math.ceil(left / most)

    @property
    def rounds(self) -> int:
        """How often the points of the matrix are repeated."""
        return math.ceil(self.cycles / self._every)

    def points(self, name: str, performance: tuple[TestPoint, ...], centre_m: float) -> list[TestPoint]:
        """The blocks with the performance points between them.

        Args:
            name: id of the test.
            performance: the matrix's points; hybrid tests are not repeated.
            centre_m: centre of the motion.
        """
        program, block = self.program, self._block(centre_m)
        points: list[TestPoint] = []
        number = done = 0
        width = len(str(self.blocks))
        sized: dict[int, TestPoint] = {}
        for stretch in self.stretches:
            count = math.ceil(stretch / self.most_in_a_block)
            for place in range(count):
                size = stretch * (place + 1) // count - stretch * place // count
                number += 1
                step = EnduranceStep(
                    name, done, self.cycles, number, size, self.full_samples_every,
                    program_cycles=0 if program is None else program.cycles,
                )
                if size not in sized:
                    sized[size] = self._sized(block, size)
                points.append(replace(sized[size], id=f"{name}-b{number:0{width}d}", endurance=step))
                done += size
            step = EnduranceStep(name, done, self.cycles)
            after = done if done < self.cycles else END  # a stop rule may bring the end forward
            points += [
                replace(point, id=f"{point.id}-{name}-{after}", endurance=step)
                for point in performance if point.kind != HYBRID
            ]
        return points

    def _block(self, centre_m: float) -> TestPoint:
        """A block without name and size."""
        highest_A = max((level_A for _, level_A in self.current_program), default=self.current_A or 0.0)
        amplitude_m = self.motion[0] if self._cycle is None else 0.0  # a record has its own
        block = TestPoint(
            id="", waveform=self.waveform, amplitude_m=amplitude_m, frequency_Hz=self.cycle_Hz,
            current_A=highest_A, ramp_in_cycles=self.ramp_in_cycles, ramp_out_cycles=self.ramp_out_cycles,
            centre_m=centre_m, rest_s=self.rest_s, kind=ENDURANCE, by_speed=self.size.by_speed,
        )  # fmt: skip
        if self._cycle is None:
            return block
        waveform = SINE_ON_SINE if self.file is None else SIGNAL_NAMES[-1]
        return replace(block, waveform=waveform, ramp_in_cycles=0.0, ramp_out_cycles=0.0, by_speed=False)

    def _sized(self, block: TestPoint, cycles: int) -> TestPoint:
        """A block of so many cycles, with its record and its current program."""
        program = self.program
        block = replace(block, cycles=cycles)
        if self._cycle is not None:
            record = repeated_record(self._cycle, cycles)
            block = replace(block, record=record, amplitude_m=record.amplitude_m)
        if program is None:
            return block
        times_s, currents_A = program.steps(block.first_cycle_s, max(cycles, program.cycles))
        return replace(block, steps_s=times_s, steps_A=currents_A)

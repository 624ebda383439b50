"""The matrix file as values: `load_matrix("table1.toml").points()`. Every number is SI."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
import random
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, ClassVar, Literal

from pydantic import Field

from protocols.descriptions import Problem
from rig.bench.model import Bench
from rig.campaign_folder import IDENTIFIER, IDENTIFIER_TEXT
from rig.errors import FileProblem, FileProblems, some
from rig.files.display_table import DisplayTable
from rig.files.loader import WrongKind, load_section
from rig.files.section import ExtendedSection
from rig.matrix import named_files
from rig.matrix.acceptance_table import AcceptanceTable
from rig.matrix.endurance_table import Endurance
from rig.matrix.forecast import forecaster
from rig.matrix.hybrid_table import HybridTable
from rig.matrix.line_table import LineTable
from rig.matrix.order_by_heat import by_heat
from rig.matrix.record_file import FORCE
from rig.matrix.report_table import ReportTable
from rig.matrix.response_table import ResponseTable
from rig.matrix.sections import (
    Campaign,
    CurrentStep,
    ExtraPoint,
    Friction,
    Identify,
    Specimen,
    Sweep,
    Temperature,
)  # fmt: skip
from rig.signals.record import NoRecord, Record
from rig.signals.waveform import HOLD, SIGNAL_NAMES, TRIANGLE
from rig.test_point import CURRENT_STEP, FRICTION, HYBRID, LOOP, SIGNAL, TestPoint

POINT_LIMIT = 10_000
FILE = "file"
"""The signal whose files may contain forces."""
LATER = frozenset({"law", "most_current_A", "sky_share", "law_damping_N_s_m"})
"""Entries of a hybrid test that came after campaigns with such tests had been run."""


class Matrix(ExtendedSection):
    """A whole matrix file."""

    later: ClassVar[frozenset[str]] = frozenset({"acceptance", "endurance", "response"})

    format: Literal[1]
    specimen: Specimen
    sweep: Sweep = Field(default_factory=Sweep, alias="matrix")
    extra: tuple[ExtraPoint, ...] = Field(default=(), alias="point")
    friction: Friction | None = None
    current_step: tuple[CurrentStep, ...] = ()
    response: tuple[ResponseTable, ...] = ()
    hybrid: HybridTable | None = None
    endurance: tuple[Endurance, ...] = ()
    temperature: Temperature | None = None
    acceptance: AcceptanceTable | None = None
    line: LineTable | None = None
    identify: Identify = Field(default_factory=Identify)
    campaign: Campaign = Field(default_factory=Campaign)
    display: DisplayTable = Field(default_factory=DisplayTable)
    report: ReportTable = Field(default_factory=ReportTable)

    def points(self) -> tuple[TestPoint, ...]:
        """Every point in the order in which it is run.

        Identifiers count in written order, so that a point keeps its name whatever the order. As written: waveform
        varies slowest, then current, amplitude, frequency, of a signal its records; the extra points follow; repeats
        come round after that. Endurance tests follow, each with its blocks in order and these points between them.
        """
        return self._ordered

    @property
    def endurance_tests(self) -> dict[str, Endurance]:
        """The endurance tests by their ids, in order."""
        return dict(zip(self._endurance_ids, self.endurance, strict=True))

    @property
    def _endurance_ids(self) -> tuple[str, ...]:
        return tuple(test.id or f"e{number}" for number, test in enumerate(self.endurance, start=1))

    @cached_property
    def _ordered(self) -> tuple[TestPoint, ...]:
        performance = self._performance()
        centre_m = self.specimen.mid_stroke_m
        cycles = (test.points(name, performance, centre_m) for name, test in self.endurance_tests.items())
        return (*performance, *itertools.chain.from_iterable(cycles))

    def _performance(self) -> tuple[TestPoint, ...]:
        """Every point in order, without those of endurance tests."""
        written = self._written()
        if self.sweep.order == "random":
            random.Random(self.sweep.seed).shuffle(written)
        if self.sweep.order == "by heat" and self.temperature is not None:
            return by_heat(tuple(written), forecaster(self.specimen), self.temperature)
        return tuple(written)

    def of_specimen(self, serial_number: str) -> Matrix:
        """The same tests of another specimen; of the file's own with an empty serial number.

        Raises:
            FileProblem: this is not a valid serial number.
        """
        if not serial_number:
            return self
        if not re.fullmatch(IDENTIFIER, serial_number):
            raise FileProblem("--serial-number", [f"{serial_number!r:.80}: expected {IDENTIFIER_TEXT}"])
        if self.line is not None and (problem := self.line.problem_with(serial_number)):
            raise FileProblem("--serial-number", [f"{serial_number}: {problem}"])
        return self.model_copy(update={"specimen": self.specimen.model_copy(update={"serial_number": serial_number})})

    @property
    def wants_fit(self) -> bool:
        """A model is to be identified; not from hybrid, endurance or response tests alone."""
        special = self.hybrid is not None or self.endurance or self.response
        tests_only = special and all(point.kind not in {LOOP, SIGNAL} for point in self.points())
        return self.identify.enabled and not tests_only

    @property
    def digest(self) -> str:
        """SHA-256 (hex) of specimen, points and acceptance bands; what is identified afterwards does not count.

        A file that is named counts by its content, not by its path. Bands count, so that a campaign that is resumed
        has the same limits.
        """
        return self._digest(frozenset())

    @property
    def earlier_digests(self) -> tuple[str, ...]:
        """What releases that did not know all of the entries called the same matrix: those of `LATER` left out.

        Only where each of them has its default, which is what those releases did.
        """
        hybrid = self.hybrid
        if hybrid is None or any(getattr(hybrid, name) != type(hybrid).model_fields[name].default for name in LATER):
            return ()
        return (self._digest(LATER),)

    def _digest(self, left_out: frozenset[str]) -> str:
        """The digest without these entries of a hybrid test."""
        unused = {name for name in SIGNAL_NAMES if name not in self.sweep.signals}
        apart: dict[str, Any] = {"identify": True, "display": True, "report": True, "line": True, "sweep": unused}
        text = self.model_dump_json(exclude=apart | {"hybrid": True if self.hybrid is None else set(left_out)})
        hashes = [*(table.hashes for table in self.sweep.signals.values()), *(test.hashes for test in self.endurance)]
        for files in hashes:
            for written, digest in files.items():
                text = text.replace(json.dumps(written, ensure_ascii=False), json.dumps(digest))
        if self.acceptance is not None:
            text = text.replace(json.dumps(self.acceptance.bands, ensure_ascii=False), f'"{self.acceptance.sha256}"')
        if (assumed := self.specimen.assumed) is not None:  # of a set, the key is the name itself
            text = text.replace(json.dumps(self.specimen.prior, ensure_ascii=False), json.dumps(assumed.key))
        return hashlib.sha256(text.encode()).hexdigest()

    def _written(self) -> list[TestPoint]:
        sweep = self.sweep
        rows = [row for waveform in sweep.waveform for row in self._of(waveform)]
        for item in self.extra:
            row = self._point(item.waveform, *item.motion, item.current_A)
            by_speed = item.size.by_speed
            rows.append(replace(row, id=item.id or "", cycles=item.cycles or sweep.cycles, by_speed=by_speed))
        points: list[TestPoint] = []
        for repeat in range(1, sweep.repeats + 1):
            for row in rows:
                name = f"p{len(points) + 1:03d}" if not row.id else row.id if repeat == 1 else f"{row.id}-{repeat}"
                points.append(replace(row, id=name, repeat=repeat))
        return points + self._special()

    def _of(self, waveform: str) -> list[TestPoint]:
        """The points of one waveform of the product, without names."""
        sweep = self.sweep
        if waveform not in SIGNAL_NAMES:
            return [
                replace(self._point(waveform, amplitude_m, frequency_Hz, current_A), by_speed=sweep.size.by_speed)
                for current_A, (amplitude_m, frequency_Hz) in product(sweep.current_A, sweep.size.motions(waveform))
            ]
        return [
            replace(
                self._point(waveform, record.amplitude_m, record.mean_rate_Hz, current_A),
                kind=SIGNAL, record=record, cycles=1, ramp_in_cycles=0.0, ramp_out_cycles=0.0,
            )
            for current_A, record in self._records(waveform)
        ]

    def _records(self, waveform: str) -> Iterator[tuple[float, Record]]:
        """Each current with each record of a signal."""
        table = self.sweep.signals[waveform]
        if waveform == FILE and self._of_force:
            yield from ((current_A, record) for (current_A, _), record in self._force_records[0].items())
            return
        yield from product(self.sweep.current_A, table.records)

    @property
    def _of_force(self) -> bool:
        """Whether the files contain forces."""
        return self.sweep.file is not None and self.sweep.file.target == FORCE

    @cached_property
    def _force_records(self) -> tuple[dict[tuple[float, int], Record], tuple[Problem, ...]]:
        """The records of forces by current and number of the file, and why there is none of some of them."""
        records: dict[tuple[float, int], Record] = {}
        problems: list[Problem] = []
        table, assumed = self.sweep.file, self.specimen.assumed
        if table is None or assumed is None:
            return records, ()
        for current_A in self.sweep.current_A:
            inverse = assumed.speed_of_force(current_A)
            for number in range(table.count):
                try:
                    record = table.force_record(number, inverse)
                    records[current_A, number] = assumed.with_forecast(record, current_A)
                except NoRecord as error:
                    problems.append((("matrix", "file", "file", number), f"at {current_A:g} A: {error}"))
        return records, tuple(problems)

    def _forces_given(self) -> Iterator[Problem]:
        """What forces as targets require, and forces that the expected damper does not give."""
        if not self._of_force:
            return
        if self.specimen.prior is None:
            yield ("specimen", "prior"), (
                'is missing; with target = "force" in [matrix.file], the first command is calculated from the expected '
                'damper. Fix: specify a parameter set, prior = "demo", or a fit in the folder of this file, prior = '
                '"fit.json"'
            )
        if self.sweep.iterate is None:
            yield ("matrix", "file", "target"), (
                'target = "force" requires a table [matrix.iterate]: only an iterated command follows a force'
            )
        yield from self._force_records[1]

    def _special(self) -> list[TestPoint]:
        """The points that are no loops: they follow once, whatever the repeats."""
        special = []
        if self.friction is not None:
            slow = self.friction
            row = self._point(TRIANGLE.name, slow.amplitude_m, slow.speed_m_s / (4.0 * slow.amplitude_m), 0.0)
            special.append(
                replace(row, id=slow.id, kind=FRICTION, cycles=slow.cycles, ramp_in_cycles=0.5, ramp_out_cycles=0.5)
            )
        for number, item in enumerate(self.current_step, start=1):
            row = self._point(HOLD.name, 0.0, 1.0 / item.hold_s, max(item.current_A))
            special.append(
                replace(
                    row,
                    id=item.id or f"step{number}",
                    kind=CURRENT_STEP,
                    cycles=len(item.current_A),
                    ramp_in_cycles=0.0,
                    ramp_out_cycles=0.0,
                    steps_A=item.current_A,
                )
            )
        for number, table in enumerate(self.response, start=1):
            special += table.points(number, self.specimen.mid_stroke_m, self.sweep.rest_s)
        assumed = self.specimen.assumed
        if self.hybrid is not None and assumed is not None:
            special += self.hybrid.points(assumed, self.specimen.mid_stroke_m)
        return special

    def _point(self, waveform: str, amplitude_m: float, frequency_Hz: float, current_A: float) -> TestPoint:
        """A point of this matrix that has no name yet."""
        return TestPoint(
            id="",
            waveform=waveform,
            amplitude_m=amplitude_m,
            frequency_Hz=frequency_Hz,
            current_A=current_A,
            cycles=self.sweep.cycles,
            ramp_in_cycles=self.sweep.ramp_in_cycles,
            ramp_out_cycles=self.sweep.ramp_out_cycles,
            centre_m=self.specimen.mid_stroke_m,
            rest_s=self.sweep.rest_s,
        )

    def problems(self) -> Iterator[Problem]:
        """See `Section.problems`."""
        miscounted = [*self._tests_named_once(), *self._counted()]
        yield from miscounted
        yield from (*self._heat_known(), *self._damper_assumed(), *self._current_tells_force(), *self._forces_given())
        if not miscounted:  # there may be millions of them
            yield from self._unique_ids()

    def _counted(self) -> Iterator[Problem]:
        sweep = self.sweep
        axes = {"waveforms": len(sweep.cyclic), "currents": len(sweep.current_A), **sweep.size.axes}
        signals = len(sweep.current_A) * sum(table.count for table in sweep.signals.values())
        count = (math.prod(axes.values()) + signals + len(self.extra)) * sweep.repeats
        count += (self.friction is not None) + len(self.current_step) + sum(table.count for table in self.response)
        count += 0 if self.hybrid is None else len(self.hybrid.compensation) * len(self.hybrid.law)
        performance = count
        for test in self.endurance:
            count += test.blocks + test.rounds * performance
        if count == 0:
            yield (), "no test points are defined. Fix: complete [matrix], or add a [[point]]"
        if count > POINT_LIMIT:
            product_of = f"{' x '.join(map(str, axes.values()))} {' x '.join(axes)}"
            yield (), (
                f"the matrix contains {count} test points: ({product_of} + {signals} signals + "
                f"{len(self.extra)} [[point]]) x {sweep.repeats} repeats{self._of_endurance(performance)}; allowed: at "
                f"most {POINT_LIMIT}. Fix: {'use longer blocks, or ' if self.endurance else ''}split the matrix"
            )

    def _of_endurance(self, performance: int) -> str:
        """The points of the endurance tests, in words."""
        return "".join(
            f" + {name}: {test.blocks} blocks and {test.rounds} x {performance} performance points"
            for name, test in self.endurance_tests.items()
        )

    def _tests_named_once(self) -> Iterator[Problem]:
        names = [name.casefold() for name in self._endurance_ids]
        for number, name in enumerate(names):
            if name in names[:number]:
                text = f"two endurance tests have the ID {name!r}. Fix: give each [[endurance]] a unique id"
                yield ("endurance", number, "id"), text

    def _heat_known(self) -> Iterator[Problem]:
        if self.sweep.order != "by heat":
            return
        if self.temperature is None:
            yield (), 'order = "by heat" requires the entry window in [temperature]'
        if self.specimen.prior is None and self.specimen.max_force_N is None:
            yield (), 'order = "by heat" requires specimen.prior or specimen.max_force'

    def _damper_assumed(self) -> Iterator[Problem]:
        if self.hybrid is not None and self.specimen.prior is None:
            text = (
                "is missing; the forecast for a hybrid test requires an expected damper. Fix: specify a parameter "
                'set, prior = "demo"'
            )
            text += ', or a fit in the folder of this file, prior = "fit.json"'
            yield ("specimen", "prior"), text

    def _current_tells_force(self) -> Iterator[Problem]:
        assumed = self.specimen.assumed
        if self.hybrid is not None and assumed is not None:
            for place, text in self.hybrid.blind_to_current(assumed):
                yield ("hybrid", *place), text

    def _unique_ids(self) -> Iterator[Problem]:
        points = [*self._written(), *(point for point in self._ordered if point.endurance is not None)]
        counts = Counter(point.id.casefold() for point in points if point.kind != HYBRID)
        twice = sorted(name for name, count in counts.items() if count > 1)
        if twice:
            yield (), (
                f"duplicate point ID: {some(twice, most=10)}. Fix: give each [[point]] a unique ID (points without an "
                "ID are named p001, p002 ...; repeats add -2, -3 ...; case is ignored)"
            )


def load_matrix(path: str | Path) -> Matrix:
    """Read and check a matrix file.

    Raises:
        FileProblem: with every wrong entry of the file.
    """
    return load_section(Path(path), Matrix, "matrix", named_files.with_paths)[0]


def load_files(matrix_path: Path, bench_path: Path) -> tuple[Matrix, Bench]:
    """Read and check both files.

    Raises:
        FileProblem: one of them cannot be used, with every wrong entry; or they are exchanged, in one line.
        FileProblems: both cannot.
    """
    problems: list[FileProblem] = []
    matrix = bench = None
    try:
        matrix = load_matrix(matrix_path)
    except FileProblem as error:
        problems.append(error)
    try:
        bench = Bench.load(bench_path)
    except FileProblem as error:
        problems.append(error)
    if [error.kind for error in problems if isinstance(error, WrongKind)] == ["bench", "matrix"]:
        turned = f"rig plan {bench_path} --bench {matrix_path}"
        raise FileProblem(str(matrix_path), ["the matrix file and the bench file are swapped: this is the bench "
            f"file. Fix: {turned}"])
    if matrix is None or bench is None:
        raise problems[0] if len(problems) == 1 else FileProblems(problems)
    return matrix, bench

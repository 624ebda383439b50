"""Runs beside each other: every motion and parameter of any of them, with what changed against the first."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from rig.campaign_folder import CampaignFolder, run_path
from rig.comparison.acceptance import AcceptanceResult, evaluate
from rig.comparison.bands import load_bands
from rig.comparison.changes import Change, ChangeSummary, change, summarised, transfer
from rig.comparison.readings import (
    LOOP_QUANTITIES,
    QUANTITIES,
    SINGLE_QUANTITIES,
    FittedReading,
    LoopReading,
    Motion,
    Reading,
    RunReadings,
    one_to_one,
    readings_of,
)
from rig.display import Display
from rig.errors import RigError, some
from rig.jobs.workers import HERE, Job, Workers
from rig.recording.run import Run
from rig.signals.test_set import MOTION_SHARE
from rig.test_point import SIGNAL

MOST_RUNS = 12
"""Maximum number of runs shown side by side; more runs are only checked against acceptance bands."""
MOST_CHECKED = 1000
NEARBY = 0.2
"""Relative difference of two motions, up to which it is worth reporting that they are not compared."""
MOST_LABELS = 4
WORTH_REPORTING = 5e-4
"""Relative difference of two motions, from which a correction is reported."""


@dataclass(frozen=True)
class MotionRow:
    """One motion: each run's reading of it, None where a run has none."""

    motion: Motion
    loops: tuple[LoopReading | None, ...]


@dataclass(frozen=True)
class Comparison:
    """Runs beside each other; the first is what the others are held against. `judgement` None without bands."""

    runs: tuple[RunReadings, ...]
    rows: tuple[MotionRow, ...]
    judgement: AcceptanceResult | None = None

    @property
    def display(self) -> Display:
        """Units and signs in which people read it: those of the first run."""
        return self.runs[0].run.display

    def change(self, run: int, quantity: str, row: MotionRow) -> Change | None:
        """Of a quantity of a motion, against the first run; None where one of them lacks it.

        Forces in rebound and in compression have one unit of change in all tests: where one of them has no relative
        change, none has.
        """
        one = self._change(run, quantity, row)
        return one if one is None or (run, quantity) not in self._in_unit_of_force else one.absolute

    @cached_property
    def _in_unit_of_force(self) -> frozenset[tuple[int, str]]:
        """Run and quantity of the forces, if one of them lacks a relative change in one test at least."""
        forces = [quantity.key for quantity in LOOP_QUANTITIES if quantity.unit == "N"]
        return frozenset(
            (run, quantity) for run in range(1, len(self.runs)) for quantity in forces if any(
                math.isnan(one.percent) for row in self.rows for key in forces
                if (one := self._change(run, key, row)) is not None
            )
        )

    def _change(self, run: int, quantity: str, row: MotionRow) -> Change | None:
        first, later = row.loops[0], row.loops[run]
        if first is None or later is None:
            return None
        before, after = first.values.get(quantity), later.values.get(quantity)
        if before is None or after is None:
            return None
        moved = transfer(QUANTITIES[quantity], first.motion, later.motion)
        return change(before, after, same_gauge=self._same_gauge(run), moved=moved)

    def summary(self, run: int, quantity: str) -> ChangeSummary | None:
        """All changes of a quantity of one run in one; None where it shares no motion with the first run."""
        known = [(row.motion, one) for row in self.rows if (one := self.change(run, quantity, row)) is not None]
        return summarised(known)

    def single_change(self, run: int, quantity: str) -> Change | None:
        """Of friction or gas force."""
        before, after = self.runs[0].singles.get(quantity), self.runs[run].singles.get(quantity)
        if before is None or after is None:
            return None
        return change(before, after, same_gauge=self._same_gauge(run))

    def parameter_change(self, run: int, name: str) -> Change | None:
        """Of a fitted parameter; None where the models differ, or one fit cannot tell it."""
        first, later = self.runs[0], self.runs[run]
        before, after = first.parameters.get(name), later.parameters.get(name)
        if first.model != later.model or before is None or after is None or before.why or after.why:
            return None
        return change(before.reading, after.reading, same_gauge=True)

    def _same_gauge(self, run: int) -> bool:
        first, later = self.runs[0].load_cell, self.runs[run].load_cell
        return bool(first) and first == later

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Of every run's fit, in order."""
        return tuple(dict.fromkeys(name for run in self.runs for name in run.parameters))

    @property
    def remarks(self) -> tuple[str, ...]:
        """What must be known before the differences are believed."""
        lines = []
        if len(self.runs) > 1 and not any(all(row.loops) for row in self.rows):
            lines.append("the runs have no cyclic motion in common")
        lines += [*self._corrected(), *self._near(), *self._without_percentage()]
        if len({run.load_cell for run in self.runs if run.load_cell}) > 1:
            lines.append(
                "different load cells or sensitivities were used: the uncertainty of their calibrations is included "
                "in the differences"
            )
        given = Counter(run.identity for run in self.runs)
        if max(given.values()) > 1:
            lines.append("the same run is specified more than once; identical data cannot show a change")
        for run in self.runs:
            if signals := [point.id for point in run.run.points if point.kind == SIGNAL]:
                lines.append(
                    f"{run.name}: signals (sweep, road, file) have no loops, so only their fit is "
                    f"compared: {', '.join(signals[:3])}{', ...' if len(signals) > 3 else ''}"
                )
            if run.not_recorded:
                lines.append(f"{run.name}: planned points not recorded: {len(run.not_recorded)}")
            if run.left_out:
                lines.append(f"{run.name}: {len(run.left_out)} item(s) not evaluated; first: {run.left_out[0]}")
        return (*lines, *self._without_parameters())

    def _without_parameters(self) -> Iterator[str]:
        """Why the parameters of a run are not compared with those of the first."""
        models = {run.model for run in self.runs if run.model}
        if len(models) > 1:
            yield f"different models were fitted ({', '.join(sorted(models))}), so parameters are not compared"
        unfitted = [run.name for run in self.runs if not run.model]
        if unfitted and len(self.runs) > 1:
            which = "none of the runs has a fit" if not models else f"no fit in {', '.join(unfitted)}"
            yield f"model parameters are not compared: {which}. Fix: rig identify RUN"
        for index, run in enumerate(self.runs[1:], start=1):
            names = [name for name in self.runs[0].parameters if name in run.parameters]
            if run.model == self.runs[0].model and names and not any(
                self.parameter_change(index, name) for name in names
            ):
                why = next(one.parameters[names[0]].why for one in (run, self.runs[0]) if one.parameters[names[0]].why)
                yield f"{run.name}: model parameters are not compared: {why}"

    def _corrected(self) -> Iterator[str]:
        """Motions that are compared although they differ a little."""
        for index, run in enumerate(self.runs[1:], start=1):
            largest = 0.0
            for row in self.rows:
                first, later = row.loops[0], row.loops[index]
                if first is not None and later is not None and None in {first.motion.read.requested,
                                                                        later.motion.read.requested}:  # fmt: skip
                    largest = max(largest, first.motion.apart_from(later.motion))
            if largest >= WORTH_REPORTING:
                yield (
                    f"{run.name}: the measured motions differ from those of the first run by up to "
                    f"{100.0 * largest:.2g} %; "
                    "changes are corrected to the first run's motion (forces with speed^0.5), and the uncertainty of "
                    "the correction is included"
                )

    def _without_percentage(self) -> Iterator[str]:
        """Forces whose changes are stated in the unit of the force."""
        for index in sorted({index for index, _ in self._in_unit_of_force}):
            yield (
                f"{self.runs[index].name}: all changes of the rebound and compression forces are stated in "
                f"{self.display.force.unit}, because in at least one test a force is near zero, smaller than the gas "
                "force or (if the gas force was not measured) less than a third of the compression force, or its sign "
                "changes; forces at peak velocity include the gas force"
            )

    def _near(self) -> Iterator[str]:
        """Motions without a counterpart; of those that have one nearby how far it is: too far for a correction."""
        for index, run in enumerate(self.runs[1:], start=1):
            alone = [
                row.loops[0].motion.phrase(self.display) for row in self.rows if row.loops[0] and not row.loops[index]
            ]
            extra: list[str] = []
            for row in self.rows:
                loop = row.loops[index]
                if loop is None or row.loops[0] is not None:
                    continue
                others = [
                    (loop.motion.apart_from(first.motion), first.motion) for first in self.runs[0].loops
                    if first.motion.waveform == loop.motion.waveform and first.motion.at_current_of(loop.motion)
                ]
                apart, nearest = min(others, key=lambda pair: pair[0], default=(math.inf, loop.motion))
                if apart < NEARBY and nearest.same_as(loop.motion):
                    yield (
                        f"{run.name}: {loop.motion.phrase(self.display)} is not compared: the nearest motion in the "
                        f"first run, {nearest.phrase(self.display)}, is compared with another motion of this run"
                    )
                elif apart < NEARBY:
                    yield (
                        f"{run.name}: {loop.motion.phrase(self.display)} is not compared: the nearest motion in the "
                        f"first run, {nearest.phrase(self.display)}, differs by {100.0 * apart:.2g} %, more than the "
                        f"largest correction ({100.0 * MOTION_SHARE:g} %)"
                    )
                else:
                    extra.append(loop.motion.phrase(self.display))
            if any(row.loops[0] and row.loops[index] for row in self.rows):
                for labels, where in ((extra, "not in the first run"), (alone, "only in the first run")):
                    if labels:
                        yield (
                            f"{run.name}: {len(labels)} motion(s) {where}, therefore not compared: "
                            f"{some(labels, '; ', MOST_LABELS)}"
                        )

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {
            "runs": [
                {"id": run.name, "path": str(run.run.path.resolve()), "specimen": run.specimen,
                 "model": run.model or None, "load_cell": run.load_cell or None, "left_out": list(run.left_out)}
                for run in self.runs
            ],
            "loops": [self._row_json(row) for row in self.rows],
            "summary": [
                {quantity.key: None if (summary := self.summary(index, quantity.key)) is None else summary.to_json()
                 for quantity in LOOP_QUANTITIES}
                for index in range(1, len(self.runs))
            ],
            "singles": {
                quantity.key: [
                    self._entry(run.singles.get(quantity.key), self.single_change(index, quantity.key))
                    for index, run in enumerate(self.runs)
                ]
                for quantity in SINGLE_QUANTITIES
            },
            "parameters": {name: self._parameter_json(name) for name in self.parameter_names},
            "remarks": list(self.remarks),
            "bands": None if self.judgement is None else self.judgement.to_json(),
        }  # fmt: skip

    def _row_json(self, row: MotionRow) -> dict[str, Any]:
        motion = row.motion
        return {
            "waveform": motion.waveform, "amplitude_m": motion.amplitude_m, "frequency_Hz": motion.frequency_Hz,
            "current_A": motion.current_A,
            "points": [None if loop is None else list(loop.ids) for loop in row.loops],
            "peak_speed_m_s": [None if loop is None else loop.speed_m_s for loop in row.loops],
            **{
                quantity.key: [
                    self._entry(None if loop is None else loop.values.get(quantity.key),
                                self.change(index, quantity.key, row))
                    for index, loop in enumerate(row.loops)
                ]
                for quantity in LOOP_QUANTITIES
            },
        }  # fmt: skip

    def _parameter_json(self, name: str) -> list[dict[str, Any] | None]:
        entries = []
        for index, run in enumerate(self.runs):
            fitted: FittedReading | None = run.parameters.get(name)
            entry = self._entry(None if fitted is None else fitted.reading, self.parameter_change(index, name))
            if entry is not None and fitted is not None:
                entry |= {"unit": fitted.unit, "why_not": fitted.why or None}
            entries.append(entry)
        return entries

    @staticmethod
    def _entry(reading: Reading | None, changed: Change | None) -> dict[str, Any] | None:
        if reading is None:
            return None
        return {
            "value": reading.value, "std": reading.std, "expanded": reading.expanded,
            "change": None if changed is None else changed.to_json(),
        }  # fmt: skip


def compare(
    runs: Sequence[Path | str | Run], bands: Path | str | None = None, workers: Workers = HERE
) -> Comparison:
    """Compare runs.

    Args:
        runs: campaigns, or their directories; the first is the reference. A single run needs `bands`.
        bands: acceptance bands file.
        workers: evaluate the runs that are specified by their directories.

    Raises:
        RigError: a single run without bands, or more than 12 runs (with bands, more than 1,000).
        FileProblem: a run or the bands file cannot be used.
    """
    limits = None if bands is None else load_bands(bands)
    if not runs or (len(runs) == 1 and limits is None):
        raise RigError("nothing to compare. Fix: specify two runs, or one run and acceptance bands (--bands FILE)")
    most = MOST_RUNS if limits is None else MOST_CHECKED
    if len(runs) > most:
        more = f"; with acceptance bands (--bands FILE) at most {MOST_CHECKED}" if limits is None else ""
        raise RigError(f"got {len(runs)} runs, expected at most {most}{more}")
    read = _read(runs, workers)
    acceptance = None if limits is None else evaluate(limits, read, str(bands))
    return Comparison(read, motion_rows(read), acceptance)


def _read(runs: Sequence[Path | str | Run], workers: Workers) -> tuple[RunReadings, ...]:
    """Comparable values of each run."""
    paths = [run for run in runs if not isinstance(run, Run)]
    if workers is HERE or not paths:
        return tuple(readings_of(run if isinstance(run, Run) else Run.open(run)) for run in runs)
    folders = [CampaignFolder.found(run_path(path)) for path in paths]
    workers.check_files([file for folder in folders for file in folder.evaluated])
    whole = [folder.path.absolute() for folder in folders]
    evaluated = iter(workers.in_order(Job(path.name, _readings_at, (path,)) for path in whole))
    return tuple(readings_of(run) if isinstance(run, Run) else next(evaluated) for run in runs)


def _readings_at(path: Path) -> RunReadings:
    """In a worker: comparable values of a run, without its arrays."""
    readings = readings_of(Run.open(path))
    points = tuple(replace(point) for point in readings.run.points)
    return replace(readings, run=replace(readings.run, points=points))


def motion_rows(runs: Sequence[RunReadings]) -> tuple[MotionRow, ...]:
    """Every motion of any run once, in the order of current, waveform and speed."""
    motions: list[Motion] = []
    loops: list[list[LoopReading | None]] = []
    for index, run in enumerate(runs):
        pairs = one_to_one(motions, [loop.motion for loop in run.loops])
        for at, row in enumerate(loops):
            row.append(run.loops[pairs[at]] if at in pairs else None)
        known = {*pairs.values()}
        alone = [loop for at, loop in enumerate(run.loops) if at not in known]
        motions += [loop.motion for loop in alone]
        loops += [[*[None] * index, loop] for loop in alone]
    rows = [MotionRow(motion, tuple(row)) for motion, row in zip(motions, loops, strict=True)]
    return tuple(sorted(rows, key=lambda row: (
        row.motion.waveform, row.motion.current_A, row.motion.amplitude_m * row.motion.frequency_Hz,
    )))

"""Runs beside each other: every motion and parameter of any of them, with what changed against the first."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rig.comparison.bands import load_bands
from rig.comparison.changes import Change, change
from rig.comparison.judgement import Judgement, judge
from rig.comparison.readings import (
    LOOP_QUANTITIES,
    SINGLE_QUANTITIES,
    FittedReading,
    LoopReading,
    Motion,
    Reading,
    RunReadings,
    readings_of,
)
from rig.errors import RigError
from rig.recording.layout import SIGNAL
from rig.recording.run import Run

MOST_RUNS = 12


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
    judgement: Judgement | None = None

    def change(self, run: int, quantity: str, row: MotionRow) -> Change | None:
        """Of a quantity of a motion, against the first run; None where one of them lacks it."""
        first, later = row.loops[0], row.loops[run]
        if first is None or later is None:
            return None
        return self._changed(run, first.values.get(quantity), later.values.get(quantity))

    def single_change(self, run: int, quantity: str) -> Change | None:
        """Of friction or gas force."""
        return self._changed(run, self.runs[0].singles.get(quantity), self.runs[run].singles.get(quantity))

    def parameter_change(self, run: int, name: str) -> Change | None:
        """Of a fitted parameter; None where the models differ, or one fit cannot tell it."""
        first, later = self.runs[0], self.runs[run]
        before, after = first.parameters.get(name), later.parameters.get(name)
        if first.model != later.model or before is None or after is None or before.why or after.why:
            return None
        return change(before.reading, after.reading, same_gauge=True)

    def _changed(self, run: int, before: Reading | None, after: Reading | None) -> Change | None:
        if before is None or after is None:
            return None
        first, later = self.runs[0].load_cell, self.runs[run].load_cell
        return change(before, after, same_gauge=bool(first) and first == later)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Of every run's fit, in order."""
        return tuple(dict.fromkeys(name for run in self.runs for name in run.parameters))

    @property
    def remarks(self) -> tuple[str, ...]:
        """What must be known before the differences are believed."""
        lines = []
        models = {run.model for run in self.runs if run.model}
        if len(models) > 1:
            lines.append(f"different models were fitted ({', '.join(sorted(models))}): parameters are not compared")
        if len(self.runs) > 1 and not any(all(row.loops) for row in self.rows):
            lines.append("the runs have no motion with cycles in common")
        if len({run.load_cell for run in self.runs if run.load_cell}) > 1:
            lines.append("different load cells or sensitivities: their calibrations count in the differences")
        given = Counter(run.identity for run in self.runs)
        if max(given.values()) > 1:
            lines.append("one run is given more than once: between itself and itself nothing can have changed")
        for run in self.runs:
            if signals := [point.id for point in run.run.points if point.kind == SIGNAL]:
                lines.append(
                    f"{run.name}: signals (sweep, road, file) have no loop and are not compared, only their "
                    f"fit: {', '.join(signals[:3])}{', ...' if len(signals) > 3 else ''}"
                )
            if run.not_recorded:
                lines.append(f"{run.name}: {len(run.not_recorded)} planned point(s) were not recorded")
            if run.left_out:
                lines.append(f"{run.name}: {len(run.left_out)} thing(s) left out; first: {run.left_out[0]}")
        return tuple(lines)

    def to_json(self) -> dict[str, Any]:
        """Plain types; the keys are in `docs/json.md`."""
        return {
            "runs": [
                {"id": run.name, "path": str(run.run.path.resolve()), "specimen": run.specimen,
                 "model": run.model or None, "load_cell": run.load_cell or None, "left_out": list(run.left_out)}
                for run in self.runs
            ],
            "loops": [self._row_json(row) for row in self.rows],
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


def compare(runs: Sequence[Path | str | Run], bands: Path | str | None = None) -> Comparison:
    """Put runs beside each other.

    Args:
        runs: campaigns, or their directories; the first is the reference. One alone needs `bands`.
        bands: acceptance bands file.

    Raises:
        RigError: one run without bands, or more than 12.
        FileProblem: a run or the bands file cannot be used.
    """
    limits = None if bands is None else load_bands(bands)
    if not runs or (len(runs) == 1 and limits is None):
        raise RigError("nothing to compare: give two runs, or one and acceptance bands (--bands FILE)")
    if len(runs) > MOST_RUNS:
        raise RigError(f"{len(runs)} runs; at most {MOST_RUNS} can be compared at once")
    read = tuple(readings_of(run if isinstance(run, Run) else Run.open(run)) for run in runs)
    judgement = None if limits is None else judge(limits, read, str(bands))
    return Comparison(read, _rows(read), judgement)


def _rows(runs: Sequence[RunReadings]) -> tuple[MotionRow, ...]:
    """Every motion of any run once, in the order of current, waveform and speed."""
    motions: list[Motion] = []
    for run in runs:
        motions += [loop.motion for loop in run.loops if not any(known.same_as(loop.motion) for known in motions)]
    rows = [MotionRow(motion, tuple(run.loop_of(motion) for run in runs)) for motion in motions]
    return tuple(sorted(rows, key=lambda row: (
        row.motion.waveform, row.motion.current_A, row.motion.amplitude_m * row.motion.frequency_Hz,
    )))

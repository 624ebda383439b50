"""A block of an endurance test as its file holds it: statistics of every cycle, full samples of some.

The block is aligned and evaluated from all of its samples, as any point. Then its file keeps the statistics of every
cycle (`/entry/cycles`), and under `/entry/data` and `/entry/raw` the samples of every k-th cycle; of a block that did
not run to its end also those before the end.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from drivers.roles import ProgramPhase
from rig.recording.alignment.alignment import Alignment, TimedChannel
from rig.recording.journal.journal_file import JournalContent, joined
from rig.recording.layout import CycleTable, PointFile, RawChannel
from rig.recording.quality.point_quality import EnduranceQuality, PointQuality
from rig.recording.quality.tracking import played
from rig.signals.arrays import FloatArray
from rig.signals.chunked_column import Values, first_after, parts
from rig.signals.cycle_statistics import (
    NO_CYCLES,
    UNITS,
    CycleBounds,
    CycleSamples,
    cycle_bounds,
    cycle_statistics,
    repeated_bounds,
)
from rig.signals.program_cycles import PROGRAM_CYCLE
from rig.test_point import TestPoint

SAMPLES_AT_ONCE = 50_000
BEFORE_THE_END_S = 10.0
"""Samples kept before the end of a block that was stopped or cut off."""
AFTERWARDS = frozenset({"INTERRUPTED", "trip", "journal-damaged", "signal-incomplete"})
"""Reasons for which a block is invalid as long as some of its cycles are missing."""
LAST_S, STILL_SHARE = 0.1, 0.05
"""Time at the end of the samples over which a rod at rest moves less than this share of the amplitude."""
MOST_WITHOUT_CYCLES = 100_000
"""Samples kept of a block without a full cycle: its last ones."""
SPARE_SAMPLES = 64
"""Kept beside a part of the samples, for differences at its edges."""

PROGRAM_UNITS = {PROGRAM_CYCLE: ("1", "Number of the cycle in the coil-current program, from 1")}
"""Only of a block with a current program."""

Windows = list[tuple[float, float]]
"""Times (s) of the file whose samples are kept."""


def reduced(
    file: PointFile, quality: PointQuality, alignment: Alignment, content: JournalContent, point: TestPoint
) -> tuple[PointFile, PointQuality]:
    """The file of a block, and its quality with the count of its cycles.

    Args:
        file: with all samples.
        quality: of them.
        alignment: the aligned channels.
        content: the journal, for how it ended.
        point: the block.
    """
    bounds = _bounds(alignment, point)
    seen, requested = bounds.run, round(point.cycles)
    if seen > requested:  # the last cycles of a long ramp reach the full amplitude
        bounds = CycleBounds(bounds.start_s[seen - requested :], bounds.cycles[seen - requested :])
    run = min(requested, max(bounds.run, _by_controller(alignment, point)))
    statistics = _statistics(alignment, bounds, point, file.sample_rate_hz)
    step = point.endurance
    before = 0 if step is None else step.cycles_before
    numbers = before + np.cumsum(bounds.cycles)
    recorded = int(np.count_nonzero(np.isfinite(statistics["displacement_max"])))
    finished = run == requested
    cut_off = not finished and (content.end is None or _still_moving(alignment, point))
    endurance = EnduranceQuality(
        cycles_run=run, cycles_recorded=recorded, finished=finished,
        unseen_cycles=step.unseen_cycles if cut_off and step is not None else 0,
    )
    units = UNITS
    program = point.repeated_program
    if program is not None:
        places = program.places(np.cumsum(bounds.cycles) - 1, statistics["current"])
        if seen < requested and not np.any(np.isfinite(statistics["current"])):
            places = np.full_like(places, np.nan)  # the first cycle may be missing, and no current shows it
        statistics = statistics | {PROGRAM_CYCLE: places}
        units = {**UNITS, **PROGRAM_UNITS}
    table = CycleTable(numbers.astype(np.int64), statistics, units)
    windows = _windows(statistics, numbers, 1 if step is None else max(1, step.keep_every), alignment, cut=not finished)
    verdict = quality.verdict
    if finished and recorded == run:  # what came after its last cycle takes nothing from it
        verdict = verdict.replaced({*AFTERWARDS, str((content.end or {}).get("stopped_by"))}, ())
    quality = replace(quality, verdict=verdict, endurance=endurance, motion=replace(
        quality.motion, cycle_amplitude_m=None, cycle_mean_m=None, cycle_frequency_Hz=None, cycle_distortion=None,
        cycle_phase_deg=None,
    ))  # fmt: skip
    return replace(_kept(file, alignment, windows), cycles=table, quality=quality.attributes), quality


def _still_moving(alignment: Alignment, point: TestPoint) -> bool:
    """Whether the samples end before the motion does, as when the station was killed."""
    time_s = alignment.time_s
    begin = first_after(time_s, float(time_s[-1]) - LAST_S)
    displacement_m = np.asarray(alignment.values["displacement"][begin:])
    known_m = displacement_m[np.isfinite(displacement_m)]
    return known_m.size > 0 and float(np.ptp(known_m)) > STILL_SHARE * point.amplitude_m


def _bounds(alignment: Alignment, point: TestPoint) -> CycleBounds:
    """The block's cycles on the file's time base."""
    if point.record is None:
        time_s, displacement_m = np.asarray(alignment.time_s), np.asarray(alignment.values["displacement"])
        return cycle_bounds(time_s, displacement_m, point.frequency_Hz)
    signal = played(point.record, alignment)
    if signal is None:
        return NO_CYCLES
    _, window = signal
    return repeated_bounds(window.evaluated_s[0], 1.0 / point.frequency_Hz, window.evaluated_s[1], round(point.cycles))


def _by_controller(alignment: Alignment, point: TestPoint) -> int:
    """Full cycles that the controller counted; 0 where it counts none.

    Until the programme starts the controller shows the count of the one before: only what follows its reset counts.
    While it fades out it goes on counting: the count is read where full amplitude has ended.
    """
    counted, phases = alignment.timed.get("cycles_done"), alignment.timed.get("phase")
    if counted is None or point.record is not None or len(counted.records) == 0:
        return 0
    values = np.asarray(counted.records[:]["value"], np.float64)
    resets = np.flatnonzero(np.diff(values) < 0.0)
    if not resets.size and values[0] > 0.0:
        return 0
    done = float(values[-1])
    if phases is not None and len(phases.records):
        full = np.asarray(phases.records[:]["value"]) == ProgramPhase.FULL_AMPLITUDE
        ends_s = np.asarray(phases.time_s)[1:][full[:-1] & ~full[1:]]
        if ends_s.size:
            after = int(np.searchsorted(np.asarray(counted.time_s), ends_s[-1]))
            done = float(values[min(after, len(values) - 1)])
            return min(round(point.cycles), int(max(0.0, done - point.ramp_in_cycles)))
    whole = point.ramp_in_cycles + point.cycles + point.ramp_out_cycles
    return round(point.cycles) if done >= np.floor(whole + 1e-6) else int(max(0.0, done - point.ramp_in_cycles))


def _statistics(
    alignment: Alignment, bounds: CycleBounds, point: TestPoint, rate_Hz: float
) -> dict[str, FloatArray]:
    """The statistics of every cycle, computed over so many cycles at a time that memory stays bounded."""
    columns = ("displacement", "force", "current", "coil_temperature")
    collected: list[dict[str, FloatArray]] = []
    usual_samples, fastest_samples = rate_Hz / point.frequency_Hz, rate_Hz / point.highest_Hz
    speed_varies = point.shape.corner_share is None
    at_once = max(1, int(SAMPLES_AT_ONCE / max(usual_samples, 1.0)))
    time_s = np.asarray(alignment.time_s)
    for first in range(0, len(bounds.cycles), at_once):
        some = CycleBounds(bounds.start_s[first : first + at_once + 1], bounds.cycles[first : first + at_once])
        begin, end = np.searchsorted(time_s, some.start_s[[0, -1]])
        rows = slice(max(0, int(begin) - SPARE_SAMPLES), min(len(time_s), int(end) + SPARE_SAMPLES))
        samples = CycleSamples(time_s[rows], *(np.asarray(alignment.values[name][rows]) for name in columns))
        collected.append(cycle_statistics(
            samples, some, usual_samples, fastest_samples=fastest_samples, speed_varies=speed_varies
        ))
    if not collected:
        return {name: np.zeros(0) for name in UNITS}
    return {name: np.concatenate([part[name] for part in collected]) for name in UNITS}


def _windows(
    statistics: Mapping[str, FloatArray], numbers: NDArray[np.int64], every: int, alignment: Alignment, *, cut: bool
) -> Windows:
    """What is kept: every so many cycles, or at least the last one, and the end of a block that was cut short."""
    start_s, end_s = statistics["start"], statistics["start"] + statistics["period"]
    kept = np.flatnonzero(numbers % every == 0)
    if kept.size == 0:
        kept = np.flatnonzero(np.isfinite(statistics["force_max"]))[-1:]
    windows = [(float(start_s[place]), float(end_s[place])) for place in kept]
    last_s = float(alignment.time_s[-1])
    if cut or not windows:
        count = len(alignment.time_s)
        earliest_s = float(alignment.time_s[max(0, count - MOST_WITHOUT_CYCLES)])
        windows.append((max(earliest_s, last_s - BEFORE_THE_END_S), np.inf))
    return windows


def _inside(time_s: FloatArray, windows: Windows) -> NDArray[np.bool_]:
    """Which times (n,) lie in a window; windows are in order, only the last may overlap the one before."""
    starts, ends = (np.array([window[edge] for window in windows]) for edge in (0, 1))
    at = np.searchsorted(starts, time_s, side="right") - 1
    within: NDArray[np.bool_] = (at >= 0) & (time_s < np.maximum.accumulate(ends)[np.maximum(at, 0)])
    return within


def _kept(file: PointFile, alignment: Alignment, windows: Windows) -> PointFile:
    """The file with the samples of the windows only; at least two aligned samples remain."""
    rows = np.flatnonzero(np.concatenate([_inside(np.asarray(part), windows) for part in _parts(file.time_s)]))
    if rows.size < 2:
        rows = np.arange(max(0, len(file.time_s) - 2), len(file.time_s))
    return replace(
        file, time_s=_chosen(file.time_s, rows),
        channels=[replace(channel, values=_chosen(channel.values, rows)) for channel in file.channels],
        flags=None if file.flags is None else _chosen(file.flags, rows),
        raw=[_raw(channel, alignment.timed[channel.name], alignment.origin_s, windows) for channel in file.raw],
    )


def _parts(values: Values) -> Iterator[Values]:
    return (values[rows] for rows in parts(len(values)))


def _chosen(values: Values, rows: NDArray[np.int64]) -> NDArray[np.float64]:
    """Rows (ascending) of a column, read part by part."""
    edges = [(part, np.searchsorted(rows, (part.start, part.stop))) for part in parts(len(values))]
    return np.concatenate([np.asarray(values[part])[rows[a:b] - part.start] for part, (a, b) in edges if b > a])


def _raw(channel: RawChannel, timed: TimedChannel, origin_s: float, windows: Windows) -> RawChannel:
    """A channel as received, within the windows."""
    records, times = [], []
    for part in parts(len(channel.records)):
        time_s = np.asarray(timed.received_s[part]) - origin_s
        inside = _inside(time_s, windows)
        records.append(channel.records[part][inside])
        times.append(time_s[inside])
    kept_s = None if channel.time_s is None else np.concatenate(times)
    return replace(channel, records=joined(records), time_s=kept_s)

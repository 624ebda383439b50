"""Evidence in a point's samples: losses, frozen values, motion, current, temperature, loop shape.

`judged` does everything: `examine` collects the evidence, `point_quality.measured_quality` the quality section of the
file, `judgement.judge` gives the verdict.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from protocols.quality import Quality
from rig.recording.alignment.alignment import Alignment, Overview, TimedChannel
from rig.recording.journal.journal_file import JournalContent
from rig.recording.layout import Attribute, PointContext, SensorContext
from rig.recording.point_files import OUT_OF_TOLERANCE
from rig.recording.quality.cross_checks import point_reasons
from rig.recording.quality.point_quality import PointQuality, measured_quality
from rig.recording.quality.tracking import Tracking, signal_quality, tracking_of, tracking_reasons
from rig.recording.quality.verdict import Kind, Reason, invalid, suspect
from rig.recording.quality.verdict_rules import PointEvidence, SensorCounts, evaluate
from rig.signals.arrays import FloatArray
from rig.signals.chunked_column import Values, parts
from rig.signals.current_error import law_error_A, loop_error_A, program_error_A, steps_error_A
from rig.signals.cycles import MeasuredMotion, measured_motion
from rig.signals.derivatives import velocity_of
from rig.signals.loop_shape import LoopShape, Standing, loop_shape, standing
from rig.signals.peak_force import PeakForce, peak_force
from rig.signals.straight_steps import steps_in_motion
from rig.test_point import ENDURANCE, RESPONSE, TestPoint

MOST_OVERVIEW_SAMPLES = 400_000
FEWEST_A_CYCLE = 200
SATURATION_SHARE = 0.999
TEMPERATURE_REACH_S = 0.5
LARGEST_DISORDER = 0.001
LOST_STEPS = 0.1
"""Share of the steps of a response test that may be missing in its results without a remark."""
EVALUATED_CYCLES, SPARE_CYCLES = 100, 5
"""Last cycles of a block of an endurance test that its verdict is given by, and what is added for its end at rest."""
VERDICT_REMARKS = {"machine-cannot": Kind.SUSPECT, "iteration": Kind.SUSPECT, OUT_OF_TOLERANCE: Kind.INVALID}
"""Remarks of the campaign in a point's journal that its verdict must know of."""


def evaluated(
    content: JournalContent, context: PointContext, alignment: Alignment, test: Mapping[str, Attribute],
    instruments: Sequence[Reason] | None = None,
) -> PointQuality:
    """The quality of an aligned point, its verdict in it.

    Args:
        content: its journal.
        context: the journal's header.
        alignment: its channels on one clock.
        test: what `/entry/test` says of it.
        instruments: what is said of the instruments; None: what the point alone says.
    """
    point = context.point
    seen = _overview(alignment, point.frequency_Hz)
    if point.kind == ENDURANCE and point.cyclic:
        seen = _last_cycles(seen, point)
    motion = measured_motion(seen.time_s, seen.displacement_m, point.waveform) if point.cyclic else None
    tracking = tracking_of(point, alignment, seen)
    evidence, shape, peak = examine(content, context, alignment, seen, motion, tracking)
    quality = measured_quality(context, alignment, seen, motion, evidence, shape, peak)
    if instruments is None:
        instruments = point_reasons(point.id, test, quality)
    verdict = evaluate(replace(evidence, extra=(*evidence.extra, *instruments)))
    return replace(quality, signal=signal_quality(tracking), verdict=verdict)


def _overview(alignment: Alignment, frequency_Hz: float) -> Overview:
    """Every k-th sample of a point too long to hold, every sample of any other.

    Args:
        alignment: the aligned point.
        frequency_Hz: of its cycles; at least 200 samples of each are kept.
    """
    count = len(alignment.time_s)
    every = 1
    if count > MOST_OVERVIEW_SAMPLES:
        rate_Hz = (count - 1) / max(float(alignment.time_s[-1]), 1e-9)
        enough = int(rate_Hz / (FEWEST_A_CYCLE * max(frequency_Hz, 1e-3)))
        every = max(1, min(-(-count // MOST_OVERVIEW_SAMPLES), enough))
    names = ("displacement", "force", "current", "coil_temperature")
    time_s, *values = (_every(column, every) for column in (alignment.time_s, *(alignment.values[n] for n in names)))
    return Overview(time_s, *values)


def _last_cycles(seen: Overview, point: TestPoint) -> Overview:
    """The last cycles of a block of an endurance test, by which it is judged: there may be thousands.

    All of its cycles are counted and described elsewhere (`rig.recording.conversion.endurance_block`).
    """
    length_s = (EVALUATED_CYCLES + SPARE_CYCLES + point.ramp_out_cycles) / point.frequency_Hz
    rows = slice(int(np.searchsorted(seen.time_s, seen.time_s[-1] - length_s)), None)
    return Overview(*(getattr(seen, column.name)[rows] for column in fields(seen)))


def _every(values: Values, every: int) -> FloatArray:
    if every == 1:
        return np.asarray(values, np.float64)
    return np.concatenate([np.asarray(values[rows])[-rows.start % every :: every] for rows in parts(len(values))])


def examine(
    content: JournalContent, context: PointContext, alignment: Alignment, seen: Overview, motion: MeasuredMotion | None,
    tracking: Tracking | None = None,
) -> tuple[PointEvidence, LoopShape | None, PeakForce]:
    """Everything a verdict is given by, the shape of the loop (None where it cannot be told), and the peak forces."""
    end = content.end or {}
    point = context.point
    inside = np.ones(len(seen.time_s), bool)
    starts = np.array([seen.time_s[0], np.nextafter(seen.time_s[-1], np.inf)])
    shape = None
    if tracking is not None:
        starts = np.array(tracking.window.evaluated_s)
        inside = (seen.time_s >= starts[0]) & (seen.time_s < starts[1])
    if motion is not None:
        inside = (seen.time_s >= motion.start_s) & (seen.time_s < motion.end_s)
        starts = motion.start_s + np.arange(motion.cycles + 1) * (motion.end_s - motion.start_s) / motion.cycles
    alike = motion is not None and not point.current_programmed  # else its cycles differ by the current
    if alike:
        shape = loop_shape(seen.time_s[inside], seen.displacement_m[inside], seen.force_N[inside], starts)
    peak = peak_force(seen.time_s[inside], seen.force_N[inside], starts if alike else None)
    frequency_Hz = point.frequency_Hz
    if point.kind == ENDURANCE:  # that its force changes is its result
        shape = None
    period_samples = context.sensors["force"].rate_Hz / frequency_Hz if frequency_Hz > 0.0 else np.inf
    findings = PointEvidence(
        sensors={name: _counts(alignment.timed[name], sensor, alignment, motion) if name in alignment.timed
                 else SensorCounts(0) for name, sensor in context.sensors.items()},
        requested_cycles=_requested_cycles(point), requested_amplitude_m=point.amplitude_m,
        requested_frequency_Hz=point.highest_Hz, current_tolerance_A=context.current_tolerance_A,
        measured_cycles=None if motion is None else motion.cycles,
        measured_amplitude_m=None if motion is None else motion.amplitude_m,
        amplitude_std_m=None if motion is None else motion.amplitude_std_m,
        measured_frequency_Hz=None if motion is None else motion.frequency_Hz,
        current_error_A=_current_error_A(seen, point, alignment, starts),
        amplitude_tolerance=context.commanded.amplitude_tolerance if point.adapts else None,
        extra=[
            *(Reason(event.code, VERDICT_REMARKS[event.code], event.text) for event in content.events
              if event.code in VERDICT_REMARKS),
            *_disorder(context, alignment),
            *_steps_lost(point, alignment, seen),
            *tracking_reasons(
                point, tracking, stopped=content.end is None or end.get("stopped_by") is not None,
                tolerance=context.commanded.tracking_tolerance,
            ),
        ],
        temperature_degC=_range(seen.temperature_degC[inside]),
        temperature_share=_share_known(seen.time_s, seen.temperature_degC, inside),
        temperature_window_degC=context.commanded.temperature_window_degC,
        skew_std_s=0.0 if point.at_rest else alignment.skew_trusted_s,
        scatter_N=None if shape is None else shape.scatter_N, change_N=None if shape is None else shape.change_N,
        change_std_N=0.0 if shape is None else shape.change_std_N,
        span_N=None if shape is None else shape.span_N, free_play_m=0.0 if shape is None else shape.free_play_m,
        samples_a_cycle=float(period_samples), stopped_by=end.get("stopped_by"), interrupted=content.end is None,
        overrun_records=int(end.get("lost_records", 0)), missing_blocks=content.missing_blocks,
        damaged_bytes=content.damaged_bytes, tripped="trip" in alignment.timed,
    )
    return findings, shape, peak


def _requested_cycles(point: TestPoint) -> float:
    """Cycles that a valid recording must have among those that are judged."""
    if not point.cyclic:
        return 0.0
    return float(min(point.cycles, EVALUATED_CYCLES) if point.kind == ENDURANCE else point.cycles)


def _disorder(context: PointContext, alignment: Alignment) -> list[Reason]:
    """Sensors whose device clock went back too often: those samples are in no loop."""
    channels = [alignment.timed[name] for name in context.sensors if name in alignment.timed]
    return [
        Reason(
            "device-time", Kind.INVALID,
            f"the device clock went backwards in {channel.disordered} of {len(channel.received)} {channel.name} "
            f"samples ({100 * channel.disordered / len(channel.received):.2g} %, limit {100 * LARGEST_DISORDER:g} %)",
        )
        for channel in channels if channel.disordered > LARGEST_DISORDER * len(channel.received)
    ]


def _steps_lost(point: TestPoint, alignment: Alignment, seen: Overview) -> list[Reason]:
    """Steps of the current of a response test that cannot be evaluated."""
    commands = alignment.timed.get("commanded_current")
    if point.kind != RESPONSE or commands is None:
        return []
    at_s = np.asarray(commands.time_s[:]) - alignment.origin_s
    velocity_m_s = velocity_of(seen.time_s, seen.displacement_m)[0]
    steps = steps_in_motion(
        (point.steps_s, point.steps_A), (at_s, commands.records["value"]), (seen.time_s, velocity_m_s),
        point.peak_speed_m_s,
    )
    if not steps.steps:
        return [invalid("response-steps", "; ".join((*steps.lost(), "no step of the current can be evaluated")))]
    if len(steps.steps) < (1.0 - LOST_STEPS) * steps.planned:
        return [suspect("response-steps", "; ".join(steps.lost()))]
    return []


def _share_known(time_s: FloatArray, temperature_degC: FloatArray, inside: NDArray[np.bool_]) -> float:
    """Share of the chosen samples (n,) with a known temperature near them: a coil does not warm in a moment."""
    known_s = time_s[np.isfinite(temperature_degC)]
    if len(known_s) == 0 or not np.any(inside):
        return 0.0
    after = np.searchsorted(known_s, time_s[inside])
    bounds_s = np.concatenate(([-np.inf], known_s, [np.inf]))
    apart_s = np.minimum(time_s[inside] - bounds_s[after], bounds_s[after + 1] - time_s[inside])
    return float(np.mean(apart_s <= TEMPERATURE_REACH_S))


def _range(values: FloatArray) -> tuple[float, float] | None:
    known = values[np.isfinite(values)]
    return (float(np.min(known)), float(np.max(known))) if len(known) else None


def _current_error_A(
    seen: Overview, point: TestPoint, alignment: Alignment, starts: FloatArray
) -> float | None:
    """How far the measured current was off: of its level, of each of its steps, or of what was commanded meanwhile."""
    if point.at_rest:
        return steps_error_A(seen.time_s, seen.current_A, point.steps_A, 1.0 / point.frequency_Hz)
    if point.current_programmed and point.kind != ENDURANCE:  # of a block only the last cycles are seen
        error_A = program_error_A(seen.time_s, seen.current_A, point.steps_A, point.steps_s)
        if error_A is not None:
            return error_A
    elif not point.current_by_law and not point.current_programmed:
        return loop_error_A(seen.time_s, seen.current_A, point.current_A, starts)
    commands = alignment.timed.get("commanded_current")
    if commands is None:
        return None
    at_s = np.asarray(commands.time_s[:]) - alignment.origin_s
    return law_error_A(seen.time_s, seen.current_A, at_s, commands.records["value"])


def _counts(
    channel: TimedChannel, sensor: SensorContext, alignment: Alignment, motion: MeasuredMotion | None,
) -> SensorCounts:
    missing = saturated = overloaded = faulty = spikes = 0
    standing_runs: list[Standing] = []
    bounds = None if motion is None else (alignment.origin_s + motion.start_s, alignment.origin_s + motion.end_s)
    for rows in parts(len(channel.records)):
        records = channel.records[rows]
        flags, values = records["flags"], records["value"]
        overloaded += _marked(flags, Quality.OVERLOAD)
        faulty += _marked(flags, Quality.SENSOR_FAULT)
        spikes += _marked(flags, Quality.SPIKE)
        missing += max(_marked(flags, Quality.NOT_A_NUMBER), int(np.count_nonzero(~np.isfinite(values))))
        if sensor.range_SI is not None:
            saturated += int(np.count_nonzero(np.abs(values) >= SATURATION_SHARE * sensor.range_SI))
        if bounds is not None:
            time_s = np.asarray(channel.time_s[rows])
            standing_runs.append(standing(values[(time_s >= bounds[0]) & (time_s < bounds[1])]))
    return SensorCounts(
        len(channel.records),
        channel.lost,
        missing,
        max(saturated, overloaded),
        faulty,
        spikes,
        standing=max((part.longest for part in standing_runs), default=0),
        flat=max((part.at_extreme for part in standing_runs), default=0),
        coarse=any(part.coarse for part in standing_runs),
        step=min((part.step for part in standing_runs if part.step > 0.0), default=0.0),
        span=max((part.span for part in standing_runs), default=0.0),
        rate_Hz=sensor.rate_Hz,
        bandwidth_Hz=sensor.bandwidth_Hz,
    )


def _marked(flags: Iterable[Any], flag: Quality) -> int:
    return int(np.count_nonzero(np.asarray(flags) & np.uint16(flag)))

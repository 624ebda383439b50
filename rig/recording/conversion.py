"""From a closed or cut-off journal to a point's finished file, checked against what it was made from."""

from __future__ import annotations

import mmap
import zlib
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

import rig
from rig.errors import FileProblem
from rig.recording.achieved import achieved_motion
from rig.recording.achievement import current_attributes, motion_attributes
from rig.recording.alignment import Alignment, TimedChannel, align
from rig.recording.channel import RING_CHANNELS, Description
from rig.recording.column import Column, Records, Values, mapped
from rig.recording.context import PointContext, SensorContext
from rig.recording.durable import flush_directory
from rig.recording.examination import examine, overview
from rig.recording.finished_point import FinishedPoint
from rig.recording.journal import JournalContent, scan_journal
from rig.recording.layout import (
    AlignedChannel,
    Attribute,
    Event,
    FloatArray,
    PointFile,
    RawChannel,
    parts,
    write_file,
)
from rig.recording.loop_shape import LoopShape
from rig.recording.plausibility import check_records, checked_context
from rig.recording.point_names import FILE, OLD_JOURNAL, free_attempt_file, journal_name
from rig.recording.sorting import Sorter
from rig.recording.velocity import HALF_WIDTH, METHOD, velocity_of
from rig.recording.verdict import Verdict, judge
from rig.recording.wire_values import resampling, wire_attributes

if TYPE_CHECKING:
    import h5py

CHECKED_BYTES = 1 << 22
DESCRIPTIONS = {description.name: description for description in RING_CHANNELS.values()}


class ReadBackDiffers(OSError):
    """The finished file does not hold what was written: the disk or the library failed; the journal is kept."""


def finish_point(journal: Path, *, recovered: bool = False) -> FinishedPoint:
    """Make a journal's `<name>.h5` beside it, prove it, delete the journal.

    A file of that name from an earlier attempt is kept under another name; a journal that had been set aside does not
    take the place of what was recorded since. A journal whose file is already complete (the power failed between the
    two) is only deleted.

    Args:
        journal: the point's journal.
        recovered: True when the campaign did not end by itself; recorded in the file.

    Raises:
        JournalProblem: it cannot be read, or holds what no rig records.
        NothingRecorded: it holds no displacement or no force.
        FileProblem: the file made of it could not be opened as a point again.
        OSError: the disk refused.
        ValueError: something in it fits nothing; so may any other error a library has for values that cannot be.
    """
    name = journal_name(journal)
    with ExitStack() as held:
        sorter = held.enter_context(Sorter(journal.parent))
        data = _mapped(journal, held)
        content = scan_journal(data, str(journal), sorter.take)
        context = checked_context(PointContext.from_json(content.context_json), name)
        check = f"{_check_of(data):08x}-{len(data)}"
        records = sorter.channels()
        check_records(records)
        point, alignment, verdict = build(content, context, records, recovered=recovered, journal_check=check)
        final = journal.with_name(name + FILE)
        if journal.name.endswith(OLD_JOURNAL) and final.exists() and not _made_from(final, check):
            final = free_attempt_file(journal.parent, name)
        if not (final.exists() and _made_from(final, check)):
            _write_proved(final, point)
    journal.unlink()
    flush_directory(journal.parent)
    numbers = {key: float(value) for key, value in point.quality.items() if isinstance(value, (int, float))}
    return FinishedPoint(
        name, str(final.resolve()), verdict.verdict, verdict.reasons, _lost(alignment), alignment.skew_s,
        alignment.skew_std_s, quality=numbers,
    )


def _mapped(journal: Path, held: ExitStack) -> bytes | mmap.mmap:
    """The journal's bytes, mapped; an empty file cannot be."""
    file = held.enter_context(journal.open("rb"))
    if journal.stat().st_size == 0:
        return b""
    return held.enter_context(mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ))


def _check_of(data: bytes | mmap.mmap) -> int:
    check = 0
    for start in range(0, len(data), CHECKED_BYTES):
        check = zlib.crc32(data[start : start + CHECKED_BYTES], check)
    return check


def build(
    content: JournalContent, context: PointContext, records: Mapping[str, Records] | None = None, *,
    recovered: bool = False, journal_check: str = "",
) -> tuple[PointFile, Alignment, Verdict]:
    """Align, judge and lay out one point.

    Args:
        content: the journal.
        context: its header.
        records: its samples by channel; those in `content` when not given.
        recovered: the campaign did not end by itself.
        journal_check: of what the file was made.

    Raises:
        NothingRecorded: the journal holds no displacement or no force.
    """
    alignment = align(content.records if records is None else records, context)
    waveform = str(context.point.get("waveform", "sine"))
    seen = overview(alignment, float(context.point["frequency_Hz"]))
    standing = context.point.get("kind") == "current_step"
    motion = None if standing else achieved_motion(seen.time_s, seen.displacement_m, waveform)
    findings, shape = examine(content, context, alignment, seen, motion)
    verdict = judge(findings)
    light = replace(alignment, time_s=seen.time_s, values={"current": seen.current_A})
    quality: dict[str, Attribute] = {
        "verdict": verdict.verdict, "reasons": verdict.reasons, "blamed": verdict.blamed,
        "lost_samples": _lost(alignment), "skew_s": alignment.skew_s, "skew_std_s": alignment.skew_std_s,
        "skew_checked": alignment.skew_checked, "skew_method": alignment.skew_method,
        "arrival_skew_s": alignment.arrival_skew_s, "recovered": recovered,
        "commanded_amplitude_m": None if motion is None else context.point.get("commanded_amplitude_m"),
        **motion_attributes(motion, light), **current_attributes(motion, light), **_clock_attributes(alignment),
        **_shape_attributes(shape),
    }
    if findings.temperature_degC is not None:
        low, high = findings.temperature_degC
        quality |= {"coil_temperature_low_degC": low, "coil_temperature_high_degC": high}
    provenance: dict[str, Attribute] = {
        "software": f"mr-damper-rig {rig.__version__}", **context.provenance, "journal_check": journal_check,
    }
    file = PointFile(
        time_s=alignment.time_s, sample_rate_hz=context.sensors["displacement"].rate_Hz,
        channels=_aligned_channels(alignment, context), flags=alignment.flags,
        raw=[_raw_channel(channel, alignment.origin_s, context.sensors.get(name))
             for name, channel in alignment.timed.items()],
        events=_events(content, alignment), quality=quality, provenance=provenance,
        test={**context.point, "mid_stroke_m": context.mid_stroke_m, "simulated": context.simulated,
              "moving_mass_kg": context.moving_mass_kg, "controller_input_delay_s": context.controller_delay_s,
              "device_rate": context.device_rate, "controller_clock_at_zero_s": alignment.origin_s,
              **{f"{name}_uncertainty_percent": context.sensors[name].uncertainty_percent
                 for name in ("force", "displacement")}},
        title=f"Test point {context.point.get('id', '')}",
    )
    return file, alignment, verdict


def _lost(alignment: Alignment) -> int:
    return sum(channel.lost for channel in alignment.timed.values())


def _clock_attributes(alignment: Alignment) -> dict[str, Attribute]:
    """How each sensor's clock was found: drift against the controller's, delays, and their standard deviations."""
    found: dict[str, Attribute] = {}
    for name in ("force", "displacement"):
        channel = alignment.timed[name]
        if channel.clock.rate_measured:
            found[f"{name}_clock_drift_ppm"] = 1e6 * (1.0 / channel.clock.rate - 1.0)
            found[f"{name}_clock_drift_std_ppm"] = 1e6 * channel.clock.rate_std
        found[f"{name}_clock_std_s"] = channel.clock.std_s
        found[f"{name}_arrival_latency_s"] = channel.latency_s if alignment.arrival_skew_s is not None else None
        if channel.sensor is None:
            continue
        found[f"{name}_declared_delay_s"] = channel.sensor.declared_s
        found[f"{name}_undeclared_delay_s"] = channel.sensor.undeclared_s
        if channel.clock.method != "edges":
            continue
        found[f"{name}_tie_std_s"] = channel.sensor.tie_std_s
        if channel.sensor.match is not None:
            found[f"{name}_matched_lag_s"] = channel.sensor.match.lag_s
            found[f"{name}_matched_lag_std_s"] = channel.sensor.match.lag_std_s
    return found


def _shape_attributes(shape: LoopShape | None) -> dict[str, Attribute]:
    if shape is None:
        return {}
    return {
        "force_noise_N": shape.noise_N, "force_scatter_N": shape.scatter_N, "force_change_N": shape.change_N,
        "force_span_N": shape.span_N, "free_play_m": shape.free_play_m,
    }


def _aligned_channels(alignment: Alignment, context: PointContext) -> list[AlignedChannel]:
    channels = []
    for name, values in {**alignment.values, "velocity": _velocity(alignment)}.items():
        sensor = context.sensors.get("displacement" if name == "velocity" else name)
        described = _described(name, sensor)
        attributes: dict[str, Attribute] = {"method": METHOD} if name == "velocity" else _calibration(sensor)
        attributes.setdefault("method", resampling(name))
        source = sensor.sensor if sensor is not None else "ecu"
        channels.append(AlignedChannel(
            name, values, described.unit, described.long_name, source, attributes,
        ))
    return channels


def _velocity(alignment: Alignment) -> Values:
    time_s, displacement = alignment.time_s, alignment.values["displacement"]
    if not isinstance(time_s, Column):
        return velocity_of(np.asarray(time_s), np.asarray(displacement))[0]

    def part(start: int, stop: int) -> FloatArray:
        first = max(0, start - HALF_WIDTH)
        last = min(len(time_s), stop + HALF_WIDTH)
        return velocity_of(time_s[first:last], displacement[first:last])[0][start - first : stop - first]

    return Column(len(time_s), np.float64, part)


def _described(name: str, sensor: SensorContext | None) -> Description:
    if name == "velocity":
        return Description(name, "m/s", "Velocity from measured displacement")
    if name == "current":
        return Description(name, "A", "Coil current measured by the ECU")
    known = DESCRIPTIONS.get(name, Description(name, "1", name))
    if sensor is None or name in {"force", "displacement"}:
        return known
    return Description(name, sensor.unit or known.unit, sensor.long_name or known.long_name)


def _calibration(sensor: SensorContext | None) -> dict[str, Attribute]:
    if sensor is None:
        return {}
    kept = {key: value for key, value in asdict(sensor).items() if key not in {"sensor", "unit", "long_name"}}
    return {key: value for key, value in kept.items() if value not in {"", None}}


def _raw_channel(channel: TimedChannel, origin_s: float, sensor: SensorContext | None) -> RawChannel:
    described = DESCRIPTIONS.get(channel.name, Description(channel.name, "1", channel.name))
    attributes: dict[str, Attribute] = {
        "clock_method": channel.clock.method, "clock_std_s": channel.clock.std_s, "lost_samples": channel.lost,
    }
    return RawChannel(
        channel.name, channel.records, described.unit, described.long_name,
        mapped(channel.time_s, lambda time_s: time_s - origin_s, np.float64), attributes,
        wire_attributes(channel.name, sensor),
    )


def _events(content: JournalContent, alignment: Alignment) -> list[Event]:
    if not content.events:
        return []
    host_ns = np.array([event.time_ns for event in content.events], np.int64)
    times_s = alignment.host.time_s(host_ns) - alignment.origin_s
    return [
        Event(round(1e9 * float(time_s)), event.code, event.text)
        for time_s, event in zip(times_s, content.events, strict=True)
    ]


def _write_proved(final: Path, point: PointFile) -> None:
    """Write under a temporary name, read back, compare, only then give it its name."""

    def proved(partial: Path) -> None:
        from rig.recording.run import RecordedPoint

        prove(partial, point)
        RecordedPoint.open(partial)  # what nobody could open must not take its journal's place
        if final.exists():
            keep_attempt(final)

    write_file(final, point, before_naming=proved)


def prove(path: Path, point: PointFile) -> None:
    """Read a file back and compare every value with what was to be written.

    Raises:
        ReadBackDiffers: naming the first dataset that differs.
    """
    import h5py

    with h5py.File(path, "r") as file:
        data, raw = file["entry/data"], file["entry/raw"]
        _same(path, data, "time", point.time_s)
        for channel in point.channels:
            _same(path, data, channel.name, mapped(channel.values, lambda values: values, np.float32))
        if point.flags is not None:
            _same(path, data, "flags", point.flags)
        for received in point.raw:
            _same(path, raw[received.name], "flags", mapped(received.records["flags"], lambda flags: flags, np.int8))
            if received.time_s is not None:
                _same(path, raw[received.name], "time", received.time_s)
            for name in ("value", "sequence", "device_us", "host_ns"):
                _same(path, raw[received.name], name, received.records[name])


def _same(path: Path, group: h5py.Group, name: str, wanted: Values) -> None:
    same = name in group and group[name].shape == wanted.shape
    for rows in parts(len(wanted)) if same else ():
        same = same and np.array_equal(group[name][rows], wanted[rows], equal_nan=wanted.dtype.kind == "f")
    if not same:
        raise ReadBackDiffers(f"{path}: {group.name}/{name} read back differs from what was recorded")


def _made_from(final: Path, journal_check: str) -> bool:
    """Whether a file is whole and was made of the journal with this check; a damaged one was not."""
    from rig.recording.run import RecordedPoint

    try:
        return RecordedPoint.open(final).provenance.get("journal_check") == journal_check
    except FileProblem:
        return False


def keep_attempt(final: Path) -> None:
    """Give an earlier attempt's file another name, which no run lists."""
    final.rename(free_attempt_file(final.parent, final.name.removesuffix(FILE)))

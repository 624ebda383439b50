"""From a closed or cut-off journal to a point's finished file, checked against what it was made from."""

from __future__ import annotations

import json
import mmap
import zlib
from collections.abc import Mapping, Sequence
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
from rig.recording.calibration_check import point_reasons
from rig.recording.channel import RING_CHANNELS, Description
from rig.recording.clock_attributes import clock_attributes, skew_attributes
from rig.recording.column import Column, Records, Values, mapped
from rig.recording.context import PointContext, SensorContext
from rig.recording.durable import flush_directory
from rig.recording.examination import examine, overview
from rig.recording.finished_point import FinishedPoint
from rig.recording.journal import JournalContent, release, scan_journal
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
from rig.recording.reason import Reason
from rig.recording.skew import Skew
from rig.recording.sorting import Sorter
from rig.recording.velocity import MARGIN, METHOD, velocity_of
from rig.recording.verdict import Verdict, judge
from rig.recording.wire_values import wire_attributes

if TYPE_CHECKING:
    import h5py

CHECKED_BYTES = 1 << 22
RESAMPLED = "monotone cubic through the sensor's own samples, never beyond its two neighbours"
METHODS = {
    "velocity": METHOD, "displacement": "the sensor's own samples", "current": "straight line between status frames",
    "coil_temperature": "straight line between status frames",
}
"""How each aligned channel was brought to the displacement's sample times; any other sensor's is `RESAMPLED`."""
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
    check = released = 0
    for start in range(0, len(data), CHECKED_BYTES):
        check = zlib.crc32(data[start : start + CHECKED_BYTES], check)
        released = release(data, released, start)
    return check


def build(
    content: JournalContent, context: PointContext, records: Mapping[str, Records] | None = None, *,
    recovered: bool = False, journal_check: str = "", delays: Skew | None = None,
    instruments: Sequence[Reason] | None = None, rewritten: Mapping[str, Attribute] | None = None,
) -> tuple[PointFile, Alignment, Verdict]:
    """Align, judge and lay out one point: the one way to a point's file, the first time and any later one.

    Args:
        content: the journal.
        context: its header.
        records: its samples by channel; those in `content` when not given.
        recovered: the campaign did not end by itself.
        journal_check: of what the file was made.
        delays: of the sensors, where all points of a campaign together know them; None: by what this point shows.
        instruments: what all points of a campaign together say of the instruments; None: what this point says.
        rewritten: what to say in `/entry/provenance` of a file that is made again.

    Raises:
        NothingRecorded: the journal holds no displacement or no force.
    """
    alignment = align(content.records if records is None else records, context, delays)
    waveform = str(context.point.get("waveform", "sine"))
    seen = overview(alignment, float(context.point["frequency_Hz"]))
    standing = context.point.get("kind") == "current_step"
    motion = None if standing else achieved_motion(seen.time_s, seen.displacement_m, waveform)
    findings, shape = examine(content, context, alignment, seen, motion)
    light = replace(alignment, time_s=seen.time_s, values={"current": seen.current_A})
    quality: dict[str, Attribute] = {
        "lost_samples": _lost(alignment), "loss_counted_by": _loss_counted_by(alignment, context),
        "recovered": recovered, **skew_attributes(alignment),
        "commanded_amplitude_m": None if motion is None else context.point.get("commanded_amplitude_m"),
        **motion_attributes(motion, light), **current_attributes(motion, light), **clock_attributes(alignment),
        **_shape_attributes(shape), **context.calibration,
    }
    if findings.temperature_degC is not None:
        low, high = findings.temperature_degC
        quality |= {"coil_temperature_low_degC": low, "coil_temperature_high_degC": high}
    test: dict[str, Attribute] = {
        **context.point, "mid_stroke_m": context.mid_stroke_m, "simulated": context.simulated,
        "moving_mass_kg": context.moving_mass_kg, "controller_input_delay_s": context.controller_delay_s,
        "device_rate": context.device_rate, "controller_clock_at_zero_s": alignment.origin_s,
        **{f"{name}_uncertainty_percent": context.sensors[name].uncertainty_percent
           for name in ("force", "displacement")},
    }
    doubts = point_reasons(str(context.point.get("id", "")), test, quality) if instruments is None else instruments
    verdict = judge(replace(findings, extra=(*findings.extra, *doubts)))
    provenance: dict[str, Attribute] = {
        "software": f"mr-damper-rig {rig.__version__}", **context.provenance, "journal_check": journal_check,
        "context": context.to_json(), "journal_end": json.dumps(content.end),
        "journal_missing_blocks": content.missing_blocks, "journal_damaged_bytes": content.damaged_bytes,
        **(rewritten or {}),
    }
    file = PointFile(
        time_s=alignment.time_s, sample_rate_hz=context.sensors["displacement"].rate_Hz,
        channels=_aligned_channels(alignment, context), flags=alignment.flags,
        raw=[_raw_channel(channel, alignment.origin_s, context.sensors.get(name))
             for name, channel in alignment.timed.items()],
        events=_events(content, alignment), quality={**verdict.attributes, **quality}, provenance=provenance, test=test,
        title=f"Test point {context.point.get('id', '')}",
    )
    return file, alignment, verdict


def _lost(alignment: Alignment) -> int:
    return sum(channel.lost for channel in alignment.timed.values())


def _loss_counted_by(alignment: Alignment, context: PointContext) -> str:
    """How a lost sample of load cell or LVDT would have been seen: `sequence`, `rate`, or `nothing`.

    A format without a sequence is counted against its rate, which only says something where clocks run at wall speed.
    """
    numbered = all(
        len(alignment.timed[name].records) == 0 or int(alignment.timed[name].records["device_us"][0]) >= 0
        for name in ("force", "displacement")
    )
    return "sequence" if numbered else "rate" if context.device_rate == 1.0 else "nothing"


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
        attributes: dict[str, Attribute] = {"method": METHODS.get(name, RESAMPLED)}
        attributes |= _calibration(None if name == "velocity" else sensor)
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
        first = max(0, start - MARGIN)
        last = min(len(time_s), stop + MARGIN)
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
        "disordered_samples": channel.disordered if channel.sensor is not None else None,
    }
    return RawChannel(
        channel.name, channel.received, described.unit, described.long_name,
        mapped(channel.received_s, lambda time_s: time_s - origin_s, np.float64), attributes,
        wire_attributes(channel.name, sensor),
    )


def _events(content: JournalContent, alignment: Alignment) -> list[Event]:
    if not content.events:
        return []
    host_ns = np.array([event.time_ns for event in content.events], np.int64)
    times_s = alignment.host.time_s(host_ns) - alignment.origin_s
    return [
        Event(round(1e9 * float(time_s)), event.code, event.text, event.time_ns)
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
            for name in ("value", "sequence", "device_us", "host_ns", "flags"):
                _same(path, raw[received.name], name, received.records[name])
            if received.time_s is not None:
                _same(path, raw[received.name], "time", received.time_s)


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

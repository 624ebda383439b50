"""From a closed or truncated journal to a point's finished file: aligned, evaluated, written, read back.

The conversion of wire values to SI and to the common time base is documented in the file, in words and numbers.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

import rig
from drivers.ring import CHANNELS
from rig.errors import FileProblem
from rig.recording.alignment.alignment import INTERPOLATED, Alignment, TimedChannel, align
from rig.recording.atomic_write import FULL, flush_directory
from rig.recording.conversion.endurance_block import reduced
from rig.recording.hdf5.hdf5_image import write_file
from rig.recording.hdf5.hdf5_objects import Checks
from rig.recording.hdf5.read_back import prove
from rig.recording.journal.journal_file import JournalContent
from rig.recording.journal.journal_lock import journal_claimed
from rig.recording.journal.point_journal import opened
from rig.recording.layout import AlignedChannel, Attribute, Event, PointContext, PointFile, RawChannel, SensorContext
from rig.recording.point_files import FILE, OLD_JOURNAL, FinishedPoint, free_attempt_file, journal_name
from rig.recording.quality.point_quality import PointQuality
from rig.recording.quality.quality_checks import evaluated
from rig.recording.quality.verdict import Reason
from rig.recording.recorded_point import RecordedPoint
from rig.recording.ring_records import Records
from rig.signals.arrays import FloatArray
from rig.signals.chunked_column import Column, Values, mapped
from rig.signals.delay_estimation.delay_model import Skew
from rig.signals.derivatives import MARGIN, METHOD, velocity_of
from rig.signals.estimate import Estimate
from rig.test_point import ENDURANCE

UNMEASURED = {
    "operator": "constant: set manually and confirmed by the operator; not measured",
    "set-point": f"set-point as sent, not measured; {INTERPOLATED}",
}
"""How a current that no device measured was made, by who states it (`PointContext.current_told_by`)."""
RAW_NAMES = {"current": "coil_current"}
"""Aligned channel -> the raw one that it is made of, where their names differ."""


@dataclass(frozen=True)
class Correction:
    """What all points of a campaign together know of one of them.

    Attributes:
        delays: of the sensors; None: what the point alone says.
        behind_arrivals: by how much force lags displacement if paired by their earliest arrivals (s), without edges.
        instruments: what is said of the instruments; None: what the point alone says.
        rewritten: what to say of it in `/entry/provenance`.
    """

    delays: Skew | None
    behind_arrivals: Estimate | None
    instruments: Sequence[Reason] | None
    rewritten: Mapping[str, Attribute]


def finish_alone(journal: Path, *, recovered: bool = False) -> FinishedPoint:
    """`conversion.finish_point` by one process at a time; who comes second gets the first one's answer.

    Nothing is raised: whatever this journal does to the conversion is in the answer, so that the next one is looked at.

    Args:
        journal: the point's journal; it must not be recorded to.
        recovered: as for `finish_point`.
    """
    try:
        with journal_claimed(journal) as handle:
            if handle is not None:
                return finish_point(journal, recovered=recovered)
        name = journal_name(journal)
        final = journal.with_name(name + FILE)
        return FinishedPoint.of(name, final, RecordedPoint.open(final).quality)
    except Exception as error:  # noqa: BLE001 - said by name; a journal may hold anything
        text = f"{journal.name}: {type(error).__name__}: {error}; the journal is kept"
        return FinishedPoint(journal_name(journal), error=text, error_slug=_slug(error))


def _slug(error: Exception) -> str:
    if not isinstance(error, OSError):
        return "unreadable"
    return "disk-full" if error.errno in FULL else "disk-error"


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
    with opened(journal, name) as recorded:
        point, quality = build(
            recorded.content, recorded.context, recorded.records, recovered=recovered, journal_check=recorded.check
        )
        final = journal.with_name(name + FILE)
        if journal.name.endswith(OLD_JOURNAL) and final.exists() and not _made_from(final, recorded.check):
            final = free_attempt_file(journal.parent, name)
        if not (final.exists() and _made_from(final, recorded.check)):
            _write_proved(final, point)
    journal.unlink()
    flush_directory(journal.parent)
    return FinishedPoint.of(name, final, quality)


def _made_from(final: Path, journal_check: str) -> bool:
    """Whether a file is whole and was made of the journal with this check; a damaged one was not."""
    try:
        return RecordedPoint.open(final).provenance.get("journal_check") == journal_check
    except FileProblem:
        return False


def keep_attempt(final: Path) -> None:
    """Give an earlier attempt's file another name, which no run lists."""
    final.rename(free_attempt_file(final.parent, final.name.removesuffix(FILE)))


def build(
    content: JournalContent, context: PointContext, records: Mapping[str, Records] | None = None, *,
    recovered: bool = False, journal_check: str = "", correction: Correction | None = None,
) -> tuple[PointFile, PointQuality]:
    """Align, judge and lay out one point: the one way to a point's file, the first time and any later one.

    Args:
        content: the journal.
        context: its header.
        records: its samples by channel; those in `content` when not given.
        recovered: the campaign did not end by itself.
        journal_check: of what the file was made.
        correction: what all points of a campaign together know; None: what this point shows.

    Raises:
        NothingRecorded: the journal holds no displacement or no force.
    """
    delays, behind, instruments = None, None, None
    if correction is not None:
        delays, behind, instruments = correction.delays, correction.behind_arrivals, correction.instruments
    alignment = align(content.records if records is None else records, context, delays, behind)
    test: dict[str, Attribute] = {
        **context.requested, "mid_stroke_m": context.mid_stroke_m, "simulated": context.simulated,
        "moving_mass_kg": context.moving_mass_kg, "controller_input_delay_s": context.controller_delay_s,
        "device_rate": context.device_rate, "controller_clock_at_zero_s": alignment.origin_s,
        **{f"{name}_uncertainty_percent": context.sensors[name].uncertainty_percent
           for name in ("force", "displacement")},
    }
    quality = replace(evaluated(content, context, alignment, test, instruments), recovered=recovered)
    provenance: dict[str, Attribute] = {
        "software": f"mr-damper-rig {rig.__version__}", **context.provenance, "journal_check": journal_check,
        "context": context.to_json(), "journal_end": json.dumps(content.end),
        "journal_missing_blocks": content.missing_blocks, "journal_damaged_bytes": content.damaged_bytes,
        **(correction.rewritten if correction else {}),
    }
    file = PointFile(
        time_s=alignment.time_s, sample_rate_hz=context.sensors["displacement"].rate_Hz,
        channels=_aligned_channels(alignment, context), flags=alignment.flags,
        raw=[_raw_channel(channel, alignment.origin_s, context.sensors.get(name), context.channels.get(name, {}))
             for name, channel in alignment.timed.items()],
        events=_events(content, alignment), quality=quality.attributes, provenance=provenance, test=test,
        title=f"Test point {context.point.id}",
    )
    if context.point.kind == ENDURANCE:
        return reduced(file, quality, alignment, content, context.point)
    return file, quality


def _aligned_channels(alignment: Alignment, context: PointContext) -> list[AlignedChannel]:
    channels = []
    for name, values in {**alignment.values, "velocity": _velocity(alignment)}.items():
        sensor = context.sensors.get("displacement" if name == "velocity" else name)
        origin = context.channels.get(RAW_NAMES.get(name, name), {}) if sensor is None else {}
        unit, long_name = _described(name, sensor, origin)
        attributes: dict[str, Attribute] = {"method": METHOD if name == "velocity" else alignment.methods[name]}
        if name == "current" and context.current_told_by:
            attributes["method"] = UNMEASURED[context.current_told_by]
        attributes |= _calibration(None if name == "velocity" else sensor)
        source = sensor.sensor if sensor is not None else str(origin.get("source", ""))
        channels.append(AlignedChannel(
            name, values, unit, long_name, source, attributes,
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


def _described(name: str, sensor: SensorContext | None, origin: Mapping[str, str]) -> tuple[str, str]:
    """Unit of an aligned channel and one line for people: as the bench file states it, else as of the raw one."""
    if name == "velocity":
        return "m/s", "Velocity from measured displacement"
    unit, long_name = _raw_described(RAW_NAMES.get(name, name), origin)
    if sensor is None or name in {"force", "displacement"}:
        return unit, long_name
    return sensor.unit or unit, sensor.long_name or long_name


def _raw_described(name: str, origin: Mapping[str, str]) -> tuple[str, str]:
    """Unit of a channel of the ring and one line for people: as its driver states it, else as the ring does."""
    known = CHANNELS.get(name)
    unit, long_name = ("1", name) if known is None else (known.unit, known.long_name)
    return unit, str(origin.get("long_name") or long_name)


def _calibration(sensor: SensorContext | None) -> dict[str, Attribute]:
    if sensor is None:
        return {}
    kept = {key: value for key, value in asdict(sensor).items() if key not in {"sensor", "unit", "long_name"}}
    return {key: value for key, value in kept.items() if value not in {"", None}}


def _raw_channel(
    channel: TimedChannel, origin_s: float, sensor: SensorContext | None, origin: Mapping[str, str]
) -> RawChannel:
    unit, long_name = _raw_described(channel.name, origin)
    attributes: dict[str, Attribute] = {
        "clock_method": channel.clock.method, "clock_std_s": channel.clock.std_s, "lost_samples": channel.lost,
        "disordered_samples": channel.disordered if channel.sensor is not None else None,
    }
    return RawChannel(
        channel.name, channel.received, unit, long_name,
        mapped(channel.received_s, lambda time_s: time_s - origin_s, np.float64), attributes,
        {"from_wire": origin.get("from_wire")} if sensor is None else wire_attributes(sensor),
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


def wire_attributes(sensor: SensorContext) -> Mapping[str, Attribute]:
    """How a sensor's `raw/<name>/value` was made of what was on the wire; factor and offset as numbers too."""
    sent = f"number sent by {sensor.sensor}{f', format {sensor.format}' if sensor.format else ''}"
    return {
        "from_wire": f"value = sensitivity * wire - offset; wire = {sent}; wire = (value + offset) / sensitivity",
        "sensitivity": sensor.sensitivity, "offset": sensor.offset,
    }


def _write_proved(final: Path, point: PointFile) -> None:
    """Write under a temporary name, read back, compare, only then give it its name."""

    def proved(partial: Path, checks: Checks) -> None:
        prove(partial, point, checks)
        RecordedPoint.open(partial)  # a file that cannot be opened must not replace its journal
        if final.exists():
            keep_attempt(final)

    write_file(final, point, before_naming=proved)

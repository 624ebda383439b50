"""From a closed or cut-off journal to a point's finished file, checked against what it was made from."""

from __future__ import annotations

import zlib
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

import rig
from protocols.quality import Quality
from rig.recording.achieved import Achieved, achieved_motion
from rig.recording.achievement import current_attributes, motion_attributes
from rig.recording.alignment import Alignment, NothingRecorded, TimedChannel, align
from rig.recording.channel import RING_CHANNELS, Description
from rig.recording.context import PointContext, SensorContext
from rig.recording.durable import flush_directory, replace_durably
from rig.recording.journal import JournalContent, JournalProblem, parse_journal
from rig.recording.layout import (
    AlignedChannel,
    Attribute,
    Event,
    PointFile,
    RawChannel,
    write_partial,
)
from rig.recording.velocity import velocity_of
from rig.recording.verdict import Findings, SensorCounts, Verdict, judge

if TYPE_CHECKING:
    import h5py

SATURATION_SHARE = 0.999
DESCRIPTIONS = {description.name: description for description in RING_CHANNELS.values()}


@dataclass(frozen=True)
class FinishedPoint:
    """What became of a point: its file, or why there is none (`error`; the journal is then kept)."""

    id: str
    file: str = ""
    verdict: str = "invalid"
    reasons: tuple[str, ...] = ()
    lost_samples: int = 0
    skew_s: float | None = None
    skew_std_s: float = 0.0
    error: str = ""


class ReadBackDiffers(OSError):
    """The finished file does not hold what was written: the disk or the library failed; the journal is kept."""


def finish_point(journal: Path, *, recovered: bool = False) -> FinishedPoint:
    """Make `<id>.h5` beside a journal, prove it, delete the journal.

    A file of that name from an earlier attempt is kept under another name. A journal whose file is already complete
    (the power failed between the two) is only deleted.

    Args:
        journal: the point's journal.
        recovered: True when the campaign did not end by itself; recorded in the file.
    """
    name = journal.stem
    try:
        data = journal.read_bytes()
        content = parse_journal(data, str(journal))
        context = PointContext.from_json(content.context_json)
        final = journal.with_suffix(".h5")
        check = f"{zlib.crc32(data):08x}-{len(data)}"
        point, alignment, verdict = build(content, context, recovered=recovered, journal_check=check)
        if not (final.exists() and _made_from(final, check)):
            _write_proved(final, point)
        journal.unlink()
        flush_directory(journal.parent)
    except (JournalProblem, NothingRecorded, OSError, ValueError) as error:
        return FinishedPoint(name, error=f"{type(error).__name__}: {error}")
    return FinishedPoint(
        name, str(final.resolve()), verdict.verdict, verdict.reasons, _lost(alignment), alignment.skew_s,
        alignment.skew_std_s,
    )


def build(
    content: JournalContent, context: PointContext, *, recovered: bool = False, journal_check: str = "",
) -> tuple[PointFile, Alignment, Verdict]:
    """Align, judge and lay out one point.

    Raises:
        NothingRecorded: the journal holds no displacement or no force.
    """
    alignment = align(content.records, context)
    waveform = str(context.point.get("waveform", "sine"))
    motion = achieved_motion(alignment.time_s, alignment.values["displacement"], waveform)
    verdict = judge(_findings(content, context, alignment, motion))
    quality: dict[str, Attribute] = {
        "verdict": verdict.verdict, "reasons": verdict.reasons, "lost_samples": _lost(alignment),
        "skew_s": alignment.skew_s, "skew_std_s": alignment.skew_std_s, "skew_method": alignment.skew_method,
        "recovered": recovered, **motion_attributes(motion, alignment),
        **current_attributes(motion, alignment), **_clock_attributes(alignment),
    }
    provenance: dict[str, Attribute] = {
        "software": f"mr-damper-rig {rig.__version__}", **context.provenance, "journal_check": journal_check,
    }
    file = PointFile(
        time_s=alignment.time_s, sample_rate_hz=context.sensors["displacement"].rate_Hz,
        channels=_aligned_channels(alignment, context), flags=alignment.flags,
        raw=[_raw_channel(channel, alignment.origin_s) for channel in alignment.timed.values()],
        events=_events(content, alignment), quality=quality, provenance=provenance,
        test={**context.point, "mid_stroke_m": context.mid_stroke_m, "simulated": context.simulated,
              "device_rate": context.device_rate, "controller_clock_at_zero_s": alignment.origin_s},
        title=f"Test point {context.point.get('id', '')}",
    )
    return file, alignment, verdict


def _findings(
    content: JournalContent, context: PointContext, alignment: Alignment, motion: Achieved | None,
) -> Findings:
    wanted_A = float(context.point["current_A"])
    end = content.end or {}
    return Findings(
        sensors={name: _counts(alignment.timed[name], sensor) if name in alignment.timed else SensorCounts(0)
                 for name, sensor in context.sensors.items()},
        wanted_cycles=float(context.point["cycles"]), wanted_amplitude_m=float(context.point["amplitude_m"]),
        wanted_frequency_Hz=float(context.point["frequency_Hz"]), current_tolerance_A=context.current_tolerance_A,
        measured_cycles=None if motion is None else motion.cycles,
        measured_amplitude_m=None if motion is None else motion.amplitude_m,
        measured_frequency_Hz=None if motion is None else motion.frequency_Hz,
        current_error_A=_current_error_A(alignment, motion, wanted_A), skew_std_s=alignment.skew_std_s,
        stopped_by=end.get("stopped_by"), interrupted=content.end is None,
        overrun_records=int(end.get("lost_records", 0)), missing_blocks=content.missing_blocks,
        damaged_bytes=content.damaged_bytes, tripped="trip" in alignment.timed,
    )


def _counts(channel: TimedChannel, sensor: SensorContext) -> SensorCounts:
    flags = channel.records["flags"]

    def count(flag: Quality) -> int:
        return int(np.count_nonzero(flags & np.uint16(flag)))

    saturated = count(Quality.OVERLOAD)
    if sensor.range_SI is not None:
        at_end = np.abs(channel.records["value"]) >= SATURATION_SHARE * sensor.range_SI
        saturated = max(saturated, int(np.count_nonzero(at_end)))
    missing = max(count(Quality.NOT_A_NUMBER), int(np.count_nonzero(~np.isfinite(channel.records["value"]))))
    return SensorCounts(
        len(channel.records), channel.lost, missing, saturated, count(Quality.SENSOR_FAULT), count(Quality.SPIKE),
    )


def _current_error_A(alignment: Alignment, motion: Achieved | None, wanted_A: float) -> float | None:
    current = alignment.values["current"]
    if motion is not None:
        current = current[(alignment.time_s >= motion.start_s) & (alignment.time_s < motion.end_s)]
    current = current[np.isfinite(current)]
    return float(np.median(np.abs(current - wanted_A))) if len(current) else None


def _lost(alignment: Alignment) -> int:
    return sum(channel.lost for channel in alignment.timed.values())


def _clock_attributes(alignment: Alignment) -> dict[str, Attribute]:
    found: dict[str, Attribute] = {}
    for name in ("force", "displacement"):
        channel = alignment.timed[name]
        found[f"{name}_clock_drift_ppm"] = 1e6 * (channel.clock.rate - 1.0)
        found[f"{name}_clock_std_s"] = channel.clock.std_s
        found[f"{name}_arrival_latency_s"] = channel.latency_s
    return found


def _aligned_channels(alignment: Alignment, context: PointContext) -> list[AlignedChannel]:
    velocity, method = velocity_of(alignment.time_s, alignment.values["displacement"])
    channels = []
    for name, values in {**alignment.values, "velocity": velocity}.items():
        sensor = context.sensors.get("displacement" if name == "velocity" else name)
        described = _described(name, sensor)
        attributes: dict[str, Attribute] = {"method": method} if name == "velocity" else _calibration(sensor)
        source = sensor.sensor if sensor is not None else "ecu"
        channels.append(AlignedChannel(
            name, values, described.unit, described.long_name, source, attributes,
        ))
    return channels


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
    return {key: value for key, value in kept.items() if value != ""}


def _raw_channel(channel: TimedChannel, origin_s: float) -> RawChannel:
    described = DESCRIPTIONS.get(channel.name, Description(channel.name, "1", channel.name))
    attributes: dict[str, Attribute] = {
        "clock_method": channel.clock.method, "clock_std_s": channel.clock.std_s, "lost_samples": channel.lost,
    }
    return RawChannel(
        channel.name, channel.records, described.unit, described.long_name, channel.time_s - origin_s, attributes,
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
    partial = final.with_name(final.name + ".tmp")
    write_partial(partial, point)
    prove(partial, point)
    if final.exists():
        _keep_attempt(final)
    replace_durably(partial, final)


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
            _same(path, data, channel.name, channel.values.astype(np.float32))
        for received in point.raw:
            for name in ("value", "sequence", "device_us", "host_ns"):
                _same(path, raw[received.name], name, received.records[name])


def _same(path: Path, group: h5py.Group, name: str, wanted: NDArray[Any]) -> None:
    found = group[name][...] if name in group else None
    if found is None or not np.array_equal(found, wanted, equal_nan=wanted.dtype.kind == "f"):
        raise ReadBackDiffers(f"{path}: {group.name}/{name} read back differs from what was recorded")


def _made_from(final: Path, journal_check: str) -> bool:
    from rig.recording.run import RecordedPoint

    return RecordedPoint.open(final).provenance.get("journal_check") == journal_check


def _keep_attempt(final: Path) -> None:
    """Give an earlier attempt's file another name, which no run lists."""
    attempt = 1
    while (kept := final.with_name(f"{final.stem}-attempt{attempt}.h5.old")).exists():
        attempt += 1
    final.rename(kept)


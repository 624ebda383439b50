"""Valid, suspect or invalid, and why: each reason begins with its slug and carries the numbers it was judged by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

LARGEST_LOSS_SHARE = 0.001
LARGEST_NAN_SHARE = 0.001
SATURATED_SAMPLES = 3
TOLERATED_CYCLES = 1
"""A cycle beside a ramp may still settle; the fit drops the first and the last anyway."""
AMPLITUDE_SUSPECT, AMPLITUDE_INVALID = 0.05, 0.10
FREQUENCY_SUSPECT = 0.03
SKEW_SUSPECT_PERIODS = 0.003

Reason = tuple[str, str]
"""`invalid` or `suspect`, and the text."""


@dataclass(frozen=True)
class SensorCounts:
    """What one sensor channel delivered: samples, and how many were lost or flagged."""

    samples: int
    lost: int = 0
    not_a_number: int = 0
    saturated: int = 0
    faulty: int = 0
    spikes: int = 0


@dataclass(frozen=True)
class Findings:
    """What is known about a point when it is judged; None where it could not be measured.

    `wanted_*` come from the matrix, `measured_*` from the kept cycles. `slip` counts of the journal are bytes and
    blocks; `current_error_A` is the median deviation of measured from wanted current over the kept cycles.
    """

    sensors: Mapping[str, SensorCounts]
    wanted_cycles: float
    wanted_amplitude_m: float
    wanted_frequency_Hz: float
    current_tolerance_A: float
    measured_cycles: float | None = None
    measured_amplitude_m: float | None = None
    measured_frequency_Hz: float | None = None
    current_error_A: float | None = None
    skew_std_s: float = 0.0
    stopped_by: str | None = None
    interrupted: bool = False
    overrun_records: int = 0
    missing_blocks: int = 0
    damaged_bytes: int = 0
    tripped: bool = False
    extra: Sequence[Reason] = field(default_factory=tuple)


@dataclass(frozen=True)
class Verdict:
    """`verdict` is `valid`, `suspect` or `invalid`; `reasons` one line each, worst first."""

    verdict: str
    reasons: tuple[str, ...]


def judge(findings: Findings) -> Verdict:
    """Judge a point by everything that was found; one bad finding is enough."""
    reasons = [
        *_ending(findings), *_sensor_reasons(findings), *_motion(findings), *_current(findings), *_skew(findings),
        *findings.extra,
    ]
    invalid = [text for kind, text in reasons if kind == "invalid"]
    suspect = [text for kind, text in reasons if kind == "suspect"]
    verdict = "invalid" if invalid else "suspect" if suspect else "valid"
    return Verdict(verdict, tuple(invalid + suspect))


def _ending(found: Findings) -> list[Reason]:
    reasons = []
    if found.stopped_by is not None:
        reasons.append(("invalid", f"{found.stopped_by}: the point was stopped before its end"))
    elif found.tripped:
        reasons.append(("invalid", "trip: an interlock tripped during the point"))
    if found.interrupted:
        reasons.append(("invalid", "INTERRUPTED: recording was cut off; recovered from the journal"))
    if found.overrun_records:
        reasons.append(("invalid", f"recorder-overrun: {found.overrun_records} records overwritten before being read"))
    if found.missing_blocks or found.damaged_bytes:
        reasons.append((
            "invalid",
            f"journal-damaged: {found.missing_blocks} blocks missing, {found.damaged_bytes} bytes unreadable",
        ))
    return reasons


def _sensor_reasons(found: Findings) -> list[Reason]:
    reasons = []
    for name, counts in found.sensors.items():
        total = counts.samples + counts.lost
        if total == 0:
            reasons.append(("invalid", f"no-samples: {name} delivered nothing"))
            continue
        if counts.lost > LARGEST_LOSS_SHARE * total:
            reasons.append(("invalid", _share("sample-gap", name, counts.lost, total, "lost", LARGEST_LOSS_SHARE)))
        if counts.not_a_number > LARGEST_NAN_SHARE * total:
            share = _share("sensor-nan", name, counts.not_a_number, total, "not a number", LARGEST_NAN_SHARE)
            reasons.append(("invalid", share))
        if counts.saturated >= SATURATED_SAMPLES:
            reasons.append(("invalid", f"sensor-saturated: {counts.saturated} {name} samples at the end of the range"))
        if counts.faulty:
            reasons.append(("invalid", f"sensor-fault: {counts.faulty} {name} samples reported faulty by the sensor"))
        if counts.spikes:
            reasons.append(("suspect", f"sensor-spike: {counts.spikes} {name} samples jump beyond the machine's speed"))
    return reasons


def _share(slug: str, name: str, count: int, total: int, what: str, limit: float) -> str:
    return f"{slug}: {count} of {total} {name} samples {what} ({100 * count / total:.2g} %, limit {100 * limit:g} %)"


def _motion(found: Findings) -> list[Reason]:
    if found.wanted_cycles <= 0:
        return []
    if found.measured_cycles is None or found.measured_cycles < found.wanted_cycles - TOLERATED_CYCLES:
        counted = "none" if found.measured_cycles is None else f"{found.measured_cycles:g}"
        return [("invalid", f"too-few-cycles: {counted} full cycles measured, {found.wanted_cycles:g} wanted")]
    reasons = []
    if found.measured_amplitude_m is not None and found.wanted_amplitude_m > 0:
        error = found.measured_amplitude_m / found.wanted_amplitude_m - 1.0
        text = (
            f"amplitude: {1e3 * found.measured_amplitude_m:.4g} mm measured, {1e3 * found.wanted_amplitude_m:.4g} mm "
            f"wanted ({100 * error:+.1f} %)"
        )
        if abs(error) > AMPLITUDE_INVALID:
            reasons.append(("invalid", text))
        elif abs(error) > AMPLITUDE_SUSPECT:
            reasons.append(("suspect", text))
    if found.measured_frequency_Hz is not None and found.wanted_frequency_Hz > 0:
        error = found.measured_frequency_Hz / found.wanted_frequency_Hz - 1.0
        if abs(error) > FREQUENCY_SUSPECT:
            reasons.append((
                "suspect",
                f"frequency: {found.measured_frequency_Hz:.4g} Hz measured, {found.wanted_frequency_Hz:.4g} Hz wanted",
            ))
    return reasons


def _current(found: Findings) -> list[Reason]:
    if found.current_error_A is None:
        return [("suspect", "no-current: the coil current was not measured during the kept cycles")]
    if found.current_error_A > found.current_tolerance_A:
        return [(
            "invalid",
            f"current-tracking: measured current off by {1e3 * found.current_error_A:.3g} mA "
            f"(limit {1e3 * found.current_tolerance_A:.3g} mA)",
        )]
    return []


def _skew(found: Findings) -> list[Reason]:
    limit_s = SKEW_SUSPECT_PERIODS / found.wanted_frequency_Hz if found.wanted_frequency_Hz > 0 else 0.0
    if limit_s and found.skew_std_s > limit_s:
        return [(
            "suspect",
            f"skew: force and displacement are tied together to {1e3 * found.skew_std_s:.2g} ms only "
            f"({1e3 * limit_s:.2g} ms would do at {found.wanted_frequency_Hz:g} Hz)",
        )]
    return []

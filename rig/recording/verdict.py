"""Valid, suspect or invalid, and why: each reason begins with its slug and carries the numbers it was judged by.

Every slug belongs to the specimen, the bench or the test (`BLAMED`): who has to do something about it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

LARGEST_LOSS_SHARE = 0.001
LARGEST_NAN_SHARE = 0.001
SATURATED_SAMPLES = 3
TOLERATED_CYCLES = 1
"""A cycle beside a ramp may still settle; the fit drops the first and the last anyway."""
AMPLITUDE_SUSPECT, AMPLITUDE_INVALID = 0.05, 0.10
TOLERANCE_ROUNDING = 0.05
"""The campaign judged the same motion before clocks were aligned: the last digit may differ."""
FREQUENCY_SUSPECT = 0.03
SKEW_SUSPECT_PERIODS = 0.003
STUCK_SHARE = 0.1
"""Of a cycle, during which no quantity of a moving rig stands still."""
FLAT_SAMPLES = 5
"""Equal neighbours at the greatest or least value: the amplifier's end, not the signal's."""
TEMPERATURE_SUSPECT_K, TEMPERATURE_INVALID_K = 5.0, 10.0
TEMPERATURE_RESOLUTION_K = 0.2
TEMPERATURE_KNOWN_SHARE = 0.9
"""Of the kept cycles, over which a point with a window must know its temperature."""
SCATTER_SUSPECT, SCATTER_INVALID = 0.02, 0.05
CHANGE_SUSPECT, CHANGE_INVALID = 0.03, 0.08
AMPLITUDE_SCATTER = 0.01

BLAMED: dict[str, str] = {
    "free-play": "bench",
    "force-scatter": "specimen",
    "force-change": "specimen",
    "temperature-drift": "test",
    "temperature-window": "test",
    "too-few-cycles": "test",
    "amplitude": "bench",
    "amplitude-scatter": "bench",
    "frequency": "bench",
    "INTERRUPTED": "test",
    "interrupted": "test",
    "operator": "test",
    "sigint": "test",
    "sigterm": "test",
    "wrong-damper": "specimen",
    "load-train": "bench",
    "host-late": "test",
    "ecu-overtemp": "test",
}
"""Slug of a reason -> who is at fault; every other slug is the bench's."""

Reason = tuple[str, str]
"""`invalid` or `suspect`, and the text."""


@dataclass(frozen=True)
class SensorCounts:
    """What one sensor channel delivered: samples, and how many were lost or flagged.

    `standing` is the longest run of equal samples during the full cycles, `flat` the longest at the extreme values.
    """

    samples: int
    lost: int = 0
    not_a_number: int = 0
    saturated: int = 0
    faulty: int = 0
    spikes: int = 0
    standing: int = 0
    flat: int = 0


@dataclass(frozen=True)
class Findings:
    """What is known about a point when it is judged; None where it could not be measured.

    `wanted_*` come from the matrix, `measured_*` from the kept cycles; `amplitude_tolerance` (relative) is that of a
    command that was compensated, None: the usual limits. Counts of the journal are bytes and
    blocks; `current_error_A` is the deviation of measured from wanted current by `rig.recording.tracking`;
    `temperature_degC` the lowest and highest coil temperature over the kept cycles, known for `temperature_share` of
    them; `scatter_N`, `change_N`, `span_N` and
    `free_play_m` are those of `rig.recording.loop_shape`.
    """

    sensors: Mapping[str, SensorCounts]
    wanted_cycles: float
    wanted_amplitude_m: float
    wanted_frequency_Hz: float
    current_tolerance_A: float
    measured_cycles: float | None = None
    measured_amplitude_m: float | None = None
    measured_frequency_Hz: float | None = None
    amplitude_std_m: float | None = None
    amplitude_tolerance: float | None = None
    current_error_A: float | None = None
    temperature_degC: tuple[float, float] | None = None
    temperature_share: float = 1.0
    temperature_window_degC: tuple[float, float] | None = None
    scatter_N: float | None = None
    change_N: float | None = None
    span_N: float | None = None
    free_play_m: float = 0.0
    samples_a_cycle: float = float("inf")
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

    @property
    def blamed(self) -> tuple[str, ...]:
        """Who is at fault, for each reason: `specimen`, `bench` or `test`."""
        return tuple(blamed(reason) for reason in self.reasons)


def blamed(reason: str) -> str:
    """Whether a reason lies in the `specimen`, the `bench` or the `test`."""
    return BLAMED.get(reason.partition(":")[0], "bench")


def judge(findings: Findings) -> Verdict:
    """Judge a point by everything that was found; one bad finding is enough."""
    reasons = [
        *_ending(findings), *_sensor_reasons(findings), *_motion(findings), *_current(findings),
        *_temperature(findings), *_specimen(findings), *_skew(findings.skew_std_s, findings.wanted_frequency_Hz),
        *findings.extra,
    ]
    invalid = [text for kind, text in reasons if kind == "invalid"]
    suspect = [text for kind, text in reasons if kind == "suspect"]
    verdict = "invalid" if invalid else "suspect" if suspect else "valid"
    return Verdict(verdict, tuple(invalid + suspect))


def with_skew(judged: Verdict, skew_std_s: float, frequency_Hz: float) -> Verdict:
    """A verdict once force and displacement are known to be tied to `skew_std_s` (s); nothing else is judged again.

    Args:
        judged: the verdict by what the point alone knew.
        skew_std_s: what is left uncertain now (s).
        frequency_Hz: the point's wanted frequency; 0 without one.
    """
    others = tuple(reason for reason in judged.reasons if not reason.startswith("skew:"))
    reasons = (*others, *(text for _, text in _skew(skew_std_s, frequency_Hz)))
    if judged.verdict == "invalid":
        return Verdict("invalid", reasons)
    return Verdict("suspect" if reasons else "valid", reasons)


def _ending(found: Findings) -> list[Reason]:
    reasons = []
    if found.stopped_by is not None:
        reasons.append(("invalid", f"{found.stopped_by}: the point was stopped before its end"))
    elif found.tripped:
        reasons.append(("invalid", "trip: an interlock tripped during the point"))
    if found.interrupted:
        reasons.append(("invalid", "INTERRUPTED: recording was cut off; recovered from the journal"))
    if found.overrun_records:
        reasons.append(("invalid", f"slow-consumer: {found.overrun_records} records overwritten before being read"))
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
        reasons += _standing(name, counts, found.samples_a_cycle)
        if counts.faulty:
            reasons.append(("invalid", f"sensor-fault: {counts.faulty} {name} samples reported faulty by the sensor"))
        if counts.spikes:
            reasons.append(("suspect", f"sensor-spike: {counts.spikes} {name} samples jump beyond the machine's speed"))
    return reasons


def _standing(name: str, counts: SensorCounts, samples_a_cycle: float) -> list[Reason]:
    if counts.saturated >= SATURATED_SAMPLES:
        return [("invalid", f"sensor-saturated: {counts.saturated} {name} samples at the end of the range")]
    if counts.standing > max(STUCK_SHARE * samples_a_cycle, FLAT_SAMPLES) and counts.flat < counts.standing:
        return [("invalid", f"sensor-stuck: {counts.standing} {name} samples in a row are equal while the rig moves")]
    if name == "force" and counts.flat >= FLAT_SAMPLES:
        return [(
            "invalid",
            f"sensor-saturated: the {name} stands at its extreme value for {counts.flat} samples: the amplifier's end",
        )]
    return []


def _share(slug: str, name: str, count: int, total: int, what: str, limit: float) -> str:
    return f"{slug}: {count} of {total} {name} samples {what} ({100 * count / total:.2g} %, limit {100 * limit:g} %)"


def _motion(found: Findings) -> list[Reason]:
    if found.wanted_cycles <= 0:
        return []
    if found.measured_cycles is None or found.measured_cycles < found.wanted_cycles - TOLERATED_CYCLES:
        if found.stopped_by is not None:
            # Nobody's fault: the point was stopped, and that is said already.
            return []
        counted = "none" if found.measured_cycles is None else f"{found.measured_cycles:g}"
        return [("invalid", f"too-few-cycles: {counted} full cycles measured, {found.wanted_cycles:g} wanted")]
    reasons = []
    if found.measured_amplitude_m is not None and found.wanted_amplitude_m > 0:
        error = found.measured_amplitude_m / found.wanted_amplitude_m - 1.0
        text = (
            f"amplitude: {1e3 * found.measured_amplitude_m:.4g} mm measured, {1e3 * found.wanted_amplitude_m:.4g} mm "
            f"wanted ({100 * error:+.1f} %)"
        )
        tolerance = found.amplitude_tolerance
        suspect = AMPLITUDE_SUSPECT if tolerance is None else tolerance * (1.0 + TOLERANCE_ROUNDING)
        if abs(error) > max(AMPLITUDE_INVALID, suspect):
            reasons.append(("invalid", text))
        elif abs(error) > suspect:
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


def _temperature(found: Findings) -> list[Reason]:
    reasons: list[Reason] = []
    window, share = found.temperature_window_degC, found.temperature_share
    if window is not None and (found.temperature_degC is None or share < TEMPERATURE_KNOWN_SHARE):
        measured = 0.0 if found.temperature_degC is None else 100.0 * share
        reasons.append((
            "suspect",
            f"no-temperature: the coil temperature was measured over {measured:.2g} % of the kept cycles only, window "
            f"{window[0]:g} to {window[1]:g} degC",
        ))
    if found.temperature_degC is None:
        return reasons
    low, high = found.temperature_degC
    shown = f"coil at {low:.1f} to {high:.1f} degC"
    if high - low > TEMPERATURE_SUSPECT_K:
        kind = "invalid" if high - low > TEMPERATURE_INVALID_K else "suspect"
        reasons.append((
            kind, f"temperature-drift: {shown} during the point (limit {TEMPERATURE_INVALID_K:g} K of change)",
        ))
    if window is not None and (
        low < window[0] - TEMPERATURE_RESOLUTION_K or high > window[1] + TEMPERATURE_RESOLUTION_K
    ):
        reasons.append(("invalid", f"temperature-window: {shown}, window {window[0]:g} to {window[1]:g} degC"))
    return reasons


def _specimen(found: Findings) -> list[Reason]:
    reasons: list[Reason] = []
    if found.free_play_m > 0.0:
        reasons.append((
            "invalid",
            f"free-play: the force rests at zero over about {1e3 * found.free_play_m:.2g} mm after it changes sign: "
            "a fixture or joint slips",
        ))
    if found.span_N is None or found.scatter_N is None or found.change_N is None or not found.span_N > 0.0:
        return reasons
    scatter, change = found.scatter_N / found.span_N, abs(found.change_N) / found.span_N
    if scatter > SCATTER_SUSPECT:
        wobbles = _amplitude_scatter(found) > AMPLITUDE_SCATTER
        slug, what = ("amplitude-scatter", "motion and force differ") if wobbles else ("force-scatter", "force differs")
        kind = "invalid" if scatter > SCATTER_INVALID else "suspect"
        reasons.append((
            kind, f"{slug}: {what} from cycle to cycle by {100 * scatter:.2g} % of its span "
            f"(limit {100 * SCATTER_INVALID:g} %)",
        ))
    if change > CHANGE_SUSPECT:
        kind = "invalid" if change > CHANGE_INVALID else "suspect"
        reasons.append((
            kind, f"force-change: the loop's span changed by {100 * found.change_N / found.span_N:+.2g} % over the "
            f"point (limit {100 * CHANGE_INVALID:g} %)",
        ))
    return reasons


def _amplitude_scatter(found: Findings) -> float:
    if found.amplitude_std_m is None or not found.wanted_amplitude_m > 0.0:
        return 0.0
    return found.amplitude_std_m / found.wanted_amplitude_m


def _skew(skew_std_s: float, frequency_Hz: float) -> list[Reason]:
    limit_s = SKEW_SUSPECT_PERIODS / frequency_Hz if frequency_Hz > 0 else 0.0
    if limit_s and skew_std_s > limit_s:
        return [(
            "suspect",
            f"skew: force and displacement are tied together to {1e3 * skew_std_s:.2g} ms only "
            f"({1e3 * limit_s:.2g} ms would do at {frequency_Hz:g} Hz)",
        )]
    return []

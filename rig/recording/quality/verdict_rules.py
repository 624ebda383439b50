"""Verdict of a point from its own evidence: limits, and a reason for each that is exceeded.

The evidence is measured by `rig.recording.quality.quality_checks`; reasons and verdicts are defined in
`rig.recording.quality.verdict`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from rig.recording.quality.stopped_point import STOPPED_POINT
from rig.recording.quality.verdict import Kind, Reason, Verdict, invalid, suspect
from rig.test_point import AMPLITUDE_INVALID, AMPLITUDE_SUSPECT, LARGEST_SKEW_PERIODS

LARGEST_LOSS_SHARE = 0.001
LARGEST_NAN_SHARE = 0.001
SATURATED_SAMPLES = 3
TOLERATED_CYCLES = 1
"""A cycle beside a ramp may still settle; the fit drops the first and the last anyway."""
TOLERANCE_ROUNDING = 0.05
"""The campaign judged the same motion before clocks were aligned: the last digit may differ."""
FREQUENCY_SUSPECT = 0.03
STUCK_SHARE = 0.1
"""Of a cycle, during which no quantity of a moving rig stands still."""
COARSE_STUCK_SHARE = 0.75
"""... which one of a coarse resolution may well seem to do for half of a cycle, but never for a whole one."""
RESOLUTION_SUSPECT = 0.05
"""Of a channel's span: a step of so much leaves 1.4 % of it uncertain everywhere, and no noise averages it away."""
SAMPLES_A_CYCLE = 25
"""As the plan asks for: harmonics up to the twelfth are below half the sampling rate."""
HARMONICS_NEEDED = 10
"""A first-order filter at ten times the test's frequency takes half a percent off its fundamental."""
FLAT_SAMPLES = 5
"""Equal neighbours at the greatest or least value: the amplifier's end, not the signal's."""
TEMPERATURE_SUSPECT_K, TEMPERATURE_INVALID_K = 5.0, 10.0
TEMPERATURE_RESOLUTION_K = 0.2
TEMPERATURE_KNOWN_SHARE = 0.9
"""Of the kept cycles, over which a point with a window must know its temperature."""
SCATTER_SUSPECT, SCATTER_INVALID = 0.02, 0.05
CHANGE_SUSPECT, CHANGE_INVALID = 0.03, 0.08
CHANGE_CERTAIN = 4.0
"""Standard deviations of its noise that a change of the force must be: a weak loop's span is never the same twice."""
AMPLITUDE_SCATTER = 0.01


@dataclass(frozen=True)
class SensorCounts:
    """What one sensor channel delivered: samples, and how many were lost or flagged.

    `standing` is the longest run of equal samples during the full cycles, `flat` the longest at the extreme values;
    `coarse`: equal neighbours are usual, as the channel comes in steps of `step` (its `span` is peak to peak, SI).
    `rate_Hz` is its sampling rate, `bandwidth_Hz` what its conditioner is declared to pass (None: not stated).
    """

    samples: int
    lost: int = 0
    not_a_number: int = 0
    saturated: int = 0
    faulty: int = 0
    spikes: int = 0
    standing: int = 0
    flat: int = 0
    coarse: bool = False
    step: float = 0.0
    span: float = 0.0
    rate_Hz: float | None = None
    bandwidth_Hz: float | None = None


@dataclass(frozen=True)
class PointEvidence:
    """What is known about a point when it is judged; None where it could not be measured.

    `wanted_*` come from the matrix, `measured_*` from the kept cycles; `amplitude_tolerance` (relative) is that of a
    command that was compensated, None: the usual limits. Counts of the journal are bytes and
    blocks; `current_error_A` is the deviation of measured from wanted current by `rig.signals.current_error`;
    `temperature_degC` the lowest and highest coil temperature over the kept cycles, known for `temperature_share` of
    them; `scatter_N`, `change_N`, `change_std_N`, `span_N` and
    `free_play_m` are those of `rig.signals.loop_shape`.
    """

    sensors: Mapping[str, SensorCounts]
    requested_cycles: float
    requested_amplitude_m: float
    requested_frequency_Hz: float
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
    change_std_N: float = 0.0
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


def evaluate(findings: PointEvidence) -> Verdict:
    """Judge a point by everything that was found; one bad finding is enough."""
    return Verdict.of((
        *_ending(findings), *_sensor_reasons(findings), *_motion(findings), *_current(findings),
        *_temperature(findings), *_specimen(findings), *_skew(findings.skew_std_s, findings.requested_frequency_Hz),
        *findings.extra,
    ))


def with_skew(verdict: Verdict, skew_std_s: float, frequency_Hz: float) -> Verdict:
    """A verdict once force and displacement are known to be tied to `skew_std_s` (s); nothing else is judged again.

    Args:
        verdict: the verdict by what the point alone knew.
        skew_std_s: what is left uncertain now (s).
        frequency_Hz: the point's wanted frequency; 0 without one.
    """
    return verdict.replaced({"skew"}, _skew(skew_std_s, frequency_Hz))


def _ending(evidence: PointEvidence) -> list[Reason]:
    reasons = []
    if evidence.stopped_by is not None:
        reasons.append(invalid(evidence.stopped_by, STOPPED_POINT))
    elif evidence.tripped:
        reasons.append(invalid("trip", "an interlock tripped during the point"))
    if evidence.interrupted:
        reasons.append(invalid("INTERRUPTED", "the recording was interrupted; the data were recovered from the "
            "journal"))
    if evidence.overrun_records:
        reasons.append(invalid(
            "slow-consumer", f"{evidence.overrun_records} records were overwritten before they were read"
        ))
    if evidence.missing_blocks or evidence.damaged_bytes:
        reasons.append(invalid(
            "journal-damaged", f"{evidence.missing_blocks} blocks missing, {evidence.damaged_bytes} bytes unreadable",
        ))
    return reasons


def _sensor_reasons(evidence: PointEvidence) -> list[Reason]:
    reasons = []
    for name, counts in evidence.sensors.items():
        total = counts.samples + counts.lost
        if total == 0:
            reasons.append(invalid("no-samples", f"{name} delivered no data"))
            continue
        if counts.lost > LARGEST_LOSS_SHARE * total:
            reasons.append(_share("sample-gap", name, counts.lost, total, "lost", LARGEST_LOSS_SHARE))
        if counts.not_a_number > LARGEST_NAN_SHARE * total:
            reasons.append(_share("sensor-nan", name, counts.not_a_number, total, "not a number", LARGEST_NAN_SHARE))
        reasons += _standing(name, counts, evidence.samples_a_cycle)
        if counts.faulty:
            reasons.append(invalid("sensor-fault", f"{counts.faulty} {name} samples flagged as faulty by the sensor"))
        if counts.spikes:
            reasons.append(suspect("sensor-spike", f"{counts.spikes} {name} samples jump by more than is "
                "possible on this machine"))
        reasons += _bandwidth(name, counts, evidence.requested_frequency_Hz)
    return reasons


def _standing(name: str, counts: SensorCounts, samples_a_cycle: float) -> list[Reason]:
    if counts.saturated >= SATURATED_SAMPLES:
        return [invalid("sensor-saturated", f"{counts.saturated} {name} samples at the limit of the range")]
    share = COARSE_STUCK_SHARE if counts.coarse else STUCK_SHARE
    if counts.standing > max(share * samples_a_cycle, FLAT_SAMPLES) and counts.flat < counts.standing:
        return [invalid("sensor-stuck", f"{counts.standing} consecutive {name} samples are identical during motion")]
    if name == "force" and counts.flat >= FLAT_SAMPLES:
        return [invalid(
            "sensor-saturated",
            f"the {name} remains at its extreme value for {counts.flat} samples: amplifier saturation",
        )]
    if counts.coarse and counts.step > RESOLUTION_SUSPECT * counts.span > 0.0:
        return [suspect(
            "sensor-resolution",
            f"the {name} has steps of {100 * counts.step / counts.span:.2g} % of its span (limit "
            f"{100 * RESOLUTION_SUSPECT:g} %): a smaller range or a finer resolution is needed",
            step=counts.step, span=counts.span,
        )]
    return []


def _bandwidth(name: str, counts: SensorCounts, frequency_Hz: float) -> list[Reason]:
    """Whether a sensor samples and passes enough of the cycle: its fundamental and the harmonics that shape it."""
    if not (frequency_Hz > 0.0 and name in {"force", "displacement"}):
        return []
    reasons = []
    if counts.rate_Hz is not None and counts.rate_Hz < SAMPLES_A_CYCLE * frequency_Hz:
        a_cycle = counts.rate_Hz / frequency_Hz
        reasons.append(suspect(
            "bandwidth",
            f"{name} at {counts.rate_Hz:g} Hz gives {a_cycle:.3g} samples per cycle at {frequency_Hz:g} Hz, which "
            f"covers harmonics only up to order {0.5 * a_cycle:.3g} ({SAMPLES_A_CYCLE} samples are required)",
            rate_Hz=counts.rate_Hz, frequency_Hz=frequency_Hz,
        ))
    if counts.bandwidth_Hz is not None and counts.bandwidth_Hz < HARMONICS_NEEDED * frequency_Hz:
        reasons.append(suspect(
            "bandwidth",
            f"{name} has a bandwidth of {counts.bandwidth_Hz:g} Hz, only {counts.bandwidth_Hz / frequency_Hz:.3g} "
            f"times the test frequency, {frequency_Hz:g} Hz (required: {HARMONICS_NEEDED} times)",
            bandwidth_Hz=counts.bandwidth_Hz, frequency_Hz=frequency_Hz,
        ))
    return reasons


def _share(slug: str, name: str, count: int, total: int, what: str, limit: float) -> Reason:
    return invalid(
        slug, f"{count} of {total} {name} samples {what} ({_percent(count / total)} %, limit {100 * limit:g} %)",
        count=float(count), total=float(total),
    )


def _percent(share: float) -> str:
    """A share in percent to two digits, all of them where it has three."""
    return f"{100.0 * share:.2g}" if share < 0.995 else f"{100.0 * share:.0f}"


def _motion(evidence: PointEvidence) -> list[Reason]:
    if evidence.requested_cycles <= 0:
        return []
    if evidence.measured_cycles is None or evidence.measured_cycles < evidence.requested_cycles - TOLERATED_CYCLES:
        if evidence.stopped_by is not None:
            # No fault of a device: the point was stopped, which is reported already.
            return []
        counted = f"{evidence.measured_cycles or 0:g} full cycle{'s' * (evidence.measured_cycles != 1)}"
        fewest = max(evidence.requested_cycles - TOLERATED_CYCLES, 1)
        return [invalid("too-few-cycles", f"{counted} measured, expected at least {fewest:g}")]
    reasons = []
    if evidence.measured_amplitude_m is not None and evidence.requested_amplitude_m > 0:
        error = evidence.measured_amplitude_m / evidence.requested_amplitude_m - 1.0
        text = (
            f"{1e3 * evidence.measured_amplitude_m:.4g} mm measured, expected "
            f"{1e3 * evidence.requested_amplitude_m:.4g} "
            f"mm ({100 * error:+.1f} %)"
        )
        tolerance = evidence.amplitude_tolerance
        allowed = AMPLITUDE_SUSPECT if tolerance is None else tolerance * (1.0 + TOLERANCE_ROUNDING)
        if abs(error) > allowed:
            kind = Kind.INVALID if abs(error) > max(AMPLITUDE_INVALID, allowed) else Kind.SUSPECT
            reasons.append(Reason("amplitude", kind, text, {"error": error, "allowed": allowed}))
    if evidence.measured_frequency_Hz is not None and evidence.requested_frequency_Hz > 0:
        error = evidence.measured_frequency_Hz / evidence.requested_frequency_Hz - 1.0
        if abs(error) > FREQUENCY_SUSPECT:
            reasons.append(suspect(
                "frequency",
                f"{evidence.measured_frequency_Hz:.4g} Hz measured, expected {evidence.requested_frequency_Hz:.4g} Hz",
            ))
    return reasons


def _current(evidence: PointEvidence) -> list[Reason]:
    if evidence.current_error_A is None:
        return [suspect("no-current", "the coil current was not measured during the evaluated cycles")]
    if evidence.current_error_A > evidence.current_tolerance_A:
        return [invalid(
            "current-tracking",
            f"the measured current deviates from its target by {1e3 * evidence.current_error_A:.3g} mA "
            f"(limit {1e3 * evidence.current_tolerance_A:.3g} mA)",
        )]
    return []


def _temperature(evidence: PointEvidence) -> list[Reason]:
    reasons: list[Reason] = []
    window, share = evidence.temperature_window_degC, evidence.temperature_share
    if window is not None and (evidence.temperature_degC is None or share < TEMPERATURE_KNOWN_SHARE):
        measured = 0.0 if evidence.temperature_degC is None else 100.0 * share
        reasons.append(suspect(
            "no-temperature",
            f"the coil temperature was measured during only {measured:.2g} % of the evaluated cycles (window: "
            f"{window[0]:g} to {window[1]:g} degC)",
        ))
    if evidence.temperature_degC is None:
        return reasons
    low, high = evidence.temperature_degC
    shown = f"coil at {low:.1f} to {high:.1f} degC"
    if high - low > TEMPERATURE_SUSPECT_K:
        reasons.append(Reason(
            "temperature-drift", _worse(high - low > TEMPERATURE_INVALID_K),
            f"{shown} during the point (change limit {TEMPERATURE_INVALID_K:g} K)",
        ))
    if window is not None and (
        low < window[0] - TEMPERATURE_RESOLUTION_K or high > window[1] + TEMPERATURE_RESOLUTION_K
    ):
        reasons.append(invalid("temperature-window", f"{shown}, window {window[0]:g} to {window[1]:g} degC"))
    return reasons


def _specimen(evidence: PointEvidence) -> list[Reason]:
    reasons: list[Reason] = []
    if evidence.free_play_m > 0.0:
        reasons.append(invalid(
            "free-play",
            f"the force remains at zero over about {1e3 * evidence.free_play_m:.2g} mm after each change of sign: "
            "a fixture or joint is slipping",
        ))
    if evidence.span_N is None or evidence.scatter_N is None or evidence.change_N is None or not evidence.span_N > 0.0:
        return reasons
    scatter, change = evidence.scatter_N / evidence.span_N, abs(evidence.change_N) / evidence.span_N
    if scatter > SCATTER_SUSPECT:
        wobbles = _amplitude_scatter(evidence) > AMPLITUDE_SCATTER
        slug, what = ("amplitude-scatter", "motion and force differ") if wobbles else ("force-scatter", "force differs")
        reasons.append(Reason(
            slug, _worse(scatter > SCATTER_INVALID), f"{what} from cycle to cycle by {100 * scatter:.2g} % of the "
                                                     f"span (limit {100 * SCATTER_INVALID:g} %)",
        ))
    if change > CHANGE_SUSPECT and abs(evidence.change_N) > CHANGE_CERTAIN * evidence.change_std_N:
        reasons.append(Reason(
            "force-change", _worse(change > CHANGE_INVALID),
            f"the force span changed by {100 * evidence.change_N / evidence.span_N:+.2g} % during the point (limit "
            f"{100 * CHANGE_INVALID:g} %)",
        ))
    return reasons


def _worse(invalid_too: bool) -> Kind:
    return Kind.INVALID if invalid_too else Kind.SUSPECT


def _amplitude_scatter(evidence: PointEvidence) -> float:
    if evidence.amplitude_std_m is None or not evidence.requested_amplitude_m > 0.0:
        return 0.0
    return evidence.amplitude_std_m / evidence.requested_amplitude_m


def _skew(skew_std_s: float, frequency_Hz: float) -> list[Reason]:
    limit_s = LARGEST_SKEW_PERIODS / frequency_Hz if frequency_Hz > 0 else 0.0
    if limit_s and skew_std_s > limit_s:
        return [suspect(
            "skew",
            f"the delay between force and displacement is uncertain by {1000.0 * skew_std_s:.3g} ms (allowed at "
            f"{frequency_Hz:g} Hz: {1000.0 * limit_s:.3g} ms)",
            skew_std_s=skew_std_s, limit_s=limit_s,
        )]
    return []

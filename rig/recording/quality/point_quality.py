"""Quality of a recorded point as values: `/entry/quality` of its file, field by field.

Each section is next to the functions that measure it; a new number of a point is one field and one expression.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Self

import numpy as np

from rig.recording.layout import Attribute
from rig.recording.quality.tracking import SignalQuality
from rig.recording.quality.verdict import Attributes, Section, Stored, Verdict, estimate, section, stored
from rig.signals.arrays import FloatArray
from rig.signals.clock_model import EDGES
from rig.signals.cycles import MeasuredMotion, fundamental_phase, wrapped
from rig.signals.delay_estimation.delay_model import at_likely_compliance
from rig.signals.delay_estimation.sample_match import Match
from rig.signals.estimate import Estimate
from rig.signals.loop_shape import LoopShape
from rig.signals.peak_force import PeakForce
from rig.signals.sample_times import SampleTimes

if TYPE_CHECKING:
    from rig.recording.alignment.alignment import Alignment, Overview
    from rig.recording.layout import PointContext
    from rig.recording.quality.verdict_rules import PointEvidence


@dataclass(frozen=True)
class MotionQuality(Section):
    """The motion over the full cycles, as `rig.signals.cycles` measures it, and one value a cycle (k,).

    `phase_deg` is by how much measured displacement follows the controller's set-point (negative: it lags);
    `distortion` the harmonics 2 to 9 beyond the ideal waveform's, relative to the fundamental.
    """

    commanded_amplitude_m: float | None = stored("commanded_amplitude_m")
    cycles: int | None = stored("measured_cycles", Stored.COUNT)
    amplitude_m: float | None = stored("measured_amplitude_m")
    amplitude_std_m: float | None = stored("measured_amplitude_std_m")
    fundamental_amplitude_m: float | None = stored("measured_fundamental_amplitude_m")
    mean_m: float | None = stored("measured_mean_m")
    frequency_Hz: float | None = stored("measured_frequency_Hz")
    start_s: float | None = stored("cycles_start_s")
    end_s: float | None = stored("cycles_end_s")
    distortion: float | None = stored("harmonic_distortion")
    cycle_amplitude_m: tuple[float, ...] | None = stored("cycle_amplitude_m", Stored.PER_CYCLE)
    cycle_mean_m: tuple[float, ...] | None = stored("cycle_mean_m", Stored.PER_CYCLE)
    cycle_frequency_Hz: tuple[float, ...] | None = stored("cycle_frequency_Hz", Stored.PER_CYCLE)
    cycle_distortion: tuple[float, ...] | None = stored("cycle_distortion", Stored.PER_CYCLE)
    cycle_phase_deg: tuple[float, ...] | None = stored("cycle_phase_deg", Stored.PER_CYCLE)
    phase_deg: float | None = stored("phase_deg")


@dataclass(frozen=True)
class CurrentQuality(Section):
    """Measured current over the full cycles: mean and scatter of a sample, A; or who told it instead: `operator`."""

    mean_A: float | None = stored("measured_current_A")
    std_A: float | None = stored("measured_current_std_A")
    told_by: str | None = stored("current_told_by", Stored.TEXT)


@dataclass(frozen=True)
class LoopQuality(Section):
    """The force's loop: noise of a sample, scatter and change from cycle to cycle, span (N), free play (m).

    `rebound_N` and `compression_N` are the peak forces as in `rig.signals.peak_force`, of every kind of motion.
    """

    noise_N: float | None = stored("force_noise_N")
    scatter_N: float | None = stored("force_scatter_N")
    change_N: float | None = stored("force_change_N")
    span_N: float | None = stored("force_span_N")
    free_play_m: float | None = stored("free_play_m")
    rebound_N: float | None = stored("peak_force_rebound_N")
    compression_N: float | None = stored("peak_force_compression_N")

    @property
    def peak_force(self) -> PeakForce | None:
        """The peak forces; None in files of earlier versions, and where they are not known."""
        if self.rebound_N is None or self.compression_N is None:
            return None
        return PeakForce(self.rebound_N, self.compression_N)


def motion_quality(context: PointContext, motion: MeasuredMotion | None, alignment: Alignment) -> MotionQuality:
    """Means over the full cycles, and one value a cycle."""
    if motion is None:
        return MotionQuality(cycles=0)
    cycles = motion.waveform
    setpoint_rad = _setpoint_phase(motion, alignment)
    lags_deg = None
    if setpoint_rad is not None:
        lags_deg = np.degrees([wrapped(phase - setpoint_rad) for phase in cycles.phase_rad.tolist()])
    return MotionQuality(
        commanded_amplitude_m=context.commanded.amplitude_m, cycles=motion.cycles,
        amplitude_m=motion.amplitude_m, amplitude_std_m=motion.amplitude_std_m,
        fundamental_amplitude_m=motion.fundamental_amplitude_m, mean_m=motion.mean_m,
        frequency_Hz=motion.frequency_Hz, start_s=motion.start_s, end_s=motion.end_s,
        distortion=_mean(cycles.distortion), cycle_amplitude_m=_listed(cycles.amplitude_m),
        cycle_mean_m=_listed(cycles.mean_m), cycle_frequency_Hz=_listed(cycles.frequency_Hz),
        cycle_distortion=_listed(cycles.distortion),
        cycle_phase_deg=None if lags_deg is None else _listed(lags_deg),
        phase_deg=None if lags_deg is None else _mean(lags_deg),
    )


def current_quality(motion: MeasuredMotion | None, alignment: Alignment, told_by: str) -> CurrentQuality:
    """The measured current over the full cycles; a current that was only stated is not measured."""
    if told_by:
        return CurrentQuality(told_by=told_by)
    current = np.asarray(alignment.values["current"], np.float64)
    if motion is not None:
        time_s = np.asarray(alignment.time_s, np.float64)
        current = current[(time_s >= motion.start_s) & (time_s < motion.end_s)]
    current = current[np.isfinite(current)]
    if len(current) == 0:
        return CurrentQuality()
    return CurrentQuality(float(np.mean(current)), float(np.std(current)))


def loop_quality(shape: LoopShape | None, peak: PeakForce) -> LoopQuality:
    """The force's loop; only its peak forces where its shape cannot be told."""
    quality = LoopQuality(rebound_N=peak.rebound_N, compression_N=peak.compression_N) if peak.known else LoopQuality()
    if shape is None:
        return quality
    return replace(
        quality, noise_N=shape.noise_N, scatter_N=shape.scatter_N, change_N=shape.change_N, span_N=shape.span_N,
        free_play_m=shape.free_play_m,
    )


def _setpoint_phase(motion: MeasuredMotion, alignment: Alignment) -> float | None:
    """Phase of the set-point's fundamental over the full cycles, on the point's time base, rad."""
    setpoint = alignment.timed.get("setpoint")
    if setpoint is None:
        return None
    time_s = np.asarray(setpoint.time_s, np.float64) - alignment.origin_s
    inside = (time_s >= motion.start_s) & (time_s < motion.end_s)
    return fundamental_phase(
        time_s[inside], setpoint.records["value"][inside].astype(np.float64), motion.frequency_Hz
    )


def _mean(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if len(known) else None


def _listed(values: FloatArray) -> tuple[float, ...]:
    return tuple(np.asarray(values).tolist())


@dataclass(frozen=True)
class SkewQuality(Section):
    """Force against displacement in time.

    Attributes:
        value_s: by how much force lagged displacement beyond the declared delays; taken out.
        std_s: what the signals leave open, whatever was declared; `trusted_std_s` what remains if one trusts
            the bench file; `low_s` to `high_s` the 95 % interval by the signals alone.
        checked: whether the controller's own record shows both delays well enough to confirm or correct them.
        state: `checked`; `declared`: as the bench file states, not checked; `doubted`: contradicted by the signals.
        method: the clock models that were used.
        arrival_s: what pairing by arrival would have given.
    """

    value_s: float | None = stored("skew_s")
    std_s: float | None = stored("skew_std_s")
    trusted_std_s: float | None = stored("skew_trusted_std_s")
    low_s: float | None = stored("skew_low_s")
    high_s: float | None = stored("skew_high_s")
    checked: bool | None = stored("skew_checked", Stored.FLAG)
    state: str | None = stored("skew_state", Stored.TEXT)
    method: str | None = stored("skew_method", Stored.TEXT)
    arrival_s: float | None = stored("arrival_skew_s")


@dataclass(frozen=True)
class TimeQuality(Section):
    """The times of an imported test's samples, as `rig.signals.sample_times` found them.

    Attributes:
        base: `as-read`, `rounded-uniform`, `jitter-uniform` or `irregular`.
        rate_Hz: of a uniform time base.
        resolution_s: printing step of the file's stamps (s).
        scatter_s: standard deviation of the stamps about a uniform rate (s).
        std_s: standard error of a single time that is left (s).
    """

    base: str | None = stored("time_base", Stored.TEXT)
    rate_Hz: float | None = stored("time_rate_Hz")
    resolution_s: float | None = stored("time_resolution_s")
    scatter_s: float | None = stored("time_scatter_s")
    std_s: float | None = stored("time_std_s")


def time_quality(times: SampleTimes) -> TimeQuality:
    """What a file holds of how its times were found."""
    return TimeQuality(
        base=times.base.value, rate_Hz=times.rate_Hz if math.isfinite(times.rate_Hz) else None,
        resolution_s=times.resolution_s, scatter_s=times.scatter_s, std_s=times.std_s,
    )


@dataclass(frozen=True)
class RecordQuality(Section):
    """How much of an imported record a point uses, and what else is in it.

    Attributes:
        record_s: duration of the record (s).
        used_s: of the point's full cycles (s).
        rest_s: time at rest (s).
        other_s: the rest of the time: ramps and other motions (s).
        motion: number of the point's motion in a record of several, of `motions`; `start_s` where its rows begin (s).
        other_motions: the other motions, in words.
    """

    record_s: float | None = stored("imported_record_s")
    used_s: float | None = stored("imported_used_s")
    rest_s: float | None = stored("imported_rest_s")
    other_s: float | None = stored("imported_other_s")
    motion: int | None = stored("imported_motion", Stored.COUNT)
    motions: int | None = stored("imported_motions", Stored.COUNT)
    start_s: float | None = stored("imported_start_s")
    other_motions: str | None = stored("imported_other_motions", Stored.TEXT)


@dataclass(frozen=True)
class Agreement:
    """How a sensor lies over the controller's input at one point; None where the point cannot tell.

    Attributes:
        gain: of the sensor relative to the input, 1 when they agree.
        offset: what the sensor shows where the input shows 0 (SI).
        lag: by how much the sensor is later than the input beyond both declared delays (s).
        declared_s: the sensor's own declared delay (s): it cannot be earlier than that.
    """

    gain: Estimate | None = None
    offset: Estimate | None = None
    lag: Estimate | None = None
    declared_s: float = 0.0


@dataclass(frozen=True)
class SensorQuality(Section):
    """A sensor's clock, its delays, and how it lies over the controller's own input of the same quantity.

    `sensor(t) = gain input(t - lag) + offset + compliance force(t)`, SI, each with its standard deviation.
    `matched_lag_s` is what the signals alone say, together with the compliance (covariance `matched_coupling`, s m/N);
    `reference_lag_s` the same once a load train's usual stiffness is taken into account. Without edges `arrival_lag_s`
    is by how much the quantity lags the sensor's earliest arrivals, which scatter by `arrival_scatter_s`.
    """

    clock_drift_ppm: float | None = stored("{sensor}_clock_drift_ppm")
    clock_drift_std_ppm: float | None = stored("{sensor}_clock_drift_std_ppm")
    clock_std_s: float | None = stored("{sensor}_clock_std_s")
    disordered_samples: int | None = stored("{sensor}_disordered_samples", Stored.COUNT)
    arrival_latency_s: float | None = stored("{sensor}_arrival_latency_s")
    arrival_lag_s: float | None = stored("{sensor}_arrival_lag_s")
    arrival_lag_std_s: float | None = stored("{sensor}_arrival_lag_std_s")
    arrival_scatter_s: float | None = stored("{sensor}_arrival_scatter_s")
    declared_delay_s: float | None = stored("{sensor}_declared_delay_s")
    undeclared_delay_s: float | None = stored("{sensor}_undeclared_delay_s")
    tie_std_s: float | None = stored("{sensor}_tie_std_s")
    compared: bool | None = stored("{sensor}_compared", Stored.FLAG)
    matched_lag_s: float | None = stored("{sensor}_matched_lag_s")
    matched_lag_std_s: float | None = stored("{sensor}_matched_lag_std_s")
    reference_lag_s: float | None = stored("{sensor}_reference_lag_s")
    reference_lag_std_s: float | None = stored("{sensor}_reference_lag_std_s")
    reference_gain: float | None = stored("{sensor}_reference_gain")
    reference_gain_std: float | None = stored("{sensor}_reference_gain_std")
    reference_offset: float | None = stored("{sensor}_reference_offset_{unit}")
    reference_offset_std: float | None = stored("{sensor}_reference_offset_std_{unit}")
    reference_compliance_m_N: float | None = stored("{sensor}_reference_compliance_m_N")
    reference_compliance_std_m_N: float | None = stored("{sensor}_reference_compliance_std_m_N")
    matched_coupling: float | None = stored("{sensor}_matched_coupling")

    @property
    def gain(self) -> Estimate | None:
        """Of the sensor relative to the controller's input."""
        return estimate(self.reference_gain, self.reference_gain_std)

    @property
    def offset(self) -> Estimate | None:
        """What the sensor shows where the controller's input shows 0 (SI)."""
        return estimate(self.reference_offset, self.reference_offset_std)

    @property
    def arrival_lag(self) -> Estimate | None:
        """By how much the quantity lags the sensor's earliest arrivals (s), by its own signal; None with edges."""
        return estimate(self.arrival_lag_s, self.arrival_lag_std_s)

    @property
    def lag(self) -> Estimate | None:
        """By how much the sensor is later than the input beyond both declared delays (s), by the signals alone."""
        return estimate(self.matched_lag_s, self.matched_lag_std_s)

    @property
    def agreement(self) -> Agreement:
        """How it lies over the input; the lag by the signals alone: a load train's usual stiffness proves nothing."""
        return Agreement(self.gain, self.offset, self.lag, self.declared_delay_s or 0.0)


FORCE = section(SensorQuality, sensor="force", unit="N")
DISPLACEMENT = section(SensorQuality, sensor="displacement", unit="m")


def skew_quality(alignment: Alignment) -> SkewQuality:
    """How the clocks were tied, and what is left uncertain."""
    low_s, high_s = alignment.delays.interval_s or (None, None)
    tied = alignment.skew_s is not None
    return SkewQuality(
        value_s=alignment.skew_s, std_s=alignment.skew_std_s, trusted_std_s=alignment.skew_trusted_s,
        low_s=low_s if tied else None, high_s=high_s if tied else None, checked=alignment.skew_checked,
        state=None if alignment.skew_s is None else alignment.delays.state,
        method=alignment.skew_method, arrival_s=alignment.arrival_skew_s,
    )


def sensor_quality(name: str, alignment: Alignment) -> SensorQuality:
    """How a sensor's clock was found, its delays, and how it lies over the controller's input."""
    channel = alignment.timed[name]
    clock, sensor = channel.clock, channel.sensor
    quality = SensorQuality(
        clock_drift_ppm=1e6 * (1.0 / clock.rate - 1.0) if clock.rate_measured else None,
        clock_drift_std_ppm=1e6 * clock.rate_std if clock.rate_measured else None, clock_std_s=clock.std_s,
        disordered_samples=channel.disordered,
        arrival_latency_s=channel.latency_s if alignment.arrival_skew_s is not None else None,
    )
    if sensor is None:
        return quality
    by_edges = clock.method == EDGES
    quality = replace(
        quality, declared_delay_s=sensor.declared_s, undeclared_delay_s=sensor.undeclared_s,
        tie_std_s=sensor.tie_std_s if by_edges else None, compared=sensor.compared if by_edges else None,
        arrival_lag_s=None if sensor.arrival_lag is None else sensor.arrival_lag.value,
        arrival_lag_std_s=None if sensor.arrival_lag is None else sensor.arrival_lag.std,
        arrival_scatter_s=sensor.arrival_scatter_s,
    )
    return quality if sensor.match is None else _with_match(quality, sensor.match, by_edges=by_edges)


def _with_match(quality: SensorQuality, match: Match, *, by_edges: bool) -> SensorQuality:
    if by_edges:
        lag_s, lag_std_s = at_likely_compliance(
            match.lag_s, match.lag_std_s, match.compliance, match.compliance_std, match.coupling
        )
        quality = replace(
            quality, matched_lag_s=match.lag_s, matched_lag_std_s=match.lag_std_s, reference_lag_s=lag_s,
            reference_lag_std_s=lag_std_s,
        )
    if math.isfinite(match.gain_std):
        quality = replace(
            quality, reference_gain=match.gain, reference_gain_std=match.gain_std, reference_offset=match.offset,
            reference_offset_std=match.offset_std,
        )
    if match.compliance is not None:
        quality = replace(
            quality, reference_compliance_m_N=match.compliance, reference_compliance_std_m_N=match.compliance_std,
            matched_coupling=match.coupling,
        )
    return quality


@dataclass(frozen=True)
class Tolerances(Section):
    """By how much two instruments of the bench may differ before one of them is doubted (bench `[checks]`).

    Attributes:
        force_gain, displacement_gain: relative difference of sensitivity.
        force_zero_N, displacement_zero_m: difference at zero.
        force_zero_change_N: how much that may change over a campaign.
        time_s: how much later an input may be than the declared delays say.
        current_zero_A: what the ECU may report while its output stage is off.
        coil_temperature_K: by how much the coil may seem colder than the ECU before anything was warmed.
    """

    force_gain: float = stored("tolerance_force_gain", default=0.02)
    displacement_gain: float = stored("tolerance_displacement_gain", default=0.01)
    force_zero_N: float = stored("tolerance_force_zero_N", default=25.0)
    force_zero_change_N: float = stored("tolerance_force_zero_change_N", default=10.0)
    displacement_zero_m: float = stored("tolerance_displacement_zero_m", default=0.5e-3)
    time_s: float = stored("tolerance_time_s", default=0.5e-3)
    current_zero_A: float = stored("tolerance_current_zero_A", default=0.02)
    coil_temperature_K: float = stored("tolerance_coil_temperature_K", default=10.0)


@dataclass(frozen=True)
class RestQuality(Section):
    """What the instruments showed at rest before the first motion.

    `force_zero_std_N` is the standard error of the load cell's zero; `force_difference_N` its difference to the
    controller's force input; `current_A` what the ECU reported while its output stage was off.
    """

    coil_degC: float | None = stored("rest_coil_degC")
    ecu_degC: float | None = stored("rest_ecu_degC")
    force_N: float | None = stored("rest_force_N")
    force_zero_std_N: float | None = stored("force_zero_std_N")
    force_difference_N: float | None = stored("rest_force_difference_N")
    force_difference_std_N: float | None = stored("rest_force_difference_std_N")
    current_A: float | None = stored("rest_current_A")
    current_std_A: float | None = stored("rest_current_std_A")

    @property
    def current(self) -> Estimate | None:
        """The reported current at rest (A)."""
        return estimate(self.current_A, self.current_std_A)


@dataclass(frozen=True)
class EnduranceQuality(Section):
    """The count of an endurance block's cycles at full amplitude.

    Attributes:
        cycles_run: run, by the displacement and by the controller's own count.
        cycles_recorded: those with statistics.
        unseen_cycles: that can have been run at most after the recording was cut off.
        finished: whether the block's programme ran to its end.
    """

    cycles_run: int | None = stored("cycles_run", Stored.COUNT)
    cycles_recorded: int | None = stored("cycles_recorded", Stored.COUNT)
    unseen_cycles: int | None = stored("cycles_unseen_at_most", Stored.COUNT)
    finished: bool | None = stored("block_finished", Stored.FLAG)


@dataclass(frozen=True)
class PointQuality(Section):
    """All that a point's file holds under `/entry/quality`.

    Attributes:
        verdict: the verdict and its reasons.
        lost_samples: samples that no channel delivered; `loss_counted_by` how a loss would have been seen: `sequence`,
            `rate` or `nothing`.
        recovered: whether the campaign did not end by itself.
        skew, motion, current, force, displacement, loop, rest: what was measured; signal: only of such a motion,
            endurance: only of a block of an endurance test.
        tolerances: what the bench allowed; None where the file does not say.
        time, record: of an imported test: how its times were found, and how much of its record it uses.
        coil_low_degC, coil_high_degC: the coil's temperature over the full cycles.
        judged_again, judged_again_utc: why and when the verdict was changed after the file was made.
    """

    verdict: Verdict = field(default_factory=Verdict)
    lost_samples: int | None = stored("lost_samples", Stored.COUNT)
    loss_counted_by: str | None = stored("loss_counted_by", Stored.TEXT)
    recovered: bool | None = stored("recovered", Stored.FLAG)
    skew: SkewQuality = field(default_factory=SkewQuality, metadata=section(SkewQuality))
    motion: MotionQuality = field(default_factory=MotionQuality, metadata=section(MotionQuality))
    signal: SignalQuality | None = field(default=None, metadata=section(SignalQuality, optional=True))
    endurance: EnduranceQuality | None = field(default=None, metadata=section(EnduranceQuality, optional=True))
    current: CurrentQuality = field(default_factory=CurrentQuality, metadata=section(CurrentQuality))
    force: SensorQuality = field(default_factory=SensorQuality, metadata=FORCE)
    displacement: SensorQuality = field(default_factory=SensorQuality, metadata=DISPLACEMENT)
    loop: LoopQuality = field(default_factory=LoopQuality, metadata=section(LoopQuality))
    tolerances: Tolerances | None = field(default=None, metadata=section(Tolerances, optional=True))
    rest: RestQuality = field(default_factory=RestQuality, metadata=section(RestQuality))
    time: TimeQuality | None = field(default=None, metadata=section(TimeQuality, optional=True))
    record: RecordQuality | None = field(default=None, metadata=section(RecordQuality, optional=True))
    coil_low_degC: float | None = stored("coil_temperature_low_degC")
    coil_high_degC: float | None = stored("coil_temperature_high_degC")
    judged_again: str | None = stored("judged_again", Stored.TEXT)
    judged_again_utc: str | None = stored("judged_again_utc", Stored.TEXT)

    @classmethod
    def read(cls, attributes: Attributes, **names: str) -> Self:
        """The quality as the attributes of `/entry/quality` tell it; of an older file, what it has."""
        return replace(super().read(attributes, **names), verdict=Verdict.stored(attributes))

    def items(self, **names: str) -> Iterator[tuple[str, Attribute]]:
        """Name and value of each attribute, the verdict first; None where there is none."""
        yield from self.verdict.attributes.items()
        yield from super().items(**names)

    def sensor(self, name: str) -> SensorQuality:
        """The section of `force` or `displacement`."""
        return {"force": self.force, "displacement": self.displacement}[name]


def measured_quality(
    context: PointContext, alignment: Alignment, seen: Overview, motion: MeasuredMotion | None,
    evidence: PointEvidence, shape: LoopShape | None, peak: PeakForce,
) -> PointQuality:
    """What is known of a point's quality before it is judged: everything but the verdict and how its end came."""
    low_degC, high_degC = evidence.temperature_degC or (None, None)
    light = replace(alignment, time_s=seen.time_s, values={"current": seen.current_A})
    calibration = PointQuality.read(context.calibration)
    return PointQuality(
        lost_samples=sum(channel.lost for channel in alignment.timed.values()),
        loss_counted_by=alignment.loss_counted_by(context.device_rate),
        skew=skew_quality(alignment), motion=motion_quality(context, motion, alignment),
        current=current_quality(motion, light, context.current_told_by),
        force=sensor_quality("force", alignment), displacement=sensor_quality("displacement", alignment),
        loop=loop_quality(shape, peak),
        tolerances=calibration.tolerances, rest=calibration.rest, coil_low_degC=low_degC, coil_high_degC=high_degC,
    )

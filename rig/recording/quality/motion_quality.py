"""Motion, current and loop of a point over its full cycles: the fields of its file, and how they are measured."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from rig.recording.quality.section import Section, Stored, stored
from rig.signals.arrays import FloatArray
from rig.signals.loop_shape import LoopShape
from rig.signals.motion import MeasuredMotion, fundamental_phase, wrapped

if TYPE_CHECKING:
    from rig.recording.alignment.alignment import Alignment
    from rig.recording.context import PointContext


@dataclass(frozen=True)
class MotionQuality(Section):
    """The motion over the full cycles, as `rig.signals.motion` measures it, and one value a cycle (k,).

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
    """Measured current over the full cycles: mean, and scatter of one sample about it, A."""

    mean_A: float | None = stored("measured_current_A")
    std_A: float | None = stored("measured_current_std_A")


@dataclass(frozen=True)
class LoopQuality(Section):
    """The force's loop: noise of a sample, scatter and change from cycle to cycle, span (N), free play (m)."""

    noise_N: float | None = stored("force_noise_N")
    scatter_N: float | None = stored("force_scatter_N")
    change_N: float | None = stored("force_change_N")
    span_N: float | None = stored("force_span_N")
    free_play_m: float | None = stored("free_play_m")


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
        commanded_amplitude_m=context.point.get("commanded_amplitude_m"), cycles=motion.cycles,
        amplitude_m=motion.amplitude_m, amplitude_std_m=motion.amplitude_std_m,
        fundamental_amplitude_m=motion.fundamental_amplitude_m, mean_m=motion.mean_m,
        frequency_Hz=motion.frequency_Hz, start_s=motion.start_s, end_s=motion.end_s,
        distortion=_mean(cycles.distortion), cycle_amplitude_m=_listed(cycles.amplitude_m),
        cycle_mean_m=_listed(cycles.mean_m), cycle_frequency_Hz=_listed(cycles.frequency_Hz),
        cycle_distortion=_listed(cycles.distortion),
        cycle_phase_deg=None if lags_deg is None else _listed(lags_deg),
        phase_deg=None if lags_deg is None else _mean(lags_deg),
    )


def current_quality(motion: MeasuredMotion | None, alignment: Alignment) -> CurrentQuality:
    """The measured current over the full cycles."""
    current = np.asarray(alignment.values["current"], np.float64)
    if motion is not None:
        time_s = np.asarray(alignment.time_s, np.float64)
        current = current[(time_s >= motion.start_s) & (time_s < motion.end_s)]
    current = current[np.isfinite(current)]
    if len(current) == 0:
        return CurrentQuality()
    return CurrentQuality(float(np.mean(current)), float(np.std(current)))


def loop_quality(shape: LoopShape | None) -> LoopQuality:
    """The force's loop; nothing where its shape cannot be told."""
    if shape is None:
        return LoopQuality()
    return LoopQuality(shape.noise_N, shape.scatter_N, shape.change_N, shape.span_N, shape.free_play_m)


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

"""A recorded point at the times of its force samples: force, coil current or its command, temperature; measurement."""

from __future__ import annotations

import math

import numpy as np

from protocols.quality import DOUBTFUL
from rig.dampers.arrays import BoolArray, FloatArray
from rig.errors import IdentificationFailed
from rig.identification.models.coil import SMALLEST_STEP_A
from rig.identification.models.measurement import Measurement
from rig.identification.remarks import Remark, say
from rig.recording.quality.campaign_delay import PointSkew
from rig.recording.recorded_point import RecordedPoint
from rig.signals.derivatives import Motion
from rig.signals.test_set import is_steady, read_current

FEWEST_SAMPLES = 50
LARGEST_MISSING_SHARE = 0.2
FEW_LAGS = 16  # lags after which current samples are mostly uncorrelated, so no transform of all samples is needed


def measured(
    point: RecordedPoint, skew: PointSkew | None, motion: Motion, mean_m: float, force_N: FloatArray, usable: BoolArray
) -> Measurement:
    """A point's measurement at the times of its motion; what needs its cycles, or their absence, is left as it is.

    Motion is about mid-stroke; the inertia of the fixture between load cell and damper is taken off the force.

    Args:
        point: the point.
        skew: what the campaign as a whole knows of the sensors' delays; None: what the point's file says.
        motion: at n times of the force.
        mean_m: of the motion, mid-stroke where the point does not know its specimen's.
        force_N: at these times, shape (n,).
        usable: whether it was measured, shape (n,).
    """
    warned: list[Remark] = []
    current_A, commanded = current_at(point, motion.time_s, warned)
    reading = read_current(_current_in(point, motion.time_s))
    return Measurement(
        id=point.id,
        file="" if point.path is None else str(point.path),
        u_m=motion.u_m - (mean_m if point.mid_stroke_m is None else point.mid_stroke_m),
        v_m_s=motion.v_m_s,
        a_m_s2=motion.a_m_s2,
        force_N=force_N - float(point.test.get("moving_mass_kg", 0.0)) * motion.a_m_s2,
        current_A=current_A,
        dt_s=float(motion.time_s[-1] - motion.time_s[0]) / (motion.time_s.size - 1),
        waveform=point.waveform,
        amplitude_m=point.amplitude_m,
        frequency_Hz=point.frequency_Hz,
        nominal_current_A=point.current_A,
        motion_requested=point.motion_requested,
        current_requested=point.current_requested,
        usable=None if bool(np.all(usable)) else usable,
        skew_std_s=point.skew_std_s if skew is None else skew.std_s,
        force_zero_std_N=point.quality.rest.force_zero_std_N or 0.0,
        current_std_A=current_std(point, motion.time_s),
        current_scatter_A=math.nan if reading is None else reading.scatter_A,
        current_step_A=0.0 if reading is None else reading.step_A,
        commanded_A=None if commanded is None else commanded[1],
        commanded_before_A=None if commanded is None else commanded[0],
        temperature_degC=temperature_at(point, motion.time_s),
        warnings=tuple(warned),
    )


def force_on_grid(
    point: RecordedPoint, shift_s: float, start_s: float, stop_s: float
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Times (s), force (N) and which are measured, on the force's own samples; lost ones become empty places.

    Raises:
        IdentificationFailed: too few samples, or too many of them missing.
    """
    samples = point.force_samples
    flagged = (samples.flags & int(DOUBTFUL)) != 0
    times_s = samples.time_s + shift_s
    inside = (times_s >= start_s) & (times_s < stop_s) & np.isfinite(times_s)
    time_s, force_N = times_s[inside], samples.force_N[inside]
    good = np.isfinite(force_N) & ~flagged[inside]
    if np.count_nonzero(good) < FEWEST_SAMPLES:
        raise IdentificationFailed(
            f"got {np.count_nonzero(good)} usable force samples in the evaluated cycles, expected {FEWEST_SAMPLES} or "
            "more"
        )
    spacing = float(np.median(np.diff(time_s)))
    places = np.concatenate(([0], np.cumsum(np.maximum(1, np.rint(np.diff(time_s) / spacing).astype(np.int64)))))
    count = int(places[-1]) + 1
    expected = math.floor((stop_s - start_s) / spacing)  # samples missing at either end have no place in the grid
    refuse_too_few(int(good.sum()), max(count, expected), "missing or flagged")
    grid_s = np.interp(np.arange(count), places, time_s)
    force = np.zeros(count)
    usable = np.zeros(count, dtype=bool)
    force[places[good]] = force_N[good]
    usable[places[good]] = True
    return grid_s, force, usable


def current_at(
    point: RecordedPoint, query_s: FloatArray, warnings: list[Remark]
) -> tuple[FloatArray, tuple[FloatArray, FloatArray] | None]:
    """Coil current (A) at the wanted times, and the changing command (before, during) where none was measured.

    A steady current is its mean. Without a measurement it is the commanded one, whose lag the fit then has to find if
    it changes.
    """
    inside_A = _current_in(point, query_s)
    if inside_A.size:
        if is_steady(inside_A):  # the mean is better than the samples
            return np.full(query_s.size, float(np.mean(inside_A))), None
        measured = np.isfinite(point.current_measured_A)
        return np.interp(query_s, point.time_s[measured], point.current_measured_A[measured]), None
    before_A, during_A = _command(point, query_s)
    if during_A.size and float(np.ptp(np.concatenate((before_A, during_A)))) >= SMALLEST_STEP_A:
        warnings.append(say("command-steps"))
        return during_A, (before_A, during_A)
    current_A = float(during_A[0]) if during_A.size else point.current_A
    warnings.append(say("command-steady", current_A=current_A))
    return np.full(query_s.size, current_A), None


def current_std(point: RecordedPoint, query_s: FloatArray) -> float:
    """Standard error (A) of a steady measured current, the mean of its noisy readings; 0 where it is something else.

    Readings between which the recording draws a straight line are no more readings: their autocovariances say so.
    """
    inside_A = _current_in(point, query_s)
    count = inside_A.size
    if count < FEWEST_SAMPLES or float(np.std(inside_A)) == 0.0 or not is_steady(inside_A):
        return 0.0
    centred_A = inside_A - np.mean(inside_A)
    together = _first_covariances(centred_A, FEW_LAGS)
    if together.size == FEW_LAGS:
        spectrum = np.fft.rfft(centred_A, 2 * count)
        covariances = np.fft.irfft(np.abs(spectrum) ** 2)[:count] / count
        ended = np.flatnonzero(covariances <= 0.0)
        together = covariances[: int(ended[0]) if ended.size else count]
    independent = count - 2 * together.size + 1  # the mean is their own: what it takes with it is missing in each
    return math.sqrt(float(2.0 * np.sum(together) - together[0]) / max(1, independent))


def _first_covariances(centred: FloatArray, most: int) -> FloatArray:
    """Autocovariances of a centred signal (n,) up to the first non-positive one, at most `most`."""
    covariances: list[float] = []
    for lag in range(most):
        covariance = float(centred[: centred.size - lag] @ centred[lag:]) / centred.size
        if covariance <= 0.0:
            break
        covariances.append(covariance)
    return np.array(covariances)


def _current_in(point: RecordedPoint, query_s: FloatArray) -> FloatArray:
    """The measured current (A) from the first to the last wanted time, where it was measured, shape (k,)."""
    inside = (point.time_s >= query_s[0]) & (point.time_s <= query_s[-1])
    readings_A: FloatArray = point.current_measured_A[inside & np.isfinite(point.current_measured_A)]
    return readings_A


def temperature_at(point: RecordedPoint, query_s: FloatArray) -> FloatArray | None:
    """Recorded coil temperature (degC) at the wanted times; None where none was recorded."""
    recorded = point.channel("coil_temperature")
    known = np.isfinite(recorded)
    return np.interp(query_s, point.time_s[known], recorded[known]) if np.any(known) else None


def _command(point: RecordedPoint, query_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The recorded command (A), held from sample to sample: before the wanted times at their interval, and at them."""
    commanded_A = point.channel("commanded_current")
    known = np.isfinite(commanded_A)
    if not np.any(known):
        return np.zeros(0), np.zeros(0)
    interval_s = float(query_s[-1] - query_s[0]) / (query_s.size - 1)
    earlier = int(max(0.0, (query_s[0] - point.time_s[known][0]) / interval_s))
    at_s = np.concatenate((query_s[0] - interval_s * np.arange(earlier, 0, -1), query_s))
    held = np.searchsorted(point.time_s[known], at_s + 0.01 * interval_s, side="right") - 1
    values = commanded_A[known][np.maximum(held, 0)]
    return values[:earlier], values[earlier:]


def refuse_too_few(good: int, count: int, what: str) -> None:
    """Refuse a test of which too many force samples say nothing.

    Raises:
        IdentificationFailed: the message says what share they are and what may be.
    """
    if good < (1.0 - LARGEST_MISSING_SHARE) * count:
        raise IdentificationFailed(
            f"{100.0 * (1.0 - good / count):.0f} % of the force samples in the evaluated cycles are {what}, expected "
            f"at most {100 * LARGEST_MISSING_SHARE:.0f} %"
        )

"""The motion that gives a force, by the inverse of the expected damper.

At a constant current the force of a damper is nearly a function of its velocity. The inverse of that function turns a
force into an equivalent speed, whose integral, without slow changes, is an equivalent displacement. The equivalent
displacement of the target is the first command. That of the measured force is compared with it as a measured
displacement would be: the iteration sees a nearly linear machine, although the force is a strongly non-linear function
of the motion, and where both are equal, the forces are equal too. Hysteresis and friction are not in the inverse.
"""

from __future__ import annotations

import hashlib
from dataclasses import replace

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.force_target import ForceTarget, SpeedOfForce
from rig.signals.record import STEP_S, NoRecord, Record, RecordFacts, between_ramps, low_passed, record_of

HALVINGS = 60
"""Of the interval in which the offset lies."""
FILTER_ORDER = 2
REACH_PERIODS = 3.0
"""Periods of the lowest frequency by which a motion is continued at both ends before it is filtered."""


def force_record(
    name: str, force_N: FloatArray, inverse: SpeedOfForce, ramp_s: float, *, lowest_Hz: float,
    highest_Hz: float | None = None, sha256: str = "",
) -> Record:
    """A force as a record: its equivalent motion, with the force as the target.

    A mean of the speed would be a displacement that grows without end. A constant is therefore subtracted from the
    force, with which the mean is zero, and changes of the motion below `lowest_Hz` are removed.

    Args:
        name: of the file.
        force_N: (n,) every `STEP_S`.
        inverse: of the expected damper at the current of the point.
        ramp_s: duration of either ramp (s).
        lowest_Hz: slower changes of the motion are removed (Hz).
        highest_Hz: faster changes of the motion are removed (Hz); None: none.
        sha256: of the file.

    Raises:
        NoRecord: the damper does not give this force, or the motion is too short.
    """
    offset_N = _offset(force_N, inverse)
    target_N = force_N - offset_N
    low_N, high_N = inverse.reach_N
    worst = int(np.argmax(np.maximum(target_N - high_N, low_N - target_N)))
    if not low_N <= target_N[worst] <= high_N:
        most_m_s = float(np.max(np.abs(inverse.speed_m_s)))
        raise NoRecord(
            f"force of {force_N[worst]:.4g} N at {STEP_S * worst:.2f} s; allowed: {low_N + offset_N:.4g} to "
            f"{high_N + offset_N:.4g} N, which the expected damper gives at speeds up to {most_m_s:g} m/s and this "
            "current. Fix: specify a higher current, or a smaller force"
        )
    motion_m = _without_slow(STEP_S * np.cumsum(inverse.speed(target_N)), lowest_Hz)
    record = record_of(name, motion_m, ramp_s, highest_Hz=highest_Hz, sha256=sha256)
    mark = hashlib.sha256(target_N.tobytes()).hexdigest()
    return replace(record, of_force=True, force=ForceTarget(mark, lowest_Hz, highest_Hz, offset_N, target_N, inverse))


def equivalent_motion(target: ForceTarget, run: RecordFacts, evaluated: RecordFacts, force_N: FloatArray) -> FloatArray:
    """The motion (n,) in m with which the expected damper would give a measured force.

    Args:
        target: the force to follow; the mean of its evaluated part replaces that of the measured force.
        run: the motion that was commanded.
        evaluated: the record of the target.
        force_N: (n,) every `STEP_S` from the begin of the run.
    """
    mean_N = float(np.mean(target.force_N[between_ramps(evaluated, len(target.force_N))]))
    centred_N = force_N - float(np.mean(force_N[between_ramps(run, len(force_N))])) + mean_N
    motion_m = _without_slow(STEP_S * np.cumsum(target.inverse.speed(centred_N)), target.lowest_Hz)
    return motion_m if target.highest_Hz is None else low_passed(motion_m, target.highest_Hz)  # as that of the target


def force_error(target_N: FloatArray, force_N: FloatArray) -> float:
    """RMS deviation of a force from its target (n,), relative to the RMS of the target; means removed."""
    size_N = float(np.std(target_N))
    return float(np.std(force_N - target_N)) / size_N if size_N > 0.0 else np.inf


def _offset(force_N: FloatArray, inverse: SpeedOfForce) -> float:
    """What is to be subtracted from a force, so that the mean of the speed is 0 (N)."""
    rest_N = float(np.interp(0.0, inverse.speed_m_s, inverse.force_N))
    low_N, high_N = float(np.min(force_N)) - rest_N, float(np.max(force_N)) - rest_N
    for _ in range(HALVINGS):
        middle_N = 0.5 * (low_N + high_N)
        if float(np.mean(inverse.speed(force_N - middle_N))) > 0.0:
            low_N = middle_N
        else:
            high_N = middle_N
    return 0.5 * (low_N + high_N)


def _without_slow(motion_m: FloatArray, lowest_Hz: float) -> FloatArray:
    """A motion (n,) without its changes below a frequency, without phase."""
    from scipy.signal import butter, sosfiltfilt  # 0.3 s to load, and only force targets need it

    time = np.arange(len(motion_m), dtype=np.float64)
    steady_m = motion_m - np.polyval(np.polyfit(time, motion_m, 1), time)
    sections = butter(FILTER_ORDER, lowest_Hz, btype="high", fs=1.0 / STEP_S, output="sos")
    reach = min(len(motion_m) - 1, round(REACH_PERIODS / (lowest_Hz * STEP_S)))
    return np.asarray(sosfiltfilt(sections, steady_m, padtype="odd", padlen=reach), np.float64)

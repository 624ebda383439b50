"""What a point's file says about what was achieved: motion cycle by cycle, and the current."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from rig.recording.achieved import Achieved, fundamental_phase, wrapped
from rig.recording.alignment import Alignment
from rig.recording.layout import Attribute, FloatArray

if TYPE_CHECKING:
    from collections.abc import Sequence


def motion_attributes(motion: Achieved | None, alignment: Alignment) -> dict[str, Attribute]:
    """Attributes of `/entry/quality` about the motion: means over the full cycles, and lists with one value a cycle.

    `phase_deg` is by how much measured displacement follows the controller's set-point (negative: it lags).
    """
    if motion is None:
        return {"measured_cycles": 0}
    cycles = motion.waveform
    lag_rad = _phase_to_setpoint(motion, alignment)
    attributes: dict[str, Attribute] = {
        "measured_cycles": motion.cycles,
        "measured_amplitude_m": motion.amplitude_m,
        "measured_amplitude_std_m": motion.amplitude_std_m,
        "measured_fundamental_amplitude_m": motion.fundamental_amplitude_m,
        "measured_mean_m": motion.mean_m,
        "measured_frequency_Hz": motion.frequency_Hz,
        "cycles_start_s": motion.start_s,
        "cycles_end_s": motion.end_s,
        "harmonic_distortion": _mean(cycles.distortion),
        "cycle_amplitude_m": _listed(cycles.amplitude_m),
        "cycle_mean_m": _listed(cycles.mean_m),
        "cycle_frequency_Hz": _listed(cycles.frequency_Hz),
        "cycle_distortion": _listed(cycles.distortion),
    }
    if lag_rad is not None:
        lags = [wrapped(phase - lag_rad) for phase in cycles.phase_rad.tolist()]
        attributes["cycle_phase_deg"] = _listed(np.degrees(lags))
        attributes["phase_deg"] = _mean(np.degrees(lags))
    return attributes


def current_attributes(motion: Achieved | None, alignment: Alignment) -> dict[str, Attribute]:
    """Attributes of `/entry/quality` about the measured current over the full cycles: mean, and scatter about it, A."""
    current = np.asarray(alignment.values["current"], np.float64)
    if motion is not None:
        time_s = np.asarray(alignment.time_s, np.float64)
        current = current[(time_s >= motion.start_s) & (time_s < motion.end_s)]
    current = current[np.isfinite(current)]
    if len(current) == 0:
        return {}
    return {"measured_current_A": float(np.mean(current)), "measured_current_std_A": float(np.std(current))}


def _phase_to_setpoint(motion: Achieved, alignment: Alignment) -> float | None:
    """Phase of the set-point's fundamental over the full cycles, on the point's time base, rad."""
    setpoint = alignment.timed.get("setpoint")
    if setpoint is None:
        return None
    time_s = np.asarray(setpoint.time_s, np.float64) - alignment.origin_s
    inside = (time_s >= motion.start_s) & (time_s < motion.end_s)
    return fundamental_phase(
        time_s[inside],
        setpoint.records["value"][inside].astype(np.float64),
        motion.frequency_Hz,
    )


def _mean(values: FloatArray) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.mean(known)) if len(known) else None


def _listed(values: FloatArray | Sequence[float]) -> str:
    """One number a cycle as text, which every reader of HDF5 attributes understands; a dash where it is not known."""
    return " ".join(f"{value:.6g}" if math.isfinite(value) else "-" for value in np.asarray(values).tolist())

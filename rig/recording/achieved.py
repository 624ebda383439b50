"""What the machine achieved, from measured displacement: full cycles, amplitude, mean and frequency."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rig.recording.cycles import NoCycles, find_cycles, full_cycles
from rig.recording.layout import FloatArray


@dataclass(frozen=True)
class Achieved:
    """Measured motion over the full cycles.

    Attributes:
        cycles: number of full cycles.
        start_s: time of their first upward crossing of the mean; `end_s` of their last, s.
        amplitude_m: mean over the cycles of half the peak-to-peak; `amplitude_std_m` its scatter from cycle to cycle.
        mean_m: mean displacement over the cycles.
        frequency_Hz: cycles per second.
    """

    cycles: int
    start_s: float
    end_s: float
    amplitude_m: float
    amplitude_std_m: float
    mean_m: float
    frequency_Hz: float


def achieved_motion(time_s: FloatArray, displacement_m: FloatArray) -> Achieved | None:
    """Measure the motion of one point.

    Args:
        time_s: (n,) s, increasing.
        displacement_m: (n,) m; NaN where nothing was measured.

    Returns:
        None when there is not one full cycle.
    """
    try:
        full = full_cycles(find_cycles(time_s, displacement_m))
    except NoCycles:
        return None
    start_s, end_s = float(full.start_s[0]), float(full.start_s[-1])
    return Achieved(
        cycles=len(full), start_s=start_s, end_s=end_s, amplitude_m=float(np.mean(full.amplitude_m)),
        amplitude_std_m=float(np.std(full.amplitude_m)), mean_m=full.mean_m,
        frequency_Hz=len(full) / (end_s - start_s),
    )

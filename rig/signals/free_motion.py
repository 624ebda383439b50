"""Motion that has no cycles, such as random or ridden motion: its velocity and acceleration without phase.

Twice differentiated, a sensor's noise grows with the fourth power of the frequency in the spectrum of the acceleration,
while the motion itself ends somewhere: between them that spectrum has its deepest valley. What lies above is noise. A
local polynomial (Savitzky and Golay 1964) takes it off whose cut-off is twice that high, so that the motion itself is
passed whole; its window follows from the cut-off by Schafer
(What is a Savitzky-Golay filter?, IEEE Signal Processing Magazine, 2011, equation 13).
"""

from __future__ import annotations

import numpy as np

from rig.signals.arrays import FloatArray
from rig.signals.derivatives import Motion, NotDifferentiable, savitzky_golay

RANDOM = "random"
"""Name of a waveform without cycles."""
DEGREE = 4
LONGEST_SEGMENT = 4096
SEGMENTS = 4
BINS_AN_OCTAVE = 6
MOTION_SHARE = 0.95
"""Of the displacement's power, which is motion for certain: the cut-off lies above it."""
FEWEST_SAMPLES = 256
PASSED = 2.0
"""Cut-off of the polynomial over that of the motion: at half of its cut-off it takes off less than 1 %."""


def mean_rate_Hz(time_s: FloatArray, displacement_m: FloatArray) -> float:
    """How often a second the displacement crosses its mean upwards; 0 where it never does.

    Args:
        time_s: (n,) s, increasing.
        displacement_m: (n,) m; NaN where nothing was measured.
    """
    known = np.isfinite(displacement_m)
    if np.count_nonzero(known) < 2:
        return 0.0
    about_mean = displacement_m[known] - np.mean(displacement_m[known])
    upwards = np.count_nonzero((about_mean[:-1] < 0.0) & (about_mean[1:] >= 0.0))
    return float(upwards / (time_s[known][-1] - time_s[known][0]))


def cutoff_Hz(displacement_m: FloatArray, spacing_s: float) -> float:
    """Frequency (Hz) above which the displacement's second derivative is noise; the highest there is without noise.

    Args:
        displacement_m: (n,) m, uniform samples without gaps.
        spacing_s: their interval (s).
    """
    frequency_Hz, power = _spectrum(displacement_m, spacing_s)
    bins = np.floor(BINS_AN_OCTAVE * np.log2(frequency_Hz / frequency_Hz[0])).astype(np.int64)
    count = np.bincount(bins)
    used = count > 0
    acceleration = np.bincount(bins, frequency_Hz**4 * power)[used] / count[used]
    middle_Hz = np.bincount(bins, frequency_Hz)[used] / count[used]
    motion = np.cumsum(np.bincount(bins, power)[used])
    first = int(np.argmax(motion >= MOTION_SHARE * motion[-1]))
    depth = np.maximum.accumulate(acceleration[first:]) / acceleration[first:]
    return float(middle_Hz[first + int(np.argmax(depth))])


def free_motion(time_s: FloatArray, displacement_m: FloatArray, query_s: FloatArray) -> Motion:
    """Displacement and its derivatives at the wanted times, noise above the motion taken off.

    Args:
        time_s: sample times (s), shape (n,), increasing.
        displacement_m: displacement (m), shape (n,); NaN where nothing was measured, bridged by a straight line.
        query_s: times (s), shape (k,), within the samples'.

    Raises:
        NotDifferentiable: too few samples.
    """
    known = np.isfinite(displacement_m)
    if np.count_nonzero(known) < FEWEST_SAMPLES:
        raise NotDifferentiable(
            f"{np.count_nonzero(known)} displacement samples; motion without cycles requires at least {FEWEST_SAMPLES}"
        )
    spacing_s = float(np.median(np.diff(time_s)))
    even_s = time_s[known][0] + spacing_s * np.arange(1 + round((time_s[known][-1] - time_s[known][0]) / spacing_s))
    even_m = np.interp(even_s, time_s[known], displacement_m[known])
    share = min(1.0, PASSED * 2.0 * spacing_s * cutoff_Hz(even_m, spacing_s))
    half = ((DEGREE + 1) / share + 4.6) / 3.2
    local = savitzky_golay(even_s, even_m, 2.0 * half * spacing_s, DEGREE)
    u, v, a = (np.interp(query_s, even_s, values) for values in (local.u_m, local.v_m_s, local.a_m_s2))
    return Motion(query_s, u, v, a, "savitzky_golay", None)


def _spectrum(values: FloatArray, spacing_s: float) -> tuple[FloatArray, FloatArray]:
    """Frequencies (Hz) but 0, and the mean power there, by overlapping segments under Hann's window (Welch 1967)."""
    size = min(LONGEST_SEGMENT, 1 << int(np.log2(2 * len(values) / (SEGMENTS + 1))))
    window = np.hanning(size + 1)[:-1]
    starts = range(0, len(values) - size + 1, size // 2)
    parts = (values[start : start + size] for start in starts)
    power = np.mean([np.abs(np.fft.rfft(window * (part - np.mean(part)))) ** 2 for part in parts], axis=0)
    return np.asarray(np.fft.rfftfreq(size, spacing_s)[1:]), np.asarray(power[1:])

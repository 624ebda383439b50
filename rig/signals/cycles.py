"""Cycles as they were measured: crossings of the mean, amplitude and frequency, and which of them a fit may use.

Nothing here trusts nominal times: ramps, rests and the rig's own lag are told from the measured displacement.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rig.errors import RigError
from rig.signals.arrays import FloatArray

CROSSING_HYSTERESIS = 0.2  # of the amplitude: noise around the mean makes no crossing
FULL_AMPLITUDE = 0.97  # of the typical greatest amplitude: below it a cycle belongs to a ramp


class NoCycles(RigError):
    """The displacement holds fewer whole cycles than were asked for."""


@dataclass(frozen=True)
class Cycles:
    """Whole measured cycles, end to end.

    Attributes:
        start_s: upward crossings of the mean (s), shape (k + 1,); cycle i lies between i and i + 1.
        amplitude_m: half of the peak-to-peak displacement of each cycle (m), shape (k,).
        mean_m: the level that was crossed (m).
    """

    start_s: FloatArray
    amplitude_m: FloatArray
    mean_m: float

    @property
    def frequency_Hz(self) -> FloatArray:
        """Frequency of each cycle (Hz), shape (k,)."""
        return 1.0 / np.diff(self.start_s)

    def __len__(self) -> int:
        return self.amplitude_m.size

    def between(self, first: int, last: int) -> Cycles:
        """Cycles `first` up to, not including, `last`."""
        return Cycles(self.start_s[first : last + 1], self.amplitude_m[first:last], self.mean_m)


def find_cycles(time_s: FloatArray, displacement_m: FloatArray, *, mean_m: float | None = None) -> Cycles:
    """Every whole cycle of a recording.

    Args:
        time_s: sample times (s), increasing, shape (n,).
        displacement_m: displacement (m), shape (n,); not-a-number samples are skipped.
        mean_m: level to cross (m); by default the mean over the whole full-amplitude cycles.

    Raises:
        NoCycles: the displacement crosses its mean upwards less than twice.
    """
    usable = np.isfinite(displacement_m) & np.isfinite(time_s)
    t, u = np.asarray(time_s)[usable], np.asarray(displacement_m)[usable]
    if t.size < 8:
        raise NoCycles(f"{t.size} usable displacement samples; at least 8 are needed to find a cycle")
    level = float(np.max(u) + np.min(u)) / 2.0 if mean_m is None else mean_m
    cycles = _cycles_about(t, u, level)
    if mean_m is not None:
        return cycles
    full = full_cycles(cycles)
    whole = (t >= full.start_s[0]) & (t < full.start_s[-1])
    return _cycles_about(t, u, float(np.mean(u[whole])))


def full_cycles(cycles: Cycles) -> Cycles:
    """The longest unbroken stretch of cycles at full amplitude: ramps and stray movements left out.

    Raises:
        NoCycles: no two cycles agree on an amplitude, as in a test stopped while it ramped in.
    """
    typical = float(np.median(cycles.amplitude_m[cycles.amplitude_m >= 0.8 * np.max(cycles.amplitude_m)]))
    full = np.abs(cycles.amplitude_m - typical) <= (1.0 - FULL_AMPLITUDE) * typical
    edges = np.diff(np.concatenate(([0], full.astype(np.int8), [0])))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    if starts.size == 0:
        raise NoCycles(f"none of {len(cycles)} cycles is at full amplitude; the motion was still ramping")
    longest = int(np.argmax(stops - starts))
    return cycles.between(int(starts[longest]), int(stops[longest]))


def kept_cycles(cycles: Cycles, *, drop_first: int = 1, drop_last: int = 1) -> Cycles:
    """The full-amplitude cycles a fit uses: the first and the last are dropped, as in the c-FOA paper, section 2.1.

    Raises:
        NoCycles: nothing is left after dropping.
    """
    full = full_cycles(cycles)
    if len(full) <= drop_first + drop_last:
        raise NoCycles(
            f"{len(full)} cycles at full amplitude; more than {drop_first + drop_last} are needed, because the first "
            f"{drop_first} and the last {drop_last} are dropped"
        )
    return full.between(drop_first, len(full) - drop_last)


def _cycles_about(t: FloatArray, u: FloatArray, level: float) -> Cycles:
    crossings, indices = _upward_crossings(t, u - level)
    if crossings.size < 2:
        raise NoCycles(
            f"the displacement crosses its mean ({level * 1e3:.3f} mm) upwards {crossings.size} time(s); at least 2 "
            "crossings, one whole cycle, are needed"
        )
    parts = [u[a:b] for a, b in pairwise(indices)]
    amplitude = np.array([(part.max() - part.min()) / 2.0 for part in parts])
    return Cycles(crossings, amplitude, level)


def _upward_crossings(t: FloatArray, x: FloatArray) -> tuple[FloatArray, NDArray[np.int64]]:
    """Times of upward zero crossings (s) and the index after each; between two, x went well below and well above."""
    band = CROSSING_HYSTERESIS * float(np.max(np.abs(x)))
    side = np.where(x > band, 1, np.where(x < -band, -1, 0))
    marked = np.flatnonzero(side)
    rising = np.flatnonzero(np.diff(side[marked]) > 0)
    times, indices = [], []
    for k in rising:
        low, high = int(marked[k]), int(marked[k + 1])
        slope, offset = np.polyfit(t[low : high + 1] - t[low], x[low : high + 1], 1)
        root = t[low] - offset / slope
        times.append(min(max(float(root), float(t[low])), float(t[high])))
        indices.append(low + int(np.searchsorted(t[low : high + 1], times[-1], side="left")))
    return np.array(times), np.array(indices, dtype=np.int64)

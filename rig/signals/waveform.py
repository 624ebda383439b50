"""The waveforms of a test motion as values: shape, peaks, harmonics, and how the controller is asked for one.

A waveform is a periodic motion of unit amplitude that begins at 0 and goes up. All code that needs more of it
than its name asks the value; a name that is not here is refused (`waveform_named`). A further one is one more entry of
`WAVEFORMS`: the controller plays what it does not know itself as a table (docs/how-to/add-a-waveform.md).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from rig.signals.arrays import FloatArray

Shape = Callable[[FloatArray], tuple[FloatArray, FloatArray, FloatArray]]
"""Phase (n,) in cycles -> position, velocity and acceleration (n,): derivatives by the phase, of unit amplitude."""

CORNER_SHARE = 0.05
"""A corner is rounded by the controller; the waveform is still the wanted one if that takes <= 1/20 of a period."""
SAMPLES_A_CORNER = 4
SAMPLES_TO_IDENTIFY = 50
"""Samples in a cycle without corners: with fewer, not even 25 harmonics are under half the sampling rate, and the
velocity by a parabola through nine samples loses more than 3 %: 1 - 1.97 (2 pi / n)^2."""
GRID = 4096
ROUNDING = 1e-12
TABLE_SAMPLES = 240


class UnknownWaveform(ValueError):
    """No waveform has this name; the message says which there are."""


@dataclass(frozen=True, eq=False)
class Waveform:
    """One waveform.

    Attributes:
        name: in matrix files, options and recordings.
        controller: what the controller plays: its own `sine` or `triangle`, or a `table` of this waveform's samples.
        shape: position, velocity and acceleration over the phase, for unit amplitude.
        corner_share: share of a period in which the controller rounds a corner; None where there is no corner.
    """

    name: str
    controller: Literal["sine", "triangle", "table", "none"]
    shape: Shape
    corner_share: float | None = None

    @cached_property
    def _cycle(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        return self.shape(np.arange(GRID) / GRID)

    @cached_property
    def peak_velocity(self) -> float:
        """Largest speed of unit amplitude and 1 Hz (1/s): 2 pi of a sine (PHYSICS 1), 4 of a triangle (2)."""
        return float(np.max(np.abs(self._cycle[1])))

    @cached_property
    def peak_acceleration(self) -> float:
        """Largest acceleration of unit amplitude and 1 Hz (1/s^2): (2 pi)^2 of a sine.

        Where there are corners, their largest step of speed spread over `corner_share` of a period: 160 of a triangle.
        """
        _, velocity, acceleration = self._cycle
        smooth = float(np.max(np.abs(acceleration)))
        if self.corner_share is None:
            return smooth
        return max(smooth, float(np.max(np.abs(np.diff(velocity, append=velocity[:1])))) / self.corner_share)

    @cached_property
    def fundamental(self) -> float:
        """Amplitude of the fundamental relative to the waveform's: 1 of a sine, 8/pi^2 of a triangle (2)."""
        return float(self._series[1])

    def harmonic(self, order: int) -> float:
        """A harmonic relative to the fundamental; of a triangle's odd ones (-1)^j/k^2, k = 2 j + 1 (2)."""
        return float(self._series[order]) / self.fundamental

    @cached_property
    def _series(self) -> FloatArray:
        """The sine coefficients by order; what rounding alone makes of one is 0."""
        sines = -2.0 / GRID * np.imag(np.fft.rfft(self._cycle[0]))
        return np.where(np.abs(sines) > ROUNDING, sines, 0.0)

    @property
    def samples_needed(self) -> float:
        """Samples in a cycle that identification needs: enough in every corner, or enough harmonics."""
        return SAMPLES_TO_IDENTIFY if self.corner_share is None else SAMPLES_A_CORNER / self.corner_share

    def motion(
        self, phase: FloatArray, amplitude_m: float, frequency_Hz: float
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Position (m), velocity (m/s) and acceleration (m/s^2) about the centre, each (n,).

        Args:
            phase: (n,) cycles.
            amplitude_m: amplitude (m).
            frequency_Hz: frequency (Hz).
        """
        position, velocity, acceleration = self.shape(phase)
        speed_m_s = amplitude_m * frequency_Hz
        return amplitude_m * position, speed_m_s * velocity, speed_m_s * frequency_Hz * acceleration

    def table_m(self, amplitude_m: float) -> list[float]:
        """One cycle as the controller plays it from a table (m about the centre)."""
        position, _, _ = self.shape(np.arange(TABLE_SAMPLES) / TABLE_SAMPLES)
        return [float(value) for value in amplitude_m * position]


def _sine(phase: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    sine = np.sin(math.tau * phase)
    return sine, math.tau * np.cos(math.tau * phase), -(math.tau**2) * sine


def _triangle(phase: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Between corners the speed is constant; they are the controller's."""
    ahead = (phase + 0.25) % 1.0
    rising = ahead < 0.5
    position = np.where(rising, 4.0 * ahead - 1.0, 3.0 - 4.0 * ahead)
    return position, np.where(rising, 4.0, -4.0), np.zeros_like(phase)


def _hold(phase: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    return np.zeros_like(phase), np.zeros_like(phase), np.zeros_like(phase)


SINE = Waveform("sine", "sine", _sine)
TRIANGLE = Waveform("triangle", "triangle", _triangle, corner_share=CORNER_SHARE)
HOLD = Waveform("hold", "none", _hold)
"""The rod stands: of points whose current steps."""

WAVEFORMS = {waveform.name: waveform for waveform in (SINE, TRIANGLE)}
"""Those a matrix file may ask for, by name."""
WAVEFORM_NAMES = tuple(WAVEFORMS)
SIGNAL_NAMES = ("sweep", "road", "file")
"""Motions without cycles that a matrix may ask for: each a record (`rig.signals.record`), no waveform."""
SINE_ON_SINE = "sine on sine"
"""A sum of sines, which is commanded as a record: only of a block of an endurance test."""
RECORD_NAMES = (*SIGNAL_NAMES, SINE_ON_SINE)
"""Every motion that is a record."""


def waveform_named(name: str) -> Waveform:
    """The waveform of this name; of a motion that is a record `HOLD`: it has no shape of its own.

    Raises:
        UnknownWaveform: there is none.
    """
    if not is_waveform(name):
        known = ", ".join((*WAVEFORM_NAMES, *RECORD_NAMES))
        raise UnknownWaveform(f"unknown waveform {name!r:.40}; known: {known}")
    return WAVEFORMS.get(name, HOLD)


def is_waveform(name: object) -> bool:
    """Whether a waveform, or a motion that is a record, has this name."""
    return isinstance(name, str) and (name in WAVEFORMS or name == HOLD.name or name in RECORD_NAMES)

"""Amplitude and frequency of cyclic motions, from any two of amplitude (or stroke), frequency and peak speed.

A damper test is specified as a stroke and peak speeds, a vibration test as amplitudes and frequencies. The peak speed
of a waveform is its `peak_velocity` times frequency times amplitude: 2 pi f A of a sine, 4 f A of a triangle
(PHYSICS 1, 2). In `[matrix]` each of the three is a list; in `[[point]]` and `[temperature.warm_up]` it is one value.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Annotated

from protocols.descriptions import Problem
from rig.files.quantity import Quantity
from rig.signals.waveform import waveform_named
from rig.units import parse, show

LARGEST_AMPLITUDE = "1 m"
LOWEST_FREQUENCY, HIGHEST_FREQUENCY = "0.001 Hz", "100 Hz"
Amplitude = Annotated[float, Quantity("length", "0 mm", LARGEST_AMPLITUDE, above=True)]
Stroke = Annotated[float, Quantity("length", "0 mm", "2 m", above=True)]
Frequency = Annotated[float, Quantity("frequency", LOWEST_FREQUENCY, HIGHEST_FREQUENCY)]
PeakSpeed = Annotated[float, Quantity("speed", "0.001 mm/s", "50 m/s")]
STROKE = "peak-to-peak displacement of the motion (twice the amplitude); replaces amplitude"
SPEED = (
    "peak speed of the motion (sine: 2 pi x frequency x amplitude; triangle: 4 x frequency x amplitude); replaces "
    "frequency, or amplitude if frequency is specified"
)
OTHER_NAMES: Mapping[str, str] = {
    "velocity": "speed", "velocities": "speed", "peak_velocity": "speed", "peak_speed": "speed", "speeds": "speed",
    "displacement": "amplitude or stroke", "peak_to_peak": "stroke", "freq": "frequency",
}
"""Names that test engineers use for these entries, and the entry."""


@dataclass(frozen=True)
class MotionSize:
    """What a table states: values in SI as written; an empty tuple for an entry that is not used."""

    amplitude_m: tuple[float, ...] = ()
    stroke_m: tuple[float, ...] = ()
    frequency_Hz: tuple[float, ...] = ()
    speed_m_s: tuple[float, ...] = ()

    @classmethod
    def single(
        cls, amplitude_m: float | None, stroke_m: float | None, frequency_Hz: float | None, speed_m_s: float | None
    ) -> MotionSize:
        """Of a table that describes one motion; None for an entry that is not used."""
        values = (amplitude_m, stroke_m, frequency_Hz, speed_m_s)
        return cls(*(() if value is None else (value,) for value in values))

    @property
    def used(self) -> tuple[str, ...]:
        """Keys of the entries that are used."""
        given = {
            "amplitude": self.amplitude_m, "stroke": self.stroke_m, "frequency": self.frequency_Hz,
            "speed": self.speed_m_s,
        }
        return tuple(key for key, values in given.items() if values)

    @property
    def axes(self) -> dict[str, int]:
        """Number of values of the two lists whose product is the motions of a waveform: {"amplitudes": 2, ...}."""
        sizes = {"strokes" if self.stroke_m else "amplitudes": len(self._amplitudes_m)}
        rates = {"frequencies": len(self.frequency_Hz), "speeds": len(self.speed_m_s)}
        used = {name: count for name, count in (sizes | rates).items() if count}
        return used if len(used) == 2 else sizes | {"frequencies": len(self.frequency_Hz)}

    @property
    def _amplitudes_m(self) -> tuple[float, ...]:
        return self.amplitude_m or tuple(0.5 * stroke_m for stroke_m in self.stroke_m)

    def motions(self, waveform: str) -> list[tuple[float, float]]:
        """Amplitude (m) and frequency (Hz) of each motion of a waveform.

        The amplitude varies slowest; where it follows from frequency and speed, the frequency does.
        """
        return [(amplitude_m, frequency_Hz) for _, amplitude_m, frequency_Hz in self._resolved(waveform)]

    def _resolved(self, waveform: str) -> Iterator[tuple[int, float, float]]:
        """Each motion, with the place of its speed in the list (0 without one)."""
        per_m_Hz = waveform_named(waveform).peak_velocity
        speeds = tuple(enumerate(self.speed_m_s))
        if self._amplitudes_m and self.frequency_Hz:
            yield from ((0, *motion) for motion in product(self._amplitudes_m, self.frequency_Hz))
        elif self._amplitudes_m:
            for amplitude_m, (place, speed_m_s) in product(self._amplitudes_m, speeds):
                yield place, amplitude_m, speed_m_s / (per_m_Hz * amplitude_m)
        else:
            for frequency_Hz, (place, speed_m_s) in product(self.frequency_Hz, speeds):
                yield place, speed_m_s / (per_m_Hz * frequency_Hz), frequency_Hz

    def problems(self, waveforms: Sequence[str], *, listed: bool) -> Iterator[Problem]:
        """Entries that contradict each other, and motions that no rig makes.

        Args:
            waveforms: cyclic waveforms that use the entries.
            listed: each entry is a list.
        """
        if self.amplitude_m and self.stroke_m:
            yield ("stroke",), "amplitude is also specified (stroke = 2 x amplitude). Fix: remove one of them"
        elif self._amplitudes_m and self.frequency_Hz and self.speed_m_s:
            size = "amplitude" if self.amplitude_m else "stroke"
            yield ("speed",), (
                f"{size} and frequency are also specified, and they already define the speed (sine: 2 pi x frequency x "
                f"amplitude). Fix: remove {size}, frequency or speed"
            )
        elif len(self.used) == 2:
            yield from (problem for name in waveforms for problem in self._beyond(name, listed=listed))

    @property
    def by_speed(self) -> bool:
        """Whether speeds are stated at constant amplitude, so that frequencies follow."""
        return bool(self.speed_m_s and self._amplitudes_m)

    @property
    def missing(self) -> tuple[str, ...]:
        """What is still needed, in words; empty where it is enough, or too much."""
        if self.speed_m_s and not self.frequency_Hz and not self._amplitudes_m:
            return ("amplitude, stroke or frequency",)
        size = () if self._amplitudes_m or (self.frequency_Hz and self.speed_m_s) else ("amplitude (or stroke)",)
        rate = () if self.frequency_Hz or self.speed_m_s else ("frequency (or speed)",)
        return (*size, *rate)

    def _beyond(self, waveform: str, *, listed: bool) -> Iterator[Problem]:
        """Speeds that need an amplitude or a frequency outside the allowed range; the first motion of each."""
        if not self.speed_m_s:
            return
        largest_m = parse(LARGEST_AMPLITUDE, "length")
        lowest_Hz, highest_Hz = parse(LOWEST_FREQUENCY, "frequency"), parse(HIGHEST_FREQUENCY, "frequency")
        seen = set[int]()
        for place, amplitude_m, frequency_Hz in self._resolved(waveform):
            text = ""
            if self._amplitudes_m and not lowest_Hz <= frequency_Hz <= highest_Hz:
                text = (
                    f"a {waveform} with amplitude {show(amplitude_m, 'mm')} would require {frequency_Hz:.4g} Hz for "
                    f"this speed (allowed: {LOWEST_FREQUENCY} to {HIGHEST_FREQUENCY}). Fix: change the speed or the "
                    "amplitude"
                )
            elif amplitude_m > largest_m:
                text = (
                    f"a {waveform} of {frequency_Hz:.4g} Hz would require an amplitude of {show(amplitude_m, 'mm')} "
                    f"for this speed (allowed: up to {LARGEST_AMPLITUDE}). Fix: change the speed or the frequency"
                )
            if text and place not in seen:
                seen.add(place)
                yield (("speed", place) if listed else ("speed",)), text

"""What a plan warns of: points that can be run, but whose recording could be too coarse to identify a damper from."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from rig.bench.model import Bench
from rig.bench.sensor_settings import SensorConfig
from rig.matrix.point import TestPoint
from rig.matrix.waveform import waveform_named
from rig.units import show

HARMONICS = 20
"""The sensor passes so many: a first-order filter at 20 f takes 0.1 % of the fundamental, and 11 % of the tenth."""

DELAY_TIMES_BANDWIDTH = math.sqrt(2.0) / math.tau
"""Group delay times cut-off frequency of a second-order Butterworth filter at low frequency, 0.225."""


def sampling_hints(points: Sequence[TestPoint], bench: Bench) -> tuple[str, ...]:
    """One line for each sensor and each way in which it is too slow, with the points concerned and the limit.

    Args:
        points: all points of a plan.
        bench: rates, declared bandwidths and delays of its sensors.
    """
    moving = [point for point in points if point.kind != "current_step"]
    hints: list[str] = []
    for name, sensor in (("load cell", bench.load_cell), ("LVDT", bench.lvdt)):
        hints += _rate(name, sensor, moving)
        hints += _bandwidth(name, sensor, moving)
    return tuple(hints)


def _rate(name: str, sensor: SensorConfig, points: Sequence[TestPoint]) -> Iterator[str]:
    for waveform in sorted({point.waveform for point in points}):
        needed = waveform_named(waveform).samples_needed
        coarse = [
            point for point in points if point.waveform == waveform and sensor.rate_Hz < needed * point.frequency_Hz
        ]
        if coarse:
            fewest = sensor.rate_Hz / max(point.frequency_Hz for point in coarse)
            need_Hz = needed * max(point.frequency_Hz for point in coarse)
            yield (
                f"{_some(coarse)}: down to {fewest:.3g} samples a cycle of the {name} at {sensor.rate_Hz:.4g} Hz; "
                f"identification from a {waveform} needs {needed:g}, that is {show(need_Hz, 'Hz')} here, because force "
                "turns round within a few samples at each reversal"
            )


def _bandwidth(name: str, sensor: SensorConfig, points: Sequence[TestPoint]) -> Iterator[str]:
    if sensor.bandwidth_Hz is not None and sensor.bandwidth_Hz > 0.5 * sensor.rate_Hz:
        yield (
            f"{name}: declared bandwidth {show(sensor.bandwidth_Hz, 'Hz')} is above half its rate, "
            f"{show(0.5 * sensor.rate_Hz, 'Hz')} (Nyquist): noise and hum above that appear at lower frequencies"
        )
    band_Hz, source = sensor.bandwidth_Hz, "declared bandwidth"
    if band_Hz is None and sensor.delay_s:
        band_Hz, source = DELAY_TIMES_BANDWIDTH / sensor.delay_s, f"declared delay {show(sensor.delay_s, 'ms')}, about"
    if band_Hz is None:
        return
    slow = [point for point in points if band_Hz < HARMONICS * point.frequency_Hz]
    if slow:
        fastest_Hz = max(point.frequency_Hz for point in slow)
        yield (
            f"{_some(slow)}: the {name} ({source} {show(band_Hz, 'Hz', 3)}) passes {math.floor(band_Hz / fastest_Hz)} "
            f"harmonics of {show(fastest_Hz, 'Hz')}; the shape of a loop needs {HARMONICS}, that is "
            f"{show(HARMONICS * fastest_Hz, 'Hz')} here"
        )


def _some(points: Sequence[TestPoint]) -> str:
    """The first points by name, and how many more there are."""
    names = ", ".join(point.id for point in points[:3])
    return names + (f" and {len(points) - 3} more" if len(points) > 3 else "")

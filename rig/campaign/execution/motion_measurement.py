"""What the displacement sensor saw of a program, measured while the campaign runs."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from drivers.roles import Input
from rig.campaign.sequencer.amplitude_compensation import MeasuredMotion
from rig.recording.layout import good_values
from rig.signals.clock_model import unwrapped
from rig.signals.cycles import measured_motion

ENOUGH_SAMPLES_A_CYCLE = 500
"""More are thinned: the loop that watches the rig has no time to waste."""
MOST_SAMPLES = 10_000
"""Of a longer program the last ones are measured, twenty cycles or more: a cycle of 500 samples takes 10 ms."""


@dataclass(frozen=True)
class WantedMotion:
    """What is to be measured: waveform, frequency (Hz), and the displacement sensor's nominal rate (Hz)."""

    waveform: str
    frequency_Hz: float
    rate_Hz: float


class MotionMeasurement:
    """Follows one program while it runs: what arrives is thinned at once, so that its end takes no time, however long.

    Args:
        wanted: the motion asked for.
    """

    def __init__(self, wanted: WantedMotion) -> None:
        self._wanted = wanted
        self._stride = max(1, int(wanted.rate_Hz / (wanted.frequency_Hz * ENOUGH_SAMPLES_A_CYCLE)))
        self._skip = 0
        self._parts: deque[NDArray[Any]] = deque()
        self._kept = 0
        self._valve_saturated = False
        self._following_error_m = 0.0

    def add(self, records: NDArray[Any]) -> None:
        """Take records (n,) of the ring's record type, in the order of arrival, from the program's start on."""
        samples = records[records["channel"] == Channel.DISPLACEMENT]
        chosen = samples[self._skip :: self._stride]
        self._skip = (self._skip - len(samples)) % self._stride
        self._parts.append(chosen)
        self._kept += len(chosen)
        while self._kept - len(self._parts[0]) >= MOST_SAMPLES:
            self._kept -= len(self._parts.popleft())
        inputs = records["value"][records["channel"] == Channel.INPUTS].astype(np.int64)
        self._valve_saturated = self._valve_saturated or bool(np.any(inputs & int(Input.VALVE_SATURATED)))
        errors_m = np.abs(records["value"][records["channel"] == Channel.SERVO_ERROR])
        self._following_error_m = max(self._following_error_m, float(np.max(errors_m, initial=0.0)))

    def motion(self) -> MeasuredMotion | None:
        """The program's motion, of a very long one that of its last cycles.

        Returns:
            None when there is not one full cycle, or no two cycles beside the ones next to a ramp agree on one.
        """
        if self._kept == 0:
            return None
        samples, wanted = np.concatenate(self._parts), self._wanted
        clocked = bool(np.all(samples["device_us"] >= 0))
        time_s = samples["device_us"] * 1e-6 if clocked else unwrapped(samples["sequence"]) / wanted.rate_Hz
        order = np.concatenate(([True], np.diff(np.maximum.accumulate(time_s)) > 0))
        motion = measured_motion(time_s[order] - time_s[0], good_values(samples[order]), wanted.waveform)
        if motion is None or not math.isfinite(motion.amplitude_m):
            return None
        return MeasuredMotion(
            amplitude_m=motion.amplitude_m, mean_m=motion.mean_m, valve_saturated=self._valve_saturated,
            following_error_m=self._following_error_m,
        )

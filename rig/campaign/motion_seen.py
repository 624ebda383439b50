"""What the displacement sensor saw of a program, measured while the campaign runs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.ring import Channel
from protocols.actuator import Input
from rig.campaign.adaptation import MotionSeen
from rig.recording.achieved import achieved_motion
from rig.recording.alignment import good_values
from rig.recording.sensor_clock import unwrapped

MOTION_CHANNELS = (int(Channel.DISPLACEMENT), int(Channel.INPUTS), int(Channel.SERVO_ERROR))
ENOUGH_SAMPLES_A_CYCLE = 500
"""More are thinned: the loop that watches the rig has no time to waste."""


@dataclass(frozen=True)
class MotionWanted:
    """What is to be measured: waveform, frequency (Hz), and the displacement sensor's nominal rate (Hz)."""

    waveform: str
    frequency_Hz: float
    rate_Hz: float


def seen_motion(records: NDArray[Any], wanted: MotionWanted) -> MotionSeen | None:
    """Measure a program's motion.

    Args:
        records: (n,) of the ring's record type: `MOTION_CHANNELS` from the program's start to its end.
        wanted: the motion asked for.

    Returns:
        None when there is not one full cycle, or no two cycles beside the ones next to a ramp agree on one.
    """
    samples = records[records["channel"] == Channel.DISPLACEMENT]
    samples = samples[:: max(1, int(wanted.rate_Hz / (wanted.frequency_Hz * ENOUGH_SAMPLES_A_CYCLE)))]
    if len(samples) == 0:
        return None
    clocked = bool(np.all(samples["device_us"] >= 0))
    time_s = samples["device_us"] * 1e-6 if clocked else unwrapped(samples["sequence"]) / wanted.rate_Hz
    order = np.concatenate(([True], np.diff(np.maximum.accumulate(time_s)) > 0))
    motion = achieved_motion(time_s[order] - time_s[0], good_values(samples[order]), wanted.waveform)
    if motion is None or not math.isfinite(motion.amplitude_m):
        return None
    inputs = records["value"][records["channel"] == Channel.INPUTS].astype(np.int64)
    errors_m = records["value"][records["channel"] == Channel.SERVO_ERROR]
    return MotionSeen(
        amplitude_m=motion.amplitude_m,
        mean_m=motion.mean_m,
        valve_saturated=bool(np.any(inputs & int(Input.VALVE_SATURATED))),
        following_error_m=float(np.max(np.abs(errors_m))) if len(errors_m) else 0.0,
    )

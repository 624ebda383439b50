"""Whether a motion can be halted at any instant within the available travel, and what fits if it cannot.

By the rules of `rig.signals.stopping`, with the configured halt deceleration; the station checks the same at the start.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from rig.bench.model import Bench
from rig.display import Display
from rig.matrix.model import Matrix
from rig.signals.arrays import FloatArray
from rig.signals.stopping import CYCLE_STEPS, Cycles, Reach, halted_m, reach
from rig.signals.waveform import Waveform
from rig.test_point import HYBRID, TestPoint

HARDEST_FIT_M_S2 = 500.0
"""No bench file may ask for more (`[actuator] halt_deceleration`)."""
FIT_STEP_M_S2 = 0.1
"""Decelerations that fits are rounded up to this."""


@dataclass(frozen=True)
class StopFit:
    """What would leave a halt the travel that it needs; None where that alone does not.

    Attributes:
        halt_deceleration_m_s2: the least one, at the point's amplitude and centre.
        centre_m: nearest to the point's.
    """

    halt_deceleration_m_s2: float | None
    centre_m: float | None

    def text(self, display: Display) -> str:
        """In words, with the sign and units of entries in a file; empty where there is nothing."""
        fits = []
        if self.halt_deceleration_m_s2 is not None:
            least = display.acceleration.at_least(self.halt_deceleration_m_s2)
            fits.append(f'halt_deceleration = "{least}" is sufficient')
        if self.centre_m is not None:
            fits.append(f"a centre (mid_stroke) of {display.displacement.text(self.centre_m)} is sufficient")
        return "; ".join(fits)


def stopping_reach(point: TestPoint, matrix: Matrix, bench: Bench) -> Reach:
    """Lowest and highest position (m, rig's coordinate) at which a halt comes to rest, begun at any instant."""
    actuator = bench.actuator
    low_m, high_m = _about_centre(point, matrix, actuator.fade_out_cycles, actuator.halt_deceleration_m_s2)
    return Reach(point.centre_m + low_m, point.centre_m + high_m)


def stop_fits(point: TestPoint, matrix: Matrix, bench: Bench, room_m: tuple[float, float]) -> StopFit:
    """What fits for a motion that a halt takes out of its travel.

    Args:
        point: the motion.
        matrix: of the specimen and the hybrid test.
        bench: the rig.
        room_m: lowest and highest position allowed.
    """
    low_m, high_m = stopping_reach(point, matrix, bench)
    shift_m = max(room_m[0] - low_m, 0.0) or min(room_m[1] - high_m, 0.0)
    movable = high_m - low_m <= room_m[1] - room_m[0]

    def fits(steps: int) -> bool:
        about = _about_centre(point, matrix, bench.actuator.fade_out_cycles, steps * FIT_STEP_M_S2)
        return within(Reach(point.centre_m + about.low_m, point.centre_m + about.high_m), room_m)

    low, high = 0, round(HARDEST_FIT_M_S2 / FIT_STEP_M_S2)
    if not fits(high):
        return StopFit(None, point.centre_m + shift_m if movable else None)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if fits(middle) else (middle, high)
    return StopFit(round(high * FIT_STEP_M_S2, 6), round(point.centre_m + shift_m, 6) if movable else None)


def within(reached: Reach, room_m: tuple[float, float]) -> bool:
    """Whether every halt ends in the room, but for rounding."""
    return reached.low_m >= room_m[0] - 1e-9 and reached.high_m <= room_m[1] + 1e-9


def _about_centre(point: TestPoint, matrix: Matrix, fade_out_cycles: float, deceleration_m_s2: float) -> Reach:
    if point.kind == HYBRID and matrix.hybrid is not None and matrix.specimen.assumed is not None:
        ride = matrix.hybrid.ride(point, matrix.specimen.assumed)
        return _of_samples(ride.extension_m[:, 0], ride.speed_m_s[:, 0], deceleration_m_s2)
    if point.record_samples is not None:
        position_m, velocity_m_s, _ = point.record_samples.motion(point.amplitude_m)
        return _of_samples(position_m, velocity_m_s, deceleration_m_s2)
    ramps = (point.ramp_in_cycles, point.ramp_out_cycles)
    return _of_cycles(
        point.shape, point.amplitude_m, point.frequency_Hz, *ramps, point.cycles, fade_out_cycles, deceleration_m_s2
    )


def _of_samples(position_m: FloatArray, velocity_m_s: FloatArray, deceleration_m_s2: float) -> Reach:
    ends_m = halted_m(position_m, velocity_m_s, deceleration_m_s2)
    return Reach(float(np.min(ends_m)), float(np.max(ends_m)))


@lru_cache(maxsize=4096)
def _of_cycles(
    shape: Waveform, amplitude_m: float, frequency_Hz: float, ramp_in_cycles: float, ramp_out_cycles: float,
    cycles: float, fade_out_cycles: float, deceleration_m_s2: float,
) -> Reach:  # fmt: skip
    """Cached: a matrix repeats a motion at each current, and a plan checks each point several times."""
    value, change, _ = shape.shape(np.arange(CYCLE_STEPS) / CYCLE_STEPS)
    unit = list(zip(value.tolist(), change.tolist(), strict=True))
    motion = Cycles(unit, amplitude_m, frequency_Hz, ramp_in_cycles, ramp_out_cycles, cycles, fade_out_cycles)
    return reach(motion.path(), deceleration_m_s2)

"""Peaks that the rod reaches, which are not quite those that a motion asks for. Pure.

A device that follows set-points continues at the speed of the last one until the next has come. Of a motion that is
known in advance that speed is the mean one of the coming period T: the path is made of lines, whose slope changes by
a T. Of a hybrid test it is the speed of the moment: the path makes steps of a T^2 / 2. A set-point that comes j later
than the one before makes a step of v j. The position loop (second order, corner w0, damping 0.7) answers a step d with
a speed of 0.46 w0 d and an acceleration of w0^2 d. Bounds, fitted to that loop for w0 T from 0.75 to 3.8 and 20 to 100
set-points a cycle (docs/maintainers/decisions/streamed-headroom.md):

    speed           v (1 + 0.46 w0 j)
    acceleration    a (1 + c (w0 T)^2) + 0.7 w0^2 j v        c = 0.05; 0.4 of a hybrid test

After a corner (triangle) the loop overshoots the new speed by 9 %, for any source of motion; that is within the 10 % by
which the interlock lies above the speed limit. The turn takes an acceleration of 0.92 w0 v. Where a controller's own
generator makes the corner and it allows less, it overshoots more: by 0.61 (w0 v / limit - 1.09) v beside that. Streamed
set-points have no generator that limits it, and a corner that they rounded would be another motion: it is the point's.

Before all that come ramps and fade-out: where the share s of the amplitude changes by s' a cycle, the motion x of unit
amplitude moves at s x' + s' x. A controller's own generator fades linearly, s' = -1 / n over n cycles: a sine reaches
sqrt(1 + (1 / 2 pi n)^2) of its speed, a triangle 1 + 1 / 4 n (1.25 over one cycle). Streamed set-points fade by a
raised cosine, no faster than the motion itself (`drivers.setpoint_generator.faded`). Ramps over whole and half cycles
add nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.bench.model import Bench
from rig.errors import some
from rig.signals.arrays import FloatArray
from rig.signals.stopping import CYCLE_STEPS
from rig.signals.waveform import Waveform
from rig.test_point import AMPLITUDE_INVALID, AMPLITUDE_SUSPECT, HYBRID, TestPoint

LOOP_1_S = math.tau * 30.0
"""Corner of the position loop (rad/s): 30 Hz, a fast servo-hydraulic axis; a slower one smooths more."""
LOOP_DAMPING = 0.7
JITTER_S = 0.4e-3
"""Of the arrival of set-points at the device, from one to the next (s)."""
LINES, STEPS = 0.05, 0.4
SPEED_JITTER, ACCELERATION_JITTER = 0.46, 0.7
CORNER_SPEED, CORNER_FROM, CORNER_ACCELERATION = 0.61, 1.09, 0.92
HYBRID_SPEED = 1.25
"""A hybrid test's set-points go so much faster than its forecast: leads amplify what follows wrongly (24 tests)."""


class Peaks(NamedTuple):
    """Largest speed (m/s) and acceleration (m/s^2) of the rod."""

    speed_m_s: float
    acceleration_m_s2: float


def peaks(point: TestPoint, bench: Bench) -> Peaks:
    """Of a point on a bench: its motion's own, with what ramps, fade-out, corners and streamed set-points add."""
    speed_m_s, acceleration_m_s2 = _with_envelope(point, bench)
    turning_m_s = point.peak_speed_m_s
    if point.shape.corner_share is not None:
        saturated = LOOP_1_S * turning_m_s / bench.limits.acceleration_m_s2 - CORNER_FROM
        speed_m_s += CORNER_SPEED * max(0.0, saturated) * turning_m_s
    if bench.actuator.setpoints_s is None or point.at_rest:
        return Peaks(speed_m_s, acceleration_m_s2)
    period_s, jitter_s = bench.actuator.setpoints_s * bench.clock.device_rate, JITTER_S * bench.clock.device_rate
    ripple = LINES
    if point.kind == HYBRID:
        speed_m_s, ripple = HYBRID_SPEED * speed_m_s, STEPS
    hardest_m_s2 = (
        acceleration_m_s2 * (1.0 + ripple * (LOOP_1_S * period_s) ** 2)
        + ACCELERATION_JITTER * LOOP_1_S**2 * jitter_s * speed_m_s
    )
    if point.shape.corner_share is not None:
        hardest_m_s2 = max(hardest_m_s2, CORNER_ACCELERATION * LOOP_1_S * turning_m_s)
    return Peaks(speed_m_s * (1.0 + SPEED_JITTER * LOOP_1_S * jitter_s), hardest_m_s2)


def gap_warnings(points: Sequence[TestPoint], bench: Bench) -> tuple[str, ...]:
    """A warning if the drive's own stop on lost set-points brakes harder than the bench allows.

    Its speed goes to 0 at once, half of a triangle's corner: 0.46 w0 v. No plan can forbid it, the drive is alone then.

    Args:
        points: all points of a plan.
        bench: the rig; a controller with a generator needs no set-points.
    """
    if bench.actuator.setpoints_s is None:
        return ()
    limit_m_s2 = bench.limits.acceleration_m_s2
    a_speed = 0.5 * CORNER_ACCELERATION * LOOP_1_S
    fast = [point for point in points if a_speed * peaks(point, bench).speed_m_s > limit_m_s2]
    if not fast:
        return ()
    fastest_m_s = max(peaks(point, bench).speed_m_s for point in fast)
    return (
        f"{some_points(fast)}: if a set-point is lost, a drive that stops on its own decelerates from "
        f"{fastest_m_s:.3g} m/s at about {a_speed * fastest_m_s:.3g} m/s^2 (with a position loop of 30 Hz); allowed: "
        f"at most {limit_m_s2:.3g} m/s^2. Fix: limit the deceleration in the drive, or plan speeds of at most "
        f"{limit_m_s2 / a_speed:.3g} m/s",
    )


def amplitude_hints(points: Sequence[TestPoint], *, adapted: bool) -> tuple[str, ...]:
    """A warning if the machine cannot reach the amplitude of points that is commanded as it is; empty otherwise.

    Args:
        points: all points of a plan.
        adapted: the amplitude is adapted: the machine is commanded more than it is to reach.
    """
    slow = [] if adapted else [
        point for point in points if point.cyclic and loop_gain(point.frequency_Hz) < 1.0 - AMPLITUDE_SUSPECT
    ]
    if not slow:
        return ()
    fastest_Hz = max(point.frequency_Hz for point in slow)
    return (
        f"{some_points(slow)}: a fast machine (position loop of 30 Hz) reaches about {100 * loop_gain(fastest_Hz):.0f} "
        f"% of the amplitude at {fastest_Hz:g} Hz; below {100 * (1 - AMPLITUDE_SUSPECT):g} % a point is suspect, below "
        f"{100 * (1 - AMPLITUDE_INVALID):g} % invalid. Fix: adapt_amplitude = true",
    )


def loop_gain(frequency_Hz: float) -> float:
    """Share of a sine's amplitude that the position loop reaches (second order, damping 0.7)."""
    ratio = math.tau * frequency_Hz / LOOP_1_S
    return 1.0 / math.hypot(1.0 - ratio**2, 2.0 * LOOP_DAMPING * ratio)


def some_points(points: Sequence[TestPoint]) -> str:
    """The first points by name, and how many more there are."""
    return some([point.id for point in points])


def _with_envelope(point: TestPoint, bench: Bench) -> Peaks:
    """Largest speed (m/s) and acceleration (m/s^2) that a point's motion asks for, its ramps and fade-out included."""
    own = Peaks(point.peak_speed_m_s, point.peak_acceleration_m_s2)
    if not point.has_frequency or point.at_rest:
        return own
    streamed = bench.actuator.setpoints_s is not None
    ramps = (point.ramp_in_cycles, point.ramp_out_cycles)
    more = _envelope_peaks(point.shape, *ramps, bench.actuator.fade_out_cycles, streamed=streamed)
    return Peaks(own.speed_m_s * more.speed_m_s, own.acceleration_m_s2 * more.acceleration_m_s2)


@lru_cache(maxsize=256)
def _envelope_peaks(
    shape: Waveform, ramp_in_cycles: float, ramp_out_cycles: float, fade_out_cycles: float, *, streamed: bool
) -> Peaks:
    """The same as shares of the waveform's own peaks, 1 or more. `cycles` between the ramps are whole ones."""
    value, change, bend = shape.shape(np.arange(CYCLE_STEPS) / CYCLE_STEPS)
    fastest, hardest = 1.0, 1.0
    parts: list[tuple[FloatArray, float, NDArray[np.int_]]] = []
    if not streamed:
        parts.append((np.ones(CYCLE_STEPS), -1.0 / fade_out_cycles, np.arange(CYCLE_STEPS)))
    for ramp, begins, way in ((ramp_in_cycles, 0.0, 1.0), (ramp_out_cycles, ramp_in_cycles, -1.0)):
        if ramp > 0.0:
            steps = np.arange(round(ramp * CYCLE_STEPS) + 1)
            done: FloatArray = np.minimum(1.0, steps / (ramp * CYCLE_STEPS))
            phase = (round(begins * CYCLE_STEPS) + steps) % CYCLE_STEPS
            parts.append((done if way > 0.0 else 1.0 - done, way / ramp, phase))
    for share, slope, phase in parts:
        speeds = np.abs(share * change[phase] + slope * value[phase])
        accelerations = np.abs(share * bend[phase] + 2.0 * slope * change[phase])
        fastest = max(fastest, float(np.max(speeds)) / shape.peak_velocity)
        hardest = max(hardest, float(np.max(accelerations)) / shape.peak_acceleration)
    if streamed and shape.corner_share is None:
        hardest = max(hardest, 1.0 + 1.0 / (8.0 * fade_out_cycles**2))
    return Peaks(fastest, hardest)

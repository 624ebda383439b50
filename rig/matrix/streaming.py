"""Peaks that the rod reaches, which are not quite those that a motion asks for. Pure.

A device that follows set-points continues at the speed of the last one until the next has come. Of a motion that is
known in advance that speed is the mean one of the coming period T: the path is made of lines, whose slope changes by
a T. Of a hybrid test it is the speed of the moment: the path makes steps of a T^2 / 2. A set-point that comes j later
than the one before makes a step of v j. The position loop (second order, corner w0, damping 0.7) answers a step d with
a speed of 0.46 w0 d and an acceleration of w0^2 d. Bounds, fitted to that loop for w0 T from 0.75 to 3.8 and 20 to 100
set-points a cycle (docs/decisions/streamed-headroom.md):

    speed           v (1 + 0.46 w0 j)
    acceleration    a (1 + c (w0 T)^2) + 0.7 w0^2 j v        c = 0.05; 0.4 of a hybrid test

After a corner (triangle) the loop overshoots the new speed by 9 %, whoever makes the motion; that is within the 10 % by
which the interlock lies above the speed limit. The turn takes an acceleration of 0.92 w0 v. Where a controller's own
generator makes the corner and it allows less, it overshoots more: by 0.61 (w0 v / limit - 1.09) v beside that. Streamed
set-points have nobody who limits it, and a corner that they rounded would be another motion: it is the point's.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rig.bench.model import Bench
from rig.matrix.point import TestPoint

LOOP_1_S = math.tau * 30.0
"""Corner of the position loop (rad/s): 30 Hz, a fast servo-hydraulic axis; a slower one smooths more."""
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
    """Of a point on a bench: its motion's own, with what corners and streamed set-points add."""
    speed_m_s, acceleration_m_s2 = point.peak_speed_m_s, point.peak_acceleration_m_s2
    if point.shape.corner_share is not None:
        saturated = LOOP_1_S * speed_m_s / bench.limits.acceleration_m_s2 - CORNER_FROM
        speed_m_s *= 1.0 + CORNER_SPEED * max(0.0, saturated)
    if bench.actuator.setpoints_s is None or point.kind == "current_step":
        return Peaks(speed_m_s, acceleration_m_s2)
    period_s, jitter_s = bench.actuator.setpoints_s * bench.clock.device_rate, JITTER_S * bench.clock.device_rate
    ripple = LINES
    if point.kind == "hybrid":
        speed_m_s, ripple = HYBRID_SPEED * speed_m_s, STEPS
    hardest_m_s2 = (
        acceleration_m_s2 * (1.0 + ripple * (LOOP_1_S * period_s) ** 2)
        + ACCELERATION_JITTER * LOOP_1_S**2 * jitter_s * speed_m_s
    )
    if point.shape.corner_share is not None:
        hardest_m_s2 = max(hardest_m_s2, CORNER_ACCELERATION * LOOP_1_S * point.peak_speed_m_s)
    return Peaks(speed_m_s * (1.0 + SPEED_JITTER * LOOP_1_S * jitter_s), hardest_m_s2)

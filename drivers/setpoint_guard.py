"""Every set-point is one that the rod can reach: from the last one that the device took, or from where the rod is.

One rule for all motions: sine, triangle, signal, hybrid test, move, fade and halt. A set-point that can be reached
within the bench's limits is passed on unchanged. Any other one is replaced by the reachable one that leads back to the
motion: the path goes on without a step, the speed changes by less than the acceleration limit allows, and is not larger
than the motion's own. Pure: time is given, nothing is sent.
"""

from __future__ import annotations

import math

from drivers.setpoint_generator import UNLIMITED, RodLimits, Setpoint

SPEED_SHARE = 1.02
"""Of the speed limit: a fade adds up to 1.3 % to the speed of its sine."""
CATCH_UP_SHARE = 0.4
"""Of the acceleration limit, used to return to a motion: the motion's own acceleration and the servo's overshoot come on
top."""
CATCH_UP_PERIODS = 5.0
"""Time constant of the return, in set-point periods."""
CAUGHT_SHARE = 0.05
"""A motion is caught up with when the step to it is below this share of (acceleration limit x period^2)."""
SLACK_M, SLACK_M_S = 1e-9, 1e-9


class SetpointGuard:
    """Follows the set-points that one device has taken.

    Args (construction):
        limits: of the bench.
        period_s: of the set-points (s of the device's time); 0: not known.

    Attributes:
        last: the last set-point that the device took, or where the rod was measured.
        at_s: when that was (s of the device's time).
        catching_up: the set-points are on their way back to the motion.
    """

    def __init__(self, limits: RodLimits = UNLIMITED, period_s: float = 0.0) -> None:
        self.last = Setpoint(0.0, 0.0)
        self.at_s = -math.inf
        self.catching_up = False
        self._limits = limits
        self._period_s = period_s
        self._acceleration_m_s2 = limits.acceleration_m_s2

    def begin(self, setpoint: Setpoint, now_s: float) -> None:
        """The device follows from here on: it holds this set-point, or the rod was measured there at this speed."""
        self.last, self.at_s, self.catching_up = setpoint, now_s, False

    def measured(self, rod: Setpoint, now_s: float) -> None:
        """The rod was measured after a gap: what the device took before no longer tells where it is."""
        self.begin(rod, now_s)
        self.catching_up = True

    def taken(self, setpoint: Setpoint, now_s: float) -> None:
        """The device acknowledged a set-point that was sent at this time."""
        self.last, self.at_s = setpoint, now_s

    def reachable(self, wanted: Setpoint, now_s: float, fastest_m_s: float) -> Setpoint:
        """The set-point to send.

        Args:
            wanted: the motion's.
            now_s: when it is sent.
            fastest_m_s: largest planned speed of the motion.
        """
        step_s = now_s - self.at_s
        if not math.isfinite(self._acceleration_m_s2) or not math.isfinite(step_s):
            return self._within_travel(wanted)
        step_s = max(step_s, 1e-6)
        if not self.catching_up and self._in_reach(wanted, step_s):
            return self._within_travel(wanted)
        self.catching_up = True
        return self._within_travel(self._returning(wanted, step_s, fastest_m_s))

    def _in_reach(self, wanted: Setpoint, step_s: float) -> bool:
        """Within the limits of speed and acceleration from the last set-point, in this time."""
        limit, before = self._acceleration_m_s2, self.last
        if abs(wanted.velocity_m_s) > SPEED_SHARE * self._limits.speed_m_s:
            return False
        # Between two set-points the device goes on at the speed of the last one.
        off_m = wanted.position_m - before.position_m - before.velocity_m_s * step_s
        gained_m_s = wanted.velocity_m_s - before.velocity_m_s
        return abs(off_m) <= 0.5 * limit * step_s**2 + SLACK_M and abs(gained_m_s) <= limit * step_s + SLACK_M_S

    def _returning(self, wanted: Setpoint, step_s: float, fastest_m_s: float) -> Setpoint:
        """Go on from the last set-point at its speed, and change the speed towards the motion."""
        period_s = self._period_s or step_s
        limit = CATCH_UP_SHARE * self._acceleration_m_s2
        position_m = self.last.position_m + self.last.velocity_m_s * step_s
        off_m = position_m - wanted.position_m
        if self._caught(off_m, wanted, period_s):
            self.catching_up = False
            return wanted
        # Linear near the motion, along the parabola of a constant deceleration far from it.
        speed_m_s = min(abs(off_m) / (CATCH_UP_PERIODS * period_s), math.sqrt(2.0 * limit * abs(off_m)))
        velocity_m_s = wanted.velocity_m_s - math.copysign(speed_m_s, off_m)
        most_m_s = min(max(fastest_m_s, abs(wanted.velocity_m_s)), self._limits.speed_m_s)
        velocity_m_s = max(-most_m_s, min(most_m_s, velocity_m_s))
        # The motion's own acceleration comes on top of what leads back to it.
        gained_m_s = limit * min(step_s, 1.5 * period_s)
        before_m_s = self.last.velocity_m_s
        velocity_m_s = max(before_m_s - gained_m_s, min(before_m_s + gained_m_s, velocity_m_s))
        return Setpoint(position_m, self._stoppable(position_m, velocity_m_s))

    def _caught(self, off_m: float, wanted: Setpoint, period_s: float) -> bool:
        near_m = CAUGHT_SHARE * self._acceleration_m_s2 * period_s**2
        near_m_s = CATCH_UP_SHARE * self._acceleration_m_s2 * period_s
        return abs(off_m) <= near_m and abs(wanted.velocity_m_s - self.last.velocity_m_s) <= near_m_s

    def _stoppable(self, position_m: float, velocity_m_s: float) -> float:
        """The speed, or as much of it as can still be stopped within the travel."""
        limits = self._limits
        end_m = limits.position_max_m if velocity_m_s > 0.0 else limits.position_min_m
        left_m = max(0.0, math.copysign(1.0, velocity_m_s) * (end_m - position_m))
        most_m_s = math.sqrt(2.0 * CATCH_UP_SHARE * self._acceleration_m_s2 * left_m)
        return max(-most_m_s, min(most_m_s, velocity_m_s))

    def _within_travel(self, setpoint: Setpoint) -> Setpoint:
        low_m, high_m = self._limits.position_min_m, self._limits.position_max_m
        if low_m <= setpoint.position_m <= high_m:
            return setpoint
        return Setpoint(max(low_m, min(high_m, setpoint.position_m)), 0.0)

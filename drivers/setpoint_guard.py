"""Every set-point is one that the rod can reach: from the last one that the device took, or from where the rod is.

One rule for all motions: sine, triangle, signal, hybrid test, move, fade and halt. A set-point that can be reached
within the bench's limits is passed on unchanged; so is a corner that a position loop turns with no more acceleration.
One that is a little out of reach is replaced by the nearest one in reach. Any other one, and those after a gap, are
replaced by a path that leads back to the motion: it has no steps, its speed changes by less than the acceleration limit
allows, and is not larger than the motion's own.
Pure: time is given, nothing is sent.
"""

from __future__ import annotations

import math

from drivers.setpoint_generator import UNLIMITED, RodLimits, Setpoint

SPEED_SHARE = 1.02
"""Of the speed limit: a fade adds up to 1.3 % to the speed of its sine."""
CATCH_UP_SHARE = 0.6
"""Of the acceleration limit, used to return to a motion: the servo's overshoot comes on top."""
CATCH_UP_PERIODS = 5.0
"""Time constant of the return, in set-point periods."""
STROKE_SHARE = 0.8
"""Of the acceleration limit, used to stay within the travel."""
CAUGHT_SHARE = 0.05
"""A motion is caught up with when the step to it is below this share of (acceleration limit x period^2), the
period at most `TURN_S`."""

LOOP_1_S = math.tau * 30.0
"""Corner of a fast position loop. It answers a step d with an acceleration of LOOP_1_S^2 d, and a speed that changes at
once by v with 0.46 LOOP_1_S v."""
TURN_S = 1.0 / (0.46 * LOOP_1_S)
TURN_SHARE = 1.02
"""A speed may change by the acceleration limit times this time at once: the loop answers with no more acceleration.
Over any time it changes by the limit times that time and `TURN_S` at most. What changes more is a corner out of reach;
so much more for rounding."""

SLACK_M = 1e-6
"""Far below what a servo resolves; clocks and rounding differ by less."""


class SetpointGuard:
    """Follows the set-points that one device has taken.

    Args (construction):
        limits: of the bench.
        period_s: of the set-points (s of the device's time); 0: not known.

    Attributes:
        last: the last set-point that the device took, or where the rod was measured.
        at_s: when that was (s of the device's time).
        taken_s: when the device last took a set-point.
        catching_up: the set-points are on their way back to the motion.
    """

    def __init__(self, limits: RodLimits = UNLIMITED, period_s: float = 0.0) -> None:
        self.last = Setpoint(0.0, 0.0)
        self.at_s = self.taken_s = -math.inf
        self.catching_up = False
        self._limits = limits
        self._period_s = period_s
        self._acceleration_m_s2 = limits.acceleration_m_s2
        # Of the speed, to change at once: a corner may use it up, and it comes back with time.
        self._most_spare_m_s = limits.acceleration_m_s2 * max(0.0, TURN_S - period_s)
        self._spare_m_s = self._most_spare_m_s

    def begin(self, setpoint: Setpoint, now_s: float) -> None:
        """The device holds this set-point and follows from here on."""
        self.last, self.at_s, self.taken_s, self.catching_up = setpoint, now_s, now_s, False
        self._spare_m_s = self._most_spare_m_s

    def measured(self, rod: Setpoint, now_s: float, *, catch_up: bool) -> None:
        """The rod was measured after a gap: what the device took before no longer tells where it is.

        Args:
            rod: the set-point that it follows, as measured.
            now_s: when.
            catch_up: the motion goes on; else what comes next begins from the rod.
        """
        self.last, self.at_s, self.catching_up = rod, now_s, catch_up
        self._spare_m_s = 0.0

    def taken(self, setpoint: Setpoint, now_s: float) -> None:
        """The device acknowledged a set-point that was sent at this time."""
        if math.isfinite(self.at_s) and math.isfinite(self._acceleration_m_s2):
            turned_m_s = abs(setpoint.velocity_m_s - self.last.velocity_m_s)
            spare_m_s = self._spare_m_s + self._acceleration_m_s2 * (now_s - self.at_s) - turned_m_s
            self._spare_m_s = max(0.0, min(self._most_spare_m_s, spare_m_s))
        self.last, self.at_s, self.taken_s = setpoint, now_s, now_s

    def reachable(self, target: Setpoint, now_s: float, fastest_m_s: float, *, braking: bool = False) -> Setpoint:
        """The set-point to send.

        Args:
            target: the motion's.
            now_s: when it is sent.
            fastest_m_s: largest planned speed of the motion.
            braking: the motion is a halt: it may end outside the travel where it began too fast or too far out.
        """
        step_s = max(now_s - self.at_s, 0.0)
        if not math.isfinite(self._acceleration_m_s2) or not math.isfinite(step_s):
            return target
        turn_m_s = self._turn_m_s(step_s, braking=braking)
        if not self.catching_up:
            self.catching_up = self._is_beyond(target, step_s, turn_m_s, braking=braking)
        if self.catching_up:
            sent = self._returning(target, step_s, fastest_m_s)
        else:
            sent = self._nearest(target, step_s, turn_m_s)
        return sent if braking else self._within_travel(sent)

    def _is_beyond(self, target: Setpoint, step_s: float, turn_m_s: float, *, braking: bool) -> bool:
        """The motion is out of reach: by a step that would throw the rod, by a corner, or by the end of travel."""
        step_m = self._acceleration_m_s2 * min(max(step_s, self._period_s), 1.0 / LOOP_1_S) ** 2
        off_m = target.position_m - self._goes_to_m(step_s)
        if abs(off_m) > step_m or abs(target.velocity_m_s - self.last.velocity_m_s) > turn_m_s:
            return True
        return not braking and self._leaves_travel(target)

    def _turn_m_s(self, step_s: float, *, braking: bool) -> float:
        """By how much the speed may change now; of a halt, that has no corner, as the limit says."""
        # The speed counts for the coming period, however soon this set-point follows the last one.
        period_s = max(step_s, self._period_s)
        if braking:
            return self._acceleration_m_s2 * period_s
        return TURN_SHARE * self._acceleration_m_s2 * min(period_s, TURN_S) + self._spare_m_s

    def _goes_to_m(self, step_s: float) -> float:
        """Where the device's set-point is after this time: it goes on at the speed of the last one."""
        return self.last.position_m + self.last.velocity_m_s * step_s

    def _nearest(self, target: Setpoint, step_s: float, turn_m_s: float) -> Setpoint:
        """The set-point itself where it is in reach; else the nearest one that is."""
        limit, straight_m, before_m_s = self._acceleration_m_s2, self._goes_to_m(step_s), self.last.velocity_m_s
        most_m_s = SPEED_SHARE * self._limits.speed_m_s
        low_m_s, high_m_s = max(-most_m_s, before_m_s - turn_m_s), min(most_m_s, before_m_s + turn_m_s)
        off_m = 0.5 * limit * step_s**2 + SLACK_M
        return Setpoint(
            max(straight_m - off_m, min(straight_m + off_m, target.position_m)),
            max(low_m_s, min(high_m_s, target.velocity_m_s)),
        )

    def _returning(self, target: Setpoint, step_s: float, fastest_m_s: float) -> Setpoint:
        """Go on from the last set-point at its speed, and change the speed towards the motion."""
        period_s = self._period_s or step_s
        limit = CATCH_UP_SHARE * self._acceleration_m_s2
        position_m = self._goes_to_m(step_s)
        off_m = position_m - target.position_m
        if self._caught(off_m, target, period_s):
            self.catching_up = False
            return target
        # Linear near the motion, along the parabola of a constant deceleration far from it.
        speed_m_s = min(abs(off_m) / (CATCH_UP_PERIODS * period_s), math.sqrt(2.0 * limit * abs(off_m)))
        velocity_m_s = target.velocity_m_s - math.copysign(speed_m_s, off_m)
        most_m_s = min(max(fastest_m_s, abs(target.velocity_m_s)), self._limits.speed_m_s)
        velocity_m_s = max(-most_m_s, min(most_m_s, velocity_m_s))
        gained_m_s = limit * min(period_s, TURN_S)
        before_m_s = self.last.velocity_m_s
        velocity_m_s = max(before_m_s - gained_m_s, min(before_m_s + gained_m_s, velocity_m_s))
        return Setpoint(position_m, self._stoppable(position_m, velocity_m_s, period_s))

    def _caught(self, off_m: float, target: Setpoint, period_s: float) -> bool:
        period_s = min(period_s, TURN_S)
        near_m = CAUGHT_SHARE * self._acceleration_m_s2 * period_s**2
        near_m_s = CATCH_UP_SHARE * self._acceleration_m_s2 * period_s
        near = abs(off_m) <= near_m and abs(target.velocity_m_s - self.last.velocity_m_s) <= near_m_s
        return near and not self._leaves_travel(target)

    def _left_m(self, position_m: float, velocity_m_s: float) -> float:
        """Travel that is left in this direction."""
        end_m = self._limits.position_max_m if velocity_m_s > 0.0 else self._limits.position_min_m
        return max(0.0, math.copysign(1.0, velocity_m_s) * (end_m - position_m))

    def _leaves_travel(self, target: Setpoint) -> bool:
        """It cannot be stopped within the travel: set-points brake it from the next one on, a period later."""
        speed_m_s, limit = abs(target.velocity_m_s), self._acceleration_m_s2
        gone_m, least_m_s = speed_m_s * self._period_s, limit * self._period_s
        if speed_m_s > least_m_s:
            gone_m += 0.5 * (speed_m_s - least_m_s) ** 2 / limit
        return gone_m > self._left_m(*target) + SLACK_M

    def _stoppable(self, position_m: float, velocity_m_s: float, period_s: float) -> float:
        """The speed, or as much of it as can still be stopped within the travel after the coming period."""
        braking = STROKE_SHARE * self._acceleration_m_s2
        lost_m_s = braking * period_s
        most_m_s = math.sqrt(lost_m_s**2 + 2.0 * braking * self._left_m(position_m, velocity_m_s)) - lost_m_s
        return max(-most_m_s, min(most_m_s, velocity_m_s))

    def _within_travel(self, setpoint: Setpoint) -> Setpoint:
        low_m, high_m = self._limits.position_min_m, self._limits.position_max_m
        if low_m <= setpoint.position_m <= high_m:
            return setpoint
        return Setpoint(max(low_m, min(high_m, setpoint.position_m)), 0.0)

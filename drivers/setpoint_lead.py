"""The set-points of a device that takes no speed: each is where the rod is to be one period later.

Such a device moves in a line to each set-point within about one period, and rests there. It is therefore sent the
position of the next period. Its own set-point moves at (sent - where it is) / period, which must not exceed the speed
of the motion: after a late, refused or lost set-point it was at rest, and would overspeed towards the next one. The
lead that this takes away is restored while the motion is slower than its planned maximum.
Pure: time is given, nothing is sent.
"""

from __future__ import annotations

import math

from drivers.setpoint_generator import RodLimits, Setpoint

SPEED_SHARE = 1.02
"""Of the planned speed: jitter of the polls does not reduce the lead of a regular stream."""
REGAIN_SHARE = 0.1
"""Of the present speed, added while lead is restored."""
SLACK_SHARE = 0.05
"""Of the acceleration limit times the period: the additional speed near rest, where there is no speed to add to."""
NEAR_M = 3e-3
"""A rod that brakes by itself is within this distance of the device's set-point, apart from its lag."""


class SetpointLead:
    """Follows the set-point of one device that takes positions only.

    Where the device is on its way is not known exactly: it may take one period, or as long as the set-point before was
    awaited. The slower one is assumed, as it makes the device faster with the next set-point.

    Args (construction):
        limits: of the bench.
        period_s: of the set-points (s of the device's time); 0: not known, set-points are passed on.
    """

    def __init__(self, limits: RodLimits, period_s: float) -> None:
        self._limits = limits
        self._period_s = period_s
        self._from_m = self._to_m = math.nan
        self._at_s, self._takes_s = -math.inf, period_s
        self._lost_m = math.nan

    def begin(self, position_m: float) -> None:
        """The device holds this position."""
        self._from_m = self._to_m = position_m
        self._at_s, self._lost_m = -math.inf, math.nan

    def measured(self, rod: Setpoint) -> None:
        """The rod was measured after a gap: this is the set-point that it follows.

        Which of the last ones the device took, and whether it still holds it, shows by where the rod is.
        """
        known = [one for one in (self._to_m, self._lost_m) if math.isfinite(one)]
        nearest_m = min(known, key=lambda one: abs(one - rod.position_m), default=rod.position_m)
        near_m = NEAR_M + abs(rod.velocity_m_s) * self._period_s
        self._from_m = self._to_m = nearest_m if abs(nearest_m - rod.position_m) <= near_m else rod.position_m
        self._lost_m = math.nan

    def sent(self, setpoint: Setpoint, now_s: float, fastest_m_s: float) -> Setpoint:
        """What to send for this set-point.

        Args:
            setpoint: where to be now (m) and how fast to go on (m/s).
            now_s: when it is sent.
            fastest_m_s: largest planned speed of the motion.
        """
        period_s, speed_m_s = self._period_s, setpoint.velocity_m_s
        low_m = min(self._limits.position_min_m, setpoint.position_m)
        high_m = max(self._limits.position_max_m, setpoint.position_m)
        target_m = max(low_m, min(high_m, setpoint.position_m + speed_m_s * period_s))
        if period_s == 0.0 or math.isnan(self._to_m):
            return setpoint._replace(position_m=target_m)
        from_m = self._where_m(now_s)
        least_m_s = SLACK_SHARE * self._limits.acceleration_m_s2 * period_s
        room_m_s = SPEED_SHARE * min(fastest_m_s, self._limits.speed_m_s) - abs(speed_m_s)
        more_m_s = max(0.0, min(max(least_m_s, REGAIN_SHARE * abs(speed_m_s)), room_m_s))
        # Never back behind what the device may have reached already.
        least_m = min(self._to_m, from_m + (min(0.0, speed_m_s) - more_m_s) * period_s)
        most_m = max(self._to_m, from_m + (max(0.0, speed_m_s) + more_m_s) * period_s)
        return setpoint._replace(position_m=max(least_m, min(most_m, target_m)))

    def lost(self, position_m: float) -> None:
        """This set-point was sent and not acknowledged: the device may have taken it."""
        self._lost_m = position_m

    def taken(self, position_m: float, now_s: float) -> None:
        """The device acknowledged this set-point, that was sent at this time."""
        self._from_m = position_m if math.isnan(self._to_m) else self._where_m(now_s)
        waited_s = now_s - self._at_s
        self._takes_s = max(self._period_s, waited_s) if math.isfinite(waited_s) else self._period_s
        self._to_m, self._at_s, self._lost_m = position_m, now_s, math.nan

    def _where_m(self, now_s: float) -> float:
        """Where the device's own set-point is (m)."""
        if not math.isfinite(self._at_s):
            return self._to_m
        share = min(1.0, max(0.0, now_s - self._at_s) / self._takes_s) if self._takes_s > 0.0 else 1.0
        return self._from_m + share * (self._to_m - self._from_m)

"""The motion without one of its safeguards each: plan, streamed set-points, and what is promised of the pressure."""

from __future__ import annotations

from edits import Edit

ACTUATOR = "drivers/streamed_actuator.py"

NO_GAP = Edit(
    ACTUATOR,
    "if self._period_s > 0.0 and self.in_motion and silent_s > self._longest_gap_s and not self.broken_off:",
    "if False:",
)
UNMEASURED = Edit(
    ACTUATOR, "if self.broken_off or self.silent_s > self._regular_s > 0.0:", "if False:"
)
UNGUARDED = Edit(
    ACTUATOR,
    "        setpoint = self._guard.reachable(setpoint, now_s, self._fastest_m_s, braking=braking)\n",
    "        pass\n",
)

MOTION: dict[str, tuple[Edit, ...]] = {
    # The plan
    "stopping-distance": (
        Edit("rig/matrix/feasibility.py", "if travel_fits and not within(reached, room_m):", "if False:"),
        Edit(
            "rig/matrix/feasibility.py",
            "    return within(stopping_reach(point, matrix, bench), command_room(matrix, bench)[:2])\n",
            "    return True\n",
        ),
        Edit(
            "rig/station/motion_start.py",
            '    refuse_beyond(travel_extents(whole, config.limits), "the motion", ROUNDING)\n', "    pass\n",
        ),
    ),
    # Streamed set-points
    "setpoints-by-clock": (NO_GAP, UNMEASURED, UNGUARDED),
    "gap-ends-nothing": (NO_GAP,),
    "halt-by-clock": (
        Edit(
            ACTUATOR, "self._source.halt_from(rod, now_s)", "self._source.halt_from(self._source.at(now_s), now_s)"
        ),
        UNGUARDED,
    ),
    "fade-by-clock": (NO_GAP, UNGUARDED),
    "rod-not-measured": (UNMEASURED,),
    "old-measurement": (
        Edit(ACTUATOR, "if old_s > self._regular_s > 0.0 and abs(rod.velocity_m_s) * old_s > RESTS_M:", "if False:"),
    ),
    "counted-as-taken": (Edit(ACTUATOR, "        return not self._lost\n", "        return True\n"),),
    "fades-nothing": (Edit(ACTUATOR, "            self._source.fade(now_s)\n", "            pass\n"),),
    # The end
    "pressure-assumed": (
        Edit("rig/campaign/sequencer/stopping.py", "if promised_off or cause.slug in PRESSURE_STAYS:", "if False:"),
    ),
}

"""The motion without one of its safeguards each: plan, streamed set-points, and what is promised of the pressure."""

from __future__ import annotations

from edits import Edit

ACTUATOR = "drivers/streamed_actuator.py"
GUARD = "drivers/setpoint_guard.py"
GENERATOR = "drivers/setpoint_generator.py"

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
            '    refuse_beyond(travel_extents(whole, config.limits), "the motion is", ROUNDING)\n', "    pass\n",
        ),
    ),
    # The end
    "pressure-assumed": (
        Edit("rig/campaign/sequencer/stopping.py", "if cause.slug in PRESSURE_STAYS:", "if False:"),
    ),
}

"""The station without one of its safeguards each.

Not here, because another one does the same and no world shows the difference: the refusal of a second motion command
after a trip (the application asks for none), the commands' watch without the program's count of cycles, the comparison
of currents (the safe stop and the file judge them too), samples lost or not a number (the file finds them itself), the
stop's acknowledgement, the controller's own limits of stroke, speed and force (the station judges its samples).
"""

from __future__ import annotations

from edits import Edit, deaf_station

SUPERVISOR = "rig/station/supervisor.py"
STOP = "rig/station/safe_stop.py"
ACTUATOR = "rig/station/threads/actuator_thread.py"
LINK_FAULTS = "rig/station/interlocks/link_faults.py"
SENSOR = "rig/station/threads/sensor_thread.py"
CONTROLLER = "rig/station/interlocks/actuator_interlock.py"
MOTION = "rig/station/interlocks/motion_interlock.py"
CURRENT = "rig/station/interlocks/current_interlock.py"
CHANNEL = "rig/station/interlocks/channel_interlock.py"
REQUESTS = "rig/station/requests.py"
PREPARATION = "rig/station/preparation.py"

UNWATCHED = Edit(
    CONTROLLER, "        findings = self._command(status, sent)\n", "        return []\n        findings = []\n"
)


SAFEGUARDS: dict[str, tuple[Edit, ...]] = {
    # What the controller says
    "lease": (
        Edit(CONTROLLER, "if status.owner not in {0, self.owner_id}:", "if False:"),
        UNWATCHED,
    ),
    "echo": (Edit(LINK_FAULTS, "if self._missing < CONSECUTIVE:", "if True:"),),
    "e-stop-bit": (deaf_station("estop"),),
    "controller-silent": (deaf_station("modbus-halfopen", "modbus-reset"),),
    "controller-busy": (deaf_station("modbus-busy", "modbus-reject"),),
    "controller-boots": (deaf_station("actuator-reboot"),),
    "position-frozen": (
        Edit(CONTROLLER, "if self._repeats >= FROZEN_POLLS:", "if False:"),
        Edit(CONTROLLER, "if self._apart >= 2 * CONSECUTIVE:", "if False:"),
    ),
    "overrun": (
        Edit(
            CONTROLLER, "elif self.clock_s - self._program_began_s > self._program_s + self._overrun_s():",
            "elif False:",
        ),
        Edit(CONTROLLER, "if self._restless >= 4 * CONSECUTIVE:", "if False:"),
    ),
    # What the ECU says
    "ecu-faults": (Edit(CURRENT, "if faults & bits\n", "if False\n"),),
    "ecu-counter": (
        Edit(CURRENT, "if counted.bad_in_a_row > 0 and (", "if False and ("),
        Edit(CURRENT, "if not counted.bad_in_a_row:", "if True:"),
    ),
    "ecu-silent": (deaf_station("ecu-silent", "can-busoff", "can-lost"),),
    "foreign-frames": (Edit(CURRENT, "if counted.foreign_commands > self._other_commands:", "if False:"),),
    "bus-load": (Edit(CURRENT, "if share <= FULL_BUS:", "if True:"),),
    # What the sensors say
    "sensor-silent": (
        Edit(SENSOR, "            self._supervisor.report([replace(finding, detail=detail)])\n", "            pass\n"),
        deaf_station("loadcell-pulled", "lvdt-pulled"),
    ),
    "sensor-stuck": (Edit(SENSOR, "if self._is_stuck():", "if False:"),),
    "sensor-saturated": (Edit(CHANNEL, "if self._saturated >= CONSECUTIVE:", "if False:"),),
    "sensor-spikes": (
        Edit(CHANNEL, "if not flags & Quality.GAP_BEFORE and abs(value", "if False and abs(value"),
    ),
    "damaged-frames": (
        Edit("rig/station/interlocks/line_interlock.py", "        if not damaged:\n", "        if True:\n"),
        deaf_station("serial-baud"),
    ),
    # The bench's limits
    "stroke-limit": (Edit(CHANNEL, "        if low <= value <= high:\n", "        if True:\n"),),
    "speed-limit": (Edit(MOTION, "if self._over >= CONSECUTIVE:", "if False:"),),
    "force-limit": (deaf_station("force-limit"),),
    "acceleration-limit": (
        Edit("rig/bench/controller_limits.py", "=limits.acceleration_m_s2,", "=2.0 * limits.acceleration_m_s2,"),
    ),
    "current-limit": (Edit(CURRENT, "if abs(status.current_A) > self.current_limit_A:", "if False:"),),
    "coil-temperature": (Edit(CURRENT, "if temperature.coil_degC > limit:", "if False:"),),
    "positions-compared": (Edit(CONTROLLER, "if self._apart >= 2 * CONSECUTIVE:", "if False:"),),
    # The stop
    "standstill-proved": (
        Edit(
            STOP, "    if inputs.still_s is None:\n        return stop.position_trusted and",
            "    if True:\n        return True or",
        ),
    ),
    "place-held": (
        Edit(STOP, "return (held and inputs.left_place) or (seen and not resting)", "return seen and not resting"),
        Edit(CONTROLLER, "if self._apart >= 2 * CONSECUTIVE:", "if False:"),
        Edit(CONTROLLER, "if self._restless >= 4 * CONSECUTIVE:", "if False:"),
    ),
    "current-proved": (
        Edit(
            STOP, "if inputs.current_A is not None and abs(inputs.current_A) < ZERO_CURRENT_A:",
            "if inputs.current_A is not None:",
        ),
    ),
    "pressure-off-after-s1": (
        Edit(
            STOP, "        if stop.kind is StopKind.PRESSURE_OFF:\n            return",
            "        if False:\n            return",
        ),
    ),
    "stop-ignored": (Edit(STOP, "    if _late(stop, inputs):\n", "    if False:\n"),),
    "zero-at-once": (
        Edit(SUPERVISOR, "                self._coil.zero_now()\n", "                pass\n"),
    ),
    "stop-sent": (Edit(SUPERVISOR, "            self._motion.act(action)\n", "            pass\n"),),
    # Who watches the watchers
    "link-ends": (Edit(SUPERVISOR, "        self._application_gone = True\n", "        return\n"),),
    "pressure-off-at-the-end": (
        Edit(SUPERVISOR, "elif self._application_gone and before.kind is not StopKind.PRESSURE_OFF:", "elif False:"),
    ),
    "end-waits-for-the-stop": (
        Edit(
            "rig/station/process.py",
            "            wait_for(supervisor.changed, lambda: supervisor.ended_for_good, END_TIMEOUT_S)\n",
            "            pass\n",
        ),
    ),
    "pressure-off-at-disarm": (
        Edit(REQUESTS, '        self._hydraulics({"level": "off"})\n        self._supervisor.disarm()\n',
             "        self._supervisor.disarm()\n"),
    ),
    "heartbeat": (deaf_station("host-stalled"),),
    "own-lateness": (deaf_station("host-late", "host-silent"),),
    "watchdog-fed": (
        Edit(SUPERVISOR, "if not self._armed or self._starving or now_ns - self.tick_ns > STALLED_NS:", "if True:"),
    ),
    "watchdog-proved": (
        Edit(PREPARATION, "            if tripped is None:\n", "            if False:\n"),
        Edit(PREPARATION, "(tripped.received_ns - begin_ns) / 1e9", "0.0"),
    ),
}

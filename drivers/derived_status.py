"""Status of an actuator that its registers do not show, derived from commands and time: answer, cycles, speed.

A device that shows only "moving" runs a program, fades out or halts, depending on the last command. Pure: time and
values are arguments.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from drivers.register_maps.controller_map import CLOCK_MODULUS, ControllerMap
from drivers.register_maps.quantity import FLOATS, Quantity, Value
from drivers.roles import ActuatorStatus, Command, Program, Result, State

SPEED_SHARE = 0.5
"""Of a speed that is a difference of positions: so much of each new one counts."""
WHOLE_CYCLES_S = 0.15
"""A program that ended so much before its time by the polls has ended with its last cycle."""
MOTIONS = {
    Command.MOVE_TO: State.MOVING, Command.START: State.RUNNING, Command.FADE_STOP: State.FADING,
    Command.HALT: State.HALTING,
}  # fmt: skip
MOVING_STATES = frozenset({State.MOVING, State.RUNNING})


class DerivedStatus:
    """Derives the missing status of one device.

    Args:
        controller: its map.
        answered: the driver says whether a command was taken; the device itself does not.
        rate: device seconds that pass in one second of the host's clock.

    Attributes:
        answer: number, command and result of the last command, where the device shows none.
    """

    def __init__(self, controller: ControllerMap, *, answered: bool, rate: float = 1.0) -> None:
        self._rate = rate
        self._map = controller
        self._answered = answered
        self.answer: tuple[int, int, int] = (0, 0, Result.IDLE)
        self._motion = State.HOLD
        self._program: Program | None = None
        self._program_id = 0
        self._began_s = math.nan
        self._cycles = 0
        self._before: tuple[float, float] | None = None
        self._speed_m_s = 0.0
        self._clocks: dict[str, tuple[float, float]] = {}

    def sent(self, command: Command, sequence: int, program: Program | None) -> None:
        """A command was written."""
        if command in MOTIONS:
            self._motion = MOTIONS[command]
        if command is Command.START:
            self._program, self._program_id, self._began_s, self._cycles = program, sequence, math.nan, 0

    def knows(self, values: Mapping[str, Value], received_ns: int) -> dict[str, Value]:
        """What the device does not show, by the names of the status.

        Args:
            values: what it shows (SI).
            received_ns: when it was shown, host time.
        """
        now_s = received_ns * 1e-9 * self._rate
        known: dict[str, Value] = {"clock_us": int(now_s * 1e6) % CLOCK_MODULUS}
        if "velocity" not in values:
            known["velocity"] = self._speed(float(values["position"]), now_s)
        if self._answered:
            known["acked_sequence"], known["acked_command"], known["result"] = self.answer
        return known

    def unwrapped(self, values: Mapping[str, Value]) -> dict[str, Value]:
        """The device's clocks where they wrap sooner than 2^32 us: made to go on (s)."""
        result: dict[str, Value] = {}
        for name in ("clock", "pulse_clock"):
            quantity = self._map.quantities.get(name)
            if quantity is not None and name in values and not _wide(quantity):
                shown_s = float(values[name])
                before_s, total_s = self._clocks.get(name, (shown_s, shown_s))
                total_s += (shown_s - before_s) % _range_s(quantity)
                self._clocks[name] = (shown_s, total_s)
                result[name] = total_s
        return result

    def completed(self, status: ActuatorStatus) -> ActuatorStatus:
        """The status with what follows from the last command: which motion it is, which program, its cycles."""
        state = status.state
        known = self._map.words.states.known
        if state in MOVING_STATES and self._motion not in known and self._motion is not State.HOLD:
            state = self._motion
        changes: dict[str, int] = {"state": int(state)}
        running = state in {State.RUNNING, State.FADING}
        if "program_id" not in self._map.quantities and not self._map.capabilities.streamed_setpoints:
            changes["program_id"] = self._program_id if running else 0
        if "cycles_done" not in self._map.quantities and self._program is not None:
            changes["cycles_done"] = self._count(state, status.received_ns * 1e-9 * self._rate, self._program)
        return status._replace(**changes)

    def _count(self, state: int, now_s: float, program: Program) -> int:
        """Cycles by the time (device s) since the program was first seen to run, ramps included."""
        if state == State.RUNNING:
            if math.isnan(self._began_s):
                self._began_s = now_s
            self._cycles = math.floor(min((now_s - self._began_s) * program.frequency_Hz, program.all_cycles) + 1e-9)
        elif not math.isnan(self._began_s):
            ran_s = now_s - self._began_s
            if state == State.HOLD and ran_s > program.all_cycles / program.frequency_Hz - WHOLE_CYCLES_S:
                self._cycles = math.floor(program.all_cycles + 1e-9)
            self._began_s = math.nan
        return self._cycles

    def _speed(self, position_m: float, now_s: float) -> float:
        """The difference of positions over time, smoothed (m/s)."""
        before, self._before = self._before, (now_s, position_m)
        if before is None or now_s <= before[0]:
            return self._speed_m_s
        speed_m_s = (position_m - before[1]) / (now_s - before[0])
        self._speed_m_s += SPEED_SHARE * (speed_m_s - self._speed_m_s)
        return self._speed_m_s


def _range_s(clock: Quantity) -> float:
    """After how long a clock begins again (s)."""
    return math.inf if clock.type in FLOATS else clock.step * clock.numbers


def _wide(clock: Quantity) -> bool:
    """It goes on for as long as the rig's own count: whole microseconds of 32 bits, or begins again never."""
    range_s = _range_s(clock)
    return math.isinf(range_s) or abs(range_s - CLOCK_MODULUS * 1e-6) < 1.0

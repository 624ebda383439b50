"""The actuator controller: its registers, commands, states, lease and watchdog. No sockets.

It lets the plant's compiled loop generate the motion and watch the limits; this class decides what may be asked.

    OFF --LOW--> LOW --ON--> HOLD --MOVE_TO--> MOVING --> HOLD          any --HALT--> HALTING --> HOLD (locked)
                                  --START----> RUNNING -> HOLD          RUNNING --FADE_STOP--> FADING --> HOLD
    a limit, the watchdog, the e-stop: TRIPPED (latched; the stop runs its course) --RESET--> what the hydraulics allow
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from drivers.roles import ActuatorLimits, Command, FaultBit, Result, State, WatchdogAction, Waveform
from simulators.clock import DeviceClock
from simulators.options import ControllerOptions
from simulators.plant import records
from simulators.plant.plant import TABLE_CAPACITY, Plant
from simulators.program import FLOAT_SLACK, Values, read_program, within_limits

MODE_STATES = {
    records.MODE_OFF: State.OFF,
    records.MODE_HOLD: State.HOLD,
    records.MODE_MOVE: State.MOVING,
    records.MODE_PROGRAM: State.RUNNING,
    records.MODE_FADE: State.FADING,
    records.MODE_STOP: State.FADING,
    records.MODE_HALT: State.HALTING,
    records.MODE_LOCKED: State.HOLD,
    records.MODE_FOLLOW: State.MOVING,
}
FOLLOWS = {records.MODE_HOLD, records.MODE_LOCKED, records.MODE_FOLLOW}
RESTING = {State.OFF, State.LOW, State.HOLD}
WITHOUT_LEASE = {Command.ACQUIRE, Command.FADE_STOP, Command.HALT, Command.HYDRAULICS_OFF}
OFF_CENTRE_M = 2e-3
GENERATED = {Command.MOVE_TO, Command.START, Command.FADE_STOP}
SHORTEST_LEASE_S = 2.0
ENDLESS_CYCLES = 1e6


@dataclass
class ActuatorFaults:
    """What is broken in the controller; all false on a healthy one."""

    position_frozen: bool = False
    stop_ignored: bool = False
    watchdog_absent: bool = False
    setpoints_lost: bool = False
    """Set-points are acknowledged and not followed."""
    e_stop_open: bool = False
    pressure_stays: bool = False
    """The order to take the pressure away is acknowledged, and the valve stays open."""


class Actuator:
    """The controller's logic over the plant.

    Attributes:
        faults: switches of the fault injectors.
        log: called with (command name, result name) for every executed command, for the truth file.
    """

    def __init__(
        self,
        plant: Plant,
        options: ControllerOptions,
        clock: DeviceClock,
        log: Callable[[str, str], None],
    ) -> None:
        self.plant = plant
        self.clock = clock
        self.faults = ActuatorFaults()
        self.log = log
        self.options = options
        self.boot_count = options.boot_count
        self.pulse_clock_us = 0
        self.served_s = 0.0
        self.taken: Callable[[float, float], None] = lambda *_: None
        """Called with position (m) and velocity (m/s) of each streamed set-point that is taken."""
        self.arrival_s: Callable[[], float] = lambda: plant.time_s
        """Simulated time at which a request that is being served has arrived (s)."""
        self.turned_s: float | None = None
        """When the streamed set-points first turned round without a rest (simulated s): a cyclic motion has begun."""
        self._actions: dict[Command, Callable[[Values], Result]] = {
            Command.ACQUIRE: self._acquire,
            Command.RELEASE: self._release,
            Command.HYDRAULICS_LOW: self._hydraulics_low,
            Command.HYDRAULICS_ON: self._hydraulics_on,
            Command.HYDRAULICS_OFF: self._hydraulics_off,
            Command.MOVE_TO: self._move_to,
            Command.START: self._start,
            Command.FADE_STOP: self._fade_stop,
            Command.HALT: self._halt,
            Command.RESET: self._reset,
        }
        self.boot()

    def boot(self) -> None:
        """Start with defaults: no lease, no program, hydraulics off."""
        options = self.options
        self.owner = 0
        self.sequence = 0
        self.result = Result.IDLE
        self._leased_s = 0.0
        self.acked_command = 0
        self.program_id = 0
        self.watchdog_echo = 0
        self._fed_s = math.nan
        self.watchdog_pressure = 0
        self._own_faults = 0
        self.limits = ActuatorLimits(
            -options.position_limit_m, options.position_limit_m, options.speed_max_m_s, options.acceleration_max_m_s2,
            options.force_max_N, options.fade_out_cycles, options.halt_deceleration_m_s2, options.watchdog_ms,
            WatchdogAction.FADE_AND_HOLD,
        )
        self.plant.state["tripped"] = 0
        self.plant.state["fault_bits"] = 0
        self.plant.order(mode=records.MODE_OFF, pressure=0)
        self.order_limits()

    @property
    def state(self) -> State:
        """The state as the register shows it."""
        if self.tripped:
            return State.TRIPPED
        return self.motion_state

    @property
    def motion_state(self) -> State:
        """What the rod is being told to do, also while TRIPPED is latched."""
        state = MODE_STATES[int(self.plant.command["mode"][0])]
        low = int(self.plant.command["pressure"][0]) == 1
        return State.LOW if low and state is State.HOLD else state

    @property
    def tripped(self) -> bool:
        """Whether a fault is latched."""
        return bool(self.plant.state["tripped"][0])

    @property
    def fault_bits(self) -> int:
        """Latched `FaultBit`s."""
        return int(self.plant.state["fault_bits"][0]) | self._own_faults

    @property
    def seen_m(self) -> float:
        """The piston's position as the position loop sees it (m): the sensor's gain and zero, no filter."""
        shown = self.plant.position_input
        return shown.options.gain * self.plant.value("position_m") + shown.zero

    def tick(self, served_s: float) -> None:
        """Judge the watchdog and the e-stop; `served_s` is wall time in which this rig was running (s)."""
        self.served_s = served_s
        if self.faults.e_stop_open and not self._own_faults & FaultBit.E_STOP:
            self.trip(FaultBit.E_STOP)
            self.plant.order(mode=records.MODE_OFF, pressure=0)
        if self.watchdog_starved and not self._own_faults & FaultBit.WATCHDOG:
            action = self.limits.watchdog_action
            if action == WatchdogAction.FADE_AND_HOLD:
                self._stop_motion()
                self.trip(FaultBit.WATCHDOG)
            elif action == WatchdogAction.FREEZE:
                self.trip(FaultBit.WATCHDOG)

    @property
    def watchdog_starved(self) -> bool:
        """Whether a lease holder has fed the watchdog once and then not for `watchdog_ms` of wall time."""
        if self.faults.watchdog_absent or self.limits.watchdog_ms == 0 or math.isnan(self._fed_s):
            return False
        if int(self.plant.command["pressure"][0]) < self.watchdog_pressure:
            self._fed_s = math.nan  # it is inactive, and restarts with the next feed
            return False
        return self.served_s - self._fed_s > self.limits.watchdog_ms * 1e-3

    def trip(self, bit: FaultBit) -> None:
        """Latch a fault of the controller itself."""
        self._own_faults |= bit
        self.plant.state["tripped"] = 1
        self.log("TRIP", bit.name or str(bit))

    def pulsed(self, time_s: float) -> None:
        """Latch the own clock at a cycle pulse (simulated time, s)."""
        self.pulse_clock_us = self.clock.wrapped_us(time_s)

    def feed(self, counter: int) -> None:
        """The host wrote the watchdog counter; only a changed value feeds."""
        if counter != self.watchdog_echo:
            self.watchdog_echo = counter
            if self.owner:
                self._fed_s = self.served_s

    def configure(self, limits: ActuatorLimits) -> bool:
        """Take new limits; False and unchanged when they make no sense or the rod moves."""
        numbers = (
            limits.position_min_m, limits.position_max_m, limits.speed_max_m_s, limits.acceleration_max_m_s2,
            limits.force_max_N, limits.fade_out_cycles, limits.halt_deceleration_m_s2,
        )
        sane = all(math.isfinite(number) for number in numbers) and all(number > 0 for number in numbers[2:])
        sane = sane and limits.position_min_m < limits.position_max_m and limits.fade_out_cycles >= 1.0
        sane = sane and limits.watchdog_action in set(WatchdogAction)
        if not sane or self.motion_state not in RESTING:
            return False
        self.limits = limits
        self.order_limits()
        return True

    def follow(self, position_m: float, velocity_m_s: float | None, within_s: float = 0.0) -> None:
        """Take a streamed set-point (m, m/s); one that makes no sense, or while the rod is not held, moves nothing.

        The device goes on from there at that speed, for `FOLLOW_S`. A set-point that comes without a speed is reached
        in a line from the present one within `within_s`, without a step, and held. After a halt the valve opens again
        only for a set-point close to where the rod is.
        """
        mode, arrival_s = self.plant.command["mode"][0], self.arrival_s()
        target_m, before_m_s, before_s, before_follow_s = self._followed(mode == records.MODE_FOLLOW)
        from_m, follow_s = position_m, records.FOLLOW_S
        if velocity_m_s is None:
            from_m, follow_s = target_m + before_m_s * min(arrival_s - before_s, before_follow_s), within_s
            velocity_m_s = (position_m - from_m) / within_s
        limits, off_m = self.limits, abs(position_m - self.seen_m) if mode == records.MODE_LOCKED else 0.0
        sane = limits.position_min_m <= position_m <= limits.position_max_m and off_m <= OFF_CENTRE_M
        sane = sane and abs(velocity_m_s) <= limits.speed_max_m_s * FLOAT_SLACK
        if not sane or self.tripped or mode not in FOLLOWS or self.motion_state is State.LOW:
            return
        if self.faults.setpoints_lost:
            return
        if before_m_s * velocity_m_s < 0.0 and self.turned_s is None:
            self.turned_s = self.plant.time_s
        self._unlock()
        self.plant.order(
            before_m=target_m, before_m_s=before_m_s, before_s=before_s, before_follow_s=before_follow_s,
            target_m=from_m, move_speed_m_s=velocity_m_s, told_s=arrival_s, follow_s=follow_s,
        )
        if velocity_m_s == 0.0:
            self.plant.state["setpoint_m"], self.plant.state["setpoint_velocity_m_s"] = position_m, 0.0
        self.plant.order(mode=records.MODE_FOLLOW if velocity_m_s != 0.0 else records.MODE_HOLD)
        self.taken(position_m, velocity_m_s)

    def _followed(self, follows: bool) -> tuple[float, float, float, float]:
        """The set-point that is followed, or held: m, m/s, when it came and for how long it goes on (s)."""
        if not follows:
            return float(self.plant.state["setpoint_m"][0]), 0.0, self.plant.time_s, 0.0
        target, speed, reported, longest = (
            float(self.plant.command[name][0]) for name in ("target_m", "move_speed_m_s", "told_s", "follow_s")
        )
        return target, speed, reported, longest

    def write_table(self, index: int, samples: Sequence[float]) -> bool:
        """Put samples of a table waveform in (m about the centre), from the number `index` on.

        Returns:
            False when they do not fit, are not finite, or a program runs.
        """
        end = index + len(samples)
        finite = all(math.isfinite(sample) for sample in samples)
        if end > TABLE_CAPACITY or not finite or self.motion_state is State.RUNNING:
            return False
        table = np.zeros(max(len(self.plant.table), end))
        table[: len(self.plant.table)] = self.plant.table
        table[index:end] = samples
        self.plant.table = table
        return True

    def refuse(self, sequence: int, command: int) -> None:
        """Answer a command that this controller does not have, once for each new sequence number."""
        if sequence not in {0, self.sequence}:
            self.sequence, self.acked_command, self.result = sequence, command, Result.REFUSED_VALUE
            known = command in set(Command)
            self.log(Command(command).name if known else f"COMMAND_{command}", self.result.name)

    def execute(self, values: Values) -> None:
        """Execute a command once for each new sequence number; the status repeats the number, with the result."""
        sequence = int(values["sequence"])
        if sequence in {0, self.sequence}:
            return
        command = Command(int(values["command"]))
        self.sequence, self.acked_command = sequence, int(command)
        action = self._actions.get(command)
        if action is None or (command in GENERATED and not self.options.generator):
            self.result = Result.REFUSED_VALUE
        elif command not in WITHOUT_LEASE and int(values["owner_id"]) != self.owner:
            self.result = Result.REFUSED_OWNER
        else:
            self.result = action(values)
        self.log(command.name, self.result.name)

    def _acquire(self, values: Values) -> Result:
        owner = int(values["owner_id"])
        if owner == 0:
            return Result.REFUSED_VALUE
        if self.owner not in {0, owner} and not self._lease_expired:
            return Result.REFUSED_OWNER
        self.owner = owner
        self._fed_s = math.nan
        self._leased_s = self.served_s
        return Result.DONE

    @property
    def _lease_expired(self) -> bool:
        """A holder that stopped feeding, or never began, may be replaced."""
        fed_s = self._leased_s if math.isnan(self._fed_s) else self._fed_s
        return self.served_s - fed_s > max(SHORTEST_LEASE_S, 2e-3 * self.limits.watchdog_ms)

    def _release(self, values: Values) -> Result:
        del values
        self.owner = 0
        self._fed_s = math.nan
        return Result.DONE

    def _hydraulics_low(self, values: Values) -> Result:
        del values
        if self.tripped or self.faults.e_stop_open or self.motion_state not in RESTING:
            return Result.REFUSED_STATE
        self._pressurise(1)
        return Result.DONE

    def _hydraulics_on(self, values: Values) -> Result:
        del values
        if self.tripped or self.faults.e_stop_open or self.motion_state not in {State.LOW, State.HOLD}:
            return Result.REFUSED_STATE
        self._pressurise(2)
        return Result.DONE

    def _pressurise(self, level: int) -> None:
        """Hold the rod where it is, under low (1) or full (2) pressure."""
        if int(self.plant.command["mode"][0]) != records.MODE_HOLD:
            self.plant.state["setpoint_m"] = self.seen_m
        self.plant.order(mode=records.MODE_HOLD, pressure=level)

    def _hydraulics_off(self, values: Values) -> Result:
        del values
        if not self.faults.pressure_stays:
            self.plant.order(mode=records.MODE_OFF, pressure=0)
        return Result.DONE

    def _move_to(self, values: Values) -> Result:
        target_m, speed_m_s = float(values["target_position"]), float(values["speed"])
        if self.state is not State.HOLD:
            return Result.REFUSED_STATE
        if not (math.isfinite(target_m) and math.isfinite(speed_m_s) and speed_m_s > 0):
            return Result.REFUSED_VALUE
        within = self.limits.position_min_m <= target_m <= self.limits.position_max_m
        if not within or speed_m_s > self.limits.speed_max_m_s * FLOAT_SLACK:
            return Result.REFUSED_LIMIT
        self._unlock()
        self.plant.order(target_m=target_m, move_speed_m_s=speed_m_s, mode=records.MODE_MOVE)
        return Result.DONE

    def _start(self, values: Values) -> Result:
        if self.state is not State.HOLD:
            return Result.REFUSED_STATE
        table = self.plant.table[: max(1, int(values["table_length"]))]
        program = read_program(values, table)
        if program is None or abs(self.seen_m - program["centre_m"]) > OFF_CENTRE_M:
            return Result.REFUSED_VALUE
        if not within_limits(program, table, self.limits):
            return Result.REFUSED_LIMIT
        self._unlock()
        if program["waveform"] == Waveform.TABLE:
            self.plant.table = table.copy()
        for name in ("program_step", "phase_cycles", "cycles_done"):
            self.plant.state[name] = 0
        if self.faults.stop_ignored:
            program["full_cycles"] = ENDLESS_CYCLES
        self.plant.order(**program, mode=records.MODE_PROGRAM)
        self.program_id = self.sequence
        return Result.DONE

    def _fade_stop(self, values: Values) -> Result:
        del values
        if not self.faults.stop_ignored:
            self._stop_motion()
        return Result.DONE

    def _halt(self, values: Values) -> Result:
        del values
        if not self.faults.stop_ignored and self.motion_state in {State.MOVING, State.RUNNING, State.FADING}:
            self.plant.order(mode=records.MODE_HALT)
        return Result.DONE

    def _reset(self, values: Values) -> Result:
        del values
        if self.motion_state not in RESTING or self.faults.e_stop_open:
            return Result.REFUSED_STATE
        self._own_faults = 0
        self.plant.state["fault_bits"] = 0
        self.plant.state["tripped"] = 0
        if not math.isnan(self._fed_s):
            self._fed_s = self.served_s
        return Result.DONE

    def stop_at_panel(self) -> None:
        """End the motion as a key at the device does: fade a program out, halt one that follows set-points."""
        if self.options.generator:
            self._stop_motion()
        else:
            self.plant.order(mode=records.MODE_HALT)

    def _stop_motion(self) -> None:
        """Fade the program out, or bring a move to rest."""
        state, command = self.plant.state, self.plant.command
        if self.motion_state is State.RUNNING:
            phase = float(state["phase_cycles"][0])
            total = float(sum(command[name][0] for name in ("ramp_in_cycles", "full_cycles", "ramp_out_cycles")))
            share = min(1.0, phase / r) if (r := float(command["ramp_in_cycles"][0])) > 0 else 1.0
            if (r := float(command["ramp_out_cycles"][0])) > 0:
                share = min(share, (total - phase) / r)
            state["fade_from_cycles"] = phase
            state["fade_envelope"] = max(share, 0.0)
            self.plant.order(mode=records.MODE_FADE)
        elif self.motion_state is State.MOVING:
            self.plant.order(mode=records.MODE_STOP)

    def _unlock(self) -> None:
        """Leave a closed valve: the set-point starts where the rod is."""
        if int(self.plant.command["mode"][0]) == records.MODE_LOCKED:
            self.plant.state["setpoint_m"] = self.seen_m

    def order_limits(self) -> None:
        """Have the plant watch the limits that the host has written."""
        limits = self.limits
        self.plant.order(
            position_min_m=limits.position_min_m,
            position_max_m=limits.position_max_m,
            speed_max_m_s=limits.speed_max_m_s,
            acceleration_max_m_s2=limits.acceleration_max_m_s2,
            force_max_N=limits.force_max_N,
            fade_cycles=max(1.0, limits.fade_out_cycles),
            halt_deceleration_m_s2=limits.halt_deceleration_m_s2,
        )

"""What the application may ask for; each answer comes after the thing asked for is proved, not merely sent.

    connect                                          open everything, prove identities, measure rates
    examine                                          the same, but what is wrong with one device hides no other's;
                                                     nothing can be armed unless all is well
    arm                                              lease, limits written and read back, 0 A frames, interlocks on
    starve_watchdog                                  prove that the controller trips when it is not fed
    hydraulics   level=off|low|on
    move         target_m, speed_m_s
    set_current  current_A
    start        waveform, amplitude_m, frequency_Hz, centre_m, cycles, ramp_in_cycles, ramp_out_cycles[, table];
                 or hybrid (a hybrid test), or signal (a motion without cycles, sample by sample); cycles and signal
                 also with current (current steps during the motion: time_s, current_A)
    stop         kind=S2|S1|SO, reason[, detail]
    reset                                            after a stop, at standstill and 0 A, with no fault left
    disarm                                           0 A, hydraulics off, lease given back
    status, shutdown

A refusal carries a slug; motion is refused with `tripped` while a trip is latched.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict

from drivers.capabilities import PRESSURE_LEVELS
from drivers.errors import DriverError, RequestRefused
from drivers.roles import ActuatorStatus, Command, Move, State, state_name
from rig.bench.settings import StationConfig
from rig.clock import monotonic_ns, wait_for
from rig.faults.row import StopKind
from rig.signals.stopping import Reach, halted_m
from rig.station.command_channel import ACK_TIMEOUT_S, CommandChannel
from rig.station.current_program import CurrentSteps, current_program
from rig.station.errors import StationRefused
from rig.station.examination import NOTHING_STOPS_IT, examine
from rig.station.hybrid_source import start_hybrid
from rig.station.interlocks.finding import Finding
from rig.station.interlocks.link_faults import link_slug
from rig.station.interlocks.motion_interlock import SPEED_WINDOW_S
from rig.station.motion_start import (
    ROUNDING,
    Answer,
    Arguments,
    number,
    refuse_beyond,
    start_cycles,
    travel_extents,
)
from rig.station.origins import stated_origins
from rig.station.preparation import Preparation
from rig.station.safe_stop import STILL_S, Movement, SafeStop
from rig.station.signal_source import start_signal
from rig.station.supervisor import Supervisor
from rig.station.threads.devices import Devices, slug_of

HYDRAULICS_TIMEOUT_S = 10.0
OFF_AGAIN_S, OFF_REPEATS = 1.0, 3
PRESSURE_STAYS = "hydraulics"
"""The slug of a pressure that does not become what was ordered, although the controller took the order."""
STOP_TIMEOUT_S = 60.0
REST_PATIENCE_S = 0.5
LONGEST_REST_S = 4.0
QUIET_NS = 250_000_000
"""So long nothing that stops the rig may have been found before a trip is forgotten ..."""
QUIET_PATIENCE_NS = 2_000_000_000
"""... which is waited for so long."""
ACTUATOR = "actuator"
BEFORE = frozenset({"connect", "examine", "status"})
"""What may be asked for before the devices are connected."""


class Requests:
    """Carries requests out on the thread that calls `handle`."""

    def __init__(self, config: StationConfig, supervisor: Supervisor, devices: Devices) -> None:
        self._config = config
        self._supervisor = supervisor
        self._devices = devices
        self._commands = CommandChannel(devices.actuator, supervisor)
        self._preparation = Preparation(config, supervisor, devices, self._commands)
        self._connected = False
        self._table: dict[str, Callable[[Arguments], Answer]] = {
            "connect": self._connect,
            "examine": self._examine,
            "arm": self._arm,
            "starve_watchdog": self._starve_watchdog,
            "hydraulics": self._hydraulics,
            "move": self._move,
            "set_current": self._set_current,
            "start": self._start,
            "stop": self._stop,
            "reset": self._reset,
            "disarm": self._disarm,
            "status": self._status,
        }

    @property
    def connected(self) -> bool:
        """The ports are open and the threads run."""
        return self._connected

    def handle(self, do: str, arguments: Arguments) -> Answer:
        """Carry out one request.

        Args:
            do: its name.
            arguments: its arguments, SI.

        Returns:
            The answer's results.

        Raises:
            StationRefused: it was not done, or could not be proved.
        """
        handler = self._table.get(do)
        if handler is None:
            raise StationRefused("bad-request", f"unknown request {do!r}; known requests: {', '.join(self._table)}, "
                "shutdown")
        if not self._connected and do not in BEFORE:
            raise StationRefused("not-connected", f"{do}: the devices are not connected")
        try:
            return handler(arguments)
        except RequestRefused as error:
            slug = link_slug(error, self._devices.actuator.link_kind)
            self._supervisor.report([Finding(slug, str(error), monotonic_ns())])
            raise StationRefused(slug, str(error)) from error
        except DriverError as error:
            in_operation = self._supervisor.armed and error.device == ACTUATOR
            slug = link_slug(error, self._devices.actuator.link_kind) if in_operation else slug_of(error)
            raise StationRefused(slug, str(error)) from error
        except TimeoutError as error:
            raise StationRefused("modbus-halfopen", f"{do}: the controller thread did not answer in time") from error

    # Before motion

    def _examine(self, arguments: Arguments) -> Answer:
        del arguments
        if self._connected:
            raise StationRefused("bad-request", "examine: already connected")
        answer = examine(self._devices, self._preparation)
        self._connected = answer.all_well
        return asdict(answer)

    def _connect(self, arguments: Arguments) -> Answer:
        del arguments
        if self._connected:
            raise StationRefused("bad-request", "connect: already connected")
        capabilities = self._devices.actuator.capabilities
        if not capabilities.can_be_stopped:
            raise StationRefused("watchdog-absent", NOTHING_STOPS_IT)
        self._devices.open()
        try:
            self._devices.start()
            self._connected = True
            answer = self._preparation.prove_devices()
            answer["channels"] = stated_origins((self._devices.actuator.origins, self._devices.coil.origins))
        except BaseException:
            self._connected = False
            self._devices.close()
            raise
        for name, without in capabilities.lacking():
            self._supervisor.warn(f"actuator-without-{name}", without)
        for name, without in self._devices.coil.lacking:
            self._supervisor.warn(f"ecu-without-{name}", without)
        return answer

    def _arm(self, arguments: Arguments) -> Answer:
        del arguments
        if self._supervisor.trip is not None:
            raise StationRefused("tripped", f"arm: {self._supervisor.trip.slug} is latched; reset the trip first")
        limits = self._preparation.prepare_controller()
        current_A = self._preparation.prepare_coil()
        self._preparation.prove_commands()
        self._supervisor.arm()
        if self._devices.actuator.capabilities.echo and self._devices.actuator.wait_fed(ACK_TIMEOUT_S) is None:
            self._supervisor.disarm()
            raise StationRefused("watchdog-absent", "arm: the controller does not echo the watchdog counter")
        return {"limits": asdict(limits), "owner_id": self._devices.owner_id, "current_A": current_A}

    def _starve_watchdog(self, arguments: Arguments) -> Answer:
        del arguments
        self._require_motion("starve_watchdog")
        level = self._devices.actuator.capabilities.watchdog_tested
        if level == "off":
            return {"tripped_after_s": self._preparation.starve_watchdog()}
        try:
            for pressure in PRESSURE_LEVELS[1 : PRESSURE_LEVELS.index(level) + 1]:
                self._hydraulics({"level": pressure})
            after_s = self._preparation.starve_watchdog(lambda: self._hydraulics({"level": "off"}))
        except BaseException:
            # Nothing else would stop the actuator, because its watchdog is untested. Disarm retries after a failure.
            with suppress(DriverError, StationRefused, TimeoutError):
                self._hydraulics({"level": "off"})
            raise
        return {"tripped_after_s": after_s}

    # Motion and current

    def _hydraulics(self, arguments: Arguments) -> Answer:
        level = arguments.get("level")
        choices: dict[object, tuple[Command, Callable[[ActuatorStatus], bool]]] = {
            "off": (Command.HYDRAULICS_OFF, lambda status: status.hydraulics_off),
            "low": (Command.HYDRAULICS_LOW, lambda status: status.state == State.LOW),
            "on": (Command.HYDRAULICS_ON, lambda status: status.state == State.HOLD),
        }
        if level not in choices:
            raise StationRefused("bad-request", f"hydraulics: got level {level!r}, expected off, low or on")
        if level != "off":
            self._require_motion("hydraulics")
        self._await_rest("hydraulics")
        if not self._devices.actuator.capabilities.hydraulics:
            status = self._commands.fresh()
            return {"state": state_name(status.state), "supply_pressure_Pa": status.supply_pressure_Pa}
        command, reached = choices[level]
        ordered_ns = monotonic_ns()
        self._commands.command(command)
        if level == "off":
            self._repeat_off(reached)
        status = self._commands.await_status(
            reached, PRESSURE_STAYS, f"pressure level {level} not reached",
            max(0.0, HYDRAULICS_TIMEOUT_S - (monotonic_ns() - ordered_ns) * 1e-9), until_trip=level != "off",
        )
        return {"state": state_name(status.state), "supply_pressure_Pa": status.supply_pressure_Pa}

    def _repeat_off(self, reached: Callable[[ActuatorStatus], bool]) -> None:
        """Send "off" again while the controller shows pressure: not every one shows that a command was lost.

        The controller has taken the first command. A repeat that fails does not change this, so it is no link fault:
        a pressure that remains on is the finding.
        """
        for _ in range(OFF_REPEATS):
            if self._devices.actuator.wait_status(reached, OFF_AGAIN_S) is not None:
                return
            with suppress(DriverError, StationRefused):
                self._commands.command(Command.HYDRAULICS_OFF)

    def _move(self, arguments: Arguments) -> Answer:
        self._require_motion("move")
        limits = self._config.limits
        target_m = number(arguments, "target_m", limits.position_min_m, limits.position_max_m)
        speed_m_s = number(arguments, "speed_m_s", 0.0, limits.speed_m_s)
        deceleration = self._config.actuator.halt_deceleration_m_s2
        ends_m = [halted_m(target_m, way * speed_m_s, deceleration) for way in (-1.0, 1.0)]
        refuse_beyond(travel_extents(Reach(min(ends_m), max(ends_m)), limits), "a halt of the move", ROUNDING)
        self._supervisor.movement = Movement(fade_s=speed_m_s / deceleration + SPEED_WINDOW_S)
        status = self._commands.command(Command.MOVE_TO, Move(target_m, speed_m_s))
        return {"state": state_name(status.state)}

    def _set_current(self, arguments: Arguments) -> Answer:
        limit_A = self._config.limits.current_A
        lowest_A = self._devices.coil.lowest_A
        current_A = number(arguments, "current_A", -limit_A if lowest_A is None else max(-limit_A, lowest_A), limit_A)
        if current_A != 0.0:
            self._require_motion("set_current")
        self._devices.coil.set_current(current_A)
        return {"commanded_A": current_A, "measured_A": self._devices.coil.fresh_current_A}

    def _start(self, arguments: Arguments) -> Answer:
        self._require_motion("start")
        devices, supervisor, commands = self._devices, self._supervisor, self._commands
        if "hybrid" in arguments:
            return start_hybrid(arguments["hybrid"], devices, supervisor, commands)
        steps = current_program(arguments["current"], devices) if "current" in arguments else None
        if "signal" in arguments:
            answer = start_signal(arguments["signal"], devices, supervisor, commands)
        else:
            answer = start_cycles(arguments, devices, supervisor, commands)
        if steps is not None:
            CurrentSteps(steps, commands.sent_ns, devices, supervisor).start()
        return answer

    # Stops

    def _stop(self, arguments: Arguments) -> Answer:
        kind = arguments.get("kind", StopKind.FADE_OUT)
        if kind not in set(StopKind):
            raise StationRefused("bad-request", f"stop: got kind {kind!r}, expected S2, S1 or SO")
        supervisor = self._supervisor
        reason = str(arguments.get("reason", "operator"))
        supervisor.ask_stop(StopKind(str(kind)), reason, str(arguments.get("detail", "requested by the application")))
        with supervisor.changed:
            settled = wait_for(supervisor.changed, lambda: supervisor.settled, STOP_TIMEOUT_S)
        stop = supervisor.stop
        if not settled or stop is None or not supervisor.proved_safe:
            raise StationRefused("unknown", f"stop: {_not_proved(stop)} is not confirmed. Fix: inspect the rig before "
                "continuing")
        return {"stop": str(stop.kind), "standstill": stop.standstill, **supervisor.evidence()}

    def _reset(self, arguments: Arguments) -> Answer:
        """Forget a trip: only at proved standstill and 0 A, with every device there, prepared anew and free of faults.

        Raises:
            StationRefused: one of these is not proved.
        """
        del arguments
        supervisor, devices = self._supervisor, self._devices
        ended = supervisor.stop
        if not supervisor.settled:
            raise StationRefused("not-at-rest", "reset: the stop is still in progress")
        devices.revive()
        now_ns = monotonic_ns()
        still_s = devices.lvdt.still_s(now_ns)
        if still_s is None or still_s < STILL_S or not devices.actuator.rests(now_ns):
            raise StationRefused("not-at-rest", "reset: the LVDT and the controller do not both confirm standstill")
        try:
            self._preparation.prepare_coil()
        except BaseException:
            devices.coil.zero_now()  # it was to be prepared anew: 0 A is latched again
            raise
        status = self._commands.fresh()
        supervisor.starve(proving=True, feeding=True)
        try:
            self._preparation.acquire()
            if status.state == State.TRIPPED or status.fault_bits:
                self._commands.command(Command.RESET)
                self._commands.await_status(
                    lambda answer: answer.fault_bits == 0, "controller-trip", "the controller remains tripped"
                )
            limits = self._preparation.prepare_controller()
        finally:
            supervisor.starve(proving=False, feeding=True)
        self._await_quiet()
        if not supervisor.reset(ended):
            raise StationRefused("not-at-rest", "reset: a new stop was started in the meantime")
        return {"limits": asdict(limits)}

    def _disarm(self, arguments: Arguments) -> Answer:
        del arguments
        if not self._supervisor.settled:
            raise StationRefused("not-at-rest", "disarm: a stop is in progress")
        # Without the ECU's link its own time-out takes the current away: no reason to leave the pressure on.
        if not self._devices.coil.by_hand:
            with suppress(DriverError):
                self._devices.coil.set_current(0.0)
        self._hydraulics({"level": "off"})
        self._supervisor.disarm()
        self.leave()
        return self._supervisor.evidence()

    def leave(self) -> None:
        """Leave the devices as they were found; the rig is disarmed, or its stop has taken the pressure away."""
        if not self._devices.coil.by_hand:
            with suppress(DriverError):
                self._devices.coil.rest()
        self._preparation.leave_controller()

    # Reading

    def _status(self, arguments: Arguments) -> Answer:
        del arguments
        supervisor, now_ns = self._supervisor, monotonic_ns()
        trip = supervisor.trip
        answer: Answer = {
            "armed": supervisor.armed,
            "trip": None if trip is None else {"slug": trip.slug, "stop": str(trip.stop), "detail": trip.detail},
            "later": dict(supervisor.later),
            "settled": supervisor.settled,
            "late_loops": supervisor.host.count,
            "late_worst_s": supervisor.host.worst_ns / 1e9,
            "late_total_s": supervisor.host.total_ns / 1e9,
            "connected": self._connected,
        }
        if self._connected:
            answer |= supervisor.evidence()
            answer["devices"] = {device.name: device.counters(now_ns) for device in self._devices}
        return answer

    # What requests share

    def _await_rest(self, do: str) -> None:
        """Wait a moment for standstill to be seen: after a reconnection it has to be seen anew.

        Raises:
            StationRefused: it moves.
        """
        actuator = self._devices.actuator
        # Behind a trip the controller's word counts after a whole period.
        period_s = min(self._supervisor.movement.period_s, LONGEST_REST_S)
        patience_s = REST_PATIENCE_S + max(STILL_S, period_s) / self._config.device_rate
        if actuator.wait_status(lambda _: actuator.rests(monotonic_ns()), patience_s) is None:
            raise StationRefused(
                "not-at-rest", f"{do}: the actuator is moving or does not report standstill. Fix: stop the actuator "
                    "first"
            )

    def _await_quiet(self) -> None:
        """Wait until nothing that stops the rig has been found for a while.

        Raises:
            StationRefused: a cause is still there.
        """
        supervisor = self._supervisor
        deadline_ns = monotonic_ns() + QUIET_PATIENCE_NS
        while (left_ns := supervisor.trouble.t_ns + QUIET_NS - monotonic_ns()) > 0:
            if monotonic_ns() + left_ns > deadline_ns:
                raise StationRefused(supervisor.trouble.slug, f"reset: the cause persists: {supervisor.trouble.detail}")
            with supervisor.changed:
                supervisor.changed.wait(left_ns * 1e-9)

    def _require_motion(self, do: str) -> None:
        supervisor = self._supervisor
        if supervisor.trip is not None:
            raise StationRefused("tripped", f"{do}: {supervisor.trip.slug} is latched; reset the trip first")
        if not supervisor.armed:
            raise StationRefused("not-armed", f"{do}: the rig is not armed")


def _not_proved(stop: SafeStop | None) -> str:
    """What a stop that did not end safe could not prove."""
    return "standstill" if stop is None or not stop.standstill else "the state (0 A, hydraulics off)"

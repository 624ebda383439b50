"""What the application may ask for; each answer comes after the thing asked for is proved, not merely sent.

    connect                                          open everything, prove identities, measure rates
    arm                                              lease, limits written and read back, 0 A frames, interlocks on
    starve_watchdog                                  prove that the controller trips when it is not fed
    hydraulics   level=off|low|on
    move         target_m, speed_m_s
    set_current  current_A
    start        waveform, amplitude_m, frequency_Hz, centre_m, cycles, ramp_in_cycles, ramp_out_cycles[, table]
    stop         kind=S2|S1|SO, reason[, detail]
    reset                                            after a stop, at standstill and 0 A only
    disarm                                           0 A, hydraulics off, lease given back
    status, shutdown

A refusal carries a slug; motion is refused with `tripped` while a trip is latched.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict

from drivers.errors import DriverError, RequestRefused
from protocols.actuator import (
    ActuatorLimits,
    ActuatorStatus,
    Command,
    FaultBit,
    Input,
    Result,
    State,
    WatchdogAction,
    Waveform,
)
from rig.clock import monotonic_ns
from rig.station.actuator_thread import ActuatorDriver
from rig.station.config import StationConfig
from rig.station.devices import Devices, slug_of
from rig.station.errors import StationRefused
from rig.station.fault_table import Stop
from rig.station.interlocks import SPEED_WINDOW_S, Finding
from rig.station.safe_stop import STILL_S, ZERO_CURRENT_A
from rig.station.supervisor import Movement, Supervisor

Arguments = Mapping[str, object]
Answer = dict[str, object]

ACK_TIMEOUT_S = 1.0
LEASE_WAIT_S = 3.0
HYDRAULICS_TIMEOUT_S = 10.0
FIRST_DATA_S = 3.0
RATE_SAMPLES = 25
STOP_TIMEOUT_S = 60.0
READ_BACK_SHARE = 1e-6

__all__ = ["Requests"]


class Requests:
    """Carries requests out on the thread that calls `handle`."""

    def __init__(self, config: StationConfig, supervisor: Supervisor, devices: Devices) -> None:
        self._config = config
        self._supervisor = supervisor
        self._devices = devices
        self._connected = False
        self._table: dict[str, Callable[[Arguments], Answer]] = {
            "connect": self._connect,
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
            raise StationRefused("bad-request", f"no request {do!r}; known: {', '.join(self._table)}, shutdown")
        if not self._connected and do not in {"connect", "status"}:
            raise StationRefused("not-connected", f"{do}: connect first")
        try:
            return handler(arguments)
        except RequestRefused as error:
            self._supervisor.report([Finding("modbus-reject", str(error), monotonic_ns())])
            raise StationRefused("modbus-reject", str(error)) from error
        except DriverError as error:
            raise StationRefused(slug_of(error), str(error)) from error
        except TimeoutError as error:
            raise StationRefused("modbus-halfopen", f"{do}: the controller's thread did not answer in time") from error

    # Before motion

    def _connect(self, arguments: Arguments) -> Answer:
        del arguments
        if self._connected:
            raise StationRefused("bad-request", "connect: already connected")
        self._devices.open()
        try:
            self._devices.start()
            self._connected = True
            return self._prove_devices()
        except BaseException:
            self._connected = False
            self._devices.close()
            raise

    def _prove_devices(self) -> Answer:
        devices, config = self._devices, self._config
        identity = devices.actuator.identity
        if identity is None:
            raise StationRefused("no-answer", "actuator: no identity")
        if config.actuator.serial_number not in {None, identity.serial_number}:
            expected = config.actuator.serial_number
            raise StationRefused(
                "wrong-identity", f"actuator: serial number {identity.serial_number!r}, the bench expects {expected!r}"
            )
        ecu = devices.coil.wait_identity(FIRST_DATA_S)
        if ecu is None:
            raise StationRefused("no-answer", f"ecu: no identity and status frames within {FIRST_DATA_S:g} s")
        if config.ecu.serial_number not in {None, ecu.serial_number}:
            expected_number = config.ecu.serial_number
            raise StationRefused(
                "wrong-identity", f"ecu: serial number {ecu.serial_number}, the bench expects {expected_number}"
            )
        answer: Answer = {"actuator": asdict(identity), "ecu": ecu._asdict()}
        for sensor in devices.sensors:
            rate_Hz = sensor.wait_rate(RATE_SAMPLES, FIRST_DATA_S)
            if rate_Hz is None:
                slug = "serial-baud" if sensor.garbled else "no-answer"
                raise StationRefused(
                    slug,
                    f"{sensor.name}: {sensor.samples} valid samples within {FIRST_DATA_S:g} s, expected about "
                    f"{sensor.config.rate_Hz:g} a second; check baud rate and format",
                )
            answer[sensor.name] = {"rate_Hz": rate_Hz}
        return answer

    def _arm(self, arguments: Arguments) -> Answer:
        del arguments
        if self._supervisor.trip is not None:
            raise StationRefused("tripped", f"arm: {self._supervisor.trip.slug} is latched; reset first")
        limits = self._prepare_controller()
        current_A = self._prepare_coil()
        self._supervisor.arm()
        if self._devices.actuator.wait_fed(ACK_TIMEOUT_S) is None:
            self._supervisor.disarm()
            raise StationRefused("watchdog-absent", "arm: the controller does not echo the watchdog counter")
        return {"limits": asdict(limits), "owner_id": self._devices.owner_id, "current_A": current_A}

    def _prepare_controller(self) -> ActuatorLimits:
        """Take the lease, clear a trip of a silent host, write the limits and read them back."""
        actuator = self._devices.actuator
        status = self._fresh()
        if not status.inputs & Input.E_STOP_CLOSED:
            raise StationRefused("estop", "arm: the e-stop chain is open")
        self._acquire()
        if status.state == State.TRIPPED:
            if status.fault_bits != FaultBit.WATCHDOG:
                bits = FaultBit(status.fault_bits).name
                raise StationRefused("controller-trip", f"arm: the controller is tripped ({bits}); find out why, reset")
            self._command(Command.RESET)
            self._await(lambda answer: answer.state != State.TRIPPED, "controller-trip", "controller stays tripped")
        wanted = self._limits()
        actuator.call(lambda driver: driver.write_limits(wanted), ACK_TIMEOUT_S)
        found = actuator.call(lambda driver: driver.read_limits(), ACK_TIMEOUT_S)
        for name, value in asdict(wanted).items():
            if not math.isclose(getattr(found, name), value, rel_tol=READ_BACK_SHARE):
                raise StationRefused(
                    "modbus-write-lost", f"arm: wrote {name} = {value}, the controller has {getattr(found, name)}"
                )
        return found

    def _acquire(self) -> None:
        """Take the lease; one left behind by a dead host runs out within `LEASE_WAIT_S`."""
        deadline_ns = monotonic_ns() + int(LEASE_WAIT_S * 1e9)
        while True:
            try:
                self._command(Command.ACQUIRE)
                break
            except StationRefused as error:
                if error.slug != "second-master":
                    raise
                if monotonic_ns() > deadline_ns:
                    raise StationRefused("two-instances", f"arm: {error.message}") from error
                self._devices.actuator.wait_status(lambda status: status.owner == 0, 0.1)
        owner = self._devices.owner_id
        self._await(
            lambda status: status.owner == owner, "second-master", f"the controller does not show owner {owner}"
        )

    def _limits(self) -> ActuatorLimits:
        limits, margins, actuator = self._config.limits, self._config.margins, self._config.actuator
        return ActuatorLimits(
            position_min_m=limits.position_min_m - margins.position_m,
            position_max_m=limits.position_max_m + margins.position_m,
            speed_max_m_s=limits.speed_m_s * (1.0 + margins.speed),
            acceleration_max_m_s2=limits.acceleration_m_s2 * (1.0 + margins.acceleration),
            force_max_N=limits.force_N * (1.0 + margins.force),
            fade_out_cycles=actuator.fade_out_cycles,
            halt_deceleration_m_s2=actuator.halt_deceleration_m_s2,
            watchdog_ms=round(actuator.watchdog_s * 1e3),
            watchdog_action=WatchdogAction.FADE_AND_HOLD,
        )

    def _prepare_coil(self) -> float:
        """0 A frames with faults cleared; proved by a status without faults."""
        coil = self._devices.coil
        coil.begin()
        if not coil.wait_clear(ACK_TIMEOUT_S):
            raise StationRefused("coil-not-ready", f"arm: ECU {coil.describe()}")
        current_A = coil.fresh_current_A
        if current_A is None or abs(current_A) >= ZERO_CURRENT_A:
            raise StationRefused("current-stuck", f"arm: measured current {current_A} A at 0 A commanded")
        return current_A

    def _starve_watchdog(self, arguments: Arguments) -> Answer:
        """Stop feeding, see the controller trip, reset it: proves that a dead host stops the rig."""
        del arguments
        self._require_motion("starve_watchdog")
        supervisor, actuator = self._supervisor, self._devices.actuator
        if actuator.judge.moving(STILL_S):
            raise StationRefused("not-at-rest", "starve_watchdog: the actuator moves")
        begin_ns = monotonic_ns()
        allowed_s = 2.0 * self._config.actuator.watchdog_s + ACK_TIMEOUT_S
        supervisor.starve(proving=True, feeding=False)
        try:
            tripped = actuator.wait_status(lambda status: bool(status.fault_bits & FaultBit.WATCHDOG), allowed_s)
            supervisor.starve(proving=True, feeding=True)
            if tripped is None:
                raise StationRefused(
                    "watchdog-absent", f"the controller did not trip within {allowed_s:g} s of not being fed"
                )
            self._command(Command.RESET)
            self._await(lambda status: status.fault_bits == 0, "controller-trip", "the watchdog's trip does not clear")
        finally:
            supervisor.starve(proving=False, feeding=True)
        return {"tripped_after_s": (tripped.received_ns - begin_ns) / 1e9}

    # Motion and current

    def _hydraulics(self, arguments: Arguments) -> Answer:
        level = arguments.get("level")
        choices: dict[object, tuple[Command, Callable[[ActuatorStatus], bool]]] = {
            "off": (Command.HYDRAULICS_OFF, lambda status: status.state == State.OFF),
            "low": (Command.HYDRAULICS_LOW, lambda status: status.state == State.LOW),
            "on": (Command.HYDRAULICS_ON, lambda status: status.state == State.HOLD),
        }
        if level not in choices:
            raise StationRefused("bad-request", f"hydraulics: level {level!r} is not one of off, low, on")
        if level != "off":
            self._require_motion("hydraulics")
        command, reached = choices[level]
        self._command(command)
        status = self._await(
            reached, "hydraulics", f"level {level} not reached", HYDRAULICS_TIMEOUT_S, only_untripped=level != "off"
        )
        return {"state": State(status.state).name, "supply_pressure_Pa": status.supply_pressure_Pa}

    def _move(self, arguments: Arguments) -> Answer:
        self._require_motion("move")
        limits = self._config.limits
        target_m = _number(arguments, "target_m", limits.position_min_m, limits.position_max_m)
        speed_m_s = _number(arguments, "speed_m_s", 0.0, limits.speed_m_s)
        deceleration = self._config.actuator.halt_deceleration_m_s2
        self._supervisor.movement = Movement(fade_s=speed_m_s / deceleration + SPEED_WINDOW_S)
        status = self._command(Command.MOVE_TO, target_position=target_m, speed=speed_m_s)
        return {"state": State(status.state).name}

    def _set_current(self, arguments: Arguments) -> Answer:
        limit_A = self._config.limits.current_A
        current_A = _number(arguments, "current_A", -limit_A, limit_A)
        if current_A != 0.0:
            self._require_motion("set_current")
        self._devices.coil.set_current(current_A)
        return {"commanded_A": current_A, "measured_A": self._devices.coil.fresh_current_A}

    def _start(self, arguments: Arguments) -> Answer:
        self._require_motion("start")
        name = str(arguments.get("waveform")).upper()
        if name not in Waveform.__members__:
            raise StationRefused("bad-request", f"start: waveform {arguments.get('waveform')!r} is not known")
        waveform = Waveform[name]
        amplitude_m = _number(arguments, "amplitude_m", 0.0, math.inf)
        frequency_Hz = _number(arguments, "frequency_Hz", 1e-3, 1e3)
        limits = self._config.limits
        centre_m = _number(arguments, "centre_m", limits.position_min_m, limits.position_max_m)
        for edge_m in (centre_m - amplitude_m, centre_m + amplitude_m):
            if not limits.position_min_m <= edge_m <= limits.position_max_m:
                raise StationRefused("matrix-infeasible", f"start: travel to {edge_m:g} m is beyond the stroke limits")
        values: dict[str, float] = {
            "waveform": waveform,
            "amplitude": amplitude_m,
            "frequency": frequency_Hz,
            "centre": centre_m,
            "cycles": _number(arguments, "cycles", 0.0, 1e6),
            "ramp_in_cycles": _number(arguments, "ramp_in_cycles", 0.0, 1e6),
            "ramp_out_cycles": _number(arguments, "ramp_out_cycles", 0.0, 1e6),
        }
        if waveform is Waveform.TABLE:
            values |= self._write_table(arguments, frequency_Hz)
        period_s = 1.0 / frequency_Hz
        self._supervisor.movement = Movement(self._config.actuator.fade_out_cycles * period_s, period_s)
        status = self._command(Command.START, **values)
        return {"program_id": status.program_id, "state": State(status.state).name}

    def _write_table(self, arguments: Arguments, frequency_Hz: float) -> dict[str, float]:
        table = arguments.get("table")
        if not isinstance(table, list) or len(table) < 2:
            raise StationRefused("bad-request", "start: waveform table needs `table`, a list of at least 2 values (m)")
        values = [float(value) for value in table]
        self._devices.actuator.call(lambda driver: driver.write_table(values), STOP_TIMEOUT_S)
        return {"table_length": len(values), "table_interval": 1.0 / (frequency_Hz * len(values))}

    # Stops

    def _stop(self, arguments: Arguments) -> Answer:
        kind = arguments.get("kind", "S2")
        if kind not in {Stop.S2, Stop.S1, Stop.SO}:
            raise StationRefused("bad-request", f"stop: kind {kind!r} is not one of S2, S1, SO")
        supervisor = self._supervisor
        reason = str(arguments.get("reason", "operator"))
        supervisor.ask_stop(Stop(str(kind)), reason, str(arguments.get("detail", "asked for by the application")))
        with supervisor.changed:
            settled = supervisor.changed.wait_for(lambda: supervisor.settled, STOP_TIMEOUT_S)
        stop = supervisor.stop
        if not settled or stop is None or not supervisor.proved_safe:
            raise StationRefused("unknown", "stop: standstill cannot be proved; go and look")
        return {"stop": str(stop.kind), "standstill": stop.standstill, **supervisor.evidence()}

    def _reset(self, arguments: Arguments) -> Answer:
        """Forget a trip: only at proved standstill and 0 A, with every device there and the controller prepared anew."""
        del arguments
        supervisor, devices = self._supervisor, self._devices
        if not supervisor.settled:
            raise StationRefused("not-at-rest", "reset: the stop is still under way")
        devices.revive()
        now_ns = monotonic_ns()
        still_s = devices.lvdt.still_s(now_ns)
        if still_s is None or still_s < STILL_S or devices.actuator.judge.moving(STILL_S):
            raise StationRefused("not-at-rest", "reset: standstill is not proved by LVDT and controller")
        self._prepare_coil()
        status = self._fresh()
        supervisor.starve(proving=True, feeding=True)
        try:
            self._acquire()
            if status.state == State.TRIPPED or status.fault_bits:
                self._command(Command.RESET)
                self._await(lambda answer: answer.fault_bits == 0, "controller-trip", "the controller stays tripped")
            limits = self._prepare_controller()
        finally:
            supervisor.starve(proving=False, feeding=True)
        supervisor.reset()
        return {"limits": asdict(limits)}

    def _disarm(self, arguments: Arguments) -> Answer:
        del arguments
        if not self._supervisor.settled:
            raise StationRefused("not-at-rest", "disarm: a stop is under way")
        self._devices.coil.set_current(0.0)
        self._hydraulics({"level": "off"})
        self._supervisor.disarm()
        status = self._command(Command.RELEASE)
        return {"state": State(status.state).name, "current_A": self._devices.coil.fresh_current_A}

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
            "late_loops": supervisor.late.count,
            "late_worst_s": supervisor.late.worst_s,
            "connected": self._connected,
        }
        if self._connected:
            answer |= supervisor.evidence()
            answer["devices"] = {device.name: device.counters(now_ns) for device in self._devices}
        return answer

    # What requests share

    def _require_motion(self, do: str) -> None:
        supervisor = self._supervisor
        if supervisor.trip is not None:
            raise StationRefused("tripped", f"{do}: {supervisor.trip.slug} is latched; reset first")
        if not supervisor.armed:
            raise StationRefused("not-armed", f"{do}: arm first")

    def _fresh(self) -> ActuatorStatus:
        status = self._devices.actuator.fresh_status(monotonic_ns())
        if status is None:
            raise StationRefused("modbus-halfopen", "no fresh status from the controller")
        return status

    def _command(self, command: Command, **values: float) -> ActuatorStatus:
        """Send a command and wait until the controller's status acknowledges it."""

        def send(driver: ActuatorDriver) -> int:
            return driver.send(command, **values)

        sequence = self._devices.actuator.call(send, ACK_TIMEOUT_S)
        status = self._await(
            lambda answer: answer.acked_sequence == sequence,
            "modbus-write-lost",
            f"{command.name} was not acknowledged",
            only_untripped=False,
        )
        if status.result != Result.DONE:
            name = Result(status.result).name if status.result in set(Result) else str(status.result)
            slug = "second-master" if status.result == Result.REFUSED_OWNER else "modbus-reject"
            raise StationRefused(slug, f"the controller refused {command.name}: {name} in state {status.state}")
        return status

    def _await(
        self,
        wanted: Callable[[ActuatorStatus], bool],
        slug: str,
        message: str,
        timeout_s: float = ACK_TIMEOUT_S,
        *,
        only_untripped: bool = False,
    ) -> ActuatorStatus:
        supervisor = self._supervisor
        status = self._devices.actuator.wait_status(
            lambda answer: wanted(answer) or (only_untripped and supervisor.trip is not None), timeout_s
        )
        if only_untripped and supervisor.trip is not None:
            raise StationRefused("tripped", f"{message}: {supervisor.trip.slug} tripped")
        if status is None:
            raise StationRefused(slug, f"{message} within {timeout_s:g} s")
        return status


def _number(arguments: Arguments, name: str, low: float, high: float) -> float:
    value = arguments.get(name)
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not low <= value <= high:
        raise StationRefused("bad-request", f"{name}: expected a number from {low:g} to {high:g}, got {value!r}")
    return float(value)

"""Checks before any motion: identities, rates, lease, limits, a coil without current, a watchdog that trips."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict

from drivers.capabilities import WatchdogKind
from drivers.current_source import SourceFault, SourceIdentity
from drivers.errors import DriverError
from drivers.roles import ActuatorLimits, ActuatorStatus, Command, FaultBit, State
from rig.bench.controller_limits import controller_limits
from rig.bench.settings import StationConfig
from rig.clock import monotonic_ns
from rig.station.command_channel import ACK_TIMEOUT_S, CommandChannel
from rig.station.errors import StationRefused
from rig.station.safe_stop import ZERO_CURRENT_A
from rig.station.supervisor import Supervisor
from rig.station.threads.actuator_thread import ActuatorThread
from rig.station.threads.devices import Device, Devices
from rig.station.threads.sensor_thread import SensorThread

LEASE_WAIT_S = 3.0
LEAVING_SHARE, LEAVING_S = 1.5, 0.2
"""So many of its times, and so much more, a watchdog that is left is given to trip (wall s)."""
FIRST_DATA_S = 3.0
RATE_SAMPLES = 25
READ_BACK_SHARE = 1e-6
TEST_TRAVEL_M = 2e-3
"""Maximum rod movement in a watchdog test under pressure (m): the permitted creep at rest."""
PROBE_A = 0.2
"""Four times what counts as no current; a coil may have it at rest."""


class Preparation:
    """Proves and prepares the devices; every method either proves its point or refuses."""

    def __init__(
        self, config: StationConfig, supervisor: Supervisor, devices: Devices, commands: CommandChannel
    ) -> None:
        self._config = config
        self._supervisor = supervisor
        self._devices = devices
        self._commands = commands

    def prove_devices(self) -> dict[str, object]:
        """Identities as the bench expects them, the coil's temperature, and data at a measured rate from every sensor.

        Returns:
            Identities of actuator and ECU, rates (Hz of the device's clock) of the sensors.

        Raises:
            StationRefused: another device, or none that sends valid data.
        """
        devices = self._devices
        in_order: tuple[Device, ...] = (devices.actuator, devices.coil, *devices.sensors)
        return {device.name: self.prove(device) for device in in_order}

    def prove(self, device: Device) -> dict[str, object]:
        """What `prove_devices` proves, of one device: its identity, or the rate of a sensor.

        Raises:
            StationRefused: another device, or one that sends no valid data.
        """
        if isinstance(device, SensorThread):
            return self._prove_sensor(device)
        return self._prove_actuator() if isinstance(device, ActuatorThread) else self._prove_ecu()

    def _prove_actuator(self) -> dict[str, object]:
        devices, config = self._devices, self._config
        identity = devices.actuator.identity
        if identity is None or devices.actuator.wait_status(lambda _: True, FIRST_DATA_S) is None:
            raise StationRefused("no-answer", f"actuator: no status received within {FIRST_DATA_S:g} s")
        if config.actuator.serial_number not in {None, identity.serial_number}:
            expected = config.actuator.serial_number
            raise StationRefused(
                "wrong-identity", f"actuator: got serial number {identity.serial_number!r}, expected {expected!r}"
            )
        return asdict(identity)

    def _prove_ecu(self) -> dict[str, object]:
        devices, config = self._devices, self._config
        ecu = self._prove_source()
        if devices.coil.identity_problem:
            raise StationRefused("wrong-identity", f"ecu: {devices.coil.identity_problem}")
        if config.ecu.serial_number is not None and (ecu is None or config.ecu.serial_number != ecu.serial_number):
            expected_number, own = config.ecu.serial_number, "none" if ecu is None else ecu.serial_number
            raise StationRefused("wrong-identity", f"ecu: got serial number {own}, expected {expected_number}")
        return {} if ecu is None else ecu._asdict()

    @staticmethod
    def _prove_sensor(sensor: SensorThread) -> dict[str, object]:
        rate_Hz = sensor.wait_rate(RATE_SAMPLES, FIRST_DATA_S)
        refusal, words = sensor.refusal
        if refusal:
            raise StationRefused(refusal, f"{sensor.name}: {words}")
        if rate_Hz is None:
            slug = "serial-baud" if sensor.garbled else "no-answer"
            raise StationRefused(
                slug,
                f"{sensor.name}: {sensor.samples} valid samples within {FIRST_DATA_S:g} s, expected about "
                f"{sensor.config.rate_Hz:g} per second; check baud rate and format",
            )
        return {"rate_Hz": rate_Hz}

    def _prove_source(self) -> SourceIdentity | None:
        """The coil's current source tells all that it should; its identity, where it has one.

        Raises:
            StationRefused: something is missing, or its frames cannot be believed: the DBC, its protection.
        """
        coil = self._devices.coil
        first_s = max(FIRST_DATA_S, 2.0 * coil.longest_period_s / self._config.device_rate)
        identity = coil.wait_identity(first_s)
        missing = coil.missing
        slug, words = coil.refusal
        if slug:
            raise StationRefused(slug, f"ecu: {words}")
        if missing:
            bad = coil.thrown_away
            failing = "; frames are received but fail their checks" if bad else ""
            message = f"ecu: no valid {' and '.join(missing)} frames within {first_s:g} s{failing}"
            raise StationRefused(bad or "no-answer", message)
        return identity

    def prepare_controller(self) -> ActuatorLimits:
        """Take the lease, clear a trip that a silent host left, write the limits and read them back.

        Raises:
            StationRefused: the controller is tripped for another reason, is held by another host, or does not hold what
                was written.
        """
        actuator = self._devices.actuator
        status = self._commands.fresh()
        if status.e_stop_open:
            raise StationRefused("estop", "arm: the e-stop chain is open")
        self.acquire()
        if status.state == State.TRIPPED:
            if status.fault_bits != FaultBit.WATCHDOG:
                bits = FaultBit(status.fault_bits).name
                raise StationRefused("controller-trip", f"arm: the controller is tripped ({bits}); find the cause, "
                    "then reset the controller")
            self._commands.command(Command.RESET)
            self._commands.await_status(
                lambda answer: answer.state != State.TRIPPED, "controller-trip", "the controller remains tripped"
            )
        limits = self._limits()
        if not (actuator.capabilities.limits_read_back or actuator.capabilities.settings_written):
            return limits
        actuator.expect_settings(False)
        actuator.call(lambda driver: driver.write_limits(limits), ACK_TIMEOUT_S)
        held = actuator.call(lambda driver: driver.read_limits(), ACK_TIMEOUT_S)
        for name, value in asdict(limits).items():
            if not math.isclose(getattr(held, name), value, rel_tol=READ_BACK_SHARE):
                raise StationRefused(
                    "modbus-write-lost", f"arm: wrote {name} = {value}, but the controller returned "
                        f"{getattr(held, name)}"
                )
        actuator.expect_settings(actuator.capabilities.settings_hash)
        return held

    def acquire(self) -> None:
        """Take the lease where there is one; one left behind by a dead host runs out within `LEASE_WAIT_S`.

        Raises:
            StationRefused: another host keeps it.
        """
        interlock = self._devices.actuator.interlock
        interlock.leased = False
        if not self._devices.actuator.capabilities.lease:
            if self._devices.actuator.capabilities.acquires:
                self._commands.command(Command.ACQUIRE)
            interlock.leased = True
            return
        deadline_ns = monotonic_ns() + int(LEASE_WAIT_S * 1e9)
        while True:
            try:
                self._commands.command(Command.ACQUIRE)
                break
            except StationRefused as error:
                if error.slug != "second-master":
                    raise
                if monotonic_ns() > deadline_ns:
                    raise StationRefused("two-instances", f"arm: {error.message}") from error
                self._devices.actuator.wait_status(lambda status: status.owner == 0, 0.1)
        owner = self._devices.owner_id
        self._commands.await_status(
            lambda status: status.owner == owner, "second-master", f"the controller does not report {owner} (this "
                "host) as the owner"
        )
        interlock.leased = True

    def _limits(self) -> ActuatorLimits:
        config = self._config
        return controller_limits(config.limits, config.margins.speed, config.actuator)

    def prepare_coil(self) -> float:
        """Send 0 A with faults cleared; proved by a status without faults.

        Returns:
            The measured current (A).

        Raises:
            StationRefused: the ECU keeps a fault, current flows, or the coil is hotter than it may become.
        """
        coil = self._devices.coil
        coil.begin()
        if not coil.wait_clear(ACK_TIMEOUT_S):
            raise StationRefused("coil-not-ready", f"arm: the ECU {coil.describe()}")
        if not coil.wait_taken(ACK_TIMEOUT_S):
            if coil.faults & SourceFault.COMMAND_CHECK:
                raise StationRefused(
                    "ecu-command",
                    f"arm: the ECU {coil.describe()} and rejects the commands; check their protection (profile, E2E "
                    "data ID, counter) and the DBC file",
                )
            raise StationRefused("coil-not-ready", f"arm: the ECU {coil.describe()}")
        current_A = coil.fresh_current_A
        if current_A is None or abs(current_A) >= ZERO_CURRENT_A:
            slug = "current-stuck" if self._devices.config.ecu.url is None else "supply-not-zero"
            raise StationRefused(slug, f"arm: measured current {current_A} A, commanded 0 A")
        coil_degC, limit_degC = coil.coil_degC, self._config.limits.coil_temperature_degC
        if coil_degC > limit_degC:
            raise StationRefused(
                "coil-temperature", f"arm: coil temperature is {coil_degC:.1f} degC, [limits] coil_temperature allows "
                f"{limit_degC:.1f} degC. Fix: let the coil cool down, or check the limit",
            )
        return current_A

    def prove_commands(self) -> None:
        """A small current comes and goes, where the source does not report commands that it throws away.

        Raises:
            StationRefused: the measured current does not follow, or does not go away again.
        """
        coil = self._devices.coil
        if coil.tells_bad_commands:
            return
        requested_A = min(PROBE_A, self._config.limits.current_A)
        measured_A, current_A = coil.try_current(requested_A), coil.fresh_current_A
        if measured_A <= 0.5 * requested_A:
            raise StationRefused(
                "ecu-command",
                f"arm: the ECU {coil.describe()}: {requested_A:g} A was commanded at rest, but the measured "
                f"current does not follow ({measured_A:.3f} A). The ECU rejects the commands, or its output stage has "
                "no power; check the protection of the command message (profile, E2E data ID, counter) and the DBC "
                "file",
            )
        if current_A is None or abs(current_A) >= ZERO_CURRENT_A:
            raise StationRefused("current-stuck", f"arm: measured current {current_A} A after the test with "
                f"{requested_A:g} A, expected 0 A")

    def starve_watchdog(self, switch_pressure_off: Callable[[], object] | None = None) -> float | None:
        """Stop feeding the watchdog, check that the controller trips, and reset it: a failed host stops the rig.

        Args:
            switch_pressure_off: switches the pressure off and confirms it, before the reset of a watchdog tested under
                pressure.

        Returns:
            Wall time until the trip (s); None for an actuator without a watchdog, which was reported on connection.

        Raises:
            StationRefused: the rod moves, the watchdog does not trip, the trip moves the rod, or the trip cannot be
                reset.
        """
        supervisor, actuator = self._supervisor, self._devices.actuator
        if actuator.capabilities.watchdog is WatchdogKind.NONE:
            return None
        if not actuator.rests(monotonic_ns()):
            raise StationRefused("not-at-rest", "starve_watchdog: the actuator is moving or does not report standstill")
        # Many watchdogs run from the first feed on.
        before = actuator.wait_fed(ACK_TIMEOUT_S)
        begin_ns = monotonic_ns()
        allowed_s = 2.0 * self._config.actuator.watchdog_s + ACK_TIMEOUT_S
        supervisor.starve(proving=True, feeding=False)
        try:
            tripped = actuator.wait_status(
                lambda status: status.received_ns > begin_ns and bool(status.fault_bits & FaultBit.WATCHDOG), allowed_s
            )
            supervisor.starve(proving=True, feeding=True)
            if tripped is None:
                raise StationRefused(
                    "watchdog-absent", f"the controller did not trip within {allowed_s:g} s after the watchdog refresh "
                        "had stopped"
                )
            if switch_pressure_off is not None:
                _check_not_moved(before, tripped)
                switch_pressure_off()
            self._commands.command(Command.RESET)
            self._commands.await_status(
                lambda status: status.fault_bits == 0, "controller-trip", "the trip caused by the watchdog test cannot "
                    "be reset"
            )
        finally:
            supervisor.starve(proving=False, feeding=True)
        return (tripped.received_ns - begin_ns) / 1e9

    def leave_controller(self) -> None:
        """Leave the controller as it was found: given back, no trip of its watchdog latched by this host's leaving.

        The rig is disarmed and its pressure off; the watchdog is not fed any more. Giving back a lease ends it; where
        there is none and it trips, it is reset. A trip that was there before is left to the operator. What goes wrong
        is only reported.
        """
        supervisor, actuator = self._supervisor, self._devices.actuator
        able, before = actuator.capabilities, actuator.interlock.status
        supervisor.starve(proving=True, feeding=False)
        actuator.interlock.leased = False
        try:
            if able.releases or able.lease:
                self._commands.command(Command.RELEASE)
            watched = able.watchdog is not WatchdogKind.NONE and not able.lease
            if watched and before is not None and not before.tripped:
                self._end_watchdog()
        except (StationRefused, DriverError, TimeoutError) as error:
            slug = error.slug if isinstance(error, StationRefused) else "modbus-halfopen"
            supervisor.warn(slug, f"the controller's original state was not restored: {error}")

    def _end_watchdog(self) -> None:
        """Wait for the trip of a watchdog that is not fed any more, and reset it.

        Raises:
            StationRefused: the trip does not clear.
            DriverError: the controller cannot be reached.
        """
        allowed_s = LEAVING_SHARE * self._config.actuator.watchdog_s + LEAVING_S
        if self._devices.actuator.wait_status(lambda status: status.watchdog_tripped, allowed_s) is None:
            return
        self._commands.command(Command.RESET)
        self._commands.await_status(
            lambda status: not status.tripped, "controller-trip", "the watchdog trip at the end of the session cannot "
                "be reset"
        )


def _check_not_moved(before: ActuatorStatus | None, tripped: ActuatorStatus) -> None:
    """Check that the watchdog trip under pressure did not move the rod.

    Raises:
        StationRefused: the rod moved, or its position is unknown.
    """
    moved_m = math.nan if before is None else abs(tripped.position_m - before.position_m)
    if not moved_m <= TEST_TRAVEL_M:
        raise StationRefused(
            "not-at-rest", f"starve_watchdog: the rod moved {1e3 * moved_m:.2f} mm during the watchdog test "
            f"under pressure; allowed: {1e3 * TEST_TRAVEL_M:g} mm"
        )

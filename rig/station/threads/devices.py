"""The station's devices: drivers, interlocks and threads, opened and checked together."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Container, Iterator

from drivers.catalogue import (
    SensorConnection,
    SupplyConnection,
    make_actuator,
    make_current_source,
    make_manual_source,
    make_sensor,
    make_supply,
)
from drivers.connection import ActuatorConnection, MotionTerms
from drivers.current_source import CurrentSource
from drivers.errors import (
    Busy,
    DamagedAnswer,
    DriverError,
    LocalEcho,
    NoAnswer,
    OtherAnswer,
    RequestRefused,
    SharedConnectionClosed,
    WrongAnswer,
    WrongIdentity,
    WrongLayout,
)
from drivers.port_causes import with_fix
from drivers.ring import Channel, Record
from drivers.roles import Sensor
from drivers.sample_stream import SampleScale
from protocols.errors import ProtocolError
from rig.bench.sensor_settings import SensorConfig
from rig.bench.settings import EcuConfig, StationConfig
from rig.station.errors import StationRefused
from rig.station.interlocks.actuator_interlock import ActuatorInterlock
from rig.station.interlocks.channel_interlock import ChannelInterlock, ChannelLimits
from rig.station.interlocks.current_interlock import EcuInterlock
from rig.station.interlocks.motion_interlock import MotionInterlock
from rig.station.supervisor import Supervisor
from rig.station.threads.actuator_thread import ActuatorThread
from rig.station.threads.current_source_thread import CurrentSourceThread
from rig.station.threads.sensor_thread import SensorRole, SensorThread
from rig.station.threads.shared_connections import SharedConnections

Append = Callable[[list[Record]], None]
Device = SensorThread | CurrentSourceThread | ActuatorThread


def motion_terms(config: StationConfig) -> MotionTerms:
    """What the driver must know of the bench when it makes the motion itself."""
    actuator, limits = config.actuator, config.limits
    return MotionTerms(
        actuator.fade_out_cycles, actuator.halt_deceleration_m_s2, config.device_rate, limits.position_min_m,
        limits.position_max_m, limits.speed_m_s, limits.acceleration_m_s2, actuator.poll_s,
        actuator.longest_setpoint_gap_s,
    )


class Devices:
    """All threads of one rig.

    Opening is all or nothing: what fails is reported together, and what was open is closed again.

    Attributes:
        append: takes records into the ring.
    """

    def __init__(self, config: StationConfig, owner_id: int, supervisor: Supervisor, append: Append) -> None:
        self.config = config
        self.owner_id = owner_id
        self.append = append
        self._supervisor = supervisor
        self._connections: dict[str, SensorConnection] = {}
        self._shared = SharedConnections(config)
        limits, margins = config.limits, config.margins
        speed_limit_m_s = limits.speed_m_s * (1.0 + margins.speed)
        self.load_cell = self._sensor(config.load_cell, append, SensorRole(
            "loadcell-pulled", Channel.FORCE,
            _interlock(config, config.load_cell, "force-limit", -limits.force_N, limits.force_N, "N"), None,
            lambda: self.actuator.force_reference(), self._actuator_ppm,
        ))
        self.lvdt = self._sensor(config.lvdt, append, SensorRole(
            "lvdt-pulled", Channel.DISPLACEMENT,
            _interlock(config, config.lvdt, "stroke-limit", limits.position_min_m, limits.position_max_m, "m"),
            MotionInterlock(speed_limit_m_s, config.lvdt.rate_Hz),
            lambda: self.actuator.position_reference(), self._actuator_ppm,
        ))
        self.auxiliary = tuple(
            self._sensor(given, append, SensorRole(
                "auxiliary-pulled", Channel(Channel.AUXILIARY_1 + index),
                _interlock(config, given, "sensor-saturated", -given.span, given.span, ""), None, None, None,
            ))
            for index, given in enumerate(config.auxiliary)
        )
        given_ecu, given_actuator = config.ecu, config.actuator
        source = _current_source(given_ecu, self._shared)
        self.coil = CurrentSourceThread(
            given_ecu,
            source,
            EcuInterlock(
                limits.current_A + margins.current_A, limits.coil_temperature_degC, lambda: self.actuator.polls,
                source.timing,
            ),
            supervisor,
            append,
        )
        driver = make_actuator(given_actuator.described, ActuatorConnection(
            given_actuator.url, given_actuator.device_id, given_actuator.timeout_s, owner_id,
            given_actuator.baudrate, given_actuator.parity,
            motion_terms(config),
        ))
        interlock = ActuatorInterlock(
            owner_id,
            driver.capabilities,
            frozen_after_ns=int(given_actuator.stale_after_s * 1e9),
            disagreement_m=config.disagreement_m,
            lag_s=(given_actuator.poll_s + config.lvdt.stale_after_s) * max(1.0, config.device_rate),
        )
        self.actuator = ActuatorThread(given_actuator, driver, interlock, self.lvdt, supervisor, append)

    def _actuator_ppm(self) -> float:
        """Rate of the controller's clock against the host's (ppm); NaN while not known."""
        return self.actuator.clock.ppm

    def _sensor(self, given: SensorConfig, append: Append, role: SensorRole) -> SensorThread:
        connection = self._connections[given.label] = SensorConnection(
            given.port, given.baudrate, given.label, role.channel, given.format,
            scale_of(given, self.config.device_rate), given.line, self._shared.bus(given.port),
            self._shared.modbus(given.port),
        )
        return SensorThread(given, make_sensor(connection), role, self._supervisor, append)

    @property
    def sensors(self) -> tuple[SensorThread, ...]:
        """Load cell, LVDT and the auxiliary channels."""
        return (self.load_cell, self.lvdt, *self.auxiliary)

    def at_another_rate(self, sensor: SensorThread, baudrate: int) -> Sensor:
        """A further driver of a sensor's port, which its own has closed, at another baud rate; nothing is opened."""
        return make_sensor(dataclasses.replace(self._connections[sensor.name], baudrate=baudrate, modbus=None))

    def __iter__(self) -> Iterator[Device]:
        return iter((*self.sensors, self.coil, self.actuator))

    def open(self) -> None:
        """Open every port; nothing moves and nothing is written to a device.

        Raises:
            StationRefused: one line for each device that cannot be reached; all ports are closed again.
        """
        problems = list(self.open_each().values())
        # A shared connection is reported once, by the first of its devices.
        problems = [one for one in problems if not isinstance(one, SharedConnectionClosed)] or problems
        if problems:
            self.close()
            raise StationRefused(slug_of(problems[0]), "\n".join(map(with_fix, problems)))

    def open_each(self) -> dict[str, DriverError | ProtocolError]:
        """Open every port that can be opened; why the others cannot, by the device's name."""
        problems: dict[str, DriverError | ProtocolError] = {}
        for device in self:
            try:
                device.open()
            except (DriverError, ProtocolError) as error:
                problems[device.name] = error
        return problems

    def start(self, but: Container[str] = ()) -> None:
        """Start every thread but those of the devices of these names; the supervisor watches the others from now on."""
        started = tuple(device for device in self if device.name not in but)
        for device in started:
            device.start()
        self._supervisor.attach(self.coil, self.actuator, self.lvdt, started)

    def revive(self) -> None:
        """Open lost ports again, as part of a reset.

        Raises:
            StationRefused: one of them is still gone.
        """
        devices: tuple[SensorThread | CurrentSourceThread, ...] = (*self.sensors, self.coil)
        for device in devices:
            try:
                device.revive()
            except DriverError as error:
                raise StationRefused(device.slug, f"reset: {error}") from error

    def close(self) -> None:
        """End every thread and close every port; they are no longer monitored."""
        self._supervisor.watchdogs.watched = ()
        for device in self:
            device.end()
            device.close()


def scale_of(given: SensorConfig, device_rate: float) -> SampleScale:
    """From a sensor's wire to SI as its bench file states it, polarity included, and its samples to time.

    Args:
        given: the sensor of the bench file.
        device_rate: device seconds that pass in one second of the host's clock.
    """
    return SampleScale(given.sensitivity, given.offset, given.rate_Hz, device_rate)


REFUSALS: tuple[tuple[type[Exception], str], ...] = (
    (WrongLayout, "register-layout"), (WrongIdentity, "wrong-identity"), (NoAnswer, "no-answer"),
    (LocalEcho, "rtu-echo"), (OtherAnswer, "modbus-mismatch"), (DamagedAnswer, "rtu-crc"),
    (WrongAnswer, "register-layout"), (ProtocolError, "register-layout"), (Busy, "modbus-busy"),
    (RequestRefused, "modbus-reject"),
)  # fmt: skip
"""By what a driver raises at connect; the first that fits."""


def slug_of(error: Exception) -> str:
    """The refusal's slug for what a driver raised at connect."""
    return next((slug for kind, slug in REFUSALS if isinstance(error, kind)), "unreachable")


def _current_source(given: EcuConfig, shared: SharedConnections) -> CurrentSource:
    """The driver of the coil's current source: a person, a supply where its address is stated, else on CAN."""
    if given.by_hand:
        return make_manual_source(given.rehearsal)
    described = given.described_supply
    if given.url is None or described is None:
        return make_current_source(*given.described_source, given.bus, shared.bus(given.port))
    return make_supply(SupplyConnection(
        given.url, described, given.poll_s, given.timeout_s, given.voltage_limit_V, given.baudrate,
        given.identity or "", given.device_id,
    ), shared.modbus(given.url))


def _interlock(
    config: StationConfig, given: SensorConfig, slug: str, low: float, high: float, unit: str
) -> ChannelInterlock:
    return ChannelInterlock(given.label, slug, ChannelLimits(low, high, given.span, config.spike_jump(given), unit))

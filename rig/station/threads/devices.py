"""The station's devices: drivers made from the configuration, their judges and threads, opened and proved together."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from drivers.actuator import ModbusActuator
from drivers.ecu import CanEcu
from drivers.errors import DriverError, NoAnswer, WrongAnswer, WrongIdentity, WrongLayout
from drivers.ring import Channel, Record
from drivers.serial_sensor import SerialSensor
from protocols.errors import ProtocolError
from protocols.line_format import LineFormat, from_description
from rig.station.config import SensorConfig, StationConfig
from rig.station.errors import StationRefused
from rig.station.interlocks.actuator_interlock import ActuatorInterlock
from rig.station.interlocks.channel_interlock import ChannelInterlock
from rig.station.interlocks.current_interlock import EcuInterlock
from rig.station.interlocks.line_interlock import ClockWatch
from rig.station.interlocks.motion_interlock import MotionInterlock
from rig.station.supervisor import Supervisor
from rig.station.threads.actuator_thread import ActuatorThread
from rig.station.threads.current_source_thread import CurrentSourceThread
from rig.station.threads.sensor_thread import SensorThread

Append = Callable[[list[Record]], None]


class Devices:
    """All threads of one rig.

    Opening is all or nothing: what fails is reported together, and what was open is closed again.
    """

    def __init__(self, config: StationConfig, owner_id: int, supervisor: Supervisor, append: Append) -> None:
        self.config = config
        self.owner_id = owner_id
        self._supervisor = supervisor
        limits, margins = config.limits, config.margins
        speed_limit_m_s = limits.speed_m_s * (1.0 + margins.speed)
        self.load_cell = self._sensor(
            config.load_cell,
            "loadcell-pulled",
            Channel.FORCE,
            _judge(config.load_cell, "force-limit", -limits.force_N, limits.force_N, "N"),
            append,
        )
        self.lvdt = self._sensor(
            config.lvdt,
            "lvdt-pulled",
            Channel.DISPLACEMENT,
            _judge(config.lvdt, "stroke-limit", limits.position_min_m, limits.position_max_m, "m"),
            append,
            MotionInterlock(speed_limit_m_s, config.lvdt.rate_Hz),
        )
        self.auxiliary = tuple(
            self._sensor(
                given,
                "auxiliary-pulled",
                Channel(Channel.AUXILIARY_1 + index),
                _judge(given, "sensor-saturated", -given.span, given.span, ""),
                append,
            )
            for index, given in enumerate(config.auxiliary)
        )
        self.coil = CurrentSourceThread(
            config.ecu,
            CanEcu(
                config.ecu.interface,
                config.ecu.channel,
                bitrate=config.ecu.bitrate,
            ),
            EcuInterlock(limits.current_A + margins.current_A, limits.coil_temperature_degC),
            supervisor,
            append,
        )
        judge = ActuatorInterlock(
            owner_id,
            frozen_after_ns=int(config.actuator.stale_after_s * 1e9),
            disagreement_m=config.disagreement_m,
            lag_s=(config.actuator.poll_s + config.lvdt.stale_after_s) * max(1.0, config.device_rate),
        )
        driver = ModbusActuator(
            config.actuator.url,
            device_id=config.actuator.device_id,
            timeout_s=config.actuator.timeout_s,
            owner_id=owner_id,
            baudrate=config.actuator.baudrate,
            parity=config.actuator.parity,
        )
        self.actuator = ActuatorThread(config.actuator, driver, judge, self.lvdt, supervisor, append)
        self.coil.judge.controller_polls = lambda: self.actuator.polls
        self.actuator.speed_source = lambda: self.lvdt.speed_m_s
        self.actuator.clock = ClockWatch(config.device_rate)
        for sensor in (self.load_cell, self.lvdt):
            sensor.reference_ppm = lambda: self.actuator.clock.ppm
        self.load_cell.reference = self.actuator.force_reference
        self.lvdt.reference = self.actuator.position_reference

    def _sensor(
        self,
        given: SensorConfig,
        slug: str,
        channel: Channel,
        judge: ChannelInterlock,
        append: Append,
        motion: MotionInterlock | None = None,
    ) -> SensorThread:
        # The bench states the offset as what the sensor shows at zero; the driver adds its own to the scaled value.
        driver = SerialSensor(
            given.url,
            given.baudrate,
            name=given.name,
            channel=channel,
            line_format=_line_format(given),
            sensitivity=given.sensitivity,
            offset=-given.offset,
            rate_Hz=given.rate_Hz,
            device_rate=self.config.device_rate,
        )
        return SensorThread(
            given, slug, channel, driver, judge, self._supervisor, append, motion, self.config.device_rate
        )

    @property
    def sensors(self) -> tuple[SensorThread, ...]:
        """Load cell, LVDT and the auxiliary channels."""
        return (self.load_cell, self.lvdt, *self.auxiliary)

    def __iter__(self) -> Iterator[SensorThread | CurrentSourceThread | ActuatorThread]:
        return iter((*self.sensors, self.coil, self.actuator))

    def open(self) -> None:
        """Open every port; nothing moves and nothing is written to a device.

        Raises:
            StationRefused: one line for each device that cannot be reached; all ports are closed again.
        """
        problems = []
        for device in self:
            try:
                device.open()
            except (DriverError, ProtocolError) as error:
                problems.append(error)
        if problems:
            self.close()
            slug = next((slug_of(error) for error in problems), "unreachable")
            raise StationRefused(slug, "\n".join(str(error) for error in problems))

    def start(self) -> None:
        """Start every thread; the supervisor watches them from now on."""
        for device in self:
            device.start()
        self._supervisor.attach(self.coil, self.actuator, self.lvdt, tuple(self))

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
        """End every thread and close every port."""
        for device in self:
            device.end()
            device.close()


def slug_of(error: Exception) -> str:
    """The refusal's slug for what a driver raised at connect."""
    if isinstance(error, WrongLayout):
        return "register-layout"
    if isinstance(error, WrongIdentity):
        return "wrong-identity"
    if isinstance(error, NoAnswer):
        return "no-answer"
    if isinstance(error, (WrongAnswer, ProtocolError)):
        return "register-layout"
    return "unreachable"


def _judge(given: SensorConfig, slug: str, low: float, high: float, unit: str) -> ChannelInterlock:
    return ChannelInterlock(
        given.name, slug, low=low, high=high, span=given.span, spike_jump=given.spike_jump, unit=unit
    )


def _line_format(given: SensorConfig) -> str | LineFormat:
    return given.format if isinstance(given.format, str) else from_description(given.format)

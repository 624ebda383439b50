"""Devices by name: the one door through which the rig comes by an actuator, a current source or a sensor.

A name is a description in `drivers.devices` or a wire format, driven by the generic driver, or a driver of its own:
another package's plug-in (`drivers.plugins`), or made known by `register_actuator` or `register_sensor` before the
bench file is read. Where names are the same, ours comes first.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from drivers import plugins
from drivers.can_bus import CanBus, CanSensorPort
from drivers.can_current_source import CanCurrentSource
from drivers.can_port import CanPort
from drivers.connection import ActuatorConnection, CanAddress, LineSettings
from drivers.current_source import CurrentSource
from drivers.devices.dbc_file import DbcText
from drivers.devices.ecu_description import COMMAND, CURRENT
from drivers.devices.source import Given, current_source, current_source_names
from drivers.devices.supply import SupplyConnection, SupplyDescription
from drivers.devices.supply_file import supply, supply_names
from drivers.errors import UnknownDevice
from drivers.manual_current import ManualCurrentSource
from drivers.register_maps.map_file import Described as RegisterMap
from drivers.register_maps.map_file import controller, controller_names
from drivers.ring import Channel
from drivers.roles import Actuator, ActuatorLimits, Sensor
from drivers.sample_stream import SampleScale
from drivers.scpi_supply import ScpiSupply
from drivers.sensor_formats import described_format
from drivers.sensor_formats import wire_text as sensor_wire_text
from drivers.serial_sensor import BINARY, CLOCKED, USUAL, SerialSensor
from drivers.streamed_actuator import as_actuator
from protocols.binary_format import BinaryFormat, Registers
from protocols.sensor_presets import TABLES

if TYPE_CHECKING:
    from drivers.modbus_line import ModbusLine

__all__ = [
    "DbcText",
    "SensorConnection",
    "SupplyConnection",
    "SupplyDescription",
    "actuator_names",
    "check_actuator",
    "check_current_source",
    "check_sensor_format",
    "clocked_format_names",
    "current_source_names",
    "current_source_period_s",
    "current_source_range_A",
    "current_source_steps_A",
    "current_source_timeout_s",
    "known_current_source_names",
    "make_actuator",
    "make_current_source",
    "make_manual_source",
    "make_sensor",
    "make_supply",
    "own_names",
    "register_actuator",
    "register_sensor",
    "sensor_format_names",
    "sensor_wire_text",
    "supply",
    "supply_names",
    "unheld_limits",
    "watchdog_time_s",
]

REHEARSED_V = 60.0
"""Voltage limit of a simulated rig's supply that is set in a person's place."""
ActuatorMaker = Callable[[ActuatorConnection], Actuator]

_REGISTERED: dict[str, ActuatorMaker] = {}


def own_names(group: str) -> frozenset[str]:
    """The names of a group of drivers that are this program's own: no plug-in can have one of them."""
    own = {
        plugins.ACTUATORS: (*controller_names(), *_REGISTERED),
        plugins.CURRENT_SOURCES: current_source_names(),
        plugins.SENSORS: (*BINARY, *TABLES, *_SENSORS),
    }
    return frozenset(own[group])


def register_actuator(name: str, maker: ActuatorMaker) -> None:
    """Make an actuator's own driver known under a name of the bench file's `register_map`."""
    _REGISTERED[name] = maker


def actuator_names() -> tuple[str, ...]:
    """Every name that `register_map` may have."""
    return tuple(dict.fromkeys((*controller_names(), *_REGISTERED, *plugins.names(plugins.ACTUATORS))))


def known_current_source_names() -> tuple[str, ...]:
    """Every name that `dbc` may have."""
    return tuple(dict.fromkeys((*current_source_names(), *plugins.names(plugins.CURRENT_SOURCES))))


def check_actuator(name: str) -> None:
    """Load the driver of a known actuator that is a plug-in's; the others need no look.

    Raises:
        BrokenPlugIn: its driver cannot be used.
    """
    if name not in controller_names() and name not in _REGISTERED:
        plugins.maker_of(plugins.ACTUATORS, name)


def _has_map(given: RegisterMap) -> bool:
    """Whether an actuator is one with a register map, not one with a driver of its own."""
    return not isinstance(given, str) or (given not in _REGISTERED and given in controller_names())


def watchdog_time_s(given: RegisterMap) -> float:
    """Time after which the watchdog of an actuator trips, where it is fixed and its map states it; else 0 (s).

    Args:
        given: a name, or the table of a register map.
    """
    return controller(given).fixed_watchdog_s if _has_map(given) else 0.0


def unheld_limits(given: RegisterMap, limits: ActuatorLimits) -> list[str]:
    """Why the registers of an actuator cannot hold limits; empty where they can, or it has no register map.

    Args:
        given: a name, or the table of a register map.
        limits: of the rig.
    """
    return controller(given).unheld_limits(limits) if _has_map(given) else []


def check_current_source(name: str) -> None:
    """Hold a known current source's description and DBC against what its driver needs; a driver of its own is loaded.

    Raises:
        LocalProtocolError: they cannot be read, or contradict each other.
        BrokenPlugIn: its driver cannot be used.
    """
    if name in current_source_names():
        current_source(name)
    else:
        plugins.maker_of(plugins.CURRENT_SOURCES, name)


def check_sensor_format(name: str) -> None:
    """Load the driver of a known format that is a plug-in's; the others need no look.

    Raises:
        BrokenPlugIn: its driver cannot be used.
    """
    if name not in (*BINARY, *TABLES, *_SENSORS):
        plugins.maker_of(plugins.SENSORS, name)


def _is_described(given: Given) -> bool:
    """Whether a current source is one of a DBC and roles, not one with a driver of its own."""
    return isinstance(given, DbcText) or given in current_source_names()


def current_source_range_A(given: Given, roles: Mapping[str, Any] | None) -> tuple[float, float]:
    """Lowest and highest current (A) that the set-point of a current source can hold; of a plug-in's all.

    Args:
        given: a name, or a user's DBC.
        roles: of a user's DBC file.
    """
    if not _is_described(given):
        return -math.inf, math.inf
    described = current_source(given, roles)
    return described.low_A, described.high_A


def current_source_steps_A(given: Given, roles: Mapping[str, Any] | None) -> tuple[float, float]:
    """Resolution (A) of a current source's set-point and of its measured current; 0 if it is not stated.

    Args:
        given: a name, or a user's DBC.
        roles: of a user's DBC file.
    """
    if not _is_described(given):
        return 0.0, 0.0
    signals = current_source(given, roles).signals

    def step_A(role: str) -> float:
        signal = signals[role][1] if role in signals else None
        return 0.0 if signal is None or signal.is_float else abs(signal.scale)

    return step_A(COMMAND), step_A(CURRENT)


def current_source_period_s(given: Given, roles: Mapping[str, Any] | None) -> float:
    """How often a current source reports its current (s of its clock); 0 for a plug-in's, which states it at run time.

    Args:
        given: a name, or a user's DBC.
        roles: of a user's DBC file.
    """
    return current_source(given, roles).timing.status_s if _is_described(given) else 0.0


def current_source_timeout_s(given: DbcText, roles: Mapping[str, Any] | None) -> float | None:
    """Time without a command after which a user's current source goes to 0 A itself (s); None: not stated."""
    return current_source(given, roles).command_timeout_s


def current_source_commands(given: Given, roles: Mapping[str, Any] | None) -> frozenset[tuple[int, bool]]:
    """Identifiers of the frames that command a current source, each with whether it is extended; none for a plug-in.

    Args:
        given: name, or the DBC of a user.
        roles: roles for the DBC of a user.
    """
    if not _is_described(given):
        return frozenset()
    return frozenset((frame.identifier, frame.extended) for frame in current_source(given, roles).sent)


def make_actuator(given: RegisterMap, connection: ActuatorConnection) -> Actuator:
    """The driver of a kind of actuator; nothing is opened. One that only follows set-points is streamed them.

    Args:
        given: a name, or the table of a register map.
        connection: address and settings of the device.

    Raises:
        UnknownDevice: no device of that name; the known ones are listed.
        BrokenPlugIn: the plug-in cannot be used.
    """
    if isinstance(given, str) and not _has_map(given):
        name = given
        if name in _REGISTERED:
            return as_actuator(_REGISTERED[name](connection), connection.motion)
        brought: Actuator | None = plugins.made(plugins.ACTUATORS, name, Actuator, connection)
        if brought is not None:
            return as_actuator(brought, connection.motion)
        raise UnknownDevice(
            "actuator", connection.url, f"unknown register_map {name!r}; known: {', '.join(actuator_names())}"
        )
    from drivers.modbus_actuator import ModbusActuator

    return as_actuator(ModbusActuator(connection, controller(given)), connection.motion)


def make_current_source(
    given: Given, roles: Mapping[str, Any] | None, bus: CanAddress, shared: CanBus | None = None
) -> CurrentSource:
    """Create the driver of a current source on CAN, without opening the bus.

    Args:
        given: name of a type of current source, or a user's DBC file.
        roles: of a user's DBC file.
        bus: of the current source.
        shared: the bus, if it is shared with sensors; a plug-in driver opens its own bus object.

    Raises:
        UnknownDevice: no device of that name; the known ones are listed.
        LocalProtocolError: a DBC and its roles cannot be used.
        BrokenPlugIn: the plug-in cannot be used.
    """
    if isinstance(given, str) and not _is_described(given):
        name, address = given, (bus.interface, bus.channel, bus.bitrate)
        further = {"roles": roles, "options": dict(bus.options)}
        brought: CurrentSource | None = plugins.made(plugins.CURRENT_SOURCES, name, CurrentSource, *address, **further)
        if brought is not None:
            return brought
        raise UnknownDevice(
            "ecu", bus.channel, f"unknown dbc {name!r}; known: {', '.join(known_current_source_names())}"
        )
    described = current_source(given, roles)
    if shared is None:
        return CanCurrentSource(CanPort(bus, fd=described.fd), described)
    return CanCurrentSource(shared.join("ecu", described.hears, rest=True, fd=described.fd), described)


def make_supply(connection: SupplyConnection, line: ModbusLine | None = None) -> CurrentSource:
    """Create the driver of a supply or analogue output for the coil, without opening it.

    Args:
        connection: address and settings of the device.
        line: of an output, the connection that it shares with sensors.
    """
    if connection.description.output is None:
        return ScpiSupply(connection)
    # loads pymodbus: only when needed
    from drivers.modbus_output import ModbusOutput

    return ModbusOutput(connection, connection.description.output, line)


def make_manual_source(rehearsal: str | None) -> CurrentSource:
    """The current that a person sets; nothing is opened.

    Args:
        rehearsal: on a simulated rig, the address of its `generic-scpi` supply, set in that person's place.
    """
    if rehearsal is None:
        return ManualCurrentSource()
    stand_in = make_supply(SupplyConnection(rehearsal, supply("generic-scpi"), voltage_limit_V=REHEARSED_V))
    return ManualCurrentSource(stand_in)


@dataclass(frozen=True, slots=True)
class SensorConnection:
    """Connection and format of a sensor.

    Attributes:
        url: its port.
        baudrate: Bd.
        name: device name for messages, as in the bench file.
        channel: ring channel 1..9.
        format: name of a format, or its table.
        scale: from the wire to SI, and its rate.
        framing: other settings of its serial line; its baud rate is ignored.
        bus: for a sensor on CAN.
        modbus: for a sensor with Modbus registers, the connection that it shares with other devices.
    """

    url: str
    baudrate: int
    name: str
    channel: Channel
    format: str | Mapping[str, Any]
    scale: SampleScale
    framing: LineSettings = USUAL
    bus: CanBus | None = None
    modbus: ModbusLine | None = None


SensorMaker = Callable[[SensorConnection], Sensor]

_SENSORS: dict[str, SensorMaker] = {}


def register_sensor(name: str, maker: SensorMaker) -> None:
    """Make a sensor's own driver known under a name of the bench file's `format`: one that is asked for its samples."""
    _SENSORS[name] = maker


def sensor_format_names() -> tuple[str, ...]:
    """Every name that a sensor's `format` may have, in addition to a file's name and a table."""
    return tuple(dict.fromkeys((*BINARY, *TABLES, *_SENSORS, *plugins.names(plugins.SENSORS))))


def clocked_format_names() -> tuple[str, ...]:
    """Formats that carry the sensor's clock and latched edges, by which skew is measured."""
    return CLOCKED


def make_sensor(connection: SensorConnection) -> Sensor:
    """The driver of a sensor; nothing is opened.

    Raises:
        LocalProtocolError: no format of that name, or a description that contradicts itself.
        BrokenPlugIn: the plug-in cannot be used.
    """
    given = connection.format
    if isinstance(given, str) and given in _SENSORS:
        return _SENSORS[given](connection)
    if isinstance(given, str) and given not in (*BINARY, *TABLES):
        brought: Sensor | None = plugins.made(plugins.SENSORS, given, Sensor, connection)
        if brought is not None:
            return brought
    line_format = given if isinstance(given, str) and given in BINARY else described_format(given, connection.channel)
    if isinstance(line_format, BinaryFormat) and line_format.registers is not None:
        return _modbus_sensor(connection, line_format, line_format.registers)
    port: CanSensorPort | None = None
    if connection.bus is not None and isinstance(line_format, BinaryFormat) and line_format.can is not None:
        port = CanSensorPort(connection.bus, connection.name, line_format.can)
    return SerialSensor(
        connection.url, replace(connection.framing, baudrate=connection.baudrate), name=connection.name,
        channel=connection.channel, line_format=line_format, scale=connection.scale, port=port,
    )


def modbus_connection(url: str, line: LineSettings, device_rate: float, *, rtu: bool) -> ModbusLine:
    """Create a connection for Modbus sensors and an analogue output, without opening it.

    Args:
        url: `modbus-tcp://host:port`, `socket://host:port`, or a serial port.
        line: settings of the serial line.
        device_rate: device seconds that pass in one second of the host's clock.
        rtu: Modbus RTU, else Modbus TCP.
    """
    # loads pymodbus: only when needed
    from drivers.modbus_line import ModbusLine

    return ModbusLine(url, line, rtu=rtu, device_rate=device_rate)


def _modbus_sensor(connection: SensorConnection, layout: BinaryFormat, registers: Registers) -> Sensor:
    # loads pymodbus: only when needed
    from drivers.modbus_line import ModbusSensor

    line = connection.modbus or modbus_connection(
        connection.url, replace(connection.framing, baudrate=connection.baudrate), connection.scale.device_rate,
        rtu=registers.rtu,
    )
    return ModbusSensor(
        line, name=connection.name, channel=connection.channel, layout=layout, registers=registers,
        scale=connection.scale,
    )

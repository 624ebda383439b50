"""Devices by name: the one door through which the rig comes by an actuator or a current source.

A name is a description in `drivers.devices`, driven by the generic driver, or a driver class of its own, made known by
`register_actuator` before the bench file is read.
"""

from __future__ import annotations

from collections.abc import Callable

from drivers.connection import ActuatorConnection
from drivers.current_source import CurrentSource
from drivers.devices.controller import controller, controller_names
from drivers.devices.source import current_source_names
from drivers.errors import UnknownDevice
from drivers.roles import Actuator

__all__ = [
    "actuator_names", "current_source_names", "make_actuator", "make_current_source", "register_actuator",
]

ActuatorMaker = Callable[[ActuatorConnection], Actuator]

_REGISTERED: dict[str, ActuatorMaker] = {}


def register_actuator(name: str, maker: ActuatorMaker) -> None:
    """Make an actuator's own driver known under a name of the bench file's `register_map`."""
    _REGISTERED[name] = maker


def actuator_names() -> tuple[str, ...]:
    """Every name that `register_map` may have."""
    return (*controller_names(), *_REGISTERED)


def make_actuator(name: str, connection: ActuatorConnection) -> Actuator:
    """The driver of a kind of actuator; nothing is opened.

    Raises:
        UnknownDevice: no device of that name; the known ones are listed.
    """
    if name in _REGISTERED:
        return _REGISTERED[name](connection)
    if name not in controller_names():
        raise UnknownDevice(
            "actuator", connection.url, f"register_map {name!r} is not known; known: {', '.join(actuator_names())}"
        )
    from drivers.modbus_actuator import ModbusActuator

    return ModbusActuator(connection, controller(name))


def make_current_source(name: str, interface: str, channel: str, bitrate: int) -> CurrentSource:
    """The driver of a kind of current source; nothing is opened.

    Raises:
        UnknownDevice: no device of that name; the known ones are listed.
    """
    if name not in current_source_names():
        raise UnknownDevice(
            "ecu", channel, f"dbc {name!r} is not known; known: {', '.join(current_source_names())}"
        )
    from drivers.can_current_source import CanCurrentSource
    from drivers.devices.source import current_source

    return CanCurrentSource(interface, channel, current_source(name), bitrate=bitrate)

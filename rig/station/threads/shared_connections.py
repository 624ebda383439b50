"""Connections shared by several devices of a bench: CAN buses, Modbus servers and serial lines."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.can_bus import CanBus
from drivers.catalogue import modbus_connection
from drivers.connection import modbus_line
from drivers.sensor_formats import registers_of
from rig.bench.settings import StationConfig

if TYPE_CHECKING:
    from drivers.modbus_line import ModbusLine


class SharedConnections:
    """One connection for all devices at one address, created before the drivers that use it.

    Args:
        config: configuration of the station.
    """

    def __init__(self, config: StationConfig) -> None:
        self._buses: dict[str, CanBus] = {}
        self._lines: dict[str, ModbusLine] = {}
        for given in config.sensors:
            bus, registers, line = given.bus, registers_of(given.described), modbus_line(given.port)
            if bus is not None and given.port not in self._buses:
                self._buses[given.port] = CanBus(bus)
            if registers is not None and line not in self._lines:
                self._lines[line] = modbus_connection(given.port, given.line, config.device_rate, rtu=registers.rtu)

    def modbus(self, port: str | None) -> ModbusLine | None:
        """The connection of Modbus sensors at this address, or None."""
        return self._lines.get(modbus_line(port or ""))

    def bus(self, port: str) -> CanBus | None:
        """The CAN bus with this name, if it has sensors, or None."""
        return self._buses.get(port)
